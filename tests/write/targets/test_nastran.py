"""NASTRAN superelements: fields of cards, names and ids; the matrices themselves are tested with a run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cmsreduce.errors import WriteError
from cmsreduce.write.component import ComponentFile
from cmsreduce.write.targets.nastran import write_nastran
from tests.write.particles import particles


def guyan(tip: int = 34, size: float = 1.0) -> ComponentFile:
    """Six modes that move one node by one dof each, with every second one of negative coupling."""
    file = particles().file
    coupled = 2 * np.eye(6) - np.eye(6, k=1) - np.eye(6, k=-1)
    arrays = {
        **{name: value for name, value in file.arrays.items() if not name.startswith("interfaces")},
        "nodes/id": np.r_[file.arrays["nodes/id"][:-1], tip],
        "modes/omega": np.full(6, np.sqrt(size)),
        "modes/mass": np.eye(6),
        "modes/stiffness": size * np.eye(6),
        "modes/damping": np.zeros((6, 6)),
        "interfaces/tip/node": np.full(6, tip),
        "interfaces/tip/component": np.arange(1, 7),
        "interfaces/tip/shapes": np.linalg.cholesky(np.linalg.inv(coupled)),
    }
    return replace(file, arrays=arrays)


def fields(line: str, start: int = 8) -> list[str]:
    """Fields of a wide card, whose place is all that tells them apart."""
    assert len(line) <= 72
    return [line[at : at + 16] for at in range(start, len(line), 16)]


@pytest.mark.parametrize("size", [1.0, 1e100, 1e200])
def test_numbers_stay_in_their_fields(tmp_path: Path, size: float) -> None:
    """A sign and an exponent of three digits leave nine digits of the sixteen characters."""
    body = guyan(size=size)
    body.arrays["nodes/xyz"][-1] = [-size, 1e-120, size]
    _, punch, deck = write_nastran(tmp_path / "body.op4", body)
    K, column, name = np.zeros((6, 6)), 0, ""
    for line in punch.read_text().splitlines():
        part = fields(line)
        if line.startswith("DMIG*"):
            name, column = part[0].strip(), int(part[2])
        elif line.startswith("*") and name == "KAA":
            row = int(part[1])
            K[row - 1, column - 1] = K[column - 1, row - 1] = float(part[2].replace("D", "E"))
    np.testing.assert_allclose(K, size * (2 * np.eye(6) - np.eye(6, k=1) - np.eye(6, k=-1)), atol=1e-8 * size)
    cards = deck.read_text().splitlines()
    at = next(number for number, line in enumerate(cards) if line.startswith("GRID*"))
    xyz = [float(word) for word in (*fields(cards[at])[2:], fields(cards[at + 1])[0])]
    assert xyz == [-size, 0.0, size]


def test_names_that_differ_after_a_dot_stay_apart(tmp_path: Path) -> None:
    for version in ("panel.v2", "panel.v3"):
        names = {path.name for path in write_nastran(tmp_path / version, guyan())}
        assert names == {f"{version}{suffix}" for suffix in (".op4", ".pch", ".bdf")}
    assert len(list(tmp_path.iterdir())) == 6


def test_the_largest_id_of_eight_digits_is_one(tmp_path: Path) -> None:
    write_nastran(tmp_path / "body.op4", guyan(99_999_999))
    with pytest.raises(WriteError, match="node 100000000 leaves no ids of eight digits"):
        write_nastran(tmp_path / "body.op4", guyan(100_000_000))
