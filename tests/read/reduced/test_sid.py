"""SID files: of FEMBS, whose bodies have closed forms, and of our own writer."""

from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.errors import ReadError
from cmsreduce.model import SI
from cmsreduce.read import InterfaceSpec, in_dofs, read_sid
from cmsreduce.write.targets.sid import write_sid
from tests.write.particles import particles

FORMATS = Path(__file__).parents[4] / "shared/data/formats"


def of_fembs(name: str) -> Path:
    path = FORMATS / name
    if not path.is_file():
        pytest.skip(f"{path} is absent")
    return path


def frequencies_hz(K, M):
    return np.sqrt(np.maximum(la.eigvalsh(K, M), 0)) / (2 * np.pi)


def test_all_modes_of_a_plane_beam_are_its_finite_element_stiffness():
    """Two Bernoulli elements of FEMBS; in the dofs of all three nodes the six modes are K of the textbook."""
    modal = read_sid("beam", of_fembs("example_all_ev.sid_fem"), SI)
    np.testing.assert_allclose(
        frequencies_hz(modal.K, modal.M)[3:],
        [6733.131, 21049.008, 52477.673, 83680.191, 180349.760, 360699.520],
        rtol=6e-5,
    )
    body = in_dofs(modal, {"all": InterfaceSpec((1, 2, 3))})
    # A bar of 10 x 10 mm whose deck says I = 833 mm^4.
    EA, EI, L = 2.1e11 * 100, 2.1e11 * 833, 250.0
    k = np.zeros((6, 6))
    k[np.ix_([0, 3], [0, 3])] = EA / L * np.array([[1, -1], [-1, 1]])
    k[np.ix_([1, 2, 4, 5], [1, 2, 4, 5])] = (EI / L**3) * np.array(
        [
            [12, 6 * L, -12, 6 * L],
            [6 * L, 4 * L**2, -6 * L, 2 * L**2],
            [-12, -6 * L, 12, -6 * L],
            [6 * L, 2 * L**2, -6 * L, 4 * L**2],
        ]
    )
    K = np.zeros((9, 9))
    K[:6, :6] += k
    K[3:, 3:] += k
    size = np.sqrt(np.outer(K.diagonal(), K.diagonal()))
    assert body.dofs.labels == [f"{node}.{dof}" for node in (1, 2, 3) for dof in (1, 2, 6)]
    assert abs((body.K.toarray() - K) / size).max() < 1e-9


def test_an_inertia_that_no_mass_has_is_refused():
    with pytest.raises(ReadError, match=r"centre of mass \(3.10231, 0, 0\) and inertia J at once"):
        read_sid("five", of_fembs("five_node_model.sid_fem"), SI)


@pytest.mark.parametrize("dialect", ["by-axis", "by-mode"])
def test_our_own_file_comes_back(tmp_path, dialect):
    written = particles()
    path = tmp_path / "body.sid"
    write_sid(path, written.file, written.integrals, dialect)
    modal = read_sid("body", path, SI)
    k = written.integrals.modes.size
    np.testing.assert_allclose(modal.M[:3, 6:], written.integrals.phi, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(modal.M[3:6, 6:], written.integrals.r_cross_phi, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(modal.M[3:6, 3:6], written.integrals.inertia, rtol=1e-10)
    modes = written.integrals.modes
    np.testing.assert_allclose(
        modal.K[6:, 6:], written.file.arrays["modes/stiffness"][np.ix_(modes, modes)], rtol=1e-10
    )
    first = int(modal.nodes.id[0])
    body = in_dofs(modal, {"a": InterfaceSpec((first,))})
    assert body.n == 6 + k
    expected = frequencies_hz(modal.K, modal.M)
    np.testing.assert_allclose(frequencies_hz(body.K.toarray(), body.M.toarray()), expected, rtol=1e-7, atol=1e-4)


def test_a_damaged_file_names_itself(tmp_path):
    written = particles()
    path = tmp_path / "body.sid"
    write_sid(path, written.file, written.integrals)
    text = path.read_text()
    for broken in (text[: len(text) // 2], text.replace("Cr  ", "Cx  "), text.replace("mass", "mess", 1)):
        path.write_text(broken)
        with pytest.raises(ReadError, match=r"body\.sid"):
            read_sid("body", path, SI)
