"""Reductors of pyMOR, and Krylov spaces, on one sparse system: one line of JSON for each order.

    python benchmarks/peers/sparse_reductors.py FOLDER METHOD 6,12 SECONDS

``FOLDER`` has K.npz, M.npz (n, n), and system.npz with B (n, inputs), C (outputs, n), ``rayleigh`` (alpha, beta) of
D = alpha M + beta K, and the grid ``omega``. The method ``direct`` writes the response at ``omega`` to H.npy, which
the others are compared with. A method ends without more results after so many CPU seconds.
"""

from __future__ import annotations

import ctypes
import json
import signal
import sys
import time
import warnings
import weakref
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from pymor.core.defaults import set_defaults
from pymor.core.logger import set_log_levels
from pymor.models.iosys import SecondOrderModel
from pymor.reductors.mt import MTReductor
from pymor.reductors.sobt import SOBTfvReductor, SOBTpReductor, SOBTpvReductor, SOBTvReductor
from pymor.reductors.sor_irka import SORIRKAReductor
from pymor.solvers.interface import Solver
from pymor.solvers.matrix_equations.adi import ADILyapunovSolver
from pymor.solvers.matrix_equations.default import MatrixEquationSolvers

Response = np.ndarray
# Most iterations of SOR-IRKA, and of the IRKA within.
ITERATIONS, INNER = 3, 20
# Real shift of the Krylov spaces, in units of the top of the band, and their blocks.
SHIFT, BLOCKS = 0.05, 4
# Steps of ADI, and those for a proof.
STEPS = 20, 60
# Modes that the most dominant are chosen from.
MODES = 60
# Damping ratio of shifts along the band.
RATIO = 0.01


@cache
def mkl() -> ctypes.CDLL:
    """MKL of this environment, or of the system."""
    found = sorted(Path(sys.prefix).glob("lib/libmkl_rt.so*"))
    return ctypes.CDLL(str(found[-1]) if found else "libmkl_rt.so")


class Factor:
    """L D L^T of a symmetric matrix, real or complex, by MKL PARDISO, in a METIS order that all matrices share."""

    order: np.ndarray | None = None

    def __init__(self, A: sp.csr_matrix) -> None:
        upper = sp.triu(A, format="csr")
        upper.sort_indices()
        self.dtype = upper.dtype
        parts = upper.data, upper.indptr.astype(np.int32), upper.indices.astype(np.int32)
        known, n = Factor.order, A.shape[0]
        order = np.zeros(n, np.int32) if known is None else known
        iparm = np.zeros(64, np.int32)
        # Values below instead of defaults; nested dissection; write the order or read it; no moved pivots; pivots of
        # one or two rows; rows count from 0.
        iparm[[0, 1, 4, 9, 20, 34]] = 1, 2, 2 if known is None else 1, 20, 1, 1
        handle, kind = np.zeros(64, np.int64), 6 if np.iscomplexobj(A) else -2
        # It must not refer to the factor: the memory is freed with it.
        self.call: Callable[..., None] = lambda phase, b=None, x=None: _pardiso(
            handle, phase, kind, n, (*parts, order), iparm, b, x
        )
        weakref.finalize(self, self.call, -1)
        self.call(11)
        Factor.order = order
        self.call(22)

    def solve(self, b: np.ndarray) -> np.ndarray:
        """Solution (n, k); real factors solve for complex loads in two parts."""
        if np.iscomplexobj(b) and self.dtype.kind != "c":
            return self.solve(b.real) + 1j * self.solve(b.imag)
        b = np.asfortranarray(b, dtype=self.dtype)
        x = np.empty_like(b)
        self.call(33, b, x)
        return x


def _pardiso(handle, phase, kind, n, matrix, iparm, b, x) -> None:
    """Call PARDISO for one matrix: entries, starts, columns and order."""
    numbers = (1, 1, kind, phase, n), (1 if b is None else b.shape[1],), (0,)
    before, width, quiet = ([ctypes.byref(ctypes.c_int32(v)) for v in group] for group in numbers)
    error = ctypes.c_int32(0)
    at = [None if a is None else ctypes.c_void_p(a.ctypes.data) for a in (*matrix, iparm, b, x)]
    mkl().pardiso(
        *(ctypes.c_void_p(handle.ctypes.data), *before, *at[:4], *width, at[4], *quiet, *at[5:], ctypes.byref(error))
    )
    if error.value:
        raise RuntimeError(f"PARDISO: error {error.value} in phase {phase}")


class PardisoSolver(Solver):
    """Solver of pyMOR for sparse symmetric matrices; it keeps the last factor, which serves the adjoint, too."""

    last: tuple[sp.csr_matrix, Factor] | None = None

    def _solve(self, operator, V, mu, initial_guess):
        A, kept = operator.assemble(mu).matrix, PardisoSolver.last
        if kept is None or not np.array_equal(kept[0].data, A.data):
            # The old factor goes first.
            PardisoSolver.last = kept = None
            PardisoSolver.last = kept = A, Factor(A)
        return operator.source.from_numpy(kept[1].solve(V.to_numpy())), {}

    def _solve_adjoint(self, operator, U, mu, initial_guess):
        found, info = self._solve(operator, U.conj(), mu, None)
        return found.conj(), info


class BandADI(ADILyapunovSolver):
    """Low-rank ADI whose first shifts lie along the band, instead of a projection on the loads."""

    def projection_shifts_init(self, A, E, B):
        """Ten complex shifts."""
        return np.geomspace(0.1, 1.0, 10) * (-RATIO + 1j)


class System:
    """M q'' + D q' + K q = B u, y = C q, in units in which the band ends at 1 and the mean mass is 1."""

    def __init__(self, folder: Path) -> None:
        data = np.load(folder / "system.npz")
        K, M = (sp.csr_matrix(sp.load_npz(folder / f"{name}.npz")) for name in "KM")
        top, (alpha, beta), mass = data["omega"][-1], data["rayleigh"], M.diagonal().mean()
        # One pattern for all sums: factors share their order.
        pattern = abs(K) + abs(M)
        pattern.data[:] = 0
        self.K, self.M = (K + pattern) / (mass * top**2), (M + pattern) / mass
        self.rayleigh = np.array([alpha / top, beta * top])
        self.D = self.rayleigh[0] * self.M + self.rayleigh[1] * self.K
        self.B, self.C, self.omega = data["B"] / (mass * top**2), data["C"], data["omega"] / top

    def at(self, s: complex) -> sp.csr_matrix:
        """s^2 M + s D + K."""
        return s**2 * self.M + s * self.D + self.K

    def direct(self) -> Response:
        """Response by one factor at each frequency (f, outputs, inputs)."""
        return np.array([self.C @ Factor(self.at(1j * w)).solve(self.B) for w in self.omega])

    def within(self, V: np.ndarray) -> Response:
        """Response in some shapes (n, r)."""
        K, D, M = (V.T @ (A @ V) for A in (self.K, self.D, self.M))
        B, C = V.T @ self.B, self.C @ V
        return np.array([C @ np.linalg.solve(K + 1j * w * D - w**2 * M, B) for w in self.omega])

    def krylov(self) -> Iterator[np.ndarray]:
        """Blocks of the second-order Krylov space of the inputs and outputs at a real shift.

        With D = alpha M + beta K it is the first-order space of (s^2 M + s D + K)^-1 M.
        """
        factor = Factor(self.at(SHIFT))
        X = np.hstack([self.B, self.C.T * (la.norm(self.B) / la.norm(self.C))])
        for _ in range(BLOCKS):
            yield (found := factor.solve(X))
            X = self.M @ found

    def by_energy(self, blocks: Iterator[np.ndarray]) -> np.ndarray:
        """Shapes that have most strain energy in some blocks, largest first (n, k)."""
        X = np.hstack(list(blocks))
        energy, Q = la.eigh(X.T @ (self.K @ X))
        kept = energy > 1e-13 * energy[-1]
        return (X @ (Q[:, kept] / np.sqrt(energy[kept])))[:, ::-1]

    def by_dominance(self) -> np.ndarray:
        """Modes by the residue of their poles over the real part, largest first (n, k).

        With D = alpha M + beta K each pair of poles belongs to one undamped mode.
        """
        factor = Factor(self.K)
        lowest = spla.LinearOperator(self.K.shape, matvec=lambda b: factor.solve(b.reshape(-1, 1)), dtype=float)
        square, modes = spla.eigsh(self.K, MODES, self.M, sigma=0, OPinv=lowest)
        poles = np.array([np.roots([1, self.rayleigh @ np.array([1, each]), each])[0] for each in square])
        residues = la.norm(self.C @ modes, axis=0) * la.norm(self.B.T @ modes, axis=0) / abs(2 * poles.imag)
        return modes[:, np.argsort(-residues / abs(poles.real))]


def responses(model: object, omega: np.ndarray) -> Response:
    """Transfer function of a model of pyMOR (f, outputs, inputs)."""
    return np.array([model.transfer_function.eval_tf(1j * w) for w in omega])


def prepared(method: str, system: System) -> Callable[[int], list[Response]]:
    """Do what all orders share; return the responses at an order, of which the best counts."""
    if method == "krylov":
        V = system.by_energy(system.krylov())
        return lambda r: [system.within(V[:, :r])]
    if method == "modes":
        V = system.by_dominance()
        return lambda r: [system.within(V[:, :r])]
    set_defaults({"pymor.operators.numpy.NumpyMatrixOperator.default_sparse_solver": PardisoSolver})
    method, _, kind = method.partition(" ")
    matrices = (A.toarray() if kind == "dense" else A for A in (system.M, system.D, system.K))
    # Dense matrices have dense Gramians.
    adi = {"dense": None, "band": BandADI(adi_maxiter=STEPS[0]), "band, long": BandADI(adi_maxiter=STEPS[1])}
    solvers = MatrixEquationSolvers(lyapunov_lr=adi.get(kind, ADILyapunovSolver(adi_maxiter=STEPS[0])))
    full = SecondOrderModel.from_matrices(*matrices, system.B, system.C, matrix_equation_solvers=solvers)
    if method == "irka":

        def irka(r: int) -> list[Response]:
            w = np.linspace(0.15, 1.0, r // 2) * (RATIO + 1j)
            start = np.concatenate([w, w.conj(), [0.5] * (r % 2)])
            options = {"force_sigma_in_rhp": True, "irka_options": {"maxit": INNER}}
            reductor = SORIRKAReductor(full)
            found = reductor.reduce(start, tol=1e-3, maxit=ITERATIONS, **options)
            return [responses(found, system.omega), system.within(reductor.V.to_numpy())]

        return irka
    if method == "modal":
        options = {"decomposition": "eig", "which": "SM"}
        if kind != "dense":
            options = {"method_options": {"init_shifts": 1j * np.linspace(0.1, 1.0, 10)}}
        return lambda r: [responses(MTReductor(full.to_lti()).reduce(2 * r, **options), system.omega)]
    # All orders share the Gramians.
    for each in (full, full.to_lti()):
        each.enable_caching("memory")
    full.gramian("pc_lr"), full.gramian("po_lr")
    kinds = SOBTpReductor, SOBTvReductor, SOBTpvReductor, SOBTfvReductor
    return lambda r: [responses(each(full).reduce(r), system.omega) for each in kinds]


def main(folder: Path, method: str, orders: list[int], limit: float) -> None:
    """Reduce by one method to every order."""
    set_log_levels({"pymor": "ERROR"})
    warnings.simplefilter("ignore")
    system = System(folder)
    started = time.process_time()
    if method == "direct":
        np.save(folder / "H.npy", system.direct())
        print(json.dumps({"seconds": time.process_time() - started}))
        return

    def late(*_: object) -> None:
        raise TimeoutError

    signal.signal(signal.SIGPROF, late)
    exact = np.load(folder / "H.npy")
    size = np.trapezoid(np.sum(abs(exact) ** 2, axis=(1, 2)), system.omega)
    reduced, shared = None, 0.0
    signal.setitimer(signal.ITIMER_PROF, limit)
    for r in orders:
        started = time.process_time()
        try:
            if reduced is None:
                reduced = prepared(method, system)
                shared, started = time.process_time() - started, time.process_time()
            misses = [np.trapezoid(np.sum(abs(H - exact) ** 2, axis=(1, 2)), system.omega) for H in reduced(r)]
        except TimeoutError:
            return
        except Exception as failure:
            print(f"{method}, order {r}: {type(failure).__name__}: {failure}"[:200], file=sys.stderr)
            continue
        seconds = shared + time.process_time() - started
        print(json.dumps({"order": r, "error": float(np.sqrt(min(misses) / size)), "seconds": seconds}), flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2], [int(each) for each in sys.argv[3].split(",")], float(sys.argv[4]))
