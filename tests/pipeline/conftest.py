"""A good study on disk, and a way to open it with other settings."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from cmsreduce.config import load_pipeline
from cmsreduce.pipeline import Run, execute
from tests.pipeline.study import PIPELINE, Log, write_study


@pytest.fixture(scope="session")
def good_study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the files of the study, written once."""
    folder = tmp_path_factory.mktemp("study")
    write_study(folder)
    return folder


@pytest.fixture(scope="session")
def finished_study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the study after a run; its results are in ``out``."""
    path = write_study(tmp_path_factory.mktemp("finished"))
    pipeline = load_pipeline(path)
    result = execute(Run(pipeline, pipeline.output, Log()), path)
    assert result is not None and result.passed
    return path.parent


@pytest.fixture
def study(good_study: Path, tmp_path: Path) -> Path:
    """A copy of the study; its pipeline file."""
    folder = tmp_path / "study"
    shutil.copytree(good_study, folder, ignore=lambda *_: ["finished", "out"])
    path = folder / "study.yaml"
    path.write_text(PIPELINE.format(output=folder / "out"))
    return path


@pytest.fixture
def ran(finished_study: Path, tmp_path: Path) -> Path:
    """A copy of the study and of its results, as a run in this folder leaves them; its pipeline file."""
    folder = tmp_path / "study"
    shutil.copytree(finished_study, folder)
    for path in (folder / "study.yaml", folder / "out" / "stages" / "origin.json"):
        path.write_text(path.read_text().replace(str(finished_study), str(folder)))
    return folder / "study.yaml"


@pytest.fixture
def opened(study: Path) -> Callable[..., Run]:
    """Open the study with keys set as on the command line."""

    def make(*overrides: str, only: str | None = None, text: str = PIPELINE) -> Run:
        study.write_text(text.format(output=study.parent / "out"))
        pipeline = load_pipeline(study, overrides)
        return Run(pipeline, pipeline.output, Log(), only)

    return make
