"""Text of one entry a line: CalculiX, Abaqus."""

import re
from pathlib import Path

import numpy as np
import pytest

from cmsreduce.errors import ReadError
from cmsreduce.read import detect_format, file_kind, matrix_names, read_matrix, read_rows

K = np.array([[3.0, -1.0 / 3.0, 0.0], [-1.0 / 3.0, 2.0e7, -1.0], [0.0, -1.0, 1.0]])
MIXED = np.triu(K) + np.array([[0, -1, 0], [1, 0, 0], [0, 0, 0]]) * K[0, 1]
SKEW = np.array([[1.0, 2.0], [-2.0, 1.0]])


def lines(A: np.ndarray, pattern: str = "{i} {j}  {v:.13e}") -> str:
    return "".join(pattern.format(i=i + 1, j=j + 1, v=A[i, j]) + "\n" for i, j in zip(*np.nonzero(A), strict=True))


@pytest.mark.parametrize(
    ("text", "expected", "format", "rounding"),
    [
        (lines(np.triu(K)), K, "calculix", 5e-15),
        (lines(np.tril(K)), K, "abaqus", 5e-15),
        (lines(K, "{i} {j}  {v:.15e}"), K, "abaqus", 2.0**-53),
        (lines(SKEW, "{i} {j}  {v:.15e}"), SKEW, "abaqus", 2.0**-53),
        (lines(np.diag([2.0, 5.0]), "{i} {j} {v:g}"), np.diag([2.0, 5.0]), "calculix", 2.0**-53),
        (lines(K, "{i},{j}, {v:.6f}"), np.round(K, 6), "abaqus", 5e-15),
        (lines(np.triu(K)).replace("e", "D"), K, "calculix", 5e-15),
        (lines(np.triu(K)).replace("e+0", "+0").replace("e-0", "-0"), K, "calculix", 5e-15),
        ("# stiffness\n\n" + lines(np.triu(K)).replace("\n", "\r\n"), K, "calculix", 5e-15),
        ("\ufeff" + lines(np.triu(K)), K, "calculix", 5e-15),
    ],
    ids=["upper", "lower", "full", "unsymmetric", "diagonal", "fixed", "D", "bare", "comment", "mark"],
)
def test_triangles_and_ways_to_print(
    tmp_path: Path, text: str, expected: np.ndarray, format: str, rounding: float
) -> None:
    path = tmp_path / "body.txt"
    path.write_bytes(text.encode())
    found = read_matrix(path)
    assert (found.format, found.name, found.dofs) == (format, "body", None)
    assert found.rounding == pytest.approx(rounding)
    assert abs(found.A - expected).max() <= 10 * rounding * abs(expected).max()
    assert matrix_names(path)[0].nnz == np.count_nonzero(expected)


@pytest.mark.parametrize(
    ("head", "pattern", "part", "expected"),
    [
        ("", "{i},1, {j},1, {v:.15e}", K, K),
        ("** Abaqus\n*MATRIX INPUT, NAME=K\n", "{i},1, {j},1, {v:.15e}", np.tril(K), K),
        # A triangle in an order of the program that is not that of the labels.
        ("", "{i},1, {j},1, {v:.15e}", MIXED, K),
        ("*MATRIX INPUT, NAME=K, TYPE=UNSYMMETRIC\n", "{i},1, {j},1, {v:.15e}", MIXED, MIXED),
        ("*MATRIX INPUT, NAME=K, TYPE=UNSYMMETRIC\n", "{i},1, {j},1, {v:.15e}", np.tril(K), np.tril(K)),
        (" *matrix input, name=K, type=unsymmetric\n", "{i},1, {j},1, {v:.15e}", np.tril(K), np.tril(K)),
        ("*MATRIX INPUT, NAME=K,\n  TYPE=UNSYMMETRIC\n", "{i},1, {j},1, {v:.15e}", np.tril(K), np.tril(K)),
        ("*MATRIX INPUT,\n NAME=K,\n TYPE=UNSYMMETRIC\n", "{i},1, {j},1, {v:.15e}", np.tril(K), np.tril(K)),
        ("*MATRIX INPUT, NAME=K,\r\nTYPE=UNSYMMETRIC,\r\n", "{i},1, {j},1, {v:.15e}", np.tril(K), np.tril(K)),
        ("*MATRIX INPUT, NAME=K, SCALE FACTOR=2.5D0\n", "{i},1, {j},1, {v:.15e}", np.tril(K), 2.5 * K),
        ("", "PART-1-1.{i},1, PART-1-1.{j},1, {v:.15e}", K, K),
        ("** Abaqus\n", "\t{i} ,1 {j} 1  {v:.15e}", K, K),
    ],
    ids=[
        "labels",
        "triangle",
        "mixed",
        "mixed unsymmetric",
        "unsymmetric",
        "small letters",
        "two lines",
        "three lines",
        "Windows",
        "factor",
        "instance",
        "blanks",
    ],
)
def test_abaqus_with_labels(tmp_path: Path, head: str, pattern: str, part: np.ndarray, expected: np.ndarray) -> None:
    path = tmp_path / "body.mtx"
    # Nodes 1 and 2 trade places with 30 and 20, so that the order of the file is not that of the nodes.
    text = re.sub(r"\b([12])( ?,| )1\b", lambda at: ("30", "20")[int(at[1]) - 1] + at[2] + at[1], lines(part, pattern))
    path.write_text(head + text)
    found = read_matrix(path)
    assert found.format == "abaqus"
    assert found.dofs is not None
    assert found.dofs.labels == ["3.1", "20.2", "30.1"]
    assert np.array_equal(found.A.toarray(), expected[::-1, ::-1])


def test_dof_list_beside_gives_labels_and_size(tmp_path: Path) -> None:
    path = tmp_path / "body.mtx"
    path.write_text(lines(K, "{i} {j}  {v:.15e}"))
    (tmp_path / "body.dof").write_text("7.1\n7.2\n9.1\n9.2\n")
    found = read_matrix(path)
    assert found.dofs is not None
    assert found.dofs.labels == ["7.1", "7.2", "9.1", "9.2"]
    assert found.A.shape == (4, 4)
    assert np.array_equal(found.A.toarray()[:3, :3], K)
    elsewhere = tmp_path / "other.txt"
    elsewhere.write_text("1,1\n1 2\n1.3\n")
    given = read_matrix(path, dofs=elsewhere)
    assert given.dofs is not None
    assert given.dofs.labels == ["1.1", "1.2", "1.3"]


@pytest.mark.parametrize("names", ["UX ROTZ", "Dx drz", "U1 UR3", "x rz", "TX RZ", "01 06"])
@pytest.mark.parametrize("pattern", ["{n} {c}", "N{n}\t{c}", "{n}, {c}", "{n}.{c}"])
def test_dof_list_of_names(tmp_path: Path, names: str, pattern: str) -> None:
    path = tmp_path / "rows.txt"
    path.write_text("# rows\n" + "\n".join(pattern.format(n=12, c=name) for name in names.split()) + "\n\x1a")
    assert read_rows(path).labels == ["12.1", "12.6"]
    assert file_kind(path).name == "dofs"


@pytest.mark.parametrize("text", ["0.1\n0.2\n1.1\n", "0,DX\n0,DY\n1,DX\n"])
def test_a_list_of_nodes_that_count_from_0_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "rows.txt").write_text(text)
    with pytest.raises(ReadError, match="there is a node 0, and nodes count from 1"):
        read_rows(tmp_path / "rows.txt")


def test_labels_of_two_instances_are_refused(tmp_path: Path) -> None:
    (tmp_path / "body.mtx").write_text("A-1.1,1, A-1.1,1, 2.0\nB-1.1,1, B-1.1,1, 3.0\n")
    with pytest.raises(ReadError, match="instances A-1 and B-1 share the numbers of their nodes"):
        read_matrix(tmp_path / "body.mtx")


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_dof_list_of_a_windows_program(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "body.sti"
    path.write_text(lines(np.triu(K)))
    (tmp_path / "body.dof").write_bytes("7.1\r\n7.2\r\n9.1\r\n".encode(encoding))
    found = read_matrix(path).dofs
    assert found is not None and found.labels == ["7.1", "7.2", "9.1"]


def test_dof_list_that_does_not_fit(tmp_path: Path) -> None:
    path = tmp_path / "body.sti"
    path.write_text(lines(np.triu(K)))
    (tmp_path / "body.dof").write_text("7.1\n7.2\n9.1\n9.2\n")
    with pytest.raises(ReadError, match=r"stop at row 3, but the dof list .* has 4 dofs; the matrix is truncated"):
        read_matrix(path)
    (tmp_path / "body.dof").write_text("7.1\n7.2\n")
    with pytest.raises(ReadError, match=r"is 3 x 3, but the dof list .* has 2 dofs"):
        read_matrix(path)
    path.write_text(lines(np.triu(np.kron(np.eye(2), K[:2, :2]))))
    with pytest.raises(ReadError, match=r"two rows for each of the 2 dofs .*CYCLIC SYMMETRY MODEL; mesh the whole"):
        read_matrix(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 1 2.0\n1 2 x\n2 2 1.0\n", "line 2: '1 2 x' is not an entry 'i j value'"),
        ("1 1 2.0\n\n1 2\n2 2 1.0\n", "line 3: '1 2' is not"),
        ("1 1 2.0\n1 2 3.0 4.0\n", "line 2"),
        ("1 1 2.0\n1.5 2 3.0\n", r"line 2: '1\.5 2 3\.0'"),
        ("1 1 2.0\n2 2 3.0\n2 2", "line 3 .the last of the file, so it is probably truncated"),
        ("1 1 2.0000000e+00\n2 2 3.0000000e+00\n3 3 4.00000", r"ends inside its last number, '4\.00000'"),
        ("1 1 2.0\n0 1 1.0\n", "row 0, column 1, but indices count from 1"),
        ("1 1 2.0\n-3 1 1.0\n", "row -3, column 1; Abaqus gives such numbers"),
        ("1 1 2.0\n1 2 1.0\n1 2 4.0\n", "row 1, column 2 appears 2 times"),
        ("3 3 4\n1 1 2.0\n1 2 1.0\n2 2 4.0\n3 3 1.0\n", "first line, '3 3 4', states rows, columns and entries"),
        ("-1,1, 5,1, 2.0\n5,1, 5,1, 3.0\n", "node -1 is one that Abaqus made for itself"),
        ("0,1, 0,1, 2.0\n1,1, 0,1, 3.0\n", "there is a node 0, and nodes count from 1"),
        ("1 1 2.0\n1 900000000000 1.0\n", "claims 900000000000 x 900000000000 in a file of"),
        ("1,1, 1,1, 2.0\n1,1, 5,11, 3.0\n", "dof 11 of node 5 is no displacement"),
        ("1,1, 1,1, 2.0\n1,1, 1,1, 3.0\n", r"row 1\.1, column 1\.1 appears 2 times"),
        ("1,1, 1,1, 2.0\n1,1, 1,1\n", "line 2 .*'1,1, 1,1' is not an entry 'node,dof, node,dof, value'|line 2"),
        ("*MATRIX INPUT, NAME=K\n1,1, 1,1, 2.0\n*MATRIX INPUT, NAME=M\n1,1, 1,1, 2.0\n", "several .MATRIX INPUT"),
    ],
)
def test_what_does_not_parse_is_named(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "body.mtx"
    path.write_text(text)
    with pytest.raises(ReadError, match=message):
        read_matrix(path)


def test_only_comments(tmp_path: Path) -> None:
    path = tmp_path / "body.mtx"
    path.write_text("** nothing\n")
    with pytest.raises(ReadError, match="there are no entries"):
        read_matrix(path, format="abaqus")


@pytest.mark.parametrize("mark", ["nan", "inf", "-Infinity", "NaN"])
def test_infinite_entries_are_left_for_the_body_to_refuse(tmp_path: Path, mark: str) -> None:
    path = tmp_path / "body.txt"
    path.write_text(f"1 1 1.0\n2 2 {mark}\n")
    assert not np.isfinite(read_matrix(path).A[1, 1])


def test_half_a_million_entries_in_seconds(tmp_path: Path) -> None:
    n = 100_000
    at = np.arange(1, n)
    path = tmp_path / "big.sti"
    with path.open("w") as file:
        file.writelines(f"{k} {k}  2.0000000000000e+00\n{k} {k + 1} -1.0000000000000e+00\n" for k in at)
        file.write(f"{n} {n}  2.0000000000000e+00\n")
    found = read_matrix(path).A
    assert found.shape == (n, n)
    assert found.nnz == 3 * n - 2
    assert np.array_equal(found @ np.ones(n), np.r_[1.0, np.zeros(n - 2), 1.0])


@pytest.mark.shared
@pytest.mark.parametrize("name", ["calculix.sti", "calculix.mas"])
def test_calculix_body(shared_data: Path, name: str) -> None:
    found = read_matrix(shared_data / "calculix_body" / name)
    assert found.format == "calculix"
    assert found.A.shape == (783, 783)
    assert found.dofs is not None
    assert found.dofs.labels[:4] == ["1.1", "1.2", "1.3", "2.1"]
    assert found.rounding == pytest.approx(5e-15)
    if name.endswith("mas"):
        import h5py

        with h5py.File(shared_data / "calculix_body" / "input_data.h5") as file:
            mass = file["mass"][()]
        for component in (1, 2, 3):
            along = (found.dofs.component == component).astype(float)
            assert along @ found.A @ along == pytest.approx(mass, rel=1e-12)


@pytest.mark.shared
def test_abaqus_body(shared_data: Path) -> None:
    folder = shared_data / "abaqus_c3d10"
    k, m = (read_matrix(folder / f"blockC3D10_{name}1.mtx") for name in ("STIF", "MASS"))
    assert detect_format(folder / "blockC3D10_STIF1.mtx") == "abaqus"
    assert k.A.shape == m.A.shape == (771, 771)
    values = np.linalg.eigvalsh(k.A.toarray())
    assert (abs(values) < 1e-9 * values[-1]).sum() == 6
    text = (folder / "blockC3D10.inp").read_text()
    nodes = text.split("*Node", 1)[1].split("*Element", 1)[0].splitlines()[1:]
    size = np.ptp([list(map(float, line.split(",")[1:4])) for line in nodes], axis=0)
    along = np.zeros(771)
    along[::3] = 1.0
    assert along @ m.A @ along == pytest.approx(2900.0 * size.prod(), rel=1e-9)
