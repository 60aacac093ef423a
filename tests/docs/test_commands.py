"""Every command of the documentation is run, in a folder that has what a reader of the page would have."""

from __future__ import annotations

import ast
import re
import shlex
import shutil
from collections.abc import Set
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from cmsreduce.balance import RANKINGS
from cmsreduce.cli import main
from cmsreduce.config import json_schema, load_pipeline
from cmsreduce.pipeline.batch import sweep_axes
from cmsreduce.reduce import METHODS
from cmsreduce.write import PROFILES, TARGETS
from tests.docs.pages import PAGES, ROOT, commands, inline, snippets

NOT_RUN = {
    "cmsreduce sweep study.yaml --over reduce.cutoff=1.5,2,4 --cluster configs/cluster-slurm.yaml": "needs a queue",
    "cmsreduce sweep study.yaml --over reduce.cutoff=1.5,2,4 --cluster tcp://node1:8786": "needs a scheduler",
}
"""Commands that are not run here, and why; their options are looked at all the same."""
PROGRAMS = {
    "make": "targets are looked up in the Makefile; CI runs setup, lint, docs, demo and test",
    "pip": "installs",
    "python": "benchmarks take minutes to hours, tests are run by themselves; the files are looked up",
}
"""Programs other than cmsreduce that are looked at, and not run."""
# The Galileo sample with one setting, one channel, few modes and points: what takes a minute takes seconds.
SMALL = tuple(
    word
    for override in (
        "scene.articulation={spin: [0 deg]}",
        "scene.sensors={gyro: {at: platform.cg, measure: [ry]}}",
        "scene.band=2 Hz",
        "balance.keep={modes: 4}",
        "verify={frf: {points: 40}}",
    )
    for word in ("--set", override)
)
# In the reader's file of the sample, for what is run from Python: one setting, which the pages name, and few points.
FEWER = (
    ("spin: [0, 45, 90, 225 deg], cone: [0, 30 deg]", "spin: [45 deg], cone: [30 deg]"),
    ("points: 400", "points: 40"),
)
# Limits of samples and examples may be broken on purpose; bad input may not.
GOOD = {0, 1}


@pytest.fixture(scope="module")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A checkout's samples, the reader's own body `rotor`, and the small study with its results."""
    from tests.pipeline.study import PIPELINE, write_study

    folder = tmp_path_factory.mktemp("reader")
    for name in ("sample_models", "pipelines", "configs"):
        shutil.copytree(ROOT / name, folder / name)
    for kind in ("op4", "bdf"):
        shutil.copy(ROOT / f"sample_models/galileo/rotor.{kind}", folder)
    write_study(folder)
    galileo = folder / "pipelines" / "galileo.yaml"
    for keys, fewer in FEWER:
        assert keys in galileo.read_text()
        galileo.write_text(galileo.read_text().replace(keys, fewer))
    (folder / "study.yaml").write_text(PIPELINE.format(output="build/study"))
    (folder / "limits.yaml").write_text(
        next(block.text for block in snippets("docs/ci.md") if block.text.startswith("# limits.yaml"))
    )
    with pytest.MonkeyPatch.context() as there:
        there.chdir(folder)
        for command in (
            "new rotor rotor.op4 rotor.bdf",
            "run study.yaml",
            "run rotor.yaml --out build/rotor",
            "run pipelines/galileo.yaml --set write.formats=[hdf5,matlab]",
        ):
            typed(f"cmsreduce {command}")
        for component in ("build/study/panel.h5", "build/rotor/rotor.h5", "build/galileo/rotor.h5"):
            shutil.copy(component, ".")
            shutil.copy(component, "build")
        for states in ("rotor.mat", "system.mat"):
            shutil.copy(f"build/galileo/{states}", ".")
        shutil.copytree("build/study", "baseline", ignore=shutil.ignore_patterns("stages"))
    return folder


@pytest.fixture
def reader(prepared: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "reader"
    shutil.copytree(prepared, folder)
    monkeypatch.chdir(folder)
    return folder


def typed(command: str, good: Set[int] = GOOD) -> None:
    """Run a command as it is written, without what a shell does after it, and demand that it finds its input good."""
    words = shlex.split(command.partition(" && ")[0])[1:]
    if words[:1] == ["new"]:
        Path(f"{words[1]}.yaml").unlink(missing_ok=True)
    if "pipelines/galileo.yaml" in words and words[0] != "inspect":
        words += SMALL
    if words[0] == "sweep":
        words = _first_point(words)
    done = CliRunner().invoke(main, words)
    assert done.exit_code in good and isinstance(done.exception, SystemExit | None), f"{command}\n{done.output}"


def _first_point(words: list[str]) -> list[str]:
    """A sweep over the first value of each key; the others are values that the grammar takes."""
    over = [words[i + 1] for i, word in enumerate(words) if word == "--over"]
    axes = sweep_axes(over)
    for key, values in axes.items():
        for value in values:
            load_pipeline(Path(words[1]), [f"{key}={value}"])
    first = {text: f"{key}={values[0]}" for text, (key, values) in zip(over, axes.items(), strict=True)}
    return [first.get(word, word) for word in words]


def synopsis(command: str) -> bool:
    """Whether it stands for commands: it has words in capitals, or choices."""
    return re.search(r" (\[|[A-Z]{2,}\b|.*\\?\|)|\.\.\.", command) is not None


def assert_synopsis(text: str) -> None:
    """The command and its options exist."""
    for verb in re.split(r"\\?\|", re.match(r"cmsreduce ([\w-]+(?: \\?\| [\w-]+)*)", text)[1]):
        command: click.Command = main.commands[verb.strip()]
        if isinstance(command, click.Group):
            continue
        known = {option for param in command.params for option in param.opts}
        assert set(re.findall(r"--[\w-]+", text)) <= known | {"--help"}, text


@pytest.mark.usefixtures("warm_processes")
@pytest.mark.parametrize("page", [page for page in PAGES if any(c.startswith("cmsreduce") for c in commands(page))])
def test_the_commands_of_a_page_run(page: str, reader: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for command in commands(page):
        for block in snippets(page):
            if (name := re.match(r"# (\w+\.yaml)\n", block.text)) is not None:
                Path(name[1]).write_text(block.text)
        if command.startswith(("mkdir", "cp")):
            _files(command, monkeypatch)
        elif command.startswith("cmsreduce"):
            assert_synopsis(command)
            if not synopsis(command) and command not in NOT_RUN:
                typed(command, {0} if page == "docs/tutorial.md" else GOOD)


def _files(command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    program, *names = shlex.split(command.partition(" && ")[0])
    if program == "mkdir":
        Path(names[-1]).mkdir()
    else:
        shutil.copy(*names)
    if (there := re.search(r"&& cd (\S+)", command)) is not None:
        monkeypatch.chdir(there[1])


def is_target(name: str) -> bool:
    if name.startswith("run-"):
        return (ROOT / "pipelines" / f"{name[4:]}.yaml").is_file()
    return re.search(rf"^{name}:", (ROOT / "Makefile").read_text(), re.M) is not None


@pytest.mark.parametrize("page", PAGES)
def test_what_is_not_run_exists(page: str) -> None:
    for command in [*commands(page), *(code for code in inline(page) if re.match(r"make [a-z]", code))]:
        program, *words = command.partition(" && ")[0].split()
        if program == "make":
            assert all(is_target(word) for word in words if word[0] != "-"), command
        elif program == "python":
            assert (ROOT / (words[2] if words[:2] == ["-m", "pytest"] else words[0])).exists(), command
        else:
            assert program in {*PROGRAMS, "cmsreduce", "mkdir", "cp"}, command


@pytest.mark.parametrize("page", PAGES)
def test_commands_within_the_text_exist(page: str) -> None:
    for code in inline(page):
        if re.match(r"cmsreduce [a-z]", code):
            assert_synopsis(code)


def test_what_is_not_run_is_still_there() -> None:
    assert set(NOT_RUN) <= {command for page in PAGES for command in commands(page)}


@pytest.mark.parametrize("page", PAGES)
def test_python_runs(page: str, request: pytest.FixtureRequest) -> None:
    names: dict[str, object] = {}
    for snippet in snippets(page):
        if snippet.language == "python":
            # Most pages have none, and a reader's folder takes a while.
            request.getfixturevalue("reader")
            if page == "docs/tutorial.md":
                for kind in ("op4", "bdf"):
                    shutil.copy(f"rotor.{kind}", f"antenna.{kind}")
                Path("antenna.yaml").write_text(Path("rotor.yaml").read_text().replace("rotor", "antenna"))
            exec(compile(snippet.text, str(snippet), "exec"), names)
    if page == "README.md":
        found = names["component"]
        # A stator held nowhere: its lowest mode is the relay antenna boom's.
        assert found.rigid_count == 6
        assert found.frequencies_hz[6] == pytest.approx(3.25, rel=0.02)


@pytest.mark.parametrize(
    ("mapping", "key", "names"),
    [
        ("ReduceKeys", "method", {*METHODS}),
        ("BalanceKeys", "rank", {*RANKINGS, "system-cost", "closed-loop"}),
        ("WriteKeys", "formats", {*TARGETS, "hdf5"}),
        ("WriteKeys", "targets", {*PROFILES}),
    ],
)
def test_words_of_the_grammar_are_those_of_the_tables(mapping: str, key: str, names: set[str]) -> None:
    """A mode set, a ranking or a target has its name in two places, as the pages on adding one say."""
    schema = json_schema()["$defs"][mapping]
    allowed = re.findall(r"'enum': (\[[^]]*\])", str((schema.get("anyOf") or [schema])[0]["properties"][key]))
    assert set(ast.literal_eval(allowed[0])) == names


def test_indented_blocks_are_commands_or_formulas() -> None:
    """YAML and Python stand in fences that name them, so that they are found here."""
    formulas = {"docs/theory.md", "docs/treetops.md"}
    for page in PAGES:
        for snippet in snippets(page):
            if snippet.language == "indented" and page not in formulas:
                assert re.match(r"(cmsreduce|pip|python|make) |read -> reduce", snippet.text), f"{snippet}"
            assert snippet.language in {"", "sh", "indented", "python", "yaml", "make"}, f"{snippet}"
