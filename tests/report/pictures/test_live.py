"""Charts in notebooks: figures of plotly with the numbers of the run."""

import re

import numpy as np
import pytest

from cmsreduce.errors import CmsReduceError, SceneError, optional_library
from cmsreduce.report import Plots, run_card
from tests.report.large_run import large_run


@pytest.fixture(scope="module")
def run():
    return large_run(modes=130, inputs=1, outputs=2, configurations=2, points=1500, nodes=40)


def test_bode_holds_the_responses_of_the_run(run) -> None:
    figure = Plots(run).bode("push 0", "probe 1", configuration="angle=5")
    full = next(trace for trace in figure.data if trace.name == "full")
    H = run.configurations[1].response.full[:, 1, 0]
    np.testing.assert_array_equal(full.y, abs(H))
    phase = next(trace for trace in figure.data if trace.yaxis == "y2" and trace.line.width == full.line.width)
    known = ~np.isnan(phase.y)
    np.testing.assert_allclose(phase.y[known], np.degrees(np.angle(H))[known])
    error = next(trace for trace in figure.data if trace.yaxis == "y3")
    reduced = run.configurations[1].response.reduced["reduced"][:, 1, 0]
    np.testing.assert_allclose(error.y, np.maximum(abs(20 * np.log10(abs(reduced / H))), 1e-4), atol=1e-9)
    assert figure.layout.yaxis.title.text == "magnitude, rad/(N m)"
    assert [note.text for note in figure.layout.annotations] == ["limit 1 dB"]


def test_the_worst_response_is_the_default(make_run) -> None:
    assert Plots(make_run()).bode().layout.title.text == "motor → gyro, spin=45 cone=30"


def test_other_plots(run) -> None:
    plots, errors = Plots(run), run.configurations[0].errors["reduced"]
    (point,) = plots.error_cost().data
    worst = max(result.errors["reduced"].frf_error for result in run.configurations)
    assert (point.x[0], point.y[0]) == (errors.coordinates, pytest.approx(100 * worst))
    np.testing.assert_array_equal(plots.mac("angle=0").data[0].z, errors.mac_matrix.mac)
    kept, left_out = plots.ranking("string").data[:2]
    assert (kept.name, len(kept.x), left_out.name, len(left_out.x)) == ("kept", 120, "left out", 10)
    modes = plots.modes("string")
    # At rest, and each mode, of which the first is shown.
    assert len(modes.data) == 131 and [trace.visible for trace in modes.data[1:4]] == [True, False, False]
    assert len(modes.layout.updatemenus[0].buttons) == 130


def test_unknown_names_are_refused_with_the_known_ones(run) -> None:
    for call, known in (
        (lambda: Plots(run).bode("pusch 0"), "did you mean 'push 0'"),
        (lambda: Plots(run).bode(output="probes"), "There are: probe 0, probe 1"),
        (lambda: Plots(run).mac("angle=7"), "configuration"),
        (lambda: Plots(run).ranking("strings"), "did you mean 'string'"),
    ):
        with pytest.raises(SceneError, match=re.escape(known)):
            call()


def test_a_library_that_is_missing_is_named_with_its_remedy() -> None:
    with pytest.raises(CmsReduceError, match=r"plots need the library nosuch, .*: pip install nosuch"):
        optional_library("nosuchlibrary.graphs", "nosuch", "plots")


def test_a_card_holds_verdict_and_errors(make_run) -> None:
    card = run_card(make_run(name="<arm>"))
    assert "&lt;arm&gt;" in card and "PASS" in card and "2 % (limit 5 %), spin=45 cone=30" in card
    assert len(card) < 2000
