"""Change a sealed file and seal it again, for tests of what its content says."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py

from cmsreduce.write.seal import SEAL, SEALED_ITEMS, put_seal


@contextmanager
def resealed(path: Path) -> Iterator[h5py.File]:
    """A component file or system.h5 open for changes; it is sealed anew at the end."""
    with h5py.File(path, "r+") as file:
        yield file
        del file.attrs[SEAL], file[SEALED_ITEMS]
        put_seal(file)
