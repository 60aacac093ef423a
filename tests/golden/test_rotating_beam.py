"""The two-body rotating beam of the verification libraries (theory section 9), at rest and spun."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.config import load_pipeline
from cmsreduce.pipeline import Run, Silent, execute
from cmsreduce.write import read_component
from tests.mechanics.test_geometric_stiffness import WRIGHT
from tests.samples import assert_made_again

ROOT = Path(__file__).parents[2]
PIPELINE = ROOT / "pipelines" / "rotating_beam.yaml"
WEAK, STRONG = [2.1209, 13.291, 37.216], [4.2418, 26.583, 74.432]
# The fourth of the weak axis, 72.93 Hz, comes before the third of the strong one, and is not printed.
PRINTED = [0, 1, 2, 3, 4, 6]
# Five digits are printed.
DIGITS = {"rtol": 0.5e-4 * (1 + 1e-9)}
FLAP = 2.1209 / WRIGHT[0]
"""A unit of gamma in the table of Wright et al., Hz; the strong axis has twice that."""


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = Run(load_pipeline(PIPELINE), tmp_path_factory.mktemp("rotating_beam"), Silent())
    assert execute(run, PIPELINE, report=False).passed
    return run.folder


def test_frequencies_at_rest_are_those_printed(out: Path) -> None:
    """Clamped at the hub, both planes; from the assembled system and from the component file's frame."""
    import h5py

    with h5py.File(out / "system.h5") as file:
        system = file["configuration_0/frequency_hz"][:7]
    np.testing.assert_allclose(system[PRINTED], sorted(WEAK + STRONG), **DIGITS)
    stored = read_component(out / "beam.h5").arrays
    deforming = stored["integrals/modes"]
    K, M = (stored[f"modes/{name}"][np.ix_(deforming, deforming)] for name in ("stiffness", "mass"))
    found = np.sqrt(la.eigh(K, M, eigvals_only=True)[:7]) / (2 * np.pi)
    np.testing.assert_allclose(found[PRINTED], sorted(WEAK + STRONG), **DIGITS)


def test_spun_at_its_gamma_of_ten_it_has_the_published_frequencies(out: Path) -> None:
    """Flapping by the table at 10; in the plane of the spin, twice as stiff, at 5, and less the square of the spin."""
    notes = "\n".join(json.loads((out / "summary.json").read_text())["notes"])
    told = re.search(r"it vibrates at ([\d.]+), ([\d.]+)", notes)
    assert told is not None
    lag = np.sqrt((2 * FLAP * WRIGHT[5]) ** 2 - (10 * FLAP) ** 2)
    np.testing.assert_allclose([float(told[1]), float(told[2])], [lag, FLAP * WRIGHT[10]], rtol=1e-3)


def test_it_would_diverge_by_its_modes_alone(tmp_path: Path) -> None:
    run = Run(load_pipeline(PIPELINE, ("components.beam.geometric_stiffness=null",)), tmp_path, Silent())
    execute(run, PIPELINE, report=False)
    assert "diverge" in "\n".join(json.loads((tmp_path / "summary.json").read_text())["notes"])


def test_the_script_makes_the_same_files_again(tmp_path: Path) -> None:
    assert_made_again(ROOT / "sample_models" / "rotating_beam", tmp_path)
