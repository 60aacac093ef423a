"""Keys of the solver: which one factorises sparse matrices, with how many threads, in how much memory."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Annotated, ClassVar

from pydantic import BeforeValidator, Field, Strict, WithJsonSchema

from cmsreduce.config.keys.mapping import Count, Keys, Plain
from cmsreduce.linalg.solver_settings import Backend, Precision

__all__ = ["NO_PARTS", "SolverKeys"]

_BYTES = {"B": 1.0, "kB": 1e3, "MB": 1e6, "GB": 1e9, "TB": 1e12, "KiB": 2.0**10, "MiB": 2.0**20, "GiB": 2.0**30}
_BYTES["TiB"] = 2.0**40
_MEMORY = re.compile(r"([0-9]+(?:\.[0-9]*)?)\s*([kKMGT]?i?B)")


def _memory(value: object) -> object:
    """Bytes of an amount of memory as people write it."""
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        raise ValueError(f"an amount of memory with its unit is expected, such as 8 GiB, found {value!r}")
    if not isinstance(value, str):
        return value
    found = _MEMORY.fullmatch(value.strip())
    if found is None or found[2] not in _BYTES:
        raise ValueError(f"{value!r} is no amount of memory; write a number and one of {', '.join(_BYTES)}")
    return float(found[1]) * _BYTES[found[2]]


Memory = Annotated[float, BeforeValidator(_memory), Field(gt=0), WithJsonSchema({"type": "string"})]
"""An amount of memory, in bytes."""


NO_PARTS = {
    "parts": "Bodies are not reduced in parts any more. Take the key out: a factor that does not fit in memory is "
    "made in single precision, or on disk; `solver.memory` says how much it may take"
}
"""The key `parts` of earlier versions, with what to write instead."""


class SolverKeys(Keys):
    """How sparse matrices are factorised, and with how much of the machine."""

    removed: ClassVar[Mapping[str, str]] = NO_PARTS

    backend: Backend = Field(
        default="auto",
        description="Sparse direct solver: pardiso (MKL), multifrontal (cmsreduce's own, for definite matrices), "
        "cholmod (scikit-sparse) or superlu (scipy); auto takes the quickest that is installed: superlu for small "
        "bodies, multifrontal for large ones. mumps (petsc4py) works on several processes under mpiexec, and is only "
        "taken where it is named. summary.json says which one ran.",
        examples=["auto"],
    )
    threads: Count | None = Field(
        default=None,
        ge=1,
        description="Threads of dense and sparse algebra; by default all cores, or what OMP_NUM_THREADS says.",
        examples=[2],
    )
    memory: Memory | None = Field(
        default=None,
        description="Memory that a factor may take; one that needs more is refused before anything is made, or made on "
        "disk (pardiso with replace_allocators). By default most of what is free.",
        examples=["8 GiB"],
    )
    precision: Precision = Field(
        default="auto",
        description="Precision of the factor, with pardiso or multifrontal: double, or single, which takes half the "
        "memory and is refined to the same accuracy in several times the solves; auto takes single where double would "
        "not fit in memory. Anything so ill conditioned that "
        "refinement does not converge is refused.",
        examples=["auto"],
    )
    ranks: Annotated[int, Strict(), Field(ge=1)] = Field(
        default=2, description="Processes of mumps, which share a factor and its memory.", examples=[2]
    )
    python: Plain | None = Field(
        default=None,
        description="Interpreter of the processes of mumps, which has petsc4py; by default the one that runs "
        "cmsreduce, or else /usr/bin/python3, which Debian's python3-petsc4py belongs to.",
        examples=["/usr/bin/python3"],
    )
    replace_allocators: bool = Field(
        default=False,
        strict=True,
        description="Whether MKL's allocator may be replaced by one of cmsreduce's, so that a factor of pardiso which "
        "does not fit in memory lies in a file, and the C library's be set to use freed pages again while a body is "
        "reduced (docs/large-bodies.md). Linux only; it changes the whole process.",
        examples=[True],
    )
