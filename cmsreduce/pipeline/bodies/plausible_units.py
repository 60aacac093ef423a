"""Unit system that the material of a body is plausible in: density, and speed of waves against the size."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import SI, FEModel, Units, rigid_body_shapes
from cmsreduce.read import MassOrder, quiet_share

__all__ = ["Material", "implausible_units", "material_of", "plausible_units", "solid_material"]

# Unit systems in use, the most frequent first.
_SYSTEMS = ("m-kg-s", "mm-t-s", "in-slinch-s", "mm-kg-ms", "mm-g-ms", "mm-kg-s", "cm-g-s", "ft-slug-s", "m-t-s")
# Osmium has 22 590 kg/m^3, foam 10; no solid is lighter than 1, which is an aerogel. A body of lumps may be slow, but
# nothing is faster than diamond: 18 000 m/s; structural materials end with beryllium, 13 000 m/s.
_LIGHTEST, _HEAVIEST, _FASTEST = 1.0, 23_000.0, 14_000.0
# Rigid bodies in a mesh, which no stretch deforms, strain what is next to them: a speed may seem so much larger.
_STRAINED = 10.0
# A density or a speed that a unit system must give to be proposed in place of another.
_USUAL_DENSITY, _USUAL_SPEED = (20.0, 23_000.0), (50.0, 14_000.0)
# No solid is denser than filled rubber and this slow: lead, the slowest metal, has 2200 m/s. None is as light as foam
# and this fast: balsa, at 100 kg/m^3, has 5000 m/s.
_DENSE, _SLOW = 2500.0, 300.0
_AIRY, _FAST = 50.0, 3000.0
# Mass at a node above so many times the median is that of a lump, which says nothing of the material.
_LUMP = 20.0
_AXES = 3
# Nodes within this share of their reach from a plane have no hull.
_FLAT = 1e-6
# Corners of tetrahedra that fill a cell.
_TETRA = {
    "tetra": ((0, 1, 2, 3),),
    "pyramid": ((0, 1, 2, 4), (0, 2, 3, 4)),
    "wedge": ((0, 1, 2, 3), (1, 2, 3, 4), (2, 3, 4, 5)),
    "hexahedron": ((0, 1, 3, 4), (1, 2, 3, 6), (1, 3, 4, 6), (3, 4, 6, 7), (1, 4, 5, 6)),
}


@dataclass(frozen=True)
class Material:
    """Figures of a body's material, in the units of its files.

    Parameters
    ----------
    mass : float
        Total mass.
    speed : float
        Speed of waves: sqrt(u K u / m) of a unit stretch u, the largest of three directions. In a solid block it is
        exactly sqrt((lambda + 2 mu) / rho); bars and lumps make it smaller, rigid bodies in the mesh larger. 0 of a
        body that is held, whose supports no stretch moves.
    density : float, optional
        Mass by volume of the solid elements; None without any.
    by_hull : bool
        The volume is that of the convex hull of the nodes: no solid with these nodes is less dense.
    """

    mass: float
    speed: float
    density: float | None = None
    by_hull: bool = False

    def to_compare(self, units: Units) -> str:
        """Density in words, as a figure to compare; empty without."""
        density = self.in_si(units)[1]
        if density is None:
            return ""
        how = "or more if it is solid" if self.by_hull else "by the volume of its elements"
        return f"{density:.4g} kg/m^3 {how}"

    def in_words(self, units: Units) -> str:
        """Speed and density as numbers of m, kg and s."""
        speed, density = self.in_si(units)
        said = [] if density is None else [f"{density:.3g} kg/m^3"]
        return " and ".join([*said, *([f"waves of {speed:.3g} m/s"] if speed else [])])

    def in_si(self, units: Units) -> tuple[float, float | None]:
        """Speed in m/s and density in kg/m^3."""
        density = None if self.density is None else self.density * units.mass / units.length**3
        return self.speed * units.length / units.time, density


def material_of(body: FEModel, cells: Mapping[str, NDArray[np.int64]]) -> Material | None:
    """Figures of a body's material; None if it is condensed, has no geometry, or is held and has no solid elements.

    Parameters
    ----------
    body : FEModel
        As its files have it.
    cells : mapping of kind to (k, corners) int64
        Elements, by node ids.
    """
    if body.nodes is None or body.sets.get("q", np.empty(0)).size:
        return None
    R = rigid_body_shapes(body.dofs, body.nodes)[:, :3]
    mass = np.einsum("ij,ij->j", R, body.M @ R)
    if mass.max(initial=0.0) <= 0:
        return None
    volume = _volume(body, cells)
    density = float(mass.max()) / volume if volume > 0 else None
    if quiet_share(body.K, R) < 1:
        return None if density is None else Material(float(mass.max()), 0.0, density)
    at = np.zeros((body.n, 3))
    moving = np.flatnonzero(body.dofs.component > 0)
    at[moving] = body.nodes.xyz[body.nodes.index(body.dofs.node[moving])] - body.nodes.xyz.mean(axis=0)
    stretch = R * at
    energy = np.einsum("ij,ij->j", stretch, body.K @ stretch)
    speed = float(np.sqrt(max(energy.max(initial=0.0), 0.0) / mass.max()))
    return Material(float(mass.max()), speed, density)


def plausible_units(material: Material) -> tuple[Units | None, str]:
    """Unit system of the files.

    Returns
    -------
    units : Units or None
        m-kg-s unless no material is like this in it; None if the figures fit no unit system.
    reason : str
        Figures against m-kg-s; empty if they fit.
    """
    speed, density = material.in_si(SI)
    wrong = speed > _FASTEST or (density is not None and not _LIGHTEST <= density <= _HEAVIEST)
    if not wrong:
        return SI, ""
    for margin in (1.0, _STRAINED):
        for name in _SYSTEMS:
            units = Units.parse(name)
            if not _usual(material, units, margin):
                continue
            if units == SI:
                return SI, ""
            reason = f"in m-kg-s no material has {material.in_words(SI)}; in {name} it has {material.in_words(units)}"
            return units, reason
    reason = (
        f"no unit system makes a material of {material.in_words(SI)} (read as m-kg-s): the stiffness, the mass and the "
        "coordinates are in units that do not belong together"
    )
    return None, reason


def solid_material(body: FEModel, cells: Mapping[str, NDArray[np.int64]], order: MassOrder) -> Material | None:
    """Figures of the material of a body of solids, without its lumps; None of other bodies.

    Parameters
    ----------
    body : FEModel
        As its files have it.
    cells : mapping of kind to (k, corners) int64
        Elements, by node ids. Without any, a body of translations with a mass by pairs of nodes counts as solid, and
        the convex hull of its nodes as its volume.
    order : MassOrder
        Pairs of nodes that its mass couples.
    """
    found = material_of(body, cells) if set(cells) <= set(_TETRA) else None
    if found is None or body.nodes is None:
        return None
    translations = body.dofs.component.max(initial=0) <= _AXES
    volume = _volume(body, cells)
    by_hull = not cells and bool(translations) and order.status in ("proven", "alike")
    if by_hull:
        volume = _hull(body)
    if not volume > 0:
        return None
    mass = _without_lumps(body)
    return Material(mass, found.speed * np.sqrt(found.mass / mass), mass / volume, by_hull) if mass > 0 else None


def implausible_units(body: FEModel, declared: Units, solid: Material | None = None) -> str:
    """Remark on declared units in which a body has waves or a density of no material; empty if not.

    The matrices show the speed in a free body without the elements.

    Parameters
    ----------
    body : FEModel
        As its files have it.
    declared : Units
        Their units.
    solid : Material, optional
        Figures of a body of solids.
    """
    material = material_of(body, {})
    if solid is not None and _is_no_solid(*solid.in_si(declared), solid.by_hull):
        material = solid
    elif material is None or material.in_si(declared)[0] <= _STRAINED * _FASTEST:
        return ""
    systems = {name: Units.parse(name) for name in _SYSTEMS}
    names = [
        name
        for name, units in systems.items()
        if _usual(material, units, 1.0) and not _is_no_solid(*material.in_si(units), material.by_hull)
    ]
    other = f"; in {names[0]} they have {material.in_words(Units.parse(names[0]))}" if names else ""
    return (
        f"in {declared.name} the matrices have {material.in_words(declared)}, as no material has{other}: "
        "check the `units:` of the body"
    )


def _is_no_solid(speed: float, density: float | None, by_hull: bool) -> bool:
    """True of a density that no solid has, or that none with such slow waves has."""
    if density is None:
        return False
    dense = density > _HEAVIEST or (density > _DENSE and 0 < speed < _SLOW)
    # The hull of hollow bodies says nothing of how light they are.
    return dense or (not by_hull and (density < _LIGHTEST or (density < _AIRY and speed > _FAST)))


def _without_lumps(body: FEModel) -> float:
    """Mass along the axis with the most, without what single nodes have above the others."""
    R = rigid_body_shapes(body.dofs, body.nodes)[:, :_AXES]  # type: ignore[arg-type]
    of_rows = R * (body.M @ R)
    axis = int(of_rows.sum(axis=0).argmax())
    _, node = np.unique(body.dofs.node, return_inverse=True)
    of_nodes = np.bincount(node, of_rows[:, axis])
    most = _LUMP * float(np.median(abs(of_nodes[of_nodes != 0])))
    return float(np.clip(of_nodes, -most, most).sum())


def _hull(body: FEModel) -> float:
    """Volume of the convex hull of the nodes with rows or supports; 0 if they lie in a plane."""
    from scipy.spatial import ConvexHull

    assert body.nodes is not None
    known = body.dofs.node if body.constrained is None else np.concatenate([body.dofs.node, body.constrained.node])
    at = body.nodes.index(np.unique(known))
    xyz = body.nodes.xyz[at[at >= 0]]
    size = np.linalg.svd(xyz - xyz.mean(axis=0), compute_uv=False)
    if len(xyz) <= _AXES or size[-1] <= _FLAT * size[0]:
        return 0.0
    return float(ConvexHull(xyz).volume)


def _usual(material: Material, units: Units, margin: float) -> bool:
    speed, density = material.in_si(units)
    dense = density is None or _USUAL_DENSITY[0] <= density <= _USUAL_DENSITY[1]
    return dense and (not speed or _USUAL_SPEED[0] <= speed <= margin * _USUAL_SPEED[1])


def _volume(body: FEModel, cells: Mapping[str, NDArray[np.int64]]) -> float:
    assert body.nodes is not None
    total = 0.0
    for kind, corners in cells.items():
        at = body.nodes.index(corners) if kind in _TETRA else np.empty((0, 0), np.int64)
        if not at.size or (at < 0).any():
            continue
        x = body.nodes.xyz[at]
        for a, b, c, d in _TETRA[kind]:
            edges = np.stack([x[:, b] - x[:, a], x[:, c] - x[:, a], x[:, d] - x[:, a]], axis=1)
            total += float(np.abs(np.linalg.det(edges)).sum()) / 6
    return total
