"""Seconds of computing for a simulated second, measured with the reduced and with the full bodies of a run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from cmsreduce.config import Pipeline, WriteKeys
from cmsreduce.model import SimulationCost, Speed
from cmsreduce.pipeline.results.component_files import write_body, write_system_file
from cmsreduce.pipeline.results.floating_bodies import floating_bodies
from cmsreduce.pipeline.results.multibody_scene import multibody_scene
from cmsreduce.pipeline.run import Run
from cmsreduce.pipeline.store import Silent, diagnostic
from cmsreduce.simulate import measured_speed

__all__ = ["measured_costs"]


def measured_costs(run: Run, speed: Speed | None) -> Speed | None:
    """The speed with measured seconds for a simulated second, of the reduced and of the full system."""
    if speed is None or speed.simulation is None:
        return speed
    run.stages.progress.stage("verify", "seconds of a simulation")
    found = speed.simulation
    reduced, full = _timed("reduced", run, found.reduced), found.full
    return replace(
        speed,
        simulation=replace(
            found,
            reduced=reduced,
            full=None if full is None else _timed("full", run, full),
        ),
    )


def _timed(which: str, run: Run, cost: SimulationCost) -> SimulationCost:
    found = _seconds(which, run, cost)
    return cost if found is None else replace(cost, seconds=found[0], noise=found[1])


@diagnostic("the time of a simulation with the {} system", about=lambda which, *_: which, whole=True)
def _seconds(which: str, run: Run, cost: SimulationCost) -> tuple[float, float] | None:
    """Seconds of computing for a simulated second, and their noise, by files in a folder that is removed."""
    keys = run.pipeline.verify
    assert keys is not None
    with TemporaryDirectory(prefix="cmsreduce-") as name:
        folder = Path(name)
        source = run if which == "reduced" else Run(_unreduced(run.pipeline), folder, Silent())
        for body in source.flexible_names:
            write_body(source, body, folder / f"{body}.h5")
        write_system_file(source, folder / "system.h5")
        scene = multibody_scene(folder, cost.configuration)
        return measured_speed(scene, floating_bodies(scene), run.scene.band[1], keys.cost.accuracy)


def _unreduced(pipeline: Pipeline) -> Pipeline:
    """The pipeline without its stages from reduce to verify."""
    parts = {
        name: part.model_copy(update={"reduce": None, "balance": None}) for name, part in pipeline.components.items()
    }
    none = dict.fromkeys(("reduce", "balance", "project", "verify"))
    return pipeline.model_copy(update={**none, "components": parts, "write": pipeline.write or WriteKeys()})
