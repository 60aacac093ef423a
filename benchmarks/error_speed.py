"""Error and time of a Craig-Bampton reduction against the number of modes.

The solid bracket of `mode_sets.py` between its hub and its payload; the figures are for
benchmarks/performance.md.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks.meshes import Cells  # noqa: E402
from benchmarks.mode_sets import AS_BUILT, LOSS, bracket_case, direct_difference, reduced, reference, response  # noqa: E402
from benchmarks.performance_page import ERROR_SPEED, error_speed_table  # noqa: E402
from cmsreduce.assemble import assemble, body_points, modal_substructure, rigid_substructure, system_modes  # noqa: E402
from cmsreduce.linalg.eigen import rigid_body_modes  # noqa: E402
from cmsreduce.model import rigid_body_shapes  # noqa: E402
from cmsreduce.verify import db_error, decibel_grid, frequency_grid, frf_error  # noqa: E402

CUTOFFS = (1.0, 1.5, 2.0, 3.0, 4.0)
CELLS: Cells = (60, 16, 16)


def study(cells: Cells) -> dict[str, object]:
    """Errors of the scene's response over its band, and seconds, at each cutoff."""
    case = bracket_case(cells)
    body, band = case.body, case.scene.band
    assert body.nodes is not None
    R = rigid_body_shapes(body.dofs, body.nodes, body.nodes.xyz.mean(axis=0))
    rigid = rigid_body_modes(body.K, body.M, R, body.rounding, body.name)
    full = reference(case, rigid)
    points = body_points(case.scene, body)
    subs = {body.name: full, **{name: rigid_substructure(part) for name, part in case.rigid.items()}}
    w, _ = system_modes(assemble(subs, case.scene, AS_BUILT), 2 * np.pi * band[1])
    omega, grid = frequency_grid(band, 200, w, np.full(w.size, LOSS / 2)), decibel_grid(band)
    elastic, whole = response(case, full, omega)[1], response(case, full, grid)[0]
    row, column = np.ones(elastic.shape[1]), np.ones(elastic.shape[2])
    rows = []
    for cutoff in CUTOFFS:
        modes, seconds = reduced(case, "craig-bampton", cutoff, rigid)
        sub = modal_substructure(modes, points)
        rows.append(
            {
                "cutoff": cutoff,
                "columns": modes.basis_size,
                "frf_error": float(frf_error(omega, elastic, response(case, sub, omega)[1], row, column)),
                "db_error": float(db_error(whole, response(case, sub, grid)[0], row, column)),
                "seconds": seconds,
            }
        )
    what = (
        f"{case.title[0].upper()}{case.title[1:]}, tied at both ends to a rigid hub and a payload, loss factor "
        f"{LOSS:g}, 0 to {band[1]:g} Hz: forces on the hub to motion of the payload, whole scene. Seconds of the whole "
        "reduction by "
        "Craig-Bampton, certificate and orthonormal modes included. The reference differs from a direct solve by "
        f"{direct_difference(case, full, rigid):.0e}."
    )
    return {"what": what, "rows": rows}


if __name__ == "__main__":
    given = tuple(int(count) for count in sys.argv[1:])
    found = study((given[0], given[1], given[2]) if given else CELLS)
    ERROR_SPEED.parent.mkdir(parents=True, exist_ok=True)
    ERROR_SPEED.write_text(json.dumps(found, indent=1), encoding="utf-8")
    print("\n".join(error_speed_table()))
