"""SID files: the grammar of FEMBS, and the forces on particles that their terms stand for."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from cmsreduce.errors import WriteError
from cmsreduce.write.targets.sid import write_sid
from tests.write.particles import FORMATS, particles

FACES = ("root", "tip")


@dataclass
class Taylor:
    """m0 [row, column] and m1 [row, mode, column]."""

    m0: np.ndarray
    m1: np.ndarray


@dataclass
class Sid:
    nodes: dict[int, dict[str, Taylor]]
    body: dict[str, Taylor]
    mass: float
    hertz: list[float]


def read(path: Path) -> Sid:
    """Read an SID file line by line: keyword = value, blocks that end with their name."""
    lines = [" ".join(line.split()) for line in path.read_text().splitlines()]
    counts = [int(word) for word in lines[0].split(":")[0].split()]
    found = Sid({}, {}, 0.0, [])
    into: dict[str, Taylor] = found.body
    header: dict[str, int] = {}
    name = ""
    for line in lines[1:]:
        key, _, value = (part.strip() for part in line.partition("="))
        entry = re.fullmatch(r"m[01]\(([\d ,]+)\)", key)
        if entry:
            at = tuple(int(index) - 1 for index in entry[1].split(","))
            matrix = into[name].m0 if key[1] == "0" else into[name].m1
            matrix[at] = float(value.replace("D", "E"))
            if header["structure"] == 2:
                matrix[at[::-1]] = matrix[at]
        elif key == "mass":
            found.mass = float(value.replace("D", "E"))
        elif key.startswith("ielastq"):
            found.hertz.append(float(value.split(":")[1].split()[0]))
        elif key == "nelastq":
            assert int(value) == counts[1]
        elif key == "new node":
            into = found.nodes.setdefault(int(value), {})
        elif key == "end node":
            into = found.body
        elif key in ("order", "nrow", "ncol", "nq", "nqn", "structure"):
            header[key] = int(value)
            if key == "structure":
                assert (header["nq"], header["nqn"]) == (counts[1], 0)
                shape = header["nrow"], header["nq"], header["ncol"]
                into[name] = Taylor(np.zeros(shape[::2]), np.zeros(shape))
        elif key.startswith("end "):
            assert key[4:] in (name, "refmod", "frame", "modal", "part")
        elif not key.startswith(("rframe", "new modal")):
            name = key
    assert len(found.nodes) == counts[0]
    return found


def inertia(rows: np.ndarray) -> np.ndarray:
    """Tensor of a column of J, whose rows are xx yy zz xy xz yz."""
    xx, yy, zz, xy, xz, yz = rows
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def growth(sid: Sid) -> np.ndarray:
    """Derivatives of the inertia tensor [mode, 3, 3]."""
    return np.array([inertia(rows) for rows in sid.body["J"].m1[:, :, 0].T])


@pytest.mark.skipif(not FORMATS.is_dir(), reason="no format samples here")
def test_the_reader_understands_a_file_of_fembs() -> None:
    sid = read(FORMATS / "five_node_model.sid_fem")
    assert list(sid.nodes) == [2519, 2523, 2520, 2521, 2522]
    assert sid.hertz == [49.64, 63.453]
    np.testing.assert_allclose(np.sqrt(np.diag(sid.body["Ke"].m0)) / (2 * np.pi), sid.hertz, rtol=1e-4)
    # Its columns go by axes: Gr is the growth of the inertia on its diagonal, Oe minus half of it.
    dJ, Gr, Oe = growth(sid), sid.body["Gr"].m0.reshape(3, 3, 2), sid.body["Oe"].m0
    for mode in range(2):
        both = Gr[:, :, mode] + Gr[:, :, mode].T
        np.testing.assert_allclose(both, 2 * dJ[mode], rtol=1e-9)
        squares = [dJ[mode, a, b] for a, b in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))]
        np.testing.assert_allclose(Oe[mode], -np.array([0.5, 0.5, 0.5, 1, 1, 1]) * squares, rtol=1e-9)
    np.testing.assert_allclose(
        sid.body["Ge"].m0.reshape(2, 3, 2), 2 * np.moveaxis(sid.body["Cr"].m1, 1, 2), rtol=1e-9, atol=1e-12
    )


@pytest.mark.parametrize("dialect", ["by-axis", "by-mode", "gr-by-mode", "embs"])
def test_forces_on_particles(tmp_path: Path, dialect: str) -> None:
    """Inertia forces of a moving frame and moving modes, summed over particles."""
    body = particles()
    write_sid(tmp_path / "body.sid", body.file, body.integrals, dialect)
    sid = read(tmp_path / "body.sid")
    m, u, k = body.m[:, None], body.u, 4
    w, alpha, a = np.array([0.4, -0.9, 1.3]), np.array([0.2, 0.5, -0.7]), np.array([1.0, -2.0, 0.5])
    q, rate = np.array([0.1, 0.2, -0.3, 0.05]), np.array([0.3, -0.2, 0.7, 0.1])

    def blocks(name: str) -> np.ndarray:
        """Gr or Ge as [row, axis, mode]."""
        rows = sid.body[name].m0.shape[0]
        by_axis = dialect == "by-axis" or (dialect == "gr-by-mode" and name == "Ge")
        shape = (rows, 3, k) if by_axis else (rows, k, 3)
        return np.moveaxis(sid.body[name].m0.reshape(shape), shape.index(k, 1), 2)

    def forces(x: np.ndarray) -> np.ndarray:
        return m * (a + np.cross(alpha, x) + np.cross(w, np.cross(w, x)) + 2 * np.cross(w, u @ rate))

    t = {name: taylor.m0 + np.einsum("rlc,l->rc", taylor.m1, q) for name, taylor in sid.body.items()}
    squares = np.array([w[0] ** 2, w[1] ** 2, w[2] ** 2, w[0] * w[1], w[1] * w[2], w[0] * w[2]])
    ours = t["Ct"] @ a + t["Cr"] @ alpha + np.einsum("kal,l,a->k", blocks("Ge"), rate, w) + t["Oe"] @ squares
    # Exact for any q: modal forces are linear in it. The file has twelve digits.
    summed = np.einsum("nik,ni->k", u, forces(body.x + u @ q))
    np.testing.assert_allclose(ours, summed, rtol=0, atol=1e-10 * abs(summed).max())
    J = inertia(sid.body["J"].m0[:, 0])
    moment = np.cross(sid.body["mdCM"].m0[:, 0], a) + J @ alpha + np.cross(w, J @ w)
    moment += np.einsum("ral,l,a->r", blocks("Gr"), rate, w)
    summed = np.cross(body.x, forces(body.x)).sum(axis=0)
    np.testing.assert_allclose(moment, summed, rtol=0, atol=1e-10 * abs(summed).max())
    assert sid.mass == pytest.approx(body.m.sum(), rel=1e-11)


def test_growth_of_the_inertia(tmp_path: Path) -> None:
    """Half the difference of the inertias at q and -q is the part of it that is linear in q."""
    body = particles()
    write_sid(tmp_path / "body.sid", body.file, body.integrals)
    sid = read(tmp_path / "body.sid")
    q = np.array([0.1, 0.2, -0.3, 0.05])

    def moved(sign: float) -> np.ndarray:
        x = body.x + sign * body.u @ q
        return (x**2).sum(axis=1) @ body.m * np.eye(3) - np.einsum("n,ni,nj->ij", body.m, x, x)

    linear = 0.5 * (moved(1) - moved(-1))
    np.testing.assert_allclose(np.einsum("lij,l->ij", growth(sid), q), linear, rtol=0, atol=1e-10 * abs(linear).max())
    np.testing.assert_allclose(sid.body["mdCM"].m1[:, :, 0], body.integrals.phi, rtol=1e-10)


def test_nodes_and_matrices(tmp_path: Path) -> None:
    body = particles()
    write_sid(tmp_path / "body.sid", body.file, body.integrals)
    sid = read(tmp_path / "body.sid")
    assert list(sid.nodes) == [2, 3, 5, 8, 13, 21, 34]
    q = np.array([0.3, -0.2, 0.7, 0.1])
    for index, node in enumerate(sid.nodes.values()):
        moved = node["origin"].m0[:, 0] + node["origin"].m1[:, :, 0] @ q
        np.testing.assert_allclose(moved, body.node_x[index] + body.node_u[index] @ q, rtol=1e-10, atol=1e-11)
        np.testing.assert_allclose(node["phi"].m0, body.node_u[index], rtol=1e-11)
        np.testing.assert_allclose(node["psi"].m0, body.node_v[index], rtol=1e-11)
        turned = node["AP"].m0 + np.einsum("rlc,l->rc", node["AP"].m1, q)
        angle, arm = body.node_v[index] @ q, np.array([0.2, -0.4, 0.9])
        np.testing.assert_allclose(turned @ arm, arm + np.cross(angle, arm), rtol=1e-10)
    np.testing.assert_allclose(sid.body["Me"].m0, np.eye(4), atol=1e-11)
    np.testing.assert_allclose(np.diag(sid.body["Ke"].m0), body.omega**2, rtol=1e-11)
    np.testing.assert_allclose(np.diag(sid.body["De"].m0), 0.02 * body.omega, rtol=1e-11)
    np.testing.assert_allclose(sid.body["Cr"].m0.T, body.integrals.r_cross_phi, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("name", ["Jrotor", "subframe", "Metal deck", "Jframe 2", "mass 7.5"])
def test_keywords_stand_alone_for_a_reader_that_searches_for_them(tmp_path: Path, name: str) -> None:
    """EMBS_ModelicaLib takes a line that contains a keyword anywhere, so that no other line may contain one."""
    body = particles()
    file = replace(body.file, name=name, arrays={**body.file.arrays, "nodes/id": 10**6 + np.arange(7)})
    file = replace(file, arrays={**file.arrays, **{f"interfaces/{face}/node": np.array([10**6]) for face in FACES}})
    write_sid(tmp_path / "body.sid", file, body.integrals, "embs")
    head, _, *lines = (tmp_path / "body.sid").read_text().splitlines()
    assert name in head
    words = ["refmod", "frame", "mdCM", "J", "Ct", "Cr", "Me", "Gr", "Ge", "Oe", "ksigma", "Ke", "De"]
    top = [line for line in lines if len(line) - len(line.lstrip()) <= 11]
    found = [word for line in top for word in words if word in line and "end " not in line]
    assert found == words
    sid = read(tmp_path / "body.sid")
    # Its integers have five digits; a symmetric matrix is there as a whole.
    assert list(sid.nodes) == [1, 2, 3, 4, 5, 6, 7]
    assert sid.mass == pytest.approx(body.m.sum(), rel=1e-15)
    assert "structure             =    2" not in (tmp_path / "body.sid").read_text()
    np.testing.assert_allclose(sid.body["Ke"].m0, np.diag(body.omega**2), rtol=1e-15)


def test_modes_without_mass_are_refused(tmp_path: Path) -> None:
    body = particles(static=True)
    with pytest.raises(WriteError, match="1 static modes have no mass, and a code that reads SID inverts Me"):
        write_sid(tmp_path / "body.sid", body.file, body.integrals)
