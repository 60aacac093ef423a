"""Keys that name a file, and the part of it to read."""

from __future__ import annotations

import re
from typing import Any, ClassVar

from pydantic import Field, model_validator

from cmsreduce.config.keys.mapping import DataPath, Flag, Keys, Plain, exactly_one

__all__ = ["ControllerFile", "GeometryFile", "MatrixFile", "RowOrder"]

# Displacement sets of a NASTRAN user set table; anything longer is a file name.
_SET_NAME = re.compile(r"[a-z]{1,2}|u[1-6]")


class MatrixFile(Keys):
    """A file that holds a matrix; a lone text is the file's name."""

    short_key: ClassVar[str] = "file"
    short_schema: ClassVar[tuple[dict[str, Any], ...]] = ({"type": "string"},)

    file: DataPath = Field(description="File name, relative to the file it is written in.", examples=["rotor.op4"])
    matrix: Plain | None = Field(
        default=None, description="Name of the matrix, where the file holds several.", examples=["KAA"]
    )
    format: Plain | None = Field(
        default=None, description="Format of the file; by default found by its content.", examples=["op4"]
    )


class GeometryFile(Keys):
    """A file that holds nodes, coordinate frames and dof sets; a lone text is the file's name."""

    short_key: ClassVar[str] = "file"
    short_schema: ClassVar[tuple[dict[str, Any], ...]] = ({"type": "string"},)

    file: DataPath = Field(description="File name, relative to the file it is written in.", examples=["rotor.bdf"])
    format: Plain | None = Field(
        default=None, description="Format of the file; by default found by its content.", examples=["bulk"]
    )


class ControllerFile(Keys):
    """A file that holds a controller in state space; a lone text is the file's name."""

    short_key: ClassVar[str] = "file"
    short_schema: ClassVar[tuple[dict[str, Any], ...]] = ({"type": "string"},)

    file: DataPath = Field(description="File name, relative to the file it is written in.", examples=["controller.mat"])


class RowOrder(Keys):
    """Order of the matrix rows: a set of the deck, or a dof list; a lone text is either of them, or ``trusted``."""

    short_schema: ClassVar[tuple[dict[str, Any], ...]] = ({"type": "string"},)

    set: Plain | None = Field(default=None, description="Displacement set of the deck: a, f, g, b, ...", examples=["a"])
    file: DataPath | None = Field(
        default=None,
        description="File with one dof per row, relative to the file it is written in.",
        examples=["rotor.dof"],
    )
    trusted: Flag = Field(
        default=False,
        description="Go on with rows whose order is not proven; the verdict names the body. All other checks stay.",
        examples=[True],
    )

    @classmethod
    def written_out(cls, value: object) -> object:
        """The word ``trusted`` is the key; one or two small letters name a set, everything else a file."""
        if value == "trusted":
            return {"trusted": True}
        if isinstance(value, str):
            return {"set" if _SET_NAME.fullmatch(value) else "file": value}
        return value

    @model_validator(mode="after")
    def _one(self) -> RowOrder:
        if not (self.trusted and self.set is None and self.file is None):
            exactly_one(self, ("set", "file"), "rows")
        return self
