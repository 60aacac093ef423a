"""Whether loops can be compiled here."""

from __future__ import annotations

from functools import cache
from importlib import import_module

__all__ = ["compiled_lacks"]


@cache
def compiled_lacks() -> str:
    """Say what is missing for compiled loops; nothing where they can be made."""
    try:
        # Compiled code needs a folder to be kept in.
        import_module("cmsreduce.linalg.narrow_products")
    except (ImportError, RuntimeError) as error:
        return f"numba ({error})"
    return ""
