"""`cmsreduce new NAME FILE...`: from a body's files to a pipeline that runs, or to a message of what is wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.io
from click.testing import CliRunner
from pyyeti.nastran import op4

from cmsreduce.cli import main
from cmsreduce.config import body_pipeline, load_pipeline
from cmsreduce.errors import ConfigError, ReadError
from cmsreduce.pipeline.bodies import draft_body
from tests.pipeline.study import write_study

SAMPLES = Path(__file__).parents[3] / "sample_models"


@pytest.fixture
def arm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    write_study(tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def typed(*words: str) -> tuple[int, str]:
    done = CliRunner().invoke(main, words)
    assert isinstance(done.exception, SystemExit | None), done.exception
    return done.exit_code, done.output


@pytest.mark.parametrize(
    ("sample", "mount", "far", "axes", "hz"),
    [
        # First elastic frequencies by scipy on the sample's matrices.
        ("galileo/rotor", "{node: 1001}", 1312, "xyz", 0.150298),
        ("galileo/stator", "{node: 2001}", 2024, "xyz", 3.2508),
        # Moves in one plane.
        ("hub_beams/right", "{node: 101}", 141, "y", 1.407537),
    ],
)
def test_samples(sample: str, mount: str, far: int, axes: str, hz: float) -> None:
    files = [SAMPLES / f"{sample}.{kind}" for kind in ("bdf", "op4")]
    draft = draft_body("body", files)
    assert (draft.interface, draft.far, draft.axes, draft.remark) == (mount, far, axes, "")
    assert draft.elastic_hz == pytest.approx(hz, rel=1e-4)


@pytest.mark.shared
def test_a_superelement_is_joined_at_its_boundary(shared_data: Path) -> None:
    draft = draft_body("inboard", [shared_data / "nas2cam" / "inboard.asm"])
    assert (draft.interface, draft.node, draft.remark) == ("{set: b}", 3, "")
    assert draft.extseout == shared_data / "nas2cam" / "inboard"


def test_a_stranger_gets_a_checked_component(arm: Path) -> None:
    code, said = typed("new", "mine", "arm.op4", "arm.bdf")
    assert (code, said) == (0, "mine.yaml written; look at the lines marked CHECK, then: cmsreduce run mine.yaml\n")
    assert (arm / "mine.yaml").read_text().count("CHECK:") == 3
    code, said = typed("run", "mine.yaml", "--quiet")
    assert (code, said) == (0, "")
    code, said = typed("check", "build/mine/mine.h5")
    assert code == 0 and "checks passed" in said


@pytest.mark.parametrize("keep", ["all", "{frf_error: 0.01}", "{modes: 4}"])
def test_a_body_that_nothing_joins_is_ranked(arm: Path, keep: str) -> None:
    """Without joints there are no joint forces to solve for."""
    typed("new", "mine", "arm.op4", "arm.bdf")
    code, said = typed("run", "mine.yaml", "--quiet", "--set", f"balance.keep={keep}", "--set", "verify={}")
    assert (code, said) == (0, "")


def test_matrices_in_files_of_their_own(arm: Path) -> None:
    read = op4.read("arm.op4")
    for name, letter in (("stiffness", "k"), ("mass", "m")):
        scipy.io.mmwrite(f"{name}_of_arm.mtx", np.asarray(next(v for n, v in read.items() if n[0].lower() == letter)))
    draft = draft_body("arm", [Path("mass_of_arm.mtx"), Path("arm.bdf"), Path("stiffness_of_arm.mtx")])
    assert draft.stiffness[0] == Path("stiffness_of_arm.mtx")
    assert draft.mass[0] == Path("mass_of_arm.mtx")


def test_files_that_do_not_fit_are_named_and_nothing_is_lost(arm: Path) -> None:
    code, said = typed("new", "mine", "arm.op4", "panel.bdf")
    assert code == 0
    assert "warning: the files do not fit together yet: body 'mine'" in said
    assert load_pipeline(Path("mine.yaml")).components["mine"].geometry.file == Path("panel.bdf")
    assert typed("new", "mine", "arm.op4", "arm.bdf")[0] == 2


@pytest.mark.parametrize(
    ("files", "message"),
    [
        (["gone.op4"], "there is no such file"),
        (["arm.bdf", "panel.bdf"], "several decks or meshes: arm.bdf, panel.bdf"),
        (["arm.bdf"], "no matrix is clearly the stiffness.*matrices found: none"),
        (["odd.op4", "arm.bdf"], "no matrix is clearly the stiffness.*found: A in odd.op4, B in odd.op4"),
    ],
)
def test_bad_files(arm: Path, files: list[str], message: str) -> None:
    op4.write("odd.op4", dict(zip(("A", "B"), op4.read("arm.op4").values(), strict=True)))
    with pytest.raises(ReadError, match=message):
        draft_body("mine", [Path(name) for name in files])
    assert typed("new", "mine", *files)[0] == 2
    assert not Path("mine.yaml").exists()


def test_names_that_cannot_be(arm: Path) -> None:
    draft = draft_body("mine", [arm / "arm.op4", arm / "arm.bdf"])
    for name in ("a b", "system"):
        with pytest.raises(ConfigError, match=name):
            body_pipeline(name, draft)
