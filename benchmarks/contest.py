"""The peers, and the run of one peer on one body in a process with limits on threads, time and memory."""

from __future__ import annotations

import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

from cmsreduce.linalg.machine import available_memory

ROOT = Path(__file__).resolve().parents[1]
HERE = ROOT / "benchmarks" / "peers"
RECORDS = ROOT / "build" / "bench"
# Environments of peers that would not share one with the project; `make bench-peers` makes them.
ENVIRONMENTS = ROOT / "build" / "peers"
_DEBIAN = {
    "PETSC_DIR": "/usr/lib/petscdir/petsc3.18/x86_64-linux-gnu-real",
    "SLEPC_DIR": "/usr/lib/slepcdir/slepc3.18/x86_64-linux-gnu-real",
}
# Reserve for the system, so that a peer that takes all memory is stopped by its own limit, not by the system.
_MEMORY_SHARE = 0.92
# Messages of peers that lack memory; PETSc has error 55, and MUMPS -13, which PETSc reports as 76.
_SHORT_OF_MEMORY = (
    "MemoryError",
    "Cannot allocate",
    "ut of memory",
    "Not enough memory",
    "error code 55",
    "emory limit",
)


@dataclass(frozen=True)
class Peer:
    """One way to the same modes.

    Parameters
    ----------
    title : str
        Name in the tables.
    script : str
        File in benchmarks/peers.
    arguments : tuple of str
        Arguments of the script.
    python : str
        Interpreter it runs in.
    needs : str
        Python that fails where the peer is not installed.
    largest : int, optional
        Dofs beyond which it is not tried.
    processes : int
        Started by mpiexec, where more than one; threads are then one each.
    environment : dict
        Environment variables of its own.
    """

    title: str
    script: str
    arguments: tuple[str, ...] = ()
    python: str = sys.executable
    needs: str = ""
    largest: int | None = None
    processes: int = 1
    environment: dict[str, str] = field(default_factory=dict)

    def absent(self) -> bool:
        """True if the peer is not installed."""
        if shutil.which(self.python) is None or (self.processes > 1 and shutil.which("mpiexec") is None):
            return True
        test = [self.python, "-c", self.needs]
        done = subprocess.run(test, env={**os.environ, **self.environment}, capture_output=True, check=False)
        return done.returncode != 0

    def command(self, folder: Path) -> list[str]:
        """The command line."""
        start = ["mpiexec", "--allow-run-as-root", "-n", str(self.processes)] if self.processes > 1 else []
        return [*start, self.python, str(HERE / self.script), str(folder), *self.arguments]


def _slepc(title: str, *arguments: str, processes: int = 1) -> Peer:
    python, needs = "/usr/bin/python3", "import petsc4py, slepc4py"
    return Peer(title, "slepc.py", arguments, python, needs, processes=processes, environment=_DEBIAN)


def _own(title: str, name: str, largest: int | None = None) -> Peer:
    python = str(ENVIRONMENTS / name / "bin" / "python")
    quiet = {"QT_QPA_PLATFORM": "offscreen"}
    return Peer(title, f"{name}_cms.py", (), python, f"import {name}", largest, environment=quiet)


def _over(title: str, script: str, backend: str) -> Peer:
    """A search over the factor of one of cmsreduce's backends."""
    return Peer(title, script, (backend,), environment={"PYTHONPATH": str(ROOT)})


OURS = "cmsreduce"
PEERS = {
    OURS: Peer("cmsreduce", "ours.py", environment={"PYTHONPATH": str(ROOT)}),
    f"{OURS}-single": Peer(
        "cmsreduce, single-precision factor", "ours.py", ("single",), environment={"PYTHONPATH": str(ROOT)}
    ),
    f"{OURS}-disk": Peer(
        "cmsreduce, factor on disk",
        "ours.py",
        ("double", "uncounted", "on-disk"),
        environment={"PYTHONPATH": str(ROOT)},
    ),
    f"{OURS}-multifrontal": _over("cmsreduce, multifrontal", "ours.py", "multifrontal"),
    f"{OURS}-pardiso": _over("cmsreduce, PARDISO", "ours.py", "pardiso"),
    "arpack-pardiso": _over("ARPACK, PARDISO", "scipy_plain.py", "pardiso"),
    "arpack-multifrontal": _over("ARPACK, multifrontal", "scipy_plain.py", "multifrontal"),
    "scipy": Peer("scipy: splu, eigsh", "scipy_plain.py", ("default",)),
    "scipy-mmd": Peer("scipy, MMD order", "scipy_plain.py", ("mmd",)),
    "scipy-metis": Peer("scipy, METIS order", "scipy_plain.py", ("metis",), needs="import pymetis"),
    "slepc-mumps": _slepc("SLEPc, MUMPS", "mumps"),
    "slepc-mumps-mpi": _slepc("SLEPc, MUMPS, 2 processes", "mumps", processes=2),
    "slepc-slices": _slepc("SLEPc, slices, MUMPS", "mumps", "slices"),
    "slepc-cholmod": _slepc("SLEPc, CHOLMOD", "cholmod"),
    "exudyn": _own("Exudyn", "exudyn"),
    # Dense matrices: 1 GiB at 3000 dofs.
    "sdynpy": _own("sdynpy (dense)", "sdynpy", 4000),
    # The peer has threads of its own; threads of OpenBLAS would only wait for them.
    "calculix": Peer(
        "CalculiX",
        "calculix.py",
        needs="import shutil, sys; sys.exit(shutil.which('ccx') is None)",
        environment={"OPENBLAS_NUM_THREADS": "1"},
    ),
}


def make(body: str, folder: Path) -> None:
    """Write the matrices of a body, in a process of its own, whose memory is then free again."""
    subprocess.run([sys.executable, str(ROOT / "benchmarks" / "meshes.py"), body, str(folder)], check=True)


def compete(name: str, body: str, n: int, folder: Path, threads: int, limit_s: float) -> dict[str, object]:
    """Run a peer on a body.

    Parameters
    ----------
    name, body : str
        The peer, the body.
    n : int
        Dofs of the body.
    folder : Path
        Where `make` wrote the body.
    threads : int
        Threads the peer may use.
    limit_s : float
        Seconds after which it is stopped.

    Returns
    -------
    dict
        What the peer reported, its ``status`` ("ok" or why there is nothing), the wall time.
    """
    peer = PEERS[name]
    record: dict[str, object] = {"peer": name, "body": body, "n": n, "threads": threads, "time": time.time()}
    if peer.absent():
        return record | {"status": "not installed"}
    if peer.largest is not None and n > peer.largest:
        return record | {"status": f"not tried beyond {peer.largest} dofs"}
    report = folder / "report.json"
    report.unlink(missing_ok=True)
    each = str(max(1, threads // peer.processes))
    own = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), each)
    with tempfile.TemporaryFile("w+") as log:
        started = time.perf_counter()
        running = subprocess.Popen(
            peer.command(folder),
            env={**os.environ, **own, **peer.environment},
            stdout=log,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        if not name.startswith(OURS):
            # Before the interpreter is up; what it starts inherits it. Ours refuses by itself.
            resource.prlimit(running.pid, resource.RLIMIT_DATA, (int(_MEMORY_SHARE * available_memory()),) * 2)
        try:
            running.wait(limit_s)
        except subprocess.TimeoutExpired:
            after = f"{limit_s:.0f} s" if limit_s < 120 else f"{limit_s / 60:.3g} minutes"
            return record | {"status": f"none in {after}"}
        finally:
            # Its child processes end too.
            if running.poll() is None:
                os.killpg(running.pid, signal.SIGKILL)
                running.wait()
        record["wall_s"] = time.perf_counter() - started
        if running.returncode or not report.exists():
            log.seek(0)
            said = log.read()
            short = any(word in said for word in _SHORT_OF_MEMORY)
            why = said.strip().splitlines()[-1][:100] if said.strip() else f"exit code {running.returncode}"
            return record | {"status": "out of memory" if short or running.returncode == -9 else f"failed: {why}"}
    found = json.loads(report.read_text(encoding="utf-8"))
    seconds = found["seconds"]
    # The certificate is timed apart: no peer has one. Solves within the search for modes are a part of it.
    steps = ("factorise", "solves", "modes")
    found["total_s"] = seconds.get("total", sum(seconds.get(step, 0.0) for step in steps))
    return record | found | {"status": "ok"}


def save(record: dict[str, object]) -> None:
    """Store a record in place of an earlier one of the same peer and body."""
    RECORDS.mkdir(parents=True, exist_ok=True)
    path = RECORDS / f"{record['body']}.{record['peer']}.json"
    path.write_text(json.dumps(record, indent=1), encoding="utf-8")


def records() -> dict[tuple[str, str], dict]:
    """All stored records, by body and peer."""
    read = [json.loads(path.read_text(encoding="utf-8")) for path in sorted(RECORDS.glob("*.*.json"))]
    return {(record["body"], record["peer"]): record for record in read}
