"""Geometry and dof sets of OUTPUT2 files that NX and MSC NASTRAN wrote, against their decks and frequencies."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
import pyyeti
import scipy.linalg as la

from cmsreduce.errors import ReadError
from cmsreduce.pipeline.drafts import draft_body
from cmsreduce.read import MatrixSource, prove_row_order, read_body, read_geometry, read_matrix

THEIRS = Path(pyyeti.__file__).parent / "tests"
pytestmark = pytest.mark.skipif(not THEIRS.is_dir(), reason="pyYeti is installed without its test data")


def test_the_model_has_the_grids_of_its_deck() -> None:
    deck = read_geometry(THEIRS / "nas2cam_extseout" / "full.dat").nodes
    nodes = read_geometry(THEIRS / "nas2cam_extseout" / "full.op2").nodes
    assert np.array_equal(nodes.id, np.sort(deck.id))
    at = deck.index(nodes.id)
    np.testing.assert_allclose(nodes.xyz, deck.xyz[at], atol=1e-4)
    np.testing.assert_allclose(nodes.frame, deck.frame[at], atol=1e-7)


def grids(path: Path, ids: tuple[int, ...], xyz: np.ndarray, wide: bool, newer: bool) -> None:
    """An OP2 file with the tables BGPDT and EQEXIN of grids, in lines of the first or of later versions."""
    integer, word = ("q", 8) if wide else ("i", 4)

    def record(content: bytes) -> bytes:
        marker = struct.pack("<i", len(content))
        return marker + content + marker

    def keys(*values: int) -> bytes:
        return b"".join(record(struct.pack(f"<{integer}", value)) for value in values)

    def table(name: str, *records: bytes) -> bytes:
        label = record("".join(part.ljust(word) for part in (name[:4], name[4:].ljust(4))).encode())
        out = keys(2) + label + keys(-1, 7) + record(struct.pack(f"<7{integer}", 101, len(ids), 0, 0, 0, 0, 0))
        out += keys(-2, 1, 0, 2) + label
        for k, each in enumerate(records, 3):
            out += keys(-k, 1, 0, len(each) // word) + record(each)
        return out + keys(-3 - len(records), 1, 0, 0)

    lines = b""
    for k, (number, place) in enumerate(zip(ids, xyz, strict=True)):
        first = struct.pack(f"<6{integer}", 0, 6 * k + 1, number, 61, 0, 0) if newer else struct.pack(f"<{integer}", 0)
        lines += first + struct.pack(f"<3{'d' if newer or wide else 'f'}", *place)
    # External numbers ascend, with the internal number of each, and ten times its first dof, and its type.
    order = np.argsort(ids)
    inner, dof = (
        [value for k in order for value in (ids[k], one(k))] for one in (lambda k: k + 1, lambda k: 60 * k + 11)
    )
    pairs = [struct.pack(f"<{2 * len(ids)}{integer}", *each) for each in (inner, dof)]
    bulk = table("GEOM1", struct.pack(f"<3{integer}", 65535, 65535, 25535))
    path.write_bytes(bulk + table("BGPDT", lines) + table("EQEXIN", *pairs) + keys(0))


@pytest.mark.parametrize("newer", [False, True], ids=["first", "later"])
@pytest.mark.parametrize("wide", [False, True], ids=["32bit", "64bit"])
def test_grids_of_every_version(tmp_path: Path, wide: bool, newer: bool) -> None:
    """Lines of later versions were read as three of the first, and the file refused as one of two runs."""
    path, xyz = tmp_path / "model.op2", np.array([[0.0, 0.5, -2.0], [1.25, 0.0, 0.0], [3.0, 4.0, 8.0]])
    grids(path, (11, 4, 7), xyz, wide, newer)
    nodes = read_geometry(path).nodes
    assert nodes.id.tolist() == [4, 7, 11]
    assert np.array_equal(nodes.xyz[nodes.index([11, 4, 7])], xyz)


@pytest.mark.parametrize(
    ("stem", "number", "rows", "eigenvalues"),
    [
        ("nas2cam_extseout/nas2cam", 1, 46, None),
        ("nas2cam_extseout/nas2cam", 2, 32, None),
        ("nas2cam_extseout/nas2cam", 3, 54, "LAMBDA"),
        ("nas2cam_extseout/nas2cam_notall6_msc2017", 2, 29, "LAMBDA#2"),
        ("nas2cam_extseout/nas2cam_notall6_nx2021", 2, 29, "LAMBDA#2"),
        # Generalised coordinates on grids.
        ("nas2cam_csuper/nas2cam", 2, 36, None),
        ("nas2cam_csuper/nas2cam", 3, 54, "LAMBDA#3"),
        ("cla_test_data_2020/nas2cam", 2, 178, "LAMBDA#2"),
    ],
)
def test_matrices_of_superelements_are_proven(stem: str, number: int, rows: int, eigenvalues: str | None) -> None:
    """Rows are found by size and proven, and the eigenvalues are those that NASTRAN wrote beside the matrices."""
    op4, op2 = (THEIRS / f"{stem}.{kind}" for kind in ("op4", "op2"))
    stiffness, mass = (MatrixSource(op4, f"{name}#{number}") for name in ("KAA", "MAA"))
    body = read_body("x", stiffness=stiffness, mass=mass, geometry=op2)
    assert body.n == rows
    proof = prove_row_order(body)
    assert (proof.status, proof.motions) == ("proven", 6)
    if eigenvalues is not None:
        theirs = np.sort(read_matrix(op4, eigenvalues).A.toarray().ravel())
        K, M = body.K.toarray(), body.M.toarray()
        # Shifted off the rigid motions, and inverted for the rows without mass.
        shifted = la.eigh(M, K + 100 * M, eigvals_only=True)
        ours = np.sort(1 / shifted[shifted > 1e-12 * shifted.max()] - 100)
        count = min(theirs.size, 12)
        np.testing.assert_allclose(ours[6:count], theirs[6:count], rtol=1e-5)


def test_a_pair_of_files_gives_a_draft() -> None:
    files = [THEIRS / "nas2cam_extseout" / f"nas2cam_notall6_nx2021.{kind}" for kind in ("op2", "op4")]
    draft = draft_body("x", files)
    assert (draft.remark, draft.geometry) == ("", files[0])
    assert [name for _, name in (draft.stiffness, draft.mass)] == ["KAA#1", "MAA#1"]


def test_the_pair_that_fits_the_deck_is_found() -> None:
    """The first pair of the file is of another superelement."""
    folder = THEIRS / "cla_test_data_2020"
    draft = draft_body("x", [folder / "residual.dat", folder / "nas2cam.op4"])
    assert draft.remark == ""
    assert [name for _, name in (draft.stiffness, draft.mass)] == ["KAA#2", "MAA#2"]


def test_a_file_without_grids_is_refused() -> None:
    with pytest.raises(ReadError, match="this is NASTRAN OUTPUT2, which holds no nodes"):
        read_geometry(THEIRS / "nastran_op2_data" / "double_le.op2")


@pytest.mark.parametrize(
    "stem",
    [
        *("nas2cam_extseout/inboard", "nas2cam_extseout/outboard", "nas2cam_extseout/reduced_bset_notall6"),
        *("nas2cam_csuper/inboard", "cla_test_data/outboard", "cla_test_data_2020/outboard"),
    ],
)
def test_every_superelement_gives_a_draft_from_any_of_its_files(stem: str) -> None:
    draft = draft_body("x", [THEIRS / f"{stem}.asm"])
    assert draft == draft_body("x", [THEIRS / f"{stem}.op4"])
    assert (draft.remark, draft.interfaces[0][1], draft.extseout) == ("", "{set: b}", THEIRS / stem)


def test_a_superelement_without_its_matrices_is_refused() -> None:
    with pytest.raises(ReadError, match=r"matrices of this superelement are missing: there is no .*fake_dtipch\.op4"):
        draft_body("x", [THEIRS / "nas2cam_csuper" / "fake_dtipch.pch"])
