"""A reduced body for floating-frame codes: data of a component file in the frame of its integrals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import WriteError
from cmsreduce.mechanics import rigid_mass_matrix
from cmsreduce.model import INERTIA_LOADS, SQUARES, UNDETERMINED, ModalIntegrals, ModalStiffening, SecondOrder, Units
from cmsreduce.write.component.component_file import ComponentFile
from cmsreduce.write.component.integrals import stored_stiffening

__all__ = [
    "FlexibleBody",
    "FrameStiffening",
    "SAME_MASS",
    "flexible_body",
    "frame_stiffening",
    "refuse_long_ids",
    "require_mass",
]

SAME_MASS = 1e-9
"""Relative to the largest modal mass. Integrals over the same mass differ from it by round-off of sums over all nodes,
integrals over another mass by per cents (theory section 8)."""
# Relative to a unit length and a direction: two equal frames differ by round-off of their axes.
_SAME_FRAME = 1e-12
# Relative to the momentum of a rigid motion of the same kinetic energy: mean axes leave round-off.
_NO_MOMENTUM = 1e-8
_LARGEST_ID = 2**31 - 1
# Rigid motions of a floating frame.
_SIX = 6
_PAIRS = tuple(("xyz".index(axes[0]), "xyz".index(axes[1])) for axes in SQUARES)

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FlexibleBody:
    """Deforming modes of a body and their shapes at nodes, along the axes of the floating frame.

    Parameters
    ----------
    name : str
        Name of the body.
    integrals : ModalIntegrals
        Integrals over the body and the k modes.
    mass, stiffness, damping : (k, k) float64
        Modal matrices.
    omega : (k,) float64
        Natural frequencies in rad per unit of time; NaN for static modes.
    node : (n,) int64
        Ids of the nodes.
    position : (n, 3) float64
        Position of each node from the origin of the frame.
    translation : (n, 3, k) float64
        Displacement of each node in each mode.
    rotation : (n, 3, k) float64
        Slope of each node in each mode; 0 where it is not known.
    blind : (b,) int64
        Ids of the nodes whose slope is not known, as with solid elements.
    interfaces : mapping of name to tuple of int
        Ids of the nodes at which joints attach.
    units : Units
        Units of all numbers.
    """

    name: str
    integrals: ModalIntegrals
    mass: Array
    stiffness: Array
    damping: Array
    omega: Array
    node: NDArray[np.int64]
    position: Array
    translation: Array
    rotation: Array
    blind: NDArray[np.int64]
    interfaces: Mapping[str, tuple[int, ...]]
    units: Units

    @property
    def k(self) -> int:
        """Number of modes."""
        return int(self.omega.size)

    @property
    def phi_cross_phi(self) -> Array:
        """Integral of phi_a x phi_b over the mass: entry [axis, a, b] (3, k, k)."""
        P = self.integrals.phi_phi
        return np.stack([P[1, 2] - P[2, 1], P[2, 0] - P[0, 2], P[0, 1] - P[1, 0]])

    def in_si(self) -> FlexibleBody:
        """The body in metres, kilograms and seconds; a modal mass of 1 stays 1."""
        units = self.units
        # Shapes that are normalised by mass are in the unit of mass to the power -1/2.
        shape = 1 / np.sqrt(units.mass)
        at, length = self.integrals, units.length
        integrals = replace(
            at,
            origin=at.origin * length,
            mass=at.mass * units.mass,
            first_moment=at.first_moment * units.mass * length,
            inertia=at.inertia * units.mass * length**2,
            phi=at.phi * units.mass * shape,
            r_cross_phi=at.r_cross_phi * units.mass * length * shape,
            second_order=replace(at.second_order, r_phi=at.r_phi * units.mass * length * shape)
            if at.second_order is not None
            else None,
        )
        return replace(
            self,
            integrals=integrals,
            stiffness=self.stiffness / units.time**2,
            damping=self.damping / units.time,
            omega=self.omega / units.time,
            position=self.position * length,
            translation=self.translation * shape,
            rotation=self.rotation * (shape / length),
            units=Units.parse("m-kg-s"),
        )

    @property
    def has_momentum(self) -> bool:
        """True if the modes have linear or angular momentum, as they have in any frame but mean axes."""
        momentum = np.vstack([self.integrals.phi, self.integrals.r_cross_phi])
        rigid = np.sqrt(np.diagonal(rigid_mass_matrix(self.integrals)))[:, None]
        largest = _NO_MOMENTUM * np.max(rigid * np.sqrt(self.mass.diagonal()), initial=0.0)
        return bool(abs(momentum).max(initial=0.0) > largest)

    @property
    def static_count(self) -> int:
        """Number of modes without mass, and so without a frequency."""
        return int(np.isnan(self.omega).sum())


@dataclass(frozen=True, eq=False)
class FrameStiffening:
    """Stiffness of k deforming modes per unit load, along the axes and about the origin of the frame of the integrals.

    Parameters
    ----------
    acceleration, turning : (3, k, k) float64
        Per unit acceleration and angular acceleration of the frame.
    spinning : (6, k, k) float64
        Per product xx yy zz xy yz xz of its angular velocities.
    force, moment : mapping of node to (3, k, k) float64
        Per unit force and moment at a node.
    """

    acceleration: Array
    turning: Array
    spinning: Array
    force: Mapping[int, Array]
    moment: Mapping[int, Array]


def flexible_body(component: ComponentFile, integrals: ModalIntegrals, *, slow: bool = False) -> FlexibleBody:
    """Data of a component file for floating-frame codes.

    Parameters
    ----------
    component : ComponentFile
        The body.
    integrals : ModalIntegrals
        Integrals over its modes; their frame becomes the frame of the body.
    slow : bool
        True if the format can be written for slow rotations: integrals of second order that are not determined are
        zero, which leaves out forces by squares of angular velocities and the change of inertia with the deformation.

    Raises
    ------
    WriteError
        If the body has no nodes, integrals that the format needs are not determined, the integrals are over other modes
        or another mass than the modal mass, or its damping is a complex stiffness.
    """
    arrays, columns = component.arrays, integrals.modes
    if "nodes/id" not in arrays:
        raise WriteError(
            f"component '{component.name}': a body of scalar points has no geometry, so a floating frame cannot hold "
            "it; write it as nastran or matlab"
        )
    if component.rigid_count > _SIX:
        raise WriteError(
            f"component '{component.name}': it has {component.rigid_count} motions without strain. Six belong to the "
            "floating frame; the others are a mechanism, which a floating-frame code would lose. Lock it, or write "
            "the body as nastran or matlab"
        )
    if "modes/loss" in arrays:
        raise WriteError(
            f"component '{component.name}': structural damping is a complex stiffness, which codes in the time domain "
            "cannot use; give it modal damping"
        )
    if columns.size and (columns.min() < component.rigid_count or columns.max() >= component.omega.size):
        raise WriteError(
            f"component '{component.name}': the integrals are over modes {columns.min() + 1} to {columns.max() + 1}, "
            f"but its deforming modes are {component.rigid_count + 1} to {component.omega.size}"
        )
    axes = integrals.axes
    translation = np.einsum("ij,njm->nim", axes, arrays["nodes/translation"][:, :, columns])
    rotation = np.einsum("ij,njm->nim", axes, arrays["nodes/rotation"][:, :, columns])
    if np.isnan(translation).any():
        lost = arrays["nodes/id"][np.isnan(translation).any(axis=(1, 2))]
        raise WriteError(
            f"component '{component.name}': the motion of node {lost[0]} is not known in every direction, and a "
            "floating frame moves in all of them; give its matrices the missing translations (a plane body lacks "
            "some), or write the body as matlab or fmi"
        )
    unknown = np.isnan(rotation).any(axis=(1, 2))
    square = np.ix_(columns, columns)
    mass = _modal_mass(component, integrals)
    if integrals.second_order is None:
        if not slow:
            raise WriteError(
                f"component '{component.name}': {UNDETERMINED}, and this format needs them. Write the body as exudyn "
                "or sid, for slow rotations, or as nastran, matlab or abcd; or reduce the matrices of its whole mesh"
            )
        k = columns.size
        integrals = replace(integrals, second_order=SecondOrder(np.zeros((3, 3, k)), np.zeros((3, 3, k, k))))
    return FlexibleBody(
        name=component.name,
        integrals=integrals,
        mass=mass,
        stiffness=_symmetric(arrays["modes/stiffness"][square]),
        damping=arrays["modes/damping"][square],
        omega=component.omega[columns],
        node=arrays["nodes/id"],
        position=(arrays["nodes/xyz"] - integrals.origin) @ axes.T,
        translation=translation,
        rotation=np.where(unknown[:, None, None], 0.0, rotation),
        blind=arrays["nodes/id"][unknown],
        interfaces=component.interfaces,
        units=component.units,
    )


def require_mass(body: FlexibleBody, because: str) -> None:
    """Refuse modes without mass for codes that cannot use them.

    Raises
    ------
    WriteError
        If there are any; ``because`` is the reason of the code.
    """
    if body.static_count:
        raise WriteError(
            f"component '{body.name}': {body.static_count} static modes have no mass, and {because}; leave "
            "`residuals` out of `reduce`, or give their nodes some inertia"
        )


def refuse_long_ids(component: ComponentFile, nodes: NDArray[np.int64], program: str) -> None:
    """Refuse nodes whose numbers are too large for a program that counts in 32 bits.

    Raises
    ------
    WriteError
        If there are any.
    """
    if nodes.max(initial=0) > _LARGEST_ID:
        raise WriteError(
            f"component '{component.name}': {program} has no node numbers above {_LARGEST_ID}, and this body has node "
            f"{nodes.max()}; number its nodes lower"
        )


def frame_stiffening(component: ComponentFile, integrals: ModalIntegrals) -> FrameStiffening | None:
    """Geometric stiffness of the deforming modes, about the frame of the integrals; None where the file has none.

    A term that is missing in the file is zero here.

    Raises
    ------
    WriteError
        If the frame is another than that of the stored terms, and not all twelve inertia loads are in the file, which
        are needed to transform them.

    Notes
    -----
    With d from the stored origin to that of the frame, an angular acceleration a about the frame's origin is one about
    the stored origin and an acceleration - a x d; a spin w is one about the stored origin and - W d, W = w w^T - w.w 1.
    """
    stored = stored_stiffening(component)
    if stored is None:
        return None
    k = integrals.modes.size
    square = np.ix_(np.arange(len(stored.loads)), integrals.modes, integrals.modes)
    deforming = ModalStiffening(stored.loads, stored.K[square], stored.origin)
    A, d = integrals.axes, integrals.origin - stored.origin
    same = max(float(abs(A - np.eye(3)).max()), float(abs(d).max())) <= _SAME_FRAME
    lacking = [load.label for load in INERTIA_LOADS if deforming.of(load.label) is None]
    if not same and 0 < len(lacking) < len(INERTIA_LOADS):
        raise WriteError(
            f"component '{component.name}': its geometric stiffness is along the basic axes about {stored.origin}, and "
            f"its integrals are in another frame; to transform it, all twelve loads of a moving frame are needed, and "
            f"'{lacking[0]}' is missing: ask for all of them, or for integrals in the frame of the stiffness"
        )

    def of(kind: str, axes: tuple[str, ...]) -> Array:
        found = [deforming.of(f"{kind} {axis}") for axis in axes]
        return np.array([np.zeros((k, k)) if K is None else K for K in found])

    xyz = ("x", "y", "z")
    pull, turn, spin = of("acceleration", xyz), of("angular acceleration", xyz), of("centrifugal", SQUARES)
    products = [np.outer(A[i], A[j]) if i == j else np.outer(A[i], A[j]) + np.outer(A[j], A[i]) for i, j in _PAIRS]
    share = np.array([[S[a, b] for a, b in _PAIRS] for S in products])
    offset = np.array([(S - np.trace(S) * np.eye(3)) @ d for S in products])
    points: dict[str, dict[int, Array]] = {"force": {}, "moment": {}}
    for load in stored.loads:
        if load.at:
            node, axes = int(load.at), tuple(f"{load.at}.{axis}" for axis in xyz)
            points[load.kind][node] = np.einsum("ij,jab->iab", A, of(load.kind, axes))
    return FrameStiffening(
        acceleration=np.einsum("ij,jab->iab", A, pull),
        turning=np.einsum("ij,jab->iab", A, turn) - np.einsum("ij,jab->iab", np.cross(A, d), pull),
        spinning=np.einsum("ij,jab->iab", share, spin) - np.einsum("ij,jab->iab", offset, pull),
        force=points["force"],
        moment=points["moment"],
    )


def _modal_mass(component: ComponentFile, integrals: ModalIntegrals) -> Array:
    """Phi^T M Phi over the mass of the integrals, so that both describe the same mass.

    For any mass matrix, it is the trace of int phi_i phi_j dm.
    """
    mass = _symmetric(component.arrays["modes/mass"][np.ix_(integrals.modes, integrals.modes)])
    if integrals.second_order is None:
        return mass
    total = _symmetric(np.einsum("iiab->ab", integrals.phi_phi))
    if integrals.lumping != "consistent":
        return total
    apart = abs(total - mass).max(initial=0.0)
    if apart > SAME_MASS * abs(mass).max(initial=0.0):
        raise WriteError(
            f"component '{component.name}': the modal mass of its integrals differs by {apart:.2e} from its modal "
            "mass: they are over another mass or other shapes; write the component file again"
        )
    return mass


def _symmetric(A: Array) -> Array:
    """The symmetric part: sums over nodes are symmetric to round-off, and MBDyn asks for the last digit."""
    return np.asarray((A + A.T) / 2)
