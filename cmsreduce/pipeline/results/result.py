"""The result of a run: everything that the summary, the report and the terminal show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cmsreduce import __version__
from cmsreduce.model import (
    ComponentResult,
    Configuration,
    Finding,
    ModalComponent,
    RunResult,
    Speed,
    SystemModes,
)
from cmsreduce.orthogonalise import ORTHOGONAL, orthogonality_errors
from cmsreduce.pipeline.results.health import health_table
from cmsreduce.pipeline.results.mass_and_frame import frame_checks, frame_of
from cmsreduce.pipeline.results.step_advice import (
    advice_notes,
    body_costly_modes,
    body_rounding,
    highest_frequency,
    treated_model,
)
from cmsreduce.pipeline.results.views import effective_mass_curves, gain_curves, scene_drawing
from cmsreduce.pipeline.run import MODEL, Run
from cmsreduce.pipeline.system import AssembledModel

__all__ = ["component_checks", "run_result"]

# Mass of a massless shape, in roundings of the file.
_MASSLESS = 10.0
_LEFT_OUT = "left out"
# The stage that represents the unreduced body; its work is no part of the reduction.
_REFERENCE = "reference"


def component_checks(run: Run, name: str) -> tuple[Finding, ...]:
    """Checks of one body: of its matrices as read, of its modes, and of its frame."""
    mass, stiffness = orthogonality_errors(run.written(name))
    # The mass of a static mode is rounding of the file.
    rounding = _MASSLESS * run.bodies[name].body.rounding if run.written(name).static_count else 0.0
    return (
        *run.bodies[name].checks,
        *run.bodies[name].health.checks,
        Finding("orthogonality in M", mass, max(ORTHOGONAL, rounding)),
        Finding("orthogonality in K", stiffness, ORTHOGONAL),
        *frame_checks(frame_of(run, name)),
    )


def run_result(run: Run, *, views: bool = False) -> RunResult:
    """Collect the result of a run.

    Parameters
    ----------
    run : Run
        Stages of the pipeline that are not finished are run.
    views : bool
        Add the drawing, the effective masses and the gains, which only pictures and the page show.
    """
    verified = run.verified if run.pipeline.verify is not None else None
    seconds = run.stages.seconds
    cutoffs = run.cutoffs
    components = {}
    for name in run.reduced_names:
        flexible = run.bodies[name]
        modes, kept = _modes_shown(run, name)
        factorised = run.stages.factorised.get(name, {})
        components[name] = ComponentResult(
            name=name,
            full_dofs=flexible.body.n,
            modes=modes,
            kept=kept,
            seconds={stage: s for stage, s in seconds.get(name, {}).items() if stage != _REFERENCE},
            peak_mib=run.stages.peak_mib.get(name, 0.0),
            checks=component_checks(run, name),
            sources=flexible.body.sources,
            bound=run.choice.bounds.get(name),
            scaling=run.balancing.scaling(name),
            cutoff=cutoffs.get(name),
            factorised=tuple(each for stage, done in factorised.items() if stage != _REFERENCE for each in done),
            costly=body_costly_modes(run, name),
            rounding=body_rounding(run.final[name]),
            health=health_table(flexible.body, flexible.health),
            proofs=flexible.proofs,
        )
    treated = treated_model(run, {name: part.costly for name, part in components.items() if part.costly is not None})
    systems = tuple(_system_modes(run, configuration, treated) for configuration in run.scene.configurations)
    limits = run.pipeline.verify.limits.model_dump(exclude_none=True) if run.pipeline.verify else {}
    configurations = verified.configurations if verified else ()
    stages = ("reduce", "orthogonalise")
    reduce_s = sum(seconds.get(name, {}).get(stage, 0.0) for name in run.bodies for stage in stages)
    return RunResult(
        name=run.pipeline.name,
        version=__version__,
        components=components,
        configurations=configurations,
        limits=limits if configurations else {key: limits[key] for key in limits if key == "static_lack"},
        model=MODEL,
        inputs=tuple(channel.name for channel in run.scene.actuators),
        outputs=tuple(channel.name for channel in run.scene.sensors),
        band=run.scene.band,
        speed=Speed(reduce_s, verified.full_s, verified.reduced_s) if verified and configurations else None,
        reference=verified.reference if verified else {},
        settings=run.pipeline.model_dump(mode="json", exclude_none=True),
        systems=systems,
        notes=(*run.stages.notes, *advice_notes(components, systems, run.scene.band[1])),
        projection=None if run.projected is None else run.projected.record,
        search=run.choice.search,
        sensitivity=run.sensitivity,
        completeness=run.completeness if verified is not None else (),
        drawing=scene_drawing(run) if views else None,
        effective_mass=effective_mass_curves(run) if views else {},
        gains=gain_curves(run) if views else {},
        checks=verified.checks if verified is not None else None,
        margins=run.margins if verified is not None else (),
    )


def _modes_shown(run: Run, name: str) -> tuple[ModalComponent, NDArray[np.int64]]:
    """The modes of a body with the reason of each, and the columns kept; after projection all are kept."""
    if run.projected is not None:
        return run.final[name], np.arange(run.final[name].omega.size)
    ranked = run.ranked[name]
    e = ranked.elastic
    kept = np.r_[: e.start, run.selection[name], e.stop : ranked.omega.size]
    why = [_LEFT_OUT] * ranked.omega.size
    for column, reason in zip(kept, run.kept[name].why, strict=True):
        why[column] = reason
    if (sensitivity := run.sensitivity) is not None:
        for number, cases in sensitivity.edge(name).items():
            turned = "kept" if why[number - 1] == _LEFT_OUT else "left out"
            named = ", ".join(case if case.startswith("without") else f"with {case}" for case in cases)
            why[number - 1] += f"; on the edge: {turned} {named}"
    return replace(ranked, why=tuple(why)), np.asarray(kept, dtype=np.int64)


def _system_modes(run: Run, configuration: Configuration, treated: AssembledModel | None) -> SystemModes:
    model = run.model.assembled
    hertz = model.resonances(configuration).omega / (2 * np.pi)
    system = model.system(configuration)
    static = None if treated is None else highest_frequency(treated.system(configuration))
    return SystemModes(configuration, system.rigid.shape[1], hertz, highest_frequency(system), static)
