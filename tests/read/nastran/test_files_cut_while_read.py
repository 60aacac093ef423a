"""A file that another program cuts while it is read: an error, where a mapped file would end the whole process."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pyyeti.nastran import op4

from cmsreduce.read import files
from cmsreduce.read.nastran import op4_printed
from cmsreduce.read.nastran.op4_binary import BinaryRecords
from cmsreduce.read.nastran.op4_printed import PrintedRecords

Records = Callable[[Path], object]


def binary(path: Path) -> object:
    records = BinaryRecords(path)
    cut(path)
    return list(records.headers())


def printed(path: Path) -> object:
    records = PrintedRecords(path)
    cut(path)
    return [[*records.numbers(*found)] for found in records.matrices()]


def cut(path: Path) -> None:
    """Leave the first third of a file, in place."""
    with path.open("r+b") as file:
        file.truncate(path.stat().st_size // 3)


@pytest.mark.parametrize("read", [binary, printed])
def test_a_file_that_is_cut_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, read: Records) -> None:
    for room in (files, op4_printed):
        monkeypatch.setattr(room, "_AT_ONCE", 64)
    path = tmp_path / "body.op4"
    op4.write(str(path), {"KAA": np.random.default_rng(0).random((40, 40))}, binary=read is binary)
    size = path.stat().st_size
    with pytest.raises(EOFError, match=rf"it had {size} bytes, and those from \d+ on are gone"):
        read(path)
