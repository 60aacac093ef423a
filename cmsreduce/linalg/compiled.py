"""Whether loops can be compiled here."""

from __future__ import annotations

from functools import cache
from importlib import import_module

__all__ = ["compiled_lacks", "worth_compiling"]

# Rows from which on loops are compiled for it: MKL and numpy's BLAS take twice as long, MKL at some widths ten times.
_ROWS = 50_000


@cache
def compiled_lacks() -> str:
    """Say what is missing for compiled loops; nothing where they can be made."""
    try:
        # Compiled code needs a folder to be kept in.
        import_module("cmsreduce.linalg.narrow_products")
    except (ImportError, RuntimeError) as error:
        return f"numba ({error})"
    return ""


def worth_compiling(n: int) -> bool:
    """Whether loops are compiled for blocks of so many rows, and can be."""
    return n >= _ROWS and not compiled_lacks()
