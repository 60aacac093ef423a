"""The points of a sweep: product, names, and what is wrong with a key or a combination."""

from __future__ import annotations

from pathlib import Path

import pytest

from cmsreduce.errors import ConfigError
from cmsreduce.pipeline.batch import sweep_axes
from cmsreduce.pipeline.batch.sweep_points import sweep_points


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("reduce.cutoff=1.5,2, 4", ("1.5", "2", "4")),
        ("reduce.method=craig-bampton, macneal-rubin", ("craig-bampton", "macneal-rubin")),
        ("balance.keep.modes={arm: 3, panel: 4},{arm: 5, panel: 6}", ("{arm: 3, panel: 4}", "{arm: 5, panel: 6}")),
        ("scene.articulation.hinge=[0, 50 deg],[0],90 deg", ("[0, 50 deg]", "[0]", "90 deg")),
        ("balance.keep={modes: 10},{frf_error: 0.01},all", ("{modes: 10}", "{frf_error: 0.01}", "all")),
        ('name_of.a="x, y",z', ('"x, y"', "z")),
        ("reduce.cutoff=2,2,2", ("2",)),
        ("verify.compare={}", ("{}",)),
        ("project=null,{modes: auto}", ("null", "{modes: auto}")),
    ],
)
def test_values_are_yaml(text: str, values: tuple[str, ...]) -> None:
    (found,) = sweep_axes([text]).values()
    assert found == values


@pytest.mark.parametrize(
    ("texts", "message"),
    [
        (["reduce.cutoff"], r"--over reduce\.cutoff: write KEY=V1,V2"),
        (["reduce.cutoff="], "write KEY=V1,V2"),
        (["=1,2"], "write KEY=V1,V2"),
        (["reduce..cutoff=1"], "write KEY=V1,V2"),
        (["reduce.cutoff=[1, 2"], "YAML syntax"),
        (["reduce.cutoff=1],[2"], "YAML syntax"),
        (["output=a,b"], "cannot be swept"),
        (["reduce.cutoff=1", "reduce.cutoff=2"], "given twice"),
        ([], "at least one --over"),
    ],
)
def test_what_is_no_sweep_is_refused(texts: list[str], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        sweep_axes(texts)


def test_the_product_in_order_with_the_first_key_slowest(study: Path) -> None:
    axes = sweep_axes(["reduce.cutoff=10,15", "balance.keep={modes: 3},{modes: 4},all"])
    points = sweep_points(study, axes, ["verify.frf.points=50"])
    assert [[value for _, value in point.axes] for point in points] == [
        ["10", "{modes: 3}"],
        ["10", "{modes: 4}"],
        ["10", "all"],
        ["15", "{modes: 3}"],
        ["15", "{modes: 4}"],
        ["15", "all"],
    ]
    assert points[4].overrides == ("verify.frf.points=50", "reduce.cutoff=15", "balance.keep={modes: 4}")
    pipeline = points[4].pipeline
    assert pipeline is not None and pipeline.reduce is not None and pipeline.reduce.cutoff_bands == 15
    assert pipeline.balance is not None and pipeline.balance.keep.modes_of("arm") == 4
    assert points[2].folder == "cutoff=10_keep=all"
    assert len({point.folder for point in points}) == 6
    # They differ only downstream of the full system.
    assert len({point.system for point in points}) == 1


def test_angles_damping_and_files_make_another_full_system(study: Path) -> None:
    for text in (
        "scene.articulation.hinge=0,50 deg",
        "components.arm.damping.modal=0.01,0.02",
        "scene.band=50 Hz,60 Hz",
    ):
        assert len({point.system for point in sweep_points(study, sweep_axes([text]))}) == 2, text


@pytest.mark.parametrize("value", ["../../../etc", "/tmp/x", "a" * 300, "..", "{modes: 3}", "ü"])
def test_a_folder_is_one_plain_name_inside_the_sweep(study: Path, value: str) -> None:
    axes = sweep_axes([f"components.arm.stiffness.file={value},arm.op4"])
    first, second = sweep_points(study, axes)
    assert "/" not in first.folder and not first.folder.startswith(".") and len(first.folder) < 100
    assert first.folder != second.folder and first.folder.isascii()


def test_a_key_that_is_unknown_is_named_as_it_was_typed(study: Path) -> None:
    with pytest.raises(ConfigError, match=r"^--over reduce\.cutof=1\.5: key 'reduce\.cutof' is unknown: did you mean"):
        sweep_points(study, sweep_axes(["reduce.cutof=1.5,2"]))
    with pytest.raises(ConfigError, match=r"^--set redoce\.cutoff=1: key 'redoce' is unknown"):
        sweep_points(study, sweep_axes(["reduce.cutoff=1,2"]), ["redoce.cutoff=1"])


def test_a_combination_that_is_bad_input_says_why_and_the_others_stay(study: Path) -> None:
    points = sweep_points(study, sweep_axes(["reduce.cutoff=10,-1"]))
    assert [point.pipeline is not None for point in points] == [True, False]
    assert points[1].message.startswith("--over reduce.cutoff=-1: key 'reduce.cutoff': found the number -1")
