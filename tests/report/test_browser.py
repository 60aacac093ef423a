"""The page in a browser without a screen."""

import re
import struct
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cmsreduce.report import render_report, sweep_page
from tests.report.browser import Opened, launched, needs_browser, opened
from tests.report.large_run import large_run
from tests.report.made_checks import SHIFT, WORST_RATIO
from tests.report.sweeps import made_sweep

pytestmark = [pytest.mark.chromium, needs_browser]

HOSTILE = "</script><script>window.stolen = 1</script>"
# What decides how soon the page is there, on any machine: its bytes, its elements, and the points of a drawn line, of
# the 4000 that the run has.
LARGEST = 15e6
MOST_ELEMENTS = 10_000
MOST_POINTS = 1000

PLOTS = "[...document.querySelectorAll('.js-plotly-plot')].map((plot) => [plot.id, plot.data.length])"
POINTS = (
    "[...document.querySelectorAll('.js-plotly-plot')].map((plot) => [plot.id, plot.data.map((line) => line.x.length)])"
)
MARKS = """(id) => {
  const plot = document.getElementById(id);
  return plot.querySelectorAll(".js-line, .point, .points path, .heatmaplayer image, .barlayer path").length;
}"""
INK = """(id) => {
  const canvas = document.getElementById(id);
  const pixels = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
  let count = 0;
  for (let k = 0; k < pixels.length; k += 4) if (Math.min(pixels[k], pixels[k + 1], pixels[k + 2]) < 200) count += 1;
  return count;
}"""


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with launched() as found:
        yield found


@pytest.fixture(scope="module")
def large(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("large") / "report.html"
    path.write_text(render_report(large_run()), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same scene with a few modes and channels: every section of the page is there."""
    path = tmp_path_factory.mktemp("small") / "report.html"
    run = large_run(modes=130, inputs=1, outputs=2, configurations=3, points=1500, nodes=60)
    path.write_text(render_report(run), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def page(browser: Any, small: Path) -> Iterator[Opened]:
    """One page for all: drawing it is the longest part of a test. Each test chooses what it looks at."""
    with opened(browser, small) as found:
        found.draw_all()
        yield found


def test_the_largest_run_opens_with_its_first_screen_only(browser: Any, large: Path) -> None:
    """Of 20 configurations with 96 channels, what is drawn on opening is what the first screen shows, thinned."""
    assert large.stat().st_size < LARGEST
    with opened(browser, large) as found:
        found.page.wait_for_selector("html[data-ready]", state="attached", timeout=60_000)
        for plot in ("speed", "response"):
            found.page.wait_for_selector(f"#{plot} .main-svg", timeout=60_000)
        points = dict(found.page.evaluate(POINTS))
        assert set(points) == {"speed", "response"}
        assert 100 < max(points["response"]) < MOST_POINTS
        assert found.page.evaluate("document.getElementsByTagName('*').length") < MOST_ELEMENTS
        assert found.page.eval_on_selector("#channel", "(select) => select.options.length") == 96
        assert found.faults == []


def test_every_plot_has_marks(page: Opened) -> None:
    drawn = dict(page.page.evaluate(PLOTS))
    assert set(drawn) == {
        "response", "by-configuration", "speed", "sigma-0", "effective-0", "mac", "gains", "completeness", "singular",
        "extraneous", "timing-bars", "static-lack", "zeros", "steps", "controller-margin",
    }  # fmt: skip
    for plot, traces in drawn.items():
        assert traces > 0
        assert page.page.evaluate(MARKS, plot) >= traces, plot
    for canvas in ("sketch", "shapes"):
        assert page.page.evaluate(INK, canvas) > 200, canvas
    assert page.faults == []


def test_modes_are_picked_and_move(page: Opened) -> None:
    """Mode 3 of a string has three half waves: two points at rest between the walls."""
    picked = "() => document.getElementById('shapes').dataset.mode"
    page.choose("shape-mode", "0")
    first = page.page.evaluate(picked)
    page.choose("shape-mode", "2")
    assert page.page.evaluate(picked) != first
    page.page.click("#shape-before")
    assert page.page.evaluate(picked).startswith("2: ")
    page.choose("shape-of", "0")
    assert page.page.evaluate("() => document.getElementById('shape-mode').options.length") == 130
    page.choose("shape-mode", "129")
    assert "left out" in page.page.evaluate(picked)
    page.page.click("#shape-play")
    before = page.page.evaluate("() => document.getElementById('shapes').toDataURL()")
    page.page.wait_for_timeout(400)
    assert page.page.evaluate("() => document.getElementById('shapes').toDataURL()") != before
    assert page.faults == []


def test_the_picture_turns_by_keys(page: Opened) -> None:
    look = "() => document.getElementById('sketch').toDataURL()"
    page.page.focus("#sketch")
    before = page.page.evaluate(look)
    page.page.keyboard.press("ArrowLeft")
    turned = page.page.evaluate(look)
    page.page.keyboard.press("Home")
    assert turned != before
    assert page.page.evaluate(look) == before


def test_choices_change_the_plots(page: Opened) -> None:
    text = "() => document.getElementById('gain-total').textContent"
    page.choose("gain-channel", "0")
    before = page.page.evaluate(text)
    page.choose("gain-channel", "1")
    assert page.page.evaluate(text) != before
    title = "(id) => document.getElementById(id).layout.xaxis.title.text"
    assert page.page.evaluate(title, "by-configuration") == "hinge.ry, deg"
    page.choose("speed-cost", "seconds")
    assert page.page.evaluate(title, "speed") == "time of the responses, s"
    page.choose("order", "1")
    assert page.page.evaluate(title, "sigma-0") == "rank, by sigma"
    page.choose("error", "1")
    assert (
        page.page.evaluate("() => document.getElementById('response').layout.yaxis2.title.text")
        == "|error| / |full|, %"
    )
    assert page.faults == []


TRACES = (
    "(id) => document.getElementById(id).data.map((trace) => [trace.name, Array.from(trace.x), Array.from(trace.y)])"
)


def test_marks_of_the_reduction_checks(page: Opened) -> None:
    """Drawn data equal the made data: zeros between the poles, the step's end, the worst frequency."""
    run = large_run(modes=130, inputs=1, outputs=2, configurations=3, points=1500, nodes=60)
    assert run.checks is not None
    said = "(id) => document.getElementById(id).textContent"

    static = page.page.evaluate(TRACES, "static-lack")
    assert len(static) == 1 and static[0][1] == pytest.approx([1e-12, 3e-3])

    page.choose("zero-configuration", "1")
    page.choose("zero-channel", "0")
    pair = run.checks.systems[1].zeros[0]
    zeros = page.page.evaluate(TRACES, "zeros")
    drawn = {name: (x, y) for name, x, y in zeros}
    upper = abs(pair.full[pair.full.imag > 0]) / (2 * np.pi)
    # Packed to a 65 000th of the decades they span.
    assert drawn["full, antiresonance, on the imaginary axis"][0] == pytest.approx(upper, rel=1e-3)
    assert [len(drawn[f"{side}, on the real axis"][0]) for side in ("full", "reduced")] == [1, 1]
    assert drawn["distance from its partner"][1] == pytest.approx(np.full(119, 100 * SHIFT), rel=1e-2)
    hidden = next(x for name, x, _ in zeros if name.startswith("from the nearest"))
    assert len(hidden) == 130 - 119
    assert page.page.evaluate(said, "zero-worst").startswith("119 zeros in the band")

    page.choose("step-configuration", "0")
    page.choose("step-channel", "1")
    step = run.checks.systems[0].step
    curves = {name: y for name, _, y in page.page.evaluate(TRACES, "steps")}
    size = abs(step.full[:, 1, 0]).max()
    assert curves["full"] == pytest.approx(step.full[:, 1, 0], abs=2e-4 * size)
    assert curves["reduced"] == pytest.approx(step.reduced[:, 1, 0], abs=2e-4 * size)
    assert max(map(abs, curves["error"])) == pytest.approx(100 * step.peak[1, 0], rel=1e-2)

    curves = {name: (x, y) for name, x, y in page.page.evaluate(TRACES, "controller-margin")}
    worst = curves["worst frequency"]
    assert worst[0][0] == pytest.approx(run.margins[0].worst_hz, rel=1e-6)
    assert worst[1][0] == pytest.approx(WORST_RATIO, rel=1e-3)
    assert "proven stable" in page.page.evaluate(said, "margin-worst")
    assert page.faults == []


def test_high_gain_modes_are_marked(page: Opened) -> None:
    marks = "a tenth or more of the gains, above the band"
    page.choose("gain-channel", "0")
    found = {name: x for name, x, _ in page.page.evaluate(TRACES, "gains")}
    # The last of 130 modes, 23 % of the gains of the first channel; none of the second.
    assert found[marks] == [pytest.approx(0.5 * 130**1.1, rel=0.02)]
    text = "() => document.getElementById('gain-total').textContent"
    assert "Hz is 23 % of the gains" in page.page.evaluate(text)
    page.choose("gain-channel", "1")
    assert marks not in [name for name, _, _ in page.page.evaluate(TRACES, "gains")]
    assert "No mode above the band is a tenth" in page.page.evaluate(text)


def test_tables_of_health_and_sensitivity(page: Opened) -> None:
    health, cases = (" ".join(page.page.inner_text(f"#{name}").split()) for name in ("health", "sensitivity"))
    assert "string: ✘ 3 limits not met" in health
    for words in (
        "differs by 0.001, relative ✘ the sources disagree",
        "nearly massless dofs 2: 3 rx 4 rx ✘ they cost time steps",
        "motions of negative energy, mass not determined ✘ a large body",
        "rigid modes below 2e-05 Hz ✔",
    ):
        assert words in health
    assert "damping x 5 2 3 2" in cases


@pytest.fixture(scope="module")
def dark(browser: Any, small: Path) -> Iterator[Opened]:
    """The page as it opens on a screen of 1280 by 900 whose user wants dark pages."""
    with opened(browser, small, width=1280, color_scheme="dark") as found:
        yield found


def test_the_first_screen_holds_verdict_error_cost_and_the_worst_response(dark: Opened) -> None:
    dark.page.wait_for_selector("html[data-drawn~=response]", state="attached", timeout=60_000)
    for part in (".badge", ".cards", "#speed", "#response"):
        box = dark.page.locator(part).bounding_box()
        assert box["y"] >= 0 and box["y"] + box["height"] <= 900 and box["x"] + box["width"] <= 1280, part
    titles = """() => ['yaxis', 'yaxis2', 'yaxis3']
      .map((axis) => document.getElementById('response').layout[axis].title.text)"""
    assert dark.page.evaluate(titles) == ["magnitude, rad/(N m)", "|error|, dB", "phase, °"]
    assert dark.page.eval_on_selector("#notes", "(notes) => notes.open") is False
    assert "this model" in dark.page.inner_text("#speed")
    assert dark.faults == []


def test_the_theme_changes_page_plots_and_canvas(dark: Opened) -> None:
    paper = (
        "() => [getComputedStyle(document.body).backgroundColor, document.getElementById('speed').layout.paper_bgcolor]"
    )
    dark.page.wait_for_selector("html[data-drawn~=speed][data-drawn~=sketch]", state="attached", timeout=60_000)
    assert dark.page.evaluate(paper) == ["rgb(20, 24, 29)", "#14181d"]
    sketch = "() => document.getElementById('sketch').toDataURL()"
    night = dark.page.evaluate(sketch)
    dark.page.focus("#theme")
    dark.page.keyboard.press("Enter")
    assert dark.page.evaluate(paper) == ["rgb(255, 255, 255)", "#fff"]
    assert dark.page.evaluate(sketch) != night
    assert dark.faults == []


def test_a_table_that_is_cut_says_so_and_opens(page: Opened) -> None:
    line = page.page.locator("#ranking .scroll + .cut").first
    assert re.fullmatch(r"\d+ of 130 rows fit here", line.locator("span").inner_text())
    line.locator("button").click()
    frame = page.page.locator("#ranking .scroll").first
    assert frame.evaluate("(frame) => frame.scrollHeight - frame.clientHeight") <= 1
    assert line.inner_text().split("\n")[0].startswith("all 130 rows")
    # Tables that fit say nothing.
    assert page.page.locator("#sensitivity .cut:visible").count() == 0


@pytest.fixture(scope="module")
def printed(browser: Any, small: Path) -> Iterator[tuple[Opened, Any]]:
    """The page on a phone that prints at once: plots and their pictures then, or that the page was ready before."""
    with opened(browser, small, width=390) as found:
        drawn = found.page.evaluate(
            """() => {
              if (document.documentElement.dataset.ready) return "too late";
              dispatchEvent(new Event("beforeprint"));
              return [...document.querySelectorAll(".plot")].map((plot) => plot.querySelectorAll("svg").length);
            }"""
        )
        yield found, drawn


def test_a_browser_that_prints_at_once_draws_every_plot(printed: tuple[Opened, Any]) -> None:
    """Printing does not wait for streams: the page unpacks itself without them."""
    found, drawn = printed
    assert drawn == "too late" or (len(drawn) == 15 and min(drawn) > 0)
    same = """async () => {
      const [streamed, now] = [new Uint8Array(await Arrays.inflated("plotly")), Arrays.inflatedNow("plotly")];
      return streamed.length === now.length && streamed.every((byte, k) => byte === now[k]);
    }"""
    assert found.page.evaluate(same)
    assert found.faults == []


def test_a_phone_needs_no_scrolling_sideways(printed: tuple[Opened, Any]) -> None:
    found, drawn = printed
    if drawn == "too late":
        found.draw_all()
    found.page.wait_for_selector("html[data-ready]", state="attached", timeout=60_000)
    found.page.evaluate("dispatchEvent(new Event('afterprint'))")
    assert found.page.evaluate("() => document.documentElement.scrollWidth") == 390


def test_the_page_of_a_sweep_opens(browser: Any, tmp_path: Path) -> None:
    path = tmp_path / "sweep.html"
    limits = {"verify": {"limits": {"frf_error": 0.05}}}
    path.write_text(sweep_page(replace(made_sweep(), provenance={"settings_of_first_point": limits})), encoding="utf-8")
    with opened(browser, path) as found:
        found.page.wait_for_selector("html[data-ready]", state="attached", timeout=60_000)
        # A line for the front, and four points.
        assert found.page.evaluate(MARKS, "sweep") >= 1 + 4
        title = "() => document.getElementById('sweep').layout.xaxis.title.text"
        assert found.page.evaluate(title) == "reduction time, s"
        shown = "() => document.getElementById('sweep').layout.annotations.map((each) => each.text)"
        assert found.page.evaluate(shown) == ["limit 5 %"]
        found.page.select_option("#cost", "operations")
        found.page.select_option("#error", "db_error")
        assert found.page.evaluate(title) == "operations for a simulated second"
        assert found.page.evaluate(shown) == []
        points = "() => [...document.querySelectorAll('#points tbody tr')].map((row) => row.cells[0].textContent)"
        assert found.page.evaluate(points) == ["1", "2", "3", "4", "5"]
        links = "() => [...document.querySelectorAll('#points tbody a')].map((link) => link.getAttribute('href'))"
        assert found.page.evaluate(links) == [f"points/{k}/" for k in range(1, 5)]
        sort = found.page.locator("#points th button", has_text="response error")
        sort.focus()
        found.page.keyboard.press("Enter")
        # A failed point has no error: it stays last in both orders.
        assert found.page.evaluate(points) == ["3", "1", "2", "4", "5"]
        sort.click()
        assert found.page.evaluate(points) == ["4", "1", "2", "3", "5"]
        assert found.page.get_attribute("#points th[aria-sort]", "aria-sort") == "descending"
        assert found.faults == []


def test_marks_of_the_modes(browser: Any, tmp_path: Path) -> None:
    """130 modes, 120 of them kept, in clusters of four, two on the edge of the sensitivity study."""
    path = tmp_path / "report.html"
    run = large_run(modes=130, inputs=1, outputs=1, configurations=1, points=1500, nodes=30)
    path.write_text(render_report(replace(run, projection=None)), encoding="utf-8")
    traces = "() => document.getElementById('sigma-0').data.map((trace) => [trace.name, trace.x.length])"
    with opened(browser, path) as found:
        found.page.wait_for_selector("html[data-ready]", state="attached", timeout=60_000)
        found.page.locator("#sigma-0").scroll_into_view_if_needed()
        found.page.wait_for_selector("html[data-drawn~=sigma-0]", state="attached", timeout=60_000)
        names = found.page.evaluate(traces)
    counts = [count for name, count in names if name == "clusters"]
    assert names[:3] == [["kept", 120], ["left out", 10], ["on the edge", 2]]
    assert counts[:2] == [4, 4]


@pytest.mark.parametrize("kind", ["png", "svg"])
def test_pictures_are_saved(page: Opened, tmp_path: Path, kind: str) -> None:
    for button, name in (
        (f'[data-viewer="shapes"][data-save="{kind}"]', "mode"),
        (f"#speed .modebar-btn[data-title='Save as {kind.upper()}']", "speed"),
    ):
        with page.page.expect_download() as coming:
            page.page.eval_on_selector(
                button, "(button) => button.dispatchEvent(new MouseEvent('click', { bubbles: true }))"
            )
        assert coming.value.suggested_filename == f"{name}.{kind}"
        coming.value.save_as(tmp_path / name)
        start = (tmp_path / name).read_bytes()[:8]
        assert start == b"\x89PNG\r\n\x1a\n" if kind == "png" else start.startswith(b"<svg")
    titles = page.page.evaluate(
        "() => [...document.querySelectorAll('.modebar-btn')].map((button) => button.dataset.title || '')"
    )
    assert not [title for title in titles if re.search("cloud|server|share|edit", title, re.I)]


def test_the_picture_of_the_page_has_its_size(page: Opened, tmp_path: Path) -> None:
    path = tmp_path / "page.png"
    page.page.screenshot(path=path, full_page=True)
    width, height = struct.unpack(">II", path.read_bytes()[16:24])
    # Wider would mean that something hangs out of the page; a page without plots is a third as high.
    assert width == 1300
    assert 8000 < height < 18_000
    assert path.stat().st_size > 250_000


def test_it_prints(page: Opened) -> None:
    assert page.page.pdf(format="A4")[:5] == b"%PDF-"


def test_names_cannot_become_scripts(browser: Any, make_run, tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    hostile = dict.fromkeys(("inputs", "outputs", "compared"), (HOSTILE,))
    run = make_run(name=HOSTILE, bodies=("rotor", HOSTILE), configurations=(HOSTILE, "other"), **hostile)
    path.write_text(render_report(run), encoding="utf-8")
    with opened(browser, path) as found:
        found.draw_all()
        found.choose("configuration", "1")
        assert found.page.evaluate("() => window.stolen || 0") == 0
        assert "reduced2 %" in found.page.inner_text("#selected").replace("\t", "")
        assert found.faults == []


def test_a_run_without_responses(browser: Any, make_run, tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    path.write_text(render_report(make_run(configurations=(), speed=None)), encoding="utf-8")
    with opened(browser, path) as found:
        found.draw_all()
        assert found.page.evaluate(PLOTS) == [["sigma-0", 2], ["timing-bars", 3]]
        assert found.faults == []
