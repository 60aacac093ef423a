"""The examples of the page on continuous integration, run as their servers would run them."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from ruamel.yaml import YAML

from cmsreduce.pipeline.results.limits import Tolerances
from tests.cli.forked import waiting, write_program
from tests.pipeline.study import PIPELINE

PAGE = (Path(__file__).parents[2] / "docs" / "ci.md").read_text()
SECTIONS = {part.partition("\n")[0]: part for part in PAGE.split("\n## ")[1:]}
BLOCKS = {
    title: found[1]
    for title, text in SECTIONS.items()
    if (found := re.search(r"```(?:yaml|make)\n(.*?)```", text, re.S))
}
INSTALL = "pip install"


def yaml(section: str) -> dict:
    return YAML(typ="safe").load(BLOCKS[section])


def github_steps() -> list[str]:
    return [step["run"] for step in yaml("GitHub Actions")["jobs"]["reduce"]["steps"] if "run" in step]


@pytest.fixture
def workplace(good_study: Path, tmp_path: Path) -> Iterator[Path]:
    """A checkout with the study, the limits of the page and no results."""
    folder = tmp_path / "checkout"
    shutil.copytree(good_study, folder, ignore=lambda *_: ["finished", "out"])
    # One angle: what is run here is the servers' steps, six runs of them.
    text = PIPELINE.replace("hinge: [0, 50 deg]", "hinge: [50 deg]")
    (folder / "study.yaml").write_text(text.format(output="build/other"))
    (folder / "limits.yaml").write_text(BLOCKS["What is checked"])
    (folder / "bin").mkdir()
    # The path of a socket is a hundred letters at most.
    with TemporaryDirectory() as short, waiting(Path(short) / "calls"):
        write_program(folder / "bin" / "cmsreduce", Path(short) / "calls")
        yield folder


def shell(folder: Path, script: str, **more: str) -> subprocess.CompletedProcess[str]:
    path = f"{folder / 'bin'}{os.pathsep}{os.environ['PATH']}"
    # As both servers do: stop at the first command that fails.
    return subprocess.run(
        ["bash", "-e", "-o", "pipefail", "-c", script],
        cwd=folder,
        env={**os.environ, "PATH": path, "PYTHONPATH": str(Path(__file__).parents[2]), **more},
        capture_output=True,
        text=True,
        check=False,
    )


def test_the_examples(workplace: Path) -> None:
    (workplace / "Makefile").write_text(BLOCKS["Makefile"])
    approved = shell(workplace, "make approve")
    assert approved.returncode == 0, approved.stderr
    assert {path.name for path in (workplace / "baseline").iterdir()} >= {"summary.json", "arm.h5", "panel.h5"}
    checked = shell(workplace, "make check")
    assert checked.returncode == 0, checked.stdout + checked.stderr
    (workplace / "check.xml").unlink()

    page = workplace / "step.md"
    github = [step for step in github_steps() if INSTALL not in step]
    for step in github:
        done = shell(workplace, step, GITHUB_STEP_SUMMARY=str(page))
        assert done.returncode == 0, done.stdout + done.stderr
    assert page.read_text().startswith("## cmsreduce check build/study: PASS")

    gitlab = [line for line in yaml("GitLab CI")["reduce"]["script"] if INSTALL not in line]
    done = shell(workplace, "\n".join(gitlab))
    assert done.returncode == 0, done.stdout + done.stderr
    assert (workplace / yaml("GitLab CI")["reduce"]["artifacts"]["reports"]["junit"]).is_file()

    limits = workplace / "limits.yaml"
    limits.write_text(limits.read_text().replace("highest_hz: 4000", "highest_hz: 20"))
    page.unlink()
    broken = shell(workplace, github[-1], GITHUB_STEP_SUMMARY=str(page))
    assert broken.returncode == 1
    assert "| FAIL | arm |" in page.read_text()
    assert shell(workplace, "\n".join(gitlab)).returncode == 1
    assert shell(workplace, "make check").returncode == 2


def test_the_tolerances_are_those_of_the_page() -> None:
    stated = dict(re.findall(r"\| `(\w+)` \| ([\d.e-]+) \|$", PAGE, re.M))
    assert {name: float(value) for name, value in stated.items()} == {
        name: value for name, value in vars(Tolerances()).items() if name != "errors"
    }
