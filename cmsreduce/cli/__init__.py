"""The command line: thin commands over the pipeline, their options, and how each of them ends.

A command joins rooms below it and prints what they say.
Words of results belong in `report`, and whatever is computed in `pipeline`.
"""

from cmsreduce.cli.commands import main

__all__ = ["main"]
