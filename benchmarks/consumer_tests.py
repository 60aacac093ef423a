"""Tests of foreign programs, run one row at a time: the first table of benchmarks/consumers.md.

A test tells its error by pytest's ``record_property("error", value)``. Rows of programs that are not here stay as they
were, and so do those that the command line does not name, if it names any.
"""

from __future__ import annotations

import importlib.metadata
import os
import platform
import re
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "benchmarks" / "consumers.md"
NAME = "tests"
HEAD = ["| program | version | compared | limit | largest error | tests | s |", "|---|---|---|---|---|---|---|"]


def package(name: str) -> str:
    """Version of an installed package, empty if it is not here."""
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return ""


def sources(variable: str) -> str:
    """Last commit of the sources that a variable names, and its date; empty if it names none."""
    path = os.environ.get(variable, "")
    if not path:
        return ""
    folder = Path(path) if Path(path).is_dir() else Path(path).resolve().parent
    command = ["git", "-C", str(folder), "log", "-1", "--format=%h of %cs"]
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip() or "of no commit"


def said(variable: str, version: str) -> str:
    """Version that a program tells, by a pattern; empty if the variable names none."""
    program = os.environ.get(variable, "")
    if not program:
        return ""
    done = subprocess.run([program, "--version"], capture_output=True, text=True, check=False)
    found = re.search(version, done.stdout + done.stderr)
    return found[1] if found else "of unknown version"


@dataclass(frozen=True)
class Row:
    """A program and the tests that hold its files to it.

    Parameters
    ----------
    what : str
        What is compared, and with what.
    limit : str
        Limit of the errors that its tests tell, and of what.
    tests : tuple of str
        Files or tests for pytest.
    version : callable
        Version of the program; empty if it is not here.
    """

    what: str
    limit: str
    tests: tuple[str, ...]
    version: Callable[[], str]


def printed(name: str) -> list[str]:
    """Lines of a part of the page that a command writes."""
    return PAGE.read_text(encoding="utf-8").partition(_begin(name))[2].partition(_END)[0].strip().splitlines()


def print_part(name: str, lines: list[str]) -> None:
    """Replace a part of the page."""
    before, begin, rest = PAGE.read_text(encoding="utf-8").partition(_begin(name))
    if not begin:
        raise SystemExit(f"{PAGE}: it has no line {_begin(name)}")
    text = "\n".join(lines)
    PAGE.write_text(f"{before}{begin}\n\n{text}\n\n{_END}{rest.partition(_END)[2]}", encoding="utf-8")


def _begin(name: str) -> str:
    return f"<!-- {name}: make consumers writes this table -->"


_END = "<!-- end -->"


def by_rules() -> str:
    """No program is needed: the tests hold the rules of its reader or documentation."""
    return "rules of its reader"


ROWS: Mapping[str, Row] = {
    "Exudyn": Row(
        "single bodies, hinged pair, loop and whole scenes: frequencies, slews",
        "1e-4 rms of a spin-up through 115 degrees",
        tuple(f"tests/consumers/test_{name}.py" for name in ("beams", "solids", "frames", "exported_scene")),
        lambda: package("exudyn"),
    ),
    "MBDyn": Row(
        "whole scenes as they are exported: joints and sensors of every kind, spin-up",
        "1e-4 rms of a spin-up through 115 degrees",
        ("tests/consumers/test_exported_mbdyn.py",),
        lambda: (os.environ.get("CMSREDUCE_MBDYN") and "1.7.3") or "",
    ),
    "42": Row(
        "whole scenes as they are exported: sensors of every kind; large motions by 42's own equations",
        "1e-4 rms of every sensor; of every mode through 401 degrees",
        ("tests/consumers/test_exported_42.py", "tests/consumers/test_large_motions_42.py"),
        lambda: sources("CMSREDUCE_42"),
    ),
    "SID reader of EMBS_ModelicaLib": Row(
        "every array of ten files: mean axes and clamped, names such as `Jframe 2`",
        "1e-12 of the largest entry of each array",
        ("tests/consumers/test_embs.py",),
        lambda: sources("CMSREDUCE_EMBS"),
    ),
    "SID reader of PyMBS": Row(
        "every array", "equal to the last bit", ("tests/consumers/test_pymbs.py",), lambda: sources("CMSREDUCE_PYMBS")
    ),
    "fmpy": Row(
        "units of assembled systems and of bodies against exact steps; its checker",
        "1e-10 of the largest output",
        ("tests/write/targets/test_fmi.py",),
        lambda: package("fmpy"),
    ),
    "Simscape": Row(
        "conditions of the block's documentation; response of the finite elements at the frames",
        "1e-8 of the largest force per displacement",
        ("tests/write/targets/test_simscape.py",),
        by_rules,
    ),
    "MBSim": Row(
        "equations that MBSim's source forms from the file, at large deflections; order of its own sample",
        "1e-12 of the largest mass and force of particles",
        ("tests/write/targets/test_mbsim.py",),
        by_rules,
    ),
    "OpenFAST ExtPtfm": Row(
        "response of the finite elements at the interface",
        "1e-8 of the largest force per displacement",
        ("tests/write/targets/test_extptfm.py",),
        by_rules,
    ),
    "examples": Row(
        "`make example-slew`, `-linkage`, `-spinup`: what they print, and the page that they leave",
        "",
        ("tests/examples/test_examples.py",),
        lambda: "of this clone",
    ),
}


def main() -> int:
    """Run the tests of every program that is here, and write the table; 1 if one fails."""
    last = printed(NAME)
    rows, failures = [], 0
    for name, row in ROWS.items():
        version = row.version() if name in (sys.argv[1:] or ROWS) else ""
        if not version:
            absent = f"| {name} | not here | {row.what} | {row.limit} | | | |"
            rows += [line for line in last if line.startswith(f"| {name} |")] or [absent]
            print(f"{name}: not run", flush=True)
            continue
        passed, failed, error, seconds = tested(row.tests)
        failures += failed
        count = f"{passed} passed" + (f", **{failed} failed**" if failed else "")
        rows.append(f"| {name} | {version} | {row.what} | {row.limit} | {error} | {count} | {seconds:.0f} |")
        print(rows[-1], flush=True)
    own = f"cmsreduce {package('cmsreduce')}, Python {platform.python_version()}, {platform.system()}"
    print_part(NAME, [*HEAD, *rows, "", f"Written by {own}."])
    return 1 if failures else 0


def tested(tests: tuple[str, ...]) -> tuple[int, int, str, float]:
    """Numbers of tests that passed and failed, the largest error that they record, and seconds."""
    with tempfile.TemporaryDirectory() as folder:
        path, start = Path(folder) / "tests.xml", time.perf_counter()
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", f"--junitxml={path}", *tests]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        seconds = time.perf_counter() - start
        if not path.exists():
            raise SystemExit(done.stdout + done.stderr)
        suite = ET.parse(path).getroot().find("testsuite")
    assert suite is not None
    failed = int(suite.attrib["failures"]) + int(suite.attrib["errors"])
    if failed:
        print(done.stdout)
    passed = int(suite.attrib["tests"]) - int(suite.attrib["skipped"]) - failed
    errors = [float(each.attrib["value"]) for each in suite.iter("property") if each.attrib["name"] == "error"]
    return passed, failed, f"{max(errors):.1e}" if errors else "", seconds


if __name__ == "__main__":
    raise SystemExit(main())
