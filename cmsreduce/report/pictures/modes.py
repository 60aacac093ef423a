"""Static pictures of modes: influence, effective mass, MAC, gains."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from cmsreduce.model import ComponentResult, EffectiveMassCurve, MacMatrix, RunResult
from cmsreduce.report.palette import FULL, INK, LIMIT, model_style
from cmsreduce.report.pictures.figure import drawn, literal, plain_axes

__all__ = ["effective_mass_picture", "gain_picture", "mac_picture", "sigma_picture"]

_MOTIONS = ("x", "y", "z", "rx", "ry", "rz")
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
_DASHES = ("-", "--", ":", "-.", (0, (8, 3)), (0, (8, 3, 1, 3)))
# Pairs of channels in one picture.
_MOST_PAIRS = 12


def sigma_picture(part: ComponentResult, path: Path) -> None:
    """Draw the influence coefficients of a body's modes, kept ones filled, clusters joined by a line above."""
    modes = part.modes
    e = modes.elastic
    number, sigma = np.arange(e.start + 1, e.stop + 1), modes.sigma[e]
    kept = np.isin(np.arange(e.start, e.stop), part.kept)
    with drawn(path) as figure:
        axes = figure.subplots()
        axes.bar(number[kept], sigma[kept], color="#0072B2", label="kept")
        axes.bar(number[~kept], sigma[~kept], color="white", edgecolor="#8c959f", hatch="////", label="left out")
        known = sigma[np.isfinite(sigma) & (sigma > 0)]
        axes.set(yscale="log", xlabel="mode, by frequency", ylabel="sigma")
        if modes.cluster is not None and known.size:
            cluster = modes.cluster[e]
            for nth, group in enumerate(sorted(set(cluster[cluster > 0].tolist()))):
                at = number[cluster == group]
                height = known.max() * 10 ** (0.5 + 0.4 * (nth % 2))
                axes.plot(
                    at, np.full(at.size, height), "-|", color=INK, linewidth=1.2, label="clusters" if nth == 0 else None
                )
        axes.set_title(literal(f"{part.name}: influence of its modes"), loc="left", pad=22)
        axes.legend(frameon=False, ncols=3, loc="lower left", bbox_to_anchor=(0, 1), borderaxespad=0.2)
        plain_axes(axes)


def effective_mass_picture(name: str, curve: EffectiveMassCurve, path: Path) -> None:
    """Draw the running effective mass of a body's modes."""
    with drawn(path) as figure:
        axes = figure.subplots()
        for k, motion in enumerate(_MOTIONS):
            axes.step(
                curve.hz, 100 * curve.running[:, k], where="post", color=_COLOURS[k], linestyle=_DASHES[k], label=motion
            )
            if curve.kept_hz.size:
                axes.plot(curve.kept_hz[-1], 100 * curve.kept_running[-1, k], "o", mfc="none", mec=_COLOURS[k])
        axes.set(
            xscale="log",
            xlabel=f"frequency, held at {literal(curve.held)}, Hz",
            ylabel="mass of the body, %",
            ylim=(0, 104),
        )
        axes.set_title(literal(f"{name}: effective mass of its modes (circles: those kept)"), loc="left", pad=22)
        axes.legend(frameon=False, ncols=6, loc="lower left", bbox_to_anchor=(0, 1), borderaxespad=0.2)
        plain_axes(axes, x="log")


def mac_picture(table: MacMatrix, where: str, path: Path) -> None:
    """Draw the modal assurance criterion between all modes of the reference and of the reduced system."""
    with drawn(path, (7.0, 5.6)) as figure:
        axes = figure.subplots()
        image = axes.imshow(
            table.mac, origin="lower", cmap="Blues", vmin=0, vmax=1, aspect="auto", interpolation="nearest"
        )
        for axis, hz in ((axes.xaxis, table.reduced_hz), (axes.yaxis, table.full_hz)):
            at = np.arange(0, hz.size, max(1, math.ceil(hz.size / 14)))
            axis.set_ticks(at, [f"{hz[k]:.4g}" for k in at])
        axes.tick_params(axis="x", rotation=50)
        axes.set(xlabel="modes of the reduced system, Hz", ylabel="modes of the full system, Hz")
        axes.set_title(literal(f"MAC of the modes, {where}"), loc="left")
        figure.colorbar(image, ax=axes, label="MAC")


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
