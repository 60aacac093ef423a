"""Stages of a run that join its reduced bodies, and the models that are compared with its own."""

from __future__ import annotations

from collections.abc import Mapping

from cmsreduce.config import CompareKeys
from cmsreduce.errors import StageError
from cmsreduce.model import ConfigurationResult
from cmsreduce.pipeline.bodies import spin_notes
from cmsreduce.pipeline.run.choice import ChoiceStages
from cmsreduce.pipeline.store import diagnostic, stage
from cmsreduce.pipeline.system import MODEL, ReducedModel

__all__ = ["SystemStages"]


class SystemStages(ChoiceStages):
    """The stages of a run that treat the system of all bodies.

    Takes what :class:`BodyStages` takes.
    """

    @property
    @stage(
        "assemble",
        needs=["final"],
        notes=lambda run, found: spin_notes(run.pipeline.scene.spin, run.bodies, run.final),
    )
    def model(self) -> ReducedModel:
        """The reduced system of the run, assembled in every configuration."""
        model = self.joined(self.final)
        for number, configuration in enumerate(self.scene.configurations):
            model.assembled.system(configuration)
            self.stages.progress.advance(number + 1, len(self.scene.configurations))
        return model

    def models(self) -> dict[str, ReducedModel]:
        """The reduced models that are compared with the reference model, the run's own first."""
        models = {MODEL: self.model}
        keys = self.pipeline.verify
        for label, ranking in (keys.compare if keys else {}).items():
            model = self._other(label, ranking)
            if model is not None:
                models[label] = model
        return models

    @diagnostic("the comparison with the model '{}'", about=lambda run, label, _: label, passes=(StageError,))
    def _other(self, label: str, ranking: CompareKeys) -> ReducedModel | None:
        """A model that the run's own is compared with."""
        return self.joined(self.balancing.kept_by(ranking, ranking.reduce))

    def measured(self, models: Mapping[str, ReducedModel]) -> tuple[ConfigurationResult, ...]:
        """Errors and curves of reduced models in every configuration."""
        return self.comparison.errors(models, self.stages.progress)
