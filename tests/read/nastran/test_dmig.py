"""DMIG entries: every width of field, both forms, and the faults of punch files."""

import re
from io import StringIO
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import scipy.linalg
import scipy.sparse as sp
from pyyeti import nastran

from cmsreduce.errors import ReadError
from cmsreduce.read import matrix_names, read_matrix

# Springs 2 and 3 N/m between nodes 1, 2 and a scalar point 7; the row of node 2, dof 1 holds a coupling only.
DOFS = ["1.1", "1.5", "2.1", "7.0"]
K = np.array([[2.0, 0.0, -2.0, 0.0], [0.0, 0.125, 0.0, 0.0], [-2.0, 0.0, 5.0, -3.0], [0.0, 0.0, -3.0, 3.0]])

SMALL = """\
$ punched by hand
DMIG    K       0       6       2       0                       4
DMIG    K       1       1               1       1       2.
        2       1       -2.
DMIG    K       1       5               1       5       1.25-1
DMIG    K       2       1               2       1       5.0             +A
$ a comment within a card
+A      7               -3.0
DMIG    K       7       0               7       0       3.+0
"""
FREE = """\
DMIG,K,0,6,2,0,,,4
DMIG,K,1,1,,1,1,2.0
,2,1,-2.0
DMIG,K,1,5,,1,5,.125
DMIG,K,2,1,,2,1,5.0,,+
+,7,0,-3.0
DMIG,K,7,0,,7,0,3.0
"""


def wide(entries: dict[tuple[str, str], float], form: int, kind: int = 2, name: str = "K") -> str:
    """A punch file of fields of 16 characters with ten digits, as NASTRAN writes it."""
    lines = [f"DMIG    {name:8}{0:8}{form:8}{kind:8}{0:8}{'':16}{4:8}"]
    column = ""
    for (row, col), value in entries.items():
        if col != column:
            node, component = col.split(".")
            lines.append(f"DMIG*   {name:8}{node:>24}{component:>16}")
            column = col
        node, component = row.split(".")
        lines.append(f"*       {node:>16}{component:>16}{f'{value:16.9E}'.replace('E', 'D')}")
    return "\n".join(lines) + "\n"


def one_a_line(entries: dict[tuple[str, str], float], form: int) -> str:
    """Free fields with one entry on each line, which leaves the second half of a line blank."""
    lines, column = [f"DMIG,K,0,{form},2,0,,,4"], ""
    for (row, col), value in entries.items():
        start = "+" if col == column else f"DMIG,K,{col.replace('.', ',')},"
        lines.append(f"{start},{row.replace('.', ',')},{value}")
        column = col
    return "\n".join(lines) + "\n"


def with_imaginary(text: str, value: float) -> str:
    """Entries with a fourth number."""
    return re.sub(r"(D[+-]\d\d)\n", lambda found: f"{found[1]}{f'{value:16.9E}'.replace('E', 'D')}\n", text)


LOWER = {(DOFS[i], DOFS[j]): K[i, j] for j in range(4) for i in range(j, 4) if K[i, j]}
UPPER = {(DOFS[i], DOFS[j]): K[i, j] for j in range(4) for i in range(j + 1) if K[i, j]}
FULL = {(DOFS[i], DOFS[j]): K[i, j] for j in range(4) for i in range(4) if K[i, j]}


@pytest.mark.parametrize(
    ("text", "rounding"),
    [
        (SMALL, 2.0**-53),
        (FREE, 2.0**-53),
        (wide(LOWER, 6), 5e-11),
        (wide(UPPER, 6), 5e-11),
        (wide(FULL, 1), 5e-11),
        (wide(FULL, 6), 5e-11),
        (wide(LOWER, 6, kind=1), 2.0**-24),
        (wide(LOWER, 6, kind=4), 5e-11),
        (with_imaginary(wide(LOWER, 6, kind=3), -0.0), 2.0**-24),
        (FREE.replace("0,6,2", "0,6,4"), 2.0**-53),
        (one_a_line(FULL, 6), 2.0**-53),
        (one_a_line(FULL, 1).replace("2.0\n", "2.0,0.0\n"), 2.0**-53),
        (wide(LOWER, 6).lower(), 5e-11),
        (wide(LOWER, 6).replace("\n", "\r\n"), 5e-11),
    ],
    ids=[
        "small",
        "free",
        "lower",
        "upper",
        "square",
        "both",
        "single",
        "complex",
        "zeros",
        "free-complex",
        "one-a-line",
        "one-a-line-square",
        "lower-case",
        "dos",
    ],
)
def test_widths_and_forms(tmp_path: Path, text: str, rounding: float) -> None:
    path = tmp_path / "k.pch"
    path.write_bytes(text.encode())
    found = read_matrix(path, "k")
    assert found.format == "dmig"
    assert found.name == "K"
    assert found.dofs is not None
    assert found.dofs.labels == DOFS
    assert np.array_equal(found.A.toarray(), K)
    assert found.rounding == pytest.approx(rounding)


def test_narrow_fields_are_as_rough_as_the_shortest_number_that_fills_one(tmp_path: Path) -> None:
    path = tmp_path / "k.pch"
    # 1.2345+3 has five digits in its eight characters; -2.3-1 left room, so it is what was meant.
    path.write_text(SMALL.replace("5.0     ", "123456.7").replace("1.25-1", "1.2345+3").replace("-2.\n", "-2.3-1\n"))
    assert read_matrix(path).rounding == pytest.approx(5e-6)


def test_as_pyyeti_writes_and_reads_it(tmp_path: Path) -> None:
    index = pd.MultiIndex.from_tuples([tuple(map(int, label.split("."))) for label in DOFS], names=["id", "dof"])
    rng = np.random.default_rng(3)
    general, symmetric = rng.normal(size=(4, 4)), K + 1.0
    with StringIO() as file:
        nastran.wtdmig(file, {name: pd.DataFrame(A, index, index) for name, A in (("g", general), ("s", symmetric))})
        text = file.getvalue()
        expected = nastran.rddmig(file)
    path = tmp_path / "k.pch"
    path.write_text(text)
    for name in ("g", "s"):
        assert np.array_equal(read_matrix(path, name).A.toarray(), expected[name].to_numpy())


def test_rows_that_only_columns_name_are_kept(tmp_path: Path) -> None:
    path = tmp_path / "k.pch"
    path.write_text(wide({("1.1", "1.1"): 2.0, ("1.1", "9.3"): 0.0, ("4.2", "1.1"): 0.0}, 6))
    found = read_matrix(path)
    assert found.dofs is not None
    assert found.dofs.labels == ["1.1", "4.2", "9.3"]
    assert found.A.nnz == 1


def test_rectangular_is_refused_unless_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "k.pch"
    path.write_text(wide({("1.1", "5.3"): 2.0, ("1.2", "5.3"): 3.0}, 2) + wide({("1.1", "1.0"): 4.0}, 9, name="V"))
    with pytest.raises(ReadError, match="'K' is rectangular"):
        read_matrix(path, "K")
    found = read_matrix(path, "K", rectangular=True)
    assert found.dofs is not None
    assert found.column_dofs is not None
    assert (found.dofs.labels, found.column_dofs.labels) == (["1.1", "1.2"], ["5.3"])
    assert found.A.toarray().tolist() == [[2.0], [3.0]]
    assert read_matrix(path, "V", rectangular=True).column_dofs is None


def test_sizes_of_all_matrices_are_listed(tmp_path: Path) -> None:
    path = tmp_path / "k.pch"
    path.write_text(wide(LOWER, 6) + wide({("1.1", "5.3"): 2.0, ("1.2", "5.3"): 3.0}, 2, 4, "V"))
    assert [(one.name, one.rows, one.cols, one.numbers, one.form) for one in matrix_names(path)] == [
        ("K", 4, 4, "real double", "symmetric"),
        ("V", 2, 1, "complex double", "rectangular"),
    ]


def test_an_imaginary_part_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "k.pch"
    text = with_imaginary(wide(LOWER, 6, kind=4), 0.0)
    path.write_text(text.replace("0.000000000D+00\n", "1.000000000D-30\n", 1))
    with pytest.raises(ReadError, match="'K' is complex"):
        read_matrix(path)
    path.write_text(text.replace("0.000000000D+00\n", "0.0000O0000D+00\n", 1))
    with pytest.raises(ReadError, match=r"line 3: .* needs a number, it has '0\.0000O"):
        read_matrix(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (wide({**LOWER, ("1.1", "2.1"): -2.5}, 6), r"two values at row 2\.1, column 1\.1 \(or across .*: -2 and -2\.5"),
        (wide(FULL, 1) + wide({("1.1", "1.1"): 9.0}, 1), r"two values at row 1\.1, column 1\.1: 2 and 9"),
        (wide(LOWER, 6).replace("5.000000000D+00", "5.0000O0000D+00"), r"line 8: .* needs a number, it has '5\.0000O"),
        (wide(LOWER, 6).replace(" 5.000000000D+00", ""), "needs a number, it has 'a blank'"),
        (wide(LOWER, 6).replace("*                      7", "*                     7x"), "line 9: .* a node id"),
        (FREE.replace("2,1,-2.0", "2305843009213693952,1,-2.0"), "line 3: .* a node id .*'2305843009213693952'"),
        (wide({("1.8", "1.1"): 1.0}, 6), r"component 8 of node 1 is not 0\.\.6"),
        (wide({("1.1", "1.9"): 1.0}, 6), r"component 9 of column 1 of 'K' is not 0\.\.6"),
        ("\n".join(wide(LOWER, 6).splitlines()[1:]) + "\n", "entries before its header"),
        (wide(LOWER, 6) + wide(LOWER, 1), "another header in line 1, with form 6"),
        (wide(LOWER, 5), "form 5 of matrix 'K'"),
        (wide(LOWER, 6, kind=7), "type 7 of matrix 'K'"),
    ],
)
def test_what_does_not_parse_is_named(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "k.pch"
    path.write_text(text)
    with pytest.raises(ReadError, match=message):
        read_matrix(path)


def test_cut_punch_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "k.pch"
    text = wide(LOWER, 6)
    column = text.rindex("DMIG*")
    for cut in [*range(column - 75, column), *range(column + 8, len(text) - 1)]:
        # Two cuts in sixty end a whole line; such a file looks like one that was meant to end there.
        if "\n" in text[cut - 1 : cut + 1] and cut < column:
            continue
        path.write_text(text[:cut])
        with pytest.raises(ReadError, match=r"truncated|needs a|should be an integer"):
            read_matrix(path)


@pytest.mark.parametrize("imaginary", [False, True])
def test_a_last_line_whose_fields_are_full_needs_no_end(tmp_path: Path, imaginary: bool) -> None:
    path = tmp_path / "k.pch"
    text = with_imaginary(wide(LOWER, 6, 4), 0.0) if imaginary else wide(LOWER, 6)
    path.write_text(text.rstrip())
    assert np.array_equal(read_matrix(path).A.toarray(), K)


@pytest.mark.shared
def test_swept_plane(shared_data: Path) -> None:
    path = shared_data / "swept_plane" / "sol103_swept_plane.pch1"
    k, m = read_matrix(path, "kaax"), read_matrix(path, "MAAX")
    assert k.dofs is not None
    assert len(k.dofs) == 45
    assert k.rounding == m.rounding == pytest.approx(5e-11)
    # Four dofs carry no mass and so are not named by the mass matrix.
    assert m.A.shape == (41, 41)
    m = m.on(k.dofs)
    # Massless dofs make infinite eigenvalues: the inverse pencil, shifted off the rigid modes, has zeros there.
    shifted = k.A.toarray() + m.A.toarray()
    inverse = np.sort(scipy.linalg.eigh(m.A.toarray(), shifted, eigvals_only=True))[::-1]
    hertz = np.sqrt(np.maximum(1 / inverse[:10] - 1, 0)) / (2 * np.pi)
    assert hertz[:3] == pytest.approx(0, abs=1e-3)
    f06 = [1.339207, 3.406026, 5.610046, 10.88232, 11.05762, 16.00409, 23.21605]
    assert hertz[3:] == pytest.approx(f06, rel=1e-6)


@pytest.mark.shared
def test_chain15(shared_data: Path) -> None:
    path = shared_data / "chain15" / "dmig.pch"
    k, m = read_matrix(path, "KAAX"), read_matrix(path, "MAAX")
    assert k.A.shape == (15, 15)
    assert m.dofs is not None
    squares = scipy.linalg.eigh(k.A.toarray(), m.A.toarray(), eigvals_only=True)
    assert abs(squares[0]) < 1e-9 * squares[-1]
    assert np.sqrt(squares[1:3]) / (2 * np.pi) == pytest.approx([1.0335, 2.1307], rel=1e-4)
    assert sp.issparse(k.on(m.dofs).A)
