"""The result of a run: everything that the summary, the report and the terminal show."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cmsreduce import __version__
from cmsreduce.model import (
    ComponentResult,
    Configuration,
    Finding,
    HealthFinding,
    ModalComponent,
    ModeCertificate,
    Proof,
    RunResult,
    Speed,
    SystemModes,
)
from cmsreduce.orthogonalise import ORTHOGONAL, orthogonality_errors
from cmsreduce.pipeline.bodies import damping_proof
from cmsreduce.pipeline.results.health import UNBOUNDED, error_bar, health_table
from cmsreduce.pipeline.results.mass_and_frame import frame_checks, frame_of
from cmsreduce.pipeline.results.proportions import largest_extent, proportion_notes
from cmsreduce.pipeline.results.simulation_cost import simulation_costs
from cmsreduce.pipeline.results.step_advice import (
    advice_notes,
    body_costly_modes,
    body_rounding,
    treated_model,
)
from cmsreduce.pipeline.results.views import (
    body_drawing,
    body_effective_mass,
    effective_mass_curves,
    gain_curves,
    scene_drawing,
)
from cmsreduce.pipeline.run import MODEL, Run
from cmsreduce.pipeline.store import at_once, collecting, diagnostic, once
from cmsreduce.pipeline.system import AssembledModel, highest_frequency, static_highest_frequency
from cmsreduce.verify import frequency_error_bars, rigid_shapes

__all__ = ["component_checks", "mode_count", "run_result", "with_failures"]

# Error bar of a frequency, relative, above which a run without a limit on frequencies says so.
_KNOWN = 1e-3
# Mass of a massless shape, in roundings of the file.
_MASSLESS = 10.0
_LEFT_OUT = "left out"
# The stage that represents the unreduced body; its work is no part of the reduction.
_REFERENCE = "reference"


@once
@diagnostic("the checks of '{}'", tuple, about=lambda run, name: name, required=True)
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
        *rigid_shapes(run.written(name)),
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
    with collecting(run.stages.failures):
        _find_at_once(run, views)
        found = _result(run)
        if views:
            found = replace(
                found,
                drawing=scene_drawing(run),
                effective_mass=effective_mass_curves(run),
                gains=gain_curves(run),
            )
        return with_failures(run, found)


def _find_at_once(run: Run, views: bool) -> None:
    """Find what takes long for each body, several bodies at a time; the run holds the results."""
    # All bodies need these.
    _ = run.final, run.selection

    def find(name: str) -> None:
        _error_bars_hz(run, name)
        component_checks(run, name)
        if views:
            body_drawing(run, name)
            body_effective_mass(run, name)

    at_once(run.stages, find, run.reduced_names, run.stages.solver.thread_count)


def with_failures(run: Run, result: RunResult) -> RunResult:
    """The result with all notes and failures of a run up to now."""
    failures = tuple(run.stages.failures)
    advice = [note for note in result.notes if note not in run.stages.notes]
    lines = [failure.line for failure in failures if failure.line not in advice]
    return replace(result, notes=(*run.stages.notes, *advice, *lines), failures=failures)


def _result(run: Run) -> RunResult:
    verified = run.verified if run.pipeline.verify is not None else None
    seconds = run.stages.seconds
    cutoffs = run.cutoffs
    limits = run.pipeline.verify.limits.model_dump(exclude_none=True) if run.pipeline.verify else {}
    components, known = {}, {}
    for name in run.reduced_names:
        flexible = run.bodies[name]
        modes, kept = _modes_shown(run, name)
        factorised = run.stages.factorised.get(name, {})
        bars, hz = _error_bars_hz(run, name), run.final[name].frequencies_hz[run.final[name].elastic]
        known[name] = tuple(error_bar(hz, bars, limits.get("frequency_error", _KNOWN)))
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
            scaling=_scaling(run, name),
            cutoff=cutoffs.get(name),
            factorised=tuple(each for stage, done in factorised.items() if stage != _REFERENCE for each in done),
            costly=body_costly_modes(run, name),
            rounding=body_rounding(run.final[name]),
            health=(*health_table(flexible.body, flexible.health), *known[name]),
            proofs=(
                *(_to_the_digits(replace(each, subject=each.subject or name), known[name]) for each in flexible.proofs),
                damping_proof(flexible.body, flexible.damping, run.modal(name)),
                mode_count(name, run.modal(name).certificate),
            ),
            frequency_error_bars_hz=bars,
        )
    coarse = [
        f"{name}: {each.words}; {each.advice}" for name, found in known.items() for each in found if not each.passed
    ]
    treated = treated_model(run, {name: part.costly for name, part in components.items() if part.costly is not None})
    systems = tuple(_system_modes(run, configuration, treated) for configuration in run.scene.configurations)
    configurations = verified.configurations if verified else ()
    stages = ("reduce", "orthogonalise")
    reduce_s = sum(seconds.get(name, {}).get(stage, 0.0) for name in run.bodies for stage in stages)
    keep = run.pipeline.balance and run.pipeline.balance.keep
    searched = keep.minimise if keep and keep.limits else None
    return RunResult(
        name=run.pipeline.name,
        version=__version__,
        components=components,
        configurations=configurations,
        limits=limits,
        model=MODEL,
        inputs=tuple(channel.name for channel in run.scene.actuators),
        outputs=tuple(channel.name for channel in run.scene.sensors),
        input_units=tuple(channel.effort_unit(run.scene.units) for channel in run.scene.actuators),
        output_units=tuple(channel.motion_unit(run.scene.units) for channel in run.scene.sensors),
        band=run.scene.band,
        speed=None
        if not (verified and configurations)
        else Speed(reduce_s, verified.full_s, verified.reduced_s, simulation_costs(run)),
        reference=verified.reference if verified else {},
        settings=run.pipeline.record(exclude_none=True),
        systems=systems,
        notes=(
            *run.stages.notes,
            *coarse,
            *_out_of_proportion(run),
            *advice_notes(components, systems, run.scene.band[1], searched),
        ),
        projection=None if run.projected is None else run.projected.record,
        search=run.choice.search,
        sensitivity=run.sensitivity,
        completeness=run.completeness if verified is not None else (),
        checks=verified.checks if verified is not None else None,
        margins=run.margins if verified is not None else (),
        between=verified.between if verified is not None else None,
        proofs=(run.stability,),
        rigid_bodies=tuple(run.rigid_bodies.values()),
    )


@diagnostic("the comparison of lengths", tuple)
def _out_of_proportion(run: Run) -> tuple[str, ...]:
    """Notes on lengths of rigid bodies and slides that no body of this size has."""
    rigid = tuple(run.rigid_bodies.values())
    known = [each.body.nodes for each in run.bodies.values() if each.body.nodes is not None]
    meshes = [nodes.xyz for nodes in known if len(nodes) > 1]
    if len(meshes) < len(run.bodies):
        # The largest body may be one without coordinates, or of one node and modes.
        return ()
    held = [np.vstack([face.position for face in body.interfaces.values()]) for body in rigid if body.interfaces]
    return tuple(proportion_notes(run.scene, largest_extent([*meshes, *held]), rigid))


def _to_the_digits(proof: Proof, bars: Iterable[HealthFinding]) -> Proof:
    """The proof; that of the rigid motions fails where the digits of the files do not bound an elastic frequency."""
    lost = [bar.words for bar in bars if bar.judged > UNBOUNDED]
    if proof.what != "rigid motions" or proof.state != "proven" or not lost:
        return proof
    return replace(proof, state="unproven", remark=f"{proof.remark}, but {lost[0]}")


def mode_count(name: str, certificate: ModeCertificate | None) -> Proof:
    """Proof that the mode set of a body misses no normal mode below its cutoff.

    Examples
    --------
    >>> found = mode_count("rotor", ModeCertificate(20.0, 2, np.array([5.0, 12.0]), np.array([1e-9, 1e-8])))
    >>> found.state, found.digits, found.remark
    ('proven', 8.0, '2 modes up to 20 Hz, counted by Sturm')
    """
    if certificate is None:
        return Proof("mode count", "unproven", remark="its mode set computes no normal modes", subject=name)
    found, upto = certificate.frequency_hz.size, f"up to {certificate.cutoff_hz:.6g} Hz"
    if certificate.counted is not None and certificate.counted != found:
        remark = f"{found} modes found {upto}, {certificate.counted} counted by Sturm"
        return Proof("mode count", "refuted", remark=remark, subject=name)
    how = "of all modes of the body" if certificate.counted is None else "counted by Sturm"
    bound = certificate.worst_bound
    digits = None if np.isnan(bound) else float(-np.log10(np.clip(bound, np.finfo(float).eps, 1.0)))
    return Proof("mode count", "proven", digits, f"{found} modes {upto}, {how}", name)


@once
def _error_bars_hz(run: Run, name: str) -> NDArray[np.float64]:
    """Error bars of the elastic modes of a body."""
    modes = run.final[name]
    return frequency_error_bars(modes, modes.elastic)


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


@diagnostic("the scaling of the channels of '{}'", str, about=lambda run, name: name)
def _scaling(run: Run, name: str) -> str:
    return run.balancing.scaling(name)


def _system_modes(run: Run, configuration: Configuration, treated: AssembledModel | None) -> SystemModes:
    found = _frequencies(run, configuration, treated)
    return SystemModes(configuration, 0, np.empty(0)) if found is None else found


@diagnostic("the table of frequencies in '{}'", about=lambda run, configuration, treated: configuration.name)
def _frequencies(run: Run, configuration: Configuration, treated: AssembledModel | None) -> SystemModes | None:
    model = run.model.assembled
    resonances = model.resonances(configuration)
    system = model.system(configuration)
    static = None if treated is None else static_highest_frequency(treated, configuration)
    hertz, highest = resonances.omega / (2 * np.pi), highest_frequency(model, configuration)
    return SystemModes(configuration, system.rigid.shape[1], hertz, highest, static, resonances.zeta)
