"""What the README and the guide promise is there."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from cmsreduce.cli import main
from cmsreduce.pipeline import STAGES

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()


def test_the_python_lines_run_and_find_the_stators_modes():
    code = re.search(r"```python\n(.*?)```", README, re.S)[1]
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    count, *hertz = done.stdout.replace("[", " ").replace("]", " ").split()
    assert int(count) == 6
    # A stator held nowhere: its lowest mode is the relay antenna boom's.
    assert float(hertz[0]) == pytest.approx(3.25, rel=0.02)


def test_every_command_of_the_readme_exists():
    named = set(re.findall(r"cmsreduce (\w+)", README)) - {"run"}
    listed = CliRunner().invoke(main, ["--help"]).output
    for command in named & {*STAGES, "inspect", "check", "report", "schema", "new"}:
        assert re.search(rf"^  {command}\b", listed, re.M), command


@pytest.mark.parametrize("page", ["README.md", *(f"docs/{p.name}" for p in (ROOT / "docs").glob("*.md"))])
def test_links_lead_somewhere(page):
    text = (ROOT / page).read_text()
    for target in re.findall(r"\]\(([^)#]+)\)", text):
        assert (ROOT / page).parent.joinpath(target).exists(), target


def test_make_has_the_targets_of_the_readme():
    makefile = (ROOT / "Makefile").read_text()
    for target in re.findall(r"`?make (\w+)", README):
        assert re.search(rf"^{target}:|\.PHONY:.*\b{target}\b", makefile, re.M), target
