"""Held solids of CalculiX: every entry of K beside supports and of M is that of the deck, or the rest is named."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.errors import DofMapError
from cmsreduce.model import FEModel, Proof
from cmsreduce.read import MatrixSource, read_body
from tests.golden.calculix_bodies import STEEL, Deck, solve
from tests.pipeline.proofs import proofs_of

pytestmark = pytest.mark.ccx

KINDS = ["C3D4", "C3D6", "C3D8", "C3D8I", "C3D10", "C3D15", "C3D20", "C3D20R"]


def held(folder: Path, deck: Deck) -> FEModel:
    deck.nset("ROOT", deck.at(0))
    deck.keywords += "*BOUNDARY\nROOT, 1, 3\n"
    solve(folder, "bar", deck.text(), matrices=True)
    sources = {"stiffness": MatrixSource(folder / "bar.sti"), "mass": MatrixSource(folder / "bar.mas")}
    return read_body("bar", geometry=folder / "bar.inp", **sources)


def skewed(deck: Deck) -> Deck:
    """Solids with faces that are not parallel."""
    deck.nodes = {
        (k, x + 0.15 * x * y - 0.1 * x * z, y * (1 + 0.3 * x), z * (1 - 0.2 * x)): n
        for (k, x, y, z), n in deck.nodes.items()
    }
    return deck


def proofs(body: FEModel, folder: Path) -> dict[str, Proof]:
    return proofs_of(body, folder / "bar.inp")


def exchanged(body: FEModel, one: np.ndarray, other: np.ndarray, *, stiffness: bool) -> FEModel:
    order = np.arange(body.n)
    order[one], order[other] = other, one
    K, M = (sp.csc_array(A[order][:, order]) for A in (body.K, body.M))
    return replace(body, K=K if stiffness else body.K, M=M)


@pytest.mark.parametrize("shape", ["straight", "skewed"])
@pytest.mark.parametrize("kind", KINDS)
def test_sound_solids_beside_supports_are_proven(tmp_path: Path, kind: str, shape: str) -> None:
    """Their masses were unproven, skew ones beside supports also where others were compared."""
    deck = Deck().solid(kind, (3, 2, 1), (1, 0.2, 0.15))
    found = proofs(held(tmp_path, skewed(deck) if shape == "skewed" else deck), tmp_path)
    assert (found["row order"].label, found["stiffness"].state) == ("row order", "proven")
    inner = kind == "C3D8I"
    assert found["mass"].label == ("mass (nodes alone)" if inner else "mass")
    assert "each entry is that of the elements" in found["mass"].remark


def test_solids_of_two_kinds_and_a_point_mass_are_proven(tmp_path: Path) -> None:
    deck = Deck().solid("C3D20R", (2, 2, 1), (0.5, 0.2, 0.15)).solid("C3D15", (2, 2, 1), (0.5, 0.2, 0.15), (0.5, 0, 0))
    deck.keywords += f"*ELEMENT, TYPE=MASS, ELSET=LUMP\n9001, {deck.node((1, 0, 0))}\n*MASS, ELSET=LUMP\n3.\n"
    assert proofs(held(tmp_path, deck), tmp_path)["mass"].label == "mass"


@pytest.mark.parametrize("kind", ["C3D10", "C3D15", "C3D20R"])
def test_an_exchange_beside_supports_is_never_proven(tmp_path: Path, kind: str) -> None:
    """Of two nodes in K and M: 8 of 60 with wedges of second order were proven whole."""
    body = held(tmp_path, Deck().solid(kind, (3, 1, 1), (1, 0.1, 0.15)))
    assert body.nodes is not None
    near = body.nodes.id[(body.nodes.xyz[:, 0] < 0.34) & np.isin(body.nodes.id, body.dofs.node)]
    left = 0
    for one, other in combinations(near, 2):
        rows = [np.flatnonzero(body.dofs.node == node) for node in (one, other)]
        wrong = exchanged(body, *rows, stiffness=True)
        try:
            found = proofs(wrong, tmp_path)
        except DofMapError:
            continue
        refuted = any(each.state == "refuted" for each in found.values())
        row_order = found["row order"]
        assert refuted or row_order.state != "proven" or row_order.only
        left += not refuted
    assert left < 0.1 * near.size


@pytest.mark.parametrize("kind", ["C3D8", "C3D10", "C3D15"])
def test_two_nodes_or_an_element_in_the_mass_alone_are_not_proven(tmp_path: Path, kind: str) -> None:
    deck = skewed(Deck().solid(kind, (3, 1, 1), (1, 0.2, 0.15)))
    body = held(tmp_path, deck)
    ids = body.dofs.node_ids
    for one, other in zip(ids[:-1:3], ids[1::3], strict=False):
        rows = [np.flatnonzero(body.dofs.node == node) for node in (one, other)]
        wrong = exchanged(body, *rows, stiffness=False)
        try:
            found = proofs(wrong, tmp_path)["mass"]
        except DofMapError:
            continue
        assert (found.state, found.only) != ("proven", "")
    root = set(deck.at(0))
    beside = next(k + 1 for k, (_, nodes) in enumerate(deck.elements) if set(nodes) & root)
    lead = STEEL.replace("STEEL", "LEAD").replace("7850", "8240") + "*SOLID SECTION, ELSET=HEAVY, MATERIAL=LEAD\n"
    solve(tmp_path, "other", deck.text() + f"*ELSET, ELSET=HEAVY\n{beside},\n" + lead, matrices=True)
    for kind_of in ("mas", "dof"):
        (tmp_path / f"other.{kind_of}").replace(tmp_path / f"bar.{kind_of}")
    sources = {"stiffness": MatrixSource(tmp_path / "bar.sti"), "mass": MatrixSource(tmp_path / "bar.mas")}
    found = proofs(read_body("bar", geometry=tmp_path / "bar.inp", **sources), tmp_path)["mass"]
    assert (found.state, found.only) != ("proven", "")


@pytest.mark.parametrize("is_held", [False, True])
def test_dofs_inside_elements_are_left_out_by_name(tmp_path: Path, is_held: bool) -> None:
    """Two of them exchanged in the mass alone: up to 7 % of a frequency, and the mass was proven."""
    deck = Deck().solid("C3D8I", (4, 2, 2), (1, 0.1, 0.15))
    if is_held:
        body = held(tmp_path, deck)
    else:
        solve(tmp_path, "bar", deck.text(), matrices=True)
        sources = {"stiffness": MatrixSource(tmp_path / "bar.sti"), "mass": MatrixSource(tmp_path / "bar.mas")}
        body = read_body("bar", geometry=tmp_path / "bar.inp", **sources)
    inner = np.flatnonzero(body.dofs.component == 0)
    for one, other in ((0, 0), (3, 25), (40, 48), (100, 130)):
        found = proofs(exchanged(body, inner[[one]], inner[[other]], stiffness=False), tmp_path)["mass"]
        assert found.label == "mass (nodes alone)" and f"the {inner.size} dofs inside elements" in found.remark


def test_a_density_of_one_part_in_another_unit_is_refuted(tmp_path: Path) -> None:
    """Nodes of the other part are a thousandth of the largest in the deck, and were left out: no deck states it."""
    deck = Deck().solid("C3D4", (4, 2, 1), (1, 0.2, 0.15))
    places = {n: key[1] for key, n in deck.nodes.items()}
    far = [k + 1 for k, (_, nodes) in enumerate(deck.elements) if min(places[n] for n in nodes) > 0.49]
    lead = STEEL.replace("STEEL", "LIGHT").replace("7850", "2700") + "*SOLID SECTION, ELSET=FAR, MATERIAL=LIGHT\n"
    near = [k for k in range(1, len(deck.elements) + 1) if k not in far]
    of_all = "*SOLID SECTION, ELSET=NEAR, MATERIAL=STEEL\n"
    sets = "".join(
        f"*ELSET, ELSET={name}\n" + "".join(f"{k},\n" for k in own) for name, own in (("NEAR", near), ("FAR", far))
    )
    deck.nset("ROOT", deck.at(0))
    text = deck.text().replace("*SOLID SECTION, ELSET=EC, MATERIAL=STEEL\n", sets + of_all + lead)
    solve(tmp_path, "bar", text + "*BOUNDARY\nROOT, 1, 3\n", matrices=True)
    deck_file = tmp_path / "bar.inp"
    sources = {"stiffness": MatrixSource(tmp_path / "bar.sti"), "mass": MatrixSource(tmp_path / "bar.mas")}
    for density, state in (("7850", "proven"), ("7850000", "refuted")):
        deck_file.write_text(deck_file.read_text().replace("7850", density))
        found = proofs(read_body("bar", geometry=deck_file, **sources), tmp_path)["mass"]
        assert (found.state, found.only) == (state, "")


@pytest.mark.parametrize("is_held", [False, True])
def test_a_few_skew_wedges_are_sound(tmp_path: Path, is_held: bool) -> None:
    """CalculiX integrates their masses by two points, which is not exact."""
    deck = Deck().solid("C3D6", (6, 2, 2), (1, 0.2, 0.2))
    deck.nodes = {
        (k, x, y * (1 + 3 * max(x - 0.8, 0)), z * (1 - 4 * max(x - 0.8, 0))): n
        for (k, x, y, z), n in deck.nodes.items()
    }
    if is_held:
        body = held(tmp_path, deck)
    else:
        solve(tmp_path, "bar", deck.text(), matrices=True)
        sources = {"stiffness": MatrixSource(tmp_path / "bar.sti"), "mass": MatrixSource(tmp_path / "bar.mas")}
        body = read_body("bar", geometry=tmp_path / "bar.inp", **sources)
    found = proofs(body, tmp_path)["mass"]
    assert (found.state, found.only) == ("proven", "")
