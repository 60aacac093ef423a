"""The site holds every page, and the reference every key and every public name."""

from __future__ import annotations

import importlib.util
import json
import re
import sys
from collections.abc import Iterator
from types import ModuleType
from typing import Any

import pytest
from ruamel.yaml import YAML

import cmsreduce
from cmsreduce.config import json_schema
from cmsreduce.config.grammar import field_at
from tests.docs.pages import ROOT
from tests.docs.test_links import LINKED
from tests.report.browser import launched, needs_browser, opened

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
    private = {
        "__init__",
        "__main__",
        "linalg",
        "mechanics",
        "multifrontal",
        *(room for room in rooms if room.startswith("cli")),
    }
    assert set(api.ROOMS) == rooms - private
    assert "::: cmsreduce.reduce.craig_bampton.CraigBampton\n" in api.api_page("reduce")
    assert cmsreduce.__version__


def test_every_page_is_in_the_navigation() -> None:
    text = (SITE / "mkdocs.yml").read_text()
    notebooks = [str(path.relative_to(ROOT).with_suffix(".md")) for path in ROOT.glob("examples/notebooks/*.ipynb")]
    assert {page for page in (*LINKED, *notebooks) if f": {page}\n" not in text} == set()


BUILT = ROOT / "build" / "site" / "index.html"


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with launched() as found:
        yield found


@pytest.mark.chromium
@needs_browser
@pytest.mark.skipif(not BUILT.is_file(), reason="`make docs` was not run; CI runs it before the tests")
class TestInABrowser:
    """The site as it lies on the disk, without a network."""

    @pytest.mark.parametrize(
        ("typed", "page", "title"),
        [
            ("shuffled", "docs/howto.html", "Questions and answers"),
            ("which mode set", "docs/howto.html", "Questions and answers"),
            ("cholmod", "docs/large-bodies.html", "Large bodies"),
        ],
    )
    def test_a_word_is_found(self, browser: Any, typed: str, page: str, title: str) -> None:
        with opened(browser, BUILT) as found:
            found.page.click("input.md-search__input")
            found.page.keyboard.type(typed)
            link = found.page.locator(f"a.md-search-result__link[href*='{page}']").first
            link.wait_for(timeout=60_000)
            link.click()
            found.page.wait_for_url(f"**/{page}*")
            assert typed in found.page.inner_text("article").lower()
            assert title in found.page.title()
            assert found.faults == []

    def test_a_word_that_is_nowhere_is_not_found(self, browser: Any) -> None:
        with opened(browser, BUILT) as found:
            found.page.click("input.md-search__input")
            found.page.keyboard.type("qwertzuiop")
            found.page.wait_for_function(
                "document.querySelector('.md-search-result__meta').innerText.startsWith('No ')"
            )
            assert found.page.locator("a.md-search-result__link").count() == 0

    def test_a_notebook_shows_its_plots(self, browser: Any) -> None:
        with opened(browser, BUILT.parent / "examples/notebooks/first_reduction.html") as found:
            found.page.wait_for_function("document.querySelectorAll('.js-plotly-plot .main-svg').length > 2")
            assert "PASS" in found.page.inner_text("article")
            assert found.page.locator("article table.dataframe").count() == 2
            # Plotly reads its canvas back, which the browser finds slow.
            assert [fault for fault in found.faults if not re.search("Canvas2D|GL Driver", fault)] == []

    def test_the_first_page_has_picture_command_and_roads(self, browser: Any) -> None:
        with opened(browser, BUILT) as found:
            assert found.page.evaluate("document.querySelector('article img').naturalWidth") > 600
            assert "cmsreduce run pipelines/galileo.yaml" in found.page.inner_text("article pre")
            assert len(found.page.inner_text("article").split()) < 300
            assert found.faults == []

    def test_a_page_is_dark_where_the_system_is_and_fits_a_phone(self, browser: Any) -> None:
        page = BUILT.parent / "docs/component-file.html"
        for scheme, dark in (("light", False), ("dark", True)):
            with opened(browser, page, width=390, color_scheme=scheme) as found:
                ground = found.page.evaluate("getComputedStyle(document.body).backgroundColor")
                assert (max(int(part) for part in re.findall(r"\d+", ground)[:3]) < 100) == dark, ground
                assert found.page.evaluate("document.documentElement.scrollWidth") <= 390
                assert found.faults == []
