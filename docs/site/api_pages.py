"""Reference pages of the package: every public name of a room, from its docstring."""

from __future__ import annotations

import importlib
from types import ModuleType

__all__ = ["ROOMS", "api_page"]

ROOMS = (
    *("read", "reduce", "orthogonalise", "balance", "project", "assemble", "verify", "write", "report", "simulate"),
    *("pipeline", "config", "model", "errors", "runs", "steps", "models_in_memory", "body_in_memory"),
)
"""The rooms in the order of the data flow, then those that join them, the data, and the front door."""


def api_page(room: str) -> str:
    """Page of one room, for mkdocstrings to fill in.

    Parameters
    ----------
    room : str
        Name of the module within the package.
    """
    module = importlib.import_module(f"cmsreduce.{room}")
    names = sorted(module.__all__, key=lambda name: (name.isupper(), name.lower()))
    parts = [f"# cmsreduce.{room}", (module.__doc__ or "").strip()]
    parts += [f"::: {_defined(module, name)}" for name in names]
    return "\n\n".join(parts) + "\n"


def _defined(module: ModuleType, name: str) -> str:
    """Full name of the definition: a room may have a module and a function of one name."""
    found = getattr(module, name)
    home = getattr(found, "__module__", "")
    return f"{home if home.startswith('cmsreduce.') else module.__name__}.{name}"
