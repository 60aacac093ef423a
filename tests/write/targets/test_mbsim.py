"""MBSim's HDF5 input: its own datasets, and the sums over particles that they stand for."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from cmsreduce.errors import WriteError
from cmsreduce.write.targets.mbsim import write_mbsim
from tests.write.particles import FORMATS, particles

PAIRS = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]


def read(path: Path) -> dict[str, np.ndarray]:
    """Data that MBSim reads, with its indices: r_phi [i, j, mode], phi_phi by pairs of components."""
    with h5py.File(path) as file:
        f = {name: item[()] for name, item in file.items()}
    k = f["stiffness matrix"].shape[0]
    return {
        "m": f["mass"],
        "r": f["position integral"],
        "rr": f["position position integral"],
        "phi": f["shape function integral"],
        "r_phi": f["position shape function integral"].reshape(3, 3, k),
        "phi_phi": f["shape function shape function integral"].reshape(6, k, k),
        "K": f["stiffness matrix"],
        "D": f.get("damping matrix"),
        "id": f.get("node numbers"),
        "x": f["nodal relative position"].reshape(-1, 3),
        "u": f["nodal shape matrix of translation"].reshape(-1, 3, k),
        "v": f["nodal shape matrix of rotation"].reshape(-1, 3, k),
    }


@pytest.mark.skipif(not FORMATS.is_dir(), reason="no format samples here")
def test_the_reader_understands_files_of_mbsim() -> None:
    """A body of lumped nodes: its integrals are sums over its nodes, so that the order of the rows shows."""
    f = read(FORMATS.parent / "calculix_body" / "input_data.h5")
    # Solids of one density: masses of the nodes are the ones that give all ten moments of mass back.
    x, k = f["x"], f["K"].shape[0]
    A = np.vstack([np.ones(len(x)), x.T, *(x[:, i] * x[:, j] for i, j in PAIRS)])
    b = np.concatenate([[f["m"]], f["r"], [f["rr"][i, j] for i, j in PAIRS]])
    rows = [f["u"][:, j].T for j in range(3)] + [x[:, i] * f["u"][:, j].T for i in range(3) for j in range(3)]
    sums = [f["phi"][j] for j in range(3)] + [f["r_phi"][i, j] for i in range(3) for j in range(3)]
    A, b = np.vstack([A, *rows]), np.concatenate([b, *sums])
    rows = [f["u"][:, i, a] * f["u"][:, j, c] for i, j in PAIRS for a in range(k) for c in range(k)]
    A, b = np.vstack([A, *rows]), np.concatenate([b, f["phi_phi"].ravel()])
    scale = abs(A).max(axis=1) * f["m"]
    masses = np.linalg.lstsq(A / (scale / f["m"])[:, None], b / (scale / f["m"]), rcond=None)[0]
    assert abs((A @ masses - b) / scale).max() < 1e-12
    assert masses.min() > 0


def test_sums_over_particles(tmp_path: Path) -> None:
    body = particles()
    write_mbsim(tmp_path / "body.h5", body.file, body.integrals)
    f = read(tmp_path / "body.h5")
    m, x, u = body.m, body.x, body.u
    np.testing.assert_allclose(f["m"], m.sum(), rtol=1e-14)
    np.testing.assert_allclose(f["r"], m @ x, rtol=1e-13)
    np.testing.assert_allclose(f["rr"], np.einsum("n,ni,nj->ij", m, x, x), rtol=0, atol=1e-13)
    np.testing.assert_allclose(f["phi"], np.einsum("n,nia->ia", m, u), rtol=0, atol=1e-14)
    np.testing.assert_allclose(f["r_phi"], np.einsum("n,ni,nja->ija", m, x, u), rtol=0, atol=1e-14)
    for pair, (i, j) in enumerate(PAIRS):
        np.testing.assert_allclose(f["phi_phi"][pair], np.einsum("n,na,nb->ab", m, u[:, i], u[:, j]), atol=1e-14)
    np.testing.assert_array_equal(f["id"], [2, 3, 5, 8, 13, 21, 34])
    np.testing.assert_allclose(f["x"], body.node_x, rtol=1e-14)
    np.testing.assert_allclose(f["u"], body.node_u, rtol=0, atol=1e-15)
    np.testing.assert_allclose(f["v"], body.node_v, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(np.diag(f["K"]), body.omega**2)
    np.testing.assert_allclose(np.diag(f["D"]), 0.02 * body.omega)


def test_equal_bodies_give_equal_bytes(tmp_path: Path) -> None:
    body = particles()
    for name in ("one.h5", "two.h5"):
        write_mbsim(tmp_path / name, body.file, body.integrals)
    assert (tmp_path / "one.h5").read_bytes() == (tmp_path / "two.h5").read_bytes()


def test_modes_without_mass_are_refused(tmp_path: Path) -> None:
    body = particles(static=True)
    with pytest.raises(WriteError, match="1 static modes have no mass, and MBSim solves with the modal mass"):
        write_mbsim(tmp_path / "body.h5", body.file, body.integrals)
    assert not list(tmp_path.iterdir())
