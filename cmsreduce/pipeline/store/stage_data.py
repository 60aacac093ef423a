"""Results of stages as arrays and JSON facts, and back: one encoding for every frozen dataclass.

Arrays are named by their path inside the result, such as ``modes.Phi``; everything else is JSON. Bodies and
configurations are not stored: they are part of what a stage is made from, and are named instead.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from importlib import import_module
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.model import Configuration, FEModel

__all__ = ["Arrays", "Given", "decode", "encode"]

Arrays = dict[str, NDArray[Any]]
Given = Mapping[str, Mapping[str, Any]]
"""Objects that are named instead of stored: class name, name, object."""

_GIVEN = (FEModel, Configuration)
_PLAIN = (str, int, float, bool, type(None))
_PACKAGE = "cmsreduce."
_COMPRESSED = {"csc": sp.csc_array, "csr": sp.csr_array}


def encode(value: Any) -> tuple[Arrays, Any]:
    """Arrays of a value by their paths, and the rest as JSON.

    Raises
    ------
    TypeError
        If the value holds something else than dataclasses, tuples, lists, mappings, arrays, sparse arrays in
        compressed form, text and numbers.

    Examples
    --------
    >>> encode({"a": (1.5, None)})
    ({}, {'map': [['a', {'tuple': [1.5, None]}]]})
    """
    arrays: Arrays = {}
    return arrays, _encoded(value, "", arrays)


def decode(arrays: Mapping[str, NDArray[Any]], facts: Any, given: Given) -> Any:
    """The value that `encode` was given.

    Parameters
    ----------
    arrays : mapping of str to array
        Arrays by their paths.
    facts : JSON
        The rest.
    given : mapping of class name to mapping of name to object
        Bodies and configurations that the value refers to.
    """
    if isinstance(facts, list):
        return [decode(arrays, each, given) for each in facts]
    if not isinstance(facts, dict):
        return facts
    if "array" in facts:
        return arrays[facts["array"]]
    if "sparse" in facts:
        parts = tuple(decode(arrays, part, given) for part in facts["parts"])
        return _COMPRESSED[facts["sparse"]](parts, shape=tuple(facts["shape"]))
    if "given" in facts:
        return given[facts["given"]][facts["name"]]
    if "tuple" in facts:
        return tuple(decode(arrays, each, given) for each in facts["tuple"])
    if "map" in facts:
        return {decode(arrays, key, given): decode(arrays, each, given) for key, each in facts["map"]}
    module, _, name = facts["class"].partition(":")
    kind = getattr(import_module(module), name) if module.startswith(_PACKAGE) else None
    if not (isinstance(kind, type) and is_dataclass(kind)):
        raise TypeError(f"a stage holds a '{facts['class']}', which is no dataclass of this package")
    return kind(**{name: decode(arrays, each, given) for name, each in facts["fields"].items()})


def _encoded(value: Any, path: str, arrays: Arrays) -> Any:
    def inside(each: Any, step: object) -> Any:
        return _encoded(each, f"{path}.{step}" if path else str(step), arrays)

    if isinstance(value, np.ndarray):
        arrays[path or "value"] = value
        return {"array": path or "value"}
    if isinstance(value, (sp.csc_array, sp.csr_array)):
        entries = [inside(getattr(value, part), part) for part in ("data", "indices", "indptr")]
        return {"sparse": value.format, "shape": list(value.shape), "parts": entries}
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, _PLAIN):
        return value
    if isinstance(value, _GIVEN):
        return {"given": type(value).__name__, "name": value.name}
    if isinstance(value, tuple):
        return {"tuple": [inside(each, number) for number, each in enumerate(value)]}
    if isinstance(value, list):
        return [inside(each, number) for number, each in enumerate(value)]
    if isinstance(value, Mapping):
        # As pairs: JSON keeps neither the order nor the type of keys. Names may hold what a dataset's may not.
        return {"map": [[key, inside(each, number)] for number, (key, each) in enumerate(value.items())]}
    if is_dataclass(value) and not isinstance(value, type):
        kind = type(value)
        parts = {field.name: inside(getattr(value, field.name), field.name) for field in fields(value)}
        return {"class": f"{kind.__module__}:{kind.__name__}", "fields": parts}
    raise TypeError(f"{path or 'a result'} is a {type(value).__name__}, which no stage can store")
