"""Small bodies for CalculiX as input decks: solids, shells, beams, and what joins them."""

import re
import subprocess
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

CUBE = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)]
CUBE_EDGES = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]
TETRAHEDRA = [(0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6), (0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6)]
TETRAHEDRON_EDGES = [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)]
WEDGE_EDGES = [(0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)]
TRIANGLES = [[0, 1, 2, 4, 5, 8], [0, 2, 3, 8, 6, 7]]
SQUARE = [(0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1), (1, 1)]
STEEL = "*MATERIAL, NAME=STEEL\n*ELASTIC\n2.1e11, 0.3\n*DENSITY\n7850.\n"
SECTIONS = {
    "M": "*MEMBRANE SECTION, ELSET={}, MATERIAL=STEEL\n0.002\n",
    "T": "*SOLID SECTION, ELSET={}, MATERIAL=STEEL\n1e-4\n",
    "C": "*SOLID SECTION, ELSET={}, MATERIAL=STEEL\n",
    "S": "*SHELL SECTION, ELSET={}, MATERIAL=STEEL\n0.01\n",
    "B": "*BEAM SECTION, ELSET={}, MATERIAL=STEEL, SECTION={}\n0.1, 1., 0.3\n",
}


def with_middles(corners, edges):
    return corners + [tuple((a + b) / 2 for a, b in zip(corners[i], corners[j], strict=True)) for i, j in edges]


def cells_of(kind):
    """Elements in a cube of two steps."""
    if kind in ("C3D4", "C3D10"):
        split = [[CUBE[i] for i in corners] for corners in TETRAHEDRA]
        return split if kind == "C3D4" else [with_middles(corners, TETRAHEDRON_EDGES) for corners in split]
    if kind in ("C3D6", "C3D15"):
        split = [[CUBE[i] for i in (*corners, *(k + 4 for k in corners))] for corners in ((0, 1, 2), (0, 2, 3))]
        return split if kind == "C3D6" else [with_middles(corners, WEDGE_EDGES) for corners in split]
    return [with_middles(CUBE, CUBE_EDGES) if kind.startswith("C3D20") else CUBE]


class Deck:
    """Nodes by their place and layer, elements by kind, and further keywords."""

    def __init__(self, section="RECT\n0.02, 0.03"):
        self.nodes, self.elements, self.keywords, self.section = {}, [], "", section

    def node(self, place, layer=0):
        key = (layer, *(round(float(x), 9) for x in place))
        return self.nodes.setdefault(key, len(self.nodes) + 1)

    def at(self, x, layer=None):
        """Nodes at a place along x."""
        return [n for key, n in self.nodes.items() if abs(key[1] - x) < 1e-9 and layer in (None, key[0])]

    def add(self, kind, places, layer=0):
        self.elements.append((kind, [self.node(place, layer) for place in places]))
        return len(self.elements)

    def solid(self, kind, cells, sides, origin=(0, 0, 0), layer=0):
        step = np.array(sides) / (2 * np.array(cells))
        for cell in np.ndindex(*cells):
            for places in cells_of(kind):
                self.add(kind, np.array(origin) + (2 * np.array(cell) + places) * step, layer)
        return self

    def plate(self, kind, cells, origin, u, v):
        origin, u, v = (np.array(part, dtype=float) for part in (origin, u, v))
        count = int(kind[1])
        corners = [each[:count] for each in TRIANGLES] if count in (3, 6) else [range(count)]
        for i, j in np.ndindex(*cells):
            at = [((2 * i + a) / (2 * cells[0]), (2 * j + b) / (2 * cells[1])) for a, b in SQUARE]
            for own in corners:
                self.add(kind, [origin + at[k][0] * u + at[k][1] * v for k in own])
        return self

    def beam(self, kind, count, place):
        """Beams along a curve of 0..1."""
        steps = (0, 0.5, 1) if kind.startswith("B32") else (0, 1)
        for i in range(count):
            self.add(kind, [place((i + step) / count) for step in steps])
        return self

    def nset(self, name, nodes):
        self.keywords += f"*NSET, NSET={name}\n" + "".join(f"{n},\n" for n in nodes)

    def text(self):
        lines = ["*NODE, NSET=ALL"]
        lines += [f"{n}, {x:.9g}, {y:.9g}, {z:.9g}" for (_, x, y, z), n in self.nodes.items()]
        for number, (kind, nodes) in enumerate(self.elements, start=1):
            # CalculiX reads at most sixteen entries a line.
            fields = [str(n) for n in (number, *nodes)]
            rows = [", ".join(fields[at : at + 11]) for at in range(0, len(fields), 11)]
            lines += [f"*ELEMENT, TYPE={kind}, ELSET=E{kind[0]}", ",\n".join(rows)]
        used = "".join(
            SECTIONS[letter].format(f"E{letter}", self.section)
            for letter in sorted({kind[0] for kind, _ in self.elements})
        )
        return "\n".join(lines) + "\n" + STEEL + used + self.keywords


def arc(t):
    return (0.5 * np.sin(t), 0.0, 0.5 * np.cos(t))


def bent(t):
    return (min(2 * t, 1.0), max(2 * t - 1, 0.0) * 0.5, 0.0)


def folded():
    return (
        Deck()
        .plate("S8R", (4, 2), (0, 0, 0), (1, 0, 0), (0, 0.3, 0))
        .plate("S8R", (4, 2), (0, 0, 0), (1, 0, 0), (0, 0, 0.3))
    )


def mixed():
    """A shell on the edge of a solid, and a beam at a corner of the shell."""
    deck = (
        Deck().solid("C3D20R", (2, 2, 1), (0.2, 0.2, 0.1)).plate("S8R", (4, 2), (0.2, 0, 0.1), (0.8, 0, 0), (0, 0.2, 0))
    )
    return deck.beam("B32R", 3, lambda t: (1, 0.2, 0.1 + 0.5 * t))


def rigid(kind, turns):
    """A rigid body at the end, with a node for its rotations or without."""
    deck = Deck().solid(kind, (4, 2, 2), (1, 0.1, 0.15))
    deck.nset("TIP", deck.at(1))
    lead = deck.node((1.1, 0.05, 0.075), layer=1)
    turn = f", ROT NODE={deck.node((3, 3, 3), layer=1)}" if turns else ""
    deck.keywords += f"*RIGID BODY, NSET=TIP, REF NODE={lead}{turn}\n"
    return deck


def halves(joint):
    """Two halves joined by equations, or two meshes that do not fit joined by a tie."""
    deck = Deck().solid("C3D8", (3, 2, 2), (0.5, 0.1, 0.15))
    near = len(deck.elements)
    deck.solid("C3D8", (3, 2, 2) if joint == "equation" else (3, 3, 3), (0.5, 0.1, 0.15), (0.5, 0, 0), layer=1)
    if joint == "equation":
        by_place = {key[1:]: n for key, n in deck.nodes.items() if key[0] == 0}
        for n in deck.at(0.5, layer=1):
            other = by_place[next(key for key, m in deck.nodes.items() if m == n)[1:]]
            deck.keywords += "".join(f"*EQUATION\n2\n{n}, {c}, 1., {other}, {c}, -1.\n" for c in (1, 2, 3))
        return deck
    here, there = set(deck.at(0.5, layer=0)), set(deck.at(0.5, layer=1))
    facing = [[k + 1 for k, (_, nodes) in enumerate(deck.elements) if set(nodes) & side] for side in (here, there)]
    assert max(facing[0]) <= near < min(facing[1])
    for name, elements, face in (("NEAR", facing[0], "S4"), ("FAR", facing[1], "S6")):
        deck.keywords += f"*SURFACE, NAME={name}\n" + "".join(f"{element}, {face}\n" for element in elements)
    deck.keywords += "*TIE, NAME=SEAM, POSITION TOLERANCE=0.01\nFAR, NEAR\n"
    return deck


def turned():
    """Results along axes of a cylinder at all nodes, and two rigid ends."""
    deck = Deck().solid("C3D8", (4, 2, 2), (1, 0.1, 0.15))
    deck.nset("EVERY", list(deck.nodes.values()))
    deck.keywords += "*TRANSFORM, NSET=EVERY, TYPE=C\n0., 0., 0., 0., 0., 1.\n"
    for name, x in (("LEFT", 0), ("RIGHT", 1)):
        deck.nset(name, deck.at(x, layer=0))
        lead, turn = deck.node((1.2 * x - 0.1, 0.05, 0.075), layer=1), deck.node((3 + x, 3, 3), layer=1)
        deck.keywords += f"*RIGID BODY, NSET={name}, REF NODE={lead}, ROT NODE={turn}\n"
    return deck


def weighted():
    """A mass on a node of a shell, which keeps the rows of that node, and a spring between two others."""
    deck = Deck().plate("S8R", (4, 2), (0, 0, 0), (1, 0, 0), (0, 0.4, 0))
    corner, near, far = (deck.node(place) for place in ((1, 0.4, 0), (0.5, 0, 0), (0.5, 0.4, 0)))
    deck.keywords += f"*ELEMENT, TYPE=MASS, ELSET=LUMP\n9001, {corner}\n*MASS, ELSET=LUMP\n0.7\n"
    deck.keywords += f"*ELEMENT, TYPE=SPRINGA, ELSET=TIES\n9002, {near}, {far}\n*SPRING, ELSET=TIES\n\n1.e5\n"
    return deck


def stiffened(kind):
    """A solid with a membrane on a side, or a truss across it: both are ties of their nodes."""
    deck = Deck().solid("C3D8", (4, 2, 2), (1, 0.1, 0.15))
    if kind == "T3D2":
        deck.add("T3D2", [(0, 0, 0), (1, 0.1, 0.15)])
    else:
        for i in range(4):
            deck.add(
                "M3D4", [(x, y, 0.15) for x, y in ((i / 4, 0), (i / 4 + 0.25, 0), (i / 4 + 0.25, 0.05), (i / 4, 0.05))]
            )
    return deck


BODIES = {
    "C3D4": lambda: Deck().solid("C3D4", (4, 2, 2), (1, 0.1, 0.15)),
    "C3D8I": lambda: Deck().solid("C3D8I", (4, 2, 2), (1, 0.1, 0.15)),
    "C3D8R": lambda: Deck().solid("C3D8R", (4, 2, 2), (1, 0.1, 0.15)),
    "C3D10": lambda: Deck().solid("C3D10", (3, 1, 1), (1, 0.1, 0.15)),
    "C3D6": lambda: Deck().solid("C3D6", (4, 1, 1), (1, 0.1, 0.15)),
    "C3D15": lambda: Deck().solid("C3D15", (3, 1, 1), (1, 0.1, 0.15)),
    "C3D20R": lambda: Deck().solid("C3D20R", (3, 2, 2), (1, 0.1, 0.15)),
    "S4": lambda: Deck().plate("S4", (6, 3), (0, 0, 0), (1, 0, 0), (0, 0.4, 0)),
    "S3": lambda: Deck().plate("S3", (5, 2), (0, 0, 0), (1, 0, 0), (0, 0.4, 0)),
    "S6": lambda: Deck().plate("S6", (4, 1), (0, 0, 0), (1, 0, 0), (0, 0.4, 0)),
    "S8R": lambda: Deck().plate("S8R", (4, 2), (0, 0, 0), (1, 0, 0), (0, 0.4, 0)),
    "folded S8R": folded,
    "B31": lambda: Deck().beam("B31", 10, arc),
    "B32R": lambda: Deck().beam("B32R", 5, arc),
    "pipe B32R": lambda: Deck("PIPE\n0.02, 0.003").beam("B32R", 5, arc),
    "box B32R": lambda: Deck("BOX\n0.03, 0.05, 0.003, 0.003, 0.004, 0.004").beam("B32R", 5, arc),
    "turned axes": turned,
    "S8R with mass and spring": weighted,
    "bent B32R": lambda: Deck().beam("B32R", 6, bent),
    "mixed": mixed,
    "rigid": lambda: rigid("C3D8", turns=True),
    "rigid C3D8I": lambda: rigid("C3D8I", turns=False),
    "equation": lambda: halves("equation"),
    "tie": lambda: halves("tie"),
}


def body(name, held):
    """Text of a body, held at x = 0 on request."""
    deck = BODIES[name]()
    if held:
        deck.nset("ROOT", deck.at(0))
        shells = all(kind[0] in "SB" for kind, _ in deck.elements)
        deck.keywords += f"*BOUNDARY\nROOT, 1, {6 if shells else 3}\n"
    return deck.text()


def solve(
    folder: Path, name: str, text: str, matrices: bool, modes: int = 12, output: str = "", preload: str = ""
) -> list[float]:
    """Run CalculiX; its frequencies in Hz, or none if it stores the matrices. A preload is a static step before."""
    step = "*FREQUENCY, SOLVER=MATRIXSTORAGE\n10\n" if matrices else f"*FREQUENCY\n{modes}\n*NODE FILE{output}\nU\n"
    perturbed = ", PERTURBATION" if preload else ""
    for file, content in _written(name, text + f"{preload}*STEP{perturbed}\n{step}*END STEP\n").items():
        (folder / file).write_bytes(content)
    if matrices:
        assert (folder / f"{name}.sti").is_file()
        return []
    table = (folder / f"{name}.dat").read_text().partition("P A R T I C I P A T I O N")[0]
    return [float(hertz) for _, hertz in re.findall(r"^\s+\d+\s+(\S+E\S+)\s+\S+\s+(\S+)\s+\S+\s*$", table, re.M)]


@cache
def _written(name: str, deck: str) -> dict[str, bytes]:
    """Files of a job of CalculiX in a folder of its own; several tests ask for the same."""
    with TemporaryDirectory() as folder:
        (Path(folder) / f"{name}.inp").write_text(deck)
        # CalculiX ends the storing of matrices with an error code of its own; what counts is what it wrote.
        subprocess.run(["ccx", name], cwd=folder, capture_output=True, timeout=120, check=False)
        return {path.name: path.read_bytes() for path in Path(folder).iterdir()}
