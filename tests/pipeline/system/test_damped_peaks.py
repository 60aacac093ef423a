"""Response errors where damping makes peaks far from the modes without damping: integrals against ten times the points.

Two bars with a hinge that a dashpot all but locks bend as one bar. Without damping they have no such mode in the band,
and the mode of the hinge there takes all of the dashpot: to its damping ratio of 300, the response would be flat.
"""

from __future__ import annotations

import numpy as np
import pytest

from cmsreduce.assemble import modal_substructure
from cmsreduce.model import Channel, Configuration, Damping, FEModel, JointElement, ModalComponent, Scene
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.pipeline.choose import system_ranking
from cmsreduce.pipeline.project.response_samples import SampledScene
from cmsreduce.pipeline.system.assembled import AssembledModel
from cmsreduce.pipeline.system.comparison import Comparison
from cmsreduce.pipeline.system.peaks import peak_damping
from cmsreduce.pipeline.system.reduced_model import ReducedModel
from cmsreduce.pipeline.system.reduction_health import all_modes, zeros_apart
from cmsreduce.pipeline.system.reference_model import ReferenceModel
from cmsreduce.reduce import CraigBampton
from cmsreduce.verify import channel_scales, frf_error
from tests.assemble.rigs import ALL, at, joint, points_of
from tests.frames import Section, line

BAND = (0.0, 60.0)
HERE = Configuration("as built")
# Bending out of the plane is far above the band.
FLAT = Section(Iy=1e-6)


def hinged(drag: float, *sensors: Channel) -> tuple[Comparison, ReducedModel]:
    law = Damping(modal=0.003)
    bodies = {
        body.name: body
        for body in (
            line("near", [0, 0, 0], [0.9, 0, 0], 6, damping=law, section=FLAT),
            line("far", [0.9, 0, 0], [2.2, 0, 0], 6, damping=law, section=FLAT),
        )
    }
    hinge = joint("hinge", "near.b", "far.a", "rz", elements=(JointElement(5, 0.0, drag),))
    push, sensors = at("near.a", [1, 1, 0, 0, 0, 0]), sensors or (at("far.b", "y"),)
    scene = Scene(tuple(bodies), BAND, (hinge,), actuators=(push,), sensors=sensors)

    def reduced(cutoff_hz: float) -> tuple[AssembledModel, dict[str, ModalComponent]]:
        parts = {name: orthogonalise(CraigBampton(cutoff_hz).reduce(body, ends(body))) for name, body in bodies.items()}
        subs = {name: modal_substructure(part, points_of(bodies[name])) for name, part in parts.items()}
        return AssembledModel(subs, scene), parts

    def ends(body: FEModel) -> np.ndarray:
        return np.concatenate([body.interface_rows(name) for name in body.interfaces])

    return Comparison(ReferenceModel(*reduced(ALL), bodies), 400), ReducedModel(*reduced(150.0))


@pytest.mark.parametrize("drag", [1.0, 100.0, 1e4])
def test_the_error_at_the_modes_that_a_dashpot_makes(drag: float) -> None:
    comparison, model = hinged(drag)
    w = np.geomspace(2 * np.pi * BAND[1] / 1e3, 2 * np.pi * BAND[1], 40_000)
    target = comparison.reference.target(HERE, w)
    H_r = model.assembled.response(HERE, w) - target.rigid
    expected = frf_error(w, target.elastic, H_r, target.row, target.column)
    assert comparison.error_at(HERE, model) == pytest.approx(expected, rel=0.03)
    assert comparison.quick_errors([HERE], model) == pytest.approx([expected], rel=0.1)
    assert comparison.screened([HERE], model)[0, 0] == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize("drag", [30.0, 100.0, 1e4])
def test_shapes_are_fitted_to_the_peaks_that_a_dashpot_makes(drag: float) -> None:
    comparison, model = hinged(drag)
    parts = {name: part for name, part in model.shapes.items() if part is not None}
    (sample,) = SampledScene(model, parts, comparison.reference).responses([HERE]).samples
    w = np.geomspace(2 * np.pi * BAND[1] / 1e3, 2 * np.pi * BAND[1], 40_000)
    highest = [abs(elastic).max() for elastic in (sample.elastic, comparison.reference.target(HERE, w).elastic)]
    assert highest[0] == pytest.approx(highest[1], rel=0.01)
    # Peaks wider than the band take no points away.
    assert sample.omega.size >= 50


def test_channels_are_scaled_by_the_peaks_that_a_dashpot_makes() -> None:
    _, model = hinged(1e4, at("far.b", "y"), at("near.a", "rz"))
    w = np.geomspace(2 * np.pi * BAND[1] / 1e3, 2 * np.pi * BAND[1], 40_000)
    assembled = model.assembled
    H = assembled.response(HERE, w)
    elastic = H - assembled.rigid_response(HERE, w)
    expected, _ = channel_scales(assembled.scene.actuators, assembled.scene.sensors, elastic, H, w)
    ((found, _),) = system_ranking._scales(assembled)
    assert found[1] / found[0] == pytest.approx(expected[1] / expected[0], rel=1e-3)


def test_zeros_are_hidden_by_the_damping_of_the_peaks() -> None:
    """The mode that the dashpot damps to a ratio of 300 hid every zero of the band, also those that a model lacks."""
    comparison, model = hinged(1e4, at("near.a", "y"))
    both = [all_modes(each, HERE) for each in (comparison.reference.assembled, model.assembled)]
    (pair,) = zeros_apart(*both, model.assembled, HERE)
    assert abs(pair.full.imag).min() < 2 * np.pi * BAND[1]
    assert pair.shift.size == 1 and pair.worst > 0.01


def test_a_mode_that_is_lost_is_seen_as_high_as_its_peak() -> None:
    """The visibility of modes without a partner decides whether errors of the others are a measure."""
    _, model = hinged(1e4)
    assembled = model.assembled
    (s,) = assembled.damped_modes(HERE).s
    assert assembled.resonances(HERE).zeta > 300
    zeta = peak_damping(assembled, HERE)
    assert zeta == pytest.approx([-s.real / abs(s)])
