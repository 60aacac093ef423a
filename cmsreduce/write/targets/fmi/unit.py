"""The archive of a Functional Mock-up Unit: description, C sources with the matrices as data, and their binary."""

from __future__ import annotations

import hashlib
import io
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import WriteError
from cmsreduce.write.files import atomic_path
from cmsreduce.write.targets.fmi.description import build_description, model_description
from cmsreduce.write.targets.fmi.linear_model import LinearModel

__all__ = ["FMI_DIALECTS", "unit_binary", "write_unit"]

FMI_DIALECTS = ("fmi3", "fmi2")
"""Versions of the standard: 3.0 and 2.0."""

_SOURCES = Path(__file__).parent / "sources"
_HEADERS = ("linear_model.h", "calls.h")
# The exponential of A has the square of this number of entries, 8 MiB.
_LARGEST = 1000
# Folders of the standards; version 2.0 names no others for these systems.
_PLATFORMS: Mapping[str, Mapping[tuple[str, str], str]] = {
    "fmi3": {
        ("linux", "x86_64"): "x86_64-linux",
        ("linux", "aarch64"): "aarch64-linux",
        ("darwin", "x86_64"): "x86_64-darwin",
        ("darwin", "arm64"): "aarch64-darwin",
    },
    "fmi2": {("linux", "x86_64"): "linux64", ("darwin", "x86_64"): "darwin64"},
}
_OPTIONS = ("-std=c99", "-O2", "-fPIC", "-shared", "-fvisibility=hidden")
# Fixed, so that equal models give equal bytes; the earliest date that the archive can hold.
_DATE = (1980, 1, 1, 0, 0, 0)


def write_unit(path: Path, model: LinearModel, version: str = "fmi3") -> None:
    """Write a Functional Mock-up Unit for model exchange and co-simulation.

    A step of co-simulation is exact for inputs that are constant over it: x(t + h) = exp(A h) x + int exp(A s) ds B u.
    The unit holds its C sources, and a binary for this machine if it has a C compiler named ``cc``.

    Parameters
    ----------
    path : Path
        Name of the file, which is complete or absent.
    model : LinearModel
        States, inputs, outputs.
    version : {"fmi3", "fmi2"}
        Version of the standard.

    Raises
    ------
    WriteError
        If there are too many states, the compiler fails, or the file cannot be written.
    """
    if model.n > _LARGEST:
        raise WriteError(
            f"{path}: {model.n} states are too many for a unit (up to {_LARGEST}), whose exact step needs the "
            "exponential of their matrix; keep fewer modes"
        )
    identifier = re.sub(r"\W", "_", model.name, flags=re.ASCII)
    identifier = identifier if identifier[:1].isalpha() else f"m{identifier}"
    data = "\n".join(_data(model))
    digest = hashlib.sha256(f"{version}\n{model.name}\n{data}".encode()).hexdigest()
    token = "{" + "-".join(digest[a:b] for a, b in ((0, 8), (8, 12), (12, 16), (16, 20), (20, 32))) + "}"
    entry = f"{version}.c"
    sources = {name: (_SOURCES / name).read_text(encoding="ascii") for name in (entry, *_HEADERS)}
    sources["model_data.h"] = f'#define TOKEN "{token}"\n{data}\n'
    files = {"modelDescription.xml": model_description(model, version, identifier, token, entry)}
    if version == "fmi3":
        files["sources/buildDescription.xml"] = build_description(identifier, entry)
    files |= {f"sources/{name}": text.encode("ascii") for name, text in sources.items()}
    files |= _binary(path, sources, version, identifier)
    image = io.BytesIO()
    with zipfile.ZipFile(image, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(zipfile.ZipInfo(name, _DATE), content, zipfile.ZIP_DEFLATED)
    with atomic_path(path) as temporary:
        temporary.write_bytes(image.getvalue())


def unit_binary(path: Path) -> str:
    """Path of the binary in a unit; empty if it holds sources only, which the importing program must compile."""
    with zipfile.ZipFile(path) as archive:
        return next((name for name in archive.namelist() if name.startswith("binaries/")), "")


def _data(model: LinearModel) -> Iterator[str]:
    """Matrices as C data, by compressed rows; time is in seconds."""
    from scipy.linalg import matrix_balance

    A, second = model.A, model.units.time if model.units else 1.0
    scale = matrix_balance(A, permute=False, separate=True)[1][0] if model.n else np.ones(0)
    yield f"#define NX {model.n}"
    yield f"#define NU {len(model.inputs)}"
    yield f"#define NY {len(model.outputs)}"
    yield "typedef struct { int rows; const int *start, *column; const double *value; } Rows;"
    for name, matrix in (("A", A / second), ("B", model.B / second), ("C", model.C), ("D", model.D)):
        row, column = np.nonzero(matrix)
        start = np.searchsorted(row, np.arange(matrix.shape[0] + 1))
        yield f"static const int {name}_start[] = {{{_numbers(start)}}};"
        yield f"static const int {name}_column[] = {{{_numbers(column)}}};"
        yield f"static const double {name}_value[] = {{{_numbers(matrix[row, column])}}};"
        yield f"static const Rows {name} = {{{matrix.shape[0]}, {name}_start, {name}_column, {name}_value}};"
    yield f"static const double SCALE[] = {{{_numbers(scale)}}};"
    yield f"static const double NOMINAL[] = {{{_numbers(model.nominal)}}};"


def _numbers(values: NDArray[np.number]) -> str:
    """Exact decimal numbers, ten a line; a 0 where there are none, because C has no empty lists."""
    texts = [repr(value) for value in values.tolist()] or ["0"]
    return ",\n".join(", ".join(texts[k : k + 10]) for k in range(0, len(texts), 10))


def _binary(path: Path, sources: Mapping[str, str], version: str, identifier: str) -> dict[str, bytes]:
    """Binary for this machine by its name in the archive; none without a compiler or a folder of the standard."""
    compiler, folder = shutil.which("cc"), _PLATFORMS[version].get((sys.platform, platform.machine()))
    if compiler is None or folder is None:
        return {}
    library = f"{identifier}.{'dylib' if sys.platform == 'darwin' else 'so'}"
    with tempfile.TemporaryDirectory() as place:
        for name, text in sources.items():
            (Path(place) / name).write_text(text, encoding="ascii")
        command = [compiler, *_OPTIONS, "-o", library, f"{version}.c", "-lm"]
        done = subprocess.run(command, cwd=place, capture_output=True, text=True, check=False)
        if done.returncode:
            reason = next((line for line in done.stderr.splitlines() if "error" in line), done.stderr.strip()[:200])
            raise WriteError(f"{path}: the C compiler {compiler} could not compile the unit: {reason}")
        return {f"binaries/{folder}/{library}": (Path(place) / library).read_bytes()}
