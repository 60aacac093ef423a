"""Names of files on the command line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

__all__ = ["PATH", "FileName", "refuse_log_over"]


class FileName(click.Path):
    """Name of a file or folder. An empty one, as of a shell variable that is not set, is not the present folder."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The name as the command takes it."""
        if value == "":
            self.fail("the name is empty", param, ctx)
        return super().convert(value, param, ctx)


PATH: Any = FileName(path_type=Path)
"""Type of options and arguments that name a file or a folder."""


def refuse_log_over(path: Path | None) -> None:
    """Refuse a log in the place of a model, a pipeline or a result, before that is opened for writing.

    Raises
    ------
    WriteError
        If the path is such a file.
    """
    if path is not None:
        from cmsreduce.pipeline.results import refuse_model_file

        refuse_model_file(path)
