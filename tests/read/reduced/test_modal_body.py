"""The change from modes to interface dofs: a superelement of NX Nastran comes back from amplitudes that hide it."""

from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.errors import MatrixError
from cmsreduce.model import rigid_body_shapes
from cmsreduce.read import InterfaceSpec, MatrixSource, ModalBody, in_dofs, read_body

NAS2CAM = Path(__file__).parents[4] / "shared/data/nas2cam"


@pytest.fixture(scope="module")
def inboard():
    """NX's body, and the same body in its rigid motions and 26 mixtures of its coordinates."""
    if not NAS2CAM.is_dir():
        pytest.skip(f"{NAS2CAM} is absent")
    op4 = NAS2CAM / "inboard.op4"
    body = read_body(
        "inboard",
        stiffness=MatrixSource(op4, "KXX"),
        mass=MatrixSource(op4, "MXX"),
        geometry=NAS2CAM / "inboard.asm",
        interfaces={"all": InterfaceSpec(set="b")},
    )
    b = body.interface_rows("all")
    K, M = body.K.toarray(), body.M.toarray()
    R = rigid_body_shapes(body.dofs, body.nodes)
    rng = np.random.default_rng(3)
    T = np.hstack([R, rng.normal(size=(body.n, body.n - 6)) / np.sqrt(abs(K).max(axis=0))[:, None]])
    hidden = T.T @ K @ T
    hidden[:6] = hidden[:, :6] = 0.0
    modal = ModalBody("inboard", hidden, T.T @ M @ T, np.zeros_like(K), body.dofs[b], T[b], body.nodes)
    return body, b, modal


def test_stiffness_and_mass_of_the_boundary_are_those_of_nx(inboard):
    body, b, modal = inboard
    found = in_dofs(modal, {"all": InterfaceSpec(tuple(dict.fromkeys(body.dofs.node[b].tolist())))})
    assert found.dofs.labels[: b.size] == [body.dofs.labels[row] for row in b]
    for letter in ("K", "M"):
        expected = getattr(body, letter).toarray()[np.ix_(b, b)]
        at_boundary = getattr(found, letter).toarray()[: b.size, : b.size]
        np.testing.assert_allclose(at_boundary, expected, rtol=0, atol=1e-9 * abs(expected).max())
    K, M = (A.toarray()[b.size :, b.size :] for A in (found.K, found.M))
    # NX prints the fixed-interface frequencies of the body.
    hz = np.sqrt(1 / np.sort(la.eigvalsh(M, K))[::-1][:3]) / (2 * np.pi)
    np.testing.assert_allclose(hz, [6.12934551, 6.1301342, 23.6318766], rtol=2e-8)
    assert found.tied is None and not found.grounded


def test_the_rigid_motions_are_shown_without_any_interface(inboard):
    body, b, modal = inboard
    found = in_dofs(modal, {})
    assert found.n == body.n and found.tied is not None and len(found.tied.dofs) == b.size - 6
    R = rigid_body_shapes(found.dofs, found.nodes)
    expected = rigid_body_shapes(body.dofs, body.nodes)
    np.testing.assert_allclose(R.T @ found.M @ R, expected.T @ body.M @ expected, rtol=1e-8, atol=1e-8)
    assert (R.T @ found.M @ R)[0, 0] == pytest.approx(1.755052, rel=1e-6)


def test_a_dof_that_no_mode_moves_is_named(inboard):
    body, b, modal = inboard
    still = modal.shapes.copy()
    still[2] = 0.0
    held = ModalBody("inboard", modal.K, modal.M, modal.D, modal.dofs, still, modal.nodes)
    node = int(body.dofs.node[b[0]])
    with pytest.raises(MatrixError, match=rf"6 interface dofs in 5 independent ways only; no mode moves {node}\.3"):
        in_dofs(held, {"first": InterfaceSpec((node,))})
