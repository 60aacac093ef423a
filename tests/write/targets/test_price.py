"""Prices of formats, against sums over particles."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import scipy.linalg as la

from cmsreduce.write.component import flexible_body
from cmsreduce.write.targets.price import lumped_price, price_of, spin_price
from tests.write.particles import particles


def test_the_speed_at_which_one_percent_of_a_stiffness_is_left_out() -> None:
    """Centrifugal forces m w x (w x u q) of the particles, on the modes, at that speed about the worst axis."""
    body = particles()
    (speed,) = re.findall(r"at (\S+) rad per unit of time", spin_price(flexible_body(body.file, body.integrals)))
    softest = 1.0
    for axis in np.eye(3):
        w = float(speed) * axis
        outward = np.cross(w, np.cross(w, body.u, axisb=1, axisc=1), axisb=1, axisc=1)
        C = np.einsum("n,nia,nib->ab", body.m, body.u, outward)
        softest = min(softest, la.eigh(np.diag(body.omega**2) + C, np.diag(body.omega**2), eigvals_only=True)[0])
    np.testing.assert_allclose(1 - softest, 0.01, rtol=0.02)


def test_lumps_with_the_mass_of_the_body_cost_nothing() -> None:
    """Particles at the nodes alone are a lumped mass already."""
    body = particles(0.0)
    by = re.findall(r"([+-]\d+\.\d)[, ]", lumped_price(body.file, body.integrals))
    assert len(by) == 4 and not np.array(by, dtype=float).any()


def test_lumps_of_a_held_body_whose_modes_are_all_its_motions() -> None:
    """Its natural vibrations are those of the frame at rest; they span the motions of the body as a whole."""
    body = particles()
    m, J = body.node_m, np.einsum("nii->ni", body.node_J)
    lumped = np.einsum("n,nia,nib->ab", m, body.node_u, body.node_u)
    lumped += np.einsum("ni,nia,nib->ab", J, body.node_v, body.node_v)
    changed = np.sqrt(la.eigh(np.diag(body.omega**2), lumped, eigvals_only=True)) / body.omega
    by = re.findall(r"([+-]\d+\.\d)[, ]", lumped_price(body.file, body.integrals))
    np.testing.assert_allclose(np.array(by, dtype=float), 100 * (changed - 1), atol=0.051)


def test_nodal_data_have_the_price_of_lumps() -> None:
    body = particles()
    for target in ("discos", "dads"):
        assert price_of(body.file, body.integrals, target, None) == (lumped_price(body.file, body.integrals),)


def test_what_exudyn_loses_is_said() -> None:
    body = particles()
    assert "no place for modal damping" in price_of(body.file, body.integrals, "exudyn", None)[0]
    undamped = {**body.file.arrays, "modes/damping": np.zeros((4, 4))}
    assert price_of(replace(body.file, arrays=undamped), body.integrals, "exudyn", None) == ()


def test_formats_that_hold_the_body_have_no_price() -> None:
    body = particles()
    assert price_of(body.file, body.integrals, "mbdyn", "invariants") == ()
    assert price_of(body.file, body.integrals, "42", None) == ()
