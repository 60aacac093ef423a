"""MBDyn's record groups: its grammar, one mass in all of them, and the invariants it forms of lumped masses itself."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cmsreduce.errors import WriteError
from cmsreduce.mechanics import integrals_about, mass_points, mean_axis_motion, without_rigid_motion
from cmsreduce.model import SecondOrder, cross_matrix
from cmsreduce.write.targets.mbdyn import write_mbdyn
from tests.write.particles import FORMATS, particles


def read(path: Path) -> dict[int, np.ndarray]:
    """Numbers of every record group, which its header line opens and any other comment ends, as MBDyn reads them."""
    words: dict[int, list[float]] = {}
    group = 0
    for line in path.read_text().splitlines():
        if line.startswith("** RECORD GROUP"):
            group = int(line.split()[3].rstrip(","))
            words[group] = []
        elif not line.startswith("**") and line.strip():
            words[group] += [float(word) for word in line.replace("REV0", "").split()]
    n, k = (int(number) for number in words[1][:2])
    assert words[1][2:] == [0, 0, 0]
    shapes = {
        2: (n,), 3: (k,), 4: (k,), 5: (n,), 6: (n,), 7: (n,), 8: (k, n, 6), 9: (k, k), 10: (k, k), 11: (n, 6),
        12: (13,), 13: (k, k), 14: (3, k), 15: (3, k), 16: (3, k, 3), 17: (3, k, k), 18: (3, k, k, 3),
    }  # fmt: skip
    return {group: np.array(words[group]).reshape(shape) for group, shape in shapes.items() if group in words}


def of_lumps(f: dict[int, np.ndarray]) -> dict[int, np.ndarray]:
    """Quantities that MBDyn computes from lumped masses: modal mass, rigid body, and invariants 3, 4, 8, 5 and 9."""
    m, J, shapes = f[11][:, 0], f[11][:, 3:], f[8]
    x = np.column_stack([f[5], f[6], f[7]])
    k = len(shapes)
    found = {9: np.zeros((k, k)), 14: np.zeros((3, k)), 15: np.zeros((3, k)), 16: np.zeros((3, k, 3))}
    found |= {17: np.zeros((3, k, k)), 18: np.zeros((3, k, k, 3))}
    inertia = np.zeros((3, 3))
    for i, (mass, about) in enumerate(zip(m, J, strict=True)):
        arm, u, v = cross_matrix(x[i]), shapes[:, i, :3].T, shapes[:, i, 3:].T
        inertia += np.diag(about) - mass * arm @ arm
        found[9] += mass * u.T @ u + v.T @ np.diag(about) @ v
        found[14] += mass * u
        found[15] += mass * arm @ u + np.diag(about) @ v
        for j in range(k):
            across = cross_matrix(mass * u[:, j])
            found[16][:, j] -= arm @ across
            found[17][:, j] += across @ u
            for other in range(k):
                found[18][:, j, other] += across @ cross_matrix(u[:, other])
    centre = m @ x / m.sum()
    inertia += m.sum() * cross_matrix(centre) @ cross_matrix(centre)
    return found | {12: np.concatenate([[m.sum()], centre, inertia.ravel()])}


@pytest.mark.skipif(not FORMATS.is_dir(), reason="no format samples here")
def test_the_reader_understands_a_file_mbdyn_accepts() -> None:
    f = read(FORMATS / "mbdyn_beam.fem")
    assert f[8].shape == (18, 21, 6)
    np.testing.assert_array_equal(f[2], np.arange(1001, 1022))
    # Its modal mass is that of its lumped mass.
    np.testing.assert_allclose(of_lumps(f)[9], f[9], atol=1e-9)


@pytest.mark.parametrize("dialect", ["invariants", "lumped"])
def test_one_mass_in_every_group(tmp_path: Path, dialect: str) -> None:
    body = particles(0.0)
    write_mbdyn(tmp_path / "body.fem", body.file, body.integrals, dialect)
    f = read(tmp_path / "body.fem")
    lumps = np.column_stack([np.tile(body.node_m, (3, 1)).T, np.zeros((7, 3))])
    for group, expected in of_lumps({**f, 11: lumps}).items():
        if group in f:
            np.testing.assert_allclose(f[group], expected, rtol=0, atol=1e-13 * abs(expected).max(), err_msg=str(group))
    groups = {9, 10, 12, 13} | ({11} if dialect == "lumped" else {14, 15, 16, 17, 18})
    assert set(f) == {2, 3, 4, 5, 6, 7, 8} | groups
    np.testing.assert_array_equal(f[2], [2, 3, 5, 8, 13, 21, 34])
    np.testing.assert_allclose(
        np.moveaxis(f[8], 0, 2), np.concatenate([body.node_u, body.node_v], axis=1), rtol=0, atol=1e-15
    )
    np.testing.assert_allclose(np.diag(f[10]), body.omega**2)
    np.testing.assert_allclose(np.diag(f[13]), 0.02 * body.omega)


def test_groups_that_every_version_reads_about_mean_axes(tmp_path: Path) -> None:
    """Without invariants MBDyn takes the momentum of the modes for zero: they have none about the centre of mass."""
    body = particles()
    with pytest.raises(WriteError, match=r"leaves out the momentum of the modes.* `--for mbdyn-1\.7\.3-first-order`"):
        write_mbdyn(tmp_path / "body.fem", body.file, body.integrals, "first-order")
    centre = body.m @ body.x / body.m.sum()
    x = body.x - centre
    about = sum(-m * cross_matrix(r) @ cross_matrix(r) for m, r in zip(body.m, x, strict=True))
    origin = body.integrals.origin + body.integrals.axes.T @ centre
    mean = integrals_about(body.integrals, origin)
    left = without_rigid_motion(mean, mean_axis_motion(mean))
    mass = np.einsum("iiab->ab", left.phi_phi)
    file = replace(body.file, arrays={**body.file.arrays, "modes/mass": mass})
    write_mbdyn(tmp_path / "body.fem", file, left, "first-order")
    f = read(tmp_path / "body.fem")
    assert set(f) == {2, 3, 4, 5, 6, 7, 8, 9, 10, 12, 13}
    np.testing.assert_array_equal(f[9], f[9].T)
    np.testing.assert_allclose(f[9], mass, rtol=0, atol=1e-15)
    np.testing.assert_allclose(f[12], [body.m.sum(), 0, 0, 0, *about.ravel()], rtol=0, atol=1e-13 * abs(about).max())


def test_lumps_that_turn(tmp_path: Path) -> None:
    """Inertia of the lumps is in the rigid body and in each mode's momentum; lumped, by its diagonal in every group."""
    body = particles()
    write_mbdyn(tmp_path / "body.fem", body.file, body.integrals, "invariants")
    f = read(tmp_path / "body.fem")
    np.testing.assert_allclose(f[15], body.integrals.r_cross_phi, rtol=0, atol=1e-15)
    np.testing.assert_allclose(f[9], np.eye(4), atol=1e-14)
    x = body.x - body.m @ body.x / body.m.sum()
    about = sum(-m * cross_matrix(r) @ cross_matrix(r) for m, r in zip(body.m, x, strict=True))
    np.testing.assert_allclose(f[12][4:].reshape(3, 3), about, rtol=1e-13, atol=1e-14)
    write_mbdyn(tmp_path / "body.fem", body.file, body.integrals, "lumped")
    f = read(tmp_path / "body.fem")
    np.testing.assert_allclose(f[11][:, 3:], [np.diag(J) for J in body.node_J])
    for group, expected in of_lumps(f).items():
        if group in f:
            np.testing.assert_allclose(f[group], expected, rtol=0, atol=1e-13 * abs(expected).max(), err_msg=str(group))


def test_points_have_the_integrals_of_lumps_that_turn(tmp_path: Path) -> None:
    """MBDyn's sums over the points are the integrals; the nodes have no mass, and come first under their own ids."""
    body = particles()
    write_mbdyn(tmp_path / "body.fem", body.file, body.integrals)
    f = read(tmp_path / "body.fem")
    np.testing.assert_array_equal(f[2], [2, 3, 5, 8, 13, 21, 34, *range(35, 35 + 16)])
    assert not f[11][:7].any()
    assert (f[11][7:, :3] > 0).all()
    assert not f[11][:, 3:].any()
    assert (f[9] == f[9].T).all()
    write_mbdyn(tmp_path / "body.fem", body.file, body.integrals, "invariants")
    whole = read(tmp_path / "body.fem")
    for group, found in of_lumps(f).items():
        expected = whole[group]
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * abs(expected).max(), err_msg=str(group))
    np.testing.assert_array_equal(f[12], whole[12])


@pytest.mark.parametrize("static", [False, True])
def test_points_of_a_mass_that_no_body_has(static: bool) -> None:
    """Polar inertia alone makes the spread of a bar along its axis negative; some points then have negative mass."""
    integrals = particles(static=static).integrals
    assert integrals.second_order is not None
    lacking = integrals.phi_phi.copy()
    lacking[0, 0] -= 1.5 * np.eye(4)
    lacking[1, 1] += 1.5 * np.eye(4)
    odd = replace(integrals, second_order=SecondOrder(integrals.r_phi, lacking))
    points = mass_points(odd)
    m, x, u = points.mass, points.position, points.translation
    assert (m < 0).any()
    np.testing.assert_allclose(m.sum(), odd.mass, rtol=1e-13)
    np.testing.assert_allclose(np.einsum("n,nia->ia", m, u), odd.phi, atol=1e-13)
    np.testing.assert_allclose(np.einsum("n,ni,nja->ija", m, x, u), odd.r_phi, atol=1e-13)
    np.testing.assert_allclose(np.einsum("n,nia,njb->ijab", m, u, u), lacking, atol=1e-13)
    squares = np.einsum("n,ni,nj->ij", m, x, x)
    np.testing.assert_allclose(np.trace(squares) * np.eye(3) - squares, odd.inertia, atol=1e-12)


def test_modes_without_mass_have_a_row_of_zeros(tmp_path: Path) -> None:
    body = particles(static=True)
    write_mbdyn(tmp_path / "body.fem", body.file, body.integrals, "invariants")
    f = read(tmp_path / "body.fem")
    np.testing.assert_allclose(f[9], np.diag([1.0, 1, 1, 0]), atol=1e-14)
    assert f[10][3, 3] == 1.0
    assert abs(f[14][:, 3]).max() < 1e-15


@pytest.mark.parametrize("dialect", ["points", "invariants", "lumped", "first-order"])
def test_a_body_that_keeps_no_mode_is_refused(tmp_path: Path, dialect: str) -> None:
    """MBDyn: illegal number of modes 0."""
    body = particles()
    at = body.integrals
    none = replace(
        at,
        modes=at.modes[:0],
        phi=at.phi[:, :0],
        r_cross_phi=at.r_cross_phi[:, :0],
        second_order=SecondOrder(at.r_phi[..., :0], at.phi_phi[..., :0, :0]),
    )
    with pytest.raises(WriteError, match="'cloud': it keeps no mode that deforms it"):
        write_mbdyn(tmp_path / "body.fem", body.file, none, dialect)


@pytest.mark.parametrize(
    ("without", "message"),
    [(["nodes/lumped_mass"], "its file has no nodal masses; .*all_nodes: true"), ([], r"have 8\.\d+ of its mass of 9")],
)
def test_lumped_masses_of_all_nodes_are_needed(tmp_path: Path, without: list[str], message: str) -> None:
    body = particles()
    arrays = {name: values for name, values in body.file.arrays.items() if name not in without}
    if not without:
        arrays["nodes/lumped_mass"] = np.r_[body.node_m[:-1], 0.0]
    with pytest.raises(WriteError, match=message):
        write_mbdyn(tmp_path / "body.fem", replace(body.file, arrays=arrays), body.integrals, "lumped")
