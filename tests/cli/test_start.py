"""Starting: quick, without heavy libraries, with help for every command, and plain lines in a log."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

import cmsreduce
from cmsreduce.cli import main
from cmsreduce.config import load_pipeline

PROGRAM = [sys.executable, "-m", "cmsreduce.cli"]
HEAVY = (
    "numpy", "scipy", "pandas", "plotly", "matplotlib", "h5py", "pydantic", "pyyeti", "meshio", "control", "rich",
    # Reading a package's version takes as long as the rest of the start.
    "importlib.metadata",
)  # fmt: skip


# What takes as long to load as a small body's whole reduction.
NOT_OF_A_PLAIN_RUN = (
    "scipy.optimize", "scipy.stats", "scipy.special", "scipy.fft", "scipy.spatial", "scipy.signal", "scipy.integrate",
    "scipy.interpolate", "pandas", "matplotlib", "meshio", "control", "pyyeti.nastran", "plotly.offline", "distributed",
    "numba",
)  # fmt: skip
ROOT = Path(__file__).parents[2]


def commands() -> dict[str, click.Command]:
    return main.commands


def test_help_comes_at_once() -> None:
    seconds = []
    for _ in range(3):
        before = os.times()
        said = subprocess.run([*PROGRAM, "--help"], capture_output=True, text=True, check=True)
        after = os.times()
        # Processor time, which other programs on the machine lengthen little.
        seconds.append(after.children_user + after.children_system - before.children_user - before.children_system)
    assert min(seconds) < 0.3
    assert "Exit codes" in said.stdout
    assert all(re.search(rf"^  {name}\b", said.stdout, re.M) for name in commands())


def test_the_command_line_loads_no_heavy_library() -> None:
    look = f"import sys, cmsreduce.cli; print([name for name in {HEAVY!r} if name in sys.modules])"
    said = subprocess.run([sys.executable, "-c", look], capture_output=True, text=True, check=True)
    assert said.stdout.strip() == "[]"


@pytest.mark.parametrize("pipeline", ["study", "galileo"])
def test_a_plain_run_loads_no_library_that_it_does_not_use(pipeline: str, study: Path, tmp_path: Path) -> None:
    """Bodies from OP4 files; nothing is verified."""
    file = study if pipeline == "study" else ROOT / "pipelines" / "galileo.yaml"
    asked = ["run", str(file), "--out", str(tmp_path / "out"), "--quiet", "--set", "verify=null"]
    look = (
        "import sys\nfrom cmsreduce.cli import main\n"
        f"try: main({asked!r})\nexcept SystemExit as end: assert end.code == 0\n"
        f"print([name for name in {NOT_OF_A_PLAIN_RUN!r} if name in sys.modules])"
    )
    said = subprocess.run([sys.executable, "-c", look], capture_output=True, text=True, check=True)
    assert said.stdout.strip() == "[]"
    assert (tmp_path / "out" / "report.html").is_file()


def test_a_run_does_without_the_libraries_of_large_bodies_and_pictures(study: Path, tmp_path: Path) -> None:
    """Its verdict is the same: SuperLU takes the place of the multifrontal solver."""
    asked = ["run", str(study), "--out", str(tmp_path / "out"), "--quiet"]
    absent = ["numba", "llvmlite", "pymetis", "sksparse", "pandas", "matplotlib"]
    call = f"import sys; sys.modules.update(dict.fromkeys({absent!r}))\nfrom cmsreduce.cli import main; main({asked!r})"
    said = subprocess.run([sys.executable, "-c", call], capture_output=True, text=True, check=False)
    assert said.returncode == 0, said.stderr
    assert "plotly" in (tmp_path / "out" / "report.html").read_text()


def test_version() -> None:
    assert CliRunner().invoke(main, ["--version"]).stdout == f"cmsreduce, version {cmsreduce.__version__}\n"


@pytest.mark.parametrize("name", commands())
def test_every_command_explains_itself(name: str) -> None:
    result = CliRunner().invoke(main, [name, "--help"])
    assert result.exit_code == 0
    command = commands()[name]
    assert command.help and command.help.strip().split("\n")[0] in " ".join(result.stdout.split())
    described = [p for p in command.params if isinstance(p, click.Option)]
    assert all(option.help for option in described)


def test_stages_of_the_contract_are_commands() -> None:
    stages = {"reduce", "orthogonalise", "balance", "assemble", "verify", "write"}
    assert stages | {"run", "inspect", "check", "report", "schema", "new"} <= set(commands())


def test_schema_is_json_and_knows_the_grammar() -> None:
    result = CliRunner().invoke(main, ["schema"])
    schema = json.loads(result.stdout)
    assert schema["type"] == "object"
    assert {"name", "components", "scene", "reduce", "balance", "verify", "write"} <= set(schema["properties"])


def test_a_new_pipeline_loads(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(main, ["new", "probe"])
    assert (result.exit_code, result.stderr) == (0, "")
    pipeline = load_pipeline(tmp_path / "probe.yaml")
    assert (pipeline.name, set(pipeline.components)) == ("probe", {"rotor", "hub"})
    before = (tmp_path / "probe.yaml").read_bytes()
    again = CliRunner().invoke(main, ["new", "probe"])
    assert again.exit_code == 2
    assert again.stderr == "error: probe.yaml exists; choose another name or remove it: cmsreduce new probe2 ...\n"
    assert (tmp_path / "probe.yaml").read_bytes() == before


def test_a_log_has_plain_lines(study: Path) -> None:
    said = CliRunner().invoke(main, ["run", str(study), "--verbose"])
    assert said.exit_code == 0, said.stderr
    lines = said.stderr.splitlines()
    assert all(re.fullmatch(r" *\d+\.\d\d s  \S.*", line) for line in lines)
    assert "\x1b" not in said.stderr + said.stdout and "\r" not in said.stderr + said.stdout
    order = [line.split()[2] for line in lines]
    stages = ["read", "reduce", "orthogonalise", "balance", "assemble", "verify", "write"]
    assert [stage for stage in dict.fromkeys(order) if stage in stages] == stages
    assert "study: PASS" in said.stdout
