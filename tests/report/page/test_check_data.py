"""Data of the plots of checks, unpacked again, and rows on a body's health."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cmsreduce.model import (
    ChannelZeros,
    Finding,
    GainSum,
    ReductionChecks,
    SystemChecks,
    health_data,
)
from cmsreduce.report.page.check_data import check_data, high_gains
from cmsreduce.report.page.packing import ArrayStore
from cmsreduce.report.page.tables import basis_row, channel_rows, health_rows
from cmsreduce.report.terminal import health_lines
from tests.report.conftest import component
from tests.report.made_checks import HEALTH
from tests.report.unpacking import unpacked


def test_zeros_are_drawn_once_and_placed_in_the_plane(make_run) -> None:
    # An antiresonance, one that damping hides, a real pair, a quadruple; the reduced system misses the last.
    full = 2 * np.pi * np.array([1j, 2j, 3, -3, 3 + 4j, -3 + 4j])
    reduced = 2 * np.pi * np.array([1.001j, 2j, 3, -3])
    pair = ChannelZeros(0, 1, full, reduced, np.array([1e-3, 0.0, 0.0, np.inf]), np.array([0, 2, 3, 4]))
    run = replace(make_run(), checks=ReductionChecks(systems=(SystemChecks("spin=0", zeros=(pair,)),)))
    store = ArrayStore()
    data = check_data(run, store)
    (found,) = data["zeros"]
    assert found["counts"] == [[0, 0], [4, 3]] and found["worst"] == [None, [0.1, 1, 4]]
    assert data["zero_first"] == (0, 1)
    assert 10 ** unpacked(store.packed(), found["full"]) == pytest.approx([1, 2, 3, 5], rel=1e-4)
    assert unpacked(store.packed(), found["full_place"]).tolist() == [0, 0, 1, 2]
    assert unpacked(store.packed(), found["judged"]).tolist() == [1, 0, 1, 1]
    # The last has no partner: a gap.
    miss = unpacked(store.packed(), found["miss"])
    assert 10 ** miss[0] == pytest.approx(1e-3, rel=1e-2) and np.isnan(miss[3])


def test_high_gains_are_those_of_the_curve() -> None:
    # Gains 4 and 1 in the band, 2 and 0.5 above it, one static: 2 of 8 is a quarter, 0.5 a sixteenth.
    gain = np.array([4.0, -1.0, 2.0, 0.5])[:, None, None]
    gains = GainSum(np.array([1.0, 5.0, 20.0, 30.0]), gain, np.full((1, 1), 0.5))
    store = ArrayStore()
    found = high_gains(gains, 10.0, store)
    assert unpacked(store.packed(), found["mode"]).tolist() == [2]
    assert unpacked(store.packed(), found["share"]) == pytest.approx([0.25])


def test_static_lack_is_in_per_cent_with_its_limit(make_run) -> None:
    checks = ReductionChecks({"rotor": {"interface 'tip'": 2e-3}})
    data = check_data(replace(make_run(), checks=checks, limits={"static_lack": 0.01}), ArrayStore())
    assert (data["statics"], data["static_limit"]) == ([["rotor", "interface 'tip'", 0.2]], 1.0)


def test_one_table_of_health_for_the_page_the_terminal_and_json() -> None:
    part = replace(component("rotor"), health=HEALTH)
    rows = {row.name: row for row in health_rows(part)}
    assert rows["centre of mass"].words == "0.5 0 0"
    assert rows["mass by the rigid motions of stiffness"].advice == "the sources disagree"
    assert [row.name for row in rows.values() if not row.passed] == [
        "mass by the rigid motions of stiffness",
        "nearly massless dofs",
        "motions of negative energy, mass",
    ]
    failed = replace(part, checks=(Finding("rows: same mass", 2.0, 1.0),))
    assert health_rows(failed)[-1].name == "rows: same mass" and not health_rows(failed)[-1].passed
    assert health_rows(component("rotor")) == []
    lines = [row.line for row in health_lines(HEALTH)]
    assert lines[0] == "centre of mass: 0.5 0 0"
    assert lines[3] == "nearly massless dofs: 2: 3 rx 4 rx (they cost time steps)"
    data = health_data(HEALTH)
    assert data["mass_properties"]["geometry"]["centre"] == [0.5, 0.0, 0.0]
    assert data["mass_properties"]["stiffness"] == {"mass": [3.0, 3.0, 3.003]}
    assert [each["ratio"] for each in data["stiffness_contrast"]] == [1e5, 10.0]
    assert data["negative_motions"] == {"mass": None} and data["principal"] is None


def test_the_mode_set_of_a_body() -> None:
    part = component("rotor")
    dependent = replace(part, modes=replace(part.modes, basis_rank=2, basis_condition=12.5))
    row = basis_row(dependent)
    assert (row["rank"], row["condition"], row["deficient"]) == (2, "12.5", True)
    assert basis_row(part)["rank"] == "–"


def test_channels_at_their_worst(make_run) -> None:
    run = make_run()
    first, second = run.configurations
    nan = np.nan
    worse = {"channel_errors": [[0.1, nan]], "channel_peak": [[0.02, nan]], "channel_shift": [[3e-4, nan]]}
    better = {"channel_errors": [[0.01, nan]], "channel_peak": [[0.05, nan]], "channel_shift": [[nan, nan]]}
    results = [
        replace(c, errors={"reduced": replace(c.errors["reduced"], **{k: np.array(v) for k, v in values.items()})})
        for c, values in ((first, better), (second, worse))
    ]
    loud, silent = channel_rows(replace(run, configurations=tuple(results)))
    assert tuple(loud[key] for key in ("name", "frf", "peak", "nrfd")) == ("motor → gyro", "10 %", "5 %", "0.03 %")
    assert loud["where"] == "spin=45 cone=30" and loud["frac"] == "0.9996"
    assert (silent["frf"], silent["nrfd"], silent["frac"]) == ("–", "–", "")
    assert channel_rows(run) == []
