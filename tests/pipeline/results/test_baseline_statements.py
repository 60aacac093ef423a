"""Every item of a component file counts in the comparison with a baseline, and the basis of the modes does not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg as la
from pyyeti.nastran import op4

from cmsreduce.config import load_pipeline
from cmsreduce.pipeline import Run, Silent, execute
from cmsreduce.pipeline.results.baseline import StoredResult, compare
from cmsreduce.pipeline.results.limits import Tolerances
from cmsreduce.write import ComponentFile, read_component
from tests.pipeline.test_parameters import string_stiffness
from tests.spinning_beam import LENGTH, PIPELINE, beam, write_beam

# How a file came about, or what the rest of it determines.
DESCRIBES = {"modes/kind", "modes/source_hz", "modes/sigma", "modes/spacing", "modes/why", "geometric_stiffness/source"}
FOLLOWS = {
    *("modes/frequency_hz", "modes/zeta", "modes/stiffness", "nodes/translation", "nodes/rotation", "frame/removed"),
    *("interfaces/root/shapes", "interfaces/tip/shapes", "integrals/modes", "nodes/id", "dofs/node", "dofs/component"),
}
ASIDE = ("provenance/", "checks/", "seal/", "integration/", "modes/rankings/")
EDITS = {
    "  beam:\n": "  load:\n    rigid: {{mass: 0.2, inertia: [1e-3, 2e-3, 3e-3, 0, 0, 0]}}\n"
    "    interfaces: {{at: {{position: [2, 0, 0]}}}}\n  beam:\n",
    "  ground: beam.root\n": "  base: beam\n  joints: {{end: {{connect: [beam.tip, load.at], free: [rz]}}}}\n"
    "  parameters:\n    pull: {{values: [0, 20], stiffness: {{beam: {{file: kg.op4, matrix: KG}}}}}}\n"
    "    drag: {{values: [0, 2], damping: {{beam: {{file: kg.op4, matrix: DG}}}}, wheels: beam.turn}}\n",
    "geometric_stiffness:": "wheels: {{turn: {{at: 4, axis: [0, 0.6, 0.8], momentum: 0.1 N*m*s}}}}\n"
    "    geometric_stiffness:",
    "bars: all": "bars: [all, force tip, moment tip]",
    "method: craig-bampton": "method: macneal-rubin",
    "formats: [hdf5]": "formats: [hdf5], all_nodes: true, frame: {{kind: clamped, at: root}}, "
    "integrals: {{about: centre-of-mass}}",
    "verify: {{frf: {{points: 20}}}}\n": "",
}


@pytest.fixture(scope="module")
def rich(tmp_path_factory: pytest.TempPathFactory) -> ComponentFile:
    """A file with all that a component file may state, but structural damping."""
    folder, text = tmp_path_factory.mktemp("rich"), PIPELINE
    for before, after in EDITS.items():
        assert before in text
        text = text.replace(before, after, 1)
    e = np.zeros(54)
    e[6], e[36] = 1, -1
    op4.write(str(folder / "kg.op4"), {"KG": string_stiffness(beam(8), LENGTH), "DG": np.outer(e, e)})
    path = write_beam(folder, 8, text)
    pipeline = load_pipeline(path)
    execute(Run(pipeline, pipeline.output, Silent()), path, report=False)
    # The last three modes stand for shapes without mass.
    return replace(read_component(Path(pipeline.output) / "beam.h5"), static_count=3)


def broken(old: ComponentFile, new: ComponentFile) -> dict[str, str]:
    one, other = (StoredResult(Path("run"), None, {"beam": file}) for file in (old, new))
    found = compare(one, other, Tolerances())
    return {each.name.removeprefix("baseline: "): each.note for each in found if not each.passed}


def test_every_item_of_the_file_counts(rich: ComponentFile) -> None:
    groups = ("augmented", "frame", "geometric_stiffness", "integrals", "interfaces", "nodes", "parameters/drag")
    assert rich.rigid_count == 6 and rich.static_count and all(group in rich.attributes for group in groups)
    paths = {path for path in (*rich.arrays, *rich.texts) if not path.startswith(ASIDE)}
    assert paths >= (DESCRIBES | FOLLOWS)
    for path in sorted(paths - DESCRIBES - FOLLOWS):
        if path in rich.texts:
            changed = replace(rich, texts={**rich.texts, path: tuple(f"{text}1" for text in rich.texts[path])})
        else:
            value = rich.arrays[path]
            more = value + 1 if value.dtype.kind == "i" else 1.01 * value + 0.01 * max(abs(value).max(), 1e-3)
            changed = replace(rich, arrays={**rich.arrays, path: more})
        assert broken(rich, changed), path
    for group in groups:
        less = {path: value for path, value in rich.arrays.items() if not path.startswith(f"{group}/")}
        texts = {path: value for path, value in rich.texts.items() if not path.startswith(f"{group}/")}
        for old, new in (
            (rich, replace(rich, arrays=less, texts=texts)),
            (replace(rich, arrays=less, texts=texts), rich),
        ):
            assert f" {group}/" in broken(old, new)["statements lost or new"], group


CHANGED = {
    "units": ("units", "length_in_si", 1e-3, "definitions lost or new", "units length_in_si=0.001"),
    "frame": ("frame", "at", "tip", "definitions lost or new", "lost frame at=root; new frame at=tip"),
    "power": ("parameters/pull", "stiffness_power", 2, "definitions lost or new", "parameters/pull stiffness_power=2"),
    "mass": ("integrals", "lumping", "diagonal", "definitions lost or new", "integrals lumping=diagonal"),
}


@pytest.mark.parametrize(("group", "name", "value", "finding", "says"), CHANGED.values(), ids=CHANGED)
def test_facts_that_define_numbers(rich: ComponentFile, group, name, value: Any, finding: str, says: str) -> None:
    attributes = {**rich.attributes, group: {**rich.attributes[group], name: value}}
    found = broken(rich, replace(rich, attributes=attributes))
    assert list(found) == [finding] and says in found[finding]


def test_one_entry_of_one_load_and_of_a_rigid_mode(rich: ComponentFile) -> None:
    K, at = rich.arrays["geometric_stiffness/K"].copy(), rich.texts["geometric_stiffness/load"].index("centrifugal zz")
    K[at, 6, 6] *= 1.01
    changed = replace(rich, arrays={**rich.arrays, "geometric_stiffness/K": K})
    assert broken(rich, changed) == {"geometric stiffness": "of centrifugal zz"}
    G = rich.arrays["modes/gyroscopic"].copy()
    G[:6, :6] *= 1.01
    changed = replace(rich, arrays={**rich.arrays, "modes/gyroscopic": G})
    assert broken(rich, changed) == {"damping": "of gyroscopic"}
    frame = rich.arrays["interfaces/tip/frame"][[1, 2, 0]]
    changed = replace(rich, arrays={**rich.arrays, "interfaces/tip/frame": frame})
    assert broken(rich, changed) == {"places and axes": "of interfaces/tip/frame"}


def test_the_basis_of_the_modes_is_no_change(rich: ComponentFile) -> None:
    """Another rotation of rigid and of static modes, other signs, and rounding where a load stresses nothing."""
    rng = np.random.default_rng(5)
    m, r, s = rich.omega.size, rich.rigid_count, rich.static_count
    turns = [np.linalg.qr(rng.standard_normal((k, k)))[0] for k in (r, s)]
    T = la.block_diag(turns[0], np.diag(rng.choice([-1.0, 1.0], m - r - s)), turns[1])
    e = T[r:, r:]
    arrays = dict(rich.arrays)
    for path, A in rich.arrays.items():
        if path in ("modes/mass", "modes/damping", "modes/gyroscopic") or path.startswith("parameters/"):
            arrays[path] = T.T @ A @ T
        elif path == "geometric_stiffness/K":
            noise = rng.standard_normal(A.shape) * 1e-13 * abs(A).max()
            arrays[path] = T.T @ (A + noise) @ T
        elif path in ("dofs/shapes", "outputs/C1", "outputs/C2", "integrals/int_phi", "integrals/int_r_x_phi"):
            arrays[path] = A @ T
        elif path == "inputs/B":
            arrays[path] = T.T @ A
        elif path in ("integrals/phi", "integrals/r_cross_phi", "integrals/r_phi"):
            arrays[path] = A @ e
        elif path == "integrals/phi_phi":
            arrays[path] = e.T @ A @ e
    assert broken(rich, replace(rich, arrays=arrays)) == {}
