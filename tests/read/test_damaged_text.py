"""Damaged texts that took no end, or ended the program: blanks, digits, widths, ratios and places that none has."""

import sys
import time
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp
from pyyeti.nastran import op4

from cmsreduce.config.keys.mapping import parse_point
from cmsreduce.errors import ReadError
from cmsreduce.pipeline import inspected
from cmsreduce.read import deck_statement, file_kind, read_cells, read_geometry, read_matrix

SECONDS = 2.0
"""Of a processor; each of these took more than ten, most of them hours."""


@pytest.mark.parametrize(
    "text",
    [
        "\n" * 4096 + "no format",
        " \n" * 40_000,
        "part" + "\n" * 4000,
        "-1" + "\n" * 50_000,
        "    -1\n   151\n" + "\n" * 300_000,
        "1" * 200_000,
        "*NODE\n" + "*" * 300_000,
    ],
    ids=lambda text: repr(text[:12]),
)
def test_a_file_of_blanks_or_digits_is_told_at_once(tmp_path: Path, text: str) -> None:
    path = tmp_path / "file"
    path.write_text(text)
    start = time.process_time()
    file_kind(path)
    read_length = [format.length for format in sys.modules["cmsreduce.read.file_kind"].GEOMETRY_FORMATS.values()]
    for length in read_length:
        if length is not None:
            length(text)
    assert time.process_time() - start < SECONDS


def harwell(path: Path) -> str:
    scipy.io.hb_write(path, sp.csc_array(np.diag(np.arange(1.0, 9.0))))
    return path.read_text()


@pytest.mark.parametrize("number", ["\u00b2", "9" * 5000, "99999999999999999999"])
def test_numbers_that_are_none_in_counts_and_indices(tmp_path: Path, number: str) -> None:
    path = tmp_path / "K.hb"
    lines = harwell(path).split("\n")
    for at in (1, 2, 5):
        words = lines[at].split()
        changed = [*lines[:at], lines[at].replace(words[1], number, 1), *lines[at + 1 :]]
        path.write_text("\n".join(changed), encoding="latin-1")
        with pytest.raises(ReadError):
            read_matrix(path, format="harwell-boeing")
    market = tmp_path / "K.mtx"
    market.write_text(f"%%MatrixMarket matrix coordinate real general\n{number} 2 1\n1 1 1.0\n", encoding="latin-1")
    with pytest.raises(ReadError, match="header"):
        read_matrix(market)
    market.write_text("%%\nMatrixMarket\n1 1 1\n1 1 1.0\n")
    with pytest.raises(ReadError, match="header"):
        read_matrix(market)


@pytest.mark.parametrize("format", ["(9999999999I8)", "(8I0)", "(0I8)"])
def test_widths_that_no_line_has(tmp_path: Path, format: str) -> None:
    path = tmp_path / "K.hb"
    lines = harwell(path).split("\n")
    lines[3] = format.ljust(16) + lines[3][16:]
    # A pointer less, so that numbers are sought by their fields.
    lines[4] = lines[4][8:]
    path.write_text("\n".join(lines))
    with pytest.raises(ReadError, match="header is damaged"):
        read_matrix(path, format="harwell-boeing")


@pytest.mark.parametrize("format", ["0E23.16", "3E0.16", "9999999999E23.16", "3E" + "9" * 5000 + ".16"])
def test_formats_of_printed_op4_that_no_line_has(tmp_path: Path, format: str) -> None:
    path = tmp_path / "K.op4"
    op4.save(str(path), {"KAA": np.eye(3)}, binary=False)
    text = path.read_text()
    assert "3E23.16" in text
    path.write_text(text.replace("3E23.16", format))
    with pytest.raises(ReadError):
        read_matrix(path, format="op4")


@pytest.mark.parametrize(("above", "step"), [("7" * 5000, "1"), ("1", "7" * 5000), ("+-1", "1")])
def test_steps_of_numbers_that_are_too_long(tmp_path: Path, above: str, step: str) -> None:
    path = tmp_path / "deck.bdf"
    path.write_text(f"GRID,1,,{above},0.,0.\nGRID,*1,=,*{step},0.,0.\n")
    with pytest.raises(ReadError, match=r"line [12]"):
        read_geometry(path)


def test_an_include_whose_quote_is_lost_ends_near_it(tmp_path: Path) -> None:
    path = tmp_path / "deck.bdf"
    path.write_text("GRID,1,,0.,0.,0.\nINCLUDE 'more.bdf\n" + "GRID,2,,1.,0.,0.\n" * 100_000)
    start = time.process_time()
    with pytest.raises(ReadError, match=r"line 2: INCLUDE has no closing quote"):
        read_geometry(path)
    assert time.process_time() - start < SECONDS


def test_a_point_has_no_node_of_thousands_of_digits() -> None:
    assert parse_point("beam.000000000000041").name == "000000000000041"
    with pytest.raises(ValueError, match="no point"):
        parse_point(f"beam.{'7' * 5000}")


CUBE = "*NODE\n1,0,0,0\n2,1,0,0\n3,1,1,0\n4,0,1,0\n5,0,0,1\n6,1,0,1\n7,1,1,1\n8,0,1,1\n"
CUBE += "*ELEMENT, TYPE=C3D8, ELSET=E\n1,1,2,3,4,5,6,7,8\n*MATERIAL, NAME=M\n*ELASTIC\n{}\n*DENSITY\n1.\n"
CUBE += "*SOLID SECTION, ELSET=E, MATERIAL=M\n"
HEXA = "".join(
    f"GRID,{k + 1},,{x}.,{y}.,{z}.\n"
    for k, (x, y, z) in enumerate(
        [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    )
)
HEXA += "CHEXA,1,1,1,2,3,4,5,6\n,7,8\nPSOLID,1,1\nMAT1,1,{},,{},1.\n"


@pytest.mark.parametrize(("E", "nu"), [("2.", ".5"), ("2.", "-1."), ("2.", ".3"), ("2.E400", ".3"), ("1.E308", ".3")])
def test_solids_that_cannot_be_compressed_have_no_energy(tmp_path: Path, E: str, nu: str) -> None:
    for name, text in (("cube.inp", CUBE.format(f"{E}, {nu}")), ("cube.bdf", HEXA.format(E, nu))):
        path = tmp_path / name
        path.write_text(text)
        nodes = read_geometry(path).nodes
        with np.errstate(all="raise"):
            mass, energy = deck_statement(path, nodes, np.ones(8, dtype=bool))
        assert mass is None or mass.mass == pytest.approx(1.0), name
        assert (energy is not None) == (E == "2." and nu == ".3"), name


SHELL = "*NODE\n1,0,0,0\n2,1,0,0\n3,{},1,0\n4,0,{},0\n5,2,0,0\n*ELEMENT, TYPE=S4, ELSET=P\n1,1,2,3,4\n"
SHELL += "*ELEMENT, TYPE=B31, ELSET=B\n2,2,5\n*SHELL SECTION, ELSET=P, MATERIAL=M\n.01\n"
SHELL += "*BEAM SECTION, ELSET=B, MATERIAL=M, SECTION=RECT\n.1, .2\n{}\n"
EXPANSION = """ELEMENT          1 with label "S4      " and with nodes:
 1 2 3 4
is expanded into a "C3D8I   " element with topology:
 6 9 12 15 8 11 14 17

ELEMENT          2 with label "B31     " and with nodes:
 2 5
is expanded into a "C3D8I   " element with topology:
 18 26 27 19 21 29 30 22

"""


def test_shells_and_beams_without_axes_are_named(tmp_path: Path) -> None:
    path = tmp_path / "shell.inp"
    (tmp_path / "shell.12d").write_text(EXPANSION)
    path.write_text(SHELL.format(1, 1, "0,1,0"))
    assert len(read_geometry(path).nodes) > 5 and read_cells(path)
    for values, number in (((0, 0, "0,1,0"), 1), ((1, 1, "1,0,0"), 2)):
        path.write_text(SHELL.format(*values))
        with pytest.raises(ReadError, match=f"element {number}: no axes of its section"):
            read_geometry(path)


FEM = """** RECORD GROUP 1, HEADER
REV0 1 1 0 0 0
** RECORD GROUP 2, FINITE ELEMENT NODE LIST
1
** RECORD GROUP 3, INITIAL MODAL DISPLACEMENTS
0
** RECORD GROUP 4, INITIAL MODAL VELOCITIES
0
** RECORD GROUP 5, NODAL X COORDINATES
0.
** RECORD GROUP 6, NODAL Y COORDINATES
0.
** RECORD GROUP 7, NODAL Z COORDINATES
0.
** RECORD GROUP 8, MODE SHAPES
1. 0. 0. 0. 0. 0.
** RECORD GROUP 9, MODAL MASS MATRIX
{}
** RECORD GROUP 10, MODAL STIFFNESS MATRIX
4.
** RECORD GROUP 12, RIGID BODY INERTIA
1. 0. 0. 0. 1. 0. 0. 0. 1. 0. 0. 0. 1.
"""


def test_a_modal_body_of_no_mass_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "body.fem"
    path.write_text(FEM.format("1."))
    assert inspected(path)
    for mass, said in (("-1.", "not positive definite"), ("1.E400", "not finite")):
        path.write_text(FEM.format(mass))
        with pytest.raises(ReadError, match=said):
            inspected(path)
