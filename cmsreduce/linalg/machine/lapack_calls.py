"""Routines of LAPACK that scipy links and lends to compiled code, but has no function for."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cython_lapack

__all__ = ["lapack_call", "lent"]

Array = NDArray[np.float64]


def lapack_call(name: str, *arguments: bytes | int | Array) -> int:
    """Call a routine of LAPACK with its arguments in order, and return its last one, INFO."""
    info = ctypes.c_int(0)
    held = [
        ctypes.c_char(each) if isinstance(each, bytes) else ctypes.c_int(each) if isinstance(each, int) else each
        for each in arguments
    ]
    where = [each.ctypes.data if isinstance(each, np.ndarray) else ctypes.addressof(each) for each in held]
    _routine(name, len(held) + 1)(*where, ctypes.addressof(info))
    return info.value


@cache
def _routine(name: str, count: int) -> Callable[..., None]:
    """A routine that scipy links and lends to compiled code, but has no function for."""
    capsule, pointer = _lent()[name], ctypes.pythonapi.PyCapsule_GetPointer
    pointer.restype, pointer.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    return ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * count)(pointer(capsule, _signature(capsule)))


def _signature(capsule: object) -> bytes:
    name = ctypes.pythonapi.PyCapsule_GetName
    name.restype, name.argtypes = ctypes.c_char_p, [ctypes.py_object]
    return bytes(name(capsule))


def _lent() -> Mapping[str, object]:
    return getattr(cython_lapack, "__pyx_capi__", {})


@cache
def lent(*names: str) -> bool:
    """Whether scipy lends some routines, with integers of the size that is assumed here."""
    found = _lent()
    return all(name in found and b"int *" in _signature(found[name]) for name in names)
