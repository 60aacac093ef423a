"""Make the Galileo sample: rotor and stator as NASTRAN decks with their matrices. See README.md.

``python sample_models/galileo/make.py`` writes rotor.bdf, rotor.op4, stator.bdf and stator.op4 beside itself.
"""

from __future__ import annotations

from pathlib import Path

import scipy.sparse as sp
from beam import Material, Section, box, round_to, tube
from pyyeti.nastran import op4
from structure import Structure

ALL, MOVE, NONE = "123456", "123", ""
AHEAD = (1.0, 0.0, 0.0)
ANTENNA_FRAME = 1

# Mass is where the concentrated masses put it: the panels and frames of the buses count as weightless.
MATERIALS = {
    "aluminium": Material(70e9, 27e9, 2700.0),
    "graphite": Material(110e9, 5e9, 1600.0),
    "glass fibre": Material(40e9, 4e9, 1900.0),
    "weightless": Material(70e9, 27e9, 0.0),
}
ROTOR_SECTIONS = {
    "core": tube(0.5, 0.02, "weightless"),
    "tower": tube(0.2, 0.002, "graphite"),
    "spoke": tube(0.1, 0.01, "weightless"),
    "rib": tube(0.0142, 0.0008, "graphite"),
    "mesh cord": Section(1.5e-10, 0.0, 0.0, 0.0, "weightless"),
    "magnetometer boom": Section(4e-5, 1e-8, 8e-9, 3e-8, "glass fibre"),
    "plasma wave antenna": tube(0.007, 0.0003, "graphite"),
    "generator boom": box(0.10, 0.08, 0.003, "aluminium"),
    "sunshade petal": Section(4e-5, 4.4e-10, 2e-8, 6e-10, "graphite"),
    "low gain antenna mast": tube(0.008, 0.0005, "graphite"),
    "plume shield strut": tube(0.01, 0.0006, "graphite"),
}
STATOR_SECTIONS = {
    "bearing cone": tube(0.45, 0.006, "aluminium"),
    "frame": tube(0.4, 0.02, "weightless"),
    "platform arm": tube(0.1, 0.003, "aluminium"),
    "relay antenna boom": tube(0.015, 0.001, "aluminium"),
    "dust detector boom": tube(0.01, 0.0005, "aluminium"),
}

# Deviation of each rib's tip mass from the mean, in thousandths: hardware is never identical, so the local
# modes of the antenna couple to its hub a little.
RIB_DEVIATIONS = (0.4, -1.1, 0.7, 1.3, -0.6, 0.2, -1.4, 0.9, -0.2, 1.1, -0.8, 0.5, -0.3, 1.0, -1.2, 0.1, 0.8, -1.3)


def rotor() -> Structure:
    """Spun section, 243 dofs; z is the spin axis, the bearing is grid 1001 at the origin."""
    body = Structure("Rotor of the Galileo sample", MATERIALS, ROTOR_SECTIONS, {ANTENNA_FRAME: (0.0, 0.0, 1.9)})
    _spun_bus(body)
    _high_gain_antenna(body)
    _magnetometer_boom(body)
    _generators(body)
    _small_appendages(body)
    return body


def stator() -> Structure:
    """Despun section, 57 dofs; the bearing is grid 2001 at the origin, the hinge of the scan platform grid 2010."""
    body = Structure("Stator of the Galileo sample", MATERIALS, STATOR_SECTIONS)
    _despun_bus(body)
    _platform_arm(body)
    _despun_booms(body)
    return body


def _spun_bus(body: Structure) -> None:
    """Bearing with its compliance, propulsion module and bus as one heavy grid, antenna tower."""
    for node, z in ((1001, 0.0), (1002, 0.0), (1003, 1.0), (1004, 1.9)):
        body.grid(node, (0.0, 0.0, z), ALL)
    body.springs_between(1001, 1002, (8e6, 8e6, 2e7, 6e4, 7e4, 4e5))
    body.bar(1002, 1003, "core", AHEAD)
    body.bar(1003, 1004, "tower", AHEAD)
    body.mass(1001, 40.0, (2.0, 2.0, 2.4))
    body.mass(1002, 60.0, (10.0, 10.0, 16.0))
    body.mass(1003, 2000.0, (1100.0, 1250.0, 1500.0))
    body.mass(1004, 40.0, (8.0, 8.0, 10.0))


def _high_gain_antenna(body: Structure) -> None:
    """Umbrella of 18 ribs whose tips are tied by the mesh; grids move along cylindrical axes."""
    for rib, deviation in enumerate(RIB_DEVIATIONS):
        root, angle = 1100 + 10 * rib, 20.0 * rib
        body.grid(root, (0.3, angle, 0.0), NONE, ANTENNA_FRAME)
        body.grid(root + 1, (1.3, angle, 0.25), MOVE, ANTENNA_FRAME)
        body.grid(root + 2, (2.3, angle, 0.75), MOVE, ANTENNA_FRAME)
        body.bar(1004, root, "spoke")
        body.bars_along((root, root + 1, root + 2), "rib")
        body.rod(root + 2, 1102 + 10 * ((rib + 1) % len(RIB_DEVIATIONS)), "mesh cord")
        body.mass(root + 1, 0.1)
        body.mass(root + 2, round_to(0.12 * (1 + 1e-3 * deviation), 6))


def _magnetometer_boom(body: Structure) -> None:
    """Eleven metres of coilable boom along x with two magnetometers, two whip antennas across its tip."""
    segments, length, root = 6, 10.3, 1.2
    for k in range(segments + 1):
        body.grid(1300 + k, (round_to(root + length * k / segments), 0.0, 0.7), MOVE if k else NONE)
    body.bar(1003, 1300, "spoke")
    body.bars_along(range(1300, 1301 + segments), "magnetometer boom")
    body.mass(1303, 0.8)
    body.mass(1306, 0.7)
    for whip, side in ((1311, -1.0), (1321, 1.0)):
        body.grid(whip, (11.5, 0.8 * side, 0.7), MOVE)
        body.grid(whip + 1, (11.5, 1.6 * side, 0.7), MOVE)
        body.bars_along((1306, whip, whip + 1), "plasma wave antenna")


def _generators(body: Structure) -> None:
    """Two booms with a radioisotope generator each, 120 degrees from the magnetometer boom."""
    for root, side in ((1400, 1.0), (1500, -1.0)):
        for k, dofs in enumerate((NONE, MOVE, MOVE, ALL)):
            reach = 1.1 + 0.9 * k
            body.grid(root + k, (round_to(-0.5 * reach), round_to(0.85 * side * reach), 0.7), dofs)
        body.bar(1003, root, "spoke")
        body.bars_along(range(root, root + 4), "generator boom")
        body.mass(root + 3, 58.0, (1.55, 1.55, 1.55))


def _small_appendages(body: Structure) -> None:
    """Sunshade of six petals, low gain antenna mast, two plume shields: light, local, of no consequence."""
    for petal in range(6):
        root, angle = 1600 + 10 * petal, 30.0 + 60.0 * petal
        for k, dofs in enumerate((NONE, MOVE, MOVE)):
            body.grid(root + k, (round_to(1.1 + 0.4 * k), angle, round_to(-0.5 - 0.1 * k)), dofs, ANTENNA_FRAME)
        body.bar(1003, root, "spoke")
        body.bars_along(range(root, root + 3), "sunshade petal")
        body.mass(root + 1, round_to(0.05 + 0.001 * petal))
    for k in range(4):
        body.grid(1700 + k, (0.0, round_to(-1.1 - 0.3 * k), 1.4), MOVE if k else NONE)
    body.bar(1003, 1700, "spoke")
    body.bars_along(range(1700, 1704), "low gain antenna mast")
    body.mass(1703, 0.05)
    for root, side in ((1800, 1.0), (1810, -1.0)):
        for k, x in enumerate((0.9, 1.2, 1.5)):
            body.grid(root + k, (x, side * x, 0.6), MOVE if k else NONE)
        body.bar(1003, root, "spoke")
        body.bars_along(range(root, root + 3), "plume shield strut")
        body.mass(root + 2, 0.1)


def _despun_bus(body: Structure) -> None:
    """Bearing cone, frame, atmospheric probe on its separation springs, electronics that balance the platform."""
    for node, z, dofs in ((2001, 0.0, ALL), (2002, -0.5, ALL), (2003, -1.1, NONE), (2004, -1.1, ALL)):
        body.grid(node, (0.0, 0.0, z), dofs)
    body.grid(2005, (-1.1, 0.0, -0.05), NONE)
    body.bar(2001, 2002, "bearing cone", AHEAD)
    body.bar(2002, 2003, "frame", AHEAD)
    body.bar(2002, 2005, "frame")
    body.springs_between(2003, 2004, (1.2e6, 1.4e6, 3.6e6, 3.5e5, 4.5e5, 4e5))
    body.mass(2001, 25.0, (2.0, 2.0, 3.0))
    body.mass(2002, 20.0, (8.0, 8.0, 12.0))
    body.mass(2004, 335.0, (50.0, 55.0, 60.0))
    body.mass(2005, 125.0, (16.0, 12.0, 18.0))


def _platform_arm(body: Structure) -> None:
    """Arm along x that carries the scan platform below the bearing's plane: the dynamic unbalance that couples."""
    body.grid(2010, (1.2, 0.0, -1.0), ALL)
    body.grid(2011, (0.4, 0.0, -0.7), MOVE)
    body.grid(2012, (0.8, 0.0, -0.9), MOVE)
    body.bars_along((2002, 2011, 2012, 2010), "platform arm")
    body.mass(2010, 8.0, (0.2, 0.2, 0.2))


def _despun_booms(body: Structure) -> None:
    """Relay antenna boom along -y, dust detector boom along -x."""
    for k, dofs in enumerate((NONE, MOVE, MOVE, MOVE, ALL)):
        body.grid(2020 + k, (-0.3, round_to(-0.3 - 0.4 * k), -0.4), dofs)
    for k, dofs in enumerate((NONE, MOVE, MOVE, MOVE, MOVE)):
        body.grid(2030 + k, (round_to(-0.3 - 0.3 * k), 0.2, -0.6), dofs)
    for root, section in ((2020, "relay antenna boom"), (2030, "dust detector boom")):
        body.bar(2002, root, "frame")
        body.bars_along(range(root, root + 5), section)
    body.mass(2024, 1.2, (0.02, 0.02, 0.04))
    body.mass(2034, 0.05)


def write(body: Structure, folder: Path, name: str) -> None:
    """Write the deck of a body and its matrices KAA and MAA, binary and double."""
    K, M = (sp.csc_matrix(X) for X in body.matrices())
    (folder / f"{name}.bdf").write_text(body.deck(), encoding="ascii")
    op4.write(str(folder / f"{name}.op4"), {"KAA": (K, 6), "MAA": (M, 6)}, endian="<", sparse="nonbigmat")


if __name__ == "__main__":
    here = Path(__file__).parent
    write(rotor(), here, "rotor")
    write(stator(), here, "stator")
