"""Includes, overrides, file names: which value wins and where a name leads."""

from pathlib import Path

import pytest

from cmsreduce.config import Pipeline, load_pipeline
from cmsreduce.errors import ConfigError, ReadError


def test_file_names_are_relative_to_their_file_and_output_to_the_working_directory(galileo):
    pipeline = load_pipeline(galileo)
    rotor, stator = pipeline.components["rotor"], pipeline.components["stator"]
    top = galileo.parents[1]
    assert rotor.stiffness.file == top / "sample_models/galileo/rotor.op4"
    assert rotor.geometry.file == top / "sample_models/galileo/rotor.bdf"
    assert stator.extseout == top / "bodies/stator"
    assert pipeline.output == Path("build/galileo")
    assert [file.resolve() for file in pipeline.include] == [top / "configs/default.yaml"]


def test_file_names_in_an_included_file_are_relative_to_that_file(tmp_path):
    (tmp_path / "bodies/plate").mkdir(parents=True)
    (tmp_path / "bodies/plate/plate.yaml").write_text(
        "components:\n  plate: {stiffness: k.npz, mass: ../m.npz, rows: plate.dof}\n"
    )
    (tmp_path / "study.yaml").write_text("name: s\ninclude: bodies/plate/plate.yaml\nscene: {band: 5 Hz}\n")
    plate = load_pipeline(tmp_path / "study.yaml").components["plate"]
    assert plate.stiffness.file == tmp_path / "bodies/plate/k.npz"
    assert plate.mass.file == tmp_path / "bodies/m.npz"
    assert plate.rows.file == tmp_path / "bodies/plate/plate.dof"


def test_relative_pipeline_gives_relative_names(galileo, monkeypatch):
    monkeypatch.chdir(galileo.parents[1])
    pipeline = load_pipeline(Path("pipelines/galileo.yaml"))
    assert pipeline.components["rotor"].mass.file == Path("sample_models/galileo/rotor.op4")


def test_up_from_a_symbolic_link_is_not_shortened(tmp_path):
    (tmp_path / "real/deep").mkdir(parents=True)
    (tmp_path / "link").symlink_to(tmp_path / "real/deep")
    (tmp_path / "p.yaml").write_text(
        "name: p\ncomponents: {a: {stiffness: link/../k.mtx, mass: m.mtx}}\nscene: {band: 1}\n"
    )
    found = load_pipeline(tmp_path / "p.yaml").components["a"].stiffness.file
    assert found.parent.resolve() == (tmp_path / "real").resolve()


def test_extseout_stands_for_three_files_and_explicit_keys_win(edited):
    path = edited(
        "extseout: ../bodies/stator", "extseout: ../bodies/stator.v2.op4\n    mass: {file: m.op4, matrix: M2}"
    )
    stator = load_pipeline(path).components["stator"]
    bodies = path.parents[1] / "bodies"
    assert (stator.stiffness.file, stator.stiffness.matrix) == (bodies / "stator.v2.op4", "KXX")
    assert (stator.mass.file, stator.mass.matrix) == (path.parent / "m.op4", "M2")
    assert stator.geometry.file == bodies / "stator.v2.asm"


def test_the_file_wins_over_its_include_key_by_key(galileo):
    pipeline = load_pipeline(galileo)
    assert (pipeline.reduce.method, pipeline.reduce.cutoff_bands) == ("craig-bampton", 3.0)
    assert pipeline.verify.frf.points == 300
    limits = pipeline.verify.limits.model_dump(exclude_none=True)
    assert limits == {"frf_error": 0.05, "db_error": 1.0, "frequency_error": 1e-3}


def test_of_several_includes_the_later_wins_and_nested_ones_come_first(tmp_path):
    files = {
        "a.yaml": "include: base.yaml\nreduce: {cutoff: 2}\nwrite: {}\n",
        "b.yaml": "reduce: {cutoff: 3}\n",
        "base.yaml": "reduce: {method: guyan, cutoff: 1}\nscene: {band: 7 Hz, base: hub}\n",
        "p.yaml": "name: p\ninclude: [a.yaml, b.yaml]\n"
        "components: {hub: {rigid: {mass: 1, inertia: [1, 1, 1, 0, 0, 0]}}}\n",
    }
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    pipeline = load_pipeline(tmp_path / "p.yaml")
    assert (pipeline.reduce.method, pipeline.reduce.cutoff_bands) == ("guyan", 3.0)
    assert pipeline.scene.band == (0.0, 7.0)
    assert pipeline.write.formats == ("hdf5",)
    assert [file.name for file in pipeline.include] == ["a.yaml", "base.yaml", "b.yaml"]


def test_another_alternative_replaces_that_of_the_include(tmp_path):
    (tmp_path / "base.yaml").write_text(
        "components: {a: {stiffness: k.mtx, mass: m.mtx, damping: {rayleigh: {alpha: 0.1}}}}\n"
        "balance: {rank: frequency, keep: {modes: 5}}\n"
    )
    (tmp_path / "p.yaml").write_text(
        "name: p\ninclude: base.yaml\nscene: {band: 1}\n"
        "components: {a: {damping: {modal: 0.02}}}\nbalance: {keep: {frf_error: 0.1}}\n"
    )
    pipeline = load_pipeline(tmp_path / "p.yaml")
    assert pipeline.components["a"].damping.law().modal == 0.02
    assert pipeline.components["a"].damping.rayleigh is None
    assert pipeline.balance.rank == "frequency"
    assert (pipeline.balance.keep.rule, pipeline.balance.keep.frf_error) == ("frf_error", 0.1)


@pytest.mark.parametrize(
    ("overrides", "read", "expected"),
    [
        (["reduce.cutoff=5"], lambda p: p.reduce.cutoff_bands, 5.0),
        (["reduce.cutoff=5", "reduce.cutoff=6"], lambda p: p.reduce.cutoff_bands, 6.0),
        (["balance.keep={modes: {rotor: 19, stator: 15}}"], lambda p: p.balance.keep.modes_of("stator"), 15),
        (["balance.keep.modes=12"], lambda p: p.keep_of("rotor").modes_of("rotor"), 12),
        (["balance.keep=all"], lambda p: p.balance.keep.rule, "all"),
        (["balance.keep.hankel_fraction=1e-4"], lambda p: p.balance.keep.fraction, 1e-4),
        (["verify=null"], lambda p: p.verify, None),
        (["scene.band=[6 rpm, 600]"], lambda p: p.scene.band, (0.1, 10.0)),
        (["scene.band=12.5"], lambda p: p.scene.band, (0.0, 12.5)),
        (["scene.sensors.los.rows.rotor.1300.x=3"], lambda p: p.scene.sensors["los"].rows["rotor.1300.x"], 3.0),
        (["scene.sensors.los.rows.rotor.8.y=4"], lambda p: p.scene.sensors["los"].rows["rotor.8.y"], 4.0),
        (["scene.articulation.spin.1=60 deg"], lambda p: p.scene.articulation.product["spin"].values[1].value, 60.0),
        (["components.rotor.stiffness.matrix=K2"], lambda p: p.components["rotor"].stiffness.matrix, "K2"),
        (["components.rotor.stiffness=k.mtx"], lambda p: p.components["rotor"].stiffness.file, Path("k.mtx")),
        (
            ["components.rotor.geometry=r.bdf", "components.rotor.geometry.format=bulk"],
            lambda p: (p.components["rotor"].geometry.file, p.components["rotor"].geometry.format),
            (Path("r.bdf"), "bulk"),
        ),
        (["scene.articulation={spin: [0]}"], lambda p: list(p.scene.articulation.product), ["spin"]),
        (
            ["components.stator.interfaces.spin_bearing=9"],
            lambda p: p.components["stator"].interfaces["spin_bearing"].node,
            9,
        ),
        (["components.rotor.damping.structural=0.02"], lambda p: p.components["rotor"].damping.law().law, "structural"),
    ],
)
def test_overrides_win(galileo, overrides, read, expected):
    assert read(load_pipeline(galileo, overrides)) == expected


def test_per_component_keys_are_laid_over_the_stage(galileo):
    pipeline = load_pipeline(galileo, ["components.stator.balance={keep: {modes: 4}}"])
    assert (pipeline.reduce_of("rotor").method, pipeline.reduce_of("rotor").cutoff_bands) == ("guyan", 3.0)
    assert pipeline.reduce_of("stator").method == "craig-bampton"
    assert (pipeline.balance_of("stator").rank, pipeline.keep_of("stator").modes_of("stator")) == ("gregory", 4)
    assert pipeline.keep_of("rotor").rule == "frf_error"


@pytest.mark.parametrize("key", ["balance.keep.frf_error", "balance.keep.bound", "project.frf_error"])
def test_errors_to_meet_are_written_as_limits_are(galileo, key):
    per_cent = load_pipeline(galileo, [f"{key.rpartition('.')[0]}={{{key.rpartition('.')[2]}: 2 %}}"])
    found = per_cent.balance.keep if key.startswith("balance") else per_cent.project
    assert getattr(found, key.rpartition(".")[2]) == 0.02
    with pytest.raises(ConfigError, match="2 %"):
        load_pipeline(galileo, [f"{key.rpartition('.')[0]}={{{key.rpartition('.')[2]}: 2}}"])


@pytest.mark.parametrize("written", ["0.5 dB", "0.5dB", "5e-1 db", "0.5"])
def test_decibels_may_have_their_unit(galileo, written):
    assert load_pipeline(galileo, [f"verify.limits.db_error={written}"]).verify.limits.db_error == 0.5


@pytest.mark.parametrize("written", ["0 dB", "-1 dB", "0.5 Hz", "dB"])
def test_other_decibels_are_refused(galileo, written):
    with pytest.raises(ConfigError, match="db_error"):
        load_pipeline(galileo, [f"verify.limits.db_error={written}"])


def test_a_stage_that_is_absent_is_not_run(tmp_path):
    (tmp_path / "p.yaml").write_text("name: p\ncomponents: {a: {extseout: a}}\nscene: {band: 1 kHz}\n")
    pipeline = load_pipeline(tmp_path / "p.yaml")
    assert [pipeline.reduce, pipeline.balance, pipeline.verify, pipeline.write] == [None] * 4
    assert pipeline.reduce_of("a") is None
    assert pipeline.output == Path("build/p")
    assert pipeline.scene.band == (0.0, 1000.0)


def test_anchors_and_merge_keys(tmp_path):
    (tmp_path / "p.yaml").write_text(
        "name: p\nscene: {band: 1}\ncomponents:\n"
        "  a: &body {stiffness: k.mtx, mass: m.mtx, damping: {modal: 0.01}}\n"
        "  b: {<<: *body, stiffness: k2.mtx}\n"
    )
    a, b = load_pipeline(tmp_path / "p.yaml").components.values()
    assert (a.stiffness.file.name, b.stiffness.file.name) == ("k.mtx", "k2.mtx")
    assert b.mass == a.mass and b.damping == a.damping


def test_yaml_1_2_words_and_numbers(tmp_path):
    (tmp_path / "p.yaml").write_text(
        "name: on\nscene: {band: 1e+1, sensors: {y: {at: no.cg, measure: [y, rx]}}}\n"
        "components: {no: {rigid: {mass: 1e-3, inertia: [.1, 1e-1, 0.1, 0, 0, 0]}}}\n"
    )
    pipeline = load_pipeline(tmp_path / "p.yaml")
    assert (pipeline.name, list(pipeline.components), pipeline.scene.band) == ("on", ["no"], (0.0, 10.0))
    assert pipeline.components["no"].rigid.mass == 1e-3
    assert pipeline.scene.sensors["y"].measure == ("y", "rx")


def test_a_dumped_pipeline_reads_back_the_same(galileo):
    pipeline = load_pipeline(
        galileo,
        [
            "scene.articulation={spin: {from: 0, to: 90 deg, steps: 4}, cone.ry: [0.1 rad]}",
            "components.platform.place={at: [0, 0, 120 mm], rotate: {axis: z, angle: 30 deg}}",
            "components.rotor.interfaces.spin_bearing.frame={axis: [1, 1, 0], angle: 1 rad}",
        ],
    )
    again = Pipeline.model_validate_json(pipeline.model_dump_json(by_alias=True))
    assert again.model_dump_json() == pipeline.model_dump_json()


def test_missing_files(galileo, edited):
    with pytest.raises(ReadError, match=r"galileo\.yml: there is no such file, did you mean .*galileo\.yaml\?"):
        load_pipeline(galileo.with_suffix(".yml"))
    with pytest.raises(ReadError, match="cannot be read"):
        load_pipeline(galileo.parent)
    path = edited("[../configs/default.yaml]", "[../configs/defaults.yaml]")
    with pytest.raises(
        ReadError, match=r"galileo\.yaml:3: key 'include': there is no file .*did you mean .*default\.yaml"
    ):
        load_pipeline(path)


def test_include_circle(tmp_path):
    for name, other in (("a", "b"), ("b", "c"), ("c", "a")):
        (tmp_path / f"{name}.yaml").write_text(f"name: {name}\ninclude: {other}.yaml\n")
    with pytest.raises(
        ConfigError, match=r"c\.yaml:2: key 'include': .*circle: .*a\.yaml -> .*b\.yaml -> .*c\.yaml -> "
    ):
        load_pipeline(tmp_path / "a.yaml")


def test_one_file_may_be_included_twice(tmp_path):
    (tmp_path / "base.yaml").write_text("scene: {band: 3}\n")
    (tmp_path / "a.yaml").write_text("include: base.yaml\ncomponents: {a: {extseout: a}}\n")
    (tmp_path / "p.yaml").write_text("name: p\ninclude: [a.yaml, base.yaml]\n")
    assert load_pipeline(tmp_path / "p.yaml").scene.band == (0.0, 3.0)


def test_a_link_to_no_file_is_named_with_what_it_names(tmp_path: Path) -> None:
    (tmp_path / "study.yaml").symlink_to("gone.yaml")
    with pytest.raises(ReadError, match=r"study\.yaml: there is no such file; the link names gone\.yaml$"):
        load_pipeline(tmp_path / "study.yaml")
