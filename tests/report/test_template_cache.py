"""Templates are compiled once, again when they change, and never written where nothing is to be written."""

import sys

import pytest
from jinja2 import DictLoader, Environment

from cmsreduce.report import template_cache
from cmsreduce.report.template_cache import TemplateCache


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(template_cache, "__file__", str(tmp_path / "template_cache.py"))
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    (tmp_path / "__pycache__").mkdir()
    return tmp_path / "__pycache__"


def rendered(text, monkeypatch=None):
    environment = Environment(loader=DictLoader({"page": text}), bytecode_cache=TemplateCache())
    if monkeypatch is not None:
        monkeypatch.setattr(environment, "_generate", None)
    return environment.get_template("page").render(n=7)


def test_a_template_is_compiled_once(folder, monkeypatch):
    assert rendered("{{ n }} modes") == "7 modes"
    assert [path.suffix for path in folder.iterdir()] == [".template"]
    # Without the compiler.
    assert rendered("{{ n }} modes", monkeypatch) == "7 modes"


def test_a_changed_template_is_compiled_again(folder):
    rendered("{{ n }} modes")
    assert rendered("{{ n + 1 }} shapes") == "8 shapes"
    assert rendered("{{ n + 1 }} shapes") == "8 shapes"


@pytest.mark.parametrize("left", [0, 2, 44, 60, 300])
def test_a_damaged_file_is_made_again(folder, left):
    rendered("{{ n }}")
    (file,) = folder.iterdir()
    whole = file.read_bytes()
    file.write_bytes(whole[:left])
    assert rendered("{{ n }}") == "7" and file.read_bytes() == whole


def test_nothing_is_written_where_python_writes_no_bytecode(folder, monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    assert rendered("{{ n }}") == "7" and not list(folder.iterdir())


def test_a_folder_that_is_not_there_is_no_error(folder):
    folder.rmdir()
    assert rendered("{{ n }}") == "7" and not folder.exists()
