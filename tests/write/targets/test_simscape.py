"""Simscape's Reduced Order Flexible Solid: the conditions that its documentation states, and the finite elements."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from scipy.io import loadmat
from scipy.spatial.transform import Rotation

from cmsreduce.errors import WriteError
from cmsreduce.model import Damping, FEModel, Units, in_units
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.reduce import CraigBampton
from cmsreduce.write import convert, write_component
from tests.frames import frame, rotation

XYZ = [[0.1, 0.2, 0.3], [0.9, 0.2, 0.4], [1.1, 0.8, 0.2], [0.3, 1.0, 0.9], [0.5, 0.5, 0.7]]
BARS = [(1, 2), (2, 3), (3, 4), (4, 5), (5, 1)]
# Nodes in an order that is not that of the names.
FACES = {"tip": 3, "root": 4, "eye": 1}
MM = Units.parse("mm-t-s")


def body(axes: np.ndarray | None = None, faces: dict[str, object] | None = None) -> FEModel:
    return frame("ring", XYZ, BARS, faces or FACES, axes=axes, damping=Damping(modal=(0.02,)))


def written(folder: Path, model: FEModel) -> Path:
    rows = np.concatenate([model.interface_rows(face) for face in model.interfaces])
    component = orthogonalise(CraigBampton(1e9).reduce(model, np.unique(rows)))
    path = folder / "ring.h5"
    write_component(path, component, nodes=(), inputs={}, outputs={}, checks=(), provenance={})
    return path


def rom(folder: Path, model: FEModel) -> dict[str, np.ndarray]:
    script, arrays = convert(written(folder, model), folder / "ring_rom.m")
    assert (script.name, arrays.name) == ("ring_rom.m", "ring_rom.mat")
    return loadmat(arrays)


def turned() -> np.ndarray:
    return np.array([rotation([1, k, 2], 0.3 * k + 0.2) for k in range(len(XYZ))])


def condensed(K: np.ndarray, M: np.ndarray, rows: np.ndarray, w: float) -> np.ndarray:
    """Force per displacement of some rows at a frequency, the others free of load."""
    Z = K - w**2 * M
    others = np.setdiff1d(np.arange(len(K)), rows)
    across = Z[np.ix_(others, rows)]
    return Z[np.ix_(rows, rows)] - across.T @ la.solve(Z[np.ix_(others, others)], across)


def test_frames_answer_as_the_finite_elements(tmp_path: Path, record_property: Callable[[str, object], None]) -> None:
    """All modes kept: exact at any frequency, along the basic axes and in SI, whatever axes and units the file has."""
    plain = body()
    found = rom(tmp_path, in_units(body(turned()), MM))
    rows = np.concatenate([np.arange(6 * node - 6, 6 * node) for node in sorted(FACES.values())])
    np.testing.assert_allclose(found["P"], np.array(XYZ)[[0, 2, 3]], rtol=1e-12)
    assert [cell.item() for cell in found["frames"].ravel()] == ["eye.1", "tip.3", "root.4"]
    for w in (300.0, 2000.0):
        expected = condensed(plain.K.toarray(), plain.M.toarray(), rows, w)
        seen = condensed(found["K"], found["M"], np.arange(18), w)
        error = abs(seen - expected).max() / abs(expected).max()
        record_property("error", float(error))
        assert error <= 1e-8


def test_what_the_block_requires(tmp_path: Path) -> None:
    found = rom(tmp_path, body(turned()))
    K, M, D, P = (found[name] for name in "KMDP")
    assert K.shape == M.shape == D.shape and len(K) > 18 and P.shape == (3, 3)
    for A in (K, M, D):
        np.testing.assert_array_equal(A, A.T)
    assert la.eigvalsh(M).min() > 0
    squares = la.eigvalsh(K, M)
    assert (abs(squares[:6]) < 1e-8 * squares[6]).all() and squares[6] > 0
    # No modal coordinate moves with a rigid motion of the frames, which costs no energy, nor any power of damping.
    R = np.zeros((len(K), 6))
    for row, (x, y, z) in zip((0, 6, 12), P, strict=True):
        R[row : row + 6] = np.eye(6)
        R[row : row + 3, 3:] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
    assert abs(K @ R).max() < 1e-9 * abs(K).max()
    assert abs(D @ R).max() < 1e-8 * abs(D).max()
    # Mass, centre and inertia are those of the finite elements.
    model = body()
    whole = np.vstack([np.vstack([np.hstack([np.eye(3), -np.cross(np.eye(3), p)]), np.eye(6)[3:]]) for p in XYZ])
    np.testing.assert_allclose(R.T @ M @ R, whole.T @ model.M.toarray() @ whole, rtol=0, atol=1e-9)
    np.testing.assert_allclose(M[18:, 18:], np.eye(len(M) - 18), atol=1e-14)
    free, vectors = la.eigh(K, M)
    modal = np.diag(vectors.T @ D @ vectors)[6:]
    np.testing.assert_allclose(modal, 2 * 0.02 * np.sqrt(free[6:]), rtol=1e-6)


def test_quaternions_turn_basic_axes_into_those_of_the_interfaces(tmp_path: Path) -> None:
    axes = turned()
    found = rom(tmp_path, body(axes))
    assert (found["Q"][:, 0] >= 0).all()
    turns = Rotation.from_quat(np.roll(found["Q"], -1, axis=1)).as_matrix()
    np.testing.assert_allclose(np.swapaxes(turns, 1, 2), axes[[0, 2, 3]], atol=1e-14)


@pytest.mark.parametrize(
    ("model", "message"),
    [
        (lambda: body(faces={"eye": ((1, 3, 4), (1, 2, 3))}), "node 1 has 3 of the six dofs that a frame needs"),
        (lambda: frame("ring", XYZ, BARS, FACES, held=(5,)), "needs a body with six motions without strain"),
        (lambda: replace(body(), damping=Damping(structural=0.02)), "structural damping is a complex stiffness"),
    ],
    ids=["three dofs", "held", "structural"],
)
def test_bodies_that_the_block_cannot_take_are_refused(tmp_path: Path, model: object, message: str) -> None:
    with pytest.raises(WriteError, match=message):
        rom(tmp_path, model())  # type: ignore[operator]
    assert not list(tmp_path.glob("*_rom*"))


def test_an_interface_without_inertia_is_refused(tmp_path: Path) -> None:
    """Mass at nodes that does not resist their rotations, as decks of beams have it: no mass matrix for the block."""
    plain = body()
    M = sp.diags_array(np.where(plain.dofs.component <= 3, 0.3, 0.0)).tocsc()
    with pytest.raises(WriteError, match="a motion of its interface moves no mass, and the block needs a mass matrix"):
        rom(tmp_path, replace(plain, M=M))
    assert not list(tmp_path.glob("*_rom*"))


def test_a_frame_names_every_interface_of_its_node(tmp_path: Path) -> None:
    found = rom(tmp_path, body(faces={"hook": 3, "tip": 3, "root": 4}))
    assert [cell.item() for cell in found["frames"].ravel()] == ["hook.3 and tip.3", "root.4"]
    assert found["P"].shape == (2, 3) and "2: F1 hook.3 and tip.3, F2" in (tmp_path / "ring_rom.m").read_text()


@pytest.mark.parametrize(
    ("name", "stem"), [("left-arm", "left_arm_rom"), ("3panel", "m3panel_rom"), ("O'träger", "O_tr_ger_rom")]
)
def test_files_have_names_that_matlab_runs(tmp_path: Path, name: str, stem: str) -> None:
    """Letters, digits and _, a letter first; the script loads the data by this name, and the data have the body's."""
    script, arrays = convert(written(tmp_path, replace(body(), name=name)), f"{tmp_path}/out/", "simscape")
    assert (script.name, arrays.name) == (f"{stem}.m", f"{stem}.mat")
    assert f"'fullpath')), '{arrays.name}'));" in script.read_text(encoding="ascii")
    assert loadmat(arrays)["name"].item() == name


def test_the_script_runs_in_octave(tmp_path: Path) -> None:
    octave = shutil.which("octave-cli")
    if octave is None:
        pytest.skip("Octave is not installed")
    rom(tmp_path, body())
    script = tmp_path / "ring_rom.m"
    done = subprocess.run([octave, "--eval", f"run('{script}')"], capture_output=True, text=True, check=False)
    model = body()
    first = np.sqrt(la.eigvalsh(model.K.toarray(), model.M.toarray())[6]) / (2 * np.pi)
    assert f"ring: 3 interface frames, 12 modes, first elastic frequency {first:g} Hz" in done.stdout, done.stderr
