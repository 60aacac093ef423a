"""Findings of the project stage."""

from __future__ import annotations

from dataclasses import dataclass

from cmsreduce.model import ModalComponent, ProjectionRecord

__all__ = ["Projected"]


@dataclass(frozen=True, eq=False)
class Projected:
    """Bodies after projection.

    Parameters
    ----------
    components : mapping of name to ModalComponent
        Rigid modes, and those that span the body's part of the chosen system modes.
    record : ProjectionRecord
        What was done.
    notes : tuple of str
        What a reader must know.
    """

    components: dict[str, ModalComponent]
    record: ProjectionRecord
    notes: tuple[str, ...]
