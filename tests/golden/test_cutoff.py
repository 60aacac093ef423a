"""What the modes above the cutoff cost on Galileo: estimated from the reduced model, and measured on the full one."""

from __future__ import annotations

from pathlib import Path

import pytest

from cmsreduce.assemble import rigid_substructure
from cmsreduce.config import load_pipeline
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.pipeline import Run, Silent
from cmsreduce.pipeline.bodies.interface_loading import loading_by_neighbours
from cmsreduce.pipeline.choose.cutoff import neglected_errors
from cmsreduce.pipeline.system import AssembledModel, ReducedModel
from cmsreduce.reduce import reduction

GALILEO = Path(__file__).parents[2] / "pipelines" / "galileo.yaml"
# Stated in docs/theory.md.
FACTOR = 1.25
# Responses are known to this: forces in the joints are those of flexibilities with condition numbers of 1e6 and more.
ROUNDING = 1e-8


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    settings = ["scene.articulation={spin: [45 deg], cone: [30 deg]}"]
    return Run(load_pipeline(GALILEO, settings), tmp_path_factory.mktemp("galileo"), Silent())


@pytest.mark.parametrize("method", ["craig-bampton", "macneal-rubin", "benfield-hruda"])
@pytest.mark.parametrize("name", ["rotor", "stator"])
def test_the_estimate_predicts_the_error_of_either_body(run: Run, name: str, method: str) -> None:
    flexible = run.bodies[name]
    fixed = {other: rigid_substructure(body) for other, body in run.rigid_bodies.items()}
    loading = loading_by_neighbours(name, run.bodies, fixed, run.scene) if method == "benfield-hruda" else None
    # The other body as it is: the error is that of this one alone.
    fixed |= {
        other: run.bodies[other].substructure(run.scene, found.modes)
        for other, found in run.references.items()
        if other != name
    }
    for cutoff in (1.0, 2.0, 4.0):
        found = reduction(method, cutoff * run.scene.band[1], None, loading).examine(
            flexible.body, flexible.ports.interface, flexible.ports.static_loads, flexible.rigid, enrich=True
        )
        assert found.enriched is not None
        reduced, richer = orthogonalise(found.component), orthogonalise(found.enriched)
        estimate = neglected_errors({name: reduced}, {name: richer}, run.bodies, fixed, run.scene)[name]
        subs = {**fixed, name: flexible.substructure(run.scene, reduced)}
        model = AssembledModel({body: subs[body] for body in run.scene.bodies}, run.scene)
        true = run.comparison.candidate_error(ReducedModel(model, {name: reduced}))
        assert max(true, ROUNDING) / FACTOR <= max(estimate, ROUNDING) <= max(true, ROUNDING) * FACTOR, (cutoff, true)
