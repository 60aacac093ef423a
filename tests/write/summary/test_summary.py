"""summary.json keeps its keys, whatever the figures."""

import json
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.model import (
    SCALAR,
    ComponentResult,
    Configuration,
    ConfigurationResult,
    DampedPairs,
    DofTable,
    FEModel,
    Finding,
    ModalComponent,
    ModelErrors,
    Response,
    RigidBody,
    RunResult,
    Speed,
    SystemModes,
    Units,
)
from cmsreduce.write import summary, write_summary
from cmsreduce.write.summary.stored_summary import sealed_text

CONTRACT = {"name", "version", "components", "configurations", "worst", "speed", "passed"}
OF_A_COMPONENT = {
    "full_dofs",
    "basis_size",
    "elastic_modes",
    "kept_modes",
    "method",
    "frequencies_hz",
    "seconds",
    "peak_mib",
    "checks",
}
OF_A_CONFIGURATION = {"angles", "frf_error", "db_error", "frequency_error", "n_full", "n_reduced"}
ERRORS = ("frf_error", "db_error", "frequency_error", "damping_error")


def errors(*figures: float) -> ModelErrors:
    none = np.empty(0)
    return ModelErrors(*figures, np.ones((1, 1)), none, none, none)


def setting(name: str, angles: dict, own: ModelErrors, **others: ModelErrors) -> ConfigurationResult:
    response = Response(np.ones(1), np.ones((1, 1, 1), complex), {})
    return ConfigurationResult(Configuration(name, angles), 300, 41, 12, 11, {"reduced": own, **others}, response)


def run(**changes) -> RunResult:
    one = sp.csc_array(np.eye(5))
    body = FEModel("rotor", one, one, DofTable(np.arange(1, 6), np.full(5, SCALAR)))
    nan = np.nan
    modes = ModalComponent(
        body=body,
        method="craig-bampton",
        Phi=np.eye(5, 4),
        omega=2 * np.pi * np.array([0.0, 1.5, 2.5, 4.0]),
        zeta=np.array([0.0, 0.01, 0.01, 0.01]),
        rigid_count=1,
        D=None,
        kind=("rigid", "fixed", "fixed", "constraint"),
        source_hz=np.array([0.0, 1.4, 2.6, nan]),
        sigma=np.array([nan, 3.0, 1.0, 2.0]),
        spacing=np.array([nan, 0.1, 0.1, 0.1]),
        why=("rigid body", "ranked", "", "ranked"),
        basis_size=4,
    )
    rotor = ComponentResult(
        "rotor", 5, modes, np.array([0, 1, 3]), {"read": 0.5}, 80.0, (Finding("orthogonality in M", 1e-15, 1e-8),), ()
    )
    result = RunResult(
        name="galileo",
        version="0.1.0",
        components={"rotor": rotor},
        configurations=(
            setting("first", {("spin", 5): np.radians(45), ("slide", 0): 0.2}, errors(0.01, 0.5, 1e-4)),
            setting("second", {("spin", 5): np.radians(90)}, errors(0.02, 0.25, 2e-4)),
        ),
        limits={"frf_error": 0.05},
        model="reduced",
        inputs=("motor",),
        outputs=("gyro",),
        band=(0.0, 10.0),
        speed=Speed(1.0, 2.0, 0.5),
        reference={"rotor": "all modes"},
        notes=("as SI",),
    )
    return replace(result, **changes)


def test_keys_are_those_of_the_contract():
    facts = summary(run())
    assert set(facts) >= CONTRACT
    assert set(facts["components"]["rotor"]) >= OF_A_COMPONENT
    assert set(facts["components"]["rotor"]["checks"][0]) == {"name", "value", "limit", "passed"}
    for row in facts["configurations"]:
        assert set(row) >= OF_A_CONFIGURATION
    assert set(facts["worst"]) == set(ERRORS)
    assert set(facts["speed"]) == {"reduce_s", "full_frf_s", "reduced_frf_s", "simulation"}


def test_figures_are_those_of_the_run():
    facts = summary(run())
    rotor = facts["components"]["rotor"]
    counts = ("full_dofs", "basis_size", "elastic_modes", "kept_modes")
    assert [rotor[key] for key in counts] == [5, 4, 3, 2]
    # Of the elastic modes that are kept; the rigid one and the one left out are not among them.
    assert rotor["frequencies_hz"] == pytest.approx([1.5, 4.0], rel=1e-15)
    assert facts["worst"] == {"frf_error": 0.02, "db_error": 0.5, "frequency_error": 2e-4, "damping_error": None}
    assert facts["band_hz"] == [0.0, 10.0]
    assert facts["passed"] is True
    assert summary(run(limits={"frf_error": 0.015}))["passed"] is False


def test_angles_are_in_degrees_and_lengths_as_they_are():
    first, second = summary(run())["configurations"]
    assert first["angles"] == {"spin": 45.0, "slide": 0.2}
    assert second["angles"] == {"spin": 90.0}


def test_a_joint_that_turns_two_ways_anywhere_is_named_with_its_motion_everywhere():
    results = (
        setting("a", {("ball", 3): np.radians(10)}, errors(0, 0, 0)),
        setting("b", {("ball", 4): np.radians(20)}, errors(0, 0, 0)),
    )
    found = [row["angles"] for row in summary(run(configurations=results))["configurations"]]
    assert found == [{"ball.rx": 10.0}, {"ball.ry": 20.0}]


def test_systems_have_their_frequencies_and_the_same_angles():
    ball = [Configuration(name, {("ball", dof): np.radians(10)}) for name, dof in (("a", 3), ("b", 4))]
    systems = tuple(
        SystemModes(configuration, 2, np.array([1.5, 2.5]), hz, zeta=zeta)
        for configuration, hz, zeta in zip(ball, (None, 9.0), (None, np.array([0.01, 0.02])), strict=True)
    )
    found = summary(run(systems=systems))["system"]
    assert [row["angles"] for row in found] == [{"ball.rx": 10.0}, {"ball.ry": 10.0}]
    facts = {"name": "a", "angles": {"ball.rx": 10.0}, "parameters": {}, "rigid_modes": 2, "frequencies_hz": [1.5, 2.5]}
    # A system too large for all its modes has no advice.
    assert found[0] == facts | {"integration": None, "zeta": None}
    assert found[1]["zeta"] == [0.01, 0.02]
    assert found[1]["integration"]["highest_hz"] == 9.0
    assert found[1]["integration"]["steps"]["central_difference"]["stable"] == pytest.approx(1 / (9 * np.pi))


def test_rigid_bodies_are_in_si_whatever_the_units_of_the_scene():
    """A plate of 2 kg, 0.3 by 0.4 by 0 m: m / 12 b^2, m / 12 a^2, and their sum."""
    tensor = np.diag(2 / 12 * np.array([0.16, 0.09, 0.25]) * 1e3)
    plate = RigidBody("plate", 2e-3, np.array([150.0, 0.0, -20.0]), tensor, units=Units.parse("mm-t-s"))
    (found,) = summary(run(rigid_bodies=(plate,)))["rigid_bodies"].items()
    assert found[0] == "plate" and found[1].keys() == {"mass_kg", "cg_m", "inertia_kg_m2"}
    assert found[1]["mass_kg"] == pytest.approx(2.0, rel=1e-14)
    assert found[1]["cg_m"] == pytest.approx([0.15, 0.0, -0.02], rel=1e-14)
    assert found[1]["inertia_kg_m2"] == pytest.approx([2 / 75, 0.015, 1 / 24, 0, 0, 0], rel=1e-14)


def test_compared_models_have_their_figures():
    results = (setting("a", {}, errors(0.01, 0.1, 0.0), first=errors(0.9, 30.0, 0.5)),)
    found = summary(run(configurations=results))["comparisons"]
    assert found["first"]["worst"] == {
        "frf_error": 0.9,
        "db_error": 30.0,
        "frequency_error": 0.5,
        "damping_error": None,
    }
    assert found["first"]["configurations"][0]["frf_error"] == 0.9


def test_complex_modes_stand_beside_the_full_ones():
    # A root of length 10 with damping ratio 0.6 is -6 + 8i.
    damped = DampedPairs(np.array([-6 + 8j]), np.array([-8 + 6j]), np.array([0.99]), np.array([1 / 3]))
    own = replace(errors(0.01, 0.1, 0.0), damped=damped)
    result = run(configurations=(setting("a", {}, own),), limits={"damping_error": 0.3})
    facts = summary(result)
    (mode,) = facts["configurations"][0]["complex_modes"]
    hertz = 10 / (2 * np.pi)
    assert mode == pytest.approx(
        {"full_hz": hertz, "reduced_hz": hertz, "full_zeta": 0.6, "reduced_zeta": 0.8, "mac": 0.99}, rel=1e-15
    )
    assert facts["configurations"][0]["damping_error"] == facts["worst"]["damping_error"] == pytest.approx(1 / 3)
    assert facts["passed"] is False
    assert summary(replace(result, limits={"damping_error": 0.4}))["passed"] is True


def test_without_damping_there_is_no_damping_error_to_limit():
    facts = summary(run(limits={"damping_error": 1e-9}))
    assert [row["damping_error"] for row in facts["configurations"]] == [None, None]
    assert [row["complex_modes"] for row in facts["configurations"]] == [None, None]
    assert facts["passed"] is True


@pytest.mark.parametrize("figure", [np.inf, np.nan, np.float64("inf")])
def test_the_file_is_valid_json_where_a_figure_is_not_finite(tmp_path, figure):
    results = (setting("a", {}, errors(figure, 0.1, 0.0)), setting("b", {}, errors(0.01, 0.1, 0.0)))
    path = tmp_path / "deep" / "summary.json"
    write_summary(path, run(configurations=results))

    def refuse(word: str) -> None:
        raise AssertionError(f"{word} is not JSON")

    facts = json.loads(path.read_text(encoding="utf-8"), parse_constant=refuse)
    assert facts["configurations"][0]["frf_error"] is None
    assert facts["worst"]["frf_error"] is None
    assert facts["passed"] is False


def test_nothing_verified():
    facts = summary(run(configurations=(), speed=None))
    assert (facts["configurations"], facts["worst"], facts["speed"]) == ([], {}, None)


def test_the_same_run_gives_the_same_bytes(tmp_path):
    for name in ("a.json", "b.json"):
        write_summary(tmp_path / name, run())
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()


def test_a_channel_and_a_list_of_numbers_are_a_line_each() -> None:
    """A line for each number made margins two thirds of the file of a scene with thousands of channels."""
    zeros = [{"output": "y {", "input": "u", "full_hz": [[0.0, float(k)] for k in range(20)]} for _ in range(50)]
    facts = {"name": "study", "none": {}, "configurations": [{"angles": {"spin": 5.0}, "zeros": zeros, "modes": []}]}
    text = sealed_text(facts)
    found = json.loads(text)
    assert {key: found[key] for key in facts} == facts
    assert sum("full_hz" in line for line in text.splitlines()) == 50
    assert len(text) < 1.2 * len(json.dumps(found))
