"""The JSON Schema documents every key; presets and starter follow the grammar."""

import json
from pathlib import Path

import pytest

from cmsreduce.config import build_scene, json_schema, load_pipeline, starter_pipeline
from cmsreduce.errors import ConfigError

CONFIGS = Path(__file__).parents[3] / "configs"


def objects(schema):
    """Every mapping of a schema that has properties."""
    if isinstance(schema, dict):
        if "properties" in schema and "type" in schema:
            yield schema
        for value in schema.values():
            yield from objects(value)
    elif isinstance(schema, list):
        for value in schema:
            yield from objects(value)


def test_every_key_of_the_schema_is_described():
    schema = json_schema()
    json.dumps(schema)
    keys = {}
    for mapping in objects(schema):
        assert mapping.get("description"), mapping.get("title")
        keys |= mapping["properties"]
    assert [key for key, value in keys.items() if not value.get("description")] == []
    assert {
        "stiffness",
        "articulation",
        "from",
        "hankel_fraction",
        "cutoff",
        "frf_error",
        "bound",
        "all_nodes",
    } <= keys.keys()


def test_schema_offers_the_choices_and_the_short_forms():
    parts = json_schema()["$defs"]
    assert "craig-bampton" in parts["ReduceKeys"]["properties"]["method"]["enum"]
    assert {"type": "string"} in parts["MatrixFile"]["anyOf"]
    assert {"const": "all"} in parts["KeepKeys"]["anyOf"]
    assert [form["type"] for form in parts["Articulation"]["anyOf"]] == ["object", "array"]
    assert json_schema()["additionalProperties"] is False
    assert json_schema()["required"] == ["name", "components", "scene"]


def test_starter_follows_the_grammar(tmp_path):
    text = starter_pipeline("probe")
    (tmp_path / "probe.yaml").write_text(text)
    pipeline = load_pipeline(tmp_path / "probe.yaml")
    scene = build_scene(pipeline)
    assert (pipeline.name, pipeline.output, scene.base) == ("probe", Path("build/probe"), "hub")
    assert [c.name for c in scene.configurations] == ["spin=0", "spin=45", "spin=90"]
    assert "NAME" not in text
    assert sum("#" in line for line in text.splitlines()) >= 15


@pytest.mark.parametrize("name", ["2024", "true", "null", "1e5"])
def test_starter_of_a_name_that_yaml_reads_as_something_else(tmp_path, name):
    (tmp_path / "p.yaml").write_text(starter_pipeline(name))
    assert load_pipeline(tmp_path / "p.yaml").name == name


@pytest.mark.parametrize("name", ["a.b", "a b", "../x", ""])
def test_starter_refuses_names_that_are_no_file_names(name):
    with pytest.raises(ConfigError, match="is no name"):
        starter_pipeline(name)


@pytest.mark.parametrize(
    ("preset", "cutoff", "points", "frf_error"), [("default", 2.0, 400, 0.05), ("strict", 4.0, 1000, 0.01)]
)
def test_presets(tmp_path, preset, cutoff, points, frf_error):
    (tmp_path / "p.yaml").write_text(
        f"name: p\ninclude: {CONFIGS / preset}.yaml\ncomponents: {{a: {{extseout: a}}}}\nscene: {{band: 10}}\n"
    )
    pipeline = load_pipeline(tmp_path / "p.yaml")
    assert (pipeline.reduce.method, pipeline.reduce.cutoff_bands) == ("craig-bampton", cutoff)
    assert (pipeline.verify.frf.points, pipeline.verify.limits.frf_error) == (points, frf_error)
    assert pipeline.write.formats == ("hdf5",)
