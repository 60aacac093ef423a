"""Run a pipeline at every point of a sweep, and write a table and a picture of error against speed."""

from __future__ import annotations

import hashlib
import math
import os
import platform
import time
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future, as_completed
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple
from uuid import uuid4

from cmsreduce import __version__
from cmsreduce.errors import CmsReduceError, ConfigError
from cmsreduce.linalg.sparse import InsufficientMemoryError
from cmsreduce.model import STATUS_OF, RunResult, SweepResult, SweepRow
from cmsreduce.pipeline.batch.dask_workers import chosen_workers
from cmsreduce.pipeline.batch.sweep_points import SweepPoint, sweep_points
from cmsreduce.pipeline.batch.workers import Workers, common_work
from cmsreduce.pipeline.execute import execute
from cmsreduce.pipeline.run import Run
from cmsreduce.pipeline.store import (
    STAGES_FOLDER,
    CommonWork,
    Failures,
    Progress,
    Silent,
    code_version,
    collecting,
    diagnostic,
    share_stages,
)
from cmsreduce.report import sweep_page, sweep_picture, trades
from cmsreduce.write import atomic_path, refuse_foreign, write_sweep_csv, write_sweep_table

__all__ = ["sweep", "write_sweep"]

_FILES = ("sweep.csv", "sweep.h5", "sweep.svg", "sweep.html")

POINTS_FOLDER = "points"
"""Folder of a sweep with a run directory for each point."""

# Errors of diagnostics for which a point is run again by itself.
_NO_MEMORY = (InsufficientMemoryError.__name__, MemoryError.__name__)
# Mean number of batches of a process: small batches keep all processes busy to the end.
_BATCHES = 8


def default_folder(output: Path) -> Path:
    """Default folder of a sweep: beside the run directory of its pipeline."""
    return output.with_name(f"{output.name}-sweep")


def sweep(
    path: Path,
    axes: Mapping[str, tuple[str, ...]],
    overrides: Sequence[str] = (),
    folder: Path | None = None,
    jobs: int = 1,
    progress: Progress | None = None,
    cluster: str | None = None,
) -> tuple[SweepResult, Path]:
    """Run every combination of values.

    Parameters
    ----------
    path : Path
        Pipeline file.
    axes : mapping of str to tuple of str
        Keys and their values, as of `sweep_axes`; the first is the slowest.
    overrides : sequence of str
        ``KEY=VALUE`` for all points.
    folder : Path, optional
        Output of the sweep: ``points/`` holds a run directory for each point, ``stages/`` the stages that they share.
    jobs : int
        Number of processes. Each uses its part of the cores.
    progress : Progress, optional
        Listener; called after each point.
    cluster : str, optional
        Address of a Dask scheduler, or a cluster file, to use its processes instead.

    Returns
    -------
    result : SweepResult
        A row for each point. The row of a point that failed has a message; the sweep goes on.
    folder : Path

    Raises
    ------
    CmsReduceError
        If the pipeline or a key of the sweep is wrong, so that no point can be run.
    """
    if jobs < 1:
        raise ConfigError(f"--jobs {jobs}: a sweep needs at least one process")
    started, progress = time.perf_counter(), progress or Silent()
    rows: dict[int, SweepRow] = {}
    points = sweep_points(path, axes, overrides)
    good = next(point.pipeline for point in points if point.pipeline is not None)
    folder = default_folder(good.output) if folder is None else folder
    refuse_foreign(folder / name for name in _FILES)
    with chosen_workers(jobs, cluster, path) as workers:
        progress.stage("sweep", f"{len(points)} points")
        for row in _rows(points, path, folder, workers):
            rows[row.point] = row
            if row.message:
                progress.note(f"point {row.point}, {row.label}: {row.message}")
            progress.advance(len(rows), len(points))
    result = SweepResult(
        good.name,
        dict(axes),
        tuple(rows[point.number] for point in points),
        time.perf_counter() - started,
        _provenance(path, overrides, workers, good.record(exclude_none=True)),
    )
    return result, folder


class _Outcome(NamedTuple):
    """The row of a point; None if one of its factors needs more memory than is free beside other points."""

    point: SweepPoint
    row: SweepRow | None


def _rows(points: Sequence[SweepPoint], path: Path, folder: Path, workers: Workers) -> Iterator[SweepRow]:
    if workers.here:
        for outcome in _one_by_one(points, path, folder, CommonWork()):
            assert outcome.row is not None
            yield outcome.row
    else:
        # Other processes have working directories of their own.
        yield from _in_processes(points, path.resolve(), folder.resolve(), workers)


def _one_by_one(
    points: Sequence[SweepPoint], path: Path, folder: Path, common: CommonWork, memory: float | None = None
) -> Iterator[_Outcome]:
    # Points of one reference model follow each other, so that it is made once.
    for point in sorted(points, key=lambda point: point.system):
        yield _run_point(point, path, folder, common, memory)


def _run_batch(
    sweep: str, points: Sequence[SweepPoint], path: Path, folder: Path, memory: float | None
) -> list[_Outcome]:
    return list(_one_by_one(points, path, folder, common_work(sweep), memory))


def _in_processes(points: Sequence[SweepPoint], path: Path, folder: Path, workers: Workers) -> Iterator[SweepRow]:
    run_batch = partial(_run_batch, uuid4().hex)
    with workers.start(workers.count) as executor:
        lost = yield from _side_by_side(run_batch, _batches(points, workers.count), path, folder, workers, executor)
    if lost:
        # It is not known at which point a process died, or whether it was killed for another reason.
        with workers.start(workers.count) as fresh:
            lost = yield from _side_by_side(run_batch, [(point,) for point in lost], path, folder, workers, fresh)
    while lost:
        with workers.start(1) as alone:
            while lost:
                point = lost.pop(0)
                try:
                    # It runs alone: its factors may take all the memory.
                    (outcome,) = workers.submit(alone, run_batch, (point,), path, folder, None).result()
                except workers.lost:
                    yield _failed(point, "its process was killed, even alone: probably too little memory for it")
                    break
                assert outcome.row is not None
                yield outcome.row


def _side_by_side(
    run_batch: Callable[..., list[_Outcome]],
    batches: Sequence[tuple[SweepPoint, ...]],
    path: Path,
    folder: Path,
    workers: Workers,
    executor: Executor,
) -> Generator[SweepRow, None, list[SweepPoint]]:
    """Yield rows of batches as they are finished; return points that were lost.

    A point is lost if its process is killed, or if it needs more than its share of the memory.
    """
    lost: list[SweepPoint] = []
    futures: dict[Future[list[_Outcome]], tuple[SweepPoint, ...]] = {}
    for batch in batches:
        try:
            futures[workers.submit(executor, run_batch, batch, path, folder, workers.memory)] = batch
        except workers.lost:
            lost += batch
    for future in as_completed(futures):
        try:
            outcomes = future.result()
        except workers.lost:
            lost += futures[future]
            continue
        for outcome in outcomes:
            if outcome.row is None:
                lost.append(outcome.point)
            else:
                yield outcome.row
    return lost


def _batches(points: Sequence[SweepPoint], jobs: int) -> list[tuple[SweepPoint, ...]]:
    """Batches of points that share one reference model; single points come last, so that no process waits long."""
    most = math.ceil(len(points) / (_BATCHES * jobs))
    systems: dict[str, list[SweepPoint]] = {}
    for point in points:
        systems.setdefault(point.system, []).append(point)
    batches = [tuple(group[at : at + most]) for group in systems.values() for at in range(0, len(group), most)]
    return [*batches[:-jobs], *((point,) for batch in batches[-jobs:] for point in batch)]


def _run_point(point: SweepPoint, path: Path, folder: Path, common: CommonWork, memory: float | None) -> _Outcome:
    own, started = folder / POINTS_FOLDER / point.folder, time.perf_counter()
    # A summary of an earlier sweep must not remain beside a point that fails.
    (own / "summary.json").unlink(missing_ok=True)
    if point.pipeline is None:
        return _Outcome(point, _failed(point, point.message))
    try:
        share_stages(own, folder / STAGES_FOLDER)
        run = Run(point.pipeline, own, Silent(), common=common)
        run.stages.share_memory(memory)
        result = execute(run, path, point.overrides, report=False)
    except CmsReduceError as error:
        if memory is not None and _lacks_memory(error):
            return _Outcome(point, None)
        return _Outcome(point, _failed(point, str(error), started))
    except Exception as error:
        # An unexpected error of one point must not end hours of work on other points.
        return _Outcome(point, _failed(point, f"{type(error).__name__}: {error}", started))
    assert result is not None
    if memory is not None and any(failure.error in _NO_MEMORY for failure in result.failures):
        return _Outcome(point, None)
    damaged = "; ".join(run.stages.store.damaged)
    return _Outcome(point, replace(_measured(point, result), message=damaged, point_s=time.perf_counter() - started))


def _lacks_memory(error: BaseException | None) -> bool:
    while error is not None and not isinstance(error, InsufficientMemoryError):
        error = error.__cause__
    return error is not None


def _failed(point: SweepPoint, message: str, started: float | None = None) -> SweepRow:
    seconds = float("nan") if started is None else time.perf_counter() - started
    text = " ".join(message.split())
    return SweepRow(point.number, _row_folder(point), dict(point.axes), "failed", text, point_s=seconds)


def _measured(point: SweepPoint, result: RunResult) -> SweepRow:
    figures: dict[str, Any] = result.worst()
    if result.speed is not None:
        names = ("reduce_s", "full_frf_s", "reduced_frf_s")
        figures |= {name: float(getattr(result.speed, name)) for name in names}
        if (costs := result.speed.simulation) is not None:
            figures |= {name: getattr(costs.reduced, name) for name in ("steps_per_second", "operations")}
            figures |= {"simulation_s": costs.reduced.seconds, "simulation_noise": costs.reduced.noise}
    return SweepRow(
        point.number,
        _row_folder(point),
        dict(point.axes),
        STATUS_OF[result.verdict.word],
        kept_modes=sum(part.kept_modes for part in result.components.values()),
        basis_size=sum(part.modes.basis_size for part in result.components.values()),
        n_reduced=max((each.n_reduced for each in result.configurations), default=0),
        n_full=max((each.n_full for each in result.configurations), default=0),
        **figures,
    )


def _row_folder(point: SweepPoint) -> str:
    return f"{POINTS_FOLDER}/{point.folder}"


def _provenance(path: Path, overrides: Sequence[str], workers: Workers, settings: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "program": f"cmsreduce {__version__}",
        "code": code_version("verify"),
        "libraries": {name: version(name) for name in ("numpy", "scipy", "h5py")},
        "pipeline": str(path.resolve()),
        "pipeline_sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
        "overrides": list(overrides),
        "settings_of_first_point": dict(settings),
        "jobs": workers.count,
        "threads": workers.threads,
        "machine": f"{platform.machine()}, {os.cpu_count()} cores, {platform.system()}",
        "made": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def write_sweep(sweep: SweepResult, folder: Path, failures: Failures | None = None) -> tuple[Path, ...]:
    """Write sweep.csv and sweep.h5, and sweep.svg and sweep.html where there are errors to draw; return the files.

    Parameters
    ----------
    sweep : SweepResult
    folder : Path
    failures : Failures, optional
        Receives a picture or a page that cannot be drawn.
    """
    table, store, picture, page = (folder / name for name in _FILES)
    write_sweep_csv(table, sweep)
    write_sweep_table(store, sweep)
    if not trades(sweep):
        # Pictures of an earlier sweep would not show this one.
        picture.unlink(missing_ok=True)
        page.unlink(missing_ok=True)
        return table, store
    with collecting(failures):
        files = [table, store, _write_picture(sweep, picture), _write_page(sweep, page)]
    return tuple(path for path in files if path is not None)


@diagnostic("the picture of the sweep")
def _write_picture(sweep: SweepResult, path: Path) -> Path | None:
    with atomic_path(path) as temporary:
        # The temporary name has no suffix of a picture format.
        drawn = temporary.with_suffix(".svg")
        sweep_picture(sweep, drawn)
        drawn.replace(temporary)
    return path


@diagnostic("the page of the sweep")
def _write_page(sweep: SweepResult, path: Path) -> Path | None:
    with atomic_path(path) as temporary:
        temporary.write_text(sweep_page(sweep), encoding="utf-8", errors="replace")
    return path
