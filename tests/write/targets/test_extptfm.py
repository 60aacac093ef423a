"""OpenFAST's ExtPtfm: its superelement, read by the rules of its reader, answers as the finite elements do."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.errors import WriteError
from cmsreduce.model import Damping, FEModel, Units, in_units
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.reduce import CraigBampton
from cmsreduce.write import convert, write_component
from tests.frames import frame, rotation

# A tripod; its feet stand on the ground.
XYZ = [[1.0, 0.0, -4.0], [-0.5, 0.9, -4.0], [-0.5, -0.9, -4.0], [0.1, 0.0, -1.0], [0.1, 0.05, 0.4]]
BARS = [(1, 4), (2, 4), (3, 4), (4, 5)]
FEET, TOP = (1, 2, 3), 5


def tripod(axes: np.ndarray | None = None, held: tuple[int, ...] = FEET, **faces: object) -> FEModel:
    return frame("tripod", XYZ, BARS, faces or {"top": TOP}, held=held, axes=axes, damping=Damping(modal=(0.01,)))


def written(folder: Path, model: FEModel, cutoff: float = 1e9, dialect: str | None = None) -> Path:
    rows = np.unique(np.concatenate([model.interface_rows(face) for face in model.interfaces]))
    path = folder / "tripod.h5"
    component = orthogonalise(CraigBampton(cutoff).reduce(model, rows))
    write_component(path, component, nodes=(), inputs={}, outputs={}, checks=(), provenance={})
    (found,) = convert(path, folder / "tripod_SE.dat", dialect and "extptfm", dialect)
    return found


def read(path: Path) -> dict[str, np.ndarray]:
    """The rules of ReadReducedFile, OpenFAST 5.0: words at the start of a line in any case; others are skipped."""
    lines = iter(path.read_text(encoding="ascii").splitlines())
    found: dict[str, np.ndarray] = {}
    for line in lines:
        upper = line[:4096].upper()
        if upper.startswith("!DIMENSION"):
            n = int(upper[11:].split()[0])
        for word, letter, rows in (
            ("!MASS", "M", None),
            ("!STIFFNESS", "S", None),
            ("!DAMPING", "D", None),
            ("!WEIGHT CONSTANT", "constant", 1),
            ("!WEIGHT STIFFNESS", "weights", None),
        ):
            if upper.startswith(word):
                found[letter] = np.array([[float(x) for x in next(lines).split()[:n]] for _ in range(rows or n)])
    return found


def read_old(path: Path) -> dict[str, np.ndarray]:
    """The rules of ReadFlexASCII, before 5.0: the same words, at fixed columns; a line of size follows each."""
    lines = iter(path.read_text(encoding="ascii").splitlines())
    found: dict[str, np.ndarray] = {}
    n, dt, total = -1, -1.0, -1.0
    for line in lines:
        upper = line[:4096].upper()
        if upper.startswith("!DIMENSION"):
            n = int(upper[11:].split()[0])
        elif upper.startswith("!TIME INCREMENT IN SIMULATION:"):
            dt = float(upper[30:].split()[0])
        elif upper.startswith("!TOTAL SIMULATION TIME IN FILE:"):
            total = float(upper[31:].split()[0])
        elif upper.startswith(("!MASS MATRIX", "!STIFFNESS MATRIX", "!DAMPING MATRIX")):
            next(lines)
            found[upper[1]] = np.array([[float(word) for word in next(lines).split()[:n]] for _ in range(n)])
        elif upper.startswith("!LOADING"):
            next(lines)
            rows = [next(lines)[:4096].split() for _ in range(round(total / dt) + 1)]
            found["loads"] = np.array([[float(word) for word in row] for row in rows])
    return found


def condensed(K: np.ndarray, M: np.ndarray, rows: np.ndarray, w: float) -> np.ndarray:
    Z = K - w**2 * M
    others = np.setdiff1d(np.arange(len(K)), rows)
    across = Z[np.ix_(others, rows)]
    return Z[np.ix_(rows, rows)] - across.T @ la.solve(Z[np.ix_(others, others)], across)


def test_the_interface_answers_as_the_finite_elements(
    tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    """All modes kept: exact at any frequency; along the basic axes and in SI, whatever those of the file."""
    axes = np.array([rotation([1, k, 2], 0.3 * k + 0.2) for k in range(len(XYZ))])
    found = read(written(tmp_path, in_units(tripod(axes), Units.parse("mm-t-s"))))
    plain = tripod()
    rows = np.flatnonzero(plain.dofs.node == TOP)
    for w in (20.0, 900.0):
        expected = condensed(plain.K.toarray(), plain.M.toarray(), rows, w)
        seen = condensed(found["S"], found["M"], np.arange(6), w)
        error = abs(seen - expected).max() / abs(expected).max()
        record_property("error", float(error))
        assert error <= 1e-8


def test_what_the_module_requires(tmp_path: Path) -> None:
    path = written(tmp_path, tripod(), cutoff=400.0, dialect="openfast-4")
    found = read_old(path)
    M, K, D = (found[letter] for letter in "MSD")
    n = len(M)
    assert 6 < n < 12 and M.shape == K.shape == D.shape == (n, n)
    assert "FLEX 5 FORMAT" in path.read_text().splitlines()[1].upper()
    for A in (M, K, D):
        np.testing.assert_array_equal(A, A.T)
    # The modes are of unit mass with the interface held; no stiffness couples them to it.
    model = tripod()
    inner = np.flatnonzero(model.dofs.node != TOP)
    held = la.eigvalsh(model.K.toarray()[np.ix_(inner, inner)], model.M.toarray()[np.ix_(inner, inner)])
    np.testing.assert_allclose(M[6:, 6:], np.eye(n - 6), atol=1e-14)
    np.testing.assert_allclose(np.diag(K)[6:], held[: n - 6], rtol=1e-9)
    assert not K[:6, 6:].any()
    # Guyan's stiffness and mass are those of the condensed finite elements.
    top = np.flatnonzero(model.dofs.node == TOP)
    np.testing.assert_allclose(K[:6, :6], condensed(model.K.toarray(), 0 * model.M.toarray(), top, 0.0), rtol=1e-9)
    free = la.eigvalsh(model.K.toarray(), model.M.toarray())
    seen, vectors = la.eigh(K, M)
    np.testing.assert_allclose(np.sqrt(seen[:3]), np.sqrt(free[:3]), rtol=1e-3)
    np.testing.assert_allclose(np.diag(vectors.T @ D @ vectors), 0.02 * np.sqrt(seen), rtol=1e-6)
    # Loads of zero at two times, which the reader holds after the last one.
    np.testing.assert_array_equal(found["loads"], [[0.0] * (n + 1), [1.0] + [0.0] * n])


def test_releases_read_the_same_matrices(tmp_path: Path) -> None:
    new, old = (read(written(tmp_path, tripod())), read_old(written(tmp_path, tripod(), dialect="openfast-4")))
    for letter in "MSD":
        np.testing.assert_array_equal(new[letter], old[letter])
    # The module adds weights without a look at whether the file has them.
    assert new["constant"].shape == (1, len(new["M"])) and not new["constant"].any()
    assert new["weights"].shape == new["M"].shape and not new["weights"].any()


def test_a_floating_platform_has_no_stiffness_at_its_interface(tmp_path: Path) -> None:
    found = read(written(tmp_path, tripod(held=())))
    assert not found["S"][:6].any()
    assert found["M"][:3, :3] == pytest.approx(found["M"][0, 0] * np.eye(3), abs=1e-9)


@pytest.mark.parametrize(
    ("faces", "message"),
    [
        ({"top": TOP, "deck": 4}, r"joins the structure to the tower at one node, and its interfaces \(deck, top\)"),
        ({"top": (TOP, (1, 2, 3))}, "node 5 has 3 of the six dofs"),
    ],
    ids=["two", "three dofs"],
)
def test_other_interfaces_are_refused(tmp_path: Path, faces: dict[str, object], message: str) -> None:
    with pytest.raises(WriteError, match=message):
        written(tmp_path, tripod(**faces))
    assert not list(tmp_path.glob("*_SE.dat"))
