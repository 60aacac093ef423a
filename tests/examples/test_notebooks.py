"""The notebooks run from top to bottom, each cell as a kernel runs it, and show what their text promises."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.docs.test_site import module

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "examples" / "notebooks").glob("*.ipynb"))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A clone whose build folder is empty."""
    for name in ("pipelines", "sample_models"):
        (tmp_path / name).symlink_to(ROOT / name)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(name: str) -> tuple[dict[str, Any], list[Any]]:
    """Names that the cells leave, and the values that they show, by the code that makes the pages of the site."""
    names: dict[str, Any] = {}
    cells = module("notebook_page").run_cells(ROOT / "examples" / "notebooks" / f"{name}.ipynb", names)
    return names, [value for _, _, value in cells if value is not None]


def test_there_is_a_test_for_every_notebook() -> None:
    tested = ["calculix_body", "choose_a_model", "couple_and_export", "first_reduction"]
    assert [path.stem for path in NOTEBOOKS] == tested


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


@pytest.mark.ccx
def test_calculix_body(folder: Path) -> None:
    """The frequencies of the bar from the files are those that CalculiX prints, to its printed digits."""
    names, (files, finished, hertz, bode, table, written) = run("calculix_body")
    assert {"bar.sti", "bar.mas", "bar.dof"} <= set(files)
    assert finished.passed and len(table) < names["body"].K.shape[0] / 10
    assert hertz.shape == (6, 2)
    np.testing.assert_allclose(names["ours"][6:12], names["calculix"][6:], rtol=1e-5)
    assert bode.layout.title.text.startswith("motor") and written[0].is_file()


def test_couple_and_export(folder: Path) -> None:
    _, (table, hz, sizes, _) = run("couple_and_export")
    assert len(table) == 6 and (hz > 0).all()
    assert sizes[1:] == (1, 1)
    assert (folder / "build/notebooks/right.npz").is_file()
