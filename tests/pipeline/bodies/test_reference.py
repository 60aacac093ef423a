"""The representation of an unreduced body that is too large for all its modes, against all its modes."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.assemble import body_points, body_ports, frequency_response, modal_substructure, physical_substructure
from cmsreduce.model import Damping, ParameterTerm, Point, Scene
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.reduce import MacNealRubin
from cmsreduce.verify import channel_scales, frf_error
from tests.assemble.rigs import at, points_of, rigid_modes
from tests.solids import block

# The face of the room has a function of the same name.
references = import_module("cmsreduce.pipeline.bodies.reference")

BAND_HZ, CUTOFF_HZ = 1500.0, 4500.0
SCENE = Scene(
    ("bar",),
    (0.0, BAND_HZ),
    ground=(Point("bar", "root"),),
    actuators=(at("bar.166", "y"),),
    sensors=(at("bar.150", "y"), at("bar.150", "z")),
)


@pytest.fixture(scope="module")
def bar():
    """A bar of 513 dofs, held at four nodes of its root: its damping in the scene is that of many free modes."""
    body = block("bar", [2.7, 0.2, 0.2], [18, 2, 2], {"root": [1, 2, 3, 7]})
    return replace(body, damping=Damping(modal=0.01))


def response(substructure):
    omega = 2 * np.pi * np.geomspace(2.0, BAND_HZ, 6000)
    return omega, frequency_response({"bar": substructure}, SCENE, SCENE.configurations[0], omega)


def test_static_responses_to_the_inertia_of_static_shapes_bring_the_response_nearer_to_that_of_all_modes(
    bar, monkeypatch
):
    ports, rigid = body_ports(bar, SCENE), rigid_modes(bar)

    def assembled(found):
        return modal_substructure(found.modes, body_points(SCENE, bar))

    omega, exact = response(assembled(references.reference(bar, ports, rigid, CUTOFF_HZ)))
    monkeypatch.setattr(references, "ALL_MODES_LIMIT", 0)
    found_modes = references.reference(bar, ports, rigid, CUTOFF_HZ)
    assert found_modes.label == "modes to 2 x cutoff"
    less = orthogonalise(MacNealRubin(2 * CUTOFF_HZ).reduce(bar, ports.interface, ports.static_loads, rigid))
    scales = channel_scales(SCENE.actuators, SCENE.sensors, exact, exact)
    found, plain = (
        frf_error(omega, exact, response(sub)[1], *scales)
        for sub in (assembled(found_modes), modal_substructure(less, points_of(bar, ("150", "166"))))
    )
    assert found < 5e-5
    assert found < plain / 3
    assert assembled(found_modes).m == less.omega.size + 13


@pytest.mark.parametrize(("strength", "by_parameter"), [(3e4, False), (1e7, False), (3e4, True)])
def test_damped_modes_stand_in_for_a_body_with_dampers(bar, monkeypatch, strength: float, by_parameter: bool) -> None:
    """Dampers between points that no load acts on: in normal modes both models lacked the same motions."""
    rows = np.zeros((bar.n, 2))
    for column, nodes in enumerate(((40, 85), (60, 120))):
        ends = bar.dofs.rows(nodes[0], np.arange(1, 4)), bar.dofs.rows(nodes[1], np.arange(1, 4))
        along = np.diff(bar.nodes.xyz[bar.nodes.index(np.array(nodes))], axis=0)[0]
        rows[ends[0], column], rows[ends[1], column] = -along, along
    small, dampers = sp.csc_array(1e-7 * bar.K), sp.csc_array(strength * (rows @ rows.T))
    damped = replace(bar, damping=Damping(), D=sp.csc_array(small + dampers))
    if by_parameter:
        term = ParameterTerm("c", "D", sp.csc_array(0.5 * dampers))
        damped = replace(bar, damping=Damping(), D=small, terms=(term,), corners=({"c": 2.0},))
    ports, rigid, points = body_ports(damped, SCENE), rigid_modes(bar), body_points(SCENE, bar)
    monkeypatch.setattr(references, "SPARSE_LIMIT", 0)
    found = references.reference(damped, ports, rigid, CUTOFF_HZ)
    assert found.label == "modes to 2 x cutoff"
    omega = 2 * np.pi * np.geomspace(20.0, BAND_HZ, 120)
    exact, own = (
        frequency_response({"bar": sub.at({"c": 2.0})}, SCENE, SCENE.configurations[0], omega)
        for sub in (physical_substructure(damped, points, rigid), modal_substructure(found.modes, points))
    )
    error = frf_error(omega, exact, own, *channel_scales(SCENE.actuators, SCENE.sensors, exact, exact))
    assert error < 1e-7


def test_bodies_that_are_too_many_together_have_no_modes_to_spare(bar) -> None:
    some, rigid = references.SYSTEM_LIMIT // bar.n, np.zeros((bar.n, 0))
    assert references.all_modes_fit([(bar, rigid)] * some)
    assert not references.all_modes_fit([(bar, rigid)] * (some + 1))
    # Damping that has a sparse matrix asks for no modes.
    structural = replace(bar, damping=Damping(structural=0.01))
    assert references.all_modes_fit([(structural, rigid)] * (2 * some))
    assert references.in_free_modes(bar, rigid, fits=False) and not references.in_free_modes(bar, rigid)
    assert not references.in_free_modes(structural, rigid, fits=False)


def test_wide_interfaces_take_all_modes_where_damping_is_diagonal_in_them() -> None:
    """A bar in its dofs and in its modes has one response: 45 of its 216 dofs are at interfaces."""
    narrow = replace(block("bar", [0.8, 0.2, 0.2], [14, 2, 2]), damping=Damping(structural=0.02))
    face = [*range(1, 10), *range(37, 43)]
    wide = replace(block("bar", [0.8, 0.2, 0.2], [7, 2, 2], {"face": face}), damping=Damping(structural=0.02))
    dashpots = replace(wide, D=wide.K * 1e-6, damping=Damping())
    scene = replace(
        SCENE,
        ground=(Point("bar", "face"),),
        actuators=(at("bar.20", "y"),),
        sensors=(at("bar.25", "y"), at("bar.22", "z")),
    )
    ports, rigid = body_ports(wide, scene), rigid_modes(wide)
    few = body_ports(narrow, replace(scene, ground=()))
    asked = {"wide": (wide, ports, rigid), "narrow": (narrow, few, rigid), "dashpots": (dashpots, ports, rigid)}
    assert references.wide_in_modes(asked) == {"wide"}
    too_many = {str(k): (wide, ports, rigid) for k in range(1 + references.SYSTEM_LIMIT // wide.n)}
    assert not references.wide_in_modes(too_many)
    found = references.reference(wide, ports, rigid, CUTOFF_HZ, wide=True)
    assert found.label == "all modes"
    omega = 2 * np.pi * np.linspace(50, BAND_HZ, 200)
    points = body_points(scene, wide)
    in_modes, in_dofs = (
        frequency_response({"bar": sub}, scene, scene.configurations[0], omega)
        for sub in (modal_substructure(found.modes, points), physical_substructure(wide, points, rigid))
    )
    np.testing.assert_allclose(in_modes, in_dofs, rtol=1e-7, atol=1e-9 * abs(in_dofs).max())
