"""`project: {responses: ...}`: shapes from the scene's responses in a run."""

from __future__ import annotations

import json
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from click.testing import CliRunner

from cmsreduce.cli import main
from cmsreduce.config import load_pipeline
from cmsreduce.errors import ConfigError
from cmsreduce.model import Configuration, Joint, Point, Scene
from cmsreduce.pipeline import Run, Silent
from cmsreduce.pipeline.project import range_errors, response_shapes
from cmsreduce.pipeline.project.articulation_range import ArticulationRange
from cmsreduce.pipeline.project.response_samples import SampledScene
from cmsreduce.project import shape_search
from cmsreduce.verify import channel_scales, frequency_grids, frf_error
from tests.beam_chain import write_beam_chain
from tests.pipeline.study import write_study
from tests.two_beams import write_two_beams

STRETCH = "scene.sensors.stretch={between: [arm.1, arm.4]}"
LIMITS = "verify.limits={frf_error: 0.02, db_error: 1.0}"


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_study(tmp_path_factory.mktemp("study"))


def opened(study: Path, *overrides: str) -> Run:
    return Run(load_pipeline(study, [LIMITS, *overrides]), study.parent / "opened", Silent())


@pytest.fixture(scope="module")
def given(study: Path) -> Run:
    run = opened(study, "project={responses: {arm: 6, panel: 6}, between: false}")
    assert run.projected is not None
    return run


def test_the_responses_are_those_of_the_assembled_reduced_bodies(given: Run) -> None:
    """Two codes: joint forces between bodies in shapes, and the matrices of the reduced component files."""
    source = given.joined(given.kept)
    sampled = SampledScene(source, given.kept, given.comparison.reference)
    shapes = {
        name: given.kept[name].Phi[:, given.kept[name].elastic].T @ (c.body.M @ c.Phi[:, c.elastic])
        for name, c in given.final.items()
    }
    configurations = list(given.scene.configurations)
    scene = sampled.responses(configurations)
    for each, sample, joined in zip(configurations, scene.samples, scene.joined(shapes), strict=True):
        H = given.model.assembled.response(each, sample.omega)
        assert (abs(joined.H - H) <= 1e-9 * abs(H).max(axis=0)).all()
    point = sampled.judge(configurations[1])
    (result,) = given.comparison.at(configurations[1:], {"reduced": given.model})
    frf, decibel = point.errors(shapes)
    assert decibel == pytest.approx(result.errors["reduced"].db_error, rel=1e-6)
    # The grids differ.
    assert frf == pytest.approx(result.errors["reduced"].frf_error, rel=0.05)
    # Between the angles of the scene, without modes of the system.
    some = ArticulationRange(given.scene).random(3, 2)
    for result, screened in zip(
        given.comparison.at(some, {"reduced": given.model}), given.comparison.screened(some, given.model), strict=True
    ):
        errors = result.errors["reduced"]
        assert screened[0] == pytest.approx(errors.frf_error, rel=0.05)
        assert screened[1] == pytest.approx(errors.db_error, rel=1e-6)


def test_a_stretch_of_a_floating_body_is_heard_where_it_is_judged(study: Path) -> None:
    """Rigid motion of the same unit is a million times as large at the lower end of the band."""
    run = opened(study, "project={responses: {arm: 3, panel: 3}, between: false}", STRETCH)
    configuration = run.scene.configurations[0]
    sampled = SampledScene(run.joined(run.kept), run.kept, run.comparison.reference)
    shapes = {
        name: run.kept[name].Phi[:, run.kept[name].elastic].T @ (c.body.M @ c.Phi[:, c.elastic])
        for name, c in run.final.items()
    }
    (result,) = run.comparison.at([configuration], {"reduced": run.model})
    errors = result.errors["reduced"]
    assert errors.loud is not None and errors.loud[-1].any()
    (sample,) = sampled.responses([configuration]).samples
    assert sample.heard[errors.loud].all()
    _, decibel = sampled.judge(configuration).errors(shapes)
    assert decibel == pytest.approx(errors.db_error, rel=1e-6)
    assert decibel == pytest.approx(np.nanmax(errors.channel_db[-1]), rel=1e-6)


def test_bodies_keep_their_rigid_motion_and_are_orthonormal_passive_mode_sets(given: Run) -> None:
    for name, c in given.final.items():
        own = given.kept[name]
        assert (c.elastic_count, c.rigid_count) == (6, own.rigid_count)
        np.testing.assert_allclose(c.Phi[:, :6], own.Phi[:, :6])
        np.testing.assert_allclose(c.Phi.T @ (c.body.M @ c.Phi), np.eye(12), atol=1e-9)
        np.testing.assert_allclose(c.Phi.T @ (c.body.K @ c.Phi), np.diag(c.omega**2), atol=1e-9 * c.omega[-1] ** 2)
        # Shapes of a subspace: frequencies from above, damping as positive as that of the modes.
        assert (c.omega[6:] >= own.omega[6:12] * (1 - 1e-9)).all()
        assert c.D is not None and np.linalg.eigvalsh(c.D[6:, 6:]).min() > 0
        assert all("scene shape" in why for why in c.why[6:])
    for each in given.scene.configurations:
        assert (given.model.assembled.damped_modes(each).s.real < 0).all()


def test_auto_meets_all_limits_with_fewer_shapes_than_modes(tmp_path: Path) -> None:
    path = write_two_beams(tmp_path)
    limits = "verify.limits={frf_error: 0.01, db_error: 1.0, frequency_error: 0.01, gain_error: 0.01}"
    run = Run(load_pipeline(path, [limits, "project={responses: auto}"]), tmp_path / "out", Silent())
    assert run.projected is not None
    critical = run.measure.measured(run.final, run.model).critical
    assert critical is not None and critical.ratio <= 1
    assert sum(c.elastic_count for c in run.final.values()) < 13
    record = run.projected.record
    assert record.certificate is not None and record.configurations == ("as built",)
    for estimate, bound in zip(record.certificate.estimated.values(), record.certificate.bound.values(), strict=True):
        assert 0 < estimate <= bound < 0.05
    # Another limit is another result.
    stricter = Run(
        load_pipeline(path, ["verify.limits.frf_error=0.05", "project={responses: auto}"]), tmp_path / "out", Silent()
    )
    assert sum(c.elastic_count for c in stricter.final.values()) < sum(c.elastic_count for c in run.final.values())


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """A short search on few frequencies: what is held in the range does not depend on how small the model is."""
    short: dict[ModuleType, dict[str, int]] = {
        frequency_grids: {"_DECIBEL_POINTS": 250},
        range_errors: {"_CLIMBED": 1},
        response_shapes: {"_FIRST": 2, "_FIRST_BETWEEN": 1, "_LOOKED_AT": 9, "_PROOF": 18},
        shape_search: {"_SPLITS": 0, "_FEW_ROUNDS": 1, "_ROUNDS": 1, "_STEPS": 20},
    }
    for module, values in short.items():
        for name, value in values.items():
            monkeypatch.setattr(module, name, value)


@pytest.mark.usefixtures("short")
def test_auto_holds_the_limit_in_the_whole_range(study: Path) -> None:
    limits = ["verify.limits={frf_error: 0.2}", "scene.articulation={hinge: [0, 90 deg]}"]
    run = opened(study, *limits, "project={responses: auto}")
    assert run.projected is not None
    record = run.projected.record
    # Angles of the scene, one between them to begin with, and those that were added for their errors.
    assert set(record.configurations) > {"hinge=0", "hinge=90"} and len(record.configurations) > 3
    assert len(record.between) > 8 and max(record.between.values()) <= 0.2
    unseen = ArticulationRange(run.scene).random(12, 5)
    assert max(run.comparison.quick_errors(unseen, run.model)) <= 0.2
    assert sum(c.elastic_count for c in run.final.values()) < sum(c.elastic_count for c in run.kept.values())


@pytest.mark.usefixtures("short")
def test_two_hinges_that_turn_independently_hold_the_limit_at_any_angles(tmp_path: Path) -> None:
    """At random pairs of angles, by solves of the unreduced bodies."""
    path = write_beam_chain(tmp_path)
    # What holds the limit at the angles of the scene alone breaks it at these random ones.
    angles = ["scene.articulation={first: [0, 60 deg], second: [-40 deg, 40 deg]}", "scene.band=150 Hz"]
    settings = ["project={responses: auto}", "reduce.cutoff=10", "verify.limits={frf_error: 0.2}", *angles]
    run = Run(load_pipeline(path, settings), tmp_path / "out", Silent())
    assert run.projected is not None
    span = ArticulationRange(run.scene)
    assert len(span.axes) == 2 and len(run.projected.record.between) > 8
    # With the first hinge straight, a motor moves nothing in the other plane; beside it, it does.
    beside = [name for name in run.projected.record.configurations if name.startswith("first.ry=0.03 ")]
    assert [name.split("=")[-1] for name in beside] == ["-40"]
    for each in span.random(6, 7):
        found = run.model.assembled.resonances(each)
        w = frequency_grids.frequency_grid(run.scene.band, 200, found.omega, found.zeta)
        H, H_r = run._solved_directly(each, w), run.model.assembled.response(each, w)
        rigid = run.model.assembled.rigid_response(each, w)
        scales = channel_scales(run.scene.actuators, run.scene.sensors, H - rigid, H, w)
        assert frf_error(w, H - rigid, H_r - rigid, *scales) <= 0.2
    assert sum(c.elastic_count for c in run.final.values()) < sum(c.elastic_count for c in run.kept.values())


def test_a_run_writes_its_shapes_and_their_certificate(tmp_path: Path) -> None:
    path = write_two_beams(tmp_path)
    keys = ("--set", "project={responses: 7}", "--out", str(tmp_path / "out"), "--verbose")
    result = CliRunner().invoke(main, ["run", str(path), *keys])
    assert result.exit_code == 0, result.output
    assert "scene shapes: 4 of right, 3 of left" in " ".join(result.output.split())
    found = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert found["projection"]["rank"] == {"right": 4, "left": 3}
    certificate = found["projection"]["certificate"]
    assert certificate["estimated"].keys() == certificate["bound"].keys() == {"as built"}
    assert len(certificate["solved"]) == 2 and certificate["reference"] == {"right": "modes", "left": "modes"}
    assert "Errors by residuals" in (tmp_path / "out" / "report.html").read_text()


# The hub, which alone is driven, is held by the ground at the arm's root.
SILENT = ["scene.ground=arm.root", "scene.actuators={push: {at: hub.cg, force: [0, 1, 1]}}", "balance=null"]


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        (["project={responses: {wing: 3}}"], "no reduced body 'wing'"),
        (["project={responses: {arm: 3}}"], "state a number of shapes of 'panel'"),
        (["project={responses: {arm: 400, panel: 3}}"], "400 shapes of 'arm' are more than"),
        (["project={responses: 4000}"], "4000 shapes of all bodies are more than"),
        (["project={responses: auto}", "scene.sensors={}"], "project.responses needs a response"),
        (["project={responses: auto}", *SILENT], "no body has an elastic mode"),
        (["project={responses: 0}", *SILENT], "no body has an elastic mode"),
        (["project={responses: auto, modes: auto}"], "`responses` takes no system modes"),
    ],
)
def test_what_is_asked_must_exist(study: Path, keys: list[str], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        _ = opened(study, *keys).projected


def scene(*angles: dict[tuple[str, int], float]) -> Scene:
    joint = Joint("hinge", Point("a", "x"), Point("b", "x"), frozenset({0, 5}))
    named = tuple(Configuration(str(number), each) for number, each in enumerate(angles))
    return Scene(("a", "b"), (0.0, 1.0), (joint,), configurations=named)


def test_the_range_is_a_box_a_whole_turn_or_a_path() -> None:
    slide, turn = ("hinge", 0), ("hinge", 5)
    box = ArticulationRange(scene(*({slide: s, turn: t} for s in (0.0, 2.0) for t in (0.0, 1.0, 3.0))))
    assert box.is_box and not box.turning.any()
    every = np.array([[each.angles[slide], each.angles[turn]] for each in box.points(64)])
    assert every.min() >= 0 and (every.max(axis=0) <= [2, 3]).all()
    # Evenly: each quarter of the box has its share.
    assert 12 <= np.count_nonzero((every < [1, 1.5]).all(axis=1)) <= 20
    around = ArticulationRange(scene({turn: 0.0}, {turn: 3.5}))
    assert around.apart(Configuration("", {turn: 0.1}), Configuration("", {turn: 2 * np.pi - 0.1})) < 0.04
    assert around.turning.all() and around.high[0] == pytest.approx(2 * np.pi)
    path = ArticulationRange(scene({slide: 0.0, turn: 0.0}, {slide: 1.0, turn: 0.5}, {slide: 1.0, turn: 2.5}))
    assert not path.is_box
    for each in path.random(20, 1):
        s, t = each.angles[slide], each.angles[turn]
        assert t == pytest.approx(s / 2) or (s == pytest.approx(1) and 0.5 <= t <= 2.5)
    assert ArticulationRange(scene({turn: 0.0})).is_point and not ArticulationRange(scene({turn: 0.0})).points(5)
