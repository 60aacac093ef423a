"""Health of bodies with motions that nothing determines."""

from __future__ import annotations

from cmsreduce.mechanics import hold_undetermined
from cmsreduce.pipeline.bodies import body_health
from tests.mechanics.test_undetermined import aircraft, rigid_of


def test_a_massless_rotation_that_is_held_grounds_no_node() -> None:
    """A rope of bars turns freely about itself; its first node was said to be held with 2 % of the stiffness."""
    found = hold_undetermined(aircraft(1.0))
    health = body_health(found.body, rigid_of(found.body), undetermined=found.motions)
    assert health.grounding is not None and health.grounding.relative.max() < 1e-14
