"""Component files of earlier runs as bodies of a scene: they answer as they did where they were written."""

import numpy as np
import pytest

from cmsreduce.config import load_pipeline
from cmsreduce.errors import CmsReduceError, ConfigError
from cmsreduce.pipeline import Run, execute
from cmsreduce.steps import AssembledSystem
from cmsreduce.write import read_component
from tests.pipeline.study import ARM, PANEL, PIPELINE, Log

FREQUENCIES = [0.5, 7.0, 23.0, 58.0]
OF_FILES = """\
  arm:
    reduced: finished/arm.h5
    interfaces: {{root: {{set: root}}, tip: {{node: 5}}}}
"""
PANEL_OF_FILE = """\
  panel:
    reduced: finished/panel.h5
    interfaces: {{root: {{set: root}}}}
"""


def response(run, configuration=1):
    model = run.model.assembled
    return AssembledSystem(model, run.scene.configurations[configuration]).response(FREQUENCIES)


@pytest.fixture
def written(opened, study):
    """A run whose files another pipeline takes as its bodies, and a way to open that pipeline."""
    text = PIPELINE.replace("cutoff: 15", "cutoff: 8")
    run = opened(text=text)
    execute(run, study, report=False)
    run.folder.rename(study.parent / "finished")

    def open_files(text, *overrides):
        study.write_text(text.format(output=study.parent / "out"))
        pipeline = load_pipeline(study, overrides)
        return Run(pipeline, pipeline.output, Log())

    return run, text, open_files


@pytest.mark.parametrize("files", ["both", "one beside a finite-element body"])
def test_bodies_of_files_answer_as_the_bodies_that_were_written(written, files, study):
    first, text, open_files = written
    text = text.replace(ARM, OF_FILES)
    if files == "both":
        text = text.replace(PANEL, PANEL_OF_FILE)
    # All that is in the files: nothing is cut off again.
    again = open_files(text.replace("cutoff: 8", "cutoff: 10000") if files == "both" else text)
    if files != "both":
        again = open_files(text, "components.arm.reduce={cutoff: 10000}")
    for configuration in (0, 1):
        H, expected = response(again, configuration), response(first, configuration)
        np.testing.assert_allclose(H, expected, rtol=0, atol=1e-7 * abs(expected).max())
    for name in ("arm", "panel"):
        np.testing.assert_allclose(again.final[name].omega, first.final[name].omega, rtol=1e-7, atol=1e-2)
    execute(again, study, report=False)
    old, new = (read_component(study.parent / folder / "arm.h5") for folder in ("finished", "out"))
    for path in ("integrals/rigid_mass", "modes/damping", "nodes/xyz"):
        scale = abs(old.arrays[path]).max()
        np.testing.assert_allclose(new.arrays[path], old.arrays[path], rtol=0, atol=1e-8 * scale)
    flexibility = [
        file.arrays["interfaces/tip/shapes"][:, file.elastic] / file.omega[file.elastic] for file in (old, new)
    ]
    Fs = [shapes @ shapes.T for shapes in flexibility]
    np.testing.assert_allclose(Fs[1], Fs[0], rtol=0, atol=1e-8 * abs(Fs[0]).max())


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("{set: root}}, tip", "{set: rot}}, tip", "its file has no interface 'rot' (it has: root, tip)"),
        ("tip: {{node: 5}}", "tip: {{node: 4}}", "there is no node 4"),
        ("reduced: finished/arm.h5", "reduced: finished/summary.json", "this is no reduced body"),
        ("reduced: finished/arm.h5", "reduced: finished/system.h5", "system.h5: this HDF5 file is no component file"),
        ("reduced: finished/arm.h5", "reduced: arm.op4", "this is no reduced body"),
        ("reduced: finished/arm.h5", "reduced: finished/amr.h5", "there is no such file"),
        ("    reduced", "    units: mm-t-s\n    reduced", "states the units"),
    ],
)
def test_what_is_no_body_of_a_scene_is_refused(written, old, new, words):
    _, text, open_files = written
    text = text.replace(ARM, OF_FILES)
    run = open_files(text.replace(old, new))
    with pytest.raises(CmsReduceError) as refused:
        _ = run.bodies
    assert words in str(refused.value)


def test_a_file_beside_matrices_is_refused(written, study):
    _, text, open_files = written
    with pytest.raises(ConfigError, match=r"study.yaml:\d+: .*`reduced` is a whole body: take `geometry` out"):
        open_files(text.replace(ARM, OF_FILES + "    geometry: arm.bdf\n"))


def test_modes_that_cannot_move_the_interfaces_are_refused(written):
    _, text, open_files = written
    # Six rigid motions and four modes for two interfaces of six dofs.
    run = open_files(text.replace("balance: {{rank: gregory, keep: all}}", "balance: {{keep: {{modes: 4}}}}"))
    path = run.pipeline.output.parent / "study.yaml"
    execute(run, path, report=False)
    run = open_files(text.replace(ARM, OF_FILES.replace("finished", "out")))
    with pytest.raises(CmsReduceError, match="its 10 modes move the 12 interface dofs in 10 independent ways only"):
        _ = run.bodies
