"""One run of a pipeline: its stages in the order data flows, each done once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from types import MappingProxyType
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from cmsreduce.linalg.blocks import dense
from cmsreduce.model import ModalComponent, Values
from cmsreduce.orthogonalise import at_parameters
from cmsreduce.pipeline.bodies import all_modes
from cmsreduce.pipeline.run.verification import VerifyStages
from cmsreduce.pipeline.store import once
from cmsreduce.pipeline.system import MODEL

__all__ = ["MODEL", "STAGES", "Run"]

T = TypeVar("T")

STAGES = ("read", "reduce", "orthogonalise", "balance", "project", "assemble", "verify", "write")
"""Stages in the order data flows."""


class Run(VerifyStages):
    """One run of a pipeline: the stages of its bodies, the choice of modes, the system of all bodies, and its files.

    Takes what :class:`BodyStages` takes.
    """

    _values: Values = MappingProxyType({})

    def at_values(self, values: Values) -> Run:
        """The run with its bodies written at some values of their parameters; all results are shared."""
        other = copy(self)
        other._values = values
        return other

    def written(self, name: str) -> ModalComponent:
        """A flexible body as it is written: reduced, or in all its modes where the pipeline does not reduce it."""
        found = self.final[name] if name in self.final else self._unreduced[name]
        return at_parameters(found, self._values) if self._values else found

    @property
    @once
    def _unreduced(self) -> dict[str, ModalComponent]:
        found = {}
        for name in (name for name in self.flexible_names if name not in self.final):
            flexible, own = self.bodies[name], self.references[name].modes
            found[name] = all_modes(flexible.body, flexible.rigid) if own is None else own
            self.stages.note(f"{name}: not reduced; its files hold all its {found[name].omega.size} modes")
        return found

    def written_motions(self, name: str) -> NDArray[np.float64]:
        """Motions of the points of a body from the amplitudes of its modes as written (6 points, m)."""
        if self._values:
            sub = self.bodies[name].substructure(self.scene, self.written(name))
            labels = self.model.assembled.substructures[name].motion
            return np.vstack([np.asarray(sub.motion[label]) for label in labels])
        motions = dense(self.model.assembled.stack.motions(name))
        in_dofs = name not in self.final and self.references[name].modes is None
        return motions @ self.written(name).Phi if in_dofs else motions

    @property
    def is_finished(self) -> bool:
        """True if every stage is stored for these files and settings, so that nothing is left to compute."""
        store = self.stages.store
        # Files are hashed up to the first body that is not proven.
        if any(store.facts("read", name, self.proof_key(name)) is None for name in self.flexible_names):
            return False
        if not self.has_response:
            return False
        return store.facts("verify", "system", self._system_key("verify")) is not None

    def on_bodies(self, work: Callable[..., T], names: Sequence[str], *shared: object) -> list[T]:
        """Results of a piece of work on each of some bodies; it takes the run, a name, and what all have in common."""
        return [work(self, name, *shared) for name in names]
