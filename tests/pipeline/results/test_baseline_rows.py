"""Changes at dofs and channels that frequencies and directions of modes do not show."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cmsreduce.pipeline.results.baseline_rows import row_findings
from cmsreduce.pipeline.results.limits import Tolerances
from cmsreduce.verify import pair_modes
from cmsreduce.write import ComponentFile, read_component

SHAPES, BOTH = "dofs/shapes", {"static flexibility", "inputs and outputs"}


def found(old: ComponentFile, new: ComponentFile) -> dict[str, tuple[float, str]]:
    """Findings beyond their tolerances."""
    shapes = [file.arrays[SHAPES][:, file.elastic] for file in (old, new)]
    pairs = pair_modes(old.omega[old.elastic], new.omega[new.elastic], *shapes)
    every = list(row_findings(old, new, pairs, Tolerances()))
    assert len(every) == 4
    return {each.name: (each.value, each.note) for each in every if not each.passed}


@pytest.mark.parametrize(
    ("body", "name", "gain", "figures"),
    [
        ("arm", SHAPES, 1.0, set()),
        ("arm", SHAPES, 1.01, BOTH),
        ("arm", SHAPES, -1.0, {"inputs and outputs"}),
        ("arm", "inputs/B", -1.0, {"inputs and outputs"}),
        ("panel", "outputs/C1", 1.01, {"inputs and outputs"}),
    ],
)
def test_static_modes_count_in_any_basis(finished_study: Path, body: str, name: str, gain: float, figures: set[str]):
    """The last three modes stand for shapes without mass, of which another run finds any rotation."""
    file = replace(read_component(finished_study / f"out/{body}.h5"), static_count=3)
    rotation = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))[0]
    arrays = {key: file.arrays[key].copy() for key in (SHAPES, "inputs/B", "outputs/C1", "outputs/C2")}
    for key, rows in arrays.items():
        modes = rows.T if key == "inputs/B" else rows
        modes[:, -3:] = modes[:, -3:] @ rotation * (gain if key == name else 1.0)
    assert found(file, replace(file, arrays={**file.arrays, **arrays})).keys() == figures


@pytest.mark.parametrize("part", ["rigid", "elastic"])
@pytest.mark.parametrize(
    ("body", "name", "says"), [("arm", "inputs/B", "input motor"), ("panel", "outputs/C1", "probe")]
)
def test_one_gain_of_a_channel(finished_study: Path, part: str, body: str, name: str, says: str) -> None:
    file = read_component(finished_study / f"out/{body}.h5")
    values = file.arrays[name].copy()
    modes = values if name == "inputs/B" else values.T
    modes[slice(file.rigid_count) if part == "rigid" else file.elastic] *= 1.01
    changed = found(file, replace(file, arrays={**file.arrays, name: values}))
    value, note = changed.pop("inputs and outputs")
    assert not changed and f"in the {part} modes" in note and says in note
    assert 0.001 < value <= 0.0201 * (1 + 1e-9)


def test_channels_lost_and_new(finished_study: Path) -> None:
    file = read_component(finished_study / "out/panel.h5")
    names = file.texts["outputs/name"]
    other = replace(file, texts={**file.texts, "outputs/name": ("yaw", *names[1:])})
    assert found(file, other) == {"outputs lost or new": (2.0, f"lost {names[0]}; new yaw")}


def test_a_shift_of_a_frequency_has_a_tolerance_of_its_own(finished_study: Path) -> None:
    file = read_component(finished_study / "out/arm.h5")
    other = replace(file, arrays={**file.arrays, "modes/omega": 1.05 * file.omega})
    assert not found(file, other)


def test_rounding_of_a_silent_channel_is_no_change(finished_study: Path) -> None:
    """An actuator within another body leaves 1e-16 of its size here, other numbers in each run."""
    file, rng = read_component(finished_study / "out/arm.h5"), np.random.default_rng(2)
    size = 1e-16 * np.linalg.norm(file.arrays["inputs/B"])
    old, new = (
        replace(file, arrays={**file.arrays, "inputs/B": size * rng.standard_normal(file.arrays["inputs/B"].shape)})
        for _ in range(2)
    )
    assert not found(old, new)
