"""One Craig-Bampton problem, 60 constraint modes and 50 normal modes, by cmsreduce and its peers, body by body.

``python benchmarks/linear_algebra.py`` runs the short list, ``--full`` the long one; ``--bodies`` and ``--peers`` pick.
Every run is stored in build/bench; ``--write`` makes benchmarks/performance.md from all stored runs.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks import contest, machine_limits, performance_page  # noqa: E402
from benchmarks.meshes import BODIES  # noqa: E402

SHORT_BODIES = ("bar-3e3", "bar-1e4", "box-1e4", "block-1e4", "bar-3e4")
SHORT_PEERS = ("cmsreduce", "scipy", "scipy-mmd", "scipy-metis")
FULL_BODIES = ("bar-3e3", "bar-3e4", "bar-1e5", "bar-3e5", "box-1e5", "block-1e5", "tets-3e5")
# Limits of each peer and of the short list as a whole.
SHORT_LIMIT_S, SHORT_TOTAL_S, FULL_LIMIT_S = 30.0, 110.0, 480.0


def main(arguments: list[str]) -> None:
    """Run the chosen bodies and peers, print tables, write the page."""
    given = _parser().parse_args(arguments)
    threads = given.threads
    bodies = given.bodies or (FULL_BODIES if given.full else SHORT_BODIES)
    peers = given.peers or (tuple(contest.PEERS) if given.full else SHORT_PEERS)
    each = given.limit or (FULL_LIMIT_S if given.full else SHORT_LIMIT_S)
    whole = float("inf") if given.full or given.bodies or given.limit else SHORT_TOTAL_S
    started = time.perf_counter()
    if not given.page:
        if given.full or given.limits:
            own = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), str(threads))
            command = [sys.executable, str(ROOT / "benchmarks" / "machine_limits.py"), str(threads)]
            subprocess.run(command, env={**os.environ, **own}, check=True)
        for body in bodies:
            with tempfile.TemporaryDirectory(dir=given.scratch) as scratch:
                contest.make(body, Path(scratch))
                for peer in peers:
                    left = whole - (time.perf_counter() - started)
                    limit = min(each, left)
                    record = contest.compete(peer, body, BODIES[body].n, Path(scratch), threads, max(limit, 1.0))
                    contest.save(record)
            print("\n".join(performance_page.body_table(body, contest.records(), only=peers)) + "\n", flush=True)
            print("\n".join(performance_page.search_table(body, contest.records())), flush=True)
    if given.write:
        performance_page.write(contest.records(), machine_limits.load())


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--full", action="store_true", help="every peer on the bodies of the page; hours")
    parser.add_argument("--bodies", nargs="+", choices=tuple(BODIES), metavar="BODY", help=", ".join(BODIES))
    parser.add_argument(
        "--peers", nargs="+", choices=tuple(contest.PEERS), metavar="PEER", help=", ".join(contest.PEERS)
    )
    parser.add_argument("--limit", type=float, metavar="SECONDS", help="stop a peer after so long")
    parser.add_argument("--threads", type=int, default=len(os.sched_getaffinity(0)), help="threads of each peer")
    parser.add_argument("--limits", action="store_true", help="measure the machine's limits as well")
    parser.add_argument("--scratch", help="folder for the matrices; 5 GB at 3e6 dofs")
    parser.add_argument("--page", action="store_true", help="run nothing; with --write, the page of what is kept")
    parser.add_argument("--write", action="store_true", help="write benchmarks/performance.md and its picture")
    return parser


if __name__ == "__main__":
    main(sys.argv[1:])
