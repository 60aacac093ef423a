"""Change a sealed file and seal it again, for tests of what its content says."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py

from cmsreduce.write import read_summary
from cmsreduce.write.seal import SEAL, SEALED_ITEMS, put_seal
from cmsreduce.write.summary.stored_summary import sealed_text


@contextmanager
def resealed(path: Path) -> Iterator[h5py.File]:
    """A component file or system.h5 open for changes; it is sealed anew at the end."""
    with h5py.File(path, "r+") as file:
        yield file
        del file.attrs[SEAL], file[SEALED_ITEMS]
        put_seal(file)


@contextmanager
def resealed_summary(path: Path, to: Path | None = None) -> Iterator[dict[str, Any]]:
    """The content of a summary.json for changes; it is written with a seal, in its place or elsewhere."""
    facts = read_summary(path)
    yield facts
    (to or path).write_text(sealed_text(facts), encoding="utf-8")
