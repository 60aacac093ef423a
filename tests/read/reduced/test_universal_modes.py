"""Modes of universal files: all modes of a bar, which are the bar, and files of NX and Permas."""

from __future__ import annotations

import importlib.util
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.errors import CmsReduceError
from cmsreduce.model import SI, RigidBody
from cmsreduce.read import InterfaceSpec, in_dofs, read_universal_modes
from tests.pipeline.study import arm

pyuff: Any = pytest.importorskip("pyuff") if importlib.util.find_spec("pyuff") else None
pytestmark = pytest.mark.skipif(pyuff is None, reason="needs pyuff (pip install 'cmsreduce[uff]')")
# Of ladisk/pyuff, whose folder data holds files of NX and Permas.
CLONE = os.environ.get("PYUFF_CLONE", "")
ZETA = 0.01
NONE = {f"id{k}": "NONE" for k in range(1, 6)} | {"model_type": 1, "load_case": 1, "r4": [], "r5": [], "r6": []}


@pytest.fixture(scope="module")
def bar():
    """A free bar of five nodes, its 30 modes of unit mass and squares of frequencies, rigid ones first."""
    body = arm()
    lam, Phi = la.eigh(body.K.toarray(), body.M.toarray())
    return body, np.where(np.arange(30) < 6, 0.0, lam), Phi


def write(path: Path, body, lam, Phi, *, phase=None, masses=None, **changed: Any) -> Path:
    """Nodes and modes of a bar; with a phase of each dof, complex modes of eigenvalue s and modal A."""
    file = pyuff.UFF(str(path))
    nodes = body.nodes
    frames = {name: [1] * len(nodes) for name in ("def_cs", "disp_cs", "color")}
    file.write_sets({"type": 2411, "node_nums": nodes.id, **frames, **dict(zip("xyz", nodes.xyz.T, strict=True))})
    masses = np.ones(lam.size) if masses is None else masses
    for k, (square, shape, mass) in enumerate(zip(lam, Phi.T, masses, strict=True)):
        w = float(np.sqrt(square))
        values = shape * np.sqrt(mass or 1.0) * (1 if phase is None else np.exp(1j * phase))
        s = w * complex(-ZETA, np.sqrt(1 - ZETA**2))
        # Of a real shape that is turned by 40 degrees as a whole.
        turn = np.exp(0.7j) if phase is not None else 1.0
        facts = {"freq": w / (2 * np.pi), "modal_m": mass, "modal_damp_vis": ZETA if w else 0.0, "modal_damp_his": 0.0}
        if phase is not None:
            facts = {"eig": s, "modal_a": 2j * s.imag * mass * turn**2, "modal_b": 0j}
        # pyuff has no complex rotations.
        count = 6 if phase is None else 3
        rows = {f"r{c + 1}": (values * turn)[c::6] for c in range(count)}
        facts["mode_n"] = k + 1
        kind = {"analysis_type": 2, "data_type": 2} if phase is None else {"analysis_type": 3, "data_type": 5}
        per_node = {
            "n_data_per_node": count,
            "data_ch": count // 3 + 1,
            "spec_data_type": 8,
            "mode_n": k + 1,
            "node_nums": nodes.id,
        }
        file.write_sets({"type": 55, **NONE, **kind, **per_node, **facts, **rows, **changed})
    # pyuff 2.5 writes the number of reals where the format, and its own reader, have that of complex numbers.
    path.write_text(path.read_text().replace("         5         6\n", "         5         3\n"))
    return path


def matrices(modal):
    body = in_dofs(modal, {"root": InterfaceSpec((1,)), "tip": InterfaceSpec((5,))})
    K, M = body.K.toarray(), body.M.toarray()
    return K[:12, :12], np.sqrt(abs(la.eigvalsh(K, M))[6:])


@pytest.mark.parametrize("masses", [None, np.linspace(1, 40, 30)])
def test_all_modes_of_a_body_are_the_body(tmp_path, bar, masses):
    body, lam, _Phi = bar
    modal = read_universal_modes("bar", write(tmp_path / "bar.unv", *bar, masses=masses), geometry=None, units=SI)
    K, omega = matrices(modal)
    ends = np.r_[:6, 24:30]
    inner = np.setdiff1d(np.arange(30), ends)
    full = body.K.toarray()
    condensed = full[np.ix_(ends, ends)] - full[np.ix_(ends, inner)] @ la.solve(
        full[np.ix_(inner, inner)], full[np.ix_(inner, ends)]
    )
    size = np.sqrt(np.outer(condensed.diagonal(), condensed.diagonal()))
    # Six digits are printed.
    assert abs((K - condensed) / size).max() < 1e-3
    np.testing.assert_allclose(omega, np.sqrt(lam[6:]), rtol=2e-5)
    assert modal.unproven == "" and modal.remarks == ()
    np.testing.assert_allclose(modal.D.diagonal() / modal.M.diagonal(), 2 * ZETA * np.sqrt(lam), rtol=2e-5, atol=1e-3)


def test_complex_modes_with_little_phase_are_made_real_with_the_figure(tmp_path, bar):
    _, lam, Phi = bar
    phase = np.random.default_rng(5).uniform(-0.03, 0.03, 30)
    path = write(tmp_path / "bar.unv", bar[0], lam[6:], Phi[:, 6:], phase=phase)
    inertia = RigidBody("bar", 1.0, np.zeros(3), np.eye(3))
    modal = read_universal_modes("bar", path, geometry=None, units=SI, rigid=inertia)
    [remark] = modal.remarks
    assert (
        "complex shapes are taken as real ones; at most" in remark
        and float(remark.split("most ")[1].split(" %")[0]) < 3
    )
    # Twisting does not move the nodes of the bar, neither the rigid motion nor the modes.
    first = modal.K.shape[0] - 24
    assert first == 5
    moving = np.arange(30) % 6 < 3
    shown = np.flatnonzero((Phi[moving, 6:] ** 2).sum(axis=0) > 1e-6)
    given, found = Phi[moving][:, 6 + shown], modal.shapes[:, first + shown]
    M, K, D = (A.diagonal()[first + shown] for A in (modal.M, modal.K, modal.D))
    np.testing.assert_allclose(M, 1.0, rtol=5e-3)
    np.testing.assert_allclose(K / M, lam[6 + shown], rtol=2e-5)
    np.testing.assert_allclose(D / M, 2 * ZETA * np.sqrt(lam[6 + shown]), rtol=2e-5)
    same = (found * given).sum(axis=0) ** 2 / ((found**2).sum(axis=0) * (given**2).sum(axis=0))
    assert same.min() > 0.999


@pytest.mark.parametrize(
    ("options", "read", "words"),
    [
        ({"phase": np.linspace(0, 1.5, 30)}, {}, r"complex mode 1 \(.* Hz\) of .* is out of phase by \d+"),
        ({"masses": np.zeros(30)}, {}, r"mode 1 \(0 Hz\) of .* has modal mass 0, so that its shape has no scale"),
        ({}, {"modal_mass": (1.0, 2.0)}, r"2 modal masses are given, but .* has 30 modes"),
        ({"spec_data_type": 12}, {}, r"only shapes of accelerations: write them as displacements"),
        ({"freq": -1.0}, {}, r"mode 1 \(-1 Hz\) has a negative frequency, or a number that is infinite or none"),
        ({"r2": np.full(5, np.nan)}, {}, r"mode 1 \(0 Hz\) has a negative frequency, or a number that is infinite or"),
        ({"elastic": True}, {}, r"none of its 24 modes is a rigid motion"),
    ],
)
def test_what_is_refused(tmp_path, bar, options, read, words):
    body, lam, Phi = bar
    first = 6 if options.pop("elastic", False) or "phase" in options else 0
    path = write(tmp_path / "bar.unv", body, lam[first:], Phi[:, first:], **options)
    with pytest.raises(CmsReduceError, match=words):
        read_universal_modes("bar", path, geometry=None, units=SI, **read)


@pytest.mark.skipif(not CLONE, reason="PYUFF_CLONE names no clone of ladisk/pyuff")
def test_files_of_nx_and_permas():
    """Frequencies that Permas printed, of a plate of 20 x 20 elements; NX wrote along turned axes."""
    with pytest.raises(CmsReduceError, match="18 nodes are along turned axes"):
        read_universal_modes("nx", Path(CLONE) / "data/NX simulation output.uff", geometry=None, units=SI)
    permas = Path(CLONE) / "data/2411 and 2414.uff"
    with pytest.raises(CmsReduceError, match=r"mode 1 \(0\.956363 Hz\) .* has modal mass 0"):
        read_universal_modes("plate", permas, geometry=None, units=SI, grounded=True)
    plate = read_universal_modes("plate", permas, geometry=None, units=SI, grounded=True, modal_mass=(1.0,) * 10)
    # One edge is clamped.
    np.testing.assert_allclose(np.sqrt(plate.K.diagonal()[[0, 9]]) / (2 * np.pi), [0.956363, 25.7643], rtol=1e-9)
    assert len(np.unique(plate.dofs.node)) == 441 - 21
