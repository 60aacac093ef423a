import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from cmsreduce.report import render_report
from tests.report.conftest import damped
from tests.report.large_run import large_run
from tests.report.unpacking import unpacked

HZ_1, HZ_2 = 1.0, 4.0
HOSTILE = "</script><script>window.stolen = 1</script>"


def packed_to(curve: np.ndarray) -> float:
    """Curves are packed to a 65000th of their range, far below a pixel."""
    return float(np.nanmax(curve) - np.nanmin(curve)) / 65_000


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

    def array(self, where: dict) -> np.ndarray:
        return unpacked(self.scripts[1], where)

    def curve(
        self, configuration: int, channel: int
    ) -> tuple[np.ndarray, np.ndarray, list[np.ndarray], list[np.ndarray]]:
        """Frequencies, full magnitude, that of the reduced models, and what they miss."""
        setting = self.data["settings"][configuration]
        curve = setting["curves"][channel]
        full = self.array(curve["full"])
        base = np.nan_to_num(full, nan=0.0)
        reduced = [base + self.array(where) for where in curve["apart"]]
        hz = self.array(setting["hz"])[self.array(curve["at"]).astype(int)]
        missed = []
        for apart, turned in zip(curve["apart"], curve["turned"], strict=True):
            ratio = 10 ** (self.array(apart) / 20) * np.exp(1j * np.radians(self.array(turned)))
            missed.append(20 * np.log10(np.maximum(abs(ratio - 1), np.finfo(float).eps)))
        return hz, full, reduced, missed


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
    # The larger error is at the second configuration.
    assert page.options["configuration"] == ["spin=45 cone=30 (worst)", "spin=0"]
    channels = ["motor → gyro", "thruster → gyro", "motor → los", "thruster → los"]
    assert page.options["channel"] == ["motor → gyro (worst)", *channels[1:]]
    assert page.data["models"] == ["reduced", "all modes", "first 19"]
    assert [c["label"] for c in page.data["channels"]] == channels
    for label in ("reduced", "all modes (compared)", "first 19 (compared)"):
        assert label in page.words
    labelled = {attrs.get("for") for tag, attrs in page.tags if tag == "label"}
    assert {"configuration", "channel", "error", "figure", "against", "speed-figure", "speed-cost", "order"} == labelled
    assert labelled == set(page.options)


def test_the_worst_channel_of_the_worst_configuration_comes_first(make_run) -> None:
    run = make_run(outputs=("gyro", "los"))
    results = []
    for k, result in enumerate(run.configurations):
        by_channel = np.array([[0.01, 0.02], [0.03 + k, np.nan]])
        own = replace(result.errors["reduced"], channel_errors=by_channel)
        results.append(replace(result, errors={**result.errors, "reduced": own}))
    page = Page(render_report(replace(run, configurations=tuple(results[::-1]))))
    assert page.data["first"] == [0, 2]
    assert page.options["configuration"][0] == "spin=45 cone=30 (worst)"
    assert page.options["channel"][0] == "motor → los (worst)"


def test_channels_have_the_unit_of_their_response(make_run) -> None:
    units = {"input_units": ("N m", "N"), "output_units": ("rad", "m/s", "")}
    page = Page(render_report(make_run(outputs=("gyro", "speed", "mixed"), **units)))
    expected = ["rad/(N m)", "rad/N", "m/(s N m)", "m/(s N)", "", ""]
    assert [channel["unit"] for channel in page.data["channels"]] == expected


def test_phases_are_those_of_the_closed_form(make_run) -> None:
    run = make_run(points=2000)
    page, response = Page(render_report(run)), run.configurations[0].response
    curve = page.data["settings"][0]["curves"][0]
    at, phase = page.array(curve["at"]).astype(int), page.array(curve["phase"])
    for label, turned in zip(("reduced", "first by frequency"), curve["turned"], strict=True):
        drawn = np.exp(1j * np.radians(phase + page.array(turned)))
        H = response.reduced[label][at, 0, 0]
        # Two angles, each packed to a 65000th of a turn at most.
        assert abs(drawn - H / abs(H)).max() < 2 * 2 * np.pi / 65_000


def test_a_broken_limit_names_the_next_step_at_the_head(make_run) -> None:
    head = render_report(make_run(limits={"frf_error": 0.001})).partition("<nav")[0]
    assert "response error 2 % at spin=45 cone=30 is above its limit 0.1 %" in head
    assert "next: " in head
    assert "next: " not in render_report(make_run()).partition("<nav")[0]


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
    # Full and reduced frequency in Hz, full and reduced ratio in per cent, MAC of the shapes.
    assert page.data["settings"][1]["damped"] == [[1.0, 1.001, 0.5, 0.52, 0.9999], [4.0, 4.0, 0.5, 0.5, 1.0]]


def test_a_system_without_damping_shows_no_damping_error(make_run) -> None:
    page = Page(render_report(make_run()))
    assert "damping" not in page.words
    assert page.data["settings"][0]["damped"] is None
    assert len(page.data["figures"]) == len(page.data["settings"][0]["errors"][0]) == 3


def test_curves_are_the_closed_form_and_keep_its_peaks(make_run) -> None:
    run = make_run(points=20_000)
    hz, full, (own, first), _ = Page(render_report(run)).curve(0, 0)
    assert hz.size < 5 * 2 * 700
    w, w_1 = 2 * np.pi * hz.astype(float), 2 * np.pi
    np.testing.assert_allclose(
        first, -10 * np.log10((w_1**2 - w**2) ** 2 + (0.01 * w_1 * w) ** 2), atol=packed_to(full) + packed_to(first)
    )
    # At its resonance 1 / (2 zeta w^2); the grid passes it within a 40th of its half-width.
    assert full.max() == pytest.approx(20 * np.log10(100 / w_1**2), abs=3e-3)
    for packed, label in ((own, "reduced"), (first, "first by frequency")):
        kept = 20 * np.log10(abs(run.configurations[0].response.reduced[label][:, 0, 0]))
        assert (packed.min(), packed.max()) == pytest.approx((kept.min(), kept.max()), abs=2 * packed_to(kept))


def test_a_shifted_resonance_is_missed_by_its_shift_over_its_width(make_run) -> None:
    hz, _, _, (own, _) = Page(render_report(make_run(points=20_000))).curve(0, 0)
    # Near its resonance the response is 1 / (w - w_1 + i zeta w_1): off by shift / |x + shift - i zeta| at distance x,
    # at most shift / zeta = 20 %, where the magnitude is off by less and the phase by the rest.
    assert 10 ** (own[abs(hz - 1) < 0.05].max() / 20) == pytest.approx(1e-3 / 0.005, rel=2e-2)
    # Far below the resonance the magnitude alone is off, by twice the shift on its share of the static response.
    share = (1 / HZ_1**2) / (1 / HZ_1**2 + 0.25 / HZ_2**2)
    assert 10 ** (own[0] / 20) == pytest.approx(2e-3 * share, rel=2e-2)


def test_a_silent_channel_is_a_gap(make_run) -> None:
    page = Page(render_report(make_run()))
    assert np.isnan(page.curve(0, 1)[1]).all()
    assert page.data["settings"][0]["frac"][0] == [0.9999, None]


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
    assert links[0] == "data:,"
    assert all(link.startswith("#") for link in links[1:])
    policy = next(attrs["content"] for _, attrs in page.tags if attrs.get("http-equiv") == "Content-Security-Policy")
    assert policy.startswith("default-src 'none'")
    assert [tag for tag, _ in page.tags].count("script") == 4


def test_names_cannot_become_markup(make_run) -> None:
    hostile = dict.fromkeys(("bodies", "inputs", "outputs", "configurations", "compared"), (HOSTILE,))
    run = make_run(name=HOSTILE, notes=(HOSTILE,), settings={HOSTILE: HOSTILE}, **hostile)
    html = render_report(run)
    page = Page(html)
    assert "<script>window" not in html
    assert len(page.scripts) == 4
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
    assert len(render_report(replace(run, configurations=loud)).encode()) < 4e6


def test_of_many_channels_the_worst_are_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 30 channels at two angles 25 have curves and running sums, those with the largest errors of either kind."""
    monkeypatch.setattr("cmsreduce.report.page.curves._CURVES", 50)
    run = large_run(modes=125, inputs=3, outputs=10, configurations=2, points=800, nodes=30)
    size = np.arange(30.0).reshape(10, 3)
    # Five channels err least in both ways: 24 is the worst in decibels, 29 in the response.
    errors = {"channel_errors": size / 1e3, "channel_db": np.where(size == 24, 9.0, 0.1)}
    told = [replace(c, errors={run.model: replace(c.errors[run.model], **errors)}) for c in run.configurations]
    page = Page(render_report(replace(run, configurations=tuple(told))))
    assert page.data["first"][1] == 29 and page.data["drawn"] == list(range(5, 30))
    for setting in page.data["settings"]:
        assert [k for k, curve in enumerate(setting["curves"]) if curve is not None] == page.data["drawn"]
    for gains in page.data["gains"]:
        assert gains["running"]["n"] == 25 * len(gains["hz"])
    assert "The 25 channels with the largest errors of 30" in page.words


def _in_every_channel(result):
    def spread(H: np.ndarray) -> np.ndarray:
        return np.repeat(H[:, :1, :], H.shape[1], axis=1)

    curves = result.response
    reduced = {label: spread(H) for label, H in curves.reduced.items()}
    return replace(result, response=replace(curves, full=spread(curves.full), reduced=reduced))
