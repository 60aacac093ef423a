"""Component files of a run: the same bytes for the same run, and all that the run had in memory."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import h5py
import numpy as np
import pytest

from cmsreduce.pipeline import Run, execute
from cmsreduce.write import read_component
from cmsreduce.write import system as system_module
from cmsreduce.write.component import component as component_module


def clock(second: int) -> type[datetime]:
    class Clock(datetime):
        @classmethod
        def now(cls, tz: object = None) -> datetime:
            return datetime(2024, 1, 1, 0, 0, second, tzinfo=UTC)

    return Clock


def written(opened: Callable[..., Run], study: Path, monkeypatch: pytest.MonkeyPatch, second: int) -> dict[str, bytes]:
    shutil.rmtree(study.parent / "out", ignore_errors=True)
    monkeypatch.setattr(component_module, "datetime", clock(second))
    execute(opened(), study, report=False)
    return {name: (study.parent / "out" / f"{name}.h5").read_bytes() for name in ("arm", "panel")}


def test_the_same_run_writes_the_same_bytes(
    opened: Callable[..., Run], study: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = written(opened, study, monkeypatch, 1)
    # Finished stages read back give what they gave when they were made.
    execute(opened(), study, report=False)
    assert (study.parent / "out" / "arm.h5").read_bytes() == first["arm"]
    later = written(opened, study, monkeypatch, 2)
    for name, content in later.items():
        assert len(content) == len(first[name])
        # The time stamp's last digit, and the checksum of the header it stands in, if it has one.
        differ = np.flatnonzero(np.frombuffer(content, np.uint8) != np.frombuffer(first[name], np.uint8))
        assert 1 <= differ.size <= 5


def test_measured_times_are_in_no_hdf5_file(
    opened: Callable[..., Run], study: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def contents() -> dict[str, bytes]:
        shutil.rmtree(study.parent / "out", ignore_errors=True)
        execute(opened("balance.keep={frf_error: 0.05}"), study, report=False)
        return {path.name: path.read_bytes() for path in sorted((study.parent / "out").glob("*.h5"))}

    for module in (component_module, system_module):
        monkeypatch.setattr(module, "datetime", clock(1))
    first = contents()
    assert first.keys() == {"arm.h5", "panel.h5", "system.h5"}
    # Every measured time differs from that of the first run.
    began = time.perf_counter
    monkeypatch.setattr(time, "perf_counter", lambda: 3 * began())
    assert contents() == first


def test_a_component_file_is_the_component_in_memory(opened: Callable[..., Run], study: Path) -> None:
    run = opened("write.all_nodes=true", "balance.keep={modes: {arm: 9, panel: 12}}")
    result = execute(run, study, report=False)
    assert result is not None
    for name, modal in run.kept.items():
        file = read_component(study.parent / "out" / f"{name}.h5")
        assert (file.name, file.method, file.rigid_count) == (name, modal.method, modal.rigid_count)
        np.testing.assert_array_equal(file.omega, modal.omega)
        np.testing.assert_array_equal(file.arrays["modes/zeta"], modal.zeta)
        np.testing.assert_array_equal(file.arrays["modes/sigma"], modal.sigma)
        np.testing.assert_array_equal(file.arrays["dofs/shapes"], modal.Phi)
        np.testing.assert_array_equal(file.arrays["dofs/node"], modal.body.dofs.node)
        assert file.texts["modes/why"] == modal.why
        assert [check.value for check in file.checks] == [check.value for check in result.components[name].checks]
        assert all(check.passed for check in file.checks)
        assert file.settings["balance"]["keep"]["modes"] == {"arm": 9, "panel": 12}


def test_inputs_and_outputs_are_those_of_the_system(opened: Callable[..., Run], study: Path) -> None:
    """The bodies of the files, joined by their interface shapes alone, answer as the run's own reduced system."""
    run = opened()
    execute(run, study, report=False)
    arm, panel = (read_component(study.parent / "out" / f"{name}.h5") for name in ("arm", "panel"))
    # The motor turns the second interface against the first.
    np.testing.assert_allclose(arm.arrays["inputs/B"][:, 0], -arm.arrays["interfaces/tip/shapes"][4], atol=1e-14)
    np.testing.assert_allclose(panel.arrays["inputs/B"][:, 0], panel.arrays["interfaces/root/shapes"][4], atol=1e-14)
    node = panel.arrays["nodes/id"].tolist().index(6)
    np.testing.assert_allclose(panel.arrays["outputs/C1"][0], panel.arrays["nodes/translation"][node, 2], atol=1e-14)
    assert (arm.texts["inputs/name"], panel.texts["outputs/name"]) == (("motor",), ("probe",))
    m, n = arm.omega.size, panel.omega.size
    # The hub's six motions, about its centre of mass; its face is 0.1 ahead of it and 0.05 below.
    hub = np.eye(6)
    hub[:3, 3:] = -np.array([[0, 0.05, 0], [-0.05, 0, -0.1], [0, 0.1, 0]])
    A = np.zeros((11, 6 + m + n))
    A[:6, :6], A[:6, 6 : 6 + m] = -hub, arm.arrays["interfaces/root/shapes"]
    locked = [0, 1, 2, 3, 5]
    A[6:, 6 : 6 + m] = -arm.arrays["interfaces/tip/shapes"][locked]
    A[6:, 6 + m :] = panel.arrays["interfaces/root/shapes"][locked]
    T = np.linalg.svd(A)[2][11:].T
    J = np.array([[0.2, 0.01, 0], [0.01, 0.3, 0], [0, 0, 0.25]])
    M = np.eye(6 + m + n)
    M[:6, :6] = np.block([[5 * np.eye(3), np.zeros((3, 3))], [np.zeros((3, 3)), J]])
    omega = np.concatenate([np.zeros(6), arm.omega, panel.omega])
    K, D = np.diag(omega**2), np.diag(2 * 0.01 * omega)
    B = np.zeros((6 + m + n, 2))
    B[6:, 0] = np.concatenate([arm.arrays["inputs/B"][:, 0], panel.arrays["inputs/B"][:, 0]])
    B[1:3, 1] = 1.0
    w = 2 * np.pi * np.array([3.0, 17.0, 41.0, 58.0])
    ours = run.model.assembled.response(run.scene.configurations[0], w)
    assert run.scene.configurations[0].name == "hinge=0"
    for k, s in enumerate(1j * w):
        x = T @ np.linalg.solve(T.T @ (s**2 * M + s * D + K) @ T, T.T @ B)
        y = np.vstack([s * x[4], s * x[5], panel.arrays["outputs/C1"][0] @ x[6 + m :]])
        np.testing.assert_allclose(ours[k], y, rtol=1e-7, atol=1e-9 * abs(y).max())


def test_the_file_says_where_it_came_from(opened: Callable[..., Run], study: Path) -> None:
    import hashlib

    execute(opened(), study, report=False)
    with h5py.File(study.parent / "out" / "arm.h5") as file:
        group = file["provenance"]
        hashes = dict(zip(group["source"][()].astype(str), group["sha256"][()].astype(str), strict=True))
    for name in ("arm.op4", "arm.bdf"):
        assert hashes[name] == hashlib.sha256((study.parent / name).read_bytes()).hexdigest()
