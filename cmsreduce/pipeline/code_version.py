"""Which code a finished stage was made with: what another version of it made is not taken for its result."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

from cmsreduce import __version__

__all__ = ["code_version"]

_PACKAGE = Path(__file__).resolve().parents[1]
_EVERY = ("model", "linalg", "reduce", "orthogonalise.py", "assemble", "balance", "project", "verify", "pipeline")
# Readers are not among them: keys hold a hash of the matrices that were read. Neither is what prints and draws.
_ROOMS = {
    "read": (),
    "reduce": ("model", "linalg", "reduce", "assemble", "pipeline"),
    "orthogonalise": ("model", "linalg", "orthogonalise.py", "pipeline"),
    "reference": ("model", "linalg", "reduce", "orthogonalise.py", "assemble", "pipeline"),
}


@cache
def code_version(stage: str, package: Path = _PACKAGE) -> str:
    """Hash of the sources that a stage's results depend on.

    Parameters
    ----------
    stage : str
        Such as ``reduce``; a stage without rooms of its own depends on all that compute.
    package : Path
        Folder of the package.

    Returns
    -------
    str
        Hexadecimal; of the version alone where the package came without its sources.
    """
    digest = hashlib.sha256(__version__.encode())
    for room in _ROOMS.get(stage, _EVERY):
        at = package / room
        for file in [at] if at.is_file() else sorted(at.rglob("*.py")):
            digest.update(str(file.relative_to(package)).encode())
            digest.update(file.read_bytes())
    return digest.hexdigest()
