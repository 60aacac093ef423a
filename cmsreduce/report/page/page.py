"""The report: one HTML page that opens offline, with its scripts, its data and the plotting library."""

from __future__ import annotations

import json
from concurrent.futures import Future, ThreadPoolExecutor
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from cmsreduce.model import MISSING_INERTIA, RunResult
from cmsreduce.report.next_steps import next_steps
from cmsreduce.report.page.check_data import check_data
from cmsreduce.report.page.curves import response_data
from cmsreduce.report.page.mode_data import mode_data
from cmsreduce.report.page.packing import ArrayStore, compressed
from cmsreduce.report.page.scene_data import scene_data
from cmsreduce.report.page.tables import (
    basis_row,
    cards,
    channel_rows,
    configuration_rows,
    health_rows,
    mode_rows,
    sensitivity_rows,
    timings,
)
from cmsreduce.report.verdict import meaning, proof_rows, verdict_lines
from cmsreduce.report.wording import (
    channels_left_out,
    checked,
    compared,
    headline,
    measured,
    number,
    rigid_words,
    seconds,
    simulation_words,
    system_words,
    worst,
)

if TYPE_CHECKING:
    from jinja2 import Environment

__all__ = [
    "embedded",
    "packed_plotly",
    "part",
    "render_report",
    "start_packing",
]

# Compression that takes half the time of the strongest, for a library 4 % larger.
_QUICK = 4
# Scripts in the order in which they depend on each other.
_SCRIPTS = ("inflate", "arrays", "style", "responses", "modes", "checks", "viewer", "scene")
_SECTIONS = (
    ("scene", "Scene"),
    ("components", "Bodies"),
    ("mode-shapes", "Mode shapes"),
    ("mac-of-modes", "MAC"),
    ("ranking", "Ranking"),
    ("errors", "Errors and limits"),
    ("responses", "Responses"),
    ("configurations", "Articulation"),
    ("gain-sum", "Gains"),
    ("statics", "Static loads"),
    ("zero-shifts", "Zeros"),
    ("step-responses", "Steps"),
    ("controller", "Controller"),
    ("complete", "Completeness"),
    ("projection", "Projection"),
    ("sensitivity", "Sensitivity"),
    ("health", "Health"),
    ("proofs", "Proofs"),
    ("checks", "Checks"),
    ("timings", "Timings"),
    ("provenance", "Provenance"),
)


def render_report(run: RunResult) -> str:
    """Render the result of a run as one self-contained HTML page.

    Parameters
    ----------
    run : RunResult

    Returns
    -------
    str
        HTML with the plotting library, styles and data inside; opening it needs no network.
    """
    from markupsafe import Markup

    models, verdict = (run.model, *compared(run)), run.verdict
    basis = verdict_lines(verdict)
    store = ArrayStore()
    data = page_data(run, store)
    script = "\n".join([*(part(f"page_{name}.js") for name in _SCRIPTS), part("page.js")])
    page = _templates().get_template("page.html.j2")
    html = page.render(
        run=run,
        drawing=run.drawing,
        cards=cards(run),
        headline=headline(run),
        meaning=meaning(verdict),
        broken=[words for state, words in basis if state == "FAIL"],
        next_steps=next_steps(run) if verdict.word == "FAIL" else (),
        rests_on=basis,
        proofs=proof_rows(verdict.proofs),
        left_out=channels_left_out(run),
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
        system=system_words(run),
        rigid_words=rigid_words,
        simulation=[] if run.speed is None or run.speed.simulation is None else simulation_words(run.speed.simulation),
        checks=[(name, check) for name, part in run.components.items() for check in part.checks],
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
    """Data of the plots as JSON values; their arrays go to the store."""
    data = response_data(run, store)
    data |= mode_data(run, store, data["drawn"]) | check_data(run, store)
    data["scene"] = scene_data(run, store)
    data["body_places"] = {body["name"]: k for k, body in enumerate(data["scene"]["bodies"])} if data["scene"] else {}
    data["has_mac"] = any(setting["mac"] is not None for setting in data["settings"])
    data["missing_inertia"] = 100 * MISSING_INERTIA
    return data


def _sections(run: RunResult, data: dict[str, Any]) -> list[tuple[str, str]]:
    there = {
        "scene": run.drawing is not None,
        "mode-shapes": run.drawing is not None,
        "responses": bool(run.configurations),
        "configurations": bool(run.configurations),
        "ranking": bool(run.components),
        "mac-of-modes": data["has_mac"],
        "gain-sum": bool(run.gains),
        "statics": bool(data["statics"]),
        "zero-shifts": bool(data["zeros"]),
        "step-responses": bool(data["steps"]),
        "controller": bool(data["margins"]),
        "complete": bool(run.completeness),
        "projection": run.projection is not None,
        "sensitivity": run.sensitivity is not None,
        "health": bool(run.components),
        "proofs": bool(run.verdict.proofs),
    }
    return [(section, name) for section, name in _SECTIONS if there.get(section, True)]


def packed_plotly() -> str:
    """The compressed plotting library; the page unpacks it when it opens."""
    return start_packing().result()


@cache
def _templates() -> Environment:
    """Environment that keeps the templates it has compiled: a sweep renders many pages."""
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    environment = Environment(
        loader=FunctionLoader(part),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"number": number, "seconds": seconds}
    return environment


@cache
def start_packing() -> Future[str]:
    """Compress the plotting library in a thread: it takes longer than the rest of a page."""

    def work() -> str:
        return compressed(files("plotly").joinpath("package_data", "plotly.min.js").read_bytes(), _QUICK)

    return ThreadPoolExecutor(1).submit(work)


def embedded(data: Any) -> str:
    """JSON for a script element: no name in it can end the element."""
    text = json.dumps(data, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def part(name: str) -> str:
    """Text of a script, a style or a template of the package."""
    return files("cmsreduce.report.page").joinpath(name).read_text(encoding="utf-8")
