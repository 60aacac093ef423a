"""Static picture of the gains of modes."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from cmsreduce.model import RunResult
from cmsreduce.report.palette import FULL, LIMIT, model_style
from cmsreduce.report.pictures.figure import drawn, literal, plain_axes

__all__ = ["gain_picture"]

# Pairs of channels in one picture.
_MOST_PAIRS = 12


def gain_picture(run: RunResult, configuration: str, path: Path) -> None:
    """Draw the running sums of modal gains, the first pairs of channels each in a panel."""
    pairs = [(o, i) for o in range(len(run.outputs)) for i in range(len(run.inputs))][:_MOST_PAIRS]
    across = min(3, len(pairs))
    down = math.ceil(len(pairs) / across)
    own, (kept, every) = model_style(0), run.gains[configuration]
    with drawn(path, (3.4 * across + 0.6, 2.5 * down + 0.6)) as figure:
        panels = figure.subplots(down, across, squeeze=False, sharex=True)
        for axes in panels.ravel()[len(pairs) :]:
            axes.set_visible(False)
        for axes, (o, i) in zip(panels.ravel(), pairs, strict=False):
            all_modes: Any = {"color": FULL.colour, "linewidth": 2, "label": "all modes"}
            axes.step(every.hz, every.running[:, o, i], where="post", **all_modes)
            modes_kept: Any = {"color": own.colour, "linestyle": "--", "label": "modes kept"}
            axes.step(kept.hz, kept.running[:, o, i], where="post", **modes_kept)
            axes.axvline(run.band[1], color=LIMIT, linewidth=0.8, linestyle=":")
            axes.set_xscale("log")
            axes.set_title(literal(f"{run.inputs[i]} → {run.outputs[o]}"), loc="left", fontsize=9)
            axes.ticklabel_format(axis="y", style="sci", scilimits=(-3, 4))
            plain_axes(axes, x="log")
        for axes in panels[-1]:
            axes.set_xlabel("Hz")
        panels[0, 0].legend(frameon=False)
        figure.suptitle(literal(f"Running sum of modal gains, {configuration}"), x=0.01, ha="left", fontsize=10)
