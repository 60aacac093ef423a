"""State space in .mat files: read by scipy and control, the response of the assembled model, balanced states."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest
from scipy.io import loadmat

from cmsreduce.config import load_pipeline
from cmsreduce.errors import CmsReduceError
from cmsreduce.pipeline import Run, execute
from tests.pipeline.study import CANTILEVER, Log, write_study

STATES = 8
WRITTEN = f"write={{formats: [hdf5, matlab], balanced_states: {STATES}}}"
FEW = ("reduce.cutoff=4", "balance.keep=all", "verify.frf.points=20")


def structures(path: Path) -> Any:
    return np.atleast_1d(loadmat(path, squeeze_me=True, struct_as_record=False)["configuration"])


def model(part: Any) -> control.StateSpace:
    n, m, p = np.shape(part.A)[0], np.size(part.inputs), np.size(part.outputs)
    return control.ss(part.A, np.reshape(part.B, (n, m)), np.reshape(part.C, (p, n)), np.reshape(part.D, (p, m)))


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Run:
    path = write_study(tmp_path_factory.mktemp("written"))
    pipeline = load_pipeline(path, (WRITTEN, *FEW))
    run = Run(pipeline, pipeline.output, Log())
    execute(run, path, report=False)
    return run


def test_the_system_answers_as_it_does_when_assembled(written: Run) -> None:
    omega = 2 * np.pi * np.linspace(1, 55, 40)
    parts = structures(written.folder / "system.mat")
    assert [part.name for part in parts] == [c.name for c in written.scene.configurations]
    for part, configuration in zip(parts, written.scene.configurations, strict=True):
        assert list(part.inputs) == [channel.name for channel in written.scene.actuators]
        H = model(part)(1j * omega).transpose(2, 0, 1)
        expected = written.model.assembled.response(configuration, omega)
        np.testing.assert_allclose(H, expected, rtol=0, atol=1e-8 * abs(expected).max())


def test_the_balanced_model_keeps_its_bound_beside_the_rigid_motions(written: Run) -> None:
    omega = 2 * np.pi * np.linspace(0.5, 55, 400)
    s = 1j * omega[:, None, None]
    for part in structures(written.folder / "system.mat"):
        small = part.balanced
        assert np.shape(small.A) == (STATES, STATES) and len(small.coordinates) == STATES // 2
        rigid = (small.rigid_C1 + s * small.rigid_C2) @ small.rigid_B / s**2
        whole = model(part)(1j * omega).transpose(2, 0, 1)
        balanced = control.ss(small.A, small.B, small.C, small.D)(1j * omega).transpose(2, 0, 1)
        miss = max(np.linalg.norm(G, 2) for G in whole - rigid - balanced)
        assert 0 < miss <= small.bound * (1 + 1e-6)
        assert small.condition == pytest.approx(np.linalg.cond(small.P), rel=1e-9)
        assert small.bound == pytest.approx(2 * small.hankel[STATES:].sum(), rel=1e-12)
    assert any("cond(P_r)" in note for note in written.stages.notes)


def test_a_component_has_its_modes_and_names(written: Run) -> None:
    kept = written.kept["panel"]
    file = loadmat(written.folder / "panel.mat", squeeze_me=True)
    m = kept.omega.size
    assert list(file["inputs"]) == ["motor", *(f"root.1.{c}" for c in range(1, 7))]
    assert list(file["outputs"]) == ["probe", *(f"root.1.{c}" for c in range(1, 7))]
    # Poles are those of the modes: two at zero for each rigid one.
    poles = np.sort(abs(np.linalg.eigvals(file["A"])))
    np.testing.assert_allclose(poles[12:], np.repeat(kept.omega[6:], 2), rtol=1e-6)
    assert poles[:12].max() < 1e-3
    np.testing.assert_allclose(file["frequency_hz"], kept.omega / (2 * np.pi))
    # The panel by itself, at its root: flexibility of its modes.
    w, zeta, shape = 2 * np.pi * 31.0, kept.zeta[6:], kept.Phi[kept.body.interface_rows("root")]
    H = model(_named(file))(1j * w)[1:, 1:]
    q = 1 / (kept.omega[6:] ** 2 - w**2 + 2j * zeta * kept.omega[6:] * w)
    expected = shape[:, 6:] * q @ shape[:, 6:].T - shape[:, :6] @ shape[:, :6].T / w**2
    np.testing.assert_allclose(H, expected, rtol=0, atol=1e-9 * abs(expected).max())
    assert file["A"].shape == (2 * m, 2 * m)


def _named(file: dict[str, Any]) -> Any:
    return type("Part", (), {name: file[name] for name in ("A", "B", "C", "D", "inputs", "outputs")})


def test_equal_input_gives_equal_bytes(opened: Callable[..., Run], study: Path) -> None:
    contents = []
    for _ in range(2):
        run = opened(WRITTEN, *FEW)
        execute(run, study, report=False)
        contents.append([(run.folder / name).read_bytes() for name in ("panel.mat", "system.mat")])
    assert contents[0] == contents[1]


def test_only_the_formats_asked_for_are_written(opened: Callable[..., Run], study: Path) -> None:
    run = opened("write.formats=[matlab]", *FEW)
    execute(run, study, report=False)
    assert {path.name for path in run.folder.glob("*.mat")} == {"arm.mat", "panel.mat", "system.mat"}
    assert not list(run.folder.glob("*.h5"))


@pytest.mark.parametrize(
    ("settings", "words"),
    [(("write.balanced_states=60",), "ask for fewer")],
)
def test_a_state_space_that_does_not_exist_fails_alone(
    opened: Callable[..., Run], study: Path, settings: tuple[str, ...], words: str
) -> None:
    run = opened(WRITTEN, *FEW, *settings)
    result = execute(run, study, report=False)
    assert result is not None and result.verdict.word == "FAIL"
    (failure,) = (each for each in result.failures if each.what == "the file system.mat")
    assert words in failure.reason and failure.required
    assert (run.folder / "summary.json").is_file() and not (run.folder / "system.mat").exists()


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (("write.formats=[hdf5]",), "add matlab"),
        (("write.balanced_states=7",), "balanced_states"),
        (("components.arm.damping={structural: 0.02}", "components.panel.damping={structural: 0.02}"), "complex stiff"),
    ],
)
def test_what_has_no_state_space_is_refused(
    opened: Callable[..., Run], study: Path, settings: tuple[str, ...], words: str
) -> None:
    with pytest.raises(CmsReduceError, match=words):
        execute(opened(WRITTEN, *FEW, *settings), study, report=False)


def test_a_held_system_has_no_rigid_part(opened: Callable[..., Run], study: Path) -> None:
    run = opened("write={formats: [matlab], balanced_states: 4}", text=CANTILEVER)
    execute(run, study, report=False)
    (part,) = structures(run.folder / "system.mat")
    assert np.size(part.balanced.rigid_B) == 0
    assert np.linalg.eigvals(part.balanced.A).real.max() < 0
