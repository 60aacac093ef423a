"""Floating frames, frames of integrals and outboard masses of a run: in its files, its checks and its messages."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.linalg as la
from click.testing import CliRunner

from cmsreduce.cli import main
from cmsreduce.config import load_pipeline
from cmsreduce.errors import ConfigError
from cmsreduce.pipeline import Run, Silent, execute
from cmsreduce.write import TARGETS, ComponentFile, convert, read_component
from tests.frames import BAR
from tests.pipeline.study import PIPELINE, write_study

FRAMES = {
    "clamped": "{kind: clamped, at: root}",
    "mean-axis": "{kind: mean-axis}",
    "chord": "{kind: chord, at: root, to: tip}",
}
FACES = "components.panel.interfaces={root: {node: 1}, tip: {node: 5}}"
TURNED = "components.arm.interfaces={root: {node: 1, frame: {axis: z, angle: 30 deg}}, tip: {node: 5}}"


# Nothing is compared with the full system here, and one configuration is enough.
QUICK = PIPELINE[: PIPELINE.index("verify:")].replace("[0, 50 deg]", "[0]") + "write: {{formats: [hdf5]}}\n"


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """Run directory of the study with keys set; the modes are computed once."""
    study = write_study(tmp_path_factory.mktemp("frames"), QUICK)
    made: dict[tuple[str, ...], Path] = {}

    def run(*overrides: str) -> Path:
        if overrides not in made:
            pipeline = load_pipeline(study, (FACES, *overrides))
            assert execute(Run(pipeline, pipeline.output, Silent()), study, report=False) is not None
            made[overrides] = study.parent / f"out{len(made)}"
            shutil.copytree(pipeline.output, made[overrides], ignore=lambda *_: ["stages"])
        return made[overrides]

    return run


@pytest.fixture
def files(out: Callable[..., Path]) -> Callable[..., dict[str, ComponentFile]]:
    """Component files of the study with keys set."""
    return lambda *keys: {name: read_component(out(*keys) / f"{name}.h5") for name in ("arm", "panel")}


def modal(file: ComponentFile) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return tuple(file.arrays[f"modes/{name}"] for name in ("mass", "damping", "stiffness"))


def response(file: ComponentFile, w: float) -> np.ndarray:
    """From unit efforts of inputs and unit loads at interfaces to outputs and interfaces."""
    M, D, K = modal(file)
    faces = [file.arrays[f"interfaces/{face}/shapes"] for face in ("root", "tip")]
    into = np.hstack([file.arrays["inputs/B"], *(face.T for face in faces)])
    out = np.vstack([file.arrays["outputs/C1"] + 1j * w * file.arrays["outputs/C2"], *faces])
    return out @ np.linalg.solve(K + 1j * w * D - w**2 * M, into)


@pytest.mark.parametrize("kind", FRAMES)
def test_a_body_in_a_frame_is_the_body(files, kind: str) -> None:
    """Frequencies and responses of the file are those of the file without a frame."""
    plain, framed = files(), files(f"write.frame={FRAMES[kind]}")
    for name, file in framed.items():
        M, _, K = modal(file)
        np.testing.assert_array_equal(K, modal(plain[name])[2])
        lam = la.eigh(K, M, eigvals_only=True)
        omega = plain[name].omega
        np.testing.assert_allclose(lam, omega**2, rtol=1e-9, atol=1e-9 * omega[6] ** 2)
        for w in (40.0, 333.0):
            expected = response(plain[name], w)
            np.testing.assert_allclose(response(file, w), expected, rtol=1e-8, atol=1e-10 * abs(expected).max())
        elastic = np.ix_(file.arrays["integrals/modes"], file.arrays["integrals/modes"])
        trace = np.einsum("iiab->ab", file.arrays["integrals/phi_phi"])
        np.testing.assert_allclose(trace, M[elastic], atol=1e-11 * abs(M).max())
        found = {check.name: check for check in file.checks}
        (check,) = (check for key, check in found.items() if key.startswith("rigid motion left in the modes"))
        assert check.passed and check.value < 1e-10
        assert file.attributes["frame"]["kind"] == kind and plain[name].attributes["frame"]["kind"] == "none"


def test_what_each_frame_holds(files) -> None:
    file = files(f"write.frame={FRAMES['clamped']}")["arm"]
    np.testing.assert_allclose(file.arrays["interfaces/root/shapes"][:, 6:], 0, atol=1e-10)
    at = file.arrays["nodes/id"].tolist().index(1)
    for name in ("translation", "rotation"):
        np.testing.assert_allclose(file.arrays[f"nodes/{name}"][at][:, 6:], 0, atol=1e-10)
    assert file.attributes[""]["support"].endswith("seen from a frame by clamped at root (nodes and dofs 1 123456)")
    assert file.arrays["frame/node"].tolist() == [1] * 6 and file.arrays["frame/removed"].shape[0] == 6

    file = files(f"write.frame={FRAMES['mean-axis']}")["panel"]
    size = np.sqrt(file.arrays["integrals/mass"])
    for name in ("phi", "r_cross_phi"):
        np.testing.assert_allclose(file.arrays[f"integrals/{name}"], 0, atol=1e-11 * size)
    np.testing.assert_allclose(file.arrays["integrals/first_moment"], 0, atol=1e-12 * size**2)
    assert not file.arrays["frame/node"].size

    file = files(f"write.frame={FRAMES['chord']}")["panel"]
    root, tip = (file.arrays[f"interfaces/{face}/shapes"][:, 6:] for face in ("root", "tip"))
    x = file.arrays["interfaces/tip/position"][0] - file.arrays["interfaces/root/position"][0]
    np.testing.assert_allclose(root[:3], 0, atol=1e-10)
    np.testing.assert_allclose(np.cross(x, tip[:3], axisb=0), 0, atol=1e-10)
    np.testing.assert_allclose(x @ root[3:], 0, atol=1e-10)
    np.testing.assert_allclose(file.arrays["integrals/axes"][0], x / np.linalg.norm(x), atol=1e-14)
    np.testing.assert_allclose(file.arrays["integrals/origin"], file.arrays["interfaces/root/position"][0])


@pytest.mark.parametrize(
    ("keys", "origin", "axes"),
    [
        ("{}", [0, 0, 0], 0.0),
        ("{about: basic}", [0, 0, 0], 0.0),
        # A lump is in the middle of the bar.
        ("{about: centre-of-mass}", [0.4, 0, 0], 0.0),
        ("{about: tip}", [0.8, 0, 0], 0.0),
        ("{about: [0.1, -0.2, 3], axes: root}", [0.1, -0.2, 3], 30.0),
    ],
)
def test_integrals_are_about_what_is_asked_for(files, keys: str, origin: list[float], axes: float) -> None:
    """Mass, first moment and inertia of a thin bar with a lump, by the formulas of the books and parallel axes."""
    file = files(TURNED, f"components.arm.write={{integrals: {keys}}}")["arm"]
    bar, lump, L = BAR.rho * BAR.A * 0.8, 0.3, 0.8
    c, s = np.cos(np.radians(axes)), np.sin(np.radians(axes))
    A = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    d = np.array([0.4, 0, 0]) - origin
    m, polar = bar + lump, BAR.rho * (BAR.Iy + BAR.Iz) * L
    J = np.diag([polar, bar * L**2 / 12, bar * L**2 / 12]) + m * (d @ d * np.eye(3) - np.outer(d, d))
    np.testing.assert_allclose(file.arrays["integrals/origin"], origin, atol=1e-12)
    np.testing.assert_allclose(file.arrays["integrals/axes"], A, atol=1e-12)
    assert file.arrays["integrals/mass"] == pytest.approx(m, rel=1e-12)
    np.testing.assert_allclose(file.arrays["integrals/first_moment"], m * A @ d, atol=1e-12)
    np.testing.assert_allclose(file.arrays["integrals/inertia"], A @ J @ A.T, rtol=1e-9, atol=1e-11)
    # The rigid mass stays about the origin of the basic frame.
    np.testing.assert_allclose(
        file.arrays["integrals/rigid_mass"][4, 4], J[1, 1] - m * d[0] ** 2 - m * d[2] ** 2 + m * 0.16
    )


def test_integrals_moved_there_and_back_are_the_same(files) -> None:
    """Parallel axes of every integral: from one point to another, and back."""
    here = files("write.integrals={about: root}")["panel"].arrays
    there = files("write.integrals={about: [0.3, -1, 0.2]}")["panel"].arrays
    d = there["integrals/origin"] - here["integrals/origin"]
    for a, b, shift in ((here, there, d), (there, here, -d)):
        m, moment = a["integrals/mass"], a["integrals/first_moment"]
        np.testing.assert_allclose(b["integrals/first_moment"], moment - m * shift, atol=1e-12)
        second = [np.trace(x["integrals/inertia"]) / 2 * np.eye(3) - x["integrals/inertia"] for x in (a, b)]
        moved = second[0] - np.outer(shift, moment) - np.outer(moment, shift) + m * np.outer(shift, shift)
        np.testing.assert_allclose(second[1], moved, atol=1e-11)
        phi = a["integrals/phi"]
        np.testing.assert_allclose(b["integrals/phi"], phi, atol=1e-13)
        turned = a["integrals/r_cross_phi"] - np.cross(shift, phi, axisb=0).T
        np.testing.assert_allclose(b["integrals/r_cross_phi"], turned, atol=1e-11)
        expected = a["integrals/r_phi"] - np.einsum("i,jk->ijk", shift, phi)
        np.testing.assert_allclose(b["integrals/r_phi"], expected, atol=1e-11)
        np.testing.assert_allclose(b["integrals/phi_phi"], a["integrals/phi_phi"], atol=1e-12)


@pytest.mark.parametrize("mass", ["consistent", "row-sum", "diagonal"])
def test_a_clamped_body_over_each_mass_is_written_for_every_code(files, out, tmp_path: Path, mass: str) -> None:
    """Files of other codes in the frame; a superelement, which needs none, is the one of the body without a frame."""
    keys = f"write.frame={FRAMES['clamped']}", f"write.integrals={{mass: {mass}}}", "write.all_nodes=true"
    file = files(*keys)["panel"]
    assert file.attributes["integrals"]["lumping"] == mass
    source = out(*keys) / "panel.h5"
    # ExtPtfm joins a structure at one node, Radioss takes three or more; this panel has two. 42 takes no momentum.
    for name, target in ((name, each) for name, each in TARGETS.items() if name not in ("extptfm", "radioss", "42")):
        assert all(path.stat().st_size > 100 for path in convert(source, tmp_path / f"panel{target.suffix}", name))
    with np.load(tmp_path / "panel.npz", allow_pickle=True) as arrays:
        trace = np.einsum("iiab->ab", file.arrays["integrals/phi_phi"])
        np.testing.assert_allclose(arrays["massMatrixReduced"], trace, atol=1e-11 * abs(trace).max())
        root = file.arrays["nodes/id"].tolist().index(1)
        np.testing.assert_allclose(arrays["modeBasis"].reshape(-1, 3, len(trace))[root], 0, atol=1e-10)
        np.testing.assert_allclose(arrays["xRef"].reshape(-1, 3)[root], 0, atol=1e-12)
    from pyyeti.nastran import op4

    framed = op4.read(str(tmp_path / "panel.op4"))
    convert(out("write.all_nodes=true") / "panel.h5", tmp_path / "plain.op4", "nastran")
    plain = op4.read(str(tmp_path / "plain.op4"))
    for name in ("kaa", "maa"):
        d = np.sqrt(abs(np.diag(plain[name])).max())
        np.testing.assert_allclose(abs(framed[name]), abs(plain[name]), rtol=1e-7, atol=1e-9 * d**2)


def test_what_hangs_on_an_interface(files) -> None:
    """The panel on the arm's tip: five thin bars, their masses and second moments by hand; the hub is inboard."""
    file = files()["arm"]
    assert file.texts["augmented/tip/bodies"] == ("panel",) and "augmented/root/mass" not in file.arrays
    xyz = np.array([[0.8, 0, 0], [1.1, 0, 0], [1.4, 0, 0], [1.4, 0.25, 0.1], [1.4, 0.5, 0.2], [1.75, 0.125, 0.05]])
    xyz -= [0.8, 0, 0]
    moment, second, mass, polar = np.zeros(3), np.zeros((3, 3)), 0.0, np.zeros((3, 3))
    for i, j in ((0, 1), (1, 2), (2, 3), (3, 4), (2, 5)):
        a, b = xyz[i], xyz[j]
        m = BAR.rho * BAR.A * np.linalg.norm(b - a)
        mass, moment = mass + m, moment + m * (a + b) / 2
        second += m * (np.outer(a, a) + np.outer(b, b) + (np.outer(a, b) + np.outer(b, a)) / 2) / 3
        polar += BAR.rho * (BAR.Iy + BAR.Iz) * np.outer(b - a, b - a) / np.linalg.norm(b - a)
    J = np.trace(second) * np.eye(3) - second + polar
    assert file.arrays["augmented/tip/mass"] == pytest.approx(mass, rel=1e-12)
    np.testing.assert_allclose(file.arrays["augmented/tip/point"], [0.8, 0, 0], atol=1e-12)
    np.testing.assert_allclose(file.arrays["augmented/tip/first_moment"], moment, atol=1e-12)
    np.testing.assert_allclose(file.arrays["augmented/tip/inertia"], J, rtol=1e-9, atol=1e-10)


def test_checks_and_inspect_show_the_frame_and_both_totals(out) -> None:
    folder = out(f"write.frame={FRAMES['clamped']}")
    for path in (folder, folder / "arm.h5"):
        result = CliRunner().invoke(main, ["check", str(path)])
        assert result.exit_code == 0, result.output
    summary = json.loads((folder / "summary.json").read_text())
    checks = {check["name"]: check for check in summary["components"]["panel"]["checks"]}
    assert checks["rigid motion left in the modes: clamped at root"]["passed"]
    assert checks["inertia: beyond what mass can have"]["passed"]
    shown = CliRunner().invoke(main, ["inspect", str(folder / "arm.h5")]).output
    assert "seen from a frame by clamped at root" in shown and "outboard of tip: mass" in shown
    # A bar of 0.8 m in four elements and a lump of 0.3: what lumping adds across it is m h^2 / 6 of the bar.
    bar = BAR.rho * BAR.A * 0.8
    apart = bar * 0.04 / 6 / (bar * 0.64 / 12)
    for text in (shown, CliRunner().invoke(main, ["inspect", str(folder.parent / "study.yaml")]).output):
        for lumping in ("consistent", "row-sum", "diagonal"):
            assert f"{lumping} mass {bar + 0.3:.9g}, centre of mass 0.4 0 0" in text
        (line,) = [line for line in text.splitlines() if "row-sum mass" in line and f"{bar + 0.3:.9g}" in line]
        assert float(line.rpartition(" ")[2]) == pytest.approx(apart, rel=0.2)


@pytest.mark.parametrize(
    ("key", "message"),
    [
        ("write.frame={kind: clamped}", "a clamped frame needs `at: INTERFACE`"),
        ("write.frame={kind: mean-axis, at: root}", "a mean-axis frame takes no `at`"),
        ("write.frame={kind: chord, at: root, to: root}", "both are 'root'"),
        ("write.frame={kind: clamped, at: root, roll: 3.y}", "has no roll to hold"),
        ("write.frame={kind: chord, at: root, to: tip, roll: 3}", "is no roll: write INTERFACE.DOF or NODE.DOF"),
        ("write.frame={kind: tangent}", "tangent"),
        (
            "write.frame={kind: clamped, at: tip}",
            "component 'panel': there is no interface 'tip'.*components.panel.write",
        ),
        ("components.arm.write={frame: {kind: clamped, at: foot}}", "component 'arm': there is no interface 'foot'"),
        ("write.integrals={about: [0, 0]}", "a point of 3 numbers is expected"),
        ("write.integrals={about: 3}", "basic, centre-of-mass, an interface or a point"),
        ("write.integrals={about: centre}", "there is no interface 'centre'"),
        ("write.integrals={axes: foot}", "there is no interface 'foot'"),
        ("write.integrals={mass: lumped}", "lumped"),
        ("components.hub.write={frame: {kind: mean-axis}}", "a rigid body has no write"),
    ],
)
def test_keys_that_say_nothing_are_refused(study: Path, key: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        load_pipeline(study, [key])


def test_one_body_takes_the_frame_out_for_itself(files) -> None:
    found = files(f"write.frame={FRAMES['clamped']}", "components.arm.write={frame: null}")
    kinds = {name: file.attributes["frame"]["kind"] for name, file in found.items()}
    assert kinds == {"arm": "none", "panel": "clamped"}


def test_a_frame_that_is_not_determined_fails_alone(study: Path) -> None:
    study.write_text(QUICK.format(output=study.parent / "out"))
    pinned = "components.arm.interfaces={root: {node: 1}, tip: {node: 5}, pin: {node: 3, dofs: 123}}"
    arguments = ["run", str(study), "--set", pinned, "--set", "components.arm.write={frame: {kind: clamped, at: pin}}"]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 1
    assert "determines 3 of six rigid motions" in " ".join(result.output.split())
    assert not (study.parent / "out" / "arm.h5").exists() and (study.parent / "out" / "panel.h5").is_file()


def test_the_same_frame_gives_the_same_bytes(study: Path) -> None:
    study.write_text(QUICK.format(output=study.parent / "out"))
    content = []
    for _ in range(2):
        pipeline = load_pipeline(study, (FACES, f"write.frame={FRAMES['chord']}"))
        execute(Run(pipeline, pipeline.output, Silent()), study, report=False)
        path = study.parent / "out" / "arm.h5"
        with h5py.File(path, "r+") as file:
            file.attrs.modify("created_utc", "2000-01-01T00:00:00+00:00")
        content.append(path.read_bytes())
    assert content[0] == content[1]
