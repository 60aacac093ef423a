"""Smallest models: modes chosen, system modes projected, and scene shapes; error against size on three systems.

    python benchmarks/smallest_model.py                    tables of its page, picture of docs/smallest-model.md
    python benchmarks/smallest_model.py --range            Galileo's search at 100 random angles of its whole range
    python benchmarks/smallest_model.py --range 3          the shapes that the tests hold at 300 random angles
    python benchmarks/smallest_model.py --certificates     certificates of 1500 random systems
    python benchmarks/smallest_model.py --search galileo   the search for modes: modes, sets tried, CPU seconds
    python benchmarks/smallest_model.py --greedy           the search against a greedy one of the tests, in minutes
    python benchmarks/smallest_model.py --growing          the search for modes at 4 to 32 angles of Galileo

``--write`` puts the table and the picture into the page.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from cmsreduce.config import load_pipeline  # noqa: E402
from cmsreduce.errors import CmsReduceError  # noqa: E402
from cmsreduce.model import SearchRecord  # noqa: E402
from cmsreduce.pipeline import Run, Silent  # noqa: E402
from cmsreduce.pipeline.project.articulation_range import ArticulationRange  # noqa: E402
from cmsreduce.project import ESTIMATE_FACTOR, keep_combinations, settled_certificates  # noqa: E402
from cmsreduce.report.pictures.figure import drawn, legend_above, plain_axes  # noqa: E402
from tests.pipeline.greedy import Greedy  # noqa: E402
from tests.project.scene_systems import random_scene, random_shapes, whole_responses  # noqa: E402
from tests.two_beams import write_two_beams  # noqa: E402

PAGE, PICTURE = ROOT / "benchmarks" / "smallest-model.md", ROOT / "docs" / "smallest-model.png"
STORED = ROOT / "tests" / "golden" / "galileo_scene_shapes.npz"
HEADER = "| system | road | shapes | worst frf_error | worst db_error | seconds |\n|---|---|---|---|---|---|"
ON_PAGE = HEADER.replace(" seconds |", "").replace("---|---|---|---|---|---|", "---|---|---|---|---|")
SCENE_SHAPES = "scene shapes"
# For the curves: multiples of both limits asked of the modes, errors of the projection, and numbers of scene shapes.
MULTIPLES, ASKED = (16.0, 8.0, 4.0, 2.0, 1.0, 0.5), (0.3, 0.1, 0.05, 0.02, 0.01, 0.005)
SIZES = {"two beams": (4, 5, 6, 7, 8, 9), "galileo": (10, 13, 16, 19, 22), "station": (10, 14, 18, 22, 26)}
LIMITS = {"two beams": (0.01, 1.0), "galileo": (0.02, 1.0), "station": (0.05, 1.0)}
COLOURS = {"modes": "#0072B2", "system modes, projected": "#009E73", SCENE_SHAPES: "#D55E00"}
SEARCH_HEADER = "| configurations | modes | sets tried | CPU seconds | a configuration |\n|---|---|---|---|---|"
GREEDY_HEADER = (
    "| system | candidates | limits | search | greedy | search, CPU s | greedy, CPU s |\n|---|---|---|---|---|---|---|"
)
FEWER = ["scene.band=0.3 Hz", "components.inboard.reduce.cutoff=16", "components.outboard.reduce.cutoff=6"]
GREEDY = {
    "Galileo, 8 angles": ("galileo", [], 0.02, 1.0),
    "station to 0.3 Hz, 4 angles": ("station", FEWER, 0.3, 3.0),
}
CONFIGURATIONS = (4, 8, 16, 32)
RANDOM_ANGLES, SYSTEMS = 100, 1500


def opened(system: str, folder: Path, *settings: str) -> Run:
    """A run of one of the systems with some settings."""
    path = write_two_beams(folder) if system == "two beams" else ROOT / "pipelines" / f"{system}.yaml"
    some = ["balance={keep: all}", "verify.compare={}", limits(system), *settings]
    return Run(load_pipeline(path, some), folder, Silent())


def limits(system: str, multiple: float = 1.0) -> str:
    """Setting of both limits of a system, times a number."""
    frf, decibel = (multiple * limit for limit in LIMITS[system])
    return f"verify.limits={{frf_error: {frf}, db_error: {decibel}}}"


def roads(system: str) -> Iterator[tuple[str, str, list[str]]]:
    """Label, remark and settings of every model."""
    for multiple in MULTIPLES:
        yield "modes", "limits" * (multiple == 1), ["balance={keep: limits}", limits(system, multiple)]
    yield SCENE_SHAPES, "limits", ["project={responses: auto, between: false}"]
    for error in ASKED:
        yield "system modes, projected", "", [f"project={{modes: auto, frf_error: {error}, between: false}}"]
    for size in SIZES[system]:
        yield SCENE_SHAPES, "", [f"project={{responses: {size}, between: false}}"]


def measured(system: str) -> Iterator[tuple[str, str, int, float, float, float]]:
    """Label, remark, size, errors and seconds of every model."""
    for label, remark, settings in roads(system):
        with tempfile.TemporaryDirectory() as folder:
            run = opened(system, Path(folder), *settings)
            _ = run.ranked, run.comparison
            started = time.perf_counter()
            try:
                size = sum(component.elastic_count for component in run.final.values())
            except CmsReduceError:
                continue
            seconds = time.perf_counter() - started
            found = run.comparison.at(run.scene.configurations, {"reduced": run.model})
            errors = [each.errors["reduced"] for each in found]
            frf, decibel = max(e.frf_error for e in errors), max(e.db_error for e in errors)
            yield label, remark, size, frf, decibel, seconds


def picture(found: dict[str, list[tuple[str, int, float]]]) -> None:
    """Largest error over its limit against size, a panel for each system."""
    with drawn(PICTURE, (9.0, 3.6)) as figure:
        panels = figure.subplots(1, len(found), sharey=True)
        for axes, (system, points) in zip(np.atleast_1d(panels), found.items(), strict=True):
            for label, colour in COLOURS.items():
                best: dict[int, float] = {}
                for name, size, error in points:
                    if name == label:
                        best[size] = min(error, best.get(size, error))
                own = sorted(best.items())
                mark = {"modes": "o", SCENE_SHAPES: "s"}.get(label, "^")
                axes.plot(*zip(*own, strict=True), marker=mark, color=colour, label=label, linewidth=1.3, markersize=4)
            axes.axhline(1, color="#444444", linewidth=1, linestyle="--")
            axes.set_yscale("log")
            axes.set_xlabel("elastic shapes of all bodies")
            axes.set_title(f"{system}: {LIMITS[system][0]:.0%} and {LIMITS[system][1]:g} dB", fontsize=9)
            plain_axes(axes, y="log")
        np.atleast_1d(panels)[0].set_ylabel("largest error over its limit")
        legend_above(figure, np.atleast_1d(panels)[0])


def table(systems: list[str], write: bool) -> None:
    """Print the table, and put it and the picture into the page."""
    print(HEADER)
    lines, points = [ON_PAGE], dict[str, list[tuple[str, int, float]]]()
    for system in systems:
        for label, remark, size, frf, decibel, seconds in measured(system):
            largest = max(frf / LIMITS[system][0], decibel / LIMITS[system][1])
            points.setdefault(system, []).append((label, size, largest))
            asked = f"{LIMITS[system][0]:.0%}, {LIMITS[system][1]:g} dB" if remark else "size or error stated"
            line = f"| {system} | {label}, {asked} | {size} | {frf:.2%} | {decibel:.2f} dB | {seconds:.0f} |"
            print(line, flush=True)
            if remark:
                # Seconds mean something on an idle machine only.
                lines.append(line.rpartition(" | ")[0] + " |")
    if write:
        picture(points)
        put("table", lines)


def put(mark: str, lines: list[str]) -> None:
    """Replace what stands between two marks of the page."""
    start, end = f"<!-- {mark} -->", f"<!-- end of {mark} -->"
    head, _, rest = PAGE.read_text().partition(start)
    tail = rest.partition(end)[2]
    PAGE.write_text(f"{head}{start}\n" + "\n".join(lines) + f"\n{end}{tail}")


def whole_range(settings: list[str]) -> None:
    """Galileo's scene shapes at random angles of the whole range: size, worst errors and how many break a limit."""
    with tempfile.TemporaryDirectory() as folder:
        run = opened("galileo", Path(folder), "project={responses: auto}", *settings)
        _ = run.ranked, run.comparison
        started = time.process_time()
        size = sum(component.elastic_count for component in run.final.values())
        seconds = time.process_time() - started
        found = run.comparison.at(ArticulationRange(run.scene).random(RANDOM_ANGLES, 1), {"reduced": run.model})
        errors = np.array([(e.errors["reduced"].frf_error, e.errors["reduced"].db_error) for e in found])
        broken = int(np.count_nonzero((errors > LIMITS["galileo"]).any(axis=1)))
        print("\n".join(run.projected.notes if run.projected else ()))
        print(
            f"{size} shapes at {RANDOM_ANGLES} random angles: worst frf_error {errors[:, 0].max():.2%}, worst db_error "
            f"{errors[:, 1].max():.2f} dB, {broken} angles break a limit; search: {seconds:.0f} CPU s"
        )


def held_in_range(hundreds: int) -> None:
    """Errors of the stored shapes of Galileo at some hundred random angles of the whole range, by the fast measure."""
    with tempfile.TemporaryDirectory() as folder, np.load(STORED) as file:
        run = opened("galileo", Path(folder))
        components = {}
        for name, kept in run.kept.items():
            amplitudes = kept.Phi[:, kept.elastic].T @ (kept.body.M @ file[f"22/{name}"].astype(np.float64))
            components[name] = keep_combinations(kept, np.linalg.qr(amplitudes)[0], "stored", coupled=True)
        model, span = run.joined(components), ArticulationRange(run.scene)
        for seed in range(1, hundreds + 1):
            errors = run.comparison.screened(span.random(RANDOM_ANGLES, seed), model)
            broken = int(np.count_nonzero((errors > LIMITS["galileo"]).any(axis=1)))
            print(
                f"22 shapes at {RANDOM_ANGLES} random angles, seed {seed}: worst frf_error {errors[:, 0].max():.2%}, "
                f"worst db_error {errors[:, 1].max():.2f} dB, {broken} angles break a limit",
                flush=True,
            )


def search_of(system: str, settings: list[str]) -> tuple[SearchRecord, float]:
    """The search for the fewest modes within the limits, and its CPU seconds."""
    with tempfile.TemporaryDirectory() as folder:
        run = opened(system, Path(folder), "balance={keep: limits}", *settings)
        _ = run.ranked, run.comparison
        started = time.process_time()
        search = run.choice.search
        seconds = time.process_time() - started
    assert search is not None
    return search, seconds


def searched(system: str, settings: list[str]) -> None:
    """The search with its CPU seconds and the load of the machine."""
    search, seconds = search_of(system, settings)
    print(
        f"{system}: {search.words}; {search.candidates} sets tried in {seconds:.1f} CPU s, load of the machine "
        f"{os.getloadavg()[0]:.0f}"
    )


def growing(write: bool) -> None:
    """Search time against the number of configurations of Galileo: spin angles at even distances, two cone angles."""
    lines = [SEARCH_HEADER]
    search_of("galileo", [])  # Imports and first allocations belong to no row.
    for count in CONFIGURATIONS:
        spin = ", ".join(f"{each:g}" for each in np.arange(count // 2) * 720 / count)
        search, seconds = search_of("galileo", [f"scene.articulation={{spin: [{spin} deg], cone: [0, 30 deg]}}"])
        each = seconds / count
        lines.append(f"| {count} | {search.modes} | {search.candidates} | {seconds:.1f} | {each:.2f} |")
        print(lines[-1], flush=True)
    if write:
        put("searches", lines)


def against_greedy(write: bool) -> None:
    """Modes and CPU seconds of the search and of the greedy one, in the configurations of the scenes."""
    lines = [GREEDY_HEADER]
    for label, (system, settings, frf, decibel) in GREEDY.items():
        with tempfile.TemporaryDirectory() as folder:
            wider = f"verify.limits={{frf_error: {frf}, db_error: {decibel}}}"
            run = opened(system, Path(folder), "balance={keep: limits}", "verify.between=0", *settings, wider)
            _ = run.ranked, run.comparison
            laps = [time.process_time()]
            search = run.choice.search
            laps.append(time.process_time())
            fewest = Greedy(run, frf, decibel).fewest()
            laps.append(time.process_time())
        assert search is not None
        seconds = " | ".join(f"{each:.0f}" for each in np.diff(laps))
        lines.append(f"| {label} | {search.of} | {frf:.0%}, {decibel:g} dB | {search.modes} | {fewest} | {seconds} |")
        print(lines[-1], flush=True)
    if write:
        put("greedy", lines)


def certificates() -> None:
    """Errors over their estimates and bounds in random systems, half of them with unusual damping."""
    rng = np.random.default_rng(2026)
    ratios, settled, broken = [], [], 0
    for k in range(SYSTEMS):
        scene = random_scene(rng, ("modal", "matrix", "structural")[k % 3], extreme=k % 2 == 1)
        shapes = random_shapes(rng, scene)
        (found,) = settled_certificates(scene, shapes)
        (whole,) = whole_responses(scene)
        error = abs(scene.joined(shapes)[0].H - whole)
        broken += int((error > found.bound * (1 + 1e-9) + 1e-9 * abs(whole)).any())
        ratios.append(np.linalg.norm(error) / np.linalg.norm(found.estimate))
        settled.append(found.settled)
    print(f"{SYSTEMS} random systems: bound broken in {broken}; stated factor {ESTIMATE_FACTOR:g}")
    for words, some in (("settled", np.array(settled)), ("not settled", ~np.array(settled))):
        r = np.array(ratios)[some]
        print(f"estimate {words}: {r.size}; error over estimate: median {np.median(r):.3g}, largest {r.max():.3g}")


if __name__ == "__main__":
    arguments = sys.argv[1:]
    if "--range" in arguments and arguments[-1].isdigit():
        held_in_range(int(arguments[-1]))
    elif "--range" in arguments:
        whole_range([each for each in arguments if "=" in each])
    elif "--certificates" in arguments:
        certificates()
    elif "--greedy" in arguments:
        against_greedy("--write" in arguments)
    elif "--growing" in arguments:
        growing("--write" in arguments)
    elif "--search" in arguments:
        searched(next(each for each in arguments if each in LIMITS), [each for each in arguments if "=" in each])
    else:
        table([each for each in arguments if each in LIMITS] or list(LIMITS), "--write" in arguments)
