"""The mode set of one body as its keys ask for it, with what its neighbours have to do with it."""

from __future__ import annotations

from collections.abc import Mapping

from cmsreduce.assemble import rigid_substructure
from cmsreduce.config import ReduceKeys
from cmsreduce.model import InterfaceLoading, RigidBody, Scene
from cmsreduce.pipeline.bodies import FlexibleBody
from cmsreduce.pipeline.surroundings import loading_by_neighbours, loading_by_outboard, shared_interfaces
from cmsreduce.reduce import METHODS, BenfieldHruda, CraigBampton, InterfaceReduction, Reduction, reduction

__all__ = ["body_reduction"]


def body_reduction(
    name: str,
    keys: ReduceKeys,
    cutoff: float,
    bodies: Mapping[str, FlexibleBody],
    rigid_bodies: Mapping[str, RigidBody],
    interface_cutoffs: Mapping[str, float],
    scene: Scene,
) -> Reduction:
    """Prepare the reduction of a body.

    Parameters
    ----------
    name : str
        The body.
    keys : ReduceKeys
        Its mode set.
    cutoff : float
        Highest frequency of normal modes in Hz.
    bodies, rigid_bodies : mapping of name to body
        All bodies of the scene: neighbours load an interface, or share its shapes.
    interface_cutoffs : mapping of name to float
        In Hz, of bodies whose interfaces of several nodes are reduced.
    scene : Scene
        Its joints.
    """
    kind = METHODS[keys.method]
    inside: InterfaceReduction | None = None
    loading: InterfaceLoading | None = None
    if keys.interface_cutoff is not None and issubclass(kind, CraigBampton):
        inside = shared_interfaces(name, bodies, interface_cutoffs, scene)
    if issubclass(kind, BenfieldHruda):
        if kind.stiffness_loading:
            rigid = {other: rigid_substructure(body) for other, body in rigid_bodies.items()}
            loading = loading_by_neighbours(name, bodies, rigid, scene)
        else:
            loading = loading_by_outboard(name, bodies, rigid_bodies, scene)
    return reduction(keys.method, cutoff, inside, loading)
