"""Stability of the reduced system: by the energies of its bodies, or by its roots."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.assemble import modal_substructure, state_space
from cmsreduce.linalg.blocks import dense
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.pipeline import Run
from cmsreduce.pipeline.system import AssembledModel, stability_proof, system_roots, without_energy
from cmsreduce.pipeline.system.stability import SystemRoots
from cmsreduce.reduce import CraigBampton
from tests.frames import line


def oscillating(s: np.ndarray) -> np.ndarray:
    s = s[s.imag > 1e-3]
    return s[np.argsort(abs(s), kind="stable")]


def test_energies_prove_a_system_without_its_roots(opened: Callable[..., Run], monkeypatch: pytest.MonkeyPatch) -> None:
    from cmsreduce.pipeline.system import measure as module

    monkeypatch.setattr(module, "system_roots", lambda *_: pytest.fail("no roots are needed"))
    proof = opened().stability
    assert proof.state == "proven" and proof.digits == pytest.approx(9)


def test_roots_are_those_of_the_state_space(opened: Callable[..., Run]) -> None:
    run = opened()
    for configuration in run.scene.configurations:
        found = system_roots(run.model.assembled, configuration)
        assert found is not None and not found.growing.size
        expected = la.eigvals(state_space(run.model.assembled.system(configuration)).A)
        np.testing.assert_allclose(oscillating(found.s), oscillating(expected), rtol=1e-7)


def test_damped_shapes_without_mass_have_a_root_each(opened: Callable[..., Run]) -> None:
    """Beta K damps them: 1 / mu of the reversed pencil, in which they are regular."""
    overrides = [f"components.{name}.damping={{rayleigh: {{beta: 1e-4}}}}" for name in ("arm", "panel")]
    run = opened("reduce.static_above=8", *overrides)
    configuration = run.scene.configurations[0]
    system = run.model.assembled.system(configuration)
    _, _, static = run.model.assembled.every_mode(configuration)
    assert static.shape[1] > 0
    found = system_roots(run.model.assembled, configuration)
    assert found is not None and not found.growing.size
    assert found.s.size == 2 * (system.N - static.shape[1]) + static.shape[1]
    M, K, D = (dense(A) for A in (system.M, system.K, system.D))
    # s^2 M + s D + K = 0 with s = 1 / mu, and a shift off the rigid motions.
    shift = 50.0
    K_s, D_s = K + shift * D + shift**2 * M, D + 2 * shift * M
    N = system.N
    mu = la.eigvals(np.block([[-la.solve(K_s, D_s), -la.solve(K_s, M)], [np.eye(N), np.zeros((N, N))]]))
    expected = oscillating(1 / mu[abs(mu) > 1e-9] + shift)
    ours = oscillating(found.s)
    low = abs(ours) < 2 * np.pi * 200
    assert low.sum() > 2
    np.testing.assert_allclose(ours[low], expected[: low.sum()], rtol=1e-6)


@pytest.mark.parametrize("zeta", [-1e-2, -1e-7])
def test_a_root_that_grows_is_named(opened: Callable[..., Run], zeta: float) -> None:
    run = opened()
    model, configuration = run.model.assembled, run.scene.configurations[1]
    subs = dict(model.substructures)
    arm, panel = subs["arm"], subs["panel"]
    w = np.where(np.isfinite(arm.omega), arm.omega, 0.0)
    subs["arm"] = replace(arm, D=sp.csc_array(np.diag(2 * zeta * w)))
    subs["panel"] = replace(panel, D=None)
    model = AssembledModel(subs, run.scene)
    assert without_energy(subs, ()) == "the damping of 'arm'"
    # The word of a factor counts for a body in its dofs alone.
    assert without_energy(subs, ("arm",)) != ""
    found = system_roots(model, configuration)
    assert found is not None and found.growing.size
    worst = found.growing[0]
    assert zeta * 1.001 <= -worst.real / abs(worst) < 0
    proof = stability_proof({configuration.name: found}, "the damping of 'arm'")
    assert proof.state == "refuted" and f"configuration '{configuration.name}'" in proof.remark
    assert f"{abs(worst) / (2 * np.pi):.6g} Hz" in proof.remark


def test_a_mode_that_gains_below_the_digits_of_the_file_is_left_to_the_roots() -> None:
    """A fine bar in single precision: the rounding of the matrix hides a ratio of -3 %, its projection does not."""
    body = line("bar", [0, 0, 0], [0.8, 0, 0], 200)
    lam, V = la.eigh(body.K.toarray(), body.M.toarray())
    w, momentum = np.sqrt(lam[7]), body.M @ V[:, [7]]
    for zeta in (0.01, -0.03):
        D = 1e-5 * body.K.toarray() - (1e-5 * w**2 - 2 * zeta * w) * momentum @ momentum.T
        coarse = replace(body, D=sp.csc_array(D.astype(np.float32).astype(float)), rounding=2.0**-24)
        modal = orthogonalise(CraigBampton(cutoff_hz=500.0).reduce(coarse))
        bar = modal_substructure(modal, [])
        least = modal.zeta[modal.elastic].min()
        assert (without_energy({"bar": bar}, ()) != "") == (least < 0)
        assert zeta > 0 or least < -0.01
        assert not modal.D[:, :6].any()


def test_an_undamped_system_stands_still(opened: Callable[..., Run]) -> None:
    run = opened("components.arm.damping=null", "components.panel.damping=null", "balance=null")
    for configuration in run.scene.configurations:
        found = system_roots(run.model.assembled, configuration)
        assert found is not None and not found.growing.size
    assert run.stability.state == "proven"


def test_unknown_roots_prove_nothing() -> None:
    still = SystemRoots(np.array([-1.0 + 5j, -1.0 - 5j]), np.zeros(2))
    proof = stability_proof({"as built": still, "turned": None}, "the controller")
    assert proof.state == "unproven" and "'turned'" in proof.remark
    grows = SystemRoots(np.array([0.1 + 5j, 0.1 - 5j]), np.zeros(2))
    assert stability_proof({"as built": grows, "turned": None}, "the controller").state == "refuted"
