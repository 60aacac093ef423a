"""Lines of input files of 42, and the files that are the same for every scene: free space, and nothing else to do."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from cmsreduce.write.files import number

__all__ = ["SURROUNDINGS", "heading", "plain", "row", "simulation_lines", "values", "vector"]


def values(*given: float | str | int) -> str:
    """Values in a row, floats with all digits."""
    return "  ".join(number(value) if isinstance(value, float) else str(value) for value in given)


def row(about: str, *given: float | str | int) -> str:
    """Values, and what they are: 42 reads the rest of a line as a comment of at most 119 characters."""
    return f"{values(*given)}  ! {about}"


def vector(about: str, given: Sequence[float] | NDArray[np.float64]) -> str:
    """Components of a vector, and what it is; zero has no sign."""
    return row(about, *(float(value) + 0.0 for value in given))


def heading(text: str) -> str:
    """Title of a section: 42 looks for the star at its beginning."""
    return f" {text} ".center(72, "*")


def plain(words: str, most: int) -> str:
    """Words without marks that 42 would take for its own, and not too long for it."""
    return re.sub(r"[^A-Za-z0-9_ .-]", "_", words)[:most]


def simulation_lines(name: str, seconds: float, step: float) -> Iterator[str]:
    """Inp_Sim.txt: end and step, the names of the other files, and no environment at all."""
    from cmsreduce import __version__

    yield f"42: scene of cmsreduce {__version__}, {plain(name, 40)}"
    yield heading("Simulation Control")
    yield row("Time Mode", "FAST")
    yield row("Sim Duration, Step Size [sec]", float(seconds), float(step))
    yield row("File Output Interval [sec]", float(step))
    yield row("RNG Seed", 0)
    yield row("Graphics Front End?", "FALSE")
    yield row("Command Script File Name", "Inp_Cmd.txt")
    yield heading("Reference Orbits")
    yield row("Number of Reference Orbits", 1)
    yield row("Input file name for Orb 0", "TRUE", "Orb_Far.txt")
    yield heading("Spacecraft")
    yield row("Number of Spacecraft", 1)
    yield row("Existence, RefOrb, Input file for SC 0", "TRUE", 0, "SC_Scene.txt")
    yield from _ENVIRONMENT


_ENVIRONMENT = (
    heading("Environment"),
    row("Date (UTC) (Month, Day, Year)", "01 01 2025"),
    row("Time (UTC) (Hr,Min,Sec)", "00 00 0.00"),
    row("Leap Seconds (sec)", 37.0),
    row("F10.7, Ap (USER, NOMINAL or TWOSIGMA)", "USER"),
    row("USER-provided F10.7", 230.0),
    row("USER-provided Ap", 100.0),
    row("Magfield (NONE,DIPOLE,IGRF)", "NONE"),
    row("IGRF Degree and Order", 2, 2),
    row("Earth Gravity Model N and M", 2, 0),
    row("Mars Gravity Model N and M", 2, 0),
    row("Luna Gravity Model N and M", 2, 0),
    row("Aerodynamic Forces & Torques (Shadows)", "FALSE", "FALSE"),
    row("Gravity Gradient Torques", "FALSE"),
    row("Solar Pressure Forces & Torques (Shadows)", "FALSE", "FALSE"),
    row("Residual Magnetic Moment Torques", "FALSE"),
    row("Gravity Perturbation Forces", "FALSE"),
    row("Thruster Plume Forces & Torques", "FALSE"),
    row("Contact Forces and Torques", "FALSE"),
    row("CFD Slosh Forces and Torques", "FALSE"),
    row("Albedo Effect on CSS Measurements", "FALSE"),
    row("Output Environmental Torques to Files", "FALSE"),
    heading("Celestial Bodies of Interest"),
    row("Ephem Option", "MEAN"),
    *(row(world, "TRUE" if world == "Earth" else "FALSE") for world in ("Mercury", "Venus", "Earth", "Mars")),
    *(row(world, "FALSE") for world in ("Jupiter", "Saturn", "Uranus", "Neptune", "Pluto", "Asteroids and Comets")),
    heading("Lagrange Point Systems of Interest"),
    *(row(system, "FALSE") for system in ("Earth-Moon", "Sun-Earth", "Sun-Jupiter")),
    heading("Ground Stations"),
    row("Number of Ground Stations", 0),
)

# So far from the Earth that its gravity changes nothing in a slew. 36 lines follow the type of the orbit.
_ORBIT = (
    "42: orbit of the scene",
    row("Description", "Far from the Earth"),
    row("Orbit Type (ZERO, FLIGHT, CENTRAL, THREE_BODY)", "CENTRAL"),
    heading("if ZERO"),
    row("World", "EARTH"),
    row("Use Polyhedron Gravity", "FALSE"),
    heading("if FLIGHT"),
    row("Region Number", 0),
    row("Use Polyhedron Gravity", "FALSE"),
    heading("if CENTRAL"),
    row("Orbit Center", "EARTH"),
    row("Secular Orbit Drift Due to J2", "FALSE"),
    row("Use Keplerian elements (KEP) or (RV) or FILE", "KEP"),
    row("Use Peri/Apoapsis (PA) or min alt/ecc (AE)", "PA"),
    row("Periapsis & Apoapsis Altitude, km", 1.0e6, 1.0e6),
    row("Min Altitude (km), Eccentricity", 1.0e6, 0.0),
    row("Inclination (deg)", 0.0),
    row("Right Ascension of Ascending Node (deg)", 0.0),
    row("Argument of Periapsis (deg)", 0.0),
    row("True Anomaly (deg)", 0.0),
    row("RV Initial Position (km)", 0.0, 0.0, 0.0),
    row("RV Initial Velocity (km/sec)", 0.0, 0.0, 0.0),
    row("TLE, TRV, or SPLINE file format", "TRV"),
    row("File name", '"NONE"'),
    row("Label to find in TLE or TRV file", '"NONE"'),
    heading("if THREE_BODY"),
    row("Lagrange system", "SUNEARTH"),
    row("Propagate using", "LAGDOF_MODES"),
    row("Initialize with MODES or XYZ or FILE", "MODES"),
    row("Libration point", "L2"),
    row("XY Semi-major axis, km", 0.0),
    row("Initial XY Phase, deg", 0.0),
    row("Sense", "CW"),
    row("Second XY Mode Semi-major Axis, km", 0.0),
    row("Second XY Mode Initial Phase, deg", 0.0),
    row("Sense", "CW"),
    row("Z Semi-axis, km", 0.0),
    row("Initial Z Phase, deg", 0.0),
    row("Initial X, Y, Z (Non-dimensional)", 0.0, 0.0, 0.0),
    row("Initial Xdot, Ydot, Zdot (Non-dimensional)", 0.0, 0.0, 0.0),
    row("Format, Label to find in file", "TRV", '"NONE"'),
    row("File name", '"NONE"'),
    heading("Formation Frame Parameters"),
    row("Formation Frame Fixed in [NL]", "N"),
    row("Euler Angles (deg) and Sequence", 0.0, 0.0, 0.0, 123),
    row("Formation Origin expressed in [NL]", "N"),
    row("Formation Origin wrt Ref Orbit (m)", 0.0, 0.0, 0.0),
)

SURROUNDINGS: dict[str, Sequence[str]] = {
    "Orb_Far.txt": _ORBIT,
    "Inp_Region.txt": ("42: regions", row("Number of Regions", 0)),
    "Inp_TDRS.txt": ("42: relay satellites", *(f'FALSE "TDRS-{k}"  ! Exists, Designation' for k in range(1, 11))),
    "Inp_IPC.txt": ("42: sockets", row("Number of Sockets", 0)),
    "Inp_AcOutput.txt": (
        "42: outputs of flight software",
        *(row("Enabled, Interval", "FALSE", 1.0e3) for _ in range(14)),
    ),
}
