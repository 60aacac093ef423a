"""Small files of every format that is read, and ways to damage them."""

from __future__ import annotations

import random
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import scipy.io
import scipy.sparse as sp
from pyyeti.nastran import op4

from tests.read.nastran.test_op2 import op2_bytes
from tests.read.nastran.test_op4 import op4_bytes

__all__ = ["damaged", "samples"]

# Numbers that sizes, places and ends are most often got wrong by.
_NUMBERS = (
    b"0",
    b"-1",
    b"1",
    b"2147483647",
    b"-2147483648",
    b"4294967296",
    b"9223372036854775807",
    b"1e308",
    b"nan",
    b"inf",
    b"9" * 5000,
)
_INTEGERS = (0, 1, 0x7F, 0xFF, 0x7FFFFFFF, 0xFFFFFFFF, 0x80000000, 0x7FFFFFFFFFFFFFFF)

_DECK = """SOL 103
CEND
BEGIN BULK
CORD2R,7,,0.,0.,0.,0.,0.,1.
,1.,0.,0.
GRID,1,,0.,0.,0.
GRID,2,7,1.,0.,0.,7
GRID*,3,,2.0,0.0
*,0.0,7
SPC1,1,123456,1
ASET1,123,2,3
CBAR,1,1,1,2,0.,1.,0.
CBAR,2,1,2,3,0.,1.,0.
ENDDATA
"""
_DMIG = """DMIG    KAA     0       6       1       0
DMIG*   KAA                            1               1
*                      1               1 2.000000000D+00
DMIG*   KAA                            2               1
*                      1               1-1.00000000D+00
*                      2               1 2.000000000D+00
ENDDATA
"""
_ABAQUS = "1,1, 1,1, 2.0\n2,1, 1,1, -1.0\n2,1, 2,1, 2.0\n2,2, 2,2, 1.0\n"
_INP = "*NODE\n1, 0., 0., 0.\n2, 1., 0., 0.\n3, 0., 1., 0.\n4, 0., 0., 1.\n*ELEMENT, TYPE=C3D4\n1, 1, 2, 3, 4\n"
_FRD = """    1C
    2C                             2                                     1
 -1         1 0.00000E+00 0.00000E+00 0.00000E+00
 -1         2 1.00000E+00 0.00000E+00 0.00000E+00
 -3
    3C                             1                                     1
 -1         1   11    0    1
 -2         1         2
 -3
 9999
"""


def samples(folder: Path) -> dict[str, bytes]:
    """A good file of each format, by its name."""
    rng = np.random.default_rng(5)
    A = rng.standard_normal((6, 6))
    A = A @ A.T
    sparse = sp.csc_array(np.where(abs(A) > 1.0, A, 0.0))
    good: dict[str, bytes] = {
        "deck.bdf": _DECK.encode(),
        "dmig.pch": _DMIG.encode(),
        "abaqus.mtx": _ABAQUS.encode(),
        "calculix.sti": b"1 1 2.0\n1 2 -1.0\n2 2 2.0\n",
        "calculix.dof": b"1.1\n1.2\n1.3\n2.1\n",
        "mesh.inp": _INP.encode(),
        "mesh.frd": _FRD.encode(),
        "nodes.txt": b"Knoten\tX (m)\tY (m)\tZ (m)\n1\t0,5\t1,e-002\t0,\n2\t-1,25\t3,0\t0,333333\n7\t0,\t0,\t1,\n",
        "binary.op2": op2_bytes("KAA", A, "<", False, False),
        "wide.op2": op2_bytes("KAA", A, ">", True, False),
    }
    for layout in ("dense", "bigmat", "nonbigmat"):
        good[f"{layout}.op4"] = op4_bytes("KAA", A, "<", False, False, layout)
    written: dict[str, Callable[[Path], object]] = {
        "printed.op4": lambda path: op4.save(str(path), {"KAA": A}, binary=False),
        "sparse.op4": lambda path: op4.save(str(path), {"KAA": sparse.toarray()}, binary=False, sparse="bigmat"),
        "market.mtx": lambda path: scipy.io.mmwrite(path, sp.coo_array(sparse), symmetry="symmetric"),
        "harwell.hb": lambda path: scipy.io.hb_write(path, sparse),
        "array.mtx": lambda path: scipy.io.mmwrite(path, A),
        "level5.mat": lambda path: scipy.io.savemat(path, {"K": sparse, "M": A}),
        "struct.mat": lambda path: scipy.io.savemat(path, {"sys": {"K": sparse, "M": A, "inner": {"K": A}}}),
        "packed.mat": lambda path: scipy.io.savemat(path, {"K": sparse}, do_compression=True),
        "level4.mat": lambda path: scipy.io.savemat(path, {"K": A}, format="4"),
        "dense.npy": lambda path: np.save(path, A),
        "arrays.npz": lambda path: np.savez(path, K=A, M=A),
        "sparse.npz": lambda path: sp.save_npz(path, sparse),
    }
    for name, write in written.items():
        path = folder / name
        write(path)
        good[name] = path.read_bytes()
    return good


def damaged(content: bytes, chance: random.Random) -> bytes:
    """The same file with one to four things wrong."""
    found = bytearray(content)
    for _ in range(chance.choice((1, 1, 1, 2, 4))):
        if not found:
            break
        chance.choice(_DAMAGES)(found, chance)
    return bytes(found)


def _overwrite(content: bytearray, chance: random.Random) -> None:
    content[chance.randrange(len(content))] = chance.randrange(256)


def _set_integer(content: bytearray, chance: random.Random) -> None:
    width = chance.choice((2, 4, 8))
    at, value = chance.randrange(len(content)), chance.choice(_INTEGERS) & (256**width - 1)
    content[at : at + width] = value.to_bytes(width, chance.choice(("little", "big")))


def _set_number(content: bytearray, chance: random.Random) -> None:
    places = list(re.finditer(rb"-?[0-9]+", bytes(content)))
    if places:
        place = chance.choice(places)
        content[place.start() : place.end()] = chance.choice(_NUMBERS)


def _cut(content: bytearray, chance: random.Random) -> None:
    del content[chance.randrange(len(content)) :]


def _drop(content: bytearray, chance: random.Random) -> None:
    at = chance.randrange(len(content))
    del content[at : at + chance.randrange(1, 40)]


def _repeat(content: bytearray, chance: random.Random) -> None:
    at = chance.randrange(len(content))
    content[at:at] = content[at : at + chance.randrange(1, 80)]


def _insert(content: bytearray, chance: random.Random) -> None:
    at = chance.randrange(len(content))
    content[at:at] = chance.choice((b"\x00", b"\n", b",", b"*", b"\xff\xfe", b" " * 90, chance.randbytes(12)))


def _lines(content: bytearray, chance: random.Random) -> None:
    """Lose, double or exchange a line."""
    lines = bytes(content).split(b"\n")
    first, second = chance.randrange(len(lines)), chance.randrange(len(lines))
    action = chance.randrange(3)
    if action == 0:
        del lines[first]
    elif action == 1:
        lines.insert(second, lines[first])
    else:
        lines[first], lines[second] = lines[second], lines[first]
    content[:] = b"\n".join(lines)


def _digit(content: bytearray, chance: random.Random) -> None:
    places = [place.start() for place in re.finditer(rb"[0-9]", bytes(content))]
    if places:
        content[chance.choice(places)] = ord(chance.choice("0123456789"))


def _encoding(content: bytearray, chance: random.Random) -> None:
    """Store the file in another encoding, as an editor may."""
    text = bytes(content).decode("latin-1")
    content[:] = text.encode(chance.choice(("utf-16", "utf-8-sig", "utf-8", "utf-32")))


_DAMAGES = (
    *(_overwrite, _set_integer, _set_number, _cut, _drop, _repeat, _insert),
    *(_lines, _lines, _digit, _digit, _encoding),
)
