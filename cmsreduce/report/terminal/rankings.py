"""Every ranking of the modes of a body beside the others, on the terminal."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import ModalComponent, SensitivityRecord
from cmsreduce.report.wording import number

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["RANKINGS_WIDTH", "print_rankings", "ranking_rows"]

# Half-power widths over distance beyond which Gregory's coefficient may mislead.
_CLOSE = 0.1
# Columns of the widest table: a terminal that is narrower wraps it, and loses nothing.
RANKINGS_WIDTH = 150
# A period, which a row shows as its frequency.
_SHOWN_ALREADY = "frequency"


def ranking_rows(
    component: ModalComponent, kept: NDArray[np.int64], edge: Collection[int] = ()
) -> list[tuple[str, ...]]:
    """One row per elastic mode, in order of frequency.

    Parameters
    ----------
    component : ModalComponent
        With its rankings.
    kept : (k,) int64
        Columns that are kept.
    edge : collection of int
        Numbers of the modes on the edge.

    Returns
    -------
    list of tuple of str
        Number, frequency in Hz, number of the cluster it belongs to or nothing, ``close`` where the next mode is within
        ten half-power widths, ``kept`` or nothing, and ``edge`` for a mode on the edge; then for each ranking the
        coefficient and the place, 1 for the most important.
    """
    e, chosen = component.elastic, set(kept.tolist())
    columns = []
    for name in _shown(component):
        values = component.rankings[name]
        order = np.argsort(-values[e], kind="stable")
        place = np.empty(order.size, dtype=np.int64)
        place[order] = np.arange(1, order.size + 1)
        columns.append([f"{number(float(v), 3)}  {p}" for v, p in zip(values[e], place, strict=True)])
    return [
        (
            str(k + 1),
            number(float(component.omega[k]) / (2 * np.pi), 5),
            "" if component.cluster is None or not component.cluster[k] else str(component.cluster[k]),
            "close" if component.spacing[k] > _CLOSE else "",
            " ".join((["kept"] if k in chosen else []) + (["edge"] if k + 1 in edge else [])),
            *(column[k - e.start] for column in columns),
        )
        for k in range(e.start, e.stop)
    ]


def print_rankings(
    components: Mapping[str, ModalComponent],
    selection: Mapping[str, NDArray[np.int64]],
    console: Console | None = None,
    sensitivity: SensitivityRecord | None = None,
    scaling: Mapping[str, str] | None = None,
) -> None:
    """Print the rankings of every body that was ranked.

    Parameters
    ----------
    components : mapping of name to ModalComponent
        All modes.
    selection : mapping of name to (k,) int64
        Elastic columns that are kept.
    console : rich.console.Console, optional
        Where to print; standard output by default.
    sensitivity : SensitivityRecord, optional
        Which modes are on the edge.
    scaling : mapping of body to str, optional
        How inputs and outputs were made comparable, printed below.
    """
    from rich import box
    from rich.console import Console
    from rich.table import Table

    console = console or Console(width=RANKINGS_WIDTH, soft_wrap=True)
    for name, component in components.items():
        if not component.rankings:
            continue
        heads = ("mode", "Hz", "cluster", "", "", *_shown(component))
        table = Table(box=box.SIMPLE_HEAD, pad_edge=False, title=f"{name}: coefficient and place", title_justify="left")
        for head in heads:
            table.add_column(head, justify="right", no_wrap=True)
        edge = () if sensitivity is None else sensitivity.edge(name)
        for row in ranking_rows(component, np.asarray(selection[name]), edge):
            table.add_row(*row)
        console.print(table)
        if scaling and scaling.get(name):
            console.print(f"{name}: {scaling[name]}", markup=False, highlight=False, soft_wrap=True)


def _shown(component: ModalComponent) -> list[str]:
    return [name for name in component.rankings if name != _SHOWN_ALREADY]
