"""Fixtures that every room's tests share."""

import gc
import shutil
from collections.abc import Generator, Iterator
from concurrent.futures import Executor
from contextlib import nullcontext
from pathlib import Path

import pytest

from cmsreduce.linalg.machine import BACKENDS
from cmsreduce.linalg.sparse.factorisation import installed_backends

SHARED = Path(__file__).resolve().parents[1].parent / "shared" / "data"


# Collecting makes half a million objects, none of which goes: looking for garbage among them, again and again, takes a
# seventh of the time. No test has to look through them later.
def pytest_configure() -> None:
    gc.disable()


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.enable()


@pytest.hookimpl(wrapper=True)
def pytest_collect_file() -> Generator[None, list[pytest.Collector], list[pytest.Collector]]:
    """Tests hold no examples in docstrings: only the package is searched for them."""
    found = yield
    return [each for each in found if type(each) is pytest.Module]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    reasons = {}
    if not SHARED.is_dir():
        reasons["shared"] = f"reference bodies are not here: {SHARED}"
    if shutil.which("ccx") is None:
        reasons["ccx"] = "the CalculiX solver ccx is not on the PATH"
    for backend in set(BACKENDS) - set(installed_backends()):
        reasons[backend] = f"the sparse solver {backend} is not installed"
    for item in items:
        for marker, reason in reasons.items():
            if marker in item.keywords:
                item.add_marker(pytest.mark.skip(reason=reason))


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of bodies that other programs made."""
    return SHARED


@pytest.fixture(scope="session")
def two_processes() -> Iterator[Executor]:
    """What `--jobs 2` starts, started once: to load the libraries takes longer than the work of a small run."""
    from cmsreduce.pipeline.batch.workers import local_workers

    with local_workers(2).start(2) as pool:
        yield pool


@pytest.fixture
def warm_processes(two_processes: Executor, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let `--jobs 2` take processes that run already."""
    monkeypatch.setattr("cmsreduce.pipeline.batch.workers._started", lambda jobs: nullcontext(two_processes))
