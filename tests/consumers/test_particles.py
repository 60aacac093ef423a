"""Equations of motion of Galileo's bodies by integrals over shapes, against d'Alembert's principle over particles."""

from __future__ import annotations

import importlib
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cmsreduce.mechanics import floating_frame
from cmsreduce.model import FrameCondition, IntegralFrame
from cmsreduce.pipeline.results.floating_bodies import floating_body
from cmsreduce.write import write_component
from tests.consumers.bodies import modes
from tests.consumers.predictions import Particles

pytest.importorskip("exudyn")
from tests.consumers.galileo import SAMPLE, Galileo

pytestmark = pytest.mark.exudyn

# The matrices of the sample are condensed: inside its bars, rotations of nodes are not among the dofs, and integrals of
# second order are an estimate there. Measured of the forces: 7e-6 and 4e-3.
CONDENSED = {"stator": 5e-5, "rotor": 1e-2}
# By the integrals of the particles themselves: round-off.
EXACT = 1e-12
INTERFACE = "spin_bearing"


@pytest.mark.parametrize("name", ["stator", "rotor"])
def test_mass_matrix_and_forces_are_those_of_particles(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.syspath_prepend(str(SAMPLE))
    for module in ("make", "structure", "beam"):
        monkeypatch.delitem(sys.modules, module, raising=False)
    structure = getattr(importlib.import_module("make"), name)()
    component = modes(Galileo(tmp_path).run.bodies[name].body, 20.0)
    place = floating_frame(component.body, component.Phi, 6, FrameCondition("clamped", INTERFACE))
    write_component(
        tmp_path / "body.h5",
        component,
        nodes=(),
        inputs={},
        outputs={},
        checks=(),
        provenance={},
        frame=place,
        about=IntegralFrame("frame", place.origin, place.axes),
    )
    body, particles = floating_body(tmp_path / "body.h5"), Particles.of(component, INTERFACE, structure)
    rng = np.random.default_rng(3)
    q, V = 0.01 * rng.normal(size=body.k), rng.normal(size=6 + body.k)
    V[6:] *= 0.01
    M, h = particles.inertia_force(V, q)
    h[6:] -= particles.stiffness @ q + particles.damping @ V[6:]
    scale = np.sqrt(np.diag(M))
    for source, tolerance in (
        (body, CONDENSED[name]),
        (
            replace(
                body,
                r_phi=np.einsum("pi,pja->ija", particles.place, particles.shapes),
                phi_phi=np.einsum("pia,pjb->ijab", particles.shapes, particles.shapes),
            ),
            EXACT,
        ),
    ):
        mass, force, _ = source.inertia(q, V)
        assert abs((mass - M) / np.outer(scale, scale)).max() < tolerance
        assert np.linalg.norm((force - h) / scale) < tolerance * np.linalg.norm(h / scale)
