"""Repeated and clustered modes."""

from __future__ import annotations

import numpy as np

from tests.frames import Section
from tests.hard.case import Case
from tests.hard.structures import bars, rigid_motions, rows, twin

__all__ = ["ten_appendages", "square_beam", "symmetric_frame"]

SQUARE = Section(Iy=1.333e-8, Iz=1.333e-8, J=2.25e-8)


def square_beam() -> Case:
    """Every bending mode comes twice."""
    body = bars("beam", np.linspace([0, 0, 0], [1.5, 0, 0], 13), [(k, k + 1) for k in range(1, 13)], SQUARE)
    face, rigid = rows(body, 1), rigid_motions(body)
    return Case(
        "repeated modes",
        "Square section: every bending mode is a pair, and any rotation within a pair is a mode.",
        "Modes are taken by frequency, never by number. A pair at the cutoff is kept complete, so the basis is one "
        "subspace for any vectors that the solver returns.",
        body,
        face,
        (5.0, 350.0),
        rigid,
        sensors=rows(body, 13, (1, 2, 3)),
        neighbour=twin(body, face, rigid),
    )


def symmetric_frame() -> Case:
    """Four equal legs around a post: a symmetry of order four."""
    corners = [[np.cos(a), np.sin(a), 0.0] for a in np.pi / 2 * np.arange(4)]
    feet = [[1.5 * x, 1.5 * y, -0.8] for x, y, _ in corners]
    xyz = np.array([[0, 0, 0], *corners, *feet, [0, 0, 0.7]])
    pairs = [(1, k) for k in (2, 3, 4, 5, 10)] + [(2, 3), (3, 4), (4, 5), (5, 2)] + [(k, k + 4) for k in (2, 3, 4, 5)]
    body = bars("frame", xyz, pairs, SQUARE)
    face, rigid = rows(body, (6, 7, 8, 9)), rigid_motions(body)
    return Case(
        "symmetric frame",
        "Fourfold symmetry on a redundant interface of 24 dofs: pairs and near coincidences, fixed and free.",
        "Pairs are taken by frequency and kept complete.",
        body,
        face,
        (1.0, 60.0),
        rigid,
        sensors=rows(body, 10, (1, 2, 3)),
        neighbour=twin(body, face, rigid),
    )


def ten_appendages() -> Case:
    """A stiff hub with ten equal whips, as the Galileo rotor has its cluster at 5.83 Hz."""
    angles = 2 * np.pi * np.arange(10) / 10
    hub = 0.4 * np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])
    out = [0.9 * hub + hub * s for s in (1.0, 2.2, 3.4)]
    xyz = np.vstack([[0, 0, 0], [0, 0, -0.5], hub, *out])
    stiff, whip = Section(A=8e-3, Iy=6e-6, Iz=6e-6, J=1e-5), Section(A=1e-4, Iy=1e-9, Iz=1e-9, J=2e-9)
    spokes = [(1, 2)] + [(1, k) for k in range(3, 13)] + [(k, 3 + (k - 2) % 10) for k in range(3, 13)]
    whips = [(k + 10 * s, k + 10 * s + 10) for k in range(3, 13) for s in range(3)]
    body = bars("rotor", xyz, spokes + whips, [stiff] * len(spokes) + [whip] * len(whips))
    face, rigid = rows(body, 2), rigid_motions(body)
    return Case(
        "ten equal appendages",
        "Ten equal whips on a stiff hub: fourteen modes lie within 0.01 % of 5.17 Hz, exact pairs among them.",
        "All modes below the cutoff are taken, in a large body after a Sturm count. A cluster is solved as a small "
        "pencil of its own.",
        body,
        face,
        (0.5, 20.0),
        rigid,
        sensors=rows(body, (33, 38), (1, 2, 3)),
        neighbour=twin(body, face, rigid),
    )
