"""The measure of a model of the scene: each error over its limit, the largest counts; at most 1 passes.

The verdict of a run and the search for the smallest model use these functions, and `Measured` judges what they find.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cmsreduce.config import VerifyKeys
from cmsreduce.errors import ConstraintError
from cmsreduce.model import (
    CHECK_OF,
    CONTROLLER_LIMITS,
    AxisCompleteness,
    BetweenErrors,
    Configuration,
    ConfigurationResult,
    Controller,
    ControllerMargin,
    Measured,
    ModalComponent,
    ReductionChecks,
    Response,
    Scene,
    SystemModes,
)
from cmsreduce.pipeline.bodies import FlexibleBody
from cmsreduce.pipeline.store import Failures, Silent, collecting, diagnostic
from cmsreduce.pipeline.system.between import errors_between
from cmsreduce.pipeline.system.comparison import Comparison
from cmsreduce.pipeline.system.completeness import axis_completeness
from cmsreduce.pipeline.system.controlled import controller_margins
from cmsreduce.pipeline.system.model_errors import model_errors
from cmsreduce.pipeline.system.reduced_model import ReducedModel
from cmsreduce.pipeline.system.reduction_health import (
    StaticProbes,
    UnitLoads,
    checks_statics,
    reduction_checks,
    unit_loads,
)
from cmsreduce.pipeline.system.reference_model import Target
from cmsreduce.pipeline.system.simulation_cost import highest_frequency
from cmsreduce.pipeline.system.stability import SystemRoots, system_roots

__all__ = ["MODEL", "ModelMeasure"]

MODEL = "reduced"
"""Label of the run's own model among those it is compared with."""

# Coordinates of a reference model whose loop has all its roots in two seconds.
_QUICK_LOOP = 400


class ModelMeasure:
    """Errors and checks of models of one scene, under the limits of a run.

    Parameters
    ----------
    keys : VerifyKeys
        Limits, checks, and the midpoint configurations that are judged.
    scene : Scene
        Configurations, channels, band.
    bodies : mapping of name to FlexibleBody
        As read.
    comparison : callable
        Gives the reference model, which is made only when it is needed.
    untruncated : callable
        Gives the system with every mode of the mode sets.
    controller : Controller, optional
        Of the scene.
    loaded : callable, optional
        Gives the unit loads of a body, which are made anew otherwise.
    """

    def __init__(
        self,
        keys: VerifyKeys,
        scene: Scene,
        bodies: Mapping[str, FlexibleBody],
        comparison: Callable[[], Comparison],
        untruncated: Callable[[], ReducedModel],
        controller: Controller | None = None,
        loaded: Callable[[str], UnitLoads] | None = None,
    ) -> None:
        self.keys, self.scene, self.bodies, self.controller = keys, scene, bodies, controller
        self._comparison, self._untruncated = comparison, untruncated
        self._full_roots: dict[str, SystemRoots | None] = {}
        self._loaded = loaded or (lambda name: unit_loads(bodies[name], scene))

    def changed(
        self,
        scene: Scene,
        bodies: Mapping[str, FlexibleBody],
        comparison: Callable[[], Comparison],
        untruncated: Callable[[], ReducedModel],
    ) -> ModelMeasure:
        """The measure in a changed scene; without the controller if that reads sensors which are not there."""
        same = [each.name for each in scene.sensors] == [each.name for each in self.scene.sensors]
        return ModelMeasure(self.keys, scene, bodies, comparison, untruncated, self.controller if same else None)

    @property
    def limits(self) -> dict[str, float]:
        """Limits of the run by the names of errors and checks; those of a controller hold without being stated."""
        own = self.keys.limits.model_dump(exclude_none=True)
        return own if self.controller is None else {**CONTROLLER_LIMITS, **own}

    @property
    def comparison(self) -> Comparison:
        """The reference model."""
        return self._comparison()

    def measured(
        self,
        components: Mapping[str, ModalComponent],
        model: ReducedModel,
        limits: Mapping[str, float] | None = None,
        *,
        between: bool = True,
        truncated: bool = True,
    ) -> Measured:
        """Measure everything that has a limit, as the verify stage does.

        Parameters
        ----------
        components : mapping of name to ModalComponent
            The reduced bodies of the model.
        model : ReducedModel
        limits : mapping of str to float, optional
            Limits that count; by default those of the run.
        between : bool
            Judge midpoint configurations, too.
        truncated : bool
            True if modes of the mode sets were left out.

        Returns
        -------
        Measured
            Its ``critical`` finding has the largest ratio to its limit, the measure of the model. Parts that fail are
            among its failures, and break their limits.
        """
        limits = self.limits if limits is None else limits
        with collecting(Failures()) as failures:
            results = self.comparison.errors({MODEL: model}, Silent(), damped="damping_error" in limits)
            apart = self.errors_between(model) if between and "frf_error" in limits else None
            found = self._judged(results, components, model, limits, self.scene.configurations, truncated)
            return replace(found, between=apart, failures=tuple(failures))

    def at(
        self,
        target: Target,
        model: ReducedModel,
        H_r: NDArray[np.complex128],
        in_db: NDArray[np.float64],
        limits: Mapping[str, float],
        *,
        truncated: bool,
    ) -> Measured:
        """Measure a model in one configuration, by its response on the grid of a target.

        Parameters
        ----------
        target : Target
            Response of the reference model.
        model : ReducedModel
        H_r : (f, outputs, inputs) complex128
            Response of the model on the grid of the target.
        in_db : (outputs, inputs) float64
            Its decibel errors.
        limits : mapping of str to float
            Limits that count; those of the bodies alone, and of midpoint configurations, are not judged here.
        truncated : bool
            True if modes of the mode sets were left out.
        """
        with collecting(Failures()) as failures:
            damped, at_peaks = "damping_error" in limits, "peak_error" in limits
            reference = self.comparison.reference
            errors = model_errors(reference, target, model, H_r, in_db, damped=damped, at_peaks=at_peaks)
            response = Response(target.omega / (2 * np.pi), target.elastic + target.rigid, {MODEL: H_r})
            result = ConfigurationResult(target.configuration, 0, 0, 0, 0, {MODEL: errors}, response)
            found = self._judged([result], {}, model, limits, [target.configuration], truncated)
            return replace(found, failures=tuple(failures))

    def _judged(
        self,
        results: Sequence[ConfigurationResult],
        components: Mapping[str, ModalComponent],
        model: ReducedModel,
        limits: Mapping[str, float],
        configurations: Sequence[Configuration],
        truncated: bool,
    ) -> Measured:
        """Findings with a limit in some configurations, beside those of the responses."""
        required = {check for figure, check in CHECK_OF.items() if figure in limits}
        controlled = not CONTROLLER_LIMITS.keys().isdisjoint(limits)
        return Measured(
            configurations=tuple(results),
            limits=limits,
            model=MODEL,
            inputs=tuple(channel.name for channel in self.scene.actuators),
            outputs=tuple(channel.name for channel in self.scene.sensors),
            systems=self.systems(model, configurations) if "highest_frequency" in limits else (),
            completeness=self.completeness(model, configurations) if "hinge_inertia" in limits else (),
            checks=self.checks(required, components, model, configurations, usual=False) if required else None,
            margins=self.margins(results, lambda: self.roots(model, configurations)) if controlled else (),
            truncated=truncated,
        )

    def checks_statics(self, name: str) -> bool:
        """True if a run checks the static completeness of a body."""
        return checks_statics(self.bodies[name].body.n, self.keys.required_checks, usual=self.keys.checks is None)

    def static_shares(self, components: Mapping[str, ModalComponent]) -> dict[str, StaticProbes]:
        """Shares of the static strain energy that each mode of the bodies holds."""
        return {name: self._loaded(name).probes(part) for name, part in components.items()}

    def systems(self, model: ReducedModel, configurations: Sequence[Configuration]) -> tuple[SystemModes, ...]:
        """Highest frequency of a model in each configuration."""
        highest = {each.name: highest_frequency(model.assembled, each) for each in configurations}
        return tuple(SystemModes(each, 0, np.empty(0), highest[each.name]) for each in configurations)

    @diagnostic("the errors between the sampled configurations", limits=("frf_error",))
    def errors_between(self, model: ReducedModel) -> BetweenErrors:
        """Errors at midpoint configurations."""
        return errors_between(self.comparison, model, self.most_between)

    @property
    def most_between(self) -> int | None:
        """Largest number of midpoint configurations; None for all."""
        return None if self.keys.between == "all" else self.keys.between

    @diagnostic(
        "the checks of the reduction",
        ReductionChecks,
        limits=("static_lack", "gain_error", "zero_error", "zeros_lost", "step_error"),
    )
    def checks(
        self,
        required: Collection[str],
        components: Mapping[str, ModalComponent],
        model: ReducedModel,
        configurations: Sequence[Configuration],
        *,
        usual: bool,
    ) -> ReductionChecks:
        """Static completeness, gains, zeros and step responses; see `reduction_checks`."""
        full = self.comparison.reference.assembled if self.scene.actuators and self.scene.sensors else None
        return reduction_checks(
            required, usual, self.scene, configurations, self._loaded, components, full, model.assembled
        )

    @diagnostic("the completeness at the hinges", tuple, limits=("hinge_inertia",))
    def completeness(
        self, model: ReducedModel, configurations: Sequence[Configuration]
    ) -> tuple[AxisCompleteness, ...]:
        """Share of the inertia at each hinge that the modes hold; empty if hinges move each other, as in a loop."""
        try:
            return axis_completeness(model.assembled, self._untruncated().assembled, configurations)
        except ConstraintError:
            return ()

    def roots(self, model: ReducedModel, configurations: Sequence[Configuration]) -> dict[str, SystemRoots | None]:
        """Roots of a model in each configuration, its loop closed; None where they are not known."""
        return {each.name: system_roots(model.assembled, each, self.controller) for each in configurations}

    @diagnostic("the margins of the controller", tuple, limits=("controller_ratio", "controller_unstable"))
    def margins(
        self, results: Sequence[ConfigurationResult], roots: Callable[[], Mapping[str, SystemRoots | None]]
    ) -> tuple[ControllerMargin, ...]:
        """Margins of the controller in every configuration; empty without one."""
        if self.controller is None:
            return ()
        return controller_margins(self.controller, results, roots(), self._reference_roots(results), MODEL)

    def _reference_roots(self, results: Sequence[ConfigurationResult]) -> dict[str, SystemRoots | None]:
        """Roots of the loop with the reference model, which no candidate changes; None for a large one."""
        model = self.comparison.reference.assembled
        for configuration in (each.configuration for each in results):
            if configuration.name not in self._full_roots:
                small = model.system(configuration).N <= _QUICK_LOOP
                found = system_roots(model, configuration, self.controller) if small else None
                self._full_roots[configuration.name] = found
        return self._full_roots
