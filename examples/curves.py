"""Curves over time on one page, one below the other; the page needs no network."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

__all__ = ["write_page"]


def write_page(path: Path, title: str, time: np.ndarray, curves: Mapping[str, Mapping[str, np.ndarray]]) -> None:
    """Write a page; ``curves`` are panels by their label, each with curves by name."""
    page = make_subplots(rows=len(curves), shared_xaxes=True, vertical_spacing=0.06)
    for row, (label, panel) in enumerate(curves.items(), 1):
        for name, values in panel.items():
            page.add_trace(go.Scatter(x=time[: values.size], y=values, name=name), row=row, col=1)
        page.update_yaxes(title_text=label, row=row, col=1)
    page.update_xaxes(title_text="time, s", row=len(curves), col=1)
    page.update_layout(title=title, height=260 * len(curves) + 120)
    page.write_html(path, include_plotlyjs=True)
