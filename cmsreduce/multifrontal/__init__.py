"""A sparse Cholesky solver: multifrontal, on all threads, for blocks of vectors, in double or single precision.

Its graph algorithms, compiled loops and calls of BLAS belong here, and the nested dissection that orders the rows.
Nothing of bodies, settings, files or other solvers does: it imports nothing of the rest of the package.
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any

from cmsreduce.multifrontal.ordering import compressed_graph, dissection_installed, nested_dissection, row_groups
from cmsreduce.multifrontal.threads import blas_threads

if TYPE_CHECKING:
    from cmsreduce.multifrontal.factor import CholeskyFactor, FactorSize, NotPositiveDefiniteError

__all__ = [
    "CholeskyFactor",
    "FactorSize",
    "NotPositiveDefiniteError",
    "blas_threads",
    "compressed_graph",
    "dissection_installed",
    "lacks",
    "nested_dissection",
    "row_groups",
]


def __getattr__(name: str) -> Any:
    # The factor needs numba, which takes half a second to load.
    if name in ("CholeskyFactor", "FactorSize", "NotPositiveDefiniteError"):
        return getattr(import_module("cmsreduce.multifrontal.factor"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


@cache
def lacks() -> str:
    """Say what is missing for a `CholeskyFactor` with an order of its own; nothing where it can be made."""
    if not dissection_installed():
        return "METIS (pip install pymetis)"
    try:
        # Compiled code needs a folder to be kept in.
        import_module("cmsreduce.multifrontal.factor")
    except (ImportError, RuntimeError) as error:
        return f"numba ({error})"
    return ""
