"""Stages of a run that verify its reduced system: errors, checks, margins and proofs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

from cmsreduce.config import LimitKeys
from cmsreduce.errors import StageError
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
from cmsreduce.pipeline.run.system import SystemStages
from cmsreduce.pipeline.store import Failures, collecting, diagnostic, once, report_failures, stage
from cmsreduce.pipeline.system import SystemRoots, completeness_note, stability_proof, without_energy

__all__ = ["Verified", "VerifyStages"]


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


class VerifyStages(SystemStages):
    """The stages of a run that measure its reduced system.

    Takes what :class:`BodyStages` takes.
    """

    @property
    @stage(
        "verify",
        key=lambda run: run._system_key("verify") if run.has_response else None,
        needs=["model", "comparison"],
        notes=lambda run, found: run.verification_notes(found),
        again=lambda run, found: bool(found.failures),
    )
    def _verified(self) -> Verified:
        with collecting(Failures(log=self.stages.failures.log)) as failed:
            found = self._findings()
        return replace(found, failures=tuple(failed))

    @property
    @once
    @diagnostic(
        "the verification",
        lambda: Verified((), {}, 0.0, 0.0),
        limits=tuple(LimitKeys.model_fields),
        passes=(StageError,),
    )
    def verified(self) -> Verified:
        """Errors and curves of the reduced models in every configuration; a configuration that failed is missing."""
        found = self._verified
        report_failures(found.failures)
        return found

    def _findings(self) -> Verified:
        if not self.has_response:
            return Verified((), {}, 0.0, 0.0, self._checked())
        comparison = self.comparison
        # Another point of a sweep may have used the same model.
        comparison.reference_seconds = comparison.reduced_seconds = 0.0
        results = self.measured(self.models())
        labels = {name: found.label for name, found in self.references.items()}
        times = comparison.reference_seconds, comparison.reduced_seconds
        return Verified(results, labels, *times, self._checked(), self._between())

    def verification_notes(self, found: Verified) -> Iterator[str]:
        """Notes for a reader of the findings."""
        if (poor := completeness_note(self.completeness)) is not None:
            yield poor
        if not self.has_response:
            yield "nothing was verified: the scene names no actuator or no sensor"
            return
        if (keys := self.pipeline.verify) is not None and keys.required_checks:
            yield from (f"not checked: {missing}" for missing in found.checks.left_out)
        yield from _between_notes(found.between)
        yield from self._whirl_note(found)
        short = {name: label for name, label in found.reference.items() if label.startswith("modes")}
        sizes = {name: self.bodies[name].body.n for name in short}
        together = {} if self.all_modes_fit else {n: size for n, size in sizes.items() if size <= ALL_MODES_LIMIT}
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
            if self.model.assembled.system(result.configuration).gyroscopic:
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
        keys, project = self.pipeline.verify, self.pipeline.project
        if keys is None or (project is not None and project.between):
            return None
        return self.measure.errors_between(self.model)

    def _checked(self) -> ReductionChecks:
        keys = self.measure.keys
        reduced = {name: self.final[name] for name in self.reduced_names}
        configurations = self.scene.configurations
        return self.measure.checks(keys.required_checks, reduced, self.model, configurations, usual=keys.checks is None)

    @property
    @once
    def checks(self) -> ReductionChecks:
        """Checks of the reduction beside its errors: from verify, or made now if the pipeline has no verify."""
        return self.verified.checks if self.pipeline.verify is not None else self._checked()

    @property
    @once
    def completeness(self) -> tuple[AxisCompleteness, ...]:
        """Share of the inertia at each hinge that the modes hold; empty if hinges move each other, as in a loop."""
        return self.measure.completeness(self.model, self.scene.configurations)

    @property
    @once
    def margins(self) -> tuple[ControllerMargin, ...]:
        """Margins of the scene's controller in every configuration; empty without a controller or without verify."""
        if self.controller is None or self.pipeline.verify is None:
            return ()
        return self.measure.margins(self.verified.configurations, lambda: self.roots)

    @property
    @once
    def _without_energy(self) -> str:
        """Reason why energies do not prove the reduced system stable; empty if they do."""
        # A damping matrix of a body that could give energy was refused when the body was read or its modes were made.
        if self.controller is not None:
            return "the controller"
        model = self.model.assembled
        # A damping matrix was proven by a factor without what parameters add to it.
        damped = [name for name, each in self.bodies.items() if all(term.letter != "D" for term in each.body.terms)]
        found = (without_energy(model.at(each).substructures, damped) for each in self.scene.configurations)
        return next((suspect for suspect in found if suspect), "")

    @property
    @once
    def roots(self) -> Mapping[str, SystemRoots | None]:
        """Roots of the reduced system in each configuration, its loop closed; None where they are not known."""
        return self.measure.roots(self.model, self.scene.configurations)

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
