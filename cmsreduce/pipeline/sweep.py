"""Run a pipeline at every point of a sweep, one after the other or in several processes."""

from __future__ import annotations

import hashlib
import math
import os
import platform
import time
from collections.abc import Generator, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import version
from multiprocessing import get_context, parent_process
from pathlib import Path
from threading import Thread
from typing import Any

from threadpoolctl import threadpool_limits

from cmsreduce import __version__
from cmsreduce.errors import CmsReduceError, ConfigError
from cmsreduce.model import RunResult
from cmsreduce.model.sweep_result import SweepResult, SweepRow
from cmsreduce.pipeline.code_version import code_version
from cmsreduce.pipeline.execute import execute
from cmsreduce.pipeline.progress import Progress, Silent
from cmsreduce.pipeline.stage_store import STAGES_FOLDER, share_stages
from cmsreduce.pipeline.sweep_points import SweepAxis, SweepPoint, sweep_points
from cmsreduce.pipeline.sweep_run import CommonWork, SweepRun

__all__ = ["POINTS_FOLDER", "default_folder", "sweep"]

POINTS_FOLDER = "points"
"""Folder of a sweep with a run directory for each point."""

_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
# Batches that each process is given on average: more keep all processes busy to the end.
_BATCHES = 8


def default_folder(output: Path) -> Path:
    """Where a sweep goes if nobody says: beside the run directory of its pipeline."""
    return output.with_name(f"{output.name}-sweep")


def sweep(
    path: Path,
    axes: Sequence[SweepAxis],
    overrides: Sequence[str] = (),
    folder: Path | None = None,
    jobs: int = 1,
    progress: Progress | None = None,
) -> tuple[SweepResult, Path]:
    """Run every combination of values.

    Parameters
    ----------
    path : Path
        Pipeline file.
    axes : sequence of SweepAxis
        Keys and their values; the first is the slowest.
    overrides : sequence of str
        ``KEY=VALUE`` for all points.
    folder : Path, optional
        The sweep's output: ``points/`` holds a run directory for each point, ``stages/`` what they share.
    jobs : int
        Processes. They share the cores: each is given its part of the threads.
    progress : Progress, optional
        Told after each point.

    Returns
    -------
    result : SweepResult
        A row for each point; one that failed has its message, and the sweep goes on.
    folder : Path

    Raises
    ------
    CmsReduceError
        If the pipeline or a key of the sweep is wrong, so that no point can be run.
    """
    if jobs < 1:
        raise ConfigError(f"--jobs {jobs}: a sweep needs at least one process")
    started, tell = time.perf_counter(), progress or Silent()
    rows: dict[int, SweepRow] = {}
    # Processes start while the points are checked.
    with _pool(jobs, _threads_each(jobs)) if jobs > 1 else nullcontext() as pool:
        points = sweep_points(path, axes, overrides)
        good = next(point.pipeline for point in points if point.pipeline is not None)
        folder = default_folder(good.output) if folder is None else folder
        tell.stage("sweep", f"{len(points)} points")
        if pool is None:
            found = _one_by_one(points, path, folder, CommonWork())
        else:
            found = _in_processes(points, path, folder, jobs, pool)
        for row in found:
            rows[row.point] = row
            if row.message:
                tell.note(f"point {row.point}, {row.label}: {row.message}")
            tell.advance(len(rows), len(points))
    result = SweepResult(
        good.name,
        {axis.key: axis.values for axis in axes},
        tuple(rows[point.number] for point in points),
        time.perf_counter() - started,
        _provenance(path, overrides, jobs, good.model_dump(mode="json", exclude_none=True)),
    )
    return result, folder


def _one_by_one(points: Sequence[SweepPoint], path: Path, folder: Path, common: CommonWork) -> Iterator[SweepRow]:
    # Those of one full system one after the other, so that it is made once.
    for point in sorted(points, key=lambda point: point.system):
        yield _run_point(point, path, folder, common)


def _run_batch(points: Sequence[SweepPoint], path: Path, folder: Path) -> list[SweepRow]:
    return list(_one_by_one(points, path, folder, _common_of_process()))


@cache
def _common_of_process() -> CommonWork:
    """What the batches of one worker process have in common."""
    return CommonWork()


def _in_processes(
    points: Sequence[SweepPoint], path: Path, folder: Path, jobs: int, pool: ProcessPoolExecutor
) -> Iterator[SweepRow]:
    lost = yield from _side_by_side(_batches(points, jobs), path, folder, pool)
    if lost:
        # Which of them it was that a process died of is not known: another process may simply have been killed.
        with _pool(jobs, _threads_each(jobs)) as fresh:
            lost = yield from _side_by_side([(point,) for point in lost], path, folder, fresh)
    while lost:
        with _pool(1, _threads_each(jobs)) as alone:
            while lost:
                point = lost.pop(0)
                try:
                    yield from alone.submit(_run_batch, (point,), path, folder).result()
                except BrokenProcessPool:
                    yield _failed(point, "its process was killed, even alone: probably too little memory for it")
                    break


def _side_by_side(
    batches: Sequence[tuple[SweepPoint, ...]], path: Path, folder: Path, pool: ProcessPoolExecutor
) -> Generator[SweepRow, None, list[SweepPoint]]:
    """Rows of batches as they are finished; the points that were lost with a killed process are returned."""
    lost: list[SweepPoint] = []
    futures: dict[Future[list[SweepRow]], tuple[SweepPoint, ...]] = {}
    for batch in batches:
        try:
            futures[pool.submit(_run_batch, batch, path, folder)] = batch
        except BrokenProcessPool:
            lost += batch
    for future in as_completed(futures):
        try:
            yield from future.result()
        except BrokenProcessPool:
            lost += futures[future]
    return lost


@contextmanager
def _pool(jobs: int, threads: int) -> Iterator[ProcessPoolExecutor]:
    # Started afresh, not forked: threads of the libraries do not survive a fork.
    pool = ProcessPoolExecutor(jobs, get_context("spawn"), _begin_process, (threads,))
    try:
        for _ in range(jobs):
            pool.submit(_common_of_process)
        yield pool
    finally:
        # An interrupted sweep does not wait for the points that have not begun.
        pool.shutdown(cancel_futures=True)


def _batches(points: Sequence[SweepPoint], jobs: int) -> list[tuple[SweepPoint, ...]]:
    """Points in batches that share one full system, none so large that others wait for it at the end."""
    most = math.ceil(len(points) / (_BATCHES * jobs))
    systems: dict[str, list[SweepPoint]] = {}
    for point in points:
        systems.setdefault(point.system, []).append(point)
    return [tuple(group[at : at + most]) for group in systems.values() for at in range(0, len(group), most)]


def _run_point(point: SweepPoint, path: Path, folder: Path, common: CommonWork) -> SweepRow:
    if point.pipeline is None:
        return _failed(point, point.message)
    started = time.perf_counter()
    own = folder / POINTS_FOLDER / point.folder
    try:
        share_stages(own, folder / STAGES_FOLDER)
        # What an earlier sweep found here must not stand beside a point that now fails.
        (own / "summary.json").unlink(missing_ok=True)
        run = SweepRun(point.pipeline, own, Silent(), common)
        result = execute(run, path, point.overrides, report=False)
    except CmsReduceError as error:
        return _failed(point, str(error), started)
    except Exception as error:
        # Hours of other points must not be lost for one that nobody thought of.
        return _failed(point, f"{type(error).__name__}: {error}", started)
    assert result is not None
    said = "; ".join(run.ledger.store.damaged)
    return replace(_measured(point, result), message=said, point_s=time.perf_counter() - started)


def _failed(point: SweepPoint, message: str, started: float | None = None) -> SweepRow:
    seconds = float("nan") if started is None else time.perf_counter() - started
    text = " ".join(message.split())
    return SweepRow(point.number, _row_folder(point), dict(point.axes), "failed", text, point_s=seconds)


def _measured(point: SweepPoint, result: RunResult) -> SweepRow:
    figures: dict[str, Any] = result.worst()
    if result.speed is not None:
        names = ("reduce_s", "full_frf_s", "reduced_frf_s")
        figures |= {name: float(getattr(result.speed, name)) for name in names}
    return SweepRow(
        point.number,
        _row_folder(point),
        dict(point.axes),
        "passed" if result.passed else "limit broken",
        kept_modes=sum(part.kept_modes for part in result.components.values()),
        basis_size=sum(part.modes.basis_size for part in result.components.values()),
        n_reduced=max((each.n_reduced for each in result.configurations), default=0),
        n_full=max((each.n_full for each in result.configurations), default=0),
        **figures,
    )


def _row_folder(point: SweepPoint) -> str:
    return f"{POINTS_FOLDER}/{point.folder}"


def _threads_each(jobs: int) -> int:
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    allowed = os.environ.get(_THREADS[0], "")
    most = min(cores, int(allowed)) if allowed.isdigit() and int(allowed) else cores
    return max(1, min(most, cores // jobs))


def _begin_process(threads: int) -> None:
    # Libraries that are loaded by now are told; those to come, and our own solver settings, read the environment.
    for name in _THREADS:
        os.environ[name] = str(threads)
    threadpool_limits(threads)
    Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """Leave when the sweep is killed, instead of waiting for points for ever; files are whole or not there."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _provenance(path: Path, overrides: Sequence[str], jobs: int, settings: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "program": f"cmsreduce {__version__}",
        "code": code_version("verify"),
        "libraries": {name: version(name) for name in ("numpy", "scipy", "h5py")},
        "pipeline": str(path.resolve()),
        "pipeline_sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
        "overrides": list(overrides),
        "settings_of_first_point": dict(settings),
        "jobs": jobs,
        "threads": _threads_each(jobs),
        "machine": f"{platform.machine()}, {os.cpu_count()} cores, {platform.system()}",
        "made": datetime.now(UTC).isoformat(timespec="seconds"),
    }
