"""Four arms on a hub: copies of one body are read, proven and reduced once, and the system is that of four bodies."""

import json
from collections import Counter

import numpy as np
import pytest
from pyyeti.nastran import op4

from cmsreduce.config import load_pipeline
from cmsreduce.models_in_memory import AssembledSystem
from cmsreduce.pipeline import Run, execute
from cmsreduce.pipeline.bodies import bodies, from_keys, proven_bodies
from cmsreduce.write import read_component
from tests.frames import frame
from tests.pipeline.study import Log, arm, write_body

NAMES = ("fl", "fr", "rl", "rr")
PLACES = {
    "fl": "at: [0.1, 0, 0]",
    "fr": "at: [0, 0.1, 0], rotate: {axis: z, angle: 90 deg}",
    "rl": "at: [-0.1, 0, 0], rotate: {axis: z, angle: 180 deg}",
    "rr": "at: [0, -0.1, 0], rotate: {axis: z, angle: -90 deg}",
}
FILES = """\
    stiffness: {file: arm.op4, matrix: KAA}
    mass: {file: arm.op4, matrix: MAA}
    geometry: arm.bdf
    interfaces: {root: {node: 1}}
    damping: {modal: 0.01}
"""
SCENE = """\
  hub:
    rigid: {mass: 5, inertia: [0.2, 0.3, 0.25, 0.01, 0, 0]}
    interfaces:
      fl: {position: [0.1, 0, 0]}
      fr: {position: [0, 0.1, 0]}
      rl: {position: [-0.1, 0, 0]}
      rr: {position: [0, -0.1, 0]}
scene:
  band: 60 Hz
  base: hub
  joints:
JOINTS
  actuators: {push: {at: hub.cg, force: [0, 1, 1]}}
  sensors: {gyro: {at: hub.cg, measure: [ry, rz], rate: true}, tip: {at: fr.5, measure: [z]}}
balance: {rank: gregory, keep: all}
write: {formats: [hdf5]}
"""


def cart(folder, *, copies, reduce="{cutoff: 4}", own="", names=NAMES):
    """The pipeline file, with three copies of the first arm, or with four arms written out."""
    folder.mkdir(exist_ok=True)
    write_body(folder, arm())
    text = f"name: cart\noutput: {folder / 'out'}\ncomponents:\n"
    for name in names:
        files = "    like: fl\n" if copies and name != "fl" else FILES
        text += f"  {name}:\n{files}    place: {{{PLACES[name]}}}\n" + (own if name == "rr" else "")
    path = folder / "cart.yaml"
    joints = "".join(f"    {name}: {{connect: [hub.{name}, {name}.root]}}\n" for name in names)
    path.write_text(text + SCENE.replace("JOINTS\n", joints) + f"reduce: {reduce}\n")
    return path


def opened(path):
    pipeline = load_pipeline(path)
    return Run(pipeline, pipeline.output, Log())


def finished(path):
    run = opened(path)
    return run, execute(run, path, report=False)


@pytest.fixture
def apart(monkeypatch):
    """Calls it to treat every body as if it had no copies."""

    def separate():
        monkeypatch.setattr(Run, "body_key", lambda run, name: name)
        # Inputs of a reduction and of a reference model are alike only if the fingerprints are.
        monkeypatch.setattr(
            bodies.FlexibleBody, "fingerprint", property(lambda self: f"{self.body.name} {id(self.body)}")
        )

    return separate


@pytest.mark.parametrize("reduce", ["{cutoff: 4}", "{cutoff: auto}", "{method: benfield-hruda, cutoff: 4}"])
def test_copies_make_the_system_that_bodies_written_out_and_done_apart_make(tmp_path, apart, reduce):
    # With `auto` two bodies do: each trial of the search measures the responses of a whole system.
    names = NAMES[:2] if "auto" in reduce else NAMES
    copied = opened(cart(tmp_path / "copies", copies=True, reduce=reduce, names=names))
    systems = [AssembledSystem(copied.model.assembled, copied.scene.configurations[0])]
    apart()
    written = opened(cart(tmp_path / "apart", copies=False, reduce=reduce, names=names))
    systems.append(AssembledSystem(written.model.assembled, written.scene.configurations[0]))
    for name in names:
        one, other = copied.final[name], written.final[name]
        assert one.name == one.body.name == name
        np.testing.assert_allclose(one.omega, other.omega, rtol=1e-9, atol=1e-3)
        assert (one.kind, one.rigid_count) == (other.kind, other.rigid_count)
    H, expected_H = (system.response([1.0, 20.0, 55.0]) for system in systems)
    np.testing.assert_allclose(H, expected_H, rtol=0, atol=1e-9 * abs(expected_H).max())


def test_files_are_read_and_a_body_is_reduced_once(tmp_path, monkeypatch):
    calls = Counter()
    for work in ("read_body", "prove_row_order", "evidence_of", "hold_undetermined", "body_health"):
        room = from_keys if work == "read_body" else proven_bodies
        real = getattr(room, work)

        def counted(*args, real=real, work=work, **named):
            calls[work] += 1
            return real(*args, **named)

        monkeypatch.setattr(room, work, counted)
    run, result = finished(cart(tmp_path, copies=True))
    assert set(calls.values()) == {1}
    assert [each for each in run.stages.progress.done if each.startswith(("reduce", "orthogonalise"))] == [
        "reduce fl",
        "orthogonalise fl",
    ]
    done = {name: len(part.factorised) for name, part in result.components.items()}
    assert done["fl"] > 0 and done["fr"] == done["rl"] == done["rr"] == 0
    # A second run takes them from the cache, and each body has its own file.
    again, _ = finished(tmp_path / "cart.yaml")
    assert not [each for each in again.stages.progress.done if each.startswith(("reduce", "orthogonalise"))]
    for name in NAMES:
        assert read_component(tmp_path / "out" / f"{name}.h5").name == name
    assert set(json.loads((tmp_path / "out/summary.json").read_text())["components"]) == set(NAMES)


def test_a_copy_that_is_asked_for_more_is_reduced_by_itself(tmp_path):
    run = opened(cart(tmp_path, copies=True, own="    reduce: {cutoff: 8}\n"))
    assert run.final["rr"].omega.size > run.final["fl"].omega.size
    reduced = [each for each in run.stages.progress.done if each.startswith("reduce")]
    assert reduced == ["reduce fl", "reduce rr"]


def test_each_copy_is_told_what_its_own_sensors_miss(tmp_path):
    run = opened(cart(tmp_path, copies=True, reduce="{cutoff: 1.5}"))
    assert set(run.final) == set(NAMES)
    missed = [note for note in run.stages.notes if "sensor 'tip'" in note]
    assert missed and all(note.startswith("fr: ") for note in missed)


def test_damped_shapes_of_one_copy_or_of_one_compared_model_are_its_own(tmp_path):
    """Mode sets of one method and cutoff that differ in `damped` alone."""
    own = "    reduce: {damped: true}\n"
    path = cart(tmp_path, copies=True, reduce="{cutoff: 3}", own=own, names=("fl", "fr", "rr"))
    damper = frame("arm", arm().nodes.xyz, [(3, 4)]).K.toarray()
    op4.write(str(tmp_path / "d.op4"), {"BAA": 1e-3 * damper})
    text = path.read_text().replace("{modal: 0.01}", "{matrix: {file: d.op4, matrix: BAA}}")
    compared = [f"    {each}: {{keep: all, reduce: {{cutoff: 6, damped: {each}}}}}\n" for each in ("false", "true")]
    path.write_text(text + "verify:\n  compare:\n" + "".join(compared))
    run = opened(path)
    sizes = {name: modal.omega.size for name, modal in run.final.items()}
    assert sizes["rr"] > sizes["fl"] == sizes["fr"]
    models = run.models()
    assert models["true"].shapes["fl"].omega.size > models["false"].shapes["fl"].omega.size


def test_inertia_shapes_of_one_copy_or_of_one_compared_model_are_its_own(tmp_path):
    """Mode sets of one method and cutoff that differ in `inertia` alone."""
    own = "    reduce: {inertia: true}\n"
    path = cart(tmp_path, copies=True, reduce="{cutoff: 3}", own=own, names=("fl", "fr", "rr"))
    compared = [f"    {each}: {{keep: all, reduce: {{inertia: {each}}}}}\n" for each in ("false", "true")]
    path.write_text(path.read_text() + "verify:\n  compare:\n" + "".join(compared))
    run = opened(path)
    sizes = {name: modal.omega.size for name, modal in run.final.items()}
    assert sizes["rr"] > sizes["fl"] == sizes["fr"]
    models = run.models()
    assert (
        models["true"].shapes["fl"].omega.size == sizes["rr"] and models["false"].shapes["rr"].omega.size < sizes["rr"]
    )
