"""Results that an object computes once and holds as long as it lives."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from copy import copy
from functools import wraps
from typing import Any, Concatenate, ParamSpec, TypeVar, cast

__all__ = ["branch_of", "once"]

P = ParamSpec("P")
T = TypeVar("T")


def _named(owner: object, *args: object, **named: object) -> Hashable:
    """Names of the arguments; an argument without a name stands for itself."""
    return tuple(getattr(value, "name", value) for value in (*args, *named.values()))


def once(
    work: Callable[Concatenate[Any, P], T], about: Callable[..., Hashable] = _named
) -> Callable[Concatenate[Any, P], T]:
    """Make a method compute each result once; the object holds the result as long as it lives.

    Parameters
    ----------
    work : callable
        The method.
    about : callable, optional
        Takes the object and the arguments, gives the label of the result; by default the names of the arguments, such
        as that of a configuration.
    """

    @wraps(work)
    def remembered(owner: Any, *args: P.args, **named: P.kwargs) -> T:
        memory: dict[Hashable, T] = owner.__dict__.setdefault("_results", {})
        label = work.__name__, about(owner, *args, **named)
        if label not in memory:
            memory[label] = work(owner, *args, **named)
        return memory[label]

    return cast(Callable[Concatenate[Any, P], T], remembered)


def branch_of(owner: T) -> T:
    """Copy an object with the results that it holds; what the copy finds further it keeps to itself."""
    branch = copy(owner)
    branch.__dict__["_results"] = dict(owner.__dict__.get("_results", {}))
    return branch
