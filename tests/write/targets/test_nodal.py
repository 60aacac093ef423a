"""Tables of nodes: from them alone, the integrals that other codes are given."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from cmsreduce.errors import WriteError
from cmsreduce.model import cross_matrix
from cmsreduce.write.targets.nodal import write_nodal
from cmsreduce.write.targets.treetops import write_treetops, write_treetops_h5
from tests.write.particles import particles


def read(path: Path) -> dict[str, np.ndarray]:
    """Tables of the file by name: ``$ NAME rows columns: meaning``, then the rows."""
    lines, found = path.read_text().splitlines(), {}
    for at, line in enumerate(lines):
        head = re.fullmatch(r"\$ ([^:]+?) (\d+) (\d+)(: .+)?", line)
        if head:
            rows, columns = int(head[2]), int(head[3])
            table = np.array([text.split() for text in lines[at + 1 : at + 1 + rows]], dtype=float)
            assert table.shape == (rows, columns)
            found[head[1]] = table
    assert lines[-1] == "$ END"
    return found


def test_integrals_follow_from_the_nodes(tmp_path: Path) -> None:
    body = particles()
    write_nodal(tmp_path / "body.txt", body.file, body.integrals)
    f, integrals = read(tmp_path / "body.txt"), body.integrals
    m, x = f["MASSES"][:, 0], f["COORDINATES"]
    xx, yy, zz, xy, xz, yz = f["INERTIAS"].T
    J = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]).transpose(2, 0, 1)
    shapes = np.stack([f[f"SHAPE {mode}"] for mode in range(1, 5)], axis=2)
    u, v = shapes[:, :3], shapes[:, 3:]
    np.testing.assert_array_equal(f["NODES"][:, 0], [2, 3, 5, 8, 13, 21, 34])
    assert m.sum() == pytest.approx(integrals.mass, rel=1e-14)
    np.testing.assert_allclose(m @ x, integrals.first_moment, rtol=1e-13)
    squares = np.einsum("n,ni,nj->ij", m, x, x)
    np.testing.assert_allclose(np.trace(squares) * np.eye(3) - squares + J.sum(axis=0), integrals.inertia, rtol=1e-13)
    np.testing.assert_allclose(np.einsum("n,nia->ia", m, u), integrals.phi, rtol=1e-12)
    momentum = np.einsum("n,nia->ia", m, np.cross(x[:, :, None], u, axis=1)) + np.einsum("nij,nja->ia", J, v)
    np.testing.assert_allclose(momentum, integrals.r_cross_phi, rtol=1e-12, atol=1e-14)
    # Of a lump that turns with its node: E = int s s^T dm moves by v x s.
    E = 0.5 * np.einsum("nii->n", J)[:, None, None] * np.eye(3) - J
    S = cross_matrix(np.moveaxis(v, 2, 1))
    r_phi = np.einsum("n,ni,nja->ija", m, x, u) + np.einsum("nim,najm->ija", E, S)
    phi_phi = np.einsum("n,nia,njb->ijab", m, u, u) + np.einsum("naim,nml,nbjl->ijab", S, E, S)
    np.testing.assert_allclose(r_phi, integrals.r_phi, rtol=0, atol=1e-14)
    np.testing.assert_allclose(phi_phi, integrals.phi_phi, rtol=0, atol=1e-14)
    np.testing.assert_allclose(f["MODAL MASS"], np.eye(4), atol=1e-14)
    np.testing.assert_allclose(f["MODAL STIFFNESS"], np.diag(body.omega**2))
    np.testing.assert_allclose(f["MODAL DAMPING"], np.diag(0.02 * body.omega))


def test_nodes_without_mass_tables_are_refused(tmp_path: Path) -> None:
    body = particles()
    arrays = {name: values for name, values in body.file.arrays.items() if not name.startswith("nodes/lumped")}
    with pytest.raises(WriteError, match="no nodal masses; write the component file with `write"):
        write_nodal(tmp_path / "body.txt", replace(body.file, arrays=arrays), body.integrals)


def test_what_treeflx_documents(tmp_path: Path) -> None:
    body = particles(blind=True)
    write_treetops(tmp_path / "body.txt", body.file, body.integrals)
    f, integrals = read(tmp_path / "body.txt"), body.integrals
    assert f["MASS"][0, 0] == integrals.mass
    for name, expected in {
        "FRAME ORIGIN": integrals.origin[None],
        "FRAME AXES": integrals.axes,
        "FIRST MOMENT": integrals.first_moment[None],
        "INERTIA": integrals.inertia,
        "LINEAR MOMENTUM": integrals.phi.T,
        "ANGULAR MOMENTUM": integrals.r_cross_phi.T,
        "INERTIA DERIVATIVE 3": integrals.r_phi[:, :, 2],
        "SECOND ORDER xz": integrals.phi_phi[0, 2],
        "SECOND ORDER zx": integrals.phi_phi[0, 2].T,
        "MODAL STIFFNESS": np.diag(body.omega**2),
        "SHAPES 13": np.hstack([body.node_u[4].T, body.node_v[4].T]),
    }.items():
        np.testing.assert_allclose(f[name], expected, rtol=0, atol=1e-15 * max(1, abs(expected).max()), err_msg=name)
    # The slope of node 5 is not known, and the file says so.
    assert not f["SHAPES 5"][:, 3:].any()
    said = [line for line in (tmp_path / "body.txt").read_text().splitlines() if "slope not known" in line]
    assert [line.split()[2] for line in said] == ["5"]


def test_what_treeflx_documents_as_named_arrays(tmp_path: Path) -> None:
    """Sums over the particles themselves, and the text's tables for what is only copied."""
    body = particles(blind=True)
    write_treetops(tmp_path / "body.txt", body.file, body.integrals)
    text = read(tmp_path / "body.txt")
    for name in ("body.h5", "again.h5"):
        write_treetops_h5(tmp_path / name, body.file, body.integrals)
    assert (tmp_path / "body.h5").read_bytes() == (tmp_path / "again.h5").read_bytes()
    with h5py.File(tmp_path / "body.h5") as file:
        assert (file.attrs["format"], file.attrs["format_version"]) == ("cmsreduce-treetops", 1)
        found: dict[str, np.ndarray] = {}
        file.visititems(lambda name, item: found.update({name: item[()]} if isinstance(item, h5py.Dataset) else {}))
    assert set(found) == {*DOCUMENTED, "interfaces/root", "interfaces/tip"}
    for name, title in {
        "frame/axes": "FRAME AXES",
        "inertia": "INERTIA",
        "modal/mass": "MODAL MASS",
        "modal/stiffness": "MODAL STIFFNESS",
        "modal/damping": "MODAL DAMPING",
        "linear_momentum": "LINEAR MOMENTUM",
        "angular_momentum": "ANGULAR MOMENTUM",
        "nodes/coordinates": "COORDINATES",
    }.items():
        np.testing.assert_allclose(found[name], text[title], rtol=1e-14, atol=0, err_msg=name)
    for mode in range(4):
        expected = text[f"INERTIA DERIVATIVE {mode + 1}"]
        np.testing.assert_allclose(found["inertia_derivative"][mode], expected, rtol=1e-14)
    for i, j in ((0, 0), (0, 2), (2, 0)):
        expected = text[f"SECOND ORDER {'xyz'[i]}{'xyz'[j]}"]
        np.testing.assert_allclose(found["second_order"][i, j], expected, rtol=1e-14)
    # What the arrays mean: momentum of a mode is that of its inertia derivative's skew part, mass the trace.
    skew = np.cross(np.eye(3)[:, None], np.eye(3)[None])
    momentum = np.einsum("aij,ijk->ak", found["inertia_derivative"], skew)
    np.testing.assert_allclose(found["angular_momentum"], momentum, rtol=0, atol=1e-13)
    np.testing.assert_allclose(np.einsum("iiab->ab", found["second_order"]), found["modal/mass"], atol=1e-13)
    for at, node in enumerate(found["nodes/id"]):
        rows = np.hstack([found["nodes/translation"][at], found["nodes/slope"][at]])
        np.testing.assert_allclose(rows, text[f"SHAPES {node}"], rtol=1e-14)
    assert found["nodes/id"][found["nodes/slope_known"] == 0].tolist() == [5]


DOCUMENTED = {
    *(
        "frame/origin",
        "frame/axes",
        "mass",
        "first_moment",
        "inertia",
        "modal/mass",
        "modal/stiffness",
        "modal/damping",
    ),
    *("linear_momentum", "angular_momentum", "inertia_derivative", "second_order"),
    *("nodes/id", "nodes/coordinates", "nodes/translation", "nodes/slope", "nodes/slope_known"),
}


def test_the_page_names_every_array() -> None:
    page = (Path(__file__).parents[3] / "docs" / "treetops.md").read_text()
    for name in (*DOCUMENTED, "geometric_stiffness/load", "geometric_stiffness/K", "interfaces/NAME"):
        assert f"`{name}`" in page, name


def test_no_file_takes_the_name_of_treetops_own(tmp_path: Path) -> None:
    body = particles()
    with pytest.raises(WriteError, match="whose layout is not public"):
        write_treetops(tmp_path / "body.FLX", body.file, body.integrals)
    with pytest.raises(WriteError, match="whose layout is not public"):
        write_treetops_h5(tmp_path / "body.flx", body.file, body.integrals)
    assert not list(tmp_path.iterdir())
