"""A plot as data: panels with series of points. Files and notebooks draw the same charts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cmsreduce.report.palette import LineStyle

__all__ = ["Chart", "Panel", "Series", "Shades"]

Array = NDArray[np.float64]
Kind = Literal["line", "mark", "named mark", "line and mark", "steps", "bar", "open bar", "circle"]


@dataclass(frozen=True, eq=False)
class Series:
    """Points of one thing.

    Parameters
    ----------
    x, y : (k,) float64
        NaN is a gap.
    label : str
        Name in the legend; empty for a series that another one names.
    look : LineStyle
    kind : str
        A named mark has its name beside it instead of in the legend.
    panel : int
        Number of its panel, from 0.
    ahead : float
        Larger is drawn above.
    """

    x: Array
    y: Array
    label: str
    look: LineStyle
    kind: Kind = "line"
    panel: int = 0
    ahead: float = 0.0


@dataclass(frozen=True, eq=False)
class Shades:
    """A table as shades from 0 to 1, with the names of its columns and rows."""

    values: Array
    columns: tuple[str, ...]
    rows: tuple[str, ...]
    label: str


@dataclass(frozen=True, eq=False)
class Panel:
    """An area with its own vertical axis.

    Parameters
    ----------
    label : str
        Quantity and unit.
    log : bool
    range : (float, float), optional
    ticks : tuple of float
    limit : (float, str), optional
        Value and words of a line across.
    height : float
        Relative to the other panels.
    """

    label: str
    log: bool = False
    range: tuple[float, float] | None = None
    ticks: tuple[float, ...] = ()
    limit: tuple[float, str] | None = None
    height: float = 1.0


@dataclass(frozen=True, eq=False)
class Chart:
    """A plot.

    Parameters
    ----------
    title, x_label : str
    panels : tuple of Panel
        From above.
    series : tuple of Series
    shades : Shades, optional
        Instead of series.
    x_log : bool
    x_range : (float, float), optional
    x_names : tuple of str
        Names of the places 0, 1, 2 ... on a horizontal axis of names.
    inches : (float, float)
    legend : int
        Columns of the legend; 0 for none.
    """

    title: str
    x_label: str
    panels: tuple[Panel, ...]
    series: tuple[Series, ...] = ()
    shades: Shades | None = None
    x_log: bool = False
    x_range: tuple[float, float] | None = None
    x_names: tuple[str, ...] = ()
    inches: tuple[float, float] = (8.0, 4.2)
    legend: int = 3
