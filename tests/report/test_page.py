import base64
import json
import re
import shutil
import subprocess
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from cmsreduce.model import RunResult
from cmsreduce.report import render_report
from tests.report.conftest import damped

HZ_1, HZ_2 = 1.0, 4.0
HOSTILE = "</script><script>window.stolen = 1</script>"


class Page(HTMLParser):
    """Elements, texts and scripts of a page."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text: list[str] = []
        self.scripts: list[str] = []
        self.options: dict[str, list[str]] = {}
        self._open: list[str] = []
        self._select = ""
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        self._open.append(tag)
        if tag == "script":
            self.scripts.append("")
        elif tag == "select":
            self._select = dict(attrs)["id"] or ""
        elif tag == "option":
            self.options.setdefault(self._select, []).append("")

    def handle_endtag(self, tag: str) -> None:
        while self._open and self._open.pop() != tag:
            pass

    def handle_data(self, data: str) -> None:
        inside = self._open[-1] if self._open else ""
        if inside == "script":
            self.scripts[-1] += data
        elif inside == "option":
            self.options[self._select][-1] += data
        elif inside != "style":
            self.text.append(data)

    @property
    def words(self) -> str:
        return re.sub(r"\s+", " ", " ".join(self.text))

    @property
    def data(self) -> dict:
        return json.loads(self.scripts[0])


def unpacked(text: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), dtype="<f4")


def test_header_says_the_verdict_and_the_result(make_run) -> None:
    words = Page(render_report(make_run())).words
    assert "✔ PASS" in words
    assert "✘ FAIL" not in words
    assert "2 elastic modes → 1 kept; worst response error 2 % at spin=45 cone=30" in words
    words = Page(render_report(make_run(limits={"db_error": 0.1}))).words
    assert "✘ FAIL" in words
    assert "decibel error 0.125 dB at spin=0 is above its limit 0.1 dB" in words


def test_every_configuration_channel_and_model_is_there(make_run) -> None:
    run = make_run(outputs=("gyro", "los"), compared=("all modes", "first 19"))
    page = Page(render_report(run))
    assert page.options["configuration"] == ["spin=0", "spin=45 cone=30"]
    assert page.options["channel"] == ["motor → gyro", "thruster → gyro", "motor → los", "thruster → los"]
    assert page.data["models"] == ["reduced", "all modes", "first 19"]
    assert [c["label"] for c in page.data["channels"]] == page.options["channel"]
    for label in ("reduced", "all modes (compared)", "first 19 (compared)"):
        assert label in page.words
    labelled = {attrs.get("for") for tag, attrs in page.tags if tag == "label"}
    assert {"configuration", "channel", "error", "figure", "order"} == labelled == set(page.options)


def test_tables_hold_the_figures(make_run) -> None:
    words = Page(render_report(make_run())).words
    for figure in (
        "spin=0 9 (2) 4 (1) reduced 1 % 0.125 dB 0.1 %",
        "first by frequency 75 % 24 dB 0 %",
        "3 dofs → 3 basis columns (craig-bampton) → 1 rigid and 2 elastic modes → 1 elastic kept",
        "1 0 rigid yes rigid",
        "2 1 fixed 1.5 1.267 0.0067 yes among the first by gregory",
        "3 4 constraint 0.01979 0.25 close no",
        "rotor 0.012 s 1.500 s 0.250 s 1.762 s 87 MiB",
        "took 2.000 s, those of the reduced system 0.100 s over the same frequencies: 20 times as fast",
        "rotor orthogonality in M 3e-16 1e-08 ✔ PASS",
        "bodies/rotor.op4 stiffness KAA " + "5e" * 32,
        "rotor is represented in the full system by all modes",
        "units were taken as SI",
        '"band": "10 Hz"',
    ):
        assert figure in words


def test_damping_ratios_of_a_damped_system(make_run) -> None:
    run = make_run()
    pairs = damped(0.001, 0.04)
    results = tuple(
        replace(result, errors={label: replace(found, damped=pairs) for label, found in result.errors.items()})
        for result in run.configurations
    )
    page = Page(render_report(replace(run, configurations=results, limits={"damping_error": 0.03})))
    assert "spin=0 9 (2) 4 (1) reduced 1 % 0.125 dB 0.1 % 4 %" in page.words
    assert "damping error 4 % at spin=0 is above its limit 3 %" in page.words
    assert "Complex modes and damping ratios in this configuration" in page.words
    assert [figure["label"] for figure in page.data["figures"]][-1] == "damping error"
    # Full and reduced frequency in Hz, full and reduced ratio in per cent, likeness of shapes.
    assert page.data["settings"][1]["damped"] == [[1.0, 1.001, 0.5, 0.52, 0.9999], [4.0, 4.0, 0.5, 0.5, 1.0]]


def test_a_system_without_damping_shows_no_damping_error(make_run) -> None:
    page = Page(render_report(make_run()))
    assert "damping" not in page.words
    assert page.data["settings"][0]["damped"] is None
    assert len(page.data["figures"]) == len(page.data["settings"][0]["errors"][0]) == 3


def test_curves_are_the_closed_form_and_keep_its_peaks(make_run) -> None:
    run = make_run(points=20_000)
    curve = Page(render_report(run)).data["settings"][0]["curves"][0]
    hz, full, (own, first) = unpacked(curve["hz"]), unpacked(curve["full"]), map(unpacked, curve["reduced"])
    assert hz.size < 5 * 2 * 700
    w, w_1 = 2 * np.pi * hz.astype(float), 2 * np.pi
    np.testing.assert_allclose(first, -10 * np.log10((w_1**2 - w**2) ** 2 + (0.01 * w_1 * w) ** 2), atol=1e-3)
    # At its resonance 1 / (2 zeta w^2); the grid passes it within a 40th of its half-width.
    assert full.max() == pytest.approx(20 * np.log10(100 / w_1**2), abs=3e-3)
    for packed, label in ((own, "reduced"), (first, "first by frequency")):
        kept = 20 * np.log10(abs(run.configurations[0].response.reduced[label][:, 0, 0]))
        assert (packed.min(), packed.max()) == (np.float32(kept.min()), np.float32(kept.max()))


def test_a_shifted_resonance_is_missed_by_its_shift_over_its_width(make_run) -> None:
    curve = Page(render_report(make_run(points=20_000))).data["settings"][0]["curves"][0]
    hz, own = unpacked(curve["hz"]), unpacked(curve["missed"][0])
    # Near its resonance the response is 1 / (w - w_1 + i zeta w_1): off by shift / |x + shift - i zeta| at distance x,
    # at most shift / zeta = 20 %, where the magnitude is off by less and the phase by the rest.
    assert 10 ** (own[abs(hz - 1) < 0.05].max() / 20) == pytest.approx(1e-3 / 0.005, rel=2e-2)
    # Far below the resonance the magnitude alone is off, by twice the shift on its share of the static response.
    share = (1 / HZ_1**2) / (1 / HZ_1**2 + 0.25 / HZ_2**2)
    assert 10 ** (own[0] / 20) == pytest.approx(2e-3 * share, rel=2e-2)


def test_a_silent_channel_is_a_gap(make_run) -> None:
    data = Page(render_report(make_run())).data
    assert np.isnan(unpacked(data["settings"][0]["curves"][1]["full"])).all()
    assert data["settings"][0]["frac"][0] == [0.9999, None]


def test_errors_by_configuration_are_in_the_units_shown(make_run) -> None:
    frf, db, _ = Page(render_report(make_run())).data["figures"]
    assert frf["values"] == [[1.0, 2.0], [75.0, 75.0]]
    assert (frf["limit"], frf["unit"], db["limit"], db["unit"]) == (5.0, "%", 1.0, "dB")


def test_frequency_pairs_carry_their_shift(make_run) -> None:
    assert Page(render_report(make_run())).data["settings"][0]["pairs"] == [
        [1.0, 1.001, 0.1, 1.0],
        [4.0, 4.004, 0.1, 1.0],
    ]


def test_the_page_fetches_nothing(make_run) -> None:
    page = Page(render_report(make_run()))
    links = [attrs[key] for _, attrs in page.tags for key in ("src", "href", "action", "data") if key in attrs]
    assert links == ["data:,"]
    policy = next(attrs["content"] for _, attrs in page.tags if attrs.get("http-equiv") == "Content-Security-Policy")
    assert policy.startswith("default-src 'none'")
    assert [tag for tag, _ in page.tags].count("script") == 3


def test_names_cannot_become_markup(make_run) -> None:
    hostile = dict.fromkeys(("bodies", "inputs", "outputs", "configurations", "compared"), (HOSTILE,))
    run = make_run(name=HOSTILE, notes=(HOSTILE,), settings={HOSTILE: HOSTILE}, **hostile)
    html = render_report(run)
    page = Page(html)
    assert "<script>window" not in html
    assert len(page.scripts) == 3
    assert page.options["configuration"] == [HOSTILE]
    assert page.data["components"][0]["name"] == page.data["models"][1] == page.data["configurations"][0] == HOSTILE


@pytest.mark.parametrize("compared", [(), ("other",)])
def test_nothing_verified(make_run, compared: tuple[str, ...]) -> None:
    page = Page(render_report(make_run(configurations=(), compared=compared, speed=None, limits={})))
    assert "No response was verified" in page.words
    assert "The speed of the responses was not measured" in page.words
    assert set(page.options) == {"order"}
    assert "among the first by gregory" in page.words


def test_no_flexible_body(make_run) -> None:
    assert "The scene has no flexible body" in Page(render_report(make_run(bodies=(), configurations=()))).words


def test_infinite_errors_are_words_and_gaps(make_run) -> None:
    run = make_run(configurations=("only",), compared=())
    only = run.configurations[0]
    run = replace(
        run, configurations=(replace(only, errors={"reduced": replace(only.errors["reduced"], frf_error=np.inf)}),)
    )
    page = Page(render_report(run))
    assert "worst response error infinite at only" in page.words
    assert page.data["figures"][0]["values"] == [[None]]


def test_a_large_run_stays_small(make_run) -> None:
    run = make_run(
        inputs=("motor",),
        outputs=("rx", "ry", "rz"),
        configurations=tuple(f"spin={k}" for k in range(8)),
        compared=("all modes", "first 19"),
        points=3000,
    )
    # Every channel carries the curves, so that nothing is small for being silent.
    loud = tuple(_in_every_channel(c) for c in run.configurations)
    assert len(render_report(replace(run, configurations=loud)).encode()) < 7e6


def _in_every_channel(result):
    def spread(H: np.ndarray) -> np.ndarray:
        return np.repeat(H[:, :1, :], H.shape[1], axis=1)

    curves = result.response
    reduced = {label: spread(H) for label, H in curves.reduced.items()}
    return replace(result, response=replace(curves, full=spread(curves.full), reduced=reduced))


PROBE = """
<script>
addEventListener("load", () => setTimeout(() => {
  const plots = [...document.querySelectorAll(".js-plotly-plot")];
  const before = document.getElementById("selected") ? document.getElementById("selected").textContent : "";
  const select = document.getElementById("configuration");
  if (select) { select.value = "1"; select.dispatchEvent(new Event("change")); }
  const after = select ? document.getElementById("selected").textContent : "";
  const found = { faults: window.faults, traces: plots.map((plot) => plot.data.length), before, after,
    lines: document.querySelectorAll(".cartesianlayer .js-line").length, stolen: window.stolen || 0,
    bars: document.querySelectorAll(".barlayer .point").length,
    buttons: [...document.querySelectorAll(".modebar-btn")].map((button) => button.dataset.title) };
  const turned = (id) => {
    const choice = document.getElementById(id);
    if (!choice) return [];
    choice.value = "1";
    choice.dispatchEvent(new Event("change"));
    return plots.map((plot) => [plot.data.length, (plot.layout.yaxis2 || plot.layout.xaxis).title?.text]);
  };
  found.relative = turned("error");
  found.ranked = turned("order");
  found.bars_ranked = plots.slice(-1)[0].data.map((trace) => [...trace.x]);
  const place = document.createElement("pre");
  place.id = "probe";
  place.textContent = JSON.stringify(found);
  document.body.append(place);
}, 300));
</script>
"""
LISTENER = """<script>window.faults = [];
addEventListener("error", (event) => window.faults.push(event.message));
addEventListener("securitypolicyviolation", (event) => window.faults.push(event.violatedDirective));
for (const kind of ["error", "warn"]) console[kind] = (...words) => window.faults.push(words.join(" "));
</script>"""


def opened(run: RunResult, folder: Path) -> dict:
    """What a browser finds in the page after it is loaded and the second configuration is chosen."""
    html = render_report(run).replace("<body>", "<body>" + LISTENER).replace("</body>", PROBE + "</body>")
    path = folder / "report.html"
    path.write_text(html, encoding="utf-8")
    options = ["--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={folder / 'profile'}"]
    dump = subprocess.run(
        ["chromium", *options, "--virtual-time-budget=20000", "--dump-dom", path.as_uri()],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    ).stdout
    page = Page(dump[dump.rindex('<pre id="probe">') :])
    return json.loads("".join(page.text))


@pytest.mark.chromium
@pytest.mark.skipif(shutil.which("chromium") is None, reason="chromium is not on the PATH")
def test_a_browser_draws_every_plot(make_run, tmp_path: Path) -> None:
    found = opened(make_run(bodies=("rotor", HOSTILE), compared=(HOSTILE,)), tmp_path)
    assert found["faults"] == []
    # full, two models, their errors and the limit; two models; kept and left out of each body.
    assert found["traces"] == [6, 2, 2, 2]
    assert found["lines"] == 8
    # The limit is one of decibels, and is not drawn on the error in per cent.
    assert found["relative"][0] == [5, "|error| / |full|, %"]
    assert [title for _, title in found["ranked"][2:]] == ["rank, by sigma"] * 2
    assert found["bars_ranked"] == [[1], [2]]
    assert found["bars"] == 4
    assert "reduced1 %" in found["before"]
    assert "reduced2 %" in found["after"]
    assert found["stolen"] == 0
    assert not [title for title in found["buttons"] if title and re.search("cloud|server|share|edit", title, re.I)]


@pytest.mark.chromium
@pytest.mark.skipif(shutil.which("chromium") is None, reason="chromium is not on the PATH")
def test_a_browser_opens_a_run_without_responses(make_run, tmp_path: Path) -> None:
    found = opened(make_run(configurations=(), speed=None), tmp_path)
    assert (found["faults"], found["traces"]) == ([], [2])
