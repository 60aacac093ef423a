"""Reductors of pyMOR and python-control on one modal system: one line of JSON for each method and order.

    python benchmarks/peers/reductors.py system.npz 6,10,16

``system.npz`` has W (n,) and D (n,) of q'' + D q' + W^2 q = B u, y = C q or, with ``rate``, y = C q',
the grid ``omega`` and the response ``H``.
"""

from __future__ import annotations

import json
import sys
import time
import warnings
from collections.abc import Callable, Iterator

import numpy as np
from pymor.core.logger import set_log_levels
from pymor.models.iosys import SecondOrderModel
from pymor.reductors.mt import MTReductor
from pymor.reductors.sobt import SOBTpvReductor
from pymor.reductors.sor_irka import SORIRKAReductor

Response = np.ndarray
# Most iterations of SOR-IRKA.
ITERATIONS = 8


def responses(model: object, omega: np.ndarray) -> Response:
    """Transfer function of a model of pyMOR (f, outputs, inputs)."""
    return np.array([model.transfer_function.eval_tf(1j * w) for w in omega])


def methods(data: dict[str, np.ndarray], path: str) -> Iterator[tuple[str, Callable[[int], Response]]]:
    """Name of each method, and its response at an order, which is half the number of states."""
    W, D, B, C, omega = (data[name] for name in ("W", "D", "B", "C", "omega"))
    rate = bool(data["rate"])
    Cp, Cv = (0 * C, C) if rate else (C, 0 * C)
    full = SecondOrderModel.from_matrices(np.eye(W.size), np.diag(D), np.diag(W**2), B, Cp, Cv)
    yield "pyMOR SOBT (pv)", lambda r: responses(SOBTpvReductor(full).reduce(r), omega)

    def irka(r: int) -> Response:
        reductor = SORIRKAReductor(full)
        found = reductor.reduce(r, tol=1e-3, maxit=ITERATIONS, projection="orth")
        # A start for our optimisation.
        np.save(f"{path}.irka{r}.npy", reductor.V.to_numpy().reshape(W.size, -1))
        return responses(found, omega)

    yield "pyMOR SOR-IRKA", irka

    def modal(r: int) -> Response:
        return responses(MTReductor(full.to_lti()).reduce(2 * r, decomposition="eig", which="SM"), omega)

    yield "pyMOR modal truncation", modal

    def balanced(r: int) -> Response:
        import control

        Z, eye = np.zeros((W.size, W.size)), np.eye(W.size)
        A = np.block([[Z, eye], [-np.diag(W**2), -np.diag(D)]])
        lti = control.ss(A, np.vstack([0 * B, B]), np.hstack([Cp, Cv]), 0)
        return control.balred(lti, 2 * r)(1j * omega, squeeze=False).transpose(2, 0, 1)

    yield "python-control balred", balanced


def main(path: str, orders: list[int]) -> None:
    """Reduce by every method to every order."""
    set_log_levels({"pymor": "ERROR"})
    warnings.simplefilter("ignore")
    data = dict(np.load(path))
    for name, reduced in methods(data, path):
        for r in orders:
            started = time.process_time()
            try:
                H = reduced(r)
            except Exception as error:
                print(json.dumps({"method": name, "order": r, "failed": f"{type(error).__name__}: {error}"[:120]}))
                continue
            miss, size = (
                np.trapezoid(np.sum(abs(part) ** 2, axis=(1, 2)), data["omega"]) for part in (H - data["H"], data["H"])
            )
            seconds = time.process_time() - started
            line = {"method": name, "order": r, "error": float(np.sqrt(miss / size)), "seconds": seconds}
            print(json.dumps(line), flush=True)


if __name__ == "__main__":
    main(sys.argv[1], [int(each) for each in sys.argv[2].split(",")])
