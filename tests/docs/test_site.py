"""The site holds every page, and the reference every key and every public name."""

from __future__ import annotations

import importlib.util
import json
import re
import sys
from collections.abc import Iterator
from types import ModuleType

import pytest
from ruamel.yaml import YAML

import cmsreduce
from cmsreduce.config import json_schema
from cmsreduce.config.grammar import field_at
from tests.docs.pages import ROOT
from tests.docs.test_links import LINKED

SITE = ROOT / "docs" / "site"


def module(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, SITE / f"{name}.py")
    assert spec is not None and spec.loader is not None
    found = importlib.util.module_from_spec(spec)
    sys.modules[name] = found
    spec.loader.exec_module(found)
    return found


@pytest.fixture(scope="module")
def keys() -> ModuleType:
    return module("key_page")


def described(schema: object) -> Iterator[str]:
    if isinstance(schema, dict):
        for key in schema.get("properties", {}).values():
            yield key["description"]
        for value in schema.values():
            yield from described(value)
    elif isinstance(schema, list):
        for value in schema:
            yield from described(value)


def test_every_key_is_on_its_page(keys: ModuleType) -> None:
    schema = json_schema()
    page = keys.key_page(schema)
    assert all(text in page for text in described(schema))
    assert page == keys.key_page(json.loads(json.dumps(schema)))


def test_paths_are_those_of_the_grammar(keys: ModuleType) -> None:
    """Each path, walked along the grammar itself, leads to a key with the same description."""
    walked, above = 0, {}
    for path, key, _ in keys.schema_keys(json_schema()):
        steps = [0 if part == "[]" else part for part in path.replace("[]", ".[]").split(".")]
        # What may be one or a list of several is told once.
        fields = [field_at(steps), field_at([*steps[:-1], 0, steps[-1]])]
        above[path] = key["description"]
        # Keys that only a validator knows share the description of what holds them.
        own = {field.description for field in fields if field} - {
            text for place, text in above.items() if re.match(re.escape(place) + r"[.\[]", path)
        }
        if own:
            assert key["description"] in own, path
            walked += 1
    assert walked > 140


def test_examples_are_yaml(keys: ModuleType) -> None:
    blocks = re.findall(r"```yaml\n(.*?)```", keys.key_page(json_schema()), re.S)
    assert len(blocks) > 140
    for block in blocks:
        assert YAML(typ="safe").load(block) is not None


def test_every_room_has_a_page_with_its_names() -> None:
    api = module("api_pages")
    rooms = {
        path.stem for path in (ROOT / "cmsreduce").iterdir() if (path / "__init__.py").is_file() or path.suffix == ".py"
    }
    private = {"__init__", "linalg", "mechanics", "multifrontal", *(room for room in rooms if room.startswith("cli"))}
    assert set(api.ROOMS) == rooms - private
    assert "::: cmsreduce.reduce.craig_bampton.CraigBampton\n" in api.api_page("reduce")
    assert cmsreduce.__version__


def test_every_page_is_in_the_navigation() -> None:
    text = (SITE / "mkdocs.yml").read_text()
    assert {page for page in LINKED if f": {page}\n" not in text} == set()
