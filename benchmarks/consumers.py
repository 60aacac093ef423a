"""Exudyn with files that cmsreduce wrote: the figures of benchmarks/consumers.md.

Needs the extra ``exudyn``. The slew of the full bodies takes some minutes.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
# The scenes live with the tests, which are not installed.
sys.path.insert(0, str(ROOT))

import exudyn  # noqa: E402
import scipy  # noqa: E402

from cmsreduce import __version__  # noqa: E402
from cmsreduce.model import ModalComponent  # noqa: E402
from tests.consumers.galileo import Galileo  # noqa: E402

BAND = 2 * np.pi * 10.0
RIGID = 7
SECONDS, STEP, TORQUE = 20.0, 0.01, 15.0
# Spectral radius of generalised alpha: damps the noise of joint forces within some steps, a mode at 1 Hz by 0.01 %.
RADIUS = 0.9
BOOM_TIP = 1306
QUANTITIES = ("stator rate x", "y", "z", "rotor rate x", "y", "z", "boom tip x", "y", "z")


def main() -> None:
    """Print every table."""
    print(f"cmsreduce {__version__}, Exudyn {exudyn.__version__}, numpy {np.__version__}, scipy {scipy.__version__}\n")
    with tempfile.TemporaryDirectory() as folder:
        pair = Galileo(Path(folder))
        frozen(pair)
        slews(pair)


def frozen(pair: Galileo) -> None:
    """Frequencies of the pair in Exudyn at each angle of the bearing."""
    print("| angle | 19 + 10, against cmsreduce | 74 + 10, against cmsreduce | 74 + 10, against full bodies, 0-10 Hz |")
    print("|---|---|---|---|")
    for setting in pair.settings:
        angle = pair.angle(setting)
        full = pair.omega(None, setting)
        cells = []
        for components in (pair.ranked, pair.reduced):
            scene, _, _ = pair.scene(components, angle)
            found = scene.frequencies()[RIGID:]
            cells.append(f"{abs(found / pair.omega(components, setting) - 1).max():.0e}")
        inside = (full < BAND).sum()
        cells.append(f"{abs(found[:inside] / full[:inside] - 1).max():.1e} ({inside} modes)")
        print(f"| {np.rad2deg(angle):.0f} deg | " + " | ".join(cells) + " |")
    print()


def slews(pair: Galileo) -> None:
    """Slew of the stator against the rotor by the motor of the bearing, from rest to rest."""
    # Nearly rigid bodies: their highest mode alone, at some 10 kHz.
    none = {name: part.truncated([part.omega.size - 1]) for name, part in pair.full.items()}
    runs = {
        "rigid": slew(pair, none),
        "19 + 10": slew(pair, pair.ranked),
        "19 + 10, half the step": slew(pair, pair.ranked, STEP / 2),
        "74 + 10": slew(pair, pair.reduced),
        "237 + 51, all": slew(pair, pair.full),
    }
    reference, _, turned = runs["237 + 51, all"]
    rigid = runs["rigid"][0]
    print(f"Turned by {np.rad2deg(turned):.1f} deg.\n")
    print("| modes, rotor + stator | s | " + " | ".join(QUANTITIES) + " |")
    print("|---|---|" + "---|" * len(QUANTITIES))
    print("| full: largest, rad/s and m | | " + " | ".join(f"{v:.2g}" for v in abs(reference).max(axis=0)) + " |")
    elastic = rms(reference - rigid)
    print("| full: rms of what is elastic | | " + " | ".join(f"{v:.2g}" for v in elastic) + " |")
    for name, (seen, seconds, _) in runs.items():
        if name != "rigid":
            errors = rms(seen - reference) / elastic
            print(f"| {name} | {seconds:.0f} | " + " | ".join(f"{error:.1e}" for error in errors) + " |")


def slew(
    pair: Galileo, components: Mapping[str, ModalComponent], step: float = STEP
) -> tuple[np.ndarray, float, float]:
    """Sensors at multiples of ``STEP`` (times, 9), seconds of the run, and largest angle of the bearing."""
    scene, stator, rotor = pair.scene(components, 0.0)

    def torque(t: float) -> float:
        return TORQUE * np.sin(2 * np.pi * t / SECONDS)

    scene.turn(rotor, lambda t: (0.0, 0.0, torque(t)))
    scene.turn(stator, lambda t: (0.0, 0.0, -torque(t)))
    sensors = [
        scene.watch_frame(stator, "AngularVelocityLocal"),
        scene.watch_frame(rotor, "AngularVelocityLocal"),
        scene.watch_point(rotor, pair.mesh_node("rotor", BOOM_TIP), "DisplacementLocal"),
    ]
    start = time.perf_counter()
    scene.move(SECONDS, round(SECONDS / step), RADIUS, modified=True)
    seconds = time.perf_counter() - start
    every = round(STEP / step)
    seen = np.hstack([scene.seen(sensor)[::every, 1:] for sensor in sensors])
    turned = np.cumsum(seen[:, 5] - seen[:, 2]) * STEP
    return seen, seconds, float(abs(turned).max())


def rms(values: np.ndarray) -> np.ndarray:
    """Root of the mean square over time."""
    return np.sqrt((values**2).mean(axis=0))


if __name__ == "__main__":
    main()
