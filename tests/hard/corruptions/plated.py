"""The arm of the study as plates, whose matrix may be of other panels than its deck."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from tests.frames import BAR
from tests.hard.corruptions.study import Study
from tests.plates import isotropic_laminate, plate_body

__all__ = ["plated"]

_ARM = "arm"
# Thickness of skin and rib, and the first plate of the rib.
_THICK, _RIB = (0.004, 0.008), 8
# Modes that the plates need for the limits of the study, in bands.
_CUTOFF = 60


def plated(
    stretch: Sequence[float] = (1.0, 1.0), bending: Sequence[float] = (1.0, 1.0), alone: float = 1.0, ratio: str = ""
) -> Callable[[Study], None]:
    """The arm as a skin and a rib below it: a matrix of so many times the stretch and bending of each.

    ``alone`` multiplies the bending of one plate of the rib; ``ratio`` is 12 I / t^3 on the cards of both. The mass is
    that of the deck.
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
        lines += [f"PSHELL,{k},1,{t},1,{ratio},1" for k, t in enumerate(_THICK, 1)]
        study.cards[_ARM] = "\n".join([*lines, f"MAT1,1,{BAR.E:.4e},,.3,{BAR.rho:.1f}"])
        study.keys["reduce"]["cutoff"] = _CUTOFF

    return change
