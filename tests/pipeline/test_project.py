"""The project stage: chosen modes come back, what comes along is counted and named, the error is met at every angle."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg as la
from click.testing import CliRunner

from cmsreduce.cli import main
from cmsreduce.config import load_pipeline
from cmsreduce.model import Configuration, Joint, Point, Scene
from cmsreduce.pipeline import execute
from cmsreduce.pipeline.project.system_modes import SystemModes
from cmsreduce.pipeline.run import Run
from cmsreduce.pipeline.store import Silent
from cmsreduce.pipeline.system import midpoint_configurations
from tests.pipeline.study import Log, write_study

# Relative error to which a chosen mode returns: rounding of the frequencies, whatever the spread of the bodies'.
RETURNED = 1e-12
ROOT = Path(__file__).parents[2]
SPARSE = [f"components.{name}.damping={{structural: 0.01}}" for name in ("rotor", "stator")]


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_study(tmp_path_factory.mktemp("study"))


def opened(study: Path, *overrides: str) -> Run:
    folder = study.parent / "opened"
    return Run(load_pipeline(study, ["reduce.cutoff=15", *overrides]), folder, Silent())


@pytest.fixture
def summary(study: Path, tmp_path: Path) -> Any:
    def of(*overrides: str) -> tuple[int, str, dict[str, Any]]:
        given = [part for override in overrides for part in ("--set", override)]
        result = CliRunner().invoke(main, ["run", str(study), "--out", str(tmp_path / "out"), "--verbose", *given])
        path = tmp_path / "out" / "summary.json"
        return result.exit_code, result.output, json.loads(path.read_text()) if path.is_file() else {}

    return of


@pytest.mark.parametrize("of", ["reduced", "full"])
@pytest.mark.parametrize("rule", ["{list: [1, 3]}", "{cutoff: 1.2}", "{count: 3}"])
def test_chosen_modes_return_at_every_sampled_configuration(study, rule, of):
    run = opened(study, f"project={{modes: {rule}, of: {of}}}")
    record = run.projected.record
    assert [each.configuration for each in record.sampled] == [c.name for c in run.scene.configurations]
    for each in record.sampled:
        assert each.hz.size and each.error.max() < RETURNED
        # Elastic modes of the reassembled system are the chosen and the extraneous ones, no others.
        configuration = next(c for c in run.scene.configurations if c.name == each.configuration)
        system = run.model.assembled.system(configuration)
        assert each.extraneous == each.predicted == system.N - system.rigid.shape[1] - each.hz.size
    for name, component in run.final.items():
        kept = component.elastic_count
        assert kept == record.rank[name] <= run.kept[name].elastic_count
        assert component.rigid_count == run.kept[name].rigid_count
        gram = component.Phi.T @ (component.body.M @ component.Phi)
        np.testing.assert_allclose(gram, np.eye(gram.shape[0]), atol=1e-9)


def test_all_shapes_of_a_repeated_mode_are_projected(study):
    """A cut between them would leave one shape of a space, which the solver chose: the span has to be that of all."""
    run = opened(study)
    system = run.model.assembled.system(run.scene.configurations[0])
    omega, shapes = np.array([2.0, 3.0, 3.0 * (1 + 1e-9), 5.0]), np.eye(system.N)[:, :4]
    turn = la.block_diag(1, [[0.6, -0.8], [0.8, 0.6]], 1)
    for modes, size in (([0], 1), ([1], 2), ([2, 3], 3)):
        spans = []
        for Phi in (shapes, shapes @ turn):
            chosen = SystemModes(run.scene.configurations[0], omega, Phi, system).only(np.array(modes))
            spans.append(chosen.Phi @ chosen.Phi.T)
            assert chosen.count == size
        np.testing.assert_allclose(spans[1], spans[0], atol=1e-14)


@pytest.mark.parametrize(
    ("of", "damping"), [("reduced", []), ("full", SPARSE)], ids=["reduced, all modes", "full, sparse dofs"]
)
def test_soft_modes_between_stiff_ones_return_to_rounding(tmp_path, of, damping):
    """Galileo: 0.15 Hz in bodies of 100 Hz, where an eigenproblem of K alone keeps ten digits."""
    # What lies between the angles is no part of this: its responses would take three quarters of the time.
    keys = [f"project={{modes: {{count: 12}}, of: {of}, between: false}}", "verify=null", *damping]
    record = Run(load_pipeline(ROOT / "pipelines" / "galileo.yaml", keys), tmp_path, Silent()).projected.record
    assert len(record.sampled) == 8 and min(each.hz.min() for each in record.sampled) < 0.2
    assert record.worst_return < RETURNED
    assert all(each.extraneous == each.predicted for each in record.sampled)


@pytest.mark.parametrize("rank", ["hankel", "gregory"])
def test_the_first_by_rank_is_the_mode_with_the_highest_peak(study, rank):
    """One actuator, one sensor, light damping: the largest Hankel value is half the highest peak of the response."""
    one = ["scene.articulation={}", "scene.actuators={motor: {joint: hinge, dof: ry}}",
           "scene.sensors={probe: {at: panel.6, measure: z}}"]  # fmt: skip
    run = opened(study, f"project={{modes: {{count: 1}}, rank: {rank}, between: false}}", *one)
    (record,), (configuration,) = run.projected.record.sampled, run.scene.configurations
    system = opened(study, *one).model.assembled.system(configuration)
    K, M, D = (A if isinstance(A, np.ndarray) else A.toarray() for A in (system.K, system.M, system.D))
    lam, X = (part[..., system.rigid.shape[1] :] for part in la.eigh(K, M))
    w, decay = np.sqrt(lam), np.einsum("ij,ij->j", X, D @ X)
    peak = abs((system.C1 @ X)[0] * (X.T @ system.B)[:, 0]) / (decay * w)
    assert record.hz == pytest.approx([w[np.argmax(peak)] / (2 * np.pi)], rel=1e-6)


def test_complex_modes_are_projected_as_real_pairs(study):
    """Roots of the damped equations of motion; real and imaginary parts that depend on each other count once."""
    keys = ["project={modes: {cutoff: 2}, between: false, damped: true}", "components.arm.damping={modal: 0.05}"]
    run = opened(study, *keys)
    for each, configuration in zip(run.projected.record.sampled, run.scene.configurations, strict=True):
        system = opened(study, *keys[1:]).model.assembled.system(configuration)
        K, M, D = (A if isinstance(A, np.ndarray) else A.toarray() for A in (system.K, system.M, system.D))
        inverse, n = la.inv(M), system.N
        size = abs(la.eigvals(np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ K, -inverse @ D]]))) / (2 * np.pi)
        assert abs(size[:, None] / each.hz - 1).min(axis=0).max() < 1e-6
        assert 0 <= each.extraneous == each.predicted


def test_frequencies_come_back_as_eigenvalues_of_the_reassembled_matrices(study):
    """Beside the record's own account: a dense eigenproblem of what the run assembles."""
    run = opened(study, "project={modes: {list: [1, 2]}}")
    for each, configuration in zip(run.projected.record.sampled, run.scene.configurations, strict=True):
        system = run.model.assembled.system(configuration)
        dense = [A if isinstance(A, np.ndarray) else A.toarray() for A in (system.K, system.M)]
        hz = np.sqrt(np.maximum(la.eigvalsh(*dense), 0.0)) / (2 * np.pi)
        assert abs(hz[:, None] / each.hz - 1).min(axis=0).max() < 1e-7


def test_one_configuration_is_not_enough_and_auto_adds_the_worst(summary):
    """Modes of the straight arm do not hold the bent one: the greedy search says where it stopped and why."""
    first = "hinge=0"
    code, _, alone = summary(
        f"project={{modes: {{count: 2}}, configurations: [{first}], between: false}}", "verify.limits={}"
    )
    assert code == 0 and alone["worst"]["frf_error"] > 0.02
    code, output, found = summary(
        "project={modes: auto, configurations: auto, frf_error: 0.02}", "verify.limits={frf_error: 0.02}"
    )
    assert code == 0, output
    assert found["worst"]["frf_error"] <= 0.02
    assert max(found["projection"]["between"].values()) <= 0.02
    assert [note for note in found["notes"] if "is met in all of them" in note]
    kept = sum(part["kept_modes"] for part in found["components"].values())
    code, _, everything = summary("project={modes: {cutoff: 4}}")
    assert code == 0 and kept < sum(part["kept_modes"] for part in everything["components"].values())


def test_an_error_between_the_angles_fails_the_run_and_names_the_angle(summary):
    code, output, found = summary(
        "project={modes: {count: 2}, configurations: [hinge=0], frf_error: 1e-4}", "verify.limits={}"
    )
    worst = max(found["projection"]["between"], key=lambda name: found["projection"]["between"][name])
    assert code == 1 and set(found["projection"]["between"]) == {"hinge=50", "midpoint hinge.ry=25"}
    assert f"at {worst} is above its limit 0.01 %" in " ".join(output.split())


def test_extraneous_modes_are_named_and_suppressed(summary):
    keys = "modes: {list: [1, 4]}, configurations: [hinge=0], between: false"
    code, output, before = summary(f"project={{{keys}}}", "verify.limits={}")
    named = before["projection"]["extraneous_in_band"]
    assert code == 0 and named
    for mode in named:
        assert mode["frequency_hz"] <= 60.0
        assert sum(mode["energy"].values()) == pytest.approx(1.0)
        assert mode["body"] == max(mode["energy"], key=lambda body: mode["energy"][body])
        assert mode["interface"].split(".")[0] in ("arm", "panel", "hub")
        assert min(mode["weight"]) >= 0
        assert max(mode["weight"]) <= 1
    foreign_there = max((m for m in named if m["mac"] < 0.9), key=lambda m: max(m["weight"]))
    assert f"extraneous mode at {foreign_there['frequency_hz']:.4g} Hz in 'hinge=0'" in " ".join(output.split())
    code, output, after = summary(f"project={{{keys}, suppress: true}}", "verify.limits={}")
    assert code == 0 and sum(after["projection"]["static_shapes_added"].values()) > 0
    assert after["worst"]["frf_error"] <= before["worst"]["frf_error"]

    def foreign(found):
        return [mode["frequency_hz"] for mode in found["projection"]["extraneous_in_band"] if mode["mac"] < 0.9]

    assert len(foreign(after)) < len(foreign(before))


def test_a_large_tolerance_compresses_and_says_so(summary):
    code, _, exact = summary("project={modes: {cutoff: 2}, between: false}")
    assert code == 0
    code, output, found = summary("project={modes: {cutoff: 2}, tolerance: 0.05, between: false}", "verify.limits={}")
    assert code == 0 and "compressed to" in output
    worst = max(each["worst_return"] for each in found["projection"]["sampled"])
    assert f"after assembly {worst:.2g}" in " ".join(output.split())
    for name, rank in found["projection"]["rank"].items():
        assert rank == np.count_nonzero(np.array(exact["projection"]["singular_values"][name]) > 0.05)
    assert max(each["worst_return"] for each in found["projection"]["sampled"]) > RETURNED


def test_modes_of_the_closed_loop_return(study):
    """Their roots are eigenvalues of the state matrix of the full-order reduced system, with feedback."""
    keys = "project={modes: {cutoff: 2}, configurations: [hinge=0], between: false, feedback: {motor: {probe: 40.0}}}"
    run = opened(study, keys)
    (record,) = run.projected.record.sampled
    assert record.error.max() < RETURNED
    source = opened(study).model.assembled.system(run.scene.configurations[0])
    K, M, D = (A if isinstance(A, np.ndarray) else A.toarray() for A in (source.K, source.M, source.D))
    gain = np.zeros((len(source.inputs), len(source.outputs)))
    gain[source.inputs.index("motor"), source.outputs.index("probe")] = 40.0
    n = source.N
    inverse = la.inv(M)
    A = np.block(
        [
            [np.zeros((n, n)), np.eye(n)],
            [-inverse @ (K + source.B @ gain @ source.C1), -inverse @ (D + source.B @ gain @ source.C2)],
        ]
    )
    size = abs(la.eigvals(A)) / (2 * np.pi)
    assert abs(size[:, None] / record.hz - 1).min(axis=0).max() < 1e-6
    plain = opened(study, "project={modes: {cutoff: 2}, configurations: [hinge=0], between: false}")
    assert record.hz.size > plain.projected.record.sampled[0].hz.size


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ("{modes: {list: [99]}}", "mode 99 is asked for, but configuration"),
        ("{configurations: [nowhere], modes: {count: 2}}", "there is no configuration 'nowhere'"),
        ("{modes: {count: 2, cutoff: 1.0}}", "takes one of cutoff, list, count"),
        ("{modes: all}", "`auto` or a mapping is expected"),
        ("{modes: auto, frf_error: 1e-13}", "cannot be met: all"),
        ("{modes: {count: 2}, feedback: {engine: {probe: 1.0}}}", "there is no actuator 'engine'"),
        ("{modes: {count: 2}, feedback: {motor: {eye: 1.0}}}", "there is no sensor 'eye'"),
    ],
)
def test_what_cannot_be_projected_is_refused(summary, keys, message):
    code, output, _ = summary(f"project={keys}")
    assert code == 2 and message in " ".join(output.split()), output


def test_auto_needs_a_response(summary):
    code, output, _ = summary("project={modes: auto}", "scene.sensors={}")
    assert code == 2 and "auto needs a response to measure" in output


@pytest.mark.parametrize(
    ("angles", "expected"),
    [
        ([{("a", 5): 0.0}, {("a", 5): 1.0}, {("a", 5): 3.0}], ["midpoint a.rz=28.65", "midpoint a.rz=114.6"]),
        ([{("a", 0): 0.0}, {("a", 0): 1.0}], ["midpoint a.x=0.5"]),
        ([{("a", 5): 0.0, ("b", 0): y} for y in (0.0, 1.0)], ["midpoint a.rz=0 b.x=0.5"]),
        (
            [{("a", 0): x, ("b", 0): y} for x, y in ((0.0, 0.0), (2.0, 0.0), (4.0, 2.0))],
            ["midpoint a.x=1 b.x=0", "midpoint a.x=3 b.x=1"],
        ),
        (
            [{("a", 0): x, ("b", 0): y} for x, y in ((0.0, 0.0), (2.0, 2.0), (4.0, 0.0))],
            ["midpoint a.x=1 b.x=1", "midpoint a.x=3 b.x=1", "midpoint a.x=2 b.x=0"],
        ),
        ([{("a", 5): 0.0}], []),
        ([{}], []),
    ],
    ids=["three", "a slide", "one of two", "a path that ends alone", "a path with a corner", "one", "none"],
)
def test_midpoint_configurations(angles, expected):
    settings = tuple(Configuration(str(k), each) for k, each in enumerate(angles))
    joints = tuple(Joint(name, Point("body", "one"), Point("body", "two"), frozenset({0, 5})) for name in "ab")
    found = midpoint_configurations(Scene(("body",), (0.0, 1.0), joints=joints, configurations=settings))
    assert sorted(setting.name for setting in found) == sorted(expected)


def test_a_finished_projection_is_reused_and_finds_the_same(study, tmp_path):
    """Also by its own verb, and anew where the error that it goes for has changed."""
    keys = ["project={modes: auto, frf_error: 0.05}", "balance.keep=all", "reduce.cutoff=15"]
    path = Path(study)

    def run(*more: str, only: str | None = None) -> Run:
        return Run(load_pipeline(path, [*keys, *more]), tmp_path / "out", Log(), only)

    first = run()
    execute(first, path, report=False)
    again = run()
    execute(again, path, report=False)
    assert "project system" in first.stages.progress.done and "project system" in again.stages.progress.reused_
    assert "project system" not in again.stages.progress.done
    for name, component in first.final.items():
        other = again.final[name]
        np.testing.assert_array_equal(other.Phi, component.Phi)
        np.testing.assert_array_equal(other.sigma, component.sigma)
        assert set(other.rankings) == set(component.rankings) and other.why == component.why
    one, two = first.projected.record, again.projected.record
    assert one.rank == two.rank and one.between == two.between and one.limit == two.limit
    for a, b in zip(one.sampled, two.sampled, strict=True):
        np.testing.assert_array_equal(a.error, b.error)
    for a, b in zip(one.extraneous, two.extraneous, strict=True):
        assert (a.configuration, a.hz, a.mac) == (b.configuration, b.hz, b.mac)
        assert (a.body, a.energy, a.interface) == (b.body, b.energy, b.interface)
        np.testing.assert_array_equal(a.weight, b.weight)
    alone = run(only="project")
    execute(alone, path)
    assert "project system" in alone.stages.progress.done and "verify system" not in alone.stages.progress.done
    other = run("project={modes: auto, frf_error: 0.2}")
    execute(other, path, report=False)
    assert {"project system", "verify system"} <= set(other.stages.progress.done)
    assert "balance system" in other.stages.progress.reused_


def test_a_limit_that_projection_goes_for_is_part_of_its_key(study, tmp_path):
    keys = ["project={modes: auto}", "balance.keep=all", "reduce.cutoff=15"]

    def run(limit: float) -> Run:
        return Run(
            load_pipeline(Path(study), [*keys, f"verify.limits={{frf_error: {limit}}}"]), tmp_path / "out", Log()
        )

    few, many = run(0.3), run(0.02)
    assert sum(few.projected.record.rank.values()) < sum(many.projected.record.rank.values())
    assert "project system" in many.stages.progress.done


def test_the_stage_has_a_verb(study, tmp_path):
    out = ["--out", str(tmp_path / "out")]
    given = ["--set", "project={modes: {count: 2}}", "--set", "verify.limits={}"]
    result = CliRunner().invoke(main, ["project", str(study), *out, *given])
    assert result.exit_code == 2 and "is not finished" in " ".join(result.output.split())
    result = CliRunner().invoke(main, ["run", str(study), *out, *given, "--until", "balance"])
    assert result.exit_code == 0, result.output
    result = CliRunner().invoke(main, ["project", str(study), *out, *given])
    assert result.exit_code == 0 and "system.project.h5" in result.output.replace("\n", ""), result.output
