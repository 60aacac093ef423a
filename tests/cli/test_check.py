"""Checks for continuous integration: limits, files for servers, what changed from a baseline."""

from __future__ import annotations

import json
import re
import shutil
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from cmsreduce.cli import main
from tests.sealed import resealed, resealed_summary


def call(*args: object) -> Result:
    return CliRunner().invoke(main, [str(arg) for arg in args])


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory, good_study: Path) -> Path:
    out = tmp_path_factory.mktemp("check") / "out"
    assert call("run", good_study / "study.yaml", "--quiet", "--out", out).exit_code == 0
    return out


@pytest.fixture
def copied(finished: Path, tmp_path: Path) -> Path:
    shutil.copytree(finished, tmp_path / "run", ignore=lambda *_: ["stages"])
    return tmp_path / "run"


def edited(path: Path, name: str, change) -> None:
    """Change a dataset as another run would have: with the frequencies of its summary."""
    with resealed(path) as file:
        file[name][...] = change(file[name][()])
        elastic = slice(file["modes"].attrs["rigid_count"], None)
        hz = file["modes/omega"][elastic] / (2 * np.pi)
    with resealed_summary(path.parent / "summary.json") as facts:
        facts["components"][path.stem]["frequencies_hz"] = hz.tolist()


def line_of(result: Result, figure: str) -> str:
    (line,) = (line for line in result.stdout.splitlines() if re.search(rf"(?<![\w]){re.escape(figure)}: ", line))
    return line


LIMITS = """\
# What the flight model may cost.
max:
  frf_error: 0.5
  orthogonality in M: 1e-9
  panel:
    kept_modes: 12
tolerance:
  frequency: 1e-3
"""


def test_limits_come_from_a_file_and_the_command_line_wins(finished: Path, tmp_path: Path) -> None:
    file = tmp_path / "limits.yaml"
    file.write_text(LIMITS)
    result = call("check", finished, "--limits", file)
    assert result.exit_code == 1
    assert line_of(result, "panel: kept_modes") == "FAIL  panel: kept_modes: 13 (limit 12)"
    assert "(limit 0.5)" in line_of(result, "frf_error") and "hinge=" in line_of(result, "frf_error")
    assert "(limit 1e-09)" in line_of(result, "arm: orthogonality in M")
    assert "arm: kept_modes" not in result.stdout
    assert result.stdout.splitlines()[-1].startswith("1 of ")
    for key in ("panel.kept_modes", "panel: kept_modes"):
        won = call("check", finished, "--limits", file, "--max", f"{key}=13")
        assert won.exit_code == 0 and won.stdout.splitlines()[-1].startswith("all ")


def test_junit_and_markdown_say_the_same(finished: Path, tmp_path: Path) -> None:
    xml, page = tmp_path / "deep" / "check.xml", tmp_path / "check.md"
    result = call("check", finished, "--max", "db_error=1e-9", "--junit", xml, "--markdown", page)
    assert result.exit_code == 1
    lines = [line for line in result.stdout.splitlines() if line.startswith(("pass", "FAIL", "info"))]
    root = ET.parse(xml).getroot()
    every = root.findall("testsuite/testcase")
    cases = [case for case in every if not case.get("name").startswith("proof: ")]
    proofs = json.loads((finished / "summary.json").read_text())["verdict"]["proofs"]
    assert len(every) - len(cases) == len(proofs) > 0
    assert (root.tag, int(root.get("tests")), len(cases)) == ("testsuites", len(every), len(lines))
    assert [case.find("system-out").text for case in cases] == [line[6:] for line in lines]
    (failed,) = (case for case in cases if case.find("failure") is not None)
    assert (failed.get("classname"), failed.get("name")) == ("run", "db_error")
    assert "limit 1e-09" in failed.find("failure").get("message")
    assert {case.get("classname") for case in cases} == {"run", "arm", "panel"}
    skipped = [case for case in cases if case.find("skipped") is not None]
    named = [(case.get("classname") if case.get("classname") != "run" else "", case.get("name")) for case in skipped]
    infos = [line[6:] for line in lines if line.startswith("info")]
    assert len(named) == len(infos)
    assert all(line.startswith(": ".join(filter(None, each)) + ": ") for each, line in zip(named, infos, strict=True))
    text = page.read_text()
    assert "FAIL" in text.splitlines()[0] and text.count("| FAIL |") == 1
    rows = [line for line in text.splitlines() if line.startswith("| ")]
    assert len(rows) == len(lines) + 2 and all(line.count("|") == 7 for line in rows)


def test_a_result_is_what_it_was(finished: Path) -> None:
    for path, baseline in ((finished, finished), (finished / "arm.h5", finished), (finished, finished / "arm.h5")):
        result = call("check", path, "--baseline", baseline)
        assert result.exit_code == 0, result.stdout
        assert "arm: baseline: mode shapes" in result.stdout and "MAC 1.000000" in result.stdout
        assert "arm: baseline: modal integrals" in result.stdout


def test_signs_of_modes_are_no_change(finished: Path, copied: Path) -> None:
    with resealed(copied / "arm.h5") as file:
        sign = np.where(np.arange(file["modes/omega"].size) % 2, 1.0, -1.0)
        deforming = sign[file["modes"].attrs["rigid_count"] :]
        for name in ("dofs/shapes", "outputs/C1", "outputs/C2", "integrals/int_phi", "integrals/int_r_x_phi"):
            file[name][...] *= sign
        file["inputs/B"][...] *= sign[:, None]
        for name in ("phi", "r_cross_phi", "r_phi"):
            file[f"integrals/{name}"][...] *= deforming
        file["integrals/phi_phi"][...] *= np.outer(deforming, deforming)
    result = call("check", copied, "--baseline", finished)
    assert result.exit_code == 0, result.stdout


def heavier(values: np.ndarray) -> np.ndarray:
    return values * 1.001


def stiffer(values: np.ndarray) -> np.ndarray:
    values[9] *= 1.01
    return values


def mixed(values: np.ndarray) -> np.ndarray:
    values[:, 8] = np.cos(0.3) * values[:, 8] + np.sin(0.3) * values[:, 11]
    return values


CHANGES = {
    "amplitude": ("dofs/shapes", lambda v: 1.01 * v, "static flexibility", "0.0201 (limit 0.001) - above all at"),
    "sign of an input": ("inputs/B", lambda v: -v, "inputs and outputs", "(limit 0.001) - of input motor in the"),
    "mass": ("integrals/rigid_mass", heavier, "mass", "0.001 (limit 1e-06)"),
    "frequency": ("modes/omega", stiffer, "frequencies", "0.01 (limit 0.0001) - mode 4:"),
    "shape": ("dofs/shapes", mixed, "mode shapes", "- mode 3 at"),
    "integral": ("integrals/int_phi", lambda v: v + 0.1, "modal integrals", "of int_phi"),
    "damping": ("modes/damping", lambda v: 1.1 * v, "damping", "0.1 (limit 0.001) - of damping"),
    "second order": ("integrals/phi_phi", lambda v: v + 0.1, "modal integrals", "0.1 (limit 0.001) - of phi_phi"),
}


@pytest.mark.parametrize(("name", "change", "figure", "says"), CHANGES.values(), ids=CHANGES)
def test_a_change_is_found_and_named(finished: Path, copied: Path, name, change, figure: str, says: str) -> None:
    edited(copied / "arm.h5", name, change)
    result = call("check", copied, "--baseline", finished)
    assert result.exit_code == 1, result.stdout
    line = line_of(result, f"arm: baseline: {figure}")
    assert line.startswith("FAIL") and says in line
    assert not any(line.startswith("FAIL  panel") for line in result.stdout.splitlines())


def exchanged(run: Path) -> None:
    for old, new in (("arm", "x"), ("panel", "arm"), ("x", "panel")):
        (run / f"{old}.h5").rename(run / f"{new}.h5")


def of_another_run(run: Path) -> None:
    with resealed(run / "panel.h5") as file:
        file["modes/omega"][9] *= 1.01


def system_of_another_run(run: Path) -> None:
    with resealed(run / "system.h5") as file:
        settings = json.loads(file["provenance/settings"][0])
        del file["provenance/settings"]
        file["provenance/settings"] = np.bytes_([json.dumps({**settings, "name": "other"})])


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (exchanged, "arm.h5: it holds component 'panel', not 'arm'"),
        (lambda run: shutil.copy(run / "arm.h5", run / "panel.h5"), "panel.h5: it holds component 'arm', not 'panel'"),
        (of_another_run, "panel.h5: its modes are not those of summary.json"),
        (system_of_another_run, "system.h5: it is of another run than "),
        (lambda run: shutil.copy(run / "arm.h5", run / "system.h5"), "system.h5: this is no system file of a run"),
    ],
    ids=["exchanged", "a body over another", "a body of another run", "system of another run", "body for system"],
)
def test_a_sound_file_of_another_body_or_run_is_refused(copied: Path, change, says: str) -> None:
    change(copied)
    result = call("check", copied)
    assert result.exit_code == 2 and says in result.output


def test_a_limit_in_per_cent(finished: Path) -> None:
    assert "(limit 0.05)" in line_of(call("check", finished, "--max", "frf_error=5 %"), "frf_error")
    assert "(limit 0.5)" in line_of(call("check", finished, "--max", "db_error=0.5 dB"), "db_error")


def test_a_tolerance_lets_a_change_pass(finished: Path, copied: Path) -> None:
    edited(copied / "arm.h5", "modes/omega", stiffer)
    result = call("check", copied, "--baseline", finished, "--tolerance", "frequency=0.02")
    assert result.exit_code == 0, result.stdout


def test_what_is_no_longer_there_is_a_change(finished: Path, copied: Path) -> None:
    """A configuration that the run left out, and an error that it did not measure, without a limit of its own."""
    with resealed_summary(copied / "summary.json") as facts:
        (name,) = [facts["system"].pop()["name"]]
        facts["figures"]["db_error"]["value"] = None
    result = call("check", copied, "--baseline", finished, "--tolerance", "errors=0.01")
    assert result.exit_code == 1
    assert line_of(result, "baseline: configurations lost or new").endswith(f"1 (limit 0) - lost {name}")
    line = line_of(result, "baseline: growth of db_error")
    assert line.startswith("FAIL") and "not measured, was" in line


def test_modes_lost_are_named_by_their_frequencies(finished: Path, good_study: Path, tmp_path: Path) -> None:
    fewer = tmp_path / "fewer"
    made = call("run", good_study / "study.yaml", "--quiet", "--out", fewer, "--set", "balance.keep={modes: {arm: 9}}")
    assert made.exit_code in (0, 1)
    result = call("check", fewer, "--baseline", finished)
    assert result.exit_code == 1
    line = line_of(result, "arm: baseline: modes lost or gained")
    was, now = (json.loads((run / "summary.json").read_text())["components"]["arm"] for run in (finished, fewer))
    lost = set(was["frequencies_hz"]) - set(now["frequencies_hz"])
    assert line.startswith(f"FAIL  arm: baseline: modes lost or gained: {len(lost)} (limit 0)")
    assert f"9 elastic modes, were {was['kept_modes']}" in line
    assert all(f"{hz:.6g}" in line for hz in sorted(lost)[:4])


def test_a_summary_alone_has_frequencies_to_compare(finished: Path, copied: Path) -> None:
    for path in copied.glob("*.h5"):
        path.unlink()
    with resealed_summary(copied / "summary.json") as facts:
        facts["components"]["arm"]["frequencies_hz"][2] *= 1.002
    result = call("check", copied, "--baseline", finished)
    assert result.exit_code == 1
    assert "mode 3" in line_of(result, "arm: baseline: frequencies")
    assert "arm: baseline: mode shapes" not in result.stdout


@pytest.mark.parametrize(
    ("item", "finding"),
    [
        ("integrals/rigid_mass", "momentum of the rigid modes against the rigid mass"),
        ("integrals/phi_phi", "trace of int phi_i phi_j dm against the modal mass"),
    ],
)
def test_a_file_whose_mass_is_not_that_of_its_modes_fails(copied: Path, item: str, finding: str) -> None:
    edited(copied / "arm.h5", item, heavier)
    result = call("check", copied / "arm.h5")
    assert result.exit_code == 1
    line = line_of(result, finding)
    assert line.startswith("FAIL") and float(line.split(": ")[2].split()[0]) == pytest.approx(1e-3, rel=0.01)


BAD = {
    "limits that are not there": (("--limits", "{tmp}/none.yaml"), None, "none.yaml", "No such file"),
    "limits that are no mapping": ((), "- 3\n", "limits.yaml", "mapping"),
    "unknown section": ((), "maximum: {}\n", "limits.yaml:1", "did you mean 'max'"),
    "unknown figure": ((), "max:\n  frf_eror: 1\n", "limits.yaml:2", "did you mean 'frf_error'"),
    "unknown component": ((), "max:\n  arn:\n    kept_modes: 1\n", "limits.yaml:3", "did you mean 'arm.kept_modes'"),
    "no number": ((), "max:\n  frf_error: small\n", "limits.yaml:2", "'frf_error' needs a number"),
    "unknown tolerance in the file": ((), "tolerance: {frequencies: 1}\n", "limits.yaml:1", "did you mean 'frequency'"),
    "unknown tolerance": (("--tolerance", "mac=0.9"), None, "--tolerance mac", "shape"),
    "no value": (("--tolerance", "frequency"), None, "--tolerance frequency", "KEY=VALUE"),
    "not a number": (("--max", "frf_error=nan"), None, "--max frf_error=nan", "KEY=VALUE"),
    "decibels with another unit": (("--max", "db_error=1 Hz"), None, "--max db_error=1 Hz", "such as db_error=1"),
    "no limit at all": (("--max", "frf_error=inf"), None, "--max frf_error=inf", "finite number"),
    "per cent without a sign": (("--max", "frf_error=5"), None, "--max frf_error=5: 5 is 500 %", "write '500 %'"),
    "per cent in the file": ((), "max: {nrfd: 1}\n", "limits.yaml:1: 'nrfd': 1 is 100 %", "write '100 %'"),
    "no baseline": (("--baseline", "{tmp}/none"), None, "none", "no summary.json"),
    "damaged baseline": (("--baseline", "{tmp}/bad.h5"), None, "bad.h5", "damaged"),
    "another body": (("--baseline", "{run}/panel.h5"), None, "--baseline", "it holds panel, but"),
    "no place for the file": (("--junit", "{run}/arm.h5/x.xml"), None, "x.xml", "cannot be written"),
}


@pytest.mark.parametrize(("args", "limits", "first", "second"), BAD.values(), ids=BAD)
def test_bad_input_exits_2_and_says_where(
    finished: Path, tmp_path: Path, args: tuple[str, ...], limits: str | None, first: str, second: str
) -> None:
    (tmp_path / "bad.h5").write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(80))
    options = [arg.format(tmp=tmp_path, run=finished) for arg in args]
    if limits is not None:
        (tmp_path / "limits.yaml").write_text(limits)
        options += ["--limits", str(tmp_path / "limits.yaml")]
    result = call("check", finished / "arm.h5" if "another" in second or "it holds" in second else finished, *options)
    assert result.exit_code == 2, result.output
    assert result.stderr.startswith("error: ") and result.stderr.count("\n") == 1, result.stderr
    assert first in result.stderr and second in result.stderr, result.stderr
