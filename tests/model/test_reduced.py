"""Frequencies in Hz, and one-line descriptions of bodies, scenes and systems."""

import numpy as np
import pytest

from cmsreduce.assemble import assemble, modal_substructure
from cmsreduce.model import Channel, Point, PointTerm, RigidBody, Scene
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.reduce import CraigBampton
from tests.frames import BAR, line

LENGTH = 1.5


@pytest.fixture(scope="module")
def reduced():
    body = line("bar", [0, 0, 0], [LENGTH, 0, 0], 12)
    rows = np.concatenate([body.interface_rows(face) for face in "ab"])
    return CraigBampton(1500.0).reduce(body, rows)


@pytest.fixture(scope="module")
def modal(reduced):
    return orthogonalise(reduced)


def test_frequencies_in_hz_of_a_free_beam(modal):
    """The first root of cos(x) cosh(x) = 1, in both planes; rigid modes have exactly zero."""
    exact = (4.730040744862704 / LENGTH) ** 2 * np.sqrt(BAR.E * np.array([BAR.Iy, BAR.Iz]) / (BAR.rho * BAR.A))
    assert (modal.frequencies_hz[:6] == 0).all()
    np.testing.assert_allclose(modal.frequencies_hz[6:8], exact / (2 * np.pi), rtol=1e-3)


def test_static_modes_have_no_finite_frequency(modal):
    treated = modal.static_above(2 * np.pi * 100.0)
    assert (treated.frequencies_hz[treated.elastic] < 100.0).all()
    assert np.isinf(treated.frequencies_hz[treated.elastic.stop :]).all() and treated.static_count > 0


def test_descriptions_are_one_line_without_arrays(reduced, modal):
    push = Channel("push", (PointTerm(Point("bar", "b"), np.eye(6)[2]),), "translation")
    scene = Scene(("bar",), (0.0, 50.0), actuators=(push,), sensors=(push,), base="bar")
    system = assemble({"bar": modal_substructure(modal, ["b"])}, scene, scene.configurations[0])
    first = f"{modal.frequencies_hz[6]:.6g} Hz"
    for described, parts in (
        (reduced.body, ("FEModel bar", "78 dofs")),
        (reduced, ("ReducedComponent bar", "78 dofs", "craig-bampton")),
        (modal, ("ModalComponent bar", "6 rigid", first)),
        (RigidBody("hub", 3.0, np.zeros(3), np.eye(3)), ("RigidBody hub", "mass 3")),
        (scene, ("Scene bar", "1 actuators", "band to 50 Hz")),
        (system, ("System", "bar", "1 inputs", f"{system.N} dofs", "6 rigid")),
    ):
        text = repr(described)
        assert all(part in text for part in parts), text
        assert "\n" not in text and "array" not in text and len(text) < 160
