"""Matrices, nodes of rows and coordinates as ANSYS exports them, from the files to a run."""

from __future__ import annotations

import json
import os
import subprocess
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.linalg as la
import scipy.sparse as sp
from click.testing import CliRunner

from cmsreduce.cli import main
from cmsreduce.errors import DofMapError, ReadError
from cmsreduce.model import FEModel
from cmsreduce.pipeline.drafts import draft_body
from cmsreduce.read import MatrixSource, read_body, read_geometry, read_matrix
from tests.solids import block

# A clone of github.com/jgerstmayr/EXUDYN, which is not part of its package.
CLONE = os.environ.get("EXUDYN_CLONE", "")
ROTOR = ("MassMatrixSparse", "StiffnessMatrixSparse", "MatrixDofMappingVector", "NodalCoordinates")
# The limit below which ANSYS writes no entry, relative to the largest one of the rotor.
SMALLEST = 1e-12


def run(*words: str) -> None:
    done = CliRunner().invoke(main, words)
    assert (done.exit_code, done.stderr) == (0, ""), done.output


def exported(folder: Path, smallest: float = SMALLEST) -> FEModel:
    """Write a block as ANSYS does: nodes in another order, small entries left out, decimal commas in the listing."""
    body = block("block", (0.9, 0.3, 0.2), (3, 2, 1))
    assert body.nodes is not None
    order = np.random.default_rng(1).permutation(len(body.nodes))
    rows = (3 * order[:, None] + np.arange(3)).ravel()
    turned = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
    T = sp.kron(sp.eye(len(body.nodes)), turned, format="csc")
    for name, A in (("Stiffness", body.K), ("Mass", body.M)):
        A = (T @ A @ T.T)[rows][:, rows].tocoo()
        kept = abs(A.data) > smallest * abs(A.data).max()
        A = sp.coo_array((A.data[kept], (A.row[kept], A.col[kept])), shape=A.shape)
        scipy.io.mmwrite(
            folder / f"part{name}.mtx", A, comment=" Creator: ANSYS Inc", precision=16, symmetry="symmetric"
        )
    ids = body.nodes.id[order]
    scipy.io.mmwrite(folder / "partMapping.mtx", ids[:, None], comment=" Creator: ANSYS Inc")
    lines = ["Knotennummer\tX-Position (m)\tY-Position (m)\tZ-Position (m)\t"]
    for node, xyz in zip(body.nodes.id, body.nodes.xyz @ turned.T, strict=True):
        lines.append("\t".join([str(node), *(f"{x:.9e}".replace(".", ",") for x in xyz)]) + "\t")
    (folder / "partNodes.txt").write_text("\r\n".join(lines) + "\r\n")
    return body


def test_a_part_runs_as_it_was_exported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    body = exported(tmp_path)
    monkeypatch.chdir(tmp_path)
    run("new", "part", "partMapping.mtx", "partMass.mtx", "partNodes.txt", "partStiffness.mtx")
    run("run", "part.yaml", "--quiet", "--set", "verify={}")
    found = json.loads(Path("build/part/summary.json").read_text())
    exact = np.sqrt(la.eigh(body.K.toarray(), body.M.toarray(), eigvals_only=True)[6:9]) / 2 / np.pi
    np.testing.assert_allclose(found["components"]["part"]["frequencies_hz"][:3], exact, rtol=1e-9)


def harwell_boeing(path: Path, A: sp.csc_array) -> None:
    """Write a matrix with the header and fields of HBMAT of ANSYS 2023 R2, the lower triangle by columns."""
    n, lower = A.shape[0], sp.csc_array(sp.tril(A))
    lines = [
        f"{'Stiffness matrix from ANSYS FULL file dumped into Harwell-Boeing format':80}",
        "".join(f"{k:14d}" for k in (n + 1 + 2 * lower.nnz, n + 1, lower.nnz, lower.nnz, 0)),
        "RSA" + " " * 11 + "".join(f"{k:14d}" for k in (n, n, lower.nnz, 0)),
        f"{'(I14)':16}{'(I14)':16}{'(d25.15)':20}{'(d25.15)':20}",
        *(f"{k + 1:14d}" for k in (*lower.indptr, *lower.indices)),
        *(f"{x:25.15e}".replace("e", "D") for x in lower.data),
    ]
    path.write_text("\n".join(lines) + "\n")


def hbmat(name: str, A: sp.csc_array, body: FEModel, order: np.ndarray) -> None:
    """A matrix and its mapping, in an order of their own."""
    of = body.dofs[order]
    harwell_boeing(Path(f"{name}.txt"), sp.csc_array(A)[order][:, order])
    lines = [
        f"{k + 1:14d}{node:14d}    U{'XYZ'[c - 1]:3}"
        for k, (node, c) in enumerate(zip(of.node, of.component, strict=False))
    ]
    Path(f"{name}.mapping").write_text("\n".join(["    Matrix Eqn          Node    DOF     ", *lines]) + "\n")


def test_stiffness_and_mass_of_hbmat_in_different_orders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each matrix has the rows of its own mapping; a mapping of another model is refused."""
    body = block("part", (0.9, 0.3, 0.2), (3, 2, 1))
    monkeypatch.chdir(tmp_path)
    for seed, (name, A) in enumerate((("stiff", body.K), ("mass", body.M))):
        hbmat(name, A, body, np.random.default_rng(seed).permutation(body.n))
    found = read_matrix(Path("mass.txt"), dofs=Path("stiff.mapping"))
    assert found.dofs is not None
    to = body.dofs.rows(found.dofs.node, found.dofs.component)
    np.testing.assert_allclose(found.A.toarray(), body.M.toarray()[np.ix_(to, to)], rtol=1e-9, atol=1e-12)
    mapping = Path("mass.mapping")
    mapping.write_text(mapping.read_text().replace(f"{body.dofs.node[0]:14d}    UX", f"{999:14d}    UX"))
    with pytest.raises(ReadError, match=r"1 dofs that the dof list lacks, the first is 999\.1"):
        read_matrix(Path("mass.txt"), dofs=Path("stiff.mapping"))


def test_a_part_runs_as_hbmat_wrote_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Matrices with a mapping file beside each, in an order of their own, and nodes that *VWRITE lists."""
    body = block("part", (0.9, 0.3, 0.2), (3, 2, 1))
    assert body.nodes is not None
    monkeypatch.chdir(tmp_path)
    order = np.random.default_rng(2).permutation(body.n)
    for name, A in (("stiff", body.K), ("mass", body.M)):
        hbmat(name, A, body, order)
    nodes = [f"{k:20d}{x:20.8E}{y:20.8E}{z:20.8E}" for k, (x, y, z) in zip(body.nodes.id, body.nodes.xyz, strict=True)]
    Path("Node.txt").write_text("\n".join(nodes) + "\n")
    run("new", "part", "stiff.txt", "mass.txt", "stiff.mapping", "mass.mapping", "Node.txt")
    run("run", "part.yaml", "--quiet", "--set", "verify={}")
    found = json.loads(Path("build/part/summary.json").read_text())
    exact = np.sqrt(la.eigh(body.K.toarray(), body.M.toarray(), eigvals_only=True)[6:9]) / 2 / np.pi
    np.testing.assert_allclose(found["components"]["part"]["frequencies_hz"][:3], exact, rtol=1e-9)


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (["1 7 UX", "2 7 UY"], r"has no line for 1 of 3 rows, the first is row 3; .* `rows:` as node\.component"),
        (["1 7 UX", "2 7 UY", "3 7 TEMP"], "line 4: row 3 is TEMP of node 7; only displacements"),
        (["1 7 UX", "2 7 UY", "4 7 UZ"], "line 4: names row 4, and the matrix has 3"),
        (["1 7 UX", "2 7 UY", "3 7"], "line 4: '3 7' is no row of a matrix"),
        (["1 7 UX", "2 7 UY", "3 7 UY"], r"map\.mapping: .*7\.2"),
    ],
)
def test_mapping_files_that_do_not_fit(tmp_path: Path, lines: list[str], message: str) -> None:
    path, matrix = tmp_path / "map.mapping", tmp_path / "K.txt"
    path.write_text("\n".join(["Matrix Eqn Node DOF", *lines]))
    harwell_boeing(matrix, sp.csc_array(np.eye(3)))
    with pytest.raises(ReadError, match=message):
        read_matrix(matrix, dofs=path)


@pytest.mark.skipif(not CLONE, reason="EXUDYN_CLONE names no clone of jgerstmayr/EXUDYN")
def test_the_rotor_of_exudyn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """ANSYS 345 dofs with lumped mass; 104.637 Hz is what Exudyn's own tests expect."""
    monkeypatch.chdir(tmp_path)
    for name in ROTOR:
        of = f"HEAD:main/pythonDev/TestModels/testData/rotorAnsys{name}.txt"
        shown = subprocess.run(["git", "-C", CLONE, "show", of], capture_output=True, check=True)
        Path(f"rotorAnsys{name}.txt").write_bytes(shown.stdout)
    draft = draft_body("rotor", [Path(f"rotorAnsys{name}.txt") for name in ROTOR])
    assert draft.remark == "" and draft.elastic_hz == pytest.approx(104.63701055079783, rel=1e-10)
    stiffness, mass = (MatrixSource(path, matrix or None) for path, matrix in (draft.stiffness, draft.mass))
    body = read_body("rotor", stiffness=stiffness, mass=mass, geometry=draft.geometry, rows=draft.rows)
    found = np.sqrt(la.eigh(body.K.toarray(), body.M.toarray(), eigvals_only=True)[6:9]) / 2 / np.pi
    np.testing.assert_allclose(found, [104.63701055079783, 104.637010550788, 187.824], rtol=3e-6)


@pytest.mark.parametrize("shift", [(7, 8), (1, 24)])
def test_exchanged_nodes_of_a_mapping_are_found(tmp_path: Path, shift: tuple[int, int]) -> None:
    """Entries that were left out do not excuse a wrong order."""
    exported(tmp_path)
    mapping = tmp_path / "partMapping.mtx"
    head, *ids = mapping.read_text().rsplit("\n", 25)
    first, second = (ids.index(str(node)) for node in shift)
    ids[first], ids[second] = ids[second], ids[first]
    mapping.write_text("\n".join([head, *ids]))
    with pytest.raises(DofMapError, match="row order of the stiffness matrix"):
        read_body(
            "part",
            stiffness=MatrixSource(tmp_path / "partStiffness.mtx"),
            mass=MatrixSource(tmp_path / "partMass.mtx"),
            rows=mapping,
            geometry=tmp_path / "partNodes.txt",
        )


@pytest.mark.parametrize(("spring", "found"), [(1e-14, False), (1e-8, True)])
def test_a_spring_to_ground_is_no_entry_that_was_left_out(tmp_path: Path, spring: float, found: bool) -> None:
    """A force of rigid motion is excused up to the smallest entries of the file, and no further."""
    exported(tmp_path)
    path = tmp_path / "partStiffness.mtx"
    K = scipy.io.mmread(path, spmatrix=False).tolil()
    K[4, 4] += spring * abs(K).max()
    scipy.io.mmwrite(path, K.tocoo(), precision=16, symmetry="symmetric")
    files = {"stiffness": MatrixSource(path), "mass": MatrixSource(tmp_path / "partMass.mtx")}
    places = {"rows": tmp_path / "partMapping.mtx", "geometry": tmp_path / "partNodes.txt"}
    with pytest.raises(DofMapError, match="rigid motion must cost no force") if found else nullcontext():
        read_body("part", **files, **places)


def test_six_dofs_of_a_node(tmp_path: Path) -> None:
    scipy.io.mmwrite(tmp_path / "K.mtx", sp.eye_array(12, format="coo"))
    scipy.io.mmwrite(tmp_path / "map.mtx", np.array([[7], [3]]))
    found = read_matrix(tmp_path / "K.mtx", dofs=tmp_path / "map.mtx")
    assert found.dofs is not None and found.dofs.labels[:7] == ["7.1", "7.2", "7.3", "7.4", "7.5", "7.6", "3.1"]


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ([[1], [2], [3], [4], [5]], "names 5 nodes for 12 rows.*list of node.component"),
        ([[k] for k in range(1, 13)], "names 12 nodes for 12 rows"),
        ([[3], [3]], "map.mtx: dof 3.1 is in two rows"),
        ([[0], [3]], "positive integers"),
        ([[1, 2]], "not a dof list"),
    ],
)
def test_a_mapping_that_does_not_fit_is_refused(tmp_path: Path, values: list[list[int]], message: str) -> None:
    scipy.io.mmwrite(tmp_path / "K.mtx", sp.eye_array(12, format="coo"))
    scipy.io.mmwrite(tmp_path / "map.mtx", np.array(values))
    with pytest.raises(ReadError, match=message):
        read_matrix(tmp_path / "K.mtx", dofs=tmp_path / "map.mtx")


NLIST = """
 LIST ALL SELECTED NODES.   DSYS=      0

    NODE        X             Y             Z           THXY     THYZ     THZX
        9 -0.42223      0.67650     -0.10342E-15     0.00     0.00     0.00
       32 -0.42223      0.81150     -0.10342E-15     0.00     0.00     0.00

    NODE        X             Y             Z           THXY     THYZ     THZX
      333 -0.42223     -0.67650       0.0000         0.00     0.00     0.00
"""
LISTINGS = {
    "Node Number\tX Location (m)\tY Location (m)\tZ Location (m)\n9\t-0.42223\t0.6765\t0.\n32\t1\t2\t-3.e-002\n": (
        [9, 32],
        [[-0.42223, 0.6765, 0.0], [1, 2, -0.03]],
    ),
    "Knotennummer;X-Position (m);Y-Position (m);Z-Position (m)\n9;-0,42223;0,6765;0,\n": ([9], [[-0.42223, 0.6765, 0]]),
    "node x y z\n9 0,5 0,25 1,0\n": ([9], [[0.5, 0.25, 1]]),
    "id, x, y, z\n9, 0.5, 0.25, 1.0\n4,1,2,3\n": ([9, 4], [[0.5, 0.25, 1], [1, 2, 3]]),
    NLIST: ([9, 32, 333], [[-0.42223, 0.6765, -1.0342e-16], [-0.42223, 0.8115, -1.0342e-16], [-0.42223, -0.6765, 0]]),
}


@pytest.mark.parametrize("text", LISTINGS)
def test_listings(tmp_path: Path, text: str) -> None:
    path = tmp_path / "nodes.txt"
    path.write_text(text)
    ids, xyz = LISTINGS[text]
    nodes = read_geometry(path).nodes
    assert nodes.id.tolist() == ids
    np.testing.assert_array_equal(nodes.xyz, xyz)
    # NLIST prints five digits.
    assert nodes.xyz_rounding == (pytest.approx(5e-6) if text == NLIST else 0.0)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("0.00     0.00     0.00\n\n", "30.00     0.00     0.00\n\n", "line 6: .* node 32 are along turned axes"),
        ("0.67650", "0.6x650", "line 9: .* is no node"),
        ("       32", "        9", "node 9 is defined twice"),
        (
            "\n    NODE        X             Y             Z           THXY     THYZ     THZX\n      333",
            "PAGE 2\n333",
            "PAGE",
        ),
    ],
)
def test_damaged_listings_are_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = tmp_path / "nodes.txt"
    path.write_text(new.join(NLIST.rsplit(old, 1)))
    with pytest.raises(ReadError, match=message):
        read_geometry(path)
