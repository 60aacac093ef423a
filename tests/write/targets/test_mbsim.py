"""MBSim's HDF5 input: its own datasets, and the sums over particles that they stand for."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from cmsreduce.errors import WriteError
from cmsreduce.model import cross_matrix
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


def equations(
    f: dict[str, np.ndarray], q: np.ndarray, rate: np.ndarray, w: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Mass matrix and load over the frame's acceleration and the modes, as MBSim forms them from the datasets.

    Source: assemble and updateMb of generic_flexible_ffr_body.cc (MBSim, July 2026). Gravity is zero.
    """
    k, one = q.size, np.eye(3)
    R, trace = f["r_phi"], np.einsum("iil->l", f["r_phi"])
    PP = np.empty((3, 3, k, k))
    for pair, (i, j) in enumerate(PAIRS):
        PP[i, j], PP[j, i] = f["phi_phi"][pair], f["phi_phi"][pair].T
    masses = np.einsum("iiab->ab", PP)
    # [row, column, mode, mode]: entry (a, b) off the diagonal is - PP[b][a].
    grown = np.einsum("ab,lm->ablm", one, masses) - PP.swapaxes(0, 1)
    inertia = np.trace(f["rr"]) * one - f["rr"]
    inertia = inertia + 2 * (trace @ q) * one - (R + R.swapaxes(0, 1)) @ q + np.einsum("abij,i,j->ab", grown, q, q)
    Gr0 = 2 * (np.einsum("l,ab->abl", trace, one) - R.swapaxes(0, 1))
    Cr0 = np.array([R[1, 2] - R[2, 1], R[2, 0] - R[0, 2], R[0, 1] - R[1, 0]]).T
    Kr = np.array([PP[1, 2].T - PP[1, 2], PP[2, 0].T - PP[2, 0], PP[0, 1].T - PP[0, 1]])
    Oe0 = np.array([R[a, a] - trace for a in range(3)] + [R[a, b] + R[b, a] for a, b in ((0, 1), (1, 2), (2, 0))]).T
    Oe1 = [PP[a, a] - masses for a in range(3)] + [PP[a, b] + PP[a, b].T for a, b in ((0, 1), (1, 2), (2, 0))]
    mc = f["r"] + f["phi"] @ q
    M = np.zeros((6 + k, 6 + k))
    M[:3, :3], M[3:6, 3:6], M[6:, 6:] = f["m"] * one, inertia, masses
    M[3:6, :3] = cross_matrix(mc)
    M[6:, :3], M[6:, 3:6] = f["phi"].T, Cr0 + (Kr @ q).T
    M = np.tril(M) + np.tril(M, -1).T
    squares = np.array([*(w * w), w[0] * w[1], w[1] * w[2], w[0] * w[2]])
    # Gr1[j][i] q_j: derivative i of the inertia by modes, twice its part of second order.
    turned = Gr0 @ rate + np.einsum("abji,j,i->ab", 2 * grown, q, rate)
    h = np.zeros(6 + k)
    h[:3] = -np.cross(w, np.cross(w, mc)) - 2 * np.cross(w, f["phi"] @ rate)
    h[3:6] = -turned @ w - np.cross(w, inertia @ w)
    h[6:] = (
        -(2 * Kr @ rate).T @ w - (Oe0 + np.array([each @ q for each in Oe1]).T) @ squares - f["K"] @ q - f["D"] @ rate
    )
    return M, h


def test_mbsims_equations_are_those_of_the_particles(
    tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    """D'Alembert over particles at large deflections and rates: every index and sign as MBSim reads it."""
    body, rng = particles(), np.random.default_rng(4)
    write_mbsim(tmp_path / "body.h5", body.file, body.integrals)
    f = read(tmp_path / "body.h5")
    k = len(f["K"])
    q, rate, w = rng.normal(size=k), rng.normal(size=k), rng.normal(size=3)
    M, h = equations(f, q, rate, w)
    x, moved = body.x + body.u @ q, body.u @ rate
    B = np.concatenate([np.tile(np.eye(3), (len(x), 1, 1)), -cross_matrix(x), body.u], axis=2)
    left = np.cross(w, np.cross(w, x)) + 2 * np.cross(w, moved)
    expected = np.einsum("n,nia,nib->ab", body.m, B, B)
    load = -np.einsum("n,nia,ni->a", body.m, B, left)
    load[6:] -= f["K"] @ q + f["D"] @ rate
    for found, known in ((M, expected), (h, load)):
        error = abs(found - known).max() / abs(known).max()
        record_property("error", float(error))
        assert error <= 1e-12


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


def test_nodes_whose_numbers_do_not_fit_are_refused(tmp_path: Path) -> None:
    body = particles()
    arrays = body.file.arrays | {"nodes/id": body.file.arrays["nodes/id"] + 2**31}
    with pytest.raises(WriteError, match=f"no node numbers above {2**31 - 1}, and this body has node {2**31 + 34}"):
        write_mbsim(tmp_path / "body.h5", replace(body.file, arrays=arrays), body.integrals)
    assert not list(tmp_path.iterdir())
