"""Input and output of every peer; needs numpy and scipy only, because a peer may run in another Python."""

from __future__ import annotations

import json
import resource
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import scipy.sparse as sp

__all__ = ["Geometry", "Problem", "Report"]

# Columns whose residual is taken at once.
_COLUMNS = 10


@dataclass(frozen=True, eq=False)
class Problem:
    """Craig-Bampton's two sparse problems: K Psi = -coupling and K x = lam M x.

    Parameters
    ----------
    name : str
        Name of the body.
    K, M : (n, n) sparse, columns sorted by row
        Stiffness and mass of the interior, face and interface held; three dofs a node, one node after the other.
    coupling : (n, i) sparse
        Stiffness between interior and interface.
    count : int
        Modes asked for.
    cutoff_hz : float
        The same as a frequency.
    """

    name: str
    K: sp.csc_matrix
    M: sp.csc_matrix
    coupling: sp.csc_matrix
    count: int
    cutoff_hz: float

    def save(self, folder: Path) -> None:
        """Write the matrices, uncompressed, and the numbers."""
        for name in ("K", "M", "coupling"):
            sp.save_npz(folder / f"{name}.npz", sp.csc_matrix(getattr(self, name)), compressed=False)
        numbers = {"name": self.name, "count": self.count, "cutoff_hz": self.cutoff_hz}
        (folder / "problem.json").write_text(json.dumps(numbers), encoding="utf-8")

    @classmethod
    def load(cls, folder: Path) -> Problem:
        """Read them again."""
        K, M, coupling = (sp.load_npz(folder / f"{name}.npz") for name in ("K", "M", "coupling"))
        # Said to be sorted, or scipy looks through all entries to find out.
        for A in (K, M, coupling):
            A.has_sorted_indices = True
        return cls(K=K, M=M, coupling=coupling, **json.loads((folder / "problem.json").read_text(encoding="utf-8")))


@dataclass(frozen=True, eq=False)
class Geometry:
    """The mesh, for a program that assembles its own matrices.

    Parameters
    ----------
    xyz : (n, 3) float64
        Places of the nodes.
    cells : (c, 8) or (c, 4) int32
        Nodes of each cell, hexahedra as Abaqus counts them.
    held, interface : (k,) int
        Nodes of the held face, of the interface.
    """

    xyz: np.ndarray
    cells: np.ndarray
    held: np.ndarray
    interface: np.ndarray

    def save(self, folder: Path) -> None:
        """Write the arrays."""
        np.savez(folder / "geometry.npz", xyz=self.xyz, cells=self.cells, held=self.held, interface=self.interface)

    @classmethod
    def load(cls, folder: Path) -> Geometry:
        """Read them again."""
        with np.load(folder / "geometry.npz") as arrays:
            return cls(**arrays)


@dataclass
class Report:
    """Seconds of each step, peak memory, frequencies and residuals; written as JSON when all is done."""

    seconds: dict[str, float] = field(default_factory=dict)
    facts: dict[str, object] = field(default_factory=dict)

    @contextmanager
    def timed(self, step: str) -> Iterator[None]:
        """Add the seconds of the block to a step."""
        started = time.perf_counter()
        yield
        self.seconds[step] = self.seconds.get(step, 0.0) + time.perf_counter() - started

    def peak(self, gib: float | None = None) -> None:
        """Note the peak memory so far, matrices and interpreter included; to be called before residuals are taken."""
        self.facts["peak_gib"] = peak_gib() if gib is None else gib

    def check(self, problem: Problem, hz: np.ndarray, X: np.ndarray | None, Psi: np.ndarray | None) -> None:
        """Note the frequencies, and |K x - lam M x| / |lam M x| and |K Psi + coupling| / |coupling|, worst columns."""
        hz = np.asarray(hz, dtype=float)
        order = np.argsort(hz)
        self.facts["hz"] = hz[order].tolist()
        if X is not None:
            lam, worst = (2 * np.pi * hz) ** 2, 0.0
            for k in range(0, hz.size, _COLUMNS):
                x = np.asarray(X[:, k : k + _COLUMNS])
                inertia = (problem.M @ x) * lam[k : k + _COLUMNS]
                left = np.linalg.norm(problem.K @ x - inertia, axis=0) / np.linalg.norm(inertia, axis=0)
                worst = max(worst, float(left.max()))
            self.facts["residual"] = worst
        if Psi is not None:
            worst = 0.0
            for k in range(0, Psi.shape[1], _COLUMNS):
                b = problem.coupling[:, k : k + _COLUMNS].toarray()
                left = np.linalg.norm(problem.K @ Psi[:, k : k + _COLUMNS] + b, axis=0) / np.linalg.norm(b, axis=0)
                worst = max(worst, float(left.max()))
            self.facts["static_residual"] = worst

    def write(self, path: Path) -> None:
        """JSON for whoever started the peer."""
        path.write_text(json.dumps({"seconds": self.seconds, **self.facts}), encoding="utf-8")


def peak_gib() -> float:
    """Peak memory of this process (not, as ru_maxrss, of the one that started it)."""
    try:
        status = Path("/proc/self/status").read_text(encoding="utf-8")
    except OSError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    return next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmHWM")) / 2**20
