"""Memory of a reduction against the columns of its basis, in memory and on disk.

``python benchmarks/out_of_core.py [COLUMNS ...]`` reduces a solid bar to that many constraint modes, makes them
orthonormal, stores both and reads them back; each line is a process of its own. ``anonymous`` is the growth of the
largest memory without a file behind it (RssAnon of Linux, every 5 ms) since the body was read; the system can drop
pages of a mapped file. 0.1 GiB of the growth is a block of right-hand sides.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks.meshes import free_bar  # noqa: E402
from cmsreduce.linalg.machine import SolverSettings, solver_settings  # noqa: E402
from cmsreduce.model import mapped_in  # noqa: E402
from cmsreduce.orthogonalise import orthogonalise  # noqa: E402
from cmsreduce.pipeline.store import decode, encode  # noqa: E402
from cmsreduce.pipeline.store.stage_store import StageStore  # noqa: E402
from cmsreduce.reduce import Guyan  # noqa: E402

# 21 168 dofs; its end is the interface.
CELLS = (35, 13, 13)
COLUMNS = (120, 240, 480)
MIB = 2.0**20


def anonymous() -> float:
    """Bytes of this process without a file behind them."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("RssAnon:"):
            return float(line.split()[1]) * 1024
    raise SystemExit("/proc/self/status has no RssAnon: this needs Linux")


class Peak:
    """Largest anonymous memory while the block lasts."""

    def __enter__(self) -> Peak:
        self.before = self.most = anonymous()
        self._stop = threading.Event()
        self._watch = threading.Thread(target=self._look)
        self._watch.start()
        return self

    def _look(self) -> None:
        while not self._stop.wait(0.005):
            self.most = max(self.most, anonymous())

    def __exit__(self, *exception: object) -> None:
        self._stop.set()
        self._watch.join()

    @property
    def beyond(self) -> float:
        """Growth in bytes."""
        return self.most - self.before


def measured(columns: int, *, disk: bool) -> dict[str, float]:
    """Reduce the bar in this process."""
    body = free_bar(CELLS)
    interface = np.arange(body.n - columns, body.n)
    with tempfile.TemporaryDirectory() as folder:
        settings = SolverSettings(memory=1.9e8, scratch=Path(folder)) if disk else SolverSettings()
        store, started = StageStore(Path(folder)), time.perf_counter()
        with solver_settings(settings), Peak() as peak:
            component = Guyan(0.0).reduce(body, interface)
            modal = orthogonalise(component)
            del component
            assert (mapped_in(modal.Phi) is not None) == disk
            store.save("orthogonalise", "bar", "key", *encode(modal))
            del modal
            found = store.load("orthogonalise", "bar", "key")
            assert found is not None
            omega = decode(*found, {"FEModel": {"bar": body}}).omega
        seconds = time.perf_counter() - started
    return {
        "dofs": body.n,
        "basis": 8 * body.n * columns / MIB,
        "anonymous": peak.beyond / MIB,
        "seconds": seconds,
        "highest": float(omega.max()),
    }


def main(columns: tuple[int, ...]) -> None:
    """Measure each count of columns both ways, and print the table."""
    print("| columns | basis, MiB | anonymous in memory, MiB | on disk, MiB | time on disk | frequencies |")
    print("|---|---|---|---|---|---|")
    for count in columns:
        memory, disk = (
            json.loads(subprocess.check_output([sys.executable, __file__, "--one", str(count), kind]))
            for kind in ("memory", "disk")
        )
        print(
            f"| {count} | {disk['basis']:.0f} | {memory['anonymous']:.0f} | {disk['anonymous']:.0f} "
            f"| {disk['seconds'] / memory['seconds']:.2f} | {abs(disk['highest'] / memory['highest'] - 1):.0e} |"
        )


if __name__ == "__main__":
    if sys.argv[1:2] == ["--one"]:
        print(json.dumps(measured(int(sys.argv[2]), disk=sys.argv[3] == "disk")))
    else:
        main(tuple(int(text) for text in sys.argv[1:]) or COLUMNS)
