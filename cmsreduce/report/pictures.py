"""Every picture of a run as files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from cmsreduce.model import RunResult
from cmsreduce.report.figure import drawn, legend_above, line_of, literal, plain_axes
from cmsreduce.report.mode_pictures import effective_mass_picture, gain_picture, likeness_picture, sigma_picture
from cmsreduce.report.palette import LIMIT, model_style
from cmsreduce.report.picture import response_picture
from cmsreduce.report.scene_pictures import scene_picture, shapes_picture
from cmsreduce.report.wording import FIGURES, compared, worst

__all__ = ["write_pictures"]


def write_pictures(run: RunResult, folder: Path, suffix: str = ".png") -> list[Path]:
    """Draw a run: scene, modes, responses of every channel at the worst configuration, errors; return the files.

    Parameters
    ----------
    run : RunResult
    folder : Path
        Is made if it is not there.
    suffix : {".png", ".svg"}
        Format.
    """
    folder.mkdir(parents=True, exist_ok=True)
    made: list[Path] = []

    def to(name: str) -> Path:
        made.append(folder / f"{_safe(name)}{suffix}")
        return made[-1]

    names = [result.configuration.name for result in run.configurations]
    rows = worst(run, run.model)
    at = names.index(rows[0].where) if rows else 0
    if run.drawing is not None:
        where = names[at] if names else next(iter(run.drawing.systems))
        scene_picture(run.drawing, where, to("scene"))
        if run.drawing.systems[where].hz.size:
            shapes_picture(run.drawing, where, to("shapes"))
    if run.configurations:
        error_picture(run, to("errors"))
        for o, output in enumerate(run.outputs):
            for i, given in enumerate(run.inputs):
                response_picture(run, to(f"response_{given}_{output}"), at, (o, i))
        found = run.configurations[at].errors.get(run.model)
        if found is not None and found.likeness is not None and found.likeness.mac.size:
            likeness_picture(found.likeness, names[at], to("likeness"))
    for name, part in run.components.items():
        if np.isfinite(part.modes.sigma).any():
            sigma_picture(part, to(f"sigma_{name}"))
        if name in run.effective_mass:
            effective_mass_picture(name, run.effective_mass[name], to(f"effective_mass_{name}"))
    if run.gains:
        gain_picture(run, run.gains[at if names else 0], to("gains"))
    return made


def error_picture(run: RunResult, path: Path) -> None:
    """Draw the response error of every model in every configuration."""
    figure_of = FIGURES[0]
    names = [result.configuration.name for result in run.configurations]
    with drawn(path) as figure:
        axes = figure.subplots()
        for k, model in enumerate((run.model, *compared(run))):
            look = model_style(k)
            found = [
                (c, result.errors[model].frf_error)
                for c, result in enumerate(run.configurations)
                if model in result.errors
            ]
            shown = [(c, figure_of.scale * value) for c, value in found if np.isfinite(value) and value > 0]
            if shown:
                x, y = zip(*shown, strict=True)
                axes.plot(x, y, marker="osD^vP"[k % 6], markersize=5, label=literal(model), **line_of(look))
        limit = run.limits.get(figure_of.name)
        if limit is not None:
            axes.axhline(figure_of.scale * limit, color=LIMIT, linewidth=0.8)
            place: Any = {"xycoords": ("axes fraction", "data"), "textcoords": "offset points"}
            axes.annotate(f"limit {figure_of.text(limit)}", (0, figure_of.scale * limit), (4, 3), color=LIMIT, **place)
        axes.set_yscale("log")
        axes.set_ylabel(f"{figure_of.label}, {figure_of.unit}")
        axes.set_xticks(
            range(len(names)),
            [literal(name) for name in names],
            rotation=30 if len(names) > 4 else 0,
            ha="right" if len(names) > 4 else "center",
        )
        legend_above(figure, axes)
        plain_axes(axes, y="log")


def _safe(name: str) -> str:
    return "".join(letter if letter.isalnum() or letter in "-=." else "_" for letter in name)
