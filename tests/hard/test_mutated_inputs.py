"""Files of every reader, damaged: each is read, or refused with one message, in little time.

`benchmarks/mutated_inputs.py` does the same five thousand times, each in a process with a limit of memory.
"""

from __future__ import annotations

import os
import random
import signal
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from cmsreduce.errors import CmsReduceError
from tests.hard.good_files import NAMES, actions, good_files
from tests.read.mutations import damaged

SECONDS = 20
# meshio reads each mesh in a process of its own, which takes some tenths of a second.
CASES, MESHES = 6, 1


class Hangs(BaseException):
    """Not an Exception, so that no reader takes it for damage."""


@contextmanager
def watched() -> Iterator[None]:
    def stop(*_: object) -> None:
        raise Hangs(f"more than {SECONDS} s")

    before = signal.signal(signal.SIGVTALRM, stop)
    signal.setitimer(signal.ITIMER_VIRTUAL, SECONDS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        signal.signal(signal.SIGVTALRM, before)


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, bytes]]:
    folder = tmp_path_factory.mktemp("good")
    return folder, good_files(folder)


def test_there_is_a_file_of_every_kind(good: tuple[Path, dict[str, bytes]]) -> None:
    assert set(good[1]) == set(NAMES)


@pytest.mark.skipif(os.name != "posix", reason="the watchdog needs signals")
@pytest.mark.parametrize("name", NAMES)
def test_damaged_anywhere(name: str, good: tuple[Path, dict[str, bytes]]) -> None:
    folder, contents = good
    path = folder / name
    for number in range(MESHES if name.startswith("mesh") else CASES):
        path.write_bytes(damaged(contents[name], random.Random(f"7 {name} {number}")))
        for action in actions(path):
            with warnings.catch_warnings(), watched():
                # Libraries may warn of odd files; numbers that overflow are an error of cmsreduce.
                warnings.simplefilter("ignore", UserWarning)
                try:
                    action()
                except CmsReduceError as error:
                    assert 0 < len(str(error)) < 5000
