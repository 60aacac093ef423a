"""Complex modes of the full and of the reduced system, for every damping law, as the summary has them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.config import load_pipeline
from cmsreduce.linalg.eigen import DampedPencil, complex_modes, modes_below
from cmsreduce.pipeline import Run, Silent, execute
from cmsreduce.pipeline.results import check_result
from cmsreduce.pipeline.results.limits import Limits
from cmsreduce.write import summary
from tests.assemble.rigs import rigid_modes
from tests.pipeline.study import ARM_FILES, PIPELINE, arm, write_body

FREE = (
    """\
name: free
output: {output}
components:
"""
    + ARM_FILES
    + """\
    damping: {damping}
scene:
  band: 450 Hz
  actuators: {{push: {{at: arm.5, force: [0, 1, 1]}}}}
  sensors: {{tip: {{at: arm.1, measure: z}}}}
reduce: {{cutoff: {cutoff}}}
verify: {{limits: {{damping_error: {limit}}}}}
"""
)
CHAIN = """\
name: chain
output: {output}
components:
  chain:
    stiffness: {{file: {punch}, matrix: KAAX}}
    mass: {{file: {punch}, matrix: MAAX}}
    interfaces: {{dampers: {{nodes: {nodes}}}}}
    damping: {{matrix: {{file: {punch}, matrix: BAAX}}}}
scene:
  band: 4 Hz
  actuators: {{push: {{at: chain.201, force: [1, 0, 0]}}}}
  sensors: {{probe: {{at: chain.108, measure: [x]}}}}
reduce: {{cutoff: {cutoff}}}
verify: {{}}
"""

Facts = dict[str, Any]
G = 0.3
# Twelve masses in a row, two dampers across several of them that lock what lies between.
LOCKED = """\
name: locked
output: {folder}/out
components:
  row:
    stiffness: K.npz
    mass: M.npz
    geometry: row.bdf
    rows: {{file: row.rows}}
    grounded: true
    damping: {{matrix: D.npz}}
    interfaces: {{end: {{node: 12, dofs: 1}}}}
scene:
  band: {band} Hz
  actuators: {{push: {{at: row.12, force: [1, 0, 0]}}}}
  sensors: {{probe: {{at: row.4, measure: x}}}}
reduce: {{method: {method}, cutoff: 1.0}}
verify: {{limits: {{damping_error: 50 %}}}}
write: {{formats: [hdf5], all_nodes: true}}
"""


def facts_of(run: Run, source: Path) -> Facts:
    result = execute(run, source, report=False)
    assert result is not None
    return summary(result)


@pytest.fixture
def free(tmp_path: Path) -> Callable[..., Facts]:
    """Run the arm by itself, floating free: the modes of the system are those of the body."""
    write_body(tmp_path, arm())

    def run(damping: str, cutoff: float = 1.0, limit: float | str = "100 %") -> Facts:
        path = tmp_path / "free.yaml"
        path.write_text(FREE.format(output=tmp_path / "out", damping=damping, cutoff=cutoff, limit=limit))
        return facts_of(Run(load_pipeline(path), tmp_path / "out", Silent()), path)

    return run


def modes_of(facts: Facts) -> dict[str, np.ndarray]:
    (configuration,) = facts["configurations"]
    return {
        key: np.array([mode[key] for mode in configuration["complex_modes"]])
        for key in ("full_hz", "full_zeta", "reduced_hz", "reduced_zeta", "mac")
    }


@pytest.mark.parametrize(
    ("damping", "ratio"),
    [
        ("{modal: 0.02}", lambda w: np.full(w.size, 0.02)),
        ("{table: [[0, 0.01], [1000, 0.03]]}", lambda w: np.interp(w / 2 / np.pi, [0, 1000], [0.01, 0.03])),
        ("{per_mode: [0.01, 0.05, 0.02]}", lambda w: np.array([0.01, 0.05] + [0.02] * (w.size - 2))),
        ("{rayleigh: {alpha: 8.0, beta: 1e-5}}", lambda w: 4 / w + 5e-6 * w),
        (f"{{structural: {G}}}", lambda w: np.full(w.size, np.sin(np.arctan(G) / 2))),
    ],
)
def test_ratios_are_those_of_the_law(
    free: Callable[..., Facts], damping: str, ratio: Callable[[np.ndarray], np.ndarray]
) -> None:
    facts = free(damping)
    body = arm()
    w, _ = modes_below(body.K, body.M, 2 * np.pi * 450, rigid=rigid_modes(body))
    modes = modes_of(facts)
    assert w.size == modes["full_hz"].size == 3
    stretch = (1 + G * G) ** 0.25 if "structural" in damping else 1.0
    np.testing.assert_allclose(modes["full_hz"], stretch * w / (2 * np.pi), rtol=1e-8)
    np.testing.assert_allclose(modes["full_zeta"], ratio(w), rtol=1e-7)
    # The reduced body has the law at its own frequencies.
    w_r = 2 * np.pi * modes["reduced_hz"] / stretch
    np.testing.assert_allclose(modes["reduced_zeta"], ratio(w_r), rtol=1e-7)
    assert facts["worst"]["damping_error"] == pytest.approx(max(abs(modes["reduced_zeta"] / modes["full_zeta"] - 1)))
    assert facts["worst"]["damping_error"] < 1e-3


def test_a_limit_on_the_damping_error_decides(free: Callable[..., Facts]) -> None:
    error = free("{rayleigh: {beta: 1e-5}}", cutoff=0.3)["worst"]["damping_error"]
    assert error > 1e-6
    assert free("{rayleigh: {beta: 1e-5}}", cutoff=0.3, limit=1.01 * error)["passed"] is True
    broken = free("{rayleigh: {beta: 1e-5}}", cutoff=0.3, limit=0.99 * error)
    assert (broken["passed"], broken["limits"]) == (False, {"damping_error": 0.99 * error})


def test_an_undamped_system_has_no_damping_error(opened: Callable[..., Run], study: Path) -> None:
    text = PIPELINE.replace("    damping: {{modal: 0.01}}\n", "").replace("rank: gregory", "rank: frequency")
    run = opened(text=text)
    facts = facts_of(run, study)
    assert facts["worst"]["damping_error"] is None
    names = {found.name for found in check_result(study.parent / "out", Limits())[0]}
    assert "frf_error" in names and "damping_error" not in names
    assert all(row["complex_modes"] is None for row in facts["configurations"])
    models = (run.comparison.reference.assembled, run.model.assembled)
    assert all(model.damped_modes(each) is None for model in models for each in run.scene.configurations)


def test_pairs_are_kept_with_a_finished_stage(opened: Callable[..., Run], study: Path) -> None:
    first, again = facts_of(opened(), study), facts_of(opened(), study)
    assert len(first["configurations"]) == 2
    for before, after in zip(first["configurations"], again["configurations"], strict=True):
        assert len(before["complex_modes"]) >= 4
        assert after["complex_modes"] == before["complex_modes"]
        assert 0 < after["damping_error"] == before["damping_error"]


def test_joined_bodies_of_unlike_damping_have_ratios_between_theirs(opened: Callable[..., Run], study: Path) -> None:
    """With viscous damping beta K in each body, zeta is a mean of beta w / 2 weighed by strain energy."""
    run = opened("components.arm.damping={rayleigh: {beta: 1e-4}}", "components.panel.damping={rayleigh: {beta: 3e-5}}")
    for row in facts_of(run, study)["configurations"]:
        for mode in row["complex_modes"]:
            w = 2 * np.pi * mode["full_hz"]
            assert 1.5e-5 * w < mode["full_zeta"] < 5e-5 * w
        assert row["damping_error"] < 0.02


@pytest.mark.shared
def test_a_damping_matrix_is_reduced_and_not_diagonalised(shared_data: Path, tmp_path: Path) -> None:
    """A chain with two dampers, whose ends are interfaces: the reduced ratios fall upon those of 15 dofs in full."""
    punch = shared_data / "chain15" / "dmig.pch"
    errors, path = [], tmp_path / "chain.yaml"
    for cutoff in (0.5, 2.0, 5.0, 20.0):
        path.write_text(CHAIN.format(output=tmp_path / "out", punch=punch, nodes=[101, 102, 301, 302], cutoff=cutoff))
        run = Run(load_pipeline(path), tmp_path / "out", Silent())
        facts = facts_of(run, path)
        errors.append(facts["worst"]["damping_error"])
        if cutoff == 2.0:
            reduced, modes = run.model.assembled.system(run.scene.configurations[0]), modes_of(facts)
    assert errors[0] > 0.1 and errors[1] < 2e-5 and errors[2] < errors[1] and errors[3] < 1e-12
    # The full roots from a companion matrix of twice the size, by another road.
    body = run.bodies["chain"].body
    K, M, D = (A.toarray() for A in (body.K, body.M, body.D))
    A = np.block([[np.zeros_like(K), np.eye(15)], [-np.linalg.solve(M, K), -np.linalg.solve(M, D)]])
    s = np.linalg.eigvals(A)
    s = s[(s.imag > 1e-3) & (abs(s) < 2 * np.pi * 4)]
    s = s[np.argsort(abs(s))]
    np.testing.assert_allclose(modes["full_hz"], abs(s) / (2 * np.pi), rtol=1e-9)
    np.testing.assert_allclose(modes["full_zeta"], -s.real / abs(s), rtol=1e-8)
    # The diagonal of D in the modes alone is 7 % off, with the same modes.
    D = sp.csc_array(reduced.D).toarray()
    alone = complex_modes(DampedPencil(reduced.K, reduced.M, np.diag(np.diag(D)), None), 8 * np.pi, reduced.rigid)
    assert abs(alone.zeta / modes["full_zeta"] - 1).max() > 0.07
    assert abs(modes["reduced_zeta"] / modes["full_zeta"] - 1).max() < 2e-5


@pytest.mark.shared
def test_dampers_inside_a_body_need_an_interface(shared_data: Path, tmp_path: Path) -> None:
    """The force of a damper is no load that the basis knows, and exact frequencies do not show it."""
    path = tmp_path / "chain.yaml"
    path.write_text(
        CHAIN.format(output=tmp_path / "out", punch=shared_data / "chain15" / "dmig.pch", nodes=[105], cutoff=20)
    )
    worst = facts_of(Run(load_pipeline(path), tmp_path / "out", Silent()), path)["worst"]
    assert worst["frequency_error"] < 1e-5
    assert worst["damping_error"] > 0.1


@pytest.mark.shared
def test_residuals_for_dampers_inside_a_body_hold_their_forces(shared_data: Path, tmp_path: Path) -> None:
    path = tmp_path / "chain.yaml"
    path.write_text(
        CHAIN.format(output=tmp_path / "out", punch=shared_data / "chain15" / "dmig.pch", nodes=[105], cutoff=20)
    )
    run = Run(load_pipeline(path, ["reduce.residuals=[dampers]"]), tmp_path / "out", Silent())
    assert facts_of(run, path)["worst"]["damping_error"] < 1e-4


@pytest.mark.shared
def test_a_damped_basis_holds_what_dampers_inside_a_body_do(shared_data: Path, tmp_path: Path) -> None:
    """The damped modes with the interface held are exact; those of the free chain follow as undamped ones do."""
    path = tmp_path / "chain.yaml"
    path.write_text(
        CHAIN.format(output=tmp_path / "out", punch=shared_data / "chain15" / "dmig.pch", nodes=[105], cutoff=4)
    )
    worst = []
    for method in ("craig-bampton", "macneal-rubin"):
        for damped in ("false", "true"):
            keys = [f"reduce.method={method}", f"reduce.damped={damped}"]
            run = Run(load_pipeline(path, keys), tmp_path / "out", Silent())
            worst.append(facts_of(run, path)["worst"]["damping_error"])
            assert ("damped" in run.modal("chain").kind) == (damped == "true")
    assert worst[0] > 0.1 and worst[2] > 0.1
    assert worst[1] < 1e-3 and worst[3] < 1e-8


def locked(folder: Path, seed: int, method: str) -> tuple[Path, list[np.ndarray], float]:
    """Write such a row; its matrices, and the top of the band in rad/s."""
    rng, n = np.random.default_rng(seed), 12
    K, D, M = np.diag([1e3] + [0.0] * (n - 1)), np.zeros((n, n)), np.diag(10 ** rng.uniform(-0.5, 0.5, n))

    def joined(i: int, j: int, value: float) -> np.ndarray:
        row = np.eye(n)[i] - np.eye(n)[j]
        return value * np.outer(row, row)

    for i in range(1, n):
        K += joined(i, i - 1, 1e3 * 10 ** rng.uniform(-0.5, 0.5))
    D = 1e-4 * K
    for _ in range(2):
        D += joined(*rng.choice(n, 2, replace=False), 10 ** rng.uniform(1.0, 2.5))
    for name, A in (("K", K), ("M", M), ("D", D)):
        sp.save_npz(folder / f"{name}.npz", sp.csc_array(A))
    (folder / "row.rows").write_text("\n".join(f"{k + 1}.1" for k in range(n)))
    (folder / "row.bdf").write_text(
        "BEGIN BULK\n" + "".join(f"GRID,{k + 1},,{k}.,0.,0.\n" for k in range(n)) + "ENDDATA\n"
    )
    s = roots_of(K, M, D)[0]
    band = 1.03 * float(np.sort(abs(s))[4])
    path = folder / "row.yaml"
    path.write_text(LOCKED.format(folder=folder, band=band / 2 / np.pi, method=method))
    return path, [K, M, D], band


def roots_of(K: np.ndarray, M: np.ndarray, D: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Oscillating roots and shapes of unit length in M, from a companion matrix."""
    n = len(K)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, D)]])
    s, Z = np.linalg.eig(A)
    X = Z[:n, s.imag > 1e-6 * abs(s)]
    return s[s.imag > 1e-6 * abs(s)], X / np.sqrt(np.einsum("ij,ij->j", X.conj(), M @ X).real)


@pytest.mark.parametrize("method", ["craig-bampton", "macneal-rubin"])
@pytest.mark.parametrize("seed", range(6))
def test_no_mode_of_the_reference_in_the_band_escapes(tmp_path: Path, seed: int, method: str) -> None:
    """From the component file: each is judged with the reduced mode that is like it, or it is named as lost."""
    path, (K, M, D), band = locked(tmp_path, seed, method)
    result = execute(Run(load_pipeline(path), tmp_path / "out", Silent()), path, report=False)
    assert result is not None
    (found,) = (each.errors["reduced"].damped for each in result.configurations)
    with h5py.File(tmp_path / "out" / "row.h5") as file:
        Phi = file["nodes/translation"][:, 0, :]
        k, m, d = (file[f"modes/{name}"][()] for name in ("stiffness", "mass", "damping"))
    (s, X), (s_r, Y) = roots_of(K, M, D), roots_of(k, m, d)
    mac = abs(X.conj().T @ M @ Phi @ Y) ** 2
    lost = [each.hz * 2 * np.pi for each in found.lost]
    for root, row in zip(s, mac, strict=True):
        if abs(root) > band:
            continue
        at, zeta = int(row.argmax()), -root.real / abs(root)
        error = abs(-s_r[at].real / abs(s_r[at]) / zeta - 1)
        if row[at] > 0.9:
            assert found.worst >= error * (1 - 1e-6) - 1e-8 or np.isclose(lost, abs(root), rtol=1e-6).any()
        if row[at] < 0.02:
            near = abs(np.log(s_r / root)).min()
            assert near < 0.02 or zeta > 0.99 or np.isclose(lost, abs(root), rtol=1e-6).any()
