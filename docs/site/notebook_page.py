"""Pages of the notebooks: each is run when the site is built, and shown with its results."""

from __future__ import annotations

import ast
import json
import shutil
from collections.abc import Iterator
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

__all__ = ["PLOTLY", "missing_program", "notebook_page", "plotly_script", "run_cells"]

PLOTLY = "assets/plotly.min.js"
"""Plotting library of the pages, one file for all of them."""


def run_cells(notebook: Path, names: dict[str, Any]) -> Iterator[tuple[str, str, Any]]:
    """Run a notebook as a kernel does.

    Parameters
    ----------
    notebook : Path
    names : dict
        Namespace of the cells, which they fill.

    Yields
    ------
    kind, source, value : str, str, object
        Kind and text of a cell; the value of its last line, None if that is no expression.
    """
    for cell in json.loads(notebook.read_text(encoding="utf-8"))["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] != "code":
            yield cell["cell_type"], source, None
            continue
        if cell["outputs"]:
            raise ValueError(f"{notebook.name}: results are not stored with a notebook")
        tree = ast.parse(source)
        last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
        exec(compile(tree, notebook.name, "exec"), names)
        value = None
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), notebook.name, "eval"), names)
        yield "code", source, value


def missing_program(notebook: Path) -> str:
    """Program that the notebook needs and that is not on the PATH; empty if there is none."""
    needs: str = json.loads(notebook.read_text(encoding="utf-8"))["metadata"].get("needs", "")
    return "" if not needs or shutil.which(needs) else needs


def notebook_page(notebook: Path, root: str) -> str:
    """Markdown of a notebook with the results of its cells, or without them where a program is missing.

    Parameters
    ----------
    notebook : Path
    root : str
        Path from the page to the root of the site.
    """
    parts = [f"[Download this notebook]({notebook.name})", f'<script src="{root}{PLOTLY}"></script>']
    if missing := missing_program(notebook):
        parts.append(f"Shown without results: `{missing}` was not there when this page was made.")
        cells: Any = ((cell["cell_type"], "".join(cell["source"]), None) for cell in _cells(notebook))
    else:
        cells = run_cells(notebook, {})
    for kind, source, value in cells:
        parts.append(source if kind == "markdown" else f"```python\n{source}\n```")
        if value is not None:
            parts.append(_shown(value))
        if len(parts) == 3:
            # The title stays the first line of the page.
            parts.insert(0, parts.pop())
    return "\n\n".join(parts) + "\n"


def plotly_script() -> str:
    """Text of the plotting library."""
    return files("plotly").joinpath("package_data", "plotly.min.js").read_text(encoding="utf-8")


def _cells(notebook: Path) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    return found


def _shown(value: Any) -> str:
    """HTML of a value as a notebook shows it, in one block of the page."""
    if hasattr(value, "to_plotly_json"):
        html = value.to_html(full_html=False, include_plotlyjs=False, config={"displaylogo": False})
    elif hasattr(value, "_repr_html_"):
        html = value._repr_html_()
    else:
        html = f"<pre>{escape(repr(value))}</pre>"
    # A blank line would end the block.
    return f'<div class="result">{"".join(line for line in html.splitlines(keepends=True) if line.strip())}</div>'
