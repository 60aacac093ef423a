"""A pipeline file run from Python, and its results as objects."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from cmsreduce.errors import ConfigError, SceneError, StageError, not_among, optional_library
from cmsreduce.model import ERRORS, MultibodyScene, RunResult, Verdict
from cmsreduce.models_in_memory import AssembledSystem, Component
from cmsreduce.pipeline import STAGES, Run, execute
from cmsreduce.pipeline.batch import opened_run
from cmsreduce.pipeline.results import floating_bodies, multibody_scene, run_result
from cmsreduce.report import Output, Plots, csv_tables, html_card, run_card
from cmsreduce.simulate import Law, Method, Motion, simulate_scene
from cmsreduce.write import summary

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["FinishedRun", "run", "simulate"]


class _Bodies(dict[str, Component]):
    """Reduced bodies by name."""

    def __missing__(self, name: object) -> Component:
        raise SceneError(not_among("reduced body", str(name), self))


class _Summary(dict[str, Any]):
    """Content of summary.json, which is too long to show."""

    def __repr__(self) -> str:
        return f"<summary of {self.get('name')}: {', '.join(self)}>"


class FinishedRun:
    """Results of a run.

    Parameters
    ----------
    work : Run
        The run with its stages; a stage that is not finished is run when one of its results is needed.
    result : RunResult, optional
        Findings of a whole run; None if the run stopped earlier.
    """

    def __init__(self, work: Run, result: RunResult | None) -> None:
        self.work, self.folder, self._result = work, work.folder, result

    @property
    def result(self) -> RunResult:
        """Findings of the whole run: all that its report shows.

        Raises
        ------
        StageError
            If the run was asked to stop before its last stage.
        """
        if self._result is None:
            raise StageError("the run stopped at the stage of `until`; run it without `until` for errors and verdict")
        return self._result

    @property
    def passed(self) -> bool:
        """True if the verdict is ``PASS``: limits are set, and each of them and every check is met."""
        return self.result.passed

    @property
    def verdict(self) -> Verdict:
        """Verdict on the run: its word, the limits that decide it, and what was proven or trusted."""
        return self.result.verdict

    @property
    def report(self) -> Path:
        """The HTML report; a `StageError` if the run stopped before its last stage."""
        _ = self.result
        return self.folder / "report.html"

    @cached_property
    def summary(self) -> dict[str, Any]:
        """Content of summary.json."""
        return _Summary(summary(self.result))

    @cached_property
    def components(self) -> dict[str, Component]:
        """Reduced bodies with the modes kept, by name; a `SceneError` for another name lists them."""
        return _Bodies({name: Component.of(modal) for name, modal in self.work.final.items()})

    @cached_property
    def errors(self) -> pd.DataFrame:
        """Errors of the reduced system, one row a configuration; no rows if the pipeline has no `verify`.

        ``frf_error`` and ``frequency_error`` are fractions, ``db_error`` is in dB; ``n_full`` and ``n_reduced`` are
        coordinates of the reference model and of the reduced system.
        """
        pandas = optional_library("pandas", "pandas", "tables in Python")
        result = self.result
        rows = {
            each.configuration.name: {name: getattr(each.errors[result.model], name) for name in ERRORS}
            | {"n_full": each.n_full, "n_reduced": each.n_reduced}
            for each in result.configurations
        }
        frame: pd.DataFrame = pandas.DataFrame.from_dict(rows, orient="index").rename_axis("configuration")
        return frame

    @cached_property
    def plot(self) -> Plots:
        """Plots of the run: ``bode("motor", "gyro.rz")``, ``error_cost()``, ``mac()``, ``ranking()``, ``modes()``.

        Each is a figure of plotly.
        """
        whole = self.result
        return Plots(whole if whole.drawing is not None else run_result(self.work, views=True))

    def table(self, name: str = "errors") -> pd.DataFrame:
        """A table of the report as numbers: errors, modes, frequencies, checks, timings, gains, completeness ...

        Raises
        ------
        SceneError
            If the run has no such table; the message lists those that it has.
        """
        pandas, tables = optional_library("pandas", "pandas", "tables in Python"), csv_tables(self.result)
        if name not in tables:
            raise SceneError(not_among("table", name, tables))
        head, *rows = tables[name]
        frame: pd.DataFrame = pandas.DataFrame(rows, columns=head)
        return frame

    @property
    def configurations(self) -> tuple[str, ...]:
        """Names of the configurations, such as ``spin=45 cone=30`` with angles in degrees."""
        return tuple(each.name for each in self.work.scene.configurations)

    def system(self, configuration: str | None = None) -> AssembledSystem:
        """The reduced system in a configuration, by default the first one.

        Raises
        ------
        SceneError
            If there is no configuration of this name; the message lists all names.
        """
        first = AssembledSystem(self.work.model.assembled, self.work.scene.configurations[0])
        return first if configuration is None else first.at(configuration)

    def _repr_html_(self) -> str:
        """Verdict and main figures as a card of a notebook."""
        if self._result is None:
            return html_card(self.work.pipeline.name, "stopped early", [("folder", str(self.folder))])
        return run_card(self._result)

    def __repr__(self) -> str:
        name, count = self.work.pipeline.name, len(self.configurations)
        if self._result is None:
            return f"<FinishedRun {name}: stopped early, {count} configurations, in {self.folder}>"
        kept = sum(part.kept_modes for part in self._result.components.values())
        worst = "".join(f", {key} {value:.3g}" for key, value in self._result.worst().items() if key == "frf_error")
        verdict = self.result.verdict.word
        return f"<FinishedRun {name}: {verdict}{worst}, {kept} modes kept, {count} configurations, in {self.folder}>"


def run(
    pipeline: str | Path,
    *,
    set: Mapping[str, Any] | None = None,
    out: str | Path | None = None,
    until: str | None = None,
    jobs: int = 1,
    progress: bool = False,
) -> FinishedRun:
    """Run a pipeline file; finished stages are reused, and files are written as by the command `cmsreduce run`.

    Parameters
    ----------
    pipeline : path
        YAML file.
    set : mapping of key to value, optional
        Keys that win over those of the file: {"balance.keep": {"modes": 20}, "reduce.cutoff": 3}. None leaves
        a key out.
    out : path, optional
        Folder of the results instead of the one that the file names.
    until : str, optional
        Last stage to run: read, reduce, orthogonalise, balance, project, assemble, verify or write.
    jobs : int
        Processes.
    progress : bool
        Print the progress.

    Raises
    ------
    CmsReduceError
        If the file or its data is wrong; the message says where and what to do. A broken limit is no error: see
        `FinishedRun.passed`.
    """
    if until is not None and until not in STAGES:
        raise StageError(not_among("stage", until, STAGES))
    if not isinstance(set or {}, Mapping):
        raise ConfigError(f"set: {set!r} is not a mapping of key to value, such as {{'reduce.cutoff': 3}}")
    overrides = [f"{key}={json.dumps(value, default=_plain)}" for key, value in (set or {}).items()]
    with (
        Output(quiet=not progress, verbose=progress).watch() as listener,
        opened_run(Path(pipeline), overrides, None if out is None else Path(out), listener, jobs=jobs) as work,
    ):
        return FinishedRun(work, execute(work, Path(pipeline), overrides, until))


def simulate(
    scene: str | Path | FinishedRun | MultibodyScene,
    seconds: float,
    *,
    configuration: str | None = None,
    efforts: Mapping[str, Law] | None = None,
    gravity: Sequence[float] = (0.0, 0.0, 0.0),
    rates: Mapping[str, float] | None = None,
    velocity: ArrayLike | None = None,
    spin: ArrayLike | None = None,
    modes: Mapping[str, ArrayLike] | None = None,
    points: int = 200,
    accuracy: float = 1e-6,
    step: float | None = None,
    method: Method = "explicit",
) -> Motion:
    """Simulate the reduced bodies of a run in time: large motions of bodies and joints, small deflections by modes.

    Parameters
    ----------
    scene : path, FinishedRun or MultibodyScene
        Folder of a run, the run, or its scene.
    seconds : float
        Time to simulate.
    configuration : str, optional
        Configuration at the start, by default the first one.
    efforts : mapping of actuator to function of time, optional
        `Pulse`, `Slew` or any function of the time in seconds; in the units of the scene. Steps end at the ``points``
        and where a pulse or a slew begins and ends; a function that acts for less than the time between two points
        needs more points, or an attribute ``ends`` with these times.
    gravity : (3,) sequence of float
        Acceleration of free fall, along the axes of the scene.
    rates : mapping of ``JOINT.DOF`` to float, optional
        Rates at the start. Bodies start as rigid ones, in the motion of least kinetic energy that has these rates.
    velocity, spin : (3,) array_like, optional
        Of the base body at the start, at the origin of its basic frame, along the axes of the scene.
    modes : mapping of body to (k,), optional
        Modal coordinates at the start.
    points : int
        Times of the motion, evenly spread, besides the start.
    accuracy : float
        Error of each radian of the fastest mode, and relative error of a step.
    step : float, optional
        Fixed step in seconds instead.
    method : str
        ``explicit`` (order 8; the fastest mode limits the step), or ``implicit`` (order 5; fast modes are damped).

    Raises
    ------
    CmsReduceError
        If the scene cannot be simulated, or the motion grows without bound; the message says where and why.
    """
    if isinstance(scene, FinishedRun):
        scene = scene.folder
    if not isinstance(scene, MultibodyScene):
        scene = multibody_scene(Path(scene), configuration)
    elif configuration is not None:
        raise SceneError("the scene is in one configuration already; take `configuration` out")
    return simulate_scene(
        scene,
        floating_bodies(scene),
        seconds,
        efforts=efforts,
        gravity=gravity,
        rates=rates,
        velocity=velocity,
        spin=spin,
        modes=modes,
        points=points,
        accuracy=accuracy,
        step=step,
        method=method,
    )


def _plain(value: Any) -> Any:
    """Numbers of numpy and paths as JSON has them."""
    return value.tolist() if hasattr(value, "tolist") else str(value)
