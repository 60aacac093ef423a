"""Bodies with motions that nothing determines: their health, and parameters that act on such a motion."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.errors import MatrixError
from cmsreduce.mechanics import hold_undetermined
from cmsreduce.model import ParameterTerm
from cmsreduce.pipeline.bodies import body_health
from cmsreduce.pipeline.bodies.parameters import refuse_undetermined
from tests.mechanics.test_undetermined import aircraft, led_by_a_point, rigid_of
from tests.solids import block


def test_a_massless_rotation_that_is_held_grounds_no_node() -> None:
    """A rope of bars turns freely about itself; its first node was said to be held with 2 % of the stiffness."""
    found = hold_undetermined(aircraft(1.0))
    health = body_health(found.body, rigid_of(found.body), undetermined=found.motions)
    assert health.grounding is not None and health.grounding.relative.max() < 1e-14


def test_a_parameter_along_a_motion_that_a_spring_holds_is_refused() -> None:
    """The stiffness of the parameter would determine the motion, and the spring would act beside it."""
    made = block("bar", (1.0, 0.2, 0.1), (4, 2, 1))
    edge = np.flatnonzero((made.nodes.xyz[:, 0] == 1.0) & (made.nodes.xyz[:, 2] == 0.0)) + 1
    found = hold_undetermined(led_by_a_point(made, edge, np.array([0.1, 0.0, 0.05])))
    own = {label: row for row, label in enumerate(found.body.dofs.labels)}
    for label, refused in (("1.1", False), ("99.2", False), ("99.5", True), ("99.3", True)):
        A = np.zeros((found.body.n, found.body.n))
        A[own[label], own[label]] = 1.0
        terms = [ParameterTerm("preload", "K", sp.csc_array(A), 1)]
        if refused:
            with pytest.raises(MatrixError, match=rf"parameter 'preload' acts on {label} in a motion"):
                refuse_undetermined(terms, found)
        else:
            refuse_undetermined(terms, found)
