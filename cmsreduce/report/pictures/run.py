"""Static pictures of a run as files."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from cmsreduce.errors import WriteError
from cmsreduce.model import RunResult
from cmsreduce.report.pictures import charts
from cmsreduce.report.pictures.gains import gain_picture
from cmsreduce.report.pictures.open_loop import nichols_picture, nyquist_picture
from cmsreduce.report.pictures.scene import scene_picture, shapes_picture
from cmsreduce.report.pictures.still import draw_chart
from cmsreduce.report.wording import file_name, worst

__all__ = ["FIGURE_NAMES", "figure_pictures", "response_picture", "run_pictures", "write_pictures"]

FIGURE_NAMES = ("bode", "nyquist", "nichols", "error-cost", "mac", "modes", "scene", "errors", "gains")
"""Single pictures for papers and slides, at the worst configuration and channel."""


def response_picture(
    run: RunResult,
    path: Path,
    configuration: int = 0,
    channel: tuple[int, int] = (0, 0),
    *,
    phase: bool = False,
) -> None:
    """Draw the responses of the reference and of the reduced models, and their errors below.

    Parameters
    ----------
    run : RunResult
        With at least one configuration verified.
    path : Path
        File to write; its suffix says the format, such as ``.png`` (1200 x 780 pixels) or ``.svg``.
    configuration : int
        Number of the configuration, from 0.
    channel : (int, int)
        Numbers of output and input, from 0.
    phase : bool
        Draw the phase, too, in a panel between.

    Raises
    ------
    WriteError
        If the run has no such response.
    """
    try:
        chart = charts.responses(run, configuration, channel, phase=phase)
    except WriteError as error:
        raise WriteError(f"{path}: {error}") from error
    draw_chart(chart, path)


def write_pictures(run: RunResult, folder: Path, suffix: str = ".png") -> list[Path]:
    """Draw a run: scene, modes, responses of every channel at the worst configuration, errors; return the files.

    Parameters
    ----------
    run : RunResult
    folder : Path
        Made if it does not exist.
    suffix : {".png", ".svg"}
        Format.
    """
    folder.mkdir(parents=True, exist_ok=True)
    made = []
    for name, draw in run_pictures(run).items():
        made.append(folder / f"{name}{suffix}")
        draw(made[-1])
    return made


class _ByFile(dict[str, Callable[[Path], None]]):
    """Pictures by the names of their files, each of its own also where file systems ignore case."""

    def add(self, name: str, draw: Callable[[Path], None]) -> None:
        """Add a picture; of several with one name, the later ones are numbered."""
        name, taken, number = file_name(name), {known.lower() for known in self}, 1
        while (own := name if number == 1 else f"{name}.{number}").lower() in taken:
            number += 1
        self[own] = draw


def run_pictures(run: RunResult) -> dict[str, Callable[[Path], None]]:
    """Every picture of a run, by the name of its file without suffix: functions that draw into a file."""
    found = _ByFile()
    names = [result.configuration.name for result in run.configurations]
    rows = worst(run, run.model)
    at = names.index(rows[0][1].note) if rows else 0
    if run.drawing is not None:
        where = names[at] if names else next(iter(run.drawing.systems))
        found["scene"] = partial(scene_picture, run.drawing, where)
        if run.drawing.systems[where].hz.size:
            found["shapes"] = partial(shapes_picture, run.drawing, where)
    if run.configurations:
        found["errors"] = partial(draw_chart, charts.errors_by_configuration(run))
        for o, output in enumerate(run.outputs):
            for i, given in enumerate(run.inputs):
                channel = partial(response_picture, run, configuration=at, channel=(o, i))
                found.add(f"response_{given}_{output}", channel)
        errors = run.configurations[at].errors.get(run.model)
        if errors is not None and errors.mac_matrix is not None and errors.mac_matrix.mac.size:
            found["mac"] = partial(draw_chart, charts.mac(errors.mac_matrix, names[at]))
    for name, part in run.components.items():
        if np.isfinite(part.modes.sigma).any():
            found.add(f"sigma_{name}", partial(draw_chart, charts.ranking(part)))
        if name in run.effective_mass:
            masses = charts.effective_mass(name, run.effective_mass[name])
            found.add(f"effective_mass_{name}", partial(draw_chart, masses))
    if run.gains:
        found["gains"] = partial(gain_picture, run, names[at] if names else next(iter(run.gains)))
    return found


def figure_pictures(run: RunResult) -> dict[str, Callable[[Path], None]]:
    """Pictures of `FIGURE_NAMES` that a run has data for: functions that draw into a file.

    Parameters
    ----------
    run : RunResult
        ``bode`` is the worst channel at its worst configuration, with phase; ``nyquist`` and ``nichols`` are the
        controller's open loop where it has the least margin, or the same channel.
    """
    every = run_pictures(run)
    found = {"modes": every["shapes"]} if "shapes" in every else {}
    found |= {name: every[name] for name in ("mac", "scene", "errors", "gains") if name in every}
    if run.configurations:
        at, channel = run.worst_response
        found["bode"] = partial(response_picture, run, configuration=at, channel=channel, phase=True)
        for name, draw in (("nyquist", nyquist_picture), ("nichols", nichols_picture)):
            found[name] = partial(draw, run, configuration=at, channel=channel)
        found["error-cost"] = partial(draw_chart, charts.error_against_cost(run))
    return {name: found[name] for name in FIGURE_NAMES if name in found}
