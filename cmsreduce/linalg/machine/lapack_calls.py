"""LAPACK routines for which scipy has no function: scipy links them and gives their addresses to compiled code."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cython_lapack

__all__ = ["lapack_call", "lapack_offers"]

_CAPSULES: Mapping[str, object] = getattr(cython_lapack, "__pyx_capi__", {})


def lapack_call(name: str, *arguments: bytes | int | NDArray[np.float64]) -> int:
    """Call a LAPACK routine with its arguments in order.

    Returns
    -------
    int
        INFO, the last argument of the routine.
    """
    info = ctypes.c_int(0)
    held = [
        ctypes.c_char(each) if isinstance(each, bytes) else ctypes.c_int(each) if isinstance(each, int) else each
        for each in arguments
    ]
    addresses = [each.ctypes.data if isinstance(each, np.ndarray) else ctypes.addressof(each) for each in held]
    _routine(name, len(held) + 1)(*addresses, ctypes.addressof(info))
    return info.value


@cache
def lapack_offers(*names: str) -> bool:
    """True if `lapack_call` can call some routines: scipy has their addresses, and their integers have 32 bits."""
    return all(name in _CAPSULES and b"int *" in _signature(name) for name in names)


@cache
def _routine(name: str, count: int) -> Callable[..., None]:
    """A routine with ``count`` arguments, all of them addresses."""
    pointer = ctypes.pythonapi.PyCapsule_GetPointer
    pointer.restype, pointer.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    return ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * count)(pointer(_CAPSULES[name], _signature(name)))


def _signature(name: str) -> bytes:
    capsule_name = ctypes.pythonapi.PyCapsule_GetName
    capsule_name.restype, capsule_name.argtypes = ctypes.c_char_p, [ctypes.py_object]
    return bytes(capsule_name(_CAPSULES[name]))
