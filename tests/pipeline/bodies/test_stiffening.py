"""A spun body through a whole run: told of, written, and taken up by a code that reads SID."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.linalg as la
from pyyeti.nastran import op4

from cmsreduce.config import load_pipeline
from cmsreduce.errors import CmsReduceError
from cmsreduce.mechanics import bars_stiffness
from cmsreduce.model import UnitLoad, Units, in_units, load_stiffness_in_units
from cmsreduce.pipeline import Run, Silent, execute, inspected
from cmsreduce.read import bars_in_units
from cmsreduce.write import convert, read_component
from tests.mechanics.test_geometric_stiffness import WRIGHT, chain
from tests.sealed import resealed
from tests.spinning_beam import BEAM, LENGTH, PIPELINE, beam, write_beam
from tests.write.targets.test_sid import read as read_sid

GAMMA = float(np.sqrt(BEAM.E * BEAM.Iy / (BEAM.rho * BEAM.A * LENGTH**4)))
"""Spin of the beam for which gamma of its weak axis is one, in rad/s."""
KEYS = "geometric_stiffness: {{bars: all, held: root}}"
HERTZ = 2.1209 / WRIGHT[0]
"""A unit of gamma in the table of frequencies, of the weak axis."""


def run(folder: Path, *overrides: str, text: str = PIPELINE, elements: int = 20, cards: str = "") -> Path:
    path = write_beam(folder, elements, text, cards)
    pipeline = load_pipeline(path, overrides)
    execute(Run(pipeline, pipeline.output, Silent()), path, report=False)
    return Path(pipeline.output)


def notes_of(out: Path) -> str:
    return "\n".join(json.loads((out / "summary.json").read_text())["notes"])


@pytest.fixture(scope="module")
def spun(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Spun at gamma = 5 about z, its frame clamped at the root."""
    rate = f"scene.spin.beam.rate={5 * GAMMA} rad/s"
    frame = "write.frame={kind: clamped, at: root}"
    text = PIPELINE.replace("bars: all", "bars: [all, force tip]")
    return run(tmp_path_factory.mktemp("spun"), rate, frame, text=text)


def test_the_run_tells_of_the_published_frequencies(spun: Path) -> None:
    note = next(line for line in notes_of(spun).splitlines() if "spinning at" in line)
    told = float(note.split("vibrates at ")[1].split(",")[0])
    assert told == pytest.approx(WRIGHT[5] * HERTZ, rel=2e-3)
    assert "at rest 2.121, 4.242" in note


@pytest.mark.parametrize("gamma", [1, 3, 5, 10])
def test_a_code_that_reads_sid_finds_the_published_frequencies(spun: Path, tmp_path: Path, gamma: int) -> None:
    """Me q'' + (Ke + Oe1 omega_z^2) q = 0: flapping is along the axis of spin, and no Coriolis force acts on it."""
    convert(spun / "beam.h5", tmp_path / "beam.SID_FEM")
    body = read_sid(tmp_path / "beam.SID_FEM").body
    flapping = np.flatnonzero(abs(body["Ct"].m0[:, 2]) + abs(body["Cr"].m0[:, 1]) > 1e-6)
    K = body["Ke"].m0 + (gamma * GAMMA) ** 2 * body["Oe"].m1[:, :, 2]
    square = np.ix_(flapping, flapping)
    found = np.sqrt(la.eigh(K[square], body["Me"].m0[square], eigvals_only=True)[0]) / (2 * np.pi)
    assert found == pytest.approx(WRIGHT[gamma] * HERTZ, rel=2e-3)


def test_named_arrays_hold_the_published_frequency(spun: Path, tmp_path: Path) -> None:
    """The HDF5 file for TREETOPS: K + K_zz omega_z^2, and flapping among its lowest."""
    convert(spun / "beam.h5", tmp_path / "beam.treetops.h5")
    with h5py.File(tmp_path / "beam.treetops.h5") as file:
        loads = [text.decode() for text in file["geometric_stiffness/load"][()]]
        stress = file["geometric_stiffness/K"][loads.index("CENTRIFUGAL zz")]
        K, M, u = file["modal/stiffness"][()], file["modal/mass"][()], file["linear_momentum"][()]
        turning = file["angular_momentum"][:, 1]
    flapping = np.flatnonzero(abs(u[:, 2]) + abs(turning) > 1e-6)
    square = np.ix_(flapping, flapping)
    found = np.sqrt(la.eigh((K + (5 * GAMMA) ** 2 * stress)[square], M[square], eigvals_only=True)[0]) / (2 * np.pi)
    assert found == pytest.approx(WRIGHT[5] * HERTZ, rel=2e-3)


def test_a_code_that_reads_sid_finds_the_load_that_buckles_the_beam(spun: Path, tmp_path: Path) -> None:
    """A force F at a node is phi(q)^T F: pushed by P along itself, a clamped beam yields at pi^2 E I / (4 L^2)."""
    convert(spun / "beam.h5", tmp_path / "beam.SID_FEM")
    sid = read_sid(tmp_path / "beam.SID_FEM")
    taken = -sid.nodes[21]["phi"].m1[0]
    found = 1 / la.eigh(taken, sid.body["Ke"].m0, eigvals_only=True)[-1]
    assert found == pytest.approx(np.pi**2 * BEAM.E * BEAM.Iy / (2 * LENGTH) ** 2, rel=1e-3)


def test_terms_of_acceleration_are_what_the_frame_feels_back(spun: Path, tmp_path: Path) -> None:
    """A root that accelerates along the beam presses it, and foreshortening takes its mass back towards the root."""
    convert(spun / "beam.h5", tmp_path / "beam.SID_FEM")
    body = read_sid(tmp_path / "beam.SID_FEM").body
    along = body["Ct"].m1[:, :, 0]
    np.testing.assert_allclose(along, along.T, atol=1e-9 * abs(along).max())
    assert la.eigvalsh(along).max() <= 1e-9 * abs(along).max()
    # int u2 dm of the first flapping mode, u2 = - 1/2 int (dw/dx)^2 dx: - int (L - x) w'^2 dx of a mode of unit mass.
    x, s = np.linspace(0, 1, 2001), 1.8751040687
    share = (np.cosh(s) + np.cos(s)) / (np.sinh(s) + np.sin(s))
    slope = s * (np.sinh(s * x) + np.sin(s * x) - share * (np.cosh(s * x) - np.cos(s * x)))
    expected = -np.trapezoid((1 - x) * slope**2, x) / LENGTH
    _, X = la.eigh(body["Ke"].m0, body["Me"].m0)
    np.testing.assert_allclose(np.einsum("a,ab,b->", X[:, 0], along, X[:, 0]), expected, rtol=2e-3)


def test_the_file_is_told_of_and_older_ones_are_read(spun: Path, tmp_path: Path) -> None:
    lines = "\n".join(inspected(spun / "beam.h5").lines)
    assert "centrifugal xx yy zz xy yz xz; force 21.x 21.y 21.z; held at interface root" in lines
    older = tmp_path / "older.h5"
    older.write_bytes((spun / "beam.h5").read_bytes())
    with resealed(older) as file:
        del file["geometric_stiffness"]
    assert "geometric_stiffness/K" not in read_component(older).arrays
    convert(older, tmp_path / "older.SID_FEM")
    assert abs(read_sid(tmp_path / "older.SID_FEM").body["Ct"].m1).max() == 0
    with resealed(older) as file:
        file.create_group("geometric_stiffness")
    with pytest.raises(CmsReduceError, match="geometric_stiffness/load"):
        read_component(older)


SPINS = {
    "slow": ("0.2 Hz", ""),
    "fast": ("1 Hz", "47% of its lowest frequency (2.121 Hz held at root)"),
    "too fast": ("5 Hz", "its modes alone diverge"),
}


@pytest.mark.parametrize("rate, said", SPINS.values(), ids=SPINS.keys())
def test_a_spin_without_the_term_is_warned_of(tmp_path: Path, rate: str, said: str) -> None:
    out = run(tmp_path, f"scene.spin.beam={rate}", text=PIPELINE.replace(KEYS, ""))
    notes = notes_of(out)
    assert ("no geometric stiffness" in notes) == bool(said)
    assert said in notes
    # No axis is named: the beam may spin about each.
    assert notes.count("no geometric stiffness") == (3 if said else 0)


def test_a_users_matrix_is_the_computed_one(tmp_path: Path) -> None:
    folder = tmp_path / "user"
    folder.mkdir()
    body = beam(8)
    held = body.dofs.rows_of(1, range(1, 7))
    loads = [UnitLoad("centrifugal", "zz"), UnitLoad("force", "x", "9")]
    found = bars_stiffness(body, chain(8, section=BEAM), loads, held=held)
    A = {f"K{number}": K.toarray() for number, K in enumerate(found.matrices)}
    op4.write(str(folder / "kg.op4"), A)
    spin, pull = (
        "{{" + f"file: kg.op4, matrix: K{k}, load: {load}" + "}}"
        for k, load in enumerate(("centrifugal zz", "force tip.x"))
    )
    matrices = "{{" + f"spin: {spin}, pull: {pull}" + "}}"
    given = run(folder, text=PIPELINE.replace(KEYS, f"geometric_stiffness: {{{{matrices: {matrices}}}}}"), elements=8)
    other = tmp_path / "computed"
    other.mkdir()
    computed = run(other, text=PIPELINE.replace("bars: all", "bars: [centrifugal zz, force tip]"), elements=8)
    with h5py.File(given / "beam.h5") as one, h5py.File(computed / "beam.h5") as two:
        a, b = one["geometric_stiffness"], two["geometric_stiffness"]
        assert a["load"][:].tolist() == [b"centrifugal zz", b"force 9.x"]
        assert b["load"][:2].tolist() == a["load"][:].tolist()
        np.testing.assert_allclose(a["K"][:], b["K"][:2], atol=1e-9 * abs(b["K"][:]).max())
        assert a["source"][0].startswith(b"kg.op4 K0 sha256 ")


REFUSED = {
    "no such interface": (KEYS, "geometric_stiffness: {{bars: all, held: rot}}", "did you mean 'root'"),
    "held by nothing": (KEYS, "geometric_stiffness: {{bars: all}}", "held:"),
    "no such load": (KEYS, "geometric_stiffness: {{bars: spin, held: root}}", "'spin' is not a unit load"),
    "nothing asked for": (KEYS, "geometric_stiffness: {{held: root}}", "bars: all"),
    "no such body": ("spin: {{beam:", "spin: {{bem:", "did you mean 'beam'"),
    "no unit": ("10 rad/s", "10", "has no unit"),
}


@pytest.mark.parametrize("old, new, said", REFUSED.values(), ids=REFUSED.keys())
def test_bad_keys_are_refused(tmp_path: Path, old: str, new: str, said: str) -> None:
    assert old in PIPELINE
    with pytest.raises(CmsReduceError, match=said):
        run(tmp_path, text=PIPELINE.replace(old, new))


def test_a_body_in_other_units_is_restated() -> None:
    body, small = beam(6), Units.parse("mm-t-s")
    held, bars = body.dofs.rows_of(1, range(1, 7)), chain(6, section=BEAM)
    restated, short = in_units(body, small), bars_in_units(bars, body.units, small)
    loads = [UnitLoad.parse(text) for text in ("acceleration x", "centrifugal zz", "force 7.x", "moment 7.y")]
    one = bars_stiffness(body, bars, loads, held=held)
    two = bars_stiffness(restated, short, loads, held=held)
    for load, a, b in zip(loads, one.matrices, two.matrices, strict=True):
        there = load_stiffness_in_units(a, body.dofs, load, body.units, small)
        assert abs(there - b).max() <= 1e-9 * max(abs(b).max(), 1e-30)
