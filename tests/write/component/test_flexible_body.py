"""Data of every floating-frame target: one mass, known motions, real damping."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cmsreduce.errors import WriteError
from cmsreduce.model import ModalIntegrals, SecondOrder
from cmsreduce.write import ComponentFile
from cmsreduce.write.component.flexible_body import flexible_body
from tests.write.particles import particles


def changed(file: ComponentFile, **arrays: np.ndarray | None) -> ComponentFile:
    merged = {**file.arrays, **{name.replace("__", "/"): values for name, values in arrays.items()}}
    return replace(file, arrays={name: values for name, values in merged.items() if values is not None})


def lumped(integrals: ModalIntegrals, scale: float) -> ModalIntegrals:
    second_order = SecondOrder(integrals.r_phi, scale * integrals.phi_phi)
    return replace(integrals, lumping="row-sum", second_order=second_order)


def test_lumped_integrals_come_with_the_modal_mass_of_the_same_lumping() -> None:
    """A lumped mass beside a consistent modal mass makes the whole body's mass matrix indefinite."""
    body = particles()
    made = flexible_body(body.file, lumped(body.integrals, 1.1))
    np.testing.assert_allclose(made.mass, 1.1 * np.eye(4), atol=1e-14)


def test_undetermined_integrals_are_left_out_for_slow_rotations_only() -> None:
    body = particles()
    momenta = replace(body.integrals, second_order=None)
    with pytest.raises(WriteError, match=r"not determined.* Write the body as exudyn or sid"):
        flexible_body(body.file, momenta)
    made, whole = flexible_body(body.file, momenta, slow=True), flexible_body(body.file, body.integrals)
    assert not made.integrals.r_phi.any() and not made.phi_cross_phi.any()
    np.testing.assert_array_equal(made.integrals.r_cross_phi, whole.integrals.r_cross_phi)
    np.testing.assert_array_equal(made.mass, whole.mass)


@pytest.mark.parametrize(
    ("file", "integrals", "message"),
    [
        (particles().file, replace(particles().integrals, modes=np.arange(1, 5)), "modes 2 to 5, but .* are 1 to 4"),
        (
            particles().file,
            replace(lumped(particles().integrals, 1.1), lumping="consistent"),
            r"differs by 1\.00e-01 from its modal mass",
        ),
        (changed(particles().file, nodes__id=None), particles().integrals, "a floating frame cannot hold it"),
        (changed(particles().file, modes__loss=np.eye(4)), particles().integrals, "complex stiffness"),
        (
            changed(particles().file, nodes__translation=np.full((7, 3, 4), np.nan)),
            particles().integrals,
            "motion of node 2 is not known in every direction.* or write the body as matlab or fmi",
        ),
        (replace(particles().file, rigid_count=7), particles().integrals, "has 7 motions without strain.* a mechanism"),
    ],
    ids=["modes", "mass", "geometry", "loss", "motion", "mechanism"],
)
def test_what_does_not_fit_is_refused(file: ComponentFile, integrals: ModalIntegrals, message: str) -> None:
    with pytest.raises(WriteError, match=message):
        flexible_body(file, integrals)
