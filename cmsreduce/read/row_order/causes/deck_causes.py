"""Likely causes of forces against rigid motion that the deck shows: equations, hourglasses, the stress of a load."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import CmsReduceError
from cmsreduce.model import KEY_STEP, DofTable, FEModel, rigid_body_shapes
from cmsreduce.read.calculix_abaqus import equations, hourglass_forces, preload_step
from cmsreduce.read.row_order.causes.failure import Failure
from cmsreduce.read.row_order.rigid_residual import RigidResidual

__all__ = ["deck_cause"]

# Elements without hourglasses, in place of those of one point.
_FULL = {"C3D8R": "C3D8I or C3D8", "S4R": "S8R or S4", "B31R": "B32R or B31"}
# Rows whose forces are those of one modulus, as no other cause makes them: four nodes.
_FEWEST_ROWS = 12
# Relative to the stiffness: a stress changes it by the strain that belongs to it, and rows in disorder by more.
_BY_STRESS = 1e-2
_NAMED = 5
# Of the terms of an equation: rigid motion that leaves less satisfies it.
_SATISFIED = 1e-6


def deck_cause(case: Failure) -> str | None:
    """The first cause of the deck that explains why a stiffness resists rigid motion, and the remedy."""
    return _broken_equations(case) or _hourglass_stiffness(case) or _preload(case)


def _hourglass_stiffness(case: Failure) -> str | None:
    """The stiffness by which CalculiX holds hourglasses resists rotation: its forces are those found."""
    body, found = case.body, case.found
    loaded = (found.excess > 1) & np.isin(body.dofs.node, case.loaded)
    deck = _input_file(body)
    if deck is None or not loaded.any():
        return None
    parts, whole, count = hourglass_forces(deck, body.dofs, case.nodes, found.shapes)
    # Constraints and supports bring forces to nodes of their own; a few others show the cause.
    some = (loaded & whole).sum() >= _FEWEST_ROWS
    sure = bool(parts) and (_explained(found, loaded, parts) or (some and _explained(found, loaded & whole, parts)))
    knots = bool(parts) and not whole.any() and case.only_turning and found.relative[loaded].max() <= _BY_STRESS
    if not sure and not knots:
        return None
    named = " and ".join(f"{number} {label}" for label, number in count.items())
    others = " and ".join(dict.fromkeys(_FULL.get(label, _FULL["C3D8R"]) for label in count))
    solids = "" if "C3D8R" in count else " (CalculiX makes C3D8R of them)"
    said, more = ("make", "") if sure else ("probably make", "; knots bring them to other nodes")
    return (
        f"elements: the {named} of {deck}{solids} {said} these forces, by the stiffness with which CalculiX holds "
        f"their hourglasses{more}. Where opposite faces of such a solid are not parallel, as in a warped shell, it "
        f"resists rigid rotation, in any order of the rows. Write the matrices again with {others} in their place"
    )


def _broken_equations(case: Failure) -> str | None:
    """Equations of the deck that rigid motion breaks: motions that break none cost no force."""
    body, found, deck = case.body, case.found, _input_file(case.body)
    try:
        stated = [] if deck is None else [each for each in equations(deck) if each[2].size > 1]
    except (CmsReduceError, ValueError, OverflowError):
        return None
    if not stated:
        return None
    node, component = (np.concatenate([getattr(dofs, name) for _, dofs, _ in stated]) for name in ("node", "component"))
    factors, count = np.concatenate([each for *_, each in stated]), np.array([each.size for *_, each in stated])
    first = np.cumsum(count) - count
    known = case.nodes.index(node) >= 0
    kept, of = np.unique(node * KEY_STEP + component, return_inverse=True)
    # A matrix that holds an equation has no row of the dof that it eliminates.
    with_row = np.isin(kept, body.dofs.node * KEY_STEP + body.dofs.component)[of]
    held = np.logical_and.reduceat(known, first) & ~np.logical_and.reduceat(with_row, first)
    here = np.isin(kept // KEY_STEP, node[known])
    shapes = np.zeros((kept.size, 6))
    table = DofTable(kept[here] // KEY_STEP, (kept[here] % KEY_STEP).astype(np.int8))
    shapes[here] = rigid_body_shapes(table, case.nodes, found.centre) / np.repeat([1, found.length], 3)
    left = np.add.reduceat(factors[:, None] * shapes[of], first) / np.add.reduceat(abs(factors), first)[:, None]
    off = _SATISFIED + case.nodes.xyz_rounding / found.length
    broken = np.flatnonzero(held & (abs(left).max(axis=1) > off))
    loaded = body.dofs.node[found.excess > 1]
    tied = node[with_row & np.repeat(np.isin(np.arange(count.size), broken), count)]
    if not broken.size or not np.isin(tied, loaded).all():
        return None
    own = left[broken] @ found.motions
    square, motions = np.linalg.eigh(own.T @ own)
    free = motions[:, square <= _SATISFIED**2 * square[-1]]
    resists = (found.excess > 1) & np.isin(body.dofs.node, case.loaded)
    if not found.explained(resists, found.force[resists] @ free):
        return None
    # Motions that break all of them explain forces anywhere.
    if not free.size and 2 * np.unique(loaded).size > body.dofs.node_ids.size:
        return None
    return _words(case, [stated[each][:2] for each in broken], abs(left[broken, :3]).max(axis=1) > off)


def _words(case: Failure, broken: Sequence[tuple[str, DofTable]], pushes: NDArray[np.bool_]) -> str | None:
    """Fault of equations that rigid motion breaks, and translation some of them, and its remedy, in words."""
    support = pushes | np.array([np.unique(dofs.node).size == 1 for _, dofs in broken])
    if case.body.grounded and support.all():
        return None
    one = int(np.argmin(support))
    where, dofs = broken[one]
    nodes = np.unique(dofs.node)
    named = f"{where} of node{'s' * (nodes.size > 1)} {', '.join(map(str, nodes[:_NAMED].tolist()))}"
    more = f" and {len(broken) - 1} more do" if len(broken) > 1 else " does"
    if support[one]:
        moved = "translation" if pushes[one] else "rotation"
        return (
            f"{named}{more} not hold under {moved} of the whole body: an equation between dofs of one node, or whose "
            "coefficients along an axis do not add up to zero, holds the body as a support does. Mend the coefficients "
            "or leave the equation out; a body that is meant to be held is `grounded: true`"
        )
    apart = float(np.ptp(case.nodes.xyz[case.nodes.index(nodes)], axis=0).max())
    return (
        f"{named}, which lie {apart:.3g} apart,{more} not hold under rotation of the whole body, which therefore costs "
        "force, in any order of the rows. Join coincident nodes, or join bodies by a rigid body or a tie of surfaces "
        "that touch"
    )


def _explained(found: RigidResidual, loaded: NDArray[np.bool_], parts: Sequence[NDArray[np.float64]]) -> bool:
    """True if forces on the rows that are loaded are those of the parts, each times a modulus."""
    rows = np.flatnonzero(loaded)
    columns = np.array([part[rows].ravel() for part in parts]).T
    force = found.force[rows]
    size = np.linalg.norm(columns, axis=0)
    columns /= np.where(size > 0, size, 1.0)
    moduli = np.linalg.lstsq(columns, force.ravel(), rcond=None)[0]
    return found.explained(loaded, force - (columns @ moduli).reshape(force.shape))


def _preload(case: Failure) -> str | None:
    """Stress of a load resists rotation: the deck has a perturbation step, and the forces are small."""
    deck, found = _input_file(case.body), case.found
    rows = (found.excess > 1) & np.isin(case.body.dofs.node, case.loaded)
    if deck is None or found.relative[rows].max(initial=0.0) > _BY_STRESS:
        return None
    step = preload_step(deck)
    if not step:
        return None
    return (
        f"a preload: {step} with PERTURBATION writes matrices that hold the stress of the step before it, and its "
        "loads do not turn with the body. Write the matrices of the body in a job whose first step has no loads, and "
        "give this stiffness as that of a parameter: `scene: {parameters: {preload: {stiffness: {BODY: {file: ..., "
        "whole: true}}}}}`"
    )


def _input_file(body: FEModel) -> Path | None:
    """Deck of CalculiX or Abaqus among the files of a body."""
    found = (s.path for s in body.sources if s.holds == "geometry" and s.path.lower().endswith(".inp"))
    return next(map(Path, found), None)
