"""The arm of the study as plates, whose matrix may be of other panels than its deck."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from cmsreduce.model import cross_matrix
from tests.frames import BAR, beam_matrices
from tests.hard.corruptions.study import Study
from tests.plates import isotropic_laminate, plate_body

__all__ = ["plated"]

_ARM = "arm"
# Thickness of skin and rib, and the first plate of the rib.
_THICK, _RIB = (0.004, 0.008), 8
# Modes that the plates need for the limits of the study, in bands.
_CUTOFF = 60


def plated(
    stretch: Sequence[float] = (1.0, 1.0),
    bending: Sequence[float] = (1.0, 1.0),
    alone: float = 1.0,
    ratio: str = "",
    own: float = 0.0,
    side: float = 0.0,
) -> Callable[[Study], None]:
    """The arm as a skin and a rib below it: a matrix of so many times the stretch and bending of each.

    ``alone`` multiplies the bending of one plate of the rib; ``ratio`` is 12 I / t^3 on the cards of both. The mass is
    that of the deck. With ``own`` each plate has a thickness of its own in the deck, so many times that of the matrix.
    With ``side`` bars without mass are beside the lower edge of the rib, on that side in the matrix, and at y = 0.01 in
    the deck.
    """

    def change(study: Study) -> None:
        ends = [[0, 0, 0], [0.2, 0, 0], [0.4, 0, 0], [0.6, 0, 0], [0.8, 0, 0]]
        xyz = np.array([*ends, *([x, y, z] for y, z in ((-0.1, 0), (0.1, 0), (0, -0.1)) for x, _, _ in ends)])
        along = range(1, 5)
        cells = [[5 + k, 6 + k, k + 1, k] for k in along] + [[k, k + 1, 11 + k, 10 + k] for k in along]
        cells += [[15 + k, 16 + k, k + 1, k] for k in along]
        panel = np.arange(len(cells)) // _RIB

        def laminate(e: int) -> np.ndarray:
            share = bending[panel[e]] / stretch[panel[e]] * (alone if e == _RIB + 1 else 1.0)
            return isotropic_laminate(stretch[panel[e]] * BAR.E, 0.3, _THICK[panel[e]], bending=share)

        study.K[_ARM] = plate_body(_ARM, xyz, cells, laminate).K.toarray()
        panels = [
            plate_body(_ARM, xyz, cells[_RIB * k : _RIB * (k + 1)], laminate, per_area=BAR.rho * t).M
            for k, t in enumerate(_THICK)
        ]
        study.xyz[_ARM], study.M[_ARM] = xyz, sum(panels[1:], panels[0]).toarray()
        lines = [f"CQUAD4,{e},{1 + panel[e - 1]}," + ",".join(map(str, cell)) for e, cell in enumerate(cells, 1)]
        if own:
            lines = [f"{line}\n,,," + ",".join([f"{own * _THICK[panel[e]]}"] * 4) for e, line in enumerate(lines)]
        lines += [f"PSHELL,{k},1,{t},1,{ratio},1" for k, t in enumerate(_THICK, 1)]
        for k in along if side else ():
            study.K[_ARM] += _beside(xyz, 15 + k, side)
            lines += [f"CBAR,{50 + k},9,{15 + k},{16 + k},0.,1.,0.", ",,," + ",".join(["0.,.01,0."] * 2)]
        if side:
            lines += [f"PBAR,9,9,{BAR.A},{BAR.Iz},{BAR.Iy},{BAR.J}", f"MAT1,9,{BAR.E:.4e},{BAR.G:.4e}"]
        study.cards[_ARM] = "\n".join([*lines, f"MAT1,1,{BAR.E:.4e},,.3,{BAR.rho:.1f}"])
        study.keys["reduce"]["cutoff"] = _CUTOFF

    return change


def _beside(xyz: np.ndarray, first: int, side: float) -> np.ndarray:
    """Stiffness of a bar beside a node and the next one, by an offset along y."""
    found, offset, arm = np.zeros((6 * len(xyz),) * 2), np.array([0.0, side, 0.0]), np.eye(12)
    k, _ = beam_matrices(*(xyz[first - 1 : first + 1] + offset), BAR)
    for end in (0, 6):
        arm[end : end + 3, end + 3 : end + 6] = -cross_matrix(offset)
    rows = slice(6 * first - 6, 6 * first + 6)
    found[rows, rows] = arm.T @ k @ arm
    return found
