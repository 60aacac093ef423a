"""The report: one HTML page that opens offline."""

from __future__ import annotations

import json
from typing import Any

from cmsreduce.model import RunResult
from cmsreduce.model.completeness import MISSING_INERTIA
from cmsreduce.report.cards import cards
from cmsreduce.report.check_data import check_data
from cmsreduce.report.curves import response_data
from cmsreduce.report.health_rows import basis_row, health_rows
from cmsreduce.report.mode_data import mode_data
from cmsreduce.report.packing import ArrayStore
from cmsreduce.report.page_parts import embedded, packed_plotly, part
from cmsreduce.report.scene_data import scene_data
from cmsreduce.report.tables import channel_rows, check_rows, configuration_rows, mode_rows, sensitivity_rows, timings
from cmsreduce.report.wording import broken, checked, compared, headline, measured, number, seconds, worst

__all__ = ["render_report"]

# In the order they depend on each other.
_SCRIPTS = ("arrays", "style", "responses", "modes", "checks", "viewer", "scene")
_SECTIONS = (
    ("scene", "Scene"),
    ("errors", "Errors"),
    ("responses", "Responses"),
    ("configurations", "Articulation"),
    ("cost", "Speed"),
    ("components", "Modes"),
    ("mode-shapes", "Shapes"),
    ("likeness", "Likeness"),
    ("gain-sum", "Gains"),
    ("statics", "Static loads"),
    ("zero-shifts", "Zeros"),
    ("step-responses", "Steps"),
    ("controller", "Controller"),
    ("complete", "Completeness"),
    ("projection", "Projection"),
    ("sensitivity", "Sensitivity"),
    ("health", "Health"),
    ("checks", "Checks"),
    ("timings", "Timings"),
    ("provenance", "Provenance"),
)


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

    from cmsreduce.report.template_cache import TemplateCache

    environment = Environment(
        loader=FunctionLoader(part),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        bytecode_cache=TemplateCache(),
    )
    environment.filters |= {"number": number, "seconds": seconds}
    models = (run.model, *compared(run))
    store = ArrayStore()
    data = page_data(run, store)
    script = "\n".join([*(part(f"page_{name}.js") for name in _SCRIPTS), part("page.js")])
    html = environment.get_template("page.html.j2").render(
        run=run,
        drawing=run.drawing,
        cards=cards(run),
        headline=headline(run),
        broken=broken(run),
        figures=measured(run),
        damped=any(result.errors[run.model].damped is not None for result in run.configurations),
        models=models,
        worst=[(model, worst(run, model)) for model in models],
        configurations=configuration_rows(run),
        mode_rows=mode_rows,
        health_rows=health_rows,
        basis_row=basis_row,
        channel_rows=channel_rows(run),
        sensitivity_rows=sensitivity_rows(run),
        checked=checked(run),
        timings=timings(run),
        checks=check_rows(run),
        settings=json.dumps(dict(run.settings), indent=2, ensure_ascii=False, default=str),
        sections=_sections(run, data),
        data=data,
        embedded=Markup(embedded(data)),
        arrays=Markup(store.packed()),
        style=Markup(part("page.css")),
        script=Markup(script),
        plotly=Markup(packed_plotly()),
    )
    return html.lstrip()


def page_data(run: RunResult, store: ArrayStore) -> dict[str, Any]:
    """What the page's plots are drawn from, as JSON values; their arrays go to the store."""
    data = response_data(run, store) | mode_data(run, store) | check_data(run, store)
    data["scene"] = scene_data(run, store)
    data["body_places"] = {body["name"]: k for k, body in enumerate(data["scene"]["bodies"])} if data["scene"] else {}
    data["has_likeness"] = any(setting["likeness"] is not None for setting in data["settings"])
    data["missing_inertia"] = 100 * MISSING_INERTIA
    return data


def _sections(run: RunResult, data: dict[str, Any]) -> list[tuple[str, str]]:
    there = {
        "scene": run.drawing is not None,
        "mode-shapes": run.drawing is not None,
        "responses": bool(run.configurations),
        "configurations": bool(run.configurations),
        "cost": bool(run.configurations),
        "likeness": data["has_likeness"],
        "gain-sum": bool(run.gains),
        "statics": bool(data["statics"]),
        "zero-shifts": bool(data["zeros"]),
        "step-responses": bool(data["steps"]),
        "controller": bool(data["margins"]),
        "complete": bool(run.completeness),
        "projection": run.projection is not None,
        "sensitivity": run.sensitivity is not None,
        "health": bool(run.components),
    }
    return [(section, name) for section, name in _SECTIONS if there.get(section, True)]
