"""Verification of a run: errors at midpoint configurations, checks, margins and proofs of the reduced system."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from cmsreduce.model import (
    AxisCompleteness,
    BetweenErrors,
    ConfigurationResult,
    ControllerMargin,
    Failure,
    Proof,
    ReductionChecks,
)
from cmsreduce.pipeline.bodies import ALL_MODES_LIMIT
from cmsreduce.pipeline.store import diagnostic, once
from cmsreduce.pipeline.system import (
    MODEL,
    SystemRoots,
    completeness_note,
    stability_proof,
    without_energy,
)

if TYPE_CHECKING:
    from cmsreduce.pipeline.run.run import Run

__all__ = ["MODEL", "Verification", "Verified"]


@dataclass(frozen=True, eq=False)
class Verified:
    """Findings of the verify stage.

    Parameters
    ----------
    configurations : tuple of ConfigurationResult
        Errors and curves, one for each configuration.
    reference : mapping of body to str
        Representation of each unreduced body.
    full_s, reduced_s : float
        Wall times of the responses of the reference model and of the reduced model over the same grids.
    checks : ReductionChecks
        Checks of the run's own model.
    between : BetweenErrors, optional
        Errors at midpoint configurations; None if the project stage measured them.
    failures : tuple of Failure
        Configurations, comparisons and checks that failed.
    """

    configurations: tuple[ConfigurationResult, ...]
    reference: Mapping[str, str]
    full_s: float
    reduced_s: float
    checks: ReductionChecks = field(default_factory=ReductionChecks)
    between: BetweenErrors | None = None
    failures: tuple[Failure, ...] = ()


class Verification:
    """Measure the reduced system of a run.

    Parameters
    ----------
    run : Run
        Its bodies, its reduced system and the reference model.
    """

    def __init__(self, run: Run) -> None:
        self.run = run

    def measured(self) -> Verified:
        """Measure the errors and checks of the reduced models."""
        if not self.run.has_response:
            return Verified((), {}, 0.0, 0.0, self._checked())
        comparison = self.run.comparison
        # Another point of a sweep may have used the same model.
        comparison.reference_seconds = comparison.reduced_seconds = 0.0
        results = self.run.measured(self.run.models())
        labels = {name: found.label for name, found in self.run.references.items()}
        times = comparison.reference_seconds, comparison.reduced_seconds
        return Verified(results, labels, *times, self._checked(), self._between())

    def notes(self, found: Verified) -> Iterator[str]:
        """Yield what a reader of the findings must know."""
        if (poor := completeness_note(self.completeness)) is not None:
            yield poor
        if not self.run.has_response:
            yield "nothing was verified: the scene names no actuator or no sensor"
            return
        if (keys := self.run.pipeline.verify) is not None and keys.required_checks:
            yield from (f"not checked: {missing}" for missing in found.checks.left_out)
        yield from _between_notes(found.between)
        yield from self._whirl_note(found)
        short = {name: label for name, label in found.reference.items() if label.startswith("modes")}
        sizes = {name: self.run.bodies[name].body.n for name in short}
        together = {} if self.run.all_modes_fit else {n: size for n, size in sizes.items() if size <= ALL_MODES_LIMIT}
        if together:
            yield (
                f"{len(together)} bodies have {sum(together.values())} dofs together, too many for all modes of each; "
                f"the reference model holds {next(iter(short.values()))} and all static shapes of them"
            )
        for name, label in short.items():
            if name not in together:
                dofs = sizes[name]
                yield (
                    f"{name}: {dofs} dofs are too many for all modes or for a solve per frequency; "
                    f"the reference model holds {label} and all static shapes of it"
                )

    def _whirl_note(self, found: Verified) -> Iterator[str]:
        """Largest error of the complex modes where gyroscopic forces make them unlike the modes at rest."""
        worst, hz, where = -1.0, 0.0, ""
        for result in found.configurations:
            errors = next(iter(result.errors.values()), None)
            if errors is None or errors.damped is None or not errors.damped.full.size:
                continue
            if self.run.model.assembled.system(result.configuration).gyroscopic:
                shift = abs(errors.damped.reduced - errors.damped.full) / abs(errors.damped.full)
                if shift.max() > worst:
                    worst, at = float(shift.max()), int(shift.argmax())
                    hz, where = float(errors.damped.full_hz[at]), result.configuration.name
        if worst >= 0:
            yield (
                f"gyroscopic forces: complex modes in the band are those of the reference to {100 * worst:.2g} %, the "
                f"worst at {hz:.4g} Hz in '{where}'; `complex_modes` in summary.json lists both, `frequency_error` is "
                "at rest"
            )

    def _between(self) -> BetweenErrors | None:
        """Errors at midpoint configurations; None without a verify stage, or if the project stage measured them."""
        keys, project = self.run.pipeline.verify, self.run.pipeline.project
        if keys is None or (project is not None and project.between):
            return None
        return self.run.measure.errors_between(self.run.model)

    def _checked(self) -> ReductionChecks:
        run = self.run
        keys = run.measure.keys
        reduced = {name: run.final[name] for name in run.reduced_names}
        configurations = run.scene.configurations
        return run.measure.checks(keys.required_checks, reduced, run.model, configurations, usual=keys.checks is None)

    @property
    @once
    def checks(self) -> ReductionChecks:
        """Checks of the reduction beside its errors: from verify, or made now if the pipeline has no verify."""
        return self.run.verified.checks if self.run.pipeline.verify is not None else self._checked()

    @property
    @once
    def completeness(self) -> tuple[AxisCompleteness, ...]:
        """Share of the inertia at each hinge that the modes hold; empty if hinges move each other, as in a loop."""
        return self.run.measure.completeness(self.run.model, self.run.scene.configurations)

    @property
    @once
    def margins(self) -> tuple[ControllerMargin, ...]:
        """Margins of the scene's controller in every configuration; empty without a controller or without verify."""
        if self.run.controller is None or self.run.pipeline.verify is None:
            return ()
        return self.run.measure.margins(self.run.verified.configurations, lambda: self.roots)

    @property
    @once
    def _without_energy(self) -> str:
        """Reason why energies do not prove the reduced system stable; empty if they do."""
        # A damping matrix of a body that could give energy was refused when the body was read or its modes were made.
        if self.run.controller is not None:
            return "the controller"
        run = self.run
        model = run.model.assembled
        # A damping matrix was proven by a factor without what parameters add to it.
        damped = [name for name, each in run.bodies.items() if all(term.letter != "D" for term in each.body.terms)]
        found = (without_energy(model.at(each).substructures, damped) for each in run.scene.configurations)
        return next((suspect for suspect in found if suspect), "")

    @property
    @once
    def roots(self) -> Mapping[str, SystemRoots | None]:
        """Roots of the reduced system in each configuration, its loop closed; None where they are not known."""
        return self.run.measure.roots(self.run.model, self.run.scene.configurations)

    @property
    @once
    @diagnostic(
        "the stability of the reduced system",
        lambda: Proof("stability", "unproven", remark="the roots of the reduced system could not be found"),
    )
    def stability(self) -> Proof:
        """Proof that no motion of the reduced system grows, in any configuration."""
        suspect = self._without_energy
        return stability_proof(self.roots if suspect else {}, suspect)


def _between_notes(found: BetweenErrors | None) -> Iterator[str]:
    """Midpoint configurations without an error, and the reason."""
    if found is None:
        return
    if found.unmeasured:
        yield (
            f"between the angles sampled, frf_error was measured at {len(found.errors)} of {found.midpoints} midpoint "
            "configurations (verify.between)"
        )
    for reason in found.left_out:
        yield f"between the angles sampled, frf_error was not measured at '{reason}'"
