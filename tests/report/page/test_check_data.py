"""What the plots of the checks are drawn from, unpacked again; what is said of a body's health."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cmsreduce.model import ChannelZeros, GainCurve, GainSum, ReductionChecks, SystemChecks
from cmsreduce.report.page.check_data import check_data, high_gains
from cmsreduce.report.page.health_rows import basis_row, health_rows
from cmsreduce.report.page.packing import ArrayStore
from cmsreduce.report.page.tables import channel_rows
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
    found = high_gains(GainCurve("", gains, gains), 10.0, store)
    assert unpacked(store.packed(), found["mode"]).tolist() == [2]
    assert unpacked(store.packed(), found["share"]) == pytest.approx([0.25])


def test_static_lack_is_in_per_cent_with_its_limit(make_run) -> None:
    checks = ReductionChecks({"rotor": {"interface 'tip'": 2e-3}})
    data = check_data(replace(make_run(), checks=checks, limits={"static_lack": 0.01}), ArrayStore())
    assert (data["statics"], data["static_limit"]) == ([["rotor", "interface 'tip'", 0.2]], 1.0)


def test_health_in_words() -> None:
    part = replace(component("rotor"), health=HEALTH)
    rows = {row.what: row for row in health_rows(part)}
    assert rows["centre of mass"].found == "0.5, 0, 0"
    assert rows["the same by the rigid motions of stiffness"].remark == "the sources disagree"
    assert [row.what for row in rows.values() if row.remark] == [
        "the same by the rigid motions of stiffness",
        "nearly massless dofs",
        "motions of negative energy, mass",
    ]
    assert health_rows(component("rotor")) == []
    dependent = replace(part, modes=replace(part.modes, basis_rank=2, basis_condition=12.5))
    assert (basis_row(dependent).rank, basis_row(dependent).condition, basis_row(dependent).deficient) == (
        "2",
        "12.5",
        True,
    )
    assert basis_row(part).rank == "–"


def test_channels_at_their_worst(make_run) -> None:
    run = make_run()
    first, second = run.configurations
    nan = np.nan
    worse = {"channel_error": [[0.1, nan]], "channel_peak": [[0.02, nan]], "channel_shift": [[3e-4, nan]]}
    better = {"channel_error": [[0.01, nan]], "channel_peak": [[0.05, nan]], "channel_shift": [[nan, nan]]}
    results = [
        replace(c, errors={"reduced": replace(c.errors["reduced"], **{k: np.array(v) for k, v in values.items()})})
        for c, values in ((first, better), (second, worse))
    ]
    loud, silent = channel_rows(replace(run, configurations=tuple(results)))
    assert (loud.name, loud.frf, loud.peak, loud.nrfd) == ("motor → gyro", "10 %", "5 %", "0.03 %")
    assert loud.where == "spin=45 cone=30" and loud.frac == "0.9996"
    assert (silent.frf, silent.nrfd, silent.frac) == ("–", "–", "")
    assert channel_rows(run) == []
