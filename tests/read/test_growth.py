"""Files of many small parts: passes over the whole file do not grow in number with the parts."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.read import deck_statement, matrix_names, read_followers, read_geometry
from cmsreduce.read.nastran.cards import Card
from cmsreduce.read.nastran.cards.table import CardTable
from tests.golden.calculix_bodies import Deck


def count_calls(monkeypatch: pytest.MonkeyPatch, owner: Any, name: str) -> list[str]:
    """Names of the calls of a function, one for each call."""
    calls: list[str] = []
    original = getattr(owner, name)

    def counted(*args: Any, **named: Any) -> Any:
        calls.append(name)
        return original(*args, **named)

    monkeypatch.setattr(owner, name, counted)
    return calls


def test_a_punch_file_of_many_matrices(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, count = tmp_path / "many.pch", 200
    path.write_text("".join(f"DMIG,M{k},0,6,2,0\nDMIG,M{k},1,1,,1,1,{k}.\n" for k in range(count)))
    passes = count_calls(monkeypatch, CardTable, "integers")
    assert [(info.name, info.rows) for info in matrix_names(path)] == [(f"M{k}", 1) for k in range(count)]
    assert len(passes) < 20


def test_a_chain_of_constraints(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each dof follows the one before it, by four shares in turn whose product is one."""
    path, count = tmp_path / "body.bdf", 250
    shares = (2.0, -1.0, -0.5, 1.0)
    cards = ["CEND", "MPC = 1", "BEGIN BULK", *(f"GRID,{k + 1},,{k}.,0.,0." for k in range(count))]
    cards += [f"MPC,1,{k + 1},1,1.,{k},1,{-shares[k % 4]}" for k in range(1, count)]
    path.write_text("\n".join(cards) + "\n")
    nodes = read_geometry(path).nodes
    products = count_calls(monkeypatch, sp.csr_array, "__matmul__")
    found = read_followers(path, nodes)
    assert len(products) <= 2 * np.ceil(np.log2(count))
    np.testing.assert_array_equal(found.T.toarray().ravel(), np.cumprod([shares[k % 4] for k in range(1, count)]))


def test_plates_with_a_material_each(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A wing of 17 000 PSHELL and 15 000 MAT2 took more than ten minutes: each looked through all materials."""
    path, count = tmp_path / "strip.bdf", 120
    cards = [f"GRID,{2 * k + j + 1},,{k}.,{j}.,0." for k in range(count + 1) for j in (0, 1)]
    for k in range(count):
        around = ",".join(str(2 * k + j) for j in (1, 3, 4, 2))
        stiff = f"{1000 + k}.,300.,0.,1000.,0.,350."
        cards += [f"CQUAD4,{k + 1},{k + 1},{around}", f"PSHELL,{k + 1},{k + 1},0.5,{k + 1}", f"MAT2,{k + 1},{stiff},2."]
    path.write_text("\n".join(["BEGIN BULK", *cards, "ENDDATA", ""]))
    nodes = read_geometry(path).nodes
    looks = count_calls(monkeypatch, Card, "integer")
    stated = deck_statement(path, nodes, np.ones(len(nodes), dtype=bool))[1]
    assert stated is not None and stated.at_nodes is not None and stated.at_nodes.plates is not None
    np.testing.assert_allclose(stated.at_nodes.plates.laminate[:, 0, 0], 0.5 * (1000 + np.arange(count)))
    assert len(looks) < 20 * count


def test_a_mesh_with_a_section_for_each_element(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Bricks of one cubic metre and 2 kg."""
    path, count = tmp_path / "mesh.inp", 100
    deck = Deck().solid("C3D8", (count, 1, 1), (count, 1.0, 1.0))
    deck.keywords = "*MATERIAL, NAME=HEAVY\n*DENSITY\n2.0\n"
    deck.keywords += "".join(
        f"*ELSET, ELSET=E{k}\n{k}\n*SOLID SECTION, ELSET=E{k}, MATERIAL=HEAVY\n" for k in range(1, count + 1)
    )
    path.write_text(deck.text().replace("ELSET=EC, MATERIAL", "ELSET=NONE, MATERIAL"))
    nodes = read_geometry(path).nodes
    passes = count_calls(monkeypatch, np, "isin")
    mass, _ = deck_statement(path, nodes, np.ones(len(nodes), dtype=bool))
    assert len(passes) < 20
    assert mass is not None
    np.testing.assert_allclose(mass.mass, 2.0 * count)


def test_a_deck_of_many_bushes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, count = tmp_path / "body.bdf", 100
    cards = ["BEGIN BULK", "PBUSH,1,K,1.,1.,1.,1.,1.,1.", "MAT1,1,2.+11,,.3,7850."]
    cards += [f"GRID,{k + 1},,{k}.,0.,0." for k in range(8 * count)]
    cards += [f"CBUSH,{k + 1},1,{8 * k + 1},{8 * k + 2},,,,0" for k in range(count)]
    path.write_text("\n".join(cards) + "\n")
    nodes = read_geometry(path).nodes
    passes = count_calls(monkeypatch, np, "ptp")
    deck_statement(path, nodes, np.ones(len(nodes), dtype=bool))
    assert len(passes) < 20
