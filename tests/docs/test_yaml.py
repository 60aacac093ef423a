"""Every YAML snippet of the documentation follows the grammar of the file that it is of."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML

from cmsreduce.config import Component, Pipeline, load_pipeline
from cmsreduce.pipeline.results import read_limits
from tests.docs.pages import PAGES, Snippet, inline, snippets

ELSEWHERE = {
    ("docs/ci.md", "name: reduction"): "GitHub's grammar; run in tests/cli/test_ci_page.py",
    ("docs/ci.md", "reduce:\n  image:"): "GitLab's grammar; run in tests/cli/test_ci_page.py",
}
"""Snippets of other programs' files: the page, how they begin, and where they are tested."""
BODY = {
    "stiffness": {"file": "a.op4", "matrix": "KAA"},
    "mass": {"file": "a.op4", "matrix": "MAA"},
    "geometry": "a.bdf",
}
"""What a body of a snippet has beside what is said of it there."""
PLACES = ("hinge", "root", "tip", "bearing", "spin_bearing")
"""Interfaces that snippets speak of without making them."""


def read(text: str) -> Any:
    return YAML(typ="safe").load(text)


def variants(text: str) -> Iterator[str]:
    """The snippet, and again with each commented alternative `# key: ...` in the place of the key."""
    yield text
    lines = text.split("\n")
    for number, line in enumerate(lines):
        if (found := re.match(r"(\s*)# (\w+): \{", line)) is not None:
            start = f"{found[1]}{found[2]}:"
            yield "\n".join(
                start.rstrip(":") + line.partition(f"# {found[2]}")[2] if at == number else other
                for at, other in enumerate(lines)
                if at == number or not other.startswith(start)
            )


def assert_loads(text: str, folder: Path) -> None:
    """Fill a snippet up to a whole file, and load it."""
    data = read(text)
    if set(data) <= {"max", "tolerance"}:
        (folder / "limits.yaml").write_text(text)
        read_limits(folder / "limits.yaml", (), ())
        return
    if not set(data) <= set(Pipeline.model_fields) and set(data) <= set(Component.model_fields):
        data = {"components": {"body": data}}
    assert set(data) <= set(Pipeline.model_fields), f"{sorted(data)} are no keys of a file known here"
    load_pipeline(written(filled(data), folder))


def filled(data: Mapping[str, Any]) -> dict[str, Any]:
    components = {**data.get("components", {})}
    components.update({name: {} for name in named_bodies(data) if name not in components})
    for name, keys in components.items():
        if "states" in keys:
            components[name] = {"geometry": "a.bdf", "rows": "a.dof", **keys}
        elif not {"rigid", "extseout", "modes", "reduced", "like"} & set(keys):
            components[name] = {**BODY, "interfaces": {place: {"node": 1} for place in PLACES}, **keys}
    scene = {"band": 10, **channels(next(iter(components))), **data.get("scene", {})}
    return {"name": "snippet", **data, "components": components, "scene": scene}


def channels(body: str) -> dict[str, Any]:
    """Actuators and sensors that snippets speak of without making them."""
    point = f"{body}.1"
    actuators = {"motor": {"at": point, "torque": [0, 0, 1]}, "thruster": {"at": point, "force": [0, 0, 1]}}
    return {"actuators": actuators, "sensors": {"gyro": {"at": point, "measure": ["rx", "ry", "rz"]}}}


def named_bodies(data: Mapping[str, Any]) -> list[str]:
    """Bodies that joints and rules of a snippet name, or one."""
    joints = data.get("scene", {}).get("joints", {}).values()
    named = [end.partition(".")[0] for joint in joints for end in joint["connect"]]
    return list(dict.fromkeys(named)) or ["body"]


def written(data: Mapping[str, Any], folder: Path) -> Path:
    stream = StringIO()
    YAML(typ="safe").dump(dict(data), stream)
    path = folder / "snippet.yaml"
    path.write_text(stream.getvalue())
    return path


def elsewhere(snippet: Snippet) -> bool:
    return any(snippet.page == page and snippet.text.startswith(start) for page, start in ELSEWHERE)


@pytest.mark.parametrize(
    "snippet", [s for page in PAGES for s in snippets(page) if s.language == "yaml" and not elsewhere(s)], ids=str
)
def test_yaml_follows_the_grammar(snippet: Snippet, tmp_path: Path) -> None:
    for text in variants(snippet.text):
        assert_loads(text, tmp_path)


def keys_in_the_text(page: str) -> list[str]:
    """Code that begins with a key of the grammar; what is left open with dots or without values is no snippet."""
    key = rf"({'|'.join([*Pipeline.model_fields, *Component.model_fields])}): "
    return [code for code in inline(page) if re.match(key, code) and not re.search(r"\.\.\.|:[,}]", code)]


@pytest.mark.parametrize("page", [page for page in PAGES if keys_in_the_text(page)])
def test_yaml_within_the_text_follows_the_grammar(page: str, tmp_path: Path) -> None:
    for code in keys_in_the_text(page):
        assert_loads(code, tmp_path)


def test_what_is_tested_elsewhere_is_still_there() -> None:
    found = [snippet for page in PAGES for snippet in snippets(page) if elsewhere(snippet)]
    assert len(found) == len(ELSEWHERE)
