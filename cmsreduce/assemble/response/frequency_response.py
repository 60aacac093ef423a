"""Frequency response by coupling the receptances of the bodies (theory sections 1 and 6)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.assemble.held_bodies import held_bodies
from cmsreduce.assemble.joint_elements import with_joint_bodies
from cmsreduce.assemble.points import PointStack
from cmsreduce.assemble.response.by_loads import by_loads, sees_much
from cmsreduce.assemble.response.by_rows import ByRows, add_between, frequencies_last
from cmsreduce.assemble.response.joint_chains import joint_chain
from cmsreduce.assemble.response.receptance import DAMPED_RIGID, Receptance, receptance
from cmsreduce.assemble.response.residual_flexibility import JoinedRows, residual_flexibility
from cmsreduce.assemble.system import Wiring, wire
from cmsreduce.linalg.blocks import dense, svd
from cmsreduce.linalg.response import frequency_blocks
from cmsreduce.model import Configuration, Matrix, Scene, Substructure, System, damping_parts

__all__ = ["body_receptances", "couple", "frequency_response", "rigid_response"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Memory of the receptances and joined flexibilities of the frequencies coupled at a time. Of 2^22 to 2^27 bytes, an
# interface of 90 joint forces takes least time with 2^23 and 2^24, half of that with 2^27.
_BLOCK_BYTES = 2**24
# Several configurations have so many times as much together: blocks of few frequencies cost more calls than work.
_OF_SEVERAL = 4
# Rigid motions with drag turn as a nutation if this share of their largest root does; less is rounding.
_TURNS = 1e-6


def body_receptances(
    stack: PointStack,
    omega: Array,
    wired: NDArray[np.bool_] | None = None,
    loaded: NDArray[np.bool_] | None = None,
) -> dict[str, Receptance]:
    """Prepare the receptances of all bodies over their motions (`PointStack.moving`).

    Parameters
    ----------
    stack : PointStack
        Points of all bodies.
    omega : (f,) float64
        Circular frequencies in rad/s; the receptances are valid up to the highest.
    wired : (size,) bool, optional
        Motions of all points that joints, inputs or outputs use. The others have receptances of zero, without solves.
    loaded : (size,) bool, optional
        Motions of all points along which joints or inputs act; see `receptance`.

    Raises
    ------
    MatrixError
        At the resonance of a body without damping.
    """
    found = {}
    for name, sub in stack.substructures.items():
        moving = stack.moving(name)
        rows, here = dense(stack.motions(name)[moving]), stack.body_columns(name).start + moving
        if wired is not None:
            rows = rows * wired[here, None]
        found[name] = receptance(sub, omega, rows, None if loaded is None else loaded[here])
    return found


def couple(
    receptances: Mapping[str, Receptance], stack: PointStack, wirings: Sequence[Wiring], grids: Sequence[Array]
) -> list[Complex]:
    """Responses of the joined bodies, in several configurations, from the receptances of the single ones.

    Parameters
    ----------
    receptances : mapping of body to Receptance
        Dynamic flexibilities over the motions of each body, see `body_receptances`; they do not depend on the
        configuration.
    stack : PointStack
        Points of all bodies.
    wirings : sequence of Wiring
        Joints, inputs and outputs in each configuration.
    grids : sequence of (f_k,) float64
        Circular frequencies of each configuration in rad/s.

    Returns
    -------
    list of (f_k, outputs, inputs) complex128
        One for each configuration.

    Notes
    -----
    With lambda the joint forces, A Y (B u + A^T lambda) = 0. Rows of A that depend on others in the motions of the
    bodies are dropped. The receptances at a frequency of several grids are computed once, and all configurations with
    as many joint forces are solved together. Frequencies are processed in blocks, to save memory, and so are
    configurations whose blocks would hold few frequencies.

    Bodies in modes with many joint forces are represented by their modes near the band instead, see
    `residual_flexibility`; the joint forces of long chains are those of a band, see `joint_chain`.
    """
    columns = {name: stack.body_columns(name).start + stack.moving(name) for name in receptances}
    joined = [JoinedRows.of(wiring, stack) for wiring in wirings]
    found = [np.empty(0, dtype=np.complex128)] * len(joined)
    rest: list[int] = []
    coordinates = sum(sub.m for sub in stack.substructures.values())
    for k, (each, grid) in enumerate(zip(joined, grids, strict=True)):
        if each.c == coordinates:
            # Nothing can move; where constraints are nearly dependent, joint forces leave rounding.
            found[k] = np.zeros((grid.size, each.outputs, each.shape[1] - each.c), dtype=np.complex128)
            continue
        smooth = residual_flexibility(stack, each, grid)
        if smooth is not None:
            try:
                found[k] = smooth(grid)
                continue
            except np.linalg.LinAlgError:
                # A free motion at zero frequency, or a resonance without damping: receptances name the body.
                pass
        chain = joint_chain(each, columns)
        if chain is not None:
            found[k] = chain.response(receptances, grid)
        elif sees_much(each, receptances, columns):
            found[k] = by_loads(each, receptances, columns, grid)
        else:
            rest.append(k)
    for some in _together(rest, joined, grids):
        solved = _from_receptances(receptances, columns, [joined[k] for k in some], [grids[k] for k in some])
        for k, H in zip(some, solved, strict=True):
            found[k] = H
    return found


def _together(numbers: Sequence[int], joined: Sequence[JoinedRows], grids: Sequence[Array]) -> list[Sequence[int]]:
    """Numbers of configurations in groups that fit in one block; a group has a few of them in any case."""
    largest = max((16 * 3 * joined[k].shape[0] * joined[k].shape[1] * grids[k].size for k in numbers), default=1)
    count = max(_OF_SEVERAL, _OF_SEVERAL * _BLOCK_BYTES // max(largest, 1))
    return [numbers[at : at + count] for at in range(0, len(numbers), count)]


def _from_receptances(
    receptances: Mapping[str, Receptance],
    columns: Mapping[str, NDArray[np.int64]],
    joined: Sequence[JoinedRows],
    grids: Sequence[Array],
) -> list[Complex]:
    """Responses (f_k, outputs, inputs) of several configurations, by the forces in their joints."""
    every = np.unique(np.concatenate([np.empty(0), *grids]))
    places = [np.searchsorted(every, grid) for grid in grids]
    found = [
        np.empty((grid.size, each.outputs, each.shape[1] - each.c), dtype=np.complex128)
        for each, grid in zip(joined, grids, strict=True)
    ]
    # With many sensors the whole receptance of a body would be a square of them.
    direct = {
        name: of
        for name, of in receptances.items()
        if isinstance(of, ByRows)
        and of.has_fewer((each.left[:, columns[name]], each.right[:, columns[name]]) for each in joined)
    }
    entries = sum(place.size**2 for name, place in columns.items() if name not in direct)
    entries += 3 * sum(each.shape[0] * each.shape[1] for each in joined)
    for part in frequency_blocks(every.size, 16 * entries, _BLOCK_BYTES * min(len(joined), _OF_SEVERAL)):
        omega = every[part]
        whole = np.arange(omega.size)
        inside = [np.flatnonzero((place >= part.start) & (place < part.stop)) for place in places]
        local = [place[own] - part.start for place, own in zip(places, inside, strict=True)]
        G = [np.zeros((*each.shape, own.size), dtype=np.complex128) for each, own in zip(joined, inside, strict=True)]
        for name, receptance_of in receptances.items():
            here = columns[name]
            if name in direct:
                for each, at, into in zip(joined, local, G, strict=True):
                    direct[name].add(into, each.left[:, here], each.right[:, here], omega[at])
                continue
            Y = frequencies_last(receptance_of(omega))
            for each, at, into in zip(joined, local, G, strict=True):
                own_Y = Y if np.array_equal(at, whole) else np.ascontiguousarray(Y[..., at])
                add_between(into, each.left[:, here], own_Y, each.right[:, here])
        for same in _alike(joined):
            stacked = np.ascontiguousarray(np.concatenate([G[k] for k in same], axis=2).transpose(2, 0, 1))
            H = joined[same[0]].response(stacked, np.concatenate([omega[local[k]] for k in same]))
            for k, own_H in zip(same, np.split(H, np.cumsum([local[k].size for k in same])[:-1]), strict=True):
                found[k][inside[k]] = own_H
    return found


def _alike(joined: Sequence[JoinedRows]) -> list[list[int]]:
    """Numbers of the configurations whose flexibilities can be stacked."""
    groups: dict[tuple[object, ...], list[int]] = {}
    for number, each in enumerate(joined):
        groups.setdefault((each.shape, each.displacement, each.rate), []).append(number)
    return list(groups.values())


def rigid_response(system: System, omega: Array, *, nutation: bool = True) -> Complex:
    """Rigid-body part of a system's response (f, outputs, inputs), with the drag of dampers in joints or to ground.

    Parameters
    ----------
    system : System
    omega : (f,) float64
        Circular frequencies in rad/s.
    nutation : bool
        False: the nutations that wheels give to rigid bodies are damped critically. The response is the same far from
        them, and does not resonate where flexible bodies, which nutate at other frequencies, do not.
    """
    Pr = system.rigid
    gain = (system.C1 @ Pr)[None] + 1j * omega[:, None, None] * (system.C2 @ Pr)[None]
    load = Pr.T @ system.B
    drag = _drag(system)
    if not drag.any():
        return np.asarray(gain @ load / -(omega**2)[:, None, None])
    w = omega[:, None, None]
    if nutation:
        return np.asarray(gain @ np.linalg.solve(1j * w * drag - w**2 * np.eye(drag.shape[0]), load[None] + 0j))
    roots, V = np.linalg.eig(drag)
    s, size = 1j * omega[:, None], abs(roots)
    turns = abs(roots.imag) > _TURNS * size.max()
    # Over a pair of roots, (s + r*) / (s + |r|)^2 in place of 1 / (s + r), which is infinite at a nutation.
    slow = np.where(turns, size, roots)
    weight = np.where(turns, (s + roots.conj()) / (s + slow), 1.0) / (s * (s + slow))
    return np.asarray((gain @ V * weight[:, None]) @ np.linalg.solve(V, load + 0j))


def _drag(system: System) -> Array:
    """Damping of the rigid motions, without its round-off (R, R).

    Round-off is left out by directions among the rigid motions: by the columns of an arbitrary basis, a motion that one
    dashpot damps would lose the small part that it has in some of them.
    """
    Pr = system.rigid
    if system.D is None or not Pr.shape[1]:
        return np.zeros((0, 0))
    return np.asarray(sum(_acting(part, Pr) for part in damping_parts(system.D)))


def _acting(D: Matrix, Pr: Array) -> Array:
    forces = np.asarray(D @ Pr)
    _, _, directions = svd(forces, full_matrices=False)
    largest = abs(D.data if sp.issparse(D) else D).max(initial=0.0)
    size = float(largest) * abs(Pr @ directions.T).max(axis=0)
    damped = directions[abs(forces @ directions.T).max(axis=0) > DAMPED_RIGID * size].T
    own = damped @ damped.T
    return np.asarray(own @ (Pr.T @ forces) @ own)


def frequency_response(
    substructures: Mapping[str, Substructure], scene: Scene, configuration: Configuration, omega: Array
) -> Complex:
    """Frequency response of the assembled bodies in one configuration.

    Parameters
    ----------
    substructures : mapping of name to Substructure
        Bodies in the scene's units.
    scene : Scene
        Joints, actuators, sensors.
    configuration : Configuration
        Angles of the joints.
    omega : (f,) float64
        Circular frequencies in rad/s.

    Returns
    -------
    H : (f, outputs, inputs) complex128
    """
    stack = PointStack(with_joint_bodies(substructures, scene))
    held = held_bodies(stack, scene)
    wiring = held.wiring(wire(stack, scene, configuration))
    wired = np.asarray(np.vstack([wiring.A, wiring.B, wiring.C1, wiring.C2]).any(axis=0))
    return couple(body_receptances(held.stack, omega, wired), held.stack, [wiring], [omega])[0]
