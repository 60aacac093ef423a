"""Help with whole sentences, completion in shells, and the state of the machine."""

from __future__ import annotations

import json
import re
from importlib.metadata import PackageNotFoundError, version

import pytest
from click.shell_completion import ShellComplete
from click.testing import CliRunner
from threadpoolctl import threadpool_info

from cmsreduce.cli import main
from cmsreduce.config import json_schema, key_names
from cmsreduce.pipeline.environment import kernels_advice


def completed(*words: str) -> list[str]:
    *before, typed = words
    shell = ShellComplete(main, {}, "cmsreduce", "_CMSREDUCE_COMPLETE")
    return [item.value for item in shell.get_completions(before, typed)]


def test_help_names_every_command_in_whole_sentences() -> None:
    text = CliRunner().invoke(main, ["--help"]).stdout
    assert "..." not in text.partition("Options:")[2]
    for name, command in main.commands.items():
        first = re.split(r"\.(?:\s|$)", str(command.help))[0].split()
        assert re.search(rf"^  {name} +{first[0]}", text, re.M), name
        assert " ".join(first) in " ".join(text.split())


@pytest.mark.parametrize(
    ("words", "found"),
    [
        (("do",), ["doctor"]),
        (("run", "--set", "reduce.cut"), ["reduce.cutoff="]),
        (("sweep", "--over", "balance.keep.fr"), ["balance.keep.fraction=", "balance.keep.frf_error="]),
        (("run", "--until", "or"), ["orthogonalise"]),
        (("check", "--max", "db"), ["db_error="]),
        (("convert", "a.h5", "b", "--format", "sims"), ["simscape"]),
        (("completion", "z"), ["zsh"]),
    ],
)
def test_completion(words: tuple[str, ...], found: list[str]) -> None:
    assert completed(*words) == found


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_scripts_of_shells_call_the_program(shell: str) -> None:
    said = CliRunner().invoke(main, ["completion", shell])
    assert said.exit_code == 0 and f"_CMSREDUCE_COMPLETE={shell}_complete" in said.stdout


def test_keys_are_those_of_the_schema() -> None:
    names = key_names()
    assert len(names) == len(set(names)) > 60
    assert {name for name in names if "." not in name} == set(json_schema()["properties"])


def test_doctor_knows_versions_solvers_and_disk() -> None:
    said = CliRunner().invoke(main, ["doctor", "--json"])
    found = json.loads(said.stdout)
    assert found["libraries"]["numpy"] == version("numpy") and found["cmsreduce"] == version("cmsreduce")
    assert "superlu" in found["sparse solvers"] and found["memory"] > 1e8 and found["disk"] > 0
    assert "extra dev" not in found and found["threads"] >= 1
    assert re.search(r"^sparse solvers +.*superlu", CliRunner().invoke(main, ["doctor"]).stdout, re.M)


def test_doctor_names_kernels_that_do_not_know_the_processor() -> None:
    for kernels, extensions in ((["Haswell", ""], ["X86_V3", "X86_V4"]), (["Zen"], ["AVX2", "AVX512_SKX"])):
        assert "OPENBLAS_CORETYPE=SKYLAKEX" in kernels_advice(kernels, extensions)
    for kernels, extensions in ((["SkylakeX"], ["X86_V4"]), (["Haswell"], ["X86_V3"]), (["armv8"], ["ASIMD"])):
        assert not kernels_advice(kernels, extensions)
    kernels = json.loads(CliRunner().invoke(main, ["doctor", "--json"]).stdout)["dense algebra"]
    assert {each["version"] for each in threadpool_info() if each["user_api"] == "blas"} == {
        name.split()[-1] for name in kernels
    }


def test_a_clone_that_is_not_installed_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """It runs from PYTHONPATH, and ended with an internal error."""
    assert CliRunner().invoke(main, ["--version"]).stdout == f"cmsreduce, version {version('cmsreduce')}\n"

    def unknown(name: str) -> str:
        raise PackageNotFoundError(name)

    monkeypatch.setattr("importlib.metadata.version", unknown)
    said = CliRunner().invoke(main, ["--version"])
    assert said.exit_code == 2
    assert re.search(r"the copy of cmsreduce in (\S+) is not installed, .*: `pip install --editable \1`", said.stderr)


def test_doctor_compiles_what_the_first_large_body_would() -> None:
    said = CliRunner().invoke(main, ["doctor", "--compile"])
    assert int(re.search(r"^compiled loops +(\d+) in ", said.stdout, re.M)[1]) >= 10
