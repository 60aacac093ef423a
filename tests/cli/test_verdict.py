"""The verdict: not measured is broken, no limit is not checked, and every command says the same."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from cmsreduce.cli import main
from tests.pipeline.study import ARM, CANTILEVER, PANEL, write_study


def call(*args: object) -> Result:
    return CliRunner().invoke(main, [str(arg) for arg in args])


@pytest.fixture(scope="module")
def cantilever(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bar held at its root, shaken and measured in two directions that do not couple."""
    return write_study(tmp_path_factory.mktemp("cantilever"), CANTILEVER)


@pytest.fixture
def outcome(cantilever: Path, tmp_path: Path):
    """Run with keys: exit code, first line and summary; `check`, `report` and the page must say the same."""

    def run(*keys: str, study: Path = cantilever) -> tuple[int, str, dict[str, Any]]:
        options = [part for key in ("balance=null", *keys) for part in ("--set", key)]
        out = tmp_path / "out"
        result = call("run", study, "--out", out, "--verbose", *options)
        assert result.exit_code in (0, 1), result.output
        facts = json.loads((out / "summary.json").read_text())
        word = facts["verdict"]["word"]
        xml, page = tmp_path / "check.xml", tmp_path / "check.md"
        checked = call("check", out, "--junit", xml, "--markdown", page, "--json")
        assert checked.exit_code == result.exit_code, checked.output
        assert json.loads(checked.stdout)["verdict"] == word
        assert json.loads(call("report", out, "--json").stdout)["verdict"] == word
        assert page.read_text().splitlines()[0].endswith(f": {word}")
        properties = {each.get("name"): each.get("value") for each in ET.parse(xml).iter("property")}
        assert properties["verdict"] == word
        assert f"<title>{facts['name']}: {word}</title>" in (out / "report.html").read_text()
        assert facts["passed"] is (word == "PASS")
        assert result.exit_code == (1 if word == "FAIL" else 0)
        lines = result.stdout.splitlines()
        first = next(line for line in lines if line.startswith(f"{facts['name']}: "))
        assert first.startswith(f"{facts['name']}: {word}: ")
        return result.exit_code, result.stdout, facts

    return run


UNMEASURED = {
    "no sensors": (("scene.sensors={}", "verify.limits={frf_error: 0.5, nrfd: 0.5}"), "the scene has no sensors", 2),
    "no actuators": (("scene.actuators={}", "verify.limits={db_error: 50}"), "the scene has no actuators", 1),
    "neither": (
        ("scene.actuators={}", "scene.sensors={}", "verify.limits={frequency_error: 100 %}"),
        "the scene has no actuators and no sensors",
        1,
    ),
    "nothing but rounding": (
        (
            "scene.actuators={lift: {at: arm.5, force: [0, 0, 1]}}",
            "scene.sensors={across: {at: arm.4, measure: y}}",
            "verify.limits={frf_error: 100 %, db_error: 100, peak_error: 100 %, zero_error: 100 %, gain_error: 100 %}",
        ),
        "no channel has an elastic response",
        5,
    ),
}


@pytest.mark.parametrize(("keys", "reason", "count"), UNMEASURED.values(), ids=UNMEASURED)
def test_a_limit_that_cannot_be_measured_is_broken(outcome, keys: tuple[str, ...], reason: str, count: int) -> None:
    code, text, facts = outcome(*keys)
    assert code == 1
    named = facts["verdict"]["not_measured"]
    assert len(named) == count and all(reason in why for why in named.values()), named
    assert f"not measured: {reason}" in " ".join(text.split())


@pytest.mark.parametrize("keys", [(), ("verify={}",), ("verify={}", "scene.sensors={}")], ids=["no verify", "", "mute"])
def test_without_limits_nothing_is_checked(outcome, keys: tuple[str, ...]) -> None:
    code, text, facts = outcome(*keys)
    assert (code, facts["verdict"]["word"], facts["passed"]) == (0, "not checked", False)
    assert "PASS:" not in text


def test_a_limit_given_to_check_makes_a_verdict(cantilever: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert call("run", cantilever, "--quiet", "--out", out, "--set", "verify={}").exit_code == 0
    assert ": not checked: " in call("check", out).stdout.splitlines()[0]
    assert ": PASS: " in call("check", out, "--max", "frf_error=0.5").stdout.splitlines()[0]
    assert call("check", out, "--max", "frf_error=1e-12").exit_code == 1


def test_modes_below_the_band_are_not_counted(outcome) -> None:
    """Its first mode, of 120 Hz, is below; Guyan on the tip has one mode in each plane, none in this band."""
    _, _, facts = outcome("reduce={method: guyan}", "scene.band=[200 Hz, 1500 Hz]", "verify.limits={modes_lost: 2}")
    row = facts["configurations"][0]
    assert row["modes_full"] == len(row["modes_lost"]) > 2 and row["modes_reduced"] == 0


def test_no_damping_meets_a_limit_on_its_error(outcome) -> None:
    code, _, facts = outcome("components.arm.damping=null", "verify.limits={damping_error: 1e-9}")
    assert code == 0 and facts["verdict"]["word"] == "PASS"
    figure = facts["figures"]["damping_error"]
    assert figure["value"] == 0.0 and figure["where"] == "neither model has damping"


def test_a_set_without_the_modes_of_the_band_fails(outcome) -> None:
    """Guyan on the tip alone has one mode in each plane, both far off; the bar has many more."""
    keys = "reduce={method: guyan}", "scene.band=1500 Hz"
    code, _, facts = outcome(*keys, "verify.limits={frequency_error: 0.5}")
    assert code == 1
    assert "the reduced model lacks" in facts["verdict"]["not_measured"]["frequency_error"]
    row = facts["configurations"][0]
    assert len(row["modes_lost"]) == row["modes_full"] - len(row["modes"]) > 2
    assert all(mode["body"] == "arm" and mode["energy_share"] == pytest.approx(1.0) for mode in row["modes_lost"])
    code, _, facts = outcome(*keys, "verify.limits={modes_lost: 2}")
    assert code == 1 and facts["verdict"]["broken"] == ["modes_lost"]


def test_modes_left_out_on_purpose_are_named_and_pass(outcome) -> None:
    """Without a load across, the modes of that plane are not needed; only a limit on their number fails the run."""
    keys = (
        "balance={rank: gregory, keep: {frf_error: 1e-3}}",
        "scene.band=800 Hz",
        "scene.actuators={lift: {at: arm.5, force: [0, 0, 1]}}",
        "scene.sensors={up: {at: arm.5, measure: z}}",
    )
    code, text, facts = outcome(*keys, "verify.limits={frequency_error: 0.01, frf_error: 0.05}")
    assert code == 0
    lost = facts["configurations"][0]["modes_lost"]
    assert lost and all(mode["peak_share"] < 1e-3 for mode in lost)
    assert "modes lost" in text and f"{lost[0]['hz']:.5g} Hz" in text
    assert outcome(*keys, "verify.limits={modes_lost: 0}")[0] == 1


def test_a_far_mode_that_no_channel_sees_is_named(outcome) -> None:
    """Without one free mode across, the first frequency across is far off; the lift and its sensor do not see it."""
    code, text, facts = outcome(
        "reduce={method: macneal-rubin, cutoff: 12}",
        "balance={keep: {arm: [1, 3-17]}}",
        "scene.actuators={lift: {at: arm.5, force: [0, 0, 1]}}",
        "scene.sensors={up: {at: arm.5, measure: z}}",
        "verify.limits={frf_error: 1e-6}",
    )
    assert code == 0 and facts["worst"]["frequency_error"] > 0.1
    # That along the lift, 20.644 Hz, times the root of the ratio of the second moments of area, 2.
    assert facts["figures"]["frequency_error"]["where"] == "as built: 29.195 Hz (100% in arm; no channel sees it)"
    assert facts["figures"]["damping_error"]["where"] == facts["figures"]["frequency_error"]["where"]
    assert "29.195 Hz (100% in arm; no channel sees it)" in " ".join(text.split())


def test_the_worst_channel_stands_beside_the_sum(outcome) -> None:
    """Shaken across with a thousandth of the effect of the lift: the sum hides a channel whose modes are left out."""
    keys = (
        "scene.band=800 Hz",
        "balance={keep: {modes: {arm: 2}}, rank: gregory}",
        "scene.sensors={both: {rows: {arm.5.z: 1.0}}, weak: {rows: {arm.5.y: 1.0e-3}}}",
    )
    code, text, facts = outcome(*keys, "verify.limits={frf_error: 5000 %}")
    channels = {(row["input"], row["output"]): row for row in facts["configurations"][0]["channels"]}
    judged = [row["frf_error"] for row in channels.values() if row["judged"]]
    assert facts["figures"]["channel_error"]["value"] == pytest.approx(max(judged)) and code == 0
    assert f"{facts['figures']['channel_error']['where'].split(', ')[1]}" in text
    assert outcome(*keys, "verify.limits={frf_error: 5000 %, channel_error: 1e-6}")[2]["verdict"]["broken"] == [
        "channel_error"
    ]


def test_rounding_across_is_no_channel_and_is_named(outcome) -> None:
    """Lift and push do not couple in this bar: neither 2025 % nor zeros lost come of it."""
    code, text, facts = outcome("scene.band=800 Hz", "verify.limits={channel_error: 0.2, zeros_lost: 0}")
    assert code == 0, text
    (silent,) = facts["channels_left_out"].values()
    assert sorted(silent) == ["lift to across", "push to up"]
    assert "channels left out (no elastic response" in text and "lift to across" in text


ARTICULATED = (
    """\
name: elbow
output: {output}
components:
"""
    + ARM
    + PANEL
    + """\
scene:
  band: 60 Hz
  ground: arm.root
  joints:
    hinge: {{connect: [arm.tip, panel.root], free: [rx]}}
  articulation: {{hinge: [0, 90, 180 deg]}}
  actuators: {{motor: {{joint: hinge, dof: rx}}, lift: {{at: panel.6, force: [0, 0, 1]}}}}
  sensors: {{probe: {{at: panel.4, measure: [y, z]}}}}
reduce: {{method: craig-bampton, cutoff: 4}}
verify:
  frf: {{points: 60}}
  limits: {{frf_error: 0.2}}
"""
)


@pytest.fixture(scope="module")
def elbow(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_study(tmp_path_factory.mktemp("elbow"), ARTICULATED)


def test_errors_between_the_angles_are_measured_without_project(outcome, elbow: Path) -> None:
    code, text, facts = outcome(study=elbow)
    assert code == 0, text
    between = facts["between"]
    assert sorted(between["errors"]) == ["midpoint hinge.rx=135", "midpoint hinge.rx=45"]
    figure = facts["figures"]["frf_error between the sampled configurations"]
    assert figure["value"] == max(between["errors"].values()) and figure["limit"] == 0.2
    # The same angle in the scene has the same error, to the digits of a coarser grid.
    _, _, there = outcome("scene.articulation={hinge: [45, 135 deg]}", "verify.between=0", study=elbow)
    rows = {row["angles"]["hinge"]: row["frf_error"] for row in there["configurations"]}
    for angle, error in rows.items():
        assert between["errors"][f"midpoint hinge.rx={angle:.0f}"] == pytest.approx(error, rel=0.1)
    assert any("0 of 1 midpoint configurations" in note for note in there["notes"])


def test_an_error_between_the_angles_breaks_the_limit(outcome, elbow: Path) -> None:
    """Of a model that is judged at its angles with a limit just above its error there."""
    _, _, facts = outcome(study=elbow)
    sampled, between = facts["worst"]["frf_error"], max(facts["between"]["errors"].values())
    limit = 0.5 * (sampled + between)
    code, _, facts = outcome(f"verify.limits={{frf_error: {limit!r}}}", study=elbow)
    assert code == 1
    which = "frf_error between the sampled configurations" if between > sampled else "frf_error"
    assert facts["verdict"]["broken"] == [which]


def test_proofs_of_the_mode_count_are_stated(outcome) -> None:
    _, text, facts = outcome("verify={}")
    proofs = {(each["subject"], each["what"]): each for each in facts["verdict"]["proofs"]}
    count = proofs["arm", "mode count"]
    assert count["state"] == "proven" and count["digits"] > 6
    assert "mode count of arm" in next(line for line in text.splitlines() if line.startswith("proven"))
    _, text, facts = outcome("verify={}", "reduce={method: guyan}")
    assert "mode count: arm" in facts["verdict"]["unproven"]
    assert "unproven  mode count of arm: its mode set computes no normal modes" in text
