"""The report: one HTML page that opens offline."""

from __future__ import annotations

import json
from importlib.resources import files
from typing import Any

from cmsreduce.model import RunResult
from cmsreduce.report.curves import plot_data
from cmsreduce.report.tables import check_rows, configuration_rows, mode_rows, timings
from cmsreduce.report.wording import broken, compared, headline, measured, number, seconds, worst

__all__ = ["render_report"]


def render_report(run: RunResult) -> str:
    """Render what a run found as one self-contained HTML page.

    Parameters
    ----------
    run : RunResult

    Returns
    -------
    str
        HTML; the plotting library, styles and data are in it, and nothing is fetched when it opens.
    """
    from jinja2 import Environment, FunctionLoader, StrictUndefined
    from markupsafe import Markup
    from plotly.offline import get_plotlyjs

    environment = Environment(
        loader=FunctionLoader(_part), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters |= {"number": number, "seconds": seconds}
    models = (run.model, *compared(run))
    return environment.get_template("page.html.j2").render(
        run=run,
        headline=headline(run),
        broken=broken(run),
        figures=measured(run),
        damped=any(result.errors[run.model].damped is not None for result in run.configurations),
        models=models,
        worst=[(model, worst(run, model)) for model in models],
        configurations=configuration_rows(run),
        mode_rows=mode_rows,
        timings=timings(run),
        checks=check_rows(run),
        settings=json.dumps(dict(run.settings), indent=2, ensure_ascii=False, default=str),
        data=Markup(_embedded(plot_data(run))),
        style=Markup(_part("page.css")),
        script=Markup(_part("page.js")),
        plotly=Markup(get_plotlyjs()),
    )


def _embedded(data: Any) -> str:
    """JSON that cannot end the script element it stands in, whatever the names in it."""
    text = json.dumps(data, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _part(name: str) -> str:
    return files("cmsreduce.report").joinpath(name).read_text(encoding="utf-8")
