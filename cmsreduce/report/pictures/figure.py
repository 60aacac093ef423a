"""Common style of all static pictures: fonts, colours, size, and reproducible files."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cmsreduce.report.palette import INK, LineStyle

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["DOTS_PER_INCH", "MARKERS", "drawn", "legend_above", "line_of", "literal", "plain_axes"]

DOTS_PER_INCH = 150
"""Resolution of pictures in pixels."""

MARKERS = {
    "circle": "o",
    "square": "s",
    "diamond": "D",
    "triangle-up": "^",
    "triangle-down": "v",
    "cross": "P",
    "star": "*",
}
"""Markers by their names in plotly."""

_PIXELS_PER_POINT = DOTS_PER_INCH / 72
# Ratio of the ends of a logarithmic axis below which it has labels between its decades, too.
_SHORT_AXIS = 30


@contextmanager
def drawn(path: Path, inches: tuple[float, float] = (8.0, 4.2)) -> Iterator[Figure]:
    """Open a figure, and save it when the block ends.

    Parameters
    ----------
    path : Path
        File to write; its suffix says the format.
    inches : (float, float)
        Width and height.
    """
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    style: Any = {
        "font.family": "DejaVu Sans",
        "font.size": 9,
        "text.color": INK,
        "axes.labelcolor": INK,
        "axes.edgecolor": "#8c959f",
        "xtick.color": INK,
        "ytick.color": INK,
        "svg.hashsalt": "cmsreduce",
    }
    with rc_context(style):
        figure = Figure(figsize=inches, dpi=DOTS_PER_INCH, layout="constrained")
        FigureCanvasAgg(figure)
        yield figure
        metadata = {"Date": None} if path.suffix.lower() == ".svg" else {}
        figure.savefig(path, metadata=metadata)


def plain_axes(axes: Axes, *, x: str = "", y: str = "") -> None:
    """Light grid, no frame on the right and above, plain numbers on logarithmic axes."""
    from matplotlib.ticker import FuncFormatter

    for axis, scale in ((axes.xaxis, x), (axes.yaxis, y)):
        if scale == "log":
            axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            low, high = axis.get_view_interval()
            few = low > 0 and high / low < _SHORT_AXIS
            axis.set_minor_formatter(FuncFormatter(_minor if few else lambda *_: ""))
    axes.grid(color="#e4e8ec", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def _minor(value: float, _: int | None = None) -> str:
    return f"{value:g}" if f"{value:.0e}"[0] in "25" else ""


def legend_above(figure: Figure, axes: Axes, columns: int = 3) -> None:
    """Legend in rows above the panels."""
    handles, labels = axes.get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside upper left", ncols=columns, frameon=False, handlelength=3.5)


def line_of(style: LineStyle) -> dict[str, Any]:
    """Colour, dashes and width of a model's line."""
    dashes = (0, style.pattern) if style.pattern else "solid"
    return {"color": style.colour, "linestyle": dashes, "linewidth": style.width / _PIXELS_PER_POINT}


def literal(text: str) -> str:
    """Text in which a dollar sign does not start a formula."""
    return text.replace("$", r"\$")
