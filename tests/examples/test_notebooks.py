"""The notebooks run from top to bottom, each cell as a kernel runs it, and show what their text promises."""

from __future__ import annotations

import ast
import json
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "examples" / "notebooks").glob("*.ipynb"))


def values(notebook: Path) -> tuple[dict[str, Any], list[Any]]:
    """Names that the cells leave, and the value of each code cell's last line."""
    names: dict[str, Any] = {}
    shown = []
    for cell in json.loads(notebook.read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] != "code":
            continue
        assert cell["outputs"] == [], "results are not stored with a notebook"
        tree = ast.parse("".join(cell["source"]))
        last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
        exec(compile(tree, notebook.name, "exec"), names)
        if isinstance(last, ast.Expr):
            shown.append(eval(compile(ast.Expression(last.value), notebook.name, "eval"), names))
    return names, shown


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A clone whose build folder is empty."""
    for name in ("pipelines", "sample_models"):
        (tmp_path / name).symlink_to(ROOT / name)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(name: str) -> tuple[dict[str, Any], list[Any]]:
    return values(ROOT / "examples" / "notebooks" / f"{name}.ipynb")


def test_there_is_a_test_for_every_notebook() -> None:
    assert [path.stem for path in NOTEBOOKS] == ["choose_a_model", "couple_and_export", "first_reduction"]


def test_first_reduction(folder: Path) -> None:
    names, (finished, bode, ranking, modes, table, errors) = run("first_reduction")
    assert finished.passed and "PASS" in finished._repr_html_() and len(repr(finished)) < 200
    assert len(repr(finished.summary)) < 500
    assert bode.layout.title.text == "wheel → gyro, as built"
    assert sum(len(trace.x) for trace in ranking.data[:2]) == len(modes.data) - 1
    assert list(table["kind"][:2]) == ["rigid", "rigid"]
    assert errors["frf_error"].max() == pytest.approx(finished.result.worst()["frf_error"])
    with pytest.raises(names["cms"].CmsReduceError, match="errors, modes"):
        finished.table("error")


def test_choose_a_model(folder: Path) -> None:
    _, (runs, table, bode, mac) = run("choose_a_model")
    assert len(repr(runs)) < 1000
    # More modes, a smaller error.
    assert table["frf_error"].is_monotonic_decreasing
    assert bode.layout.yaxis2.title.text == "phase, deg" and mac.data[0].z.max() > 0.99


def test_couple_and_export(folder: Path) -> None:
    _, (table, hz, sizes, _) = run("couple_and_export")
    assert len(table) == 6 and (hz > 0).all()
    assert sizes[1:] == (1, 1)
    assert (folder / "build/notebooks/right.npz").is_file()
