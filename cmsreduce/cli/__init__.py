"""The command line: thin commands over the pipeline, their options, and how each of them ends.

A command joins rooms below it and prints what they say.
Words of results belong in `report`, and whatever is computed in `pipeline`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cmsreduce.cli.commands import main

__all__ = ["main"]


def __getattr__(name: str) -> Any:
    # Only when it is used: `__main__` decides first what Ctrl-C does while the commands load.
    if name != "main":
        raise AttributeError(f"module 'cmsreduce.cli' has no attribute '{name}'")
    from cmsreduce.cli.commands import main

    return main
