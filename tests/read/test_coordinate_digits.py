"""Zeros at the end of a coordinate are digits, in every format; short numbers of a person are exact."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.errors import DofMapError
from cmsreduce.model import FEModel, Nodes
from cmsreduce.read import MatrixSource, prove_row_order, read_body
from cmsreduce.read.geometry import read_geometry
from cmsreduce.read.printed_numbers import coordinate_rounding, decimals
from tests.solids import block

PLACES = np.array([[x, y, 0.25] for x in (0.0, 0.3, 0.6, 3.0) for y in (0.0, 0.5)])


def wide(number: int, place: np.ndarray) -> str:
    x, y, z = place
    return f"GRID*   {number:16d}{'':16}{x:16.9E}{y:16.9E}\n*       {z:16.9E}\n"


def narrow(number: int, place: np.ndarray) -> str:
    return f"GRID    {number:8d}{'':8}" + "".join(f"{x:8.6f}" for x in place) + "\n"


def typed(number: int, place: np.ndarray) -> str:
    return f"GRID,{number},," + ",".join(f"{x:.4g}" if x % 1 else f"{x:.0f}." for x in place) + "\n"


def deck(line: Callable[[int, np.ndarray], str]) -> Callable[[np.ndarray], str]:
    return lambda places: "".join(["BEGIN BULK\n", *map(line, range(1, len(places) + 1), places), "ENDDATA\n"])


def lines(form: str) -> Callable[[np.ndarray], str]:
    return lambda places: "".join(form.format(k, *place) for k, place in enumerate(places, start=1))


def listing(places: np.ndarray) -> str:
    return "NODE X Y Z\n" + lines("{} {:.7E} {:.7E} {:.7E}\n")(places)


def frd(places: np.ndarray) -> str:
    nodes = "".join(f" -1{k:10d}" + "".join(f"{x:12.5E}" for x in at) + "\n" for k, at in enumerate(places, start=1))
    return f"    1Cbody\n    2C{len(places):30d}{'':37}1\n{nodes} -3\n 9999\n"


def universal(places: np.ndarray) -> str:
    nodes = lines("{:10d}         0         0        11{:13.5E}{:13.5E}{:13.5E}\n")(places)
    return f"    -1\n    15\n{nodes}    -1\n"


FORMATS: dict[str, tuple[str, Callable[[np.ndarray], str], float]] = {
    "wide bulk data": ("body.bdf", deck(wide), 5e-10),
    "narrow bulk data": ("body.bdf", deck(narrow), 5e-7),
    "bulk data typed by hand": ("body.bdf", deck(typed), 0.0),
    "frd": ("body.frd", frd, 5e-6),
    "inp": ("body.inp", lambda at: "*NODE, NSET=NALL\n" + lines("{}, {:.6f}, {:.6f}, {:.6f}\n")(at), 5e-7),
    "inp typed by hand": ("body.inp", lambda at: "*NODE\n" + lines("{}, {:.4g}, {:.4g}, {:.4g}\n")(at), 0.0),
    "listing": ("body.txt", listing, 5e-8),
    "listing with commas": (
        "body.txt",
        lambda at: FORMATS["listing"][1](at).replace(".", ",").replace(" ", "\t"),
        5e-8,
    ),
    "universal": ("body.unv", universal, 5e-6),
}


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_counts_printed_zeros(name: str, tmp_path: Path) -> None:
    file, written, rounding = FORMATS[name]
    if name == "universal":
        pytest.importorskip("pyuff")
    (tmp_path / file).write_text(written(PLACES))
    nodes = read_geometry(tmp_path / file).nodes
    np.testing.assert_allclose(nodes.xyz, PLACES, rtol=1e-12)
    # Bulk data may turn places, so that the errors of all three coordinates count.
    assert 0.999999 * rounding <= nodes.xyz_rounding <= 1.01 * rounding * (3**0.5 if file == "body.bdf" else 1)


def test_digits_of_a_file_that_a_library_reads(tmp_path: Path) -> None:
    path, glued = tmp_path / "sector.cdb", lines("{:9d}        0        0{:20.13E}{:20.13E}{:20.13E}\n")
    path.write_text("NBLOCK,6,SOLID,8,8\n(3i9,6e20.13)\n" + glued(-PLACES))
    assert coordinate_rounding(decimals(path, -PLACES)) == pytest.approx(5e-14)
    path.write_bytes(b"\0" + PLACES.tobytes())
    assert coordinate_rounding(decimals(path, PLACES)) == 0
    assert coordinate_rounding(decimals(path, PLACES / 7)) == pytest.approx(5e-17, rel=10)


def body_near(tmp_path: Path, form: Callable[[np.ndarray], str], off: float) -> FEModel:
    """A bar whose matrices are those of a mesh that is ``off`` from its deck, in files; its rows as written."""
    exact = block("bar", [0.9, 0.2, 0.2], [6, 2, 2])
    assert exact.nodes is not None
    (tmp_path / "bar.bdf").write_text(form(np.round(exact.nodes.xyz, 3)))
    true = block("bar", [0.9 + off, 0.2, 0.2 - off], [6, 2, 2])
    (tmp_path / "rows.txt").write_text("\n".join(true.dofs.labels))
    return true


def read(tmp_path: Path, body: FEModel) -> FEModel:
    sp.save_npz(tmp_path / "K.npz", body.K)
    sp.save_npz(tmp_path / "M.npz", body.M)
    sources = {"stiffness": MatrixSource(tmp_path / "K.npz"), "mass": MatrixSource(tmp_path / "M.npz")}
    return read_body("bar", **sources, geometry=tmp_path / "bar.bdf", rows=tmp_path / "rows.txt")


@pytest.mark.parametrize(("form", "off"), [(wide, 4e-10), (narrow, 4e-7)], ids=["wide", "narrow"])
def test_a_mesh_within_its_digits_is_proven_and_a_shuffled_one_is_not(
    form: Callable[[int, np.ndarray], str], off: float, tmp_path: Path
) -> None:
    body = body_near(tmp_path, deck(form), off)
    proof = prove_row_order(read(tmp_path, body))
    assert proof.status == "proven"
    # Exchange the rows of two neighbours, which the smallest forces betray.
    order = np.arange(body.n)
    order[3:6], order[6:9] = np.arange(6, 9), np.arange(3, 6)
    shuffled = replace(body, K=sp.csc_array(body.K[order][:, order]))
    with pytest.raises(DofMapError, match="not proven"):
        read(tmp_path, shuffled)


def test_a_deck_converted_to_other_units_prints_more_digits_than_it_has(tmp_path: Path) -> None:
    """Places of 12 digits in millimetres, divided by a length in feet: each has the 16 digits of a quotient."""
    foot = 304.8
    inexact = block("bar", [0.9 / foot, 0.2 / foot, 0.2 / foot], [6, 2, 2])
    assert inexact.nodes is not None
    rng = np.random.default_rng(0)
    off = inexact.nodes.xyz * (1 + 1e-11 * rng.uniform(-1, 1, inexact.nodes.xyz.shape))
    form = lambda number, place: f"GRID,{number},," + ",".join(map(repr, place.tolist())) + "\n"  # noqa: E731
    (tmp_path / "bar.bdf").write_text(deck(form)(off))
    (tmp_path / "rows.txt").write_text("\n".join(inexact.dofs.labels))
    found = read(tmp_path, inexact)
    assert isinstance(found.nodes, Nodes) and 1e-15 < found.nodes.xyz_rounding < 1e-9 * 0.9 / foot
    order = np.arange(inexact.n)
    order[3:6], order[6:9] = np.arange(6, 9), np.arange(3, 6)
    with pytest.raises(DofMapError, match="not proven"):
        read(tmp_path, replace(inexact, K=sp.csc_array(inexact.K[order][:, order])))


def test_a_mesh_off_a_deck_that_was_typed_is_another_mesh(tmp_path: Path) -> None:
    body = body_near(tmp_path, deck(typed), 1e-6)
    with pytest.raises(DofMapError, match="not proven"):
        read(tmp_path, body)


def test_coordinates_that_leave_no_force_are_exact_whatever_their_digits(tmp_path: Path) -> None:
    found = read(tmp_path, body_near(tmp_path, deck(narrow), 0.0))
    assert isinstance(found.nodes, Nodes) and found.nodes.xyz_rounding == 0
    near = read(tmp_path, body_near(tmp_path, deck(narrow), 1e-8))
    assert isinstance(near.nodes, Nodes) and near.nodes.xyz_rounding >= 5e-7
