"""A closed loop: a four-bar linkage with a coupler that bends, driven by a pulse of torque on its crank.

python examples/linkage.py         # make example-linkage
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from curves import write_page

import cmsreduce as cms

ROOT = Path(__file__).parents[1]
MIDDLE = 21


def main(folder: Path = ROOT / "build" / "example-linkage", seconds: float = 1.5) -> cms.Motion:
    """Reduce the coupler, drive the loop, print and draw."""
    run = cms.run(ROOT / "examples" / "linkage.yaml", out=folder)
    pulse = cms.Pulse(20.0, 0.3)
    motion = cms.simulate(run, seconds, efforts={"motor": pulse}, points=150, accuracy=1e-3, method="implicit")
    crank, rocker = (np.degrees(motion.joints[name]) for name in ("a.rz", "d.rz"))
    coupler = motion.system.bodies[motion.names.index("coupler")]
    bend = motion.modal["coupler"] @ coupler.markers[str(MIDDLE)].translation.T
    gap = abs(motion.point("rocker", "d") - motion.point("frame", "d")).max()
    sys.stdout.write(
        f"{motion!r}\n"
        f"crank: {crank[-1]:.2f} deg, rocker: from {rocker.min():.2f} to {rocker.max():.2f} deg\n"
        f"middle of the coupler: {1e3 * np.linalg.norm(bend, axis=1).max():.3f} mm of bending at most\n"
        f"loop: closed to {gap:.1e} m; energy to {motion.imbalance:.1e} of the largest kinetic energy\n"
    )
    curves = {
        "angle, deg": {"crank": crank, "rocker": rocker},
        "bending, mm": {f"coupler {axis}": 1e3 * values for axis, values in zip("xyz", bend.T, strict=True)},
        "energy, J": {"kinetic": motion.energy[:, 0], "strain": motion.energy[:, 1], "work": motion.work},
    }
    write_page(folder / "motion.html", "Four-bar linkage with a flexible coupler", motion.time, curves)
    sys.stdout.write(f"{folder / 'motion.html'}\n")
    return motion


if __name__ == "__main__":
    main()
