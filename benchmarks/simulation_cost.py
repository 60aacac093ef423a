"""Seconds for a simulated second in Exudyn and in cmsreduce.simulate: Galileo with all its modes, and reduced.

Run ``python benchmarks/simulation_cost.py [PIPELINE]``. Each body is written in all its modes (at most 600 dofs) and as
the pipeline reduces it; the scene is exported to Exudyn and stepped with generalised alpha. Both take the step of the
pipeline's cost (`verify.cost`), the explicit one for cmsreduce, the band's for Exudyn, and the time of a step is a
median of several runs.
"""

from __future__ import annotations

import importlib.util
import statistics
import sys
import tempfile
import time
from pathlib import Path
from types import ModuleType

import numpy as np

import cmsreduce as cms
from cmsreduce.mechanics import longest_steps
from cmsreduce.pipeline.results import floating_bodies, multibody_scene
from cmsreduce.simulate import measured_speed
from cmsreduce.write import export_scene

ROOT = Path(__file__).parents[1]
# Steps that are timed, and how often; the first run loads the program.
STEPS, TIMES = 20, 4
ACCURACY = 1e-2


def loaded(path: Path) -> ModuleType:
    """The exported script as a module."""
    spec = importlib.util.spec_from_file_location("scene", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["scene"] = module
    spec.loader.exec_module(module)
    return module


def exudyn_seconds(folder: Path, step: float) -> float:
    """Seconds of Exudyn for a simulated second, assembly of the scene left out by the difference of two lengths."""
    module = loaded(folder / "scene.py")
    times = []
    for _ in range(TIMES):
        spent = []
        for steps in (STEPS, 2 * STEPS):
            scene = module.build()
            started = time.perf_counter()
            scene.simulate(steps * step, step)
            spent.append(time.perf_counter() - started)
        times.append((spent[1] - spent[0]) / (STEPS * step))
    return statistics.median(times[1:])


def main(pipeline: Path) -> None:
    """Print a row for the full and for the reduced bodies."""
    whole = {"reduce": None, "balance": None, "project": None, "verify": None, "write": {"formats": ["hdf5"]}}
    print("| bodies | modes | highest, Hz | cmsreduce, s per s | Exudyn, s per s |\n|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as name:
        for label, keys in (("all modes", whole), ("reduced", {"verify": None})):
            folder = Path(name, label.replace(" ", "_"))
            run = cms.run(pipeline, set=keys, out=folder)
            scene = multibody_scene(folder)
            bodies = floating_bodies(scene)
            band = run.work.scene.band[1]
            ours, _ = measured_speed(scene, bodies, band, ACCURACY)
            system = run.work.model.assembled
            highest = float(system.every_mode(run.work.scene.configurations[0])[0].max())
            step = longest_steps("generalised_alpha", highest, band)["1_percent"]
            export_scene(scene, "exudyn", folder / "exudyn")
            theirs = exudyn_seconds(folder / "exudyn", step)
            modes = sum(body.k for body in bodies.values())
            print(f"| {label} | {modes} | {highest / (2 * np.pi):.4g} | {ours:.3g} | {theirs:.3g} |", flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "pipelines" / "galileo.yaml")
