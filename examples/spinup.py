"""Spin-up of a flexible beam: with the stiffness that stress gives, and without it, when the motion diverges.

python examples/spinup.py          # make example-spinup
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from curves import write_page

import cmsreduce as cms

ROOT = Path(__file__).parents[1]
TIP = 41


def main(folder: Path = ROOT / "build" / "example-spinup", seconds: float = 4.0) -> cms.Motion:
    """Reduce the beam twice, spin it up, print and draw."""
    pulse, pipeline = {"motor": cms.Pulse(1040.0, 3.0)}, ROOT / "examples" / "spinup.yaml"
    motion = cms.simulate(cms.run(pipeline, out=folder), seconds, efforts=pulse, points=100, accuracy=1e-3)
    beam = motion.system.bodies[motion.names.index("beam")]
    lag = 1e3 * (motion.modal["beam"] @ beam.markers[str(TIP)].translation[1])
    rate = motion.angular_velocity["beam"][:, 2]
    sys.stdout.write(
        f"{motion!r}\n"
        f"rate: {rate[-1]:.2f} rad/s; tip: {lag.min():.2f} mm behind at most, "
        f"{np.ptp(lag[-20:]):.3f} mm of swing at the end\n"
    )
    soft = cms.run(pipeline, out=folder / "soft", set={"components.beam.geometric_stiffness": None})
    try:
        cms.simulate(soft, seconds, efforts=pulse, points=100, accuracy=1e-3)
        sys.stdout.write("without geometric stiffness: no divergence\n")
    except cms.CmsReduceError as error:
        sys.stdout.write(f"without geometric stiffness: {error}\n")
    curves = {"rate, rad/s": {"axle": rate}, "tip, mm": {"across the beam": lag}}
    write_page(folder / "motion.html", "Spin-up of a flexible beam", motion.time, curves)
    sys.stdout.write(f"{folder / 'motion.html'}\n")
    return motion


if __name__ == "__main__":
    main()
