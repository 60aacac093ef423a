"""A run that is one point of a sweep: what it has in common with the others is done once."""

from __future__ import annotations

import copy
from collections.abc import Callable, Hashable, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

from cmsreduce.assemble import modal_substructure, physical_substructure
from cmsreduce.config import Pipeline
from cmsreduce.pipeline.bodies import ALL_MODES_LIMIT, FlexibleBody, Reference
from cmsreduce.pipeline.run import Run
from cmsreduce.pipeline.store import Progress, modal_from, modal_to, stage_key
from cmsreduce.pipeline.system import Comparison

__all__ = ["CommonWork", "SweepRun"]

T = TypeVar("T")
# Sets of bodies as read and of unreduced bodies that are held at once: those of the points before and after a change.
_BODIES, _FULL = 16, 1


class CommonWork:
    """What points of a sweep have in common, in memory: bodies as read, their references, the full system."""

    def __init__(self) -> None:
        self._held: dict[str, dict[Hashable, Any]] = {}

    def get(self, kind: str, key: Hashable) -> Any:
        """What is held under a key; None if nothing is."""
        return self._held.get(kind, {}).get(key)

    def hold(self, kind: str, key: Hashable, value: T, most: int = _BODIES) -> T:
        """Hold a value, and let go of the oldest of its kind beyond so many."""
        held = self._held.setdefault(kind, {})
        held.pop(key, None)
        held[key] = value
        while len(held) > most:
            del held[next(iter(held))]
        return value

    def once(self, kind: str, key: Hashable, work: Callable[[], T]) -> T:
        """What is held under a key, done if it is not."""
        found: T | None = self.get(kind, key)
        return self.hold(kind, key, work()) if found is None else found


class SweepRun(Run):
    """One point.

    Parameters
    ----------
    pipeline : Pipeline
    folder : Path
        Run directory.
    progress : Progress
    common : CommonWork
        Shared with the points before and after it.
    """

    def __init__(self, pipeline: Pipeline, folder: Path, progress: Progress, common: CommonWork) -> None:
        super().__init__(pipeline, folder, progress)
        self._common = common

    def flexible(self, name: str) -> FlexibleBody:
        """Read one flexible body and check it, or take it from another point."""
        return self._common.once("body", self._body_key(name), lambda: Run.flexible(self, name))

    def unreduced(self, name: str) -> Reference:
        """One body as it was read, or what stands for it, from memory, the common store, or made."""
        body, points = self.bodies[name].body, self.bodies[name].points(self.scene)
        key = self._reference_key(name)

        def unpack(arrays: Mapping[str, Any], facts: Mapping[str, Any]) -> Reference:
            if "Phi" not in arrays:
                return Reference(physical_substructure(body, points, self.bodies[name].rigid), None, facts["reference"])
            modes = modal_from(body, arrays, facts)
            return Reference(modal_substructure(modes, points), modes, facts["reference"])

        def find() -> Reference:
            work = Run.unreduced
            return self.ledger.once("reference", name, key, lambda: work(self, name), _packed, unpack)

        return self._common.once("reference", (key, tuple(points)), find)

    @cached_property
    def comparison(self) -> Comparison:
        """The full system, of which another point may have computed the responses."""
        references = {name: self._reference_key(name) for name in self.references}
        key = (self._full_key, self._points, tuple(references.items()))
        known: Comparison | None = self._common.get("full", key)
        # Its clocks are this point's own; its systems, modes and tables are everybody's.
        mine = super().comparison if known is None else copy.copy(known)
        mine.full_seconds = mine.reduced_seconds = 0.0
        return self._common.hold("full", key, mine, _FULL)

    def _body_key(self, name: str) -> str:
        keys = self.pipeline.reduce_of(name)
        part = self.pipeline.components[name].model_dump(mode="json", exclude={"reduce", "balance"})
        scene = self.pipeline.scene.model_dump(mode="json", exclude={"band", "articulation"})
        return stage_key("read", name, part, scene, None if keys is None else keys.residuals)

    def _reference_key(self, name: str) -> str:
        flexible = self.bodies[name]
        # Small bodies are represented whole; the others' stand-in depends on the cutoff.
        cutoff = None if flexible.body.n <= ALL_MODES_LIMIT else self.mode_sets.multiple(name) * self.scene.band[1]
        rigid = name in self.mode_sets.unneeded
        return stage_key("reference", flexible.fingerprint, repr(flexible.body.damping), cutoff, rigid)

    @property
    def _full_key(self) -> str:
        rigid = {
            name: part.model_dump(mode="json", exclude={"reduce", "balance"})
            for name, part in self.pipeline.components.items()
        }
        return stage_key("read", self.pipeline.scene.model_dump(mode="json"), rigid)


def _packed(found: Reference) -> tuple[dict[str, Any], dict[str, Any]]:
    arrays, facts = ({}, {}) if found.modes is None else modal_to(found.modes)
    return arrays, {**facts, "reference": found.label}
