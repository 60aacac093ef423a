"""Speed against error: the Galileo sample at growing size, and solid blocks against a plain scipy reduction.

Prints two Markdown tables; every time stands beside an error, every comparison is a ratio within one run.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from skfem import Basis, BilinearForm, ElementHex1, ElementVector, MeshHex
from skfem.helpers import dot
from skfem.models.elasticity import lame_parameters, linear_elasticity

from cmsreduce.config import load_pipeline
from cmsreduce.model import DofTable, FEModel, Nodes
from cmsreduce.pipeline import Run, Silent, run_result
from cmsreduce.reduce import CraigBampton

ROOT = Path(__file__).parents[1]
COUNTS = ((4, 4), (8, 8), (12, 10), (19, 15), (30, 16), (74, 16))
BLOCKS = ((24, 6, 6), (32, 8, 8), (40, 10, 10))
MODES = 30


def galileo() -> None:
    """Worst error over eight configurations against modes kept and time of the responses."""
    print("| rotor + stator modes | frf_error | db_error | full response, s | reduced, s | ratio |")
    print("|---|---|---|---|---|---|")
    for rotor, stator in COUNTS:
        keep = f"balance.keep={{modes: {{rotor: {rotor}, stator: {stator}}}}}"
        pipeline = load_pipeline(ROOT / "pipelines" / "galileo.yaml", [keep, "verify.compare={}"])
        with tempfile.TemporaryDirectory() as folder:
            result = run_result(Run(pipeline, Path(folder), Silent()))
        worst, speed = result.worst(), result.speed
        assert speed is not None
        print(
            f"| {rotor} + {stator} | {100 * worst['frf_error']:.3g} % | {worst['db_error']:.3g} dB "
            f"| {speed.full_frf_s:.2f} | {speed.reduced_frf_s:.2f} | {speed.full_frf_s / speed.reduced_frf_s:.1f} |"
        )


def block(cells: tuple[int, int, int]) -> FEModel:
    """Steel bar of hexahedra, 1 x 0.25 x 0.25 m, free."""
    sides = [np.linspace(0, side, n + 1) for side, n in zip((1, 0.25, 0.25), cells, strict=True)]
    # All cells are alike: the matrices of the first one are scattered over the mesh.
    K1, M1, dofs1 = _matrices(MeshHex.init_tensor(*(side[:2] for side in sides)))
    mesh = MeshHex.init_tensor(*sides)
    rows = (3 * mesh.t[:, None, :] + np.arange(3)[None, :, None]).reshape(24, -1)
    at = np.repeat(rows, 24, axis=0).ravel(), np.tile(rows, (24, 1)).ravel()
    own = dofs1.T.ravel()
    n = 3 * mesh.p.shape[1]
    K, M = (
        sp.csc_array(sp.coo_array((np.repeat(A[np.ix_(own, own)].ravel(), mesh.t.shape[1]), at), shape=(n, n)))
        for A in (K1, M1)
    )
    ids = np.arange(1, mesh.p.shape[1] + 1)
    nodes = Nodes.in_basic(ids, mesh.p.T)
    return FEModel("block", K, M, DofTable(np.repeat(ids, 3), np.tile([1, 2, 3], ids.size)), nodes)


def _matrices(mesh: MeshHex) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stiffness and mass of a mesh, and the dof of each component at each of its nodes in the order of ``mesh.t``."""
    basis = Basis(mesh, ElementVector(ElementHex1()))
    K = linear_elasticity(*lame_parameters(2.1e11, 0.3)).assemble(basis)
    M = BilinearForm(lambda u, v, w: 7850 * dot(u, v)).assemble(basis)
    return K.toarray(), M.toarray(), basis.nodal_dofs[:, mesh.t[:, 0]]


def plain(body: FEModel, interface: np.ndarray, count: int) -> np.ndarray:
    """Fixed-interface frequencies as a scipy user writes it: splu, eigsh with a count guessed right."""
    j = np.setdiff1d(np.arange(body.n), interface)
    Kjj, Mjj = sp.csc_matrix(body.K[j][:, j]), sp.csc_matrix(body.M[j][:, j])
    spla.splu(Kjj).solve(body.K[j][:, interface].toarray())
    return np.sqrt(np.sort(spla.eigsh(Kjj, k=count, M=Mjj, sigma=0.0, return_eigenvectors=False)))


def blocks() -> None:
    """Craig-Bampton against the plain way, same modes."""
    print("| dofs | interface | modes | cmsreduce, s | plain scipy, s | ratio | frequencies differ by |")
    print("|---|---|---|---|---|---|---|")
    for cells in BLOCKS:
        body = block(cells)
        assert body.nodes is not None
        corner = body.nodes.id[
            (body.nodes.xyz[:, 0] == 0) & (body.nodes.xyz[:, 1] <= 0.1) & (body.nodes.xyz[:, 2] <= 0.1)
        ]
        interface = np.concatenate([body.dofs.rows(int(node), [1, 2, 3]) for node in corner])
        started = time.perf_counter()
        w = plain(body, interface, MODES)
        plainly = time.perf_counter() - started
        started = time.perf_counter()
        component = CraigBampton(w[-1] / (2 * np.pi) * (1 + 1e-9)).reduce(body, interface)
        ours = time.perf_counter() - started
        source = component.modes.source_hz
        hz = source[np.isfinite(source)][:MODES]
        worst = abs(2 * np.pi * hz / w - 1).max()
        print(
            f"| {body.n} | {interface.size} | {hz.size} | {ours:.2f} | {plainly:.2f} "
            f"| {plainly / ours:.1f} | {worst:.0e} |"
        )


if __name__ == "__main__":
    galileo()
    print()
    blocks()
