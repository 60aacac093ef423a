"""Slew of the Galileo spacecraft: the motor of the spin bearing turns rotor against stator by 20 degrees in 8 s.

Bodies are those of pipelines/galileo.yaml, 19 and 15 modes. The motor pushes both sides, so that the whole spacecraft
keeps its momentum of zero; the rotor's boom bends, and swings on after the slew.

    python examples/slew.py            # make example-slew
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from curves import write_page

import cmsreduce as cms

ROOT = Path(__file__).parents[1]
BOOM_TIP = 1306


def main(folder: Path = ROOT / "build" / "example-slew", seconds: float = 12.0) -> cms.Motion:
    """Reduce the bodies, slew, print and draw."""
    keys = {"verify": None, "write.all_nodes": True}
    run = cms.run(ROOT / "pipelines" / "galileo.yaml", out=folder, set=keys)
    slew = cms.Slew(np.radians(20), duration=2 * seconds / 3)
    motion = cms.simulate(run, seconds, efforts={"motor": slew}, points=80, accuracy=1e-3, method="implicit")
    angle, rotor = np.degrees(motion.joints["spin.rz"]), motion.system.bodies[motion.names.index("rotor")]
    bend = motion.modal["rotor"] @ rotor.markers[str(BOOM_TIP)].translation.T
    turned = np.degrees(motion.sensors["gyro.rz"])
    sys.stdout.write(
        f"{motion!r}\n"
        f"spin bearing: {angle[-1]:.3f} deg, stator: {turned[-1]:.3f} deg\n"
        f"boom tip: {np.linalg.norm(bend, axis=1).max():.4f} m of bending at most, "
        f"{np.ptp(bend[motion.time > slew.duration], axis=0).max():.4f} m of swing afterwards\n"
        f"{motion.seconds_per_second:.2f} s of computing for each second\n"
    )
    curves = {
        "angle, deg": {"spin bearing": angle, "platform about z": turned},
        "torque, N m": {"motor": motion.efforts["motor"]},
        "bending, m": {f"boom tip {axis}": values for axis, values in zip("xyz", bend.T, strict=True)},
    }
    write_page(folder / "motion.html", "Galileo: a slew by 20 degrees", motion.time, curves)
    sys.stdout.write(f"{folder / 'motion.html'}\n")
    return motion


if __name__ == "__main__":
    main()
