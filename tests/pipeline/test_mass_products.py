"""Mass products of two models, by the masses between their coordinates."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from cmsreduce.assemble import modal_substructure, physical_substructure
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.pipeline.system import cross_orthogonality, mass_products
from cmsreduce.reduce import reduction
from tests.assemble.rigs import rigid_modes
from tests.solids import block

BODY = block("bar", [0.8, 0.2, 0.2], [8, 3, 3], {"root": [1, 2, 3, 7]})


@cache
def modes_to(hz):
    """Not made while tests are collected, which every process does."""
    return orthogonalise(
        reduction("craig-bampton", hz).reduce(BODY, BODY.interface_rows("root"), rigid=rigid_modes(BODY))
    )


@pytest.mark.parametrize("many", [False, True])
@pytest.mark.parametrize("few", [False, True])
def test_they_are_the_products_over_all_dofs(many, few):
    full, reduced = modes_to(6e3) if many else None, modes_to(2e3) if few else None
    rng = np.random.default_rng(0)
    X, Y = (
        rng.standard_normal((BODY.n if modes is None else modes.omega.size, k)) + 1j * rng.standard_normal(k)
        for modes, k in ((full, 3), (reduced, 2))
    )
    sub = physical_substructure(BODY, [], rigid_modes(BODY)) if full is None else modal_substructure(full, [])
    masses = mass_products({"bar": BODY}, {"bar": full}, {"bar": reduced}, {"bar": sub})
    here, there = (Z if modes is None else modes.Phi @ Z for modes, Z in ((full, X), (reduced, Y)))
    expected = here.conj().T @ (BODY.M @ there)
    found = cross_orthogonality({"bar": X}, {"bar": Y}, masses)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * abs(expected).max())


def test_a_body_that_is_no_finite_element_model_has_its_own_mass():
    sub = modal_substructure(modes_to(6e3), [])
    masses = mass_products({}, {}, {}, {"bar": sub})
    np.testing.assert_array_equal(masses["bar"].toarray(), np.eye(modes_to(6e3).omega.size))
