"""The corruptions: what is done to a sound study, and how it is to be found.

A row without ``unseen`` has to be refused or to fail. ``unseen`` says why files of this kind cannot show it; the table
then gives the figures that a user compares.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from tests.frames import BAR, beam_matrices, frame, line
from tests.hard.corruptions.plated import plated
from tests.hard.corruptions.study import Study

__all__ = ["ROWS", "Row"]

Change = Callable[[Study], None]


@dataclass(frozen=True)
class Row:
    """One corruption of the study.

    Parameters
    ----------
    what : str
        What was done.
    finder : str
        What has to find it.
    change : callable
        Does it.
    deck : bool
        The decks state the bars; else the grids alone.
    unseen : str
        Why it cannot be seen; empty where it has to be found.
    """

    what: str
    finder: str
    change: Change
    deck: bool = False
    unseen: str = ""


def _swapped(n: int, pairs: list[tuple[int, int]]) -> np.ndarray:
    order = np.arange(n)
    for i, j in pairs:
        order[[i, j]] = order[[j, i]]
    return order


def _nodes(i: int, j: int) -> list[tuple[int, int]]:
    return [(6 * (i - 1) + k, 6 * (j - 1) + k) for k in range(6)]


def _reordered(letters: str, body: str, order: Callable[[int], np.ndarray]) -> Change:
    def change(study: Study) -> None:
        for letter in letters:
            matrices = getattr(study, letter)
            to = order(len(matrices[body]))
            matrices[body] = matrices[body][np.ix_(to, to)]

    return change


def _by_component(n: int) -> np.ndarray:
    return np.arange(n).reshape(-1, 6).T.ravel()


def _reversed_nodes(n: int) -> np.ndarray:
    return np.arange(n).reshape(-1, 6)[::-1].ravel()


def _shuffled(n: int) -> np.ndarray:
    return np.random.default_rng(0).permutation(n)


def _scaled(letter: str, factor: float, body: str = "arm") -> Change:
    def change(study: Study) -> None:
        getattr(study, letter)[body] = factor * getattr(study, letter)[body]

    return change


def _put(letter: str, body: str, make: Callable[[np.ndarray], np.ndarray]) -> Change:
    def change(study: Study) -> None:
        getattr(study, letter)[body] = make(getattr(study, letter)[body].copy())

    return change


def _entry(i: int, j: int, value: Callable[[float], float], *, both: bool = True) -> Callable[[np.ndarray], np.ndarray]:
    def make(A: np.ndarray) -> np.ndarray:
        new = value(float(A[i, j]))
        A[i, j] = new
        if both:
            A[j, i] = new
        return A

    return make


def _keys(*path_and_value: Any) -> Change:
    """Set a key of the pipeline; the value None takes it out."""
    *path, value = path_and_value

    def change(study: Study) -> None:
        at = study.keys
        for key in path[:-1]:
            at = at[key]
        if value is None:
            at.pop(path[-1])
        else:
            at[path[-1]] = value

    return change


def _damped(make: Callable[[Study], np.ndarray]) -> Change:
    def change(study: Study) -> None:
        study.damped(make(study))

    return change


def _grids(body: str, make: Callable[[np.ndarray], np.ndarray]) -> Change:
    def change(study: Study) -> None:
        study.xyz[body] = make(study.xyz[body].copy())

    return change


def _files(act: Callable[[Path], None]) -> Change:
    def change(study: Study) -> None:
        study.after.append(act)

    return change


def _both(*changes: Change) -> Change:
    def change(study: Study) -> None:
        for each in changes:
            each(study)

    return change


def _truncate(name: str) -> Change:
    def act(folder: Path) -> None:
        content = (folder / name).read_bytes()
        (folder / name).write_bytes(content[: len(content) // 2])

    return _files(act)


def _bad_mode(study: Study) -> np.ndarray:
    """Damping beta K less some of the first elastic mode: the diagonal stays positive."""
    import scipy.linalg as la

    K, M = study.K["arm"], study.M["arm"]
    w, X = la.eigh(K, M)
    x = M @ X[:, 6]
    return 1e-5 * K - 1e-5 * w[6] * 2.5 * np.outer(x, x)


def _ground(value: float, i: int = 14) -> Callable[[np.ndarray], np.ndarray]:
    return _entry(i, i, lambda old: old + value)


def _digits(count: int) -> Callable[[np.ndarray], np.ndarray]:
    def make(A: np.ndarray) -> np.ndarray:
        return np.array([[float(f"{v:.{count - 1}e}") for v in row] for row in A])

    return make


def _turned_node(A: np.ndarray, node: int = 3) -> np.ndarray:
    """The matrix in a displacement frame of one node, turned by 90 degrees about z."""
    T = np.eye(len(A))
    R = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    for part in (6 * node - 6, 6 * node - 3):
        T[part : part + 3, part : part + 3] = R
    return T @ A @ T.T


def _doubled(study: Study) -> None:
    """A node twice, the bars of one side on the copy: the mesh was not merged."""
    for matrices in (study.K, study.M):
        A = matrices["panel"]
        n = len(A)
        new = np.zeros((n + 6, n + 6))
        new[:n, :n] = A
        # The part between nodes 3 and 6 hangs on the copy of node 3.
        far, near, copy = slice(30, 36), slice(12, 18), slice(n, n + 6)
        own = A[near, far]
        new[near, far], new[far, near] = 0.0, 0.0
        new[copy, far], new[far, copy] = own, own.T
        half = A[far, far]
        new[copy, copy] = np.abs(np.diag(np.diag(half)))
        matrices["panel"] = new
    study.xyz["panel"] = np.vstack([study.xyz["panel"], study.xyz["panel"][2]])


def _without_lump(M: np.ndarray) -> np.ndarray:
    """The arm's mass without the lump at its third node."""
    M[range(12, 15), range(12, 15)] -= 0.3
    return M


def _lumped(M: np.ndarray) -> np.ndarray:
    """Translations by sums of rows, rotations by a small inertia."""
    n = len(M)
    x = np.tile([1.0, 0, 0, 0, 0, 0], n // 6)
    return np.diag(np.kron((M @ x).reshape(-1, 6)[:, 0], [1, 1, 1, 1e-3, 1e-3, 1e-3]))


def _moved_lump(M: np.ndarray) -> np.ndarray:
    """The arm's lump at its fourth node."""
    M = _without_lump(M)
    M[range(18, 21), range(18, 21)] += 0.3
    return M


def _longer(study: Study) -> None:
    study.M["arm"] = line("arm", [0, 0, 0], [0.816, 0, 0], 4, masses={3: 0.3}).M.toarray()


def _without_bar(study: Study) -> None:
    """No bar between the second node and the third of the arm."""
    k, _ = beam_matrices(study.xyz["arm"][1], study.xyz["arm"][2], BAR)
    study.K["arm"][6:18, 6:18] -= k


def _other_section(**changes: float) -> Callable[[Study], None]:
    """Stiffness of the arm with another section than that of the deck."""

    def change(study: Study) -> None:
        places = study.xyz[ARM].tolist()
        study.K[ARM] = frame(ARM, places, [(1, 2), (2, 3), (3, 4), (4, 5)], section=replace(BAR, **changes)).K.toarray()

    return change


def _stiffer_bar(study: Study) -> None:
    """Two more of the bar between the first two nodes of the arm."""
    k, _ = beam_matrices(study.xyz["arm"][0], study.xyz["arm"][1], BAR)
    study.K["arm"][:12, :12] += 2 * k


ARM, PANEL = "arm", "panel"
GROUND = "rigid motions, or the row order: K resists a rigid motion"
PATTERN = "mass: pairs of nodes coupled in M and in K"
DECK = "the deck's materials, sections and masses"
NO_DECK = "matrices and grids are those of a sound body of another material"


def _offset_beam(study: Study) -> None:
    """The last bar of the arm is a beam with an offset of its neutral axis in the deck, which no comparison reads."""

    def edit(folder: Path) -> None:
        deck = folder / f"{ARM}.bdf"
        beam = f"PBEAM,8,1,{BAR.A},{BAR.Iz},{BAR.Iy},,{BAR.J}\n,,,,,,,,\n,0.,0.\n,,,,,.01,.01\n"
        deck.write_text(deck.read_text().replace("CBAR,4,1,", "CBEAM,4,8,").replace("ENDDATA", f"{beam}ENDDATA"))

    study.after.append(edit)


def _bush(rate: float, stated: float) -> Change:
    """A bush along the arm from node 2 to node 4, with another rate in the deck."""

    def change(study: Study) -> None:
        rows = np.ix_([6, 18], [6, 18])
        study.K[ARM][rows] += rate * np.array([[1, -1], [-1, 1]])
        card = f"CBUSH,50,50,2,4,0.,1.,0.\nPBUSH,50,K,{stated}\n"
        deck = Path(f"{ARM}.bdf")
        study.after.append(lambda folder: _into_deck(folder / deck, card))

    return change


def _into_deck(deck: Path, cards: str) -> None:
    deck.write_text(deck.read_text().replace("ENDDATA", f"{cards}ENDDATA"))


def _stress(study: Study) -> np.ndarray:
    """Stiffness of the arm's bars across themselves by a tension of 100 N."""
    found, xyz = np.zeros_like(study.K[ARM]), study.xyz[ARM]
    for k in range(len(xyz) - 1):
        along = xyz[k + 1] - xyz[k]
        length = float(np.linalg.norm(along))
        across = 100 / length * (np.eye(3) - np.outer(along, along) / length**2)
        for i, j, sign in ((k, k, 1), (k + 1, k + 1, 1), (k, k + 1, -1), (k + 1, k, -1)):
            found[6 * i : 6 * i + 3, 6 * j : 6 * j + 3] += sign * across
    return found


def _parameter(letter: str, matrix: Callable[[Study], np.ndarray]) -> Change:
    """A parameter from 0 to 1 that adds a matrix to one of the arm."""

    def change(study: Study) -> None:
        A = sp.csc_array(matrix(study))
        study.keys["scene"]["parameters"] = {"p": {"values": [0, 1], letter: {ARM: "P.npz"}}}
        study.after.append(lambda folder: sp.save_npz(folder / "P.npz", A))

    return change


ROWS: tuple[Row, ...] = (
    # Rows and columns.
    Row("two nodes exchanged in K", "row order", _reordered("K", ARM, lambda n: _swapped(n, _nodes(2, 4)))),
    Row("two nodes exchanged in M", PATTERN, _reordered("M", PANEL, lambda n: _swapped(n, _nodes(2, 5)))),
    Row("two nodes exchanged in K and M", "row order", _reordered("KM", ARM, lambda n: _swapped(n, _nodes(2, 4)))),
    Row("x and y of a node exchanged in K", "row order", _reordered("K", ARM, lambda n: _swapped(n, [(12, 13)]))),
    Row("x and y of a node exchanged in M", "mass", _reordered("M", ARM, lambda n: _swapped(n, [(12, 13)]))),
    Row(
        "x and rx of a node exchanged in K and M", "row order", _reordered("KM", ARM, lambda n: _swapped(n, [(12, 15)]))
    ),
    Row("rx and ry of a node exchanged in M", "mass", _reordered("M", ARM, lambda n: _swapped(n, [(15, 16)]))),
    Row("K by components, M by nodes", "row order", _reordered("K", PANEL, _by_component)),
    Row("M by components, K by nodes", PATTERN, _reordered("M", PANEL, _by_component)),
    Row("both by components", "row order", _reordered("KM", PANEL, _by_component)),
    Row("all nodes of K in reverse", "row order", _reordered("K", PANEL, _reversed_nodes)),
    Row("all nodes of M in reverse", PATTERN, _reordered("M", PANEL, _reversed_nodes)),
    Row(
        "all nodes of M in reverse, straight even body",
        "mass",
        _reordered("M", ARM, _reversed_nodes),
        deck=True,
        unseen="each node has its mass; the verdict names the mass as unproven",
    ),
    Row(
        "rotations of M of the other sign",
        "mass",
        _put("M", ARM, lambda A: A * np.outer(*[np.tile([1, 1, 1, -1, -1, -1], 5)] * 2)),
        deck=True,
        unseen="the same momentum of the body; the verdict names the mass as unproven",
    ),
    Row(
        "rotations of M in degrees",
        "mass",
        _put("M", ARM, lambda A: A * np.outer(*[np.tile([1, 1, 1, *[np.pi / 180] * 3], 5)] * 2)),
        deck=True,
        unseen="a mass between lumped and consistent, as programs make it; compare the first frequency",
    ),
    Row("rows of K shuffled", "row order", _reordered("K", ARM, _shuffled)),
    Row("rows of M shuffled", "mass", _reordered("M", ARM, _shuffled)),
    Row("rows of both shuffled", "row order", _reordered("KM", ARM, _shuffled)),
    Row(
        "rows of both shuffled, body said to be grounded",
        "row order",
        _both(_reordered("KM", ARM, _shuffled), _keys("components", ARM, "grounded", True)),
    ),
    Row("floating body said to be grounded", "rigid motions", _keys("components", ARM, "grounded", True)),
    Row("rows of D shuffled", "damping", _damped(lambda s: 1e-5 * s.K[ARM][np.ix_(_shuffled(30), _shuffled(30))])),
    Row(
        "two nodes exchanged in D",
        "damping",
        _damped(lambda s: 1e-5 * s.K[ARM][np.ix_(*[_swapped(30, _nodes(2, 4))] * 2)]),
    ),
    # Files in the wrong place.
    Row(
        "K and M exchanged",
        "row order",
        _both(_keys("components", ARM, "stiffness", "arm_M.npz"), _keys("components", ARM, "mass", "arm_K.npz")),
    ),
    Row("the mass file given twice", "row order", _keys("components", ARM, "stiffness", "arm_M.npz")),
    Row("the stiffness file given twice", "mass", _keys("components", ARM, "mass", "arm_K.npz")),
    Row("the mass of the other body", "sizes", _keys("components", ARM, "mass", "panel_M.npz")),
    Row("the geometry of the other body", "sizes", _keys("components", ARM, "geometry", "panel.bdf")),
    Row("K as damping matrix", "damping", _damped(lambda s: s.K[ARM])),
    Row("M as damping matrix", "damping", _damped(lambda s: s.M[ARM])),
    # Units.
    Row("coordinates in mm, matrices in m", "row order", _grids(ARM, lambda x: 1000 * x)),
    Row("coordinates in inches", "row order", _grids(ARM, lambda x: x / 0.0254)),
    Row("units of the body said to be mm, t", "joints: interfaces apart", _keys("components", ARM, "units", "mm-t-s")),
    Row("K x 1000, deck", DECK, _scaled("K", 1000.0), deck=True),
    Row("K x 1000, grids alone", DECK, _scaled("K", 1000.0), unseen=NO_DECK),
    Row("K x 1000, deck with a beam that is not counted", DECK, _both(_scaled("K", 1000.0), _offset_beam), deck=True),
    Row("rate of a bush a hundred times, deck", DECK, _bush(1e8, 1e6), deck=True),
    Row("K / 1000, deck", DECK, _scaled("K", 1e-3), deck=True),
    Row("K x 25.4, deck", DECK, _scaled("K", 25.4), deck=True),
    Row("M x 1000, deck", DECK, _scaled("M", 1000.0), deck=True),
    Row("M x 1000, grids alone", DECK, _scaled("M", 1000.0), unseen=NO_DECK),
    Row("weight for mass (M x 9.81), deck", DECK, _scaled("M", 9.81), deck=True),
    Row("weight for mass (M x 9.81), grids alone", DECK, _scaled("M", 9.81), unseen=NO_DECK),
    Row("M in lbf s^2/in read as kg, deck", DECK, _scaled("M", 1 / 175.1268), deck=True),
    Row("K and M x 1000, deck", DECK, _both(_scaled("K", 1e3), _scaled("M", 1e3)), deck=True),
    Row("K of another material (steel for aluminium), deck", DECK, _scaled("K", 3.0), deck=True),
    Row("K of another material, grids alone", DECK, _scaled("K", 3.0), unseen=NO_DECK),
    Row("elements of the middle of K left out, deck", DECK, _without_bar, deck=True),
    Row(
        "elements of the middle of K left out, grids alone",
        DECK,
        _without_bar,
        unseen="hinges inside a body look so; a note counts the motions without energy",
    ),
    Row("a lumped mass on the next node, deck", DECK, _put("M", ARM, _moved_lump), deck=True),
    Row("a lumped mass on the next node, grids alone", DECK, _put("M", ARM, _moved_lump), unseen=NO_DECK),
    Row("M of a mesh 2 % longer, deck", DECK, _longer, deck=True),
    Row("M of a mesh 2 % longer, grids alone", DECK, _longer, unseen=NO_DECK),
    Row("a lumped mass of 0.3 left out, deck", DECK, _put("M", ARM, _without_lump), deck=True),
    Row("a lumped mass of 0.3 left out, grids alone", DECK, _put("M", ARM, _without_lump), unseen=NO_DECK),
    Row("one bar three times as stiff, deck", DECK, _stiffer_bar, deck=True),
    Row("one bar three times as stiff, grids alone", DECK, _stiffer_bar, unseen=NO_DECK),
    Row("torsion constant of the bars eight times, deck", DECK, _other_section(J=8 * BAR.J), deck=True),
    Row("torsion constant of the bars eight times, grids alone", DECK, _other_section(J=8 * BAR.J), unseen=NO_DECK),
    Row("planes of bending exchanged, deck", DECK, _other_section(Iy=BAR.Iz, Iz=BAR.Iy), deck=True),
    Row("bending of a panel of plates four times, deck", DECK, plated(bending=(1.0, 4.0))),
    Row("thickness of two panels exchanged in bending, deck", DECK, plated(bending=(8.0, 1 / 8))),
    Row("bending of one plate twice, deck", DECK, plated(alone=2.0)),
    Row("12 I / t^3 of all plates 1.5 in the deck alone", DECK, plated(ratio="1.5")),
    Row("thickness of each plate 2 % more on its own card", DECK, plated(own=1.02)),
    Row("bars on the other side of a rib of plates, deck", DECK, plated(side=-0.01)),
    Row("materials of two panels exchanged, deck", DECK, plated(stretch=(1.5, 1 / 1.5), bending=(1.5, 1 / 1.5))),
    Row(
        "two nodes exchanged in a lumped M, deck",
        DECK,
        _both(_put("M", ARM, _lumped), _reordered("M", ARM, lambda n: _swapped(n, _nodes(1, 2)))),
        deck=True,
    ),
    Row(
        "two nodes exchanged in a lumped M, grids alone",
        "mass",
        _both(_put("M", ARM, _lumped), _reordered("M", ARM, lambda n: _swapped(n, _nodes(1, 2)))),
        unseen="a diagonal mass of a node may be anywhere; the centre of mass moves",
    ),
    Row(
        "damping of 10 % for 1 %",
        "",
        _keys("components", ARM, "damping", {"modal": 0.1}),
        unseen="a damping that a body can have; compare the peaks",
    ),
    # Digits and entries.
    Row("K with 3 digits", "row order", _put("K", ARM, _digits(3))),
    Row("M with 2 digits", "mass: the same along x, y, z", _put("M", ARM, _digits(2))),
    Row("sign of one entry of K", "row order", _put("K", ARM, _entry(13, 19, lambda v: -v))),
    Row("sign of one diagonal entry of K", "row order", _put("K", ARM, _entry(14, 14, lambda v: -v))),
    Row("sign of one diagonal entry of M", "mass", _put("M", ARM, _entry(14, 14, lambda v: -v))),
    Row("sign of K", "negative energy", _scaled("K", -1.0)),
    Row("sign of M", "mass", _scaled("M", -1.0)),
    Row(
        "one entry of K changed on one side", "symmetry", _put("K", ARM, _entry(13, 19, lambda v: 1.01 * v, both=False))
    ),
    Row(
        "one entry of M changed on one side", "symmetry", _put("M", ARM, _entry(13, 19, lambda v: 1.01 * v, both=False))
    ),
    Row("lower triangle of K only", "symmetry", _put("K", ARM, np.tril)),
    Row("lower triangle of M only", "symmetry", _put("M", ARM, np.tril)),
    Row("one entry of K lost", "row order", _put("K", ARM, _entry(13, 19, lambda v: 0.0))),
    Row("NaN in K", "finite entries", _put("K", ARM, _entry(13, 13, lambda v: float("nan")))),
    Row("infinite entry in M", "finite entries", _put("M", ARM, _entry(13, 13, lambda v: float("inf")))),
    Row("a row of M without entries", "mass", _put("M", ARM, lambda A: A * np.outer(*[np.arange(30) != 14] * 2))),
    Row("a zero matrix for K", "rigid motions", _scaled("K", 0.0)),
    Row("a zero matrix for M", "mass", _scaled("M", 0.0)),
    # Supports and connections.
    Row("spring to ground at a node", GROUND, _put("K", ARM, _ground(1e3))),
    Row("soft spring to ground", GROUND, _put("K", ARM, _ground(1.0))),
    Row("node held by a penalty of 1e12", GROUND, _put("K", ARM, _ground(1e12))),
    Row(
        "dashpot to ground",
        "damping: drag on a rigid motion",
        _damped(lambda s: 1e-5 * s.K[ARM] + np.diag(np.arange(30) == 14) * 5.0),
    ),
    Row("negative damping of one mode", "damping", _damped(_bad_mode)),
    Row("negative damping matrix", "damping", _damped(lambda s: -1e-5 * s.K[ARM])),
    Row("damping matrix not symmetric", "damping", _damped(lambda s: 1e-5 * np.tril(s.K[ARM]))),
    Row("modal damping of 500 % for 5 %", "damping", _keys("components", ARM, "damping", {"modal": 5})),
    Row("negative modal damping", "grammar", _keys("components", ARM, "damping", {"modal": -0.01})),
    Row("a node twice, mesh not merged", "parts or rows", _doubled),
    Row(
        "half a mesh: rows of two nodes lost",
        "sizes",
        _both(*(_put(letter, ARM, lambda A: A[:18, :18]) for letter in "KM")),
    ),
    Row(
        "a node of the deck moved by 10 %",
        "row order",
        _grids(PANEL, lambda x: x * np.where(np.arange(6) == 4, 1.1, 1)[:, None]),
    ),
    Row("coordinates rounded to 2 digits", "row order", _grids(PANEL, lambda x: np.round(x, 1))),
    Row("coordinates mirrored", "row order", _grids(PANEL, lambda x: x * [1, -1, 1])),
    Row(
        "displacement frame of a node not in the deck",
        "row order",
        _both(_put("K", ARM, _turned_node), _put("M", ARM, _turned_node)),
    ),
    Row("displacement frame in K alone", "row order", _put("K", ARM, _turned_node)),
    Row("displacement frame in M alone", "mass", _put("M", PANEL, _turned_node)),
    # The scene.
    Row(
        "wrong interface node",
        "joints: interfaces apart",
        _keys("components", PANEL, "interfaces", "root", {"node": 2}),
    ),
    Row(
        "interface node that does not exist",
        "interface",
        _keys("components", PANEL, "interfaces", "root", {"node": 77}),
    ),
    Row("interface of another body", "scene", _keys("scene", "joints", "hinge", "connect", ["arm.tip", "panel.tip"])),
    Row("joint left out", "scene: joined to nothing", _keys("scene", "joints", "weld", None)),
    Row(
        "hinge about another axis",
        "",
        _both(_keys("scene", "joints", "hinge", "free", ["rz"]), _keys("scene", "actuators", "motor", "dof", "rz")),
        unseen="the scene is another sound scene; compare the picture",
    ),
    Row("angle without a unit", "grammar", _keys("scene", "articulation", {"hinge": [0, 50]})),
    Row("stress of a parameter given as mass", "parameters", _parameter("mass", _stress)),
    Row("stiffness as damping of a parameter", "parameters", _parameter("damping", lambda study: study.K[ARM])),
    Row("mass of a parameter of the other sign", "parameters", _parameter("mass", lambda study: -3 * study.M[ARM])),
    Row(
        "stiffness with a parameter for the difference",
        "parameters",
        _parameter("stiffness", lambda study: study.K[ARM] + _stress(study)),
        unseen="a body may be twice as stiff with a parameter; a note says that the matrix holds that of the body",
    ),
    Row("angle of a locked motion", "scene", _keys("scene", "articulation", {"hinge.rz": ["10 deg"]})),
    Row("sensors missing", "limits not measured", _keys("scene", "sensors", None)),
    Row("actuators missing", "limits not measured", _keys("scene", "actuators", None)),
    Row("verify missing", "not checked", _keys("verify", None)),
    Row(
        "limits missing",
        "not checked",
        _keys("verify", "limits", {}),
    ),
    Row("limit of 5 for 5 %", "grammar", _keys("verify", "limits", "frf_error", 5)),
    Row("cutoff inside the band", "frf_error, lost modes", _keys("reduce", "cutoff", 0.3)),
    Row("Guyan", "frequency_error, lost modes", _keys("reduce", "method", "guyan")),
    Row("one mode kept", "frf_error, lost modes", _keys("balance", "keep", {"modes": 1})),
    Row("mass of the hub left out", "grammar", _keys("components", "hub", "rigid", "mass", 0)),
    Row(
        "inertia that no mass has",
        "mass of a rigid body",
        _keys("components", "hub", "rigid", "inertia", [0.2, 0.9, 0.2, 0, 0, 0]),
    ),
    Row("a misspelt key", "grammar", _keys("reduce", "cutof", 3)),
    # Files.
    Row("matrix file cut in half", "reader", _truncate("arm_K.npz")),
    Row("deck cut in half", "sizes", _truncate("arm.bdf")),
    Row(
        "a grid twice in the deck",
        "reader",
        _files(
            lambda folder: (folder / "arm.bdf").write_text(
                (folder / "arm.bdf").read_text().replace("BEGIN BULK\n", "BEGIN BULK\nGRID,3,,9.,9.,9.\n")
            )
        ),
    ),
    Row("pipeline cut in half", "grammar", _truncate("study.yaml")),
    Row("matrix file missing", "reader", _files(lambda folder: (folder / "arm_M.npz").unlink())),
    Row(
        "deck of another program's text",
        "reader",
        _files(lambda folder: (folder / "arm.bdf").write_text("no deck\n" * 5)),
    ),
)
