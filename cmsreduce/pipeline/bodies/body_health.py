"""Health of an unreduced body: definiteness, mass properties, rigid motions, grounding, effective masses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.eigen import certified_modes
from cmsreduce.linalg.sparse import factorise, motions_held
from cmsreduce.model import FEModel, Finding, rigid_body_shapes
from cmsreduce.pipeline.bodies.mass_proof import negative_mass
from cmsreduce.pipeline.bodies.stiffness_proof import negative_stiffness
from cmsreduce.pipeline.store import diagnostic
from cmsreduce.verify import (
    Contrast,
    EffectiveMass,
    Grounding,
    LightDofs,
    MassProperties,
    PrincipalInertia,
    RigidMotions,
    effective_mass,
    grounding,
    inertia_excess,
    light_dofs,
    principal_inertia,
    rigid_mass_properties,
    rigid_motions,
    stiffness_contrast,
)

__all__ = ["BodyHealth", "body_health", "effective_masses"]

_FREE = 6
_NONE = np.empty(0, dtype=np.int64)


@dataclass(frozen=True, eq=False)
class BodyHealth:
    """Findings of the matrices and the geometry of a body.

    Parameters
    ----------
    negative : mapping of ``stiffness`` and ``mass`` to int or None
        Number of motions of negative energy; None if no factorisation was made, or if it does not show them.
    light : LightDofs
        Dofs without mass, and almost without.
    contrast : tuple of Contrast
        Range of the stiffness of each kind of dof.
    mass : mapping of ``geometry``, ``stiffness`` and ``modes`` to MassProperties
        Mass properties by the rigid motions of each source; only ``geometry`` for a body that is not free in all
        directions, empty without geometry.
    principal : PrincipalInertia, optional
        Principal inertia by geometry, if the mass is the same in all directions.
    motions : RigidMotions, optional
        Rigid motions by each source, of a body that is free in all directions; only of a thorough check.
    grounding : Grounding, optional
        Forces under its rigid motions; rotations about the mean of its nodes.
    checks : tuple of Finding
        Checks that must pass.
    """

    negative: dict[str, int | None]
    light: LightDofs
    contrast: tuple[Contrast, ...]
    mass: dict[str, MassProperties]
    principal: PrincipalInertia | None
    motions: RigidMotions | None
    grounding: Grounding | None
    checks: tuple[Finding, ...]


def body_health(
    body: FEModel,
    rigid: NDArray[np.float64],
    *,
    thorough: bool = True,
    negative: Mapping[str, int | None] | None = None,
    undetermined: sp.csc_array | None = None,
) -> BodyHealth:
    """Check a body as it was read.

    Parameters
    ----------
    body : FEModel
        The body.
    rigid : (n, r) float64
        Its rigid-body modes.
    thorough : bool
        Factorise its matrices, for their definiteness and for rigid motions by other sources.
    negative : mapping of ``stiffness`` and ``mass`` to int or None, optional
        Motions of negative energy, if they are known.
    undetermined : (n, k) csc array, optional
        Motions that neither stiffness nor mass determines, of which one dof each is held, as in `Determined`.
    """
    if negative is None:
        negative = dict.fromkeys(("stiffness", "mass"))
        if thorough:
            negative = {"stiffness": negative_stiffness(body), "mass": negative_mass(body)}
    checks = [
        Finding(f"{what}: motions of negative energy", float(n), 0.0) for what, n in negative.items() if n is not None
    ]
    mass: dict[str, MassProperties] = {}
    motions = held = principal = None
    if body.nodes is not None:
        centre = body.nodes.xyz.mean(axis=0)
        R = _rigid_shapes(body, undetermined)
        M6 = R.T @ (body.M @ R)
        mass |= _mass(body, "geometry", M6)
        if inertia_excess(M6) is not None and "geometry" in mass:
            principal = _principal(body, mass["geometry"])
        if rigid.shape[1] == _FREE:
            # About the mean of the nodes: the inertia of a body far from the origin would drown in its distance.
            about = _rigid_shapes(body, undetermined, centre)
            held = _grounding(body, about)
            # An indefinite stiffness has no static response that shows rigid motions.
            motions = _motions(body, about) if thorough and not negative["stiffness"] else None
        if motions is not None:
            for source, X in (("stiffness", motions.stiffness), ("modes", motions.eigen)):
                found = _mass(body, source, X.T @ (body.M @ X))
                mass |= {name: replace(each, cg=each.cg + centre) for name, each in found.items()}
    return BodyHealth(
        negative=dict(negative),
        light=_light(body),
        contrast=_contrast(body),
        mass=mass,
        principal=principal,
        motions=motions,
        grounding=held,
        checks=tuple(checks),
    )


def _rigid_shapes(
    body: FEModel, undetermined: sp.csc_array | None, point: ArrayLike = (0.0, 0.0, 0.0)
) -> NDArray[np.float64]:
    """Rigid motions by the geometry (n, 6), in which each dof that is held is at rest."""
    assert body.nodes is not None
    R = rigid_body_shapes(body.dofs, body.nodes, point)
    if undetermined is None or not undetermined.shape[1]:
        return R
    resisted = body.K @ undetermined
    own = factorise(sp.csc_array(undetermined.T @ resisted), what="the stiffness of motions held")
    return np.asarray(R - undetermined @ own(resisted.T @ R))


def _name(body: FEModel, *_: object) -> str:
    return body.name


@diagnostic("the mass of '{}'", dict, about=lambda body, source, _: f"{body.name}, by its {source}")
def _mass(body: FEModel, source: str, M6: NDArray[np.float64]) -> dict[str, MassProperties]:
    return {source: rigid_mass_properties(M6)}


@diagnostic("the search for light dofs of '{}'", lambda: LightDofs(_NONE, _NONE, 0.0, -1), about=_name)
def _light(body: FEModel) -> LightDofs:
    return light_dofs(body)


@diagnostic("the contrast of the stiffness of '{}'", tuple, about=_name)
def _contrast(body: FEModel) -> tuple[Contrast, ...]:
    return tuple(stiffness_contrast(body))


@diagnostic("the principal inertia of '{}'", about=_name)
def _principal(body: FEModel, mass: MassProperties) -> PrincipalInertia | None:
    return principal_inertia(mass)


@diagnostic("the search for grounded dofs of '{}'", about=_name)
def _grounding(body: FEModel, R: NDArray[np.float64]) -> Grounding | None:
    return grounding(body, R)


@diagnostic("the comparison of rigid motions of '{}'", about=_name)
def _motions(body: FEModel, R: NDArray[np.float64]) -> RigidMotions | None:
    return rigid_motions(body, R)


@diagnostic("the table of effective masses of '{}'", about=_name)
def effective_masses(
    body: FEModel, rigid: NDArray[np.float64], faces: Sequence[str], hz: float
) -> EffectiveMass | None:
    """Effective masses of the modes of a body held at interfaces.

    Parameters
    ----------
    body : FEModel
        With geometry.
    rigid : (n, r) float64
        Its rigid-body modes.
    faces : sequence of str
        Interfaces that are held.
    hz : float
        Highest frequency.

    Returns
    -------
    EffectiveMass or None
        About the mean of the held nodes; None without geometry, or where the interfaces do not hold the body.

    Raises
    ------
    MatrixError
        If the modes cannot be computed.
    """
    if body.nodes is None or not faces:
        return None
    held = np.unique(np.concatenate([body.interface_rows(face) for face in faces]))
    if motions_held(rigid, held) < rigid.shape[1]:
        return None
    point = np.vstack([body.interfaces[face].position for face in faces]).mean(axis=0)
    R = rigid_body_shapes(body.dofs, body.nodes, point)
    MR = np.asarray(body.M @ R)
    free = np.setdiff1d(np.arange(body.n), held)
    if not free.size:
        return None
    K, M = (sp.csc_array(A[free][:, free]) for A in (body.K, body.M))
    try:
        modes = certified_modes(K, M, 2 * np.pi * hz, rounding=body.rounding)
    except MatrixError as error:
        raise MatrixError(f"body '{body.name}' held at {', '.join(faces)}: {error}") from None
    return effective_mass(modes.omega / (2 * np.pi), MR[free].T @ modes.Phi, R.T @ MR)
