"""A multifrontal sparse Cholesky solver: on all threads, for blocks of vectors, in double or single precision.

Its graph algorithms, nested dissection, compiled loops and calls of BLAS belong here.
Bodies, settings, files and other solvers do not: this package imports nothing of the rest of cmsreduce.
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any

from cmsreduce.multifrontal.ordering import compressed_graph, dissection_installed, nested_dissection, row_groups
from cmsreduce.multifrontal.threads import blas_threads

if TYPE_CHECKING:
    from cmsreduce.multifrontal.factor import (
        CholeskyFactor,
        FactorSize,
        NotPositiveDefiniteError,
        UnstableError,
        compile_loops,
    )
    from cmsreduce.multifrontal.loops import compiled_folder
    from cmsreduce.multifrontal.shift import shifted

__all__ = [
    "CholeskyFactor",
    "FactorSize",
    "NotPositiveDefiniteError",
    "UnstableError",
    "blas_threads",
    "compile_loops",
    "compiled_folder",
    "compressed_graph",
    "dissection_installed",
    "lacks",
    "nested_dissection",
    "row_groups",
    "shifted",
]


def __getattr__(name: str) -> Any:
    # The factor needs numba, which takes half a second to load.
    if name in ("CholeskyFactor", "FactorSize", "NotPositiveDefiniteError", "UnstableError", "compile_loops"):
        return getattr(import_module("cmsreduce.multifrontal.factor"), name)
    if name == "compiled_folder":
        return import_module("cmsreduce.multifrontal.loops").compiled_folder
    if name == "shifted":
        return import_module("cmsreduce.multifrontal.shift").shifted
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


@cache
def lacks() -> str:
    """Name of the package that `CholeskyFactor` with nested dissection lacks here; empty if it lacks none."""
    if not dissection_installed():
        return "METIS (pip install pymetis)"
    try:
        # This also fails without a folder for compiled code.
        import_module("cmsreduce.multifrontal.factor")
    except (ImportError, RuntimeError) as error:
        return f"numba ({error})"
    return ""
