"""Means that a run finds here: versions, solvers and their kernels, threads, memory, disk, compiled loops."""

from __future__ import annotations

import os
import platform
import re
import shutil
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import ThreadpoolController

from cmsreduce import __version__
from cmsreduce.linalg.machine import available_memory, usable_cores
from cmsreduce.linalg.sparse import installed_backends
from cmsreduce.multifrontal import lacks

__all__ = ["EnvironmentLine", "environment", "kernels_advice"]

_PACKAGE = "cmsreduce"
_NOT_OF_A_NAME, _EXTRA = re.compile(r"[^\w.-]"), re.compile(r"extra == ['\"]([\w-]+)")
_DEVELOPERS = frozenset({"dev", "docs"})
# Free space below which the finished stages of a large body may not fit: those of 1e6 dofs take a few GB.
_SMALL_DISK = 5e9
# Names that numpy gives to AVX-512, and OpenBLAS to its kernels without it; it takes a new processor for one of these.
_AVX512, _OLDER = frozenset({"AVX512_SKX", "X86_V4"}), frozenset({"Haswell", "Zen"})


@dataclass(frozen=True)
class EnvironmentLine:
    """One fact about the machine or the installation.

    Parameters
    ----------
    name : str
    value : object
        Plain value.
    words : str
        The value for a reader.
    advice : str
        What to do; empty if all is well.
    """

    name: str
    value: Any
    words: str
    advice: str = ""


def environment(folder: Path) -> tuple[EnvironmentLine, ...]:
    """Facts on which speed and possibilities of a run depend; nothing is changed.

    Parameters
    ----------
    folder : Path
        Folder on whose disk runs are written.
    """
    return (*_versions(), *_solvers(), *_kernels(), *_machine(folder))


def _versions() -> Iterator[EnvironmentLine]:
    yield EnvironmentLine(_PACKAGE, __version__, __version__)
    python = platform.python_version()
    yield EnvironmentLine("python", python, f"{python}, {platform.system()} {platform.machine()}")
    core, extras = _requirements()
    found = {name: _version(name) for name in core}
    missing = [name for name, number in found.items() if number is None]
    words = ", ".join(f"{name} {number}" for name, number in found.items() if number is not None)
    advice = f"not installed: {', '.join(missing)}; install cmsreduce again with pip" if missing else ""
    yield EnvironmentLine("libraries", found, words, advice)
    for extra, names in extras.items():
        have = {name: _version(name) for name in names}
        words = ", ".join(f"{name} {number or 'not installed'}" for name, number in have.items())
        advice = f"pip install '{_PACKAGE}[{extra}]', if you need it" if None in have.values() else ""
        yield EnvironmentLine(f"extra {extra}", have, words, advice)


def _requirements() -> tuple[list[str], dict[str, list[str]]]:
    """Names of the libraries that every installation has, and of those of each extra but the developers'."""
    core: list[str] = []
    extras: dict[str, list[str]] = {}
    for text in requires(_PACKAGE) or []:
        requirement, _, marker = text.partition(";")
        name = _NOT_OF_A_NAME.split(requirement.strip())[0]
        if not marker:
            core.append(name)
        elif (extra := _EXTRA.search(marker)) is None:
            # Only some processors have it.
            core += [name] if _version(name) else []
        elif extra[1] not in _DEVELOPERS:
            extras.setdefault(extra[1], []).append(name)
    return core, extras


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _solvers() -> Iterator[EnvironmentLine]:
    backends = installed_backends()
    advice = "" if set(backends) - {"superlu"} else "SuperLU alone is slow above 1e4 dofs: pip install mkl"
    yield EnvironmentLine("sparse solvers", list(backends), ", ".join(backends), advice)
    if lacks():
        yield EnvironmentLine("compiled loops", None, "none: the multifrontal solver cannot be used here", lacks())
        return
    # This loads numba, which no run does that does not need it.
    from cmsreduce.multifrontal import compiled_folder

    folder = compiled_folder()
    compiled = sum(1 for _ in folder.rglob("*.nbi"))
    advice = "" if compiled else "`cmsreduce doctor --compile` makes them, or the first large body, in half a minute"
    yield EnvironmentLine("compiled loops", str(folder), f"{compiled} in {folder}", advice)


def _kernels() -> Iterator[EnvironmentLine]:
    found = ThreadpoolController().select(user_api="blas").info()
    # numpy and scipy may bring one each.
    kernels = {f"{each['internal_api']} {each['version']}": str(each.get("architecture", "")) for each in found}
    words = ", ".join(f"{name} ({kind})" if kind else name for name, kind in sorted(kernels.items()))
    extensions = np.show_config(mode="dicts").get("SIMD Extensions", {}).get("found", [])
    yield EnvironmentLine("dense algebra", kernels, words, kernels_advice(set(kernels.values()), extensions))


def kernels_advice(kernels: Collection[str], extensions: Collection[str]) -> str:
    """Advice where OpenBLAS does not know a processor, and takes kernels with half its speed.

    On an AMD EPYC of family 26, 60 + 50 modes of 307 800 dofs take 14.3 s with the others, and 18.7 s without.

    Parameters
    ----------
    kernels : collection of str
        Processors for which the libraries have chosen their kernels.
    extensions : collection of str
        Extensions of the processor by the names of numpy.

    Examples
    --------
    >>> kernels_advice(["SkylakeX"], ["X86_V3", "X86_V4"])
    ''
    """
    if not _OLDER & set(kernels) or not _AVX512 & set(extensions):
        return ""
    return "this processor has AVX-512: with OPENBLAS_CORETYPE=SKYLAKEX set, large bodies take a quarter less time"


def _machine(folder: Path) -> Iterator[EnvironmentLine]:
    cores, most = usable_cores(), os.cpu_count() or 1
    advice = "" if cores >= most else "OMP_NUM_THREADS, the affinity or the control group of the process allows no more"
    yield EnvironmentLine("threads", cores, f"{cores} of {most} cores", advice)
    memory = available_memory()
    yield EnvironmentLine("memory", memory, f"{memory / 2**30:.1f} GiB available")
    free = shutil.disk_usage(folder).free
    advice = "finished stages of large bodies may not fit; choose another --out" if free < _SMALL_DISK else ""
    yield EnvironmentLine("disk", free, f"{free / 2**30:.1f} GiB free in {folder.absolute()}", advice)
