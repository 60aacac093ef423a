"""Colours and line styles of the models; they differ without colour, too."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["COLOURS", "FULL", "INK", "LIMIT", "LineStyle", "model_style"]

INK = "#1f2328"
"""Text and axes."""

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""Colours of bodies and motions."""

LIMIT = "#6e7781"
"""Colour of limit lines."""


@dataclass(frozen=True)
class LineStyle:
    """Line style of one model.

    Parameters
    ----------
    colour : str
        Hexadecimal; of the colour-blind safe set of Okabe and Ito (2008).
    dash : str
        Name of the dash in plotly.
    pattern : tuple of float
        The same dash in matplotlib, on and off in line widths; empty is solid.
    width : float
        In pixels.
    symbol : str
        Marker in plotly.
    """

    colour: str
    dash: str
    pattern: tuple[float, ...]
    width: float
    symbol: str


FULL = LineStyle("#333333", "solid", (), 4.0, "circle")
"""The reference model."""

_MODELS = (
    LineStyle("#E69F00", "dash", (4, 2), 2.2, "circle"),
    LineStyle("#0072B2", "dot", (1, 1.6), 2.0, "square"),
    LineStyle("#D55E00", "dashdot", (5, 2, 1, 2), 2.0, "diamond"),
    LineStyle("#009E73", "longdash", (8, 3), 2.0, "triangle-up"),
    LineStyle("#CC79A7", "longdashdot", (8, 3, 1, 3), 2.0, "triangle-down"),
    LineStyle("#56B4E9", "dot", (1, 3), 2.0, "cross"),
)


def model_style(number: int) -> LineStyle:
    """Style of a reduced model: 0 is the run's own, the others repeat after five."""
    return _MODELS[0] if number == 0 else _MODELS[1 + (number - 1) % (len(_MODELS) - 1)]
