"""Exudyn's arrays against the formulas it computes them by from a mass matrix of nodes."""

from pathlib import Path

import numpy as np
import pytest

from cmsreduce.mechanics import modal_integrals
from cmsreduce.model import cross_matrix, rigid_body_shapes
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.reduce import CraigBampton
from cmsreduce.write import read_component, write_component
from cmsreduce.write.targets.exudyn import write_exudyn
from tests.frames import line
from tests.write.particles import Particles, particles


def loaded(path: Path, body: Particles) -> dict[str, np.ndarray]:
    write_exudyn(path, body.file, body.integrals)
    with np.load(path, allow_pickle=True) as file:
        return {name: file[name] for name in file}


def skew(columns: np.ndarray) -> np.ndarray:
    """Blocks S(x) of every node (3 n, 3), side by side for each column."""
    nodes = columns.reshape(-1, 3, columns.shape[1])
    return np.block([[cross_matrix(node[:, c]) for c in range(columns.shape[1])] for node in nodes])


def test_particles_give_what_exudyn_computes_of_a_mass_matrix(tmp_path: Path) -> None:
    body = particles(0.0)
    a = loaded(tmp_path / "body.npz", body)
    M = np.kron(np.diag(body.node_m), np.eye(3))
    Psi, x = body.node_u.reshape(21, 4), body.node_x.reshape(21, 1)
    Phit, xs, Ps = np.tile(np.eye(3), (7, 1)), skew(x), skew(Psi)
    for name, expected in {
        "modeBasis": Psi,
        "xRef": x[:, 0],
        "massMatrixReduced": Psi.T @ M @ Psi,
        "stiffnessMatrixReduced": np.diag(body.omega**2),
        "inertiaLocal": xs.T @ M @ xs,
        "Mtt": Phit.T @ M @ Phit,
        "totalMass": body.m.sum(),
        "chiU": body.m @ body.x / body.m.sum(),
        "chiUtilde": cross_matrix(body.m @ body.x / body.m.sum()),
        "mPsiTildePsi": Ps.T @ M @ Psi,
        "mPsiTildePsiTilde": Ps.T @ M @ Ps,
        "mPhitTPsi": Phit.T @ M @ Psi,
        "mPhitTPsiTilde": Phit.T @ M @ Ps,
        "mXRefTildePsi": xs.T @ M @ Psi,
        "mXRefTildePsiTilde": xs.T @ M @ Ps,
    }.items():
        np.testing.assert_allclose(a[name], expected, rtol=0, atol=1e-13 * abs(expected).max(), err_msg=name)
    assert a["infoList"].tolist() == [4, 7, 3, 4, 7, 11]


def test_energy_of_lumps_that_turn(tmp_path: Path) -> None:
    """Kinetic energy of a deformed body for any motion of the frame and the modes, particle by particle."""
    body = particles()
    a = loaded(tmp_path / "body.npz", body)
    w, v = np.array([0.3, -1.1, 0.7]), np.array([0.2, 0.4, -0.5])
    q, rate = np.array([0.1, 0.2, -0.3, 0.05]), np.array([1.0, -2.0, 0.5, 0.25])
    velocity = v + np.cross(w, body.x + body.u @ q) + body.u @ rate
    wide = np.kron(q[:, None], np.eye(3))
    # The frame's own inertia, and what the modes make of it.
    J = a["inertiaLocal"] + wide.T @ a["mPsiTildePsiTilde"] @ wide
    J = J + a["mXRefTildePsiTilde"] @ wide + (a["mXRefTildePsiTilde"] @ wide).T
    turning = -(a["mXRefTildePsi"] + wide.T @ a["mPsiTildePsi"])
    moment = a["totalMass"] * a["chiU"] + a["mPhitTPsi"] @ q
    ours = 0.5 * v @ a["Mtt"] @ v + 0.5 * w @ J @ w + 0.5 * rate @ a["massMatrixReduced"] @ rate
    ours += v @ np.cross(w, moment) + v @ a["mPhitTPsi"] @ rate + w @ turning @ rate
    assert ours == pytest.approx(0.5 * body.m @ (velocity**2).sum(axis=1), rel=1e-13)


def test_exudyn_loads_the_file_and_has_its_frequencies(tmp_path: Path) -> None:
    exu = pytest.importorskip("exudyn")
    fem = pytest.importorskip("exudyn.FEM")
    body = particles()
    write_exudyn(tmp_path / "body.npz", body.file, body.integrals)
    cms = fem.ObjectFFRFreducedOrderInterface()
    cms.LoadFromFile(str(tmp_path / "body.npz"))
    system = exu.SystemContainer()
    mbs = system.AddSystem()
    made = cms.AddObjectFFRFreducedOrder(mbs)
    ground = mbs.AddMarker(fem.eii.MarkerBodyRigid(bodyNumber=mbs.AddObject(fem.eii.ObjectGround())))
    node = mbs.AddMarker(fem.eii.MarkerNodeRigid(nodeNumber=made["nRigidBody"]))
    mbs.AddObject(fem.eii.GenericJoint(markerNumbers=[ground, node], constrainedAxes=[1] * 6))
    mbs.Assemble()
    values, _ = mbs.ComputeODE2Eigenvalues(useAbsoluteValues=True, ignoreAlgebraicEquations=False)[:2]
    np.testing.assert_allclose(np.sqrt(np.sort(values)[-4:]), body.omega, rtol=1e-8)


def test_consistent_mass_of_a_beam_is_no_mass_of_nodes(tmp_path: Path) -> None:
    """Its rotations carry mass and its directions differ; Exudyn's own sums over translations would lose momentum."""
    body = line("bar", [0.1, 0, 0], [0.5, 0.4, 0.3], 3, masses={2: 0.4})
    modal = orthogonalise(CraigBampton(1e4).reduce(body, body.interface_rows("a")))
    columns = np.arange(modal.rigid_count, modal.omega.size)
    write_component(
        tmp_path / "bar.h5", modal, nodes=[], inputs={}, outputs={}, checks=[], provenance={}, all_nodes=True
    )
    integrals = modal_integrals(body, modal.Phi[:, columns], modes=columns)
    write_exudyn(tmp_path / "bar.npz", read_component(tmp_path / "bar.h5"), integrals)
    with np.load(tmp_path / "bar.npz", allow_pickle=True) as file:
        a = {name: file[name] for name in file}
    assert body.nodes is not None
    v, w, rate = np.array([0.2, 0.4, -0.5]), np.array([0.3, -1.1, 0.7]), np.linspace(1, -1, columns.size)
    motion = rigid_body_shapes(body.dofs, body.nodes) @ np.concatenate([v, w]) + modal.Phi[:, columns] @ rate
    ours = 0.5 * v @ a["Mtt"] @ v + 0.5 * w @ a["inertiaLocal"] @ w + 0.5 * rate @ a["massMatrixReduced"] @ rate
    ours += v @ np.cross(w, a["totalMass"] * a["chiU"]) + v @ a["mPhitTPsi"] @ rate - w @ a["mXRefTildePsi"] @ rate
    assert ours == pytest.approx(0.5 * motion @ body.M @ motion, rel=1e-12)
    M = body.M.toarray()[np.ix_(body.dofs.component <= 3, body.dofs.component <= 3)]
    of_translations = skew(a["xRef"][:, None]).T @ M @ a["modeBasis"]
    assert abs(of_translations - a["mXRefTildePsi"]).max() > 0.01 * np.sqrt(np.trace(a["inertiaLocal"]))
