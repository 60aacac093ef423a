"""42's flexible-body file: its grammar, and the forces that 42 forms of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cmsreduce.errors import WriteError
from cmsreduce.write.targets.flex42 import write_42
from tests.write.particles import FORMATS, particles


class Lines:
    """Lines of the file in turn, without their comments; 42 skips headings and reads comments into 80 characters."""

    def __init__(self, path: Path) -> None:
        self.lines = path.read_text().splitlines()
        self.at = 0

    def heading(self, *words: str) -> None:
        line = self.lines[self.at]
        assert all(word in line for word in words), line
        self.at += 1

    def row(self) -> list[str]:
        values, _, comment = self.lines[self.at].partition("!")
        assert len(comment) < 79
        self.at += 1
        return values.split()

    def entries(self, *shape: int) -> np.ndarray:
        values = np.zeros(shape)
        for _ in range(int(self.row()[0])):
            *place, value = self.row()
            values[tuple(int(index) for index in place)] = float(value)
        return values


def read(path: Path, joints: int, nodes: int) -> dict[str, np.ndarray]:
    """Read the file as 42 does, which knows the numbers of joints and nodes from elsewhere."""
    f, found = Lines(path), {}
    f.heading("Flexible Body Inputs for 42")
    f.row()
    k = int(f.row()[0])
    f.heading("Initial Modal States")
    found["start"] = np.array([f.row() for _ in range(k)], dtype=float)
    for where, count in (("Joint", joints), ("Analysis", nodes)):
        f.heading(f"{where} Node Mode Shapes")
        for kind in ("PSI", "THETA"):
            f.heading("Non-zero", kind)
            found[f"{where} {kind}"] = f.entries(k, count, 3)
    for name in ("Mass", "Stiffness", "Damping"):
        f.heading("Non-zero", name)
        found[name] = f.entries(k, k)
    for name, symbol in (("Linear Momentum", "Pf"), ("Angular Momentum", "Hf")):
        f.heading(name, symbol)
        found[symbol] = np.array([f.row() for _ in range(k)], dtype=float).T
    f.heading("Linear Modal Integral, L")
    found["L"] = f.entries(3, 3, k)
    f.heading("Angular Modal Integral, N")
    found["N"] = f.entries(3, 3, k, k)
    assert f.lines[f.at] == "[EOF]"
    return found


@pytest.mark.skipif(not FORMATS.is_dir(), reason="no format samples here")
def test_the_reader_understands_a_file_of_42() -> None:
    f = read(FORMATS / "Flex_Simple.txt", 0, 2)
    np.testing.assert_allclose(np.sqrt(np.diag(f["Stiffness"])) / (2 * np.pi), [1.0, 10.0], rtol=1e-4)
    assert f["Analysis THETA"][1, 0, 1] == 0.0707
    assert f["Analysis PSI"][0, 1, 2] == -0.1


def test_forces_that_42_forms(tmp_path: Path) -> None:
    """Modal forces of a spinning frame with moving modes, as 42 forms them of L and N, against particles."""
    body = particles(still=True)
    write_42(tmp_path / "flex.txt", body.file, body.integrals)
    f = read(tmp_path / "flex.txt", 2, 7)
    w, alpha, a = np.array([0.4, -0.9, 1.3]), np.array([0.2, 0.5, -0.7]), np.array([1.0, -2.0, 0.5])
    eta, xi = np.array([0.3, -0.1, 0.2, 0.05]), np.array([0.3, -0.2, 0.7, 0.1])
    L, N = f["L"], f["N"]
    Q = np.array([N[2, 1] - N[1, 2], N[0, 2] - N[2, 0], N[1, 0] - N[0, 1]])
    R = np.transpose(L, (1, 2, 0)) - np.einsum("iik,ab->akb", L, np.eye(3))
    S = np.transpose(N, (1, 2, 3, 0)) - np.einsum("iijk,ab->ajkb", N, np.eye(3))
    carried = f["Pf"].T @ a + (f["Hf"] + Q @ eta).T @ alpha
    spun = np.einsum("a,akb,b->k", w, R, w) + np.einsum("a,ajkb,b,k->j", w, S, w, eta)
    spun += 2 * np.einsum("ajk,k,a->j", Q, xi, w)
    x = body.x + body.u @ eta
    acceleration = a + np.cross(alpha, x) + np.cross(w, np.cross(w, x)) + 2 * np.cross(w, body.u @ xi)
    np.testing.assert_allclose(carried + spun, np.einsum("n,nik,ni->k", body.m, body.u, acceleration), rtol=1e-12)


def test_shapes_and_matrices(tmp_path: Path) -> None:
    body = particles(still=True)
    write_42(tmp_path / "flex.txt", body.file, body.integrals)
    f = read(tmp_path / "flex.txt", 2, 7)
    for kind, shapes in (("PSI", body.node_u), ("THETA", body.node_v)):
        np.testing.assert_allclose(f[f"Analysis {kind}"], np.transpose(shapes, (2, 0, 1)), rtol=0, atol=1e-15)
        np.testing.assert_allclose(f[f"Joint {kind}"], np.transpose(shapes[[1, 6]], (2, 0, 1)), rtol=0, atol=1e-15)
    np.testing.assert_allclose(f["Mass"], np.eye(4), atol=1e-14)
    np.testing.assert_allclose(f["Stiffness"], np.diag(body.omega**2))
    np.testing.assert_allclose(f["Damping"], np.diag(0.02 * body.omega))
    np.testing.assert_allclose(f["Hf"], body.integrals.r_cross_phi, rtol=0, atol=1e-15)
    assert not f["start"].any()


def test_numbers_are_in_si(tmp_path: Path) -> None:
    """A body of particles in millimetres, tonnes and milliseconds: 42 reads metres, kilograms and seconds."""
    body = particles(0.0, still=True)
    units = {"name": "mm-t-ms", "length_in_si": 1e-3, "mass_in_si": 1e3, "time_in_si": 1e-3}
    small = replace(body.file, attributes=body.file.attributes | {"units": units})
    flex, nodes = write_42(tmp_path / "Flex_cloud.txt", small, body.integrals)
    f = read(flex, 2, 7)
    m = 1e3 * body.node_m
    x = np.array([row.split('"')[0].split() for row in nodes.read_text().splitlines()[4:]], dtype=float)
    np.testing.assert_allclose(x, 1e-3 * body.node_x, rtol=0, atol=1e-17)
    u, v = (np.transpose(f[f"Analysis {kind}"], (1, 2, 0)) for kind in ("PSI", "THETA"))
    # The same motion: a metre is a thousand millimetres, a radian is a radian.
    np.testing.assert_allclose(v / u, 1e3 * body.node_v / body.node_u, rtol=1e-12)
    np.testing.assert_allclose(f["Mass"], np.einsum("n,nia,nib->ab", m, u, u), atol=1e-13)
    np.testing.assert_allclose(f["Stiffness"], f["Mass"] @ np.diag((1e3 * body.omega) ** 2), atol=1e-4)
    np.testing.assert_allclose(f["Damping"], f["Mass"] @ np.diag(0.02e3 * body.omega), atol=1e-9)
    np.testing.assert_allclose(f["Pf"], np.einsum("n,nia->ia", m, u), rtol=0, atol=1e-11)
    np.testing.assert_allclose(
        f["Hf"], np.einsum("n,nia->ia", m, np.cross(x[:, :, None], u, axis=1)), rtol=0, atol=1e-13
    )
    np.testing.assert_allclose(f["L"], np.einsum("n,ni,nja->ija", m, x, u), rtol=0, atol=1e-14)
    np.testing.assert_allclose(f["N"], np.einsum("n,nia,njb->ijab", m, u, u), rtol=0, atol=1e-13)


def test_numbers_of_the_spacecrafts_joints_and_the_file_of_nodes(tmp_path: Path) -> None:
    """Joint 4 alone is at this body; its nodes are where 42 looks for the analysis nodes, in their order."""
    body = particles(still=True)
    flex, nodes = write_42(tmp_path / "Flex_cloud.txt", body.file, body.integrals, {"tip": 4})
    assert (flex.name, nodes.name) == ("Flex_cloud.txt", "Nodes_cloud.txt")
    f = read(flex, 5, 7)
    np.testing.assert_allclose(f["Joint PSI"][:, 4], body.node_u[6].T, rtol=0, atol=1e-15)
    assert not f["Joint PSI"][:, :4].any()
    title, _, count, _, *rows = nodes.read_text().splitlines()
    assert "Body Node Inputs for 42" in title and int(count.split("!")[0]) == len(rows) == 7
    # Three numbers, then a comment in quotation marks.
    parts = [row.split('"') for row in rows]
    np.testing.assert_allclose(np.array([p[0].split() for p in parts], dtype=float), body.node_x, rtol=0, atol=1e-15)
    assert [p[1] for p in parts][:2] == ["node 2", "node 3 root"] and all(p[2] == "" for p in parts)


def test_a_joint_has_one_node(tmp_path: Path) -> None:
    body = particles(still=True)
    several = {
        **body.file.arrays,
        "interfaces/tip/node": np.array([21, 34]),
        "interfaces/tip/component": np.array([1, 1]),
    }
    with pytest.raises(WriteError, match="interface 'tip' has 2 nodes, and a joint of 42 has one"):
        write_42(tmp_path / "flex.txt", replace(body.file, arrays=several), body.integrals)


def test_modes_without_mass_are_refused(tmp_path: Path) -> None:
    body = particles(static=True)
    with pytest.raises(WriteError, match="42 divides by the modal mass"):
        write_42(tmp_path / "flex.txt", body.file, body.integrals)


def test_modes_with_momentum_are_refused(tmp_path: Path) -> None:
    """42 sets Pf and Hf to zero with REFPT_CM (42init.c), and adds Hf twice with REFPT_JOINT (AugmentIPAngVelf)."""
    body = particles()
    with pytest.raises(WriteError, match=r"its modes have momentum.*`cmsreduce convert --for 42`"):
        write_42(tmp_path / "flex.txt", body.file, body.integrals)
    assert not [*tmp_path.iterdir()]
