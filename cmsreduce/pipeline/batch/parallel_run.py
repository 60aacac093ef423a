"""A run that distributes its bodies and configurations to several processes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from shutil import rmtree
from typing import Any, TypeVar
from uuid import uuid4

from cmsreduce.config import Pipeline, load_pipeline
from cmsreduce.model import ConfigurationResult, Failure
from cmsreduce.pipeline.batch.dask_workers import chosen_workers
from cmsreduce.pipeline.batch.workers import Workers
from cmsreduce.pipeline.run import Run, file_size
from cmsreduce.pipeline.store import (
    CommonWork,
    Failures,
    Progress,
    Silent,
    branch_of,
    collecting,
    report_failures,
)
from cmsreduce.pipeline.system import ReducedModel
from cmsreduce.read import expect_kind

__all__ = ["ParallelRun", "opened_run"]

T = TypeVar("T")

# Folder in that of the stages.
_TAKEN = ".taken"


@dataclass(frozen=True)
class _Opening:
    """A run as other processes open it, each once for all its tasks."""

    pipeline: Pipeline = field(compare=False)
    folder: Path
    memory: float | None
    number: str = field(default_factory=lambda: uuid4().hex)


class ParallelRun(Run):
    """A run in which other processes reduce the bodies and measure the configurations.

    The processes write finished stages to the run directory, where the run finds them. If a process is killed or meets
    an error, the run does the work of that process itself, and reports the error as a single process does.

    Parameters
    ----------
    pipeline : Pipeline
    folder : Path
        Run directory, which the processes must see under the same name.
    progress : Progress
    workers : Workers
    executor : Executor
        Executor that runs the tasks of the workers.
    """

    def __init__(
        self, pipeline: Pipeline, folder: Path, progress: Progress, workers: Workers, executor: Executor
    ) -> None:
        super().__init__(pipeline, folder, progress, common=CommonWork())
        self._workers, self._executor = workers, executor
        self._opening = _Opening(pipeline, folder.resolve(), workers.memory)

    def finish_bodies(self) -> None:
        """Reduce and orthonormalise all bodies, each in a process of its own; copies of a body are done with it."""
        asked = {name: (self.body_key(name), self.pipeline.reduce_of(name)) for name in self.flexible_names}
        names = [name for k, (name, keys) in enumerate(asked.items()) if keys not in [*asked.values()][:k]]
        # The longest work first: no process is left with it while the others are done.
        names.sort(key=lambda name: file_size(self.pipeline, name), reverse=True)
        if len(names) < 2:
            return
        self.stages.progress.stage("reduce", f"{len(names)} bodies in {self._workers.count} processes")
        with self._marks() as taken:
            for _, name in self._outcomes(_finish_body, [(name, names, taken) for name in names] if taken else []):
                # Read while the others are at work.
                self._proven(name)

    @contextmanager
    def _marks(self) -> Iterator[Path | None]:
        """Folder in which a process marks the body that it takes; None where the processes cannot share results."""
        folder = self.stages.store.folder.resolve() / _TAKEN
        # Of a run that was killed.
        rmtree(folder, ignore_errors=True)
        try:
            folder.mkdir(parents=True)
        except OSError:
            # The first result to write reports it.
            yield None
            return
        try:
            yield folder
        finally:
            rmtree(folder, ignore_errors=True)

    def measured(self, models: Mapping[str, ReducedModel]) -> tuple[ConfigurationResult, ...]:
        """Errors and curves in every configuration; each process measures some of them."""
        count = len(self.scene.configurations)
        shares = [
            (tuple(range(first, count, self._workers.count)),) for first in range(min(self._workers.count, count))
        ]
        if len(shares) < 2:
            return super().measured(models)
        found: dict[int, ConfigurationResult] = {}
        for _, (results, failures, reference_s, reduced_s) in self._outcomes(_measure, shares):
            found |= results
            report_failures(failures)
            self.comparison.reference_seconds += reference_s
            self.comparison.reduced_seconds += reduced_s
        for number, configuration in enumerate(self.scene.configurations):
            if number not in found:
                for each in self.comparison.measured([configuration], models):
                    found[number] = each
        return tuple(found[number] for number in sorted(found))

    def on_bodies(self, work: Callable[..., T], names: Sequence[str], *shared: object) -> list[T]:
        """Results of a piece of work on each of some bodies; each process does it for some of them."""
        # A process would first rank or project the modes again.
        if len(names) == 1 or self._ranks or self.pipeline.project is not None:
            return super().on_bodies(work, names, *shared)
        known = tuple(self.stages.notes)
        tasks = [(name, work, shared, known) for name in names]
        found = {name: outcome for (name, *_), outcome in self._outcomes(_on_body, tasks)}
        results = []
        for name in names:
            if name not in found:
                results.append(work(self, name, *shared))
                continue
            result, failures, notes = found[name]
            report_failures(failures)
            for note in notes:
                self.stages.note(note)
            results.append(result)
        return results

    def _outcomes(self, work: Any, arguments: Sequence[tuple[Any, ...]]) -> Iterator[tuple[Any, Any]]:
        """Arguments and result of each piece of work that succeeded, in the order they are finished."""
        futures = {}
        for each in arguments:
            try:
                futures[self._workers.submit(self._executor, work, self._opening, *each)] = each
            except self._workers.lost:
                break
        for number, future in enumerate(as_completed(futures), 1):
            try:
                outcome = future.result()
            except Exception:
                # The process died, or its result cannot be sent: whatever it was, this run does the work itself.
                outcome = None
            self.stages.progress.advance(number, len(arguments))
            if outcome is not None:
                yield futures[future], outcome


@contextmanager
def opened_run(
    source: Path,
    overrides: Sequence[str],
    folder: Path | None,
    progress: Progress,
    *,
    only: str | None = None,
    jobs: int = 1,
    cluster: str | None = None,
) -> Iterator[Run]:
    """Open a run, with processes that share its work while the block lasts.

    Parameters
    ----------
    source : Path
        Pipeline file.
    overrides : sequence of str
        ``KEY=VALUE`` each.
    folder : Path, optional
        Run directory, instead of the pipeline's own.
    progress : Progress
    only : str, optional
        The one stage to run, in this process.
    jobs : int
        Processes of this machine.
    cluster : str, optional
        Address of a Dask scheduler, or a cluster file.

    Raises
    ------
    CmsReduceError
        If the pipeline or the cluster is wrong.
    """
    expect_kind(source, "pipeline")
    # Proofs are found by the names of files: all processes must give them the same ones.
    source = source if cluster is None else source.resolve()
    pipeline = load_pipeline(source, overrides)
    folder = pipeline.output if folder is None else folder
    with chosen_workers(jobs, cluster, source) as workers:
        alone = Run(pipeline, folder, progress, only)
        if workers.here or only is not None or alone.is_finished:
            yield alone
            return
        with workers.start(workers.count) as executor:
            run = ParallelRun(pipeline, folder, progress, workers, executor)
            run.finish_bodies()
            yield run


@lru_cache(maxsize=1)
def _opened(opening: _Opening) -> Run:
    # A process keeps what one task reads, proves and factorises for its next ones.
    run = Run(opening.pipeline, opening.folder, Silent(), common=CommonWork())
    run.stages.share_memory(opening.memory)
    run.makes_reference = run.pipeline.verify is not None
    return run


def _finish_body(opening: _Opening, first: str, names: Sequence[str], taken: Path) -> str | None:
    """Reduce a body that no other process has taken, best one that this process has proven; its name.

    The processes first read and prove all bodies together, each from another one.
    """
    try:
        opened = _opened(opening)
        opened.flexible(first)
        for each in opened.at_hand(names):
            opened.flexible(each)
        _ = opened.bodies
        # The factor of a proof serves the reduction. Of the bodies proven here the last one comes first; of the others
        # the first one, whose factor another process is the likeliest to have dropped.
        own = [name for name in names[::-1] if opened.has_proven(name)]
        name = next(name for name in [*own, *names] if _take(taken / name))
        # The results of the body are on disk: the process holds the bodies as read alone.
        run = branch_of(opened)
        if name in run.reduced_names:
            run.modal(name)
        if run.pipeline.verify is not None and name not in run.mode_sets.unneeded:
            run.reference(name)
        if run.pipeline.verify is not None and name in run.reduced_names and run.measure.checks_statics(name):
            run.unit_loads(name)
    except Exception:
        # Any error: the run that gave the task meets the same one in its own process, and reports it.
        return None
    return name


def _take(mark: Path) -> bool:
    """Mark a body as taken; False where another process was quicker."""
    try:
        mark.touch(exist_ok=False)
    except FileExistsError:
        return False
    return True


def _on_body(
    opening: _Opening, name: str, work: Callable[..., T], shared: Sequence[object], known: Sequence[str]
) -> tuple[T, tuple[Failure, ...], list[str]] | None:
    """Result of a piece of work on a body, failures, and notes beside the known ones."""
    try:
        run = _opened(opening)
        run.stages.notes = [*known]
        with collecting(Failures(log=run.stages.failures.log)) as failed:
            result = work(run, name, *shared)
    except Exception:
        # As for a body: the run does this work itself, and reports the error.
        return None
    return result, tuple(failed), run.stages.notes[len(known) :]


def _measure(
    opening: _Opening, numbers: Sequence[int]
) -> tuple[dict[int, ConfigurationResult], tuple[Failure, ...], float, float] | None:
    """Results of some configurations, failures, and the wall times of the two models' responses."""
    try:
        run = _opened(opening)
        comparison = run.comparison
        # Another task of this process may have used the same model.
        comparison.reference_seconds = comparison.reduced_seconds = 0.0
        with collecting(Failures(log=run.stages.failures.log)) as failed:
            models = run.models()
            measured = comparison.measured([run.scene.configurations[number] for number in numbers], models)
    except Exception:
        # As for a body: the run measures these configurations itself, and reports the error.
        return None
    names = {each.configuration.name: each for each in measured}
    results = {number: names[name] for number in numbers if (name := run.scene.configurations[number].name) in names}
    return results, tuple(failed), comparison.reference_seconds, comparison.reduced_seconds
