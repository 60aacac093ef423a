"""The cache of stages: results are computed once, and held in memory, on disk, and for other points of a sweep."""

from __future__ import annotations

import resource
import time
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import asdict, replace
from functools import wraps
from pathlib import Path
from threading import Lock
from typing import Any, Concatenate, Literal, NamedTuple, ParamSpec, TypeVar, cast

import numpy as np

from cmsreduce.errors import MatrixError, StageError, WriteError
from cmsreduce.linalg.machine import SolverSettings, solver_settings
from cmsreduce.model import Factorisation, mapped_in
from cmsreduce.pipeline.store.diagnostics import Failures, diagnostic
from cmsreduce.pipeline.store.once import once
from cmsreduce.pipeline.store.progress import Progress
from cmsreduce.pipeline.store.stage_data import Arrays, Given, decode, encode
from cmsreduce.pipeline.store.stage_store import STAGES_FOLDER, StageStore

__all__ = ["FAILURES_LOG", "REPORT", "CommonWork", "Stages", "stage"]

REPORT = "report"
"""Not a stage: where it is the only one allowed, nothing is computed."""

FAILURES_LOG = "failures.log"
"""File of a run directory with the tracebacks of diagnostics that failed."""

P = ParamSpec("P")
T = TypeVar("T")

_MISSING = object()
_KIB = 1024


class CommonWork:
    """Results that points of a sweep share in memory, by stage and key; the oldest ones are dropped."""

    def __init__(self) -> None:
        self._held: dict[str, dict[Hashable, Any]] = {}

    def get(self, kind: str, key: Hashable, default: object = None) -> Any:
        """Result under a key."""
        return self._held.get(kind, {}).get(key, default)

    def hold(self, kind: str, key: Hashable, value: object, most: int) -> None:
        """Hold a result, and drop the oldest of its kind beyond ``most``."""
        held = self._held.setdefault(kind, {})
        held.pop(key, None)
        held[key] = value
        while len(held) > most:
            del held[next(iter(held))]


class _Entry(NamedTuple):
    """One stage of one body or of the system."""

    function: str
    stage: str
    what: str
    key: str
    stored: bool
    common: int
    again: Callable[[Any], bool] | None = None
    needed: bool = False


class Stages:
    """The cache of stages of one run, with times, factorisations and notes.

    Parameters
    ----------
    folder : Path
        Run directory.
    progress : Progress
        Listener.
    only : str, optional
        The one stage that may be run; every other stage that is stored must be finished.
    solver : SolverSettings, optional
        Settings under which stages factorise matrices.
    common : CommonWork, optional
        Results shared with other runs of this process.
    """

    def __init__(
        self,
        folder: Path,
        progress: Progress,
        only: str | None = None,
        solver: SolverSettings | None = None,
        common: CommonWork | None = None,
    ) -> None:
        # Arrays that outgrow memory lie beside the finished stages, on the same disk.
        given = SolverSettings() if solver is None else solver
        self.solver = replace(given, scratch=given.scratch or folder / STAGES_FOLDER)
        self.store, self.progress, self.only, self.common = StageStore(folder, progress.note), progress, only, common
        self.factorised: dict[str, dict[str, list[Factorisation]]] = {}
        self.seconds: dict[str, dict[str, float]] = {}
        self.peak_mib: dict[str, float] = {}
        self.written: list[Path] = []
        self.notes: list[str] = []
        self.failures = Failures(progress.note, folder / FAILURES_LOG)
        self.interrupted = False
        self._telling = Lock()

    def note(self, text: str) -> None:
        """Record something that a reader must know, and report it once."""
        if text not in self.notes:
            self.notes.append(text)
            self.progress.note(text)

    def share_memory(self, most: float | None) -> None:
        """Limit the bytes of a factor, unless the pipeline states a limit: other processes work beside this one."""
        if self.solver.memory is None and most is not None:
            self.solver = replace(self.solver, memory=most)

    @contextmanager
    def timed(self, stage: str, what: str) -> Iterator[None]:
        """Announce a piece of work, apply the solver settings to it, and count its time and factorisations."""
        if self.interrupted:
            raise KeyboardInterrupt
        with self._telling:
            self.progress.stage(stage, what)
        settings = replace(self.solver, work=[])
        started = time.perf_counter()
        try:
            with solver_settings(settings):
                yield
        except MatrixError as error:
            # Linear algebra knows no names of bodies.
            if f"'{what}'" in str(error):
                raise
            raise MatrixError(f"{stage} of '{what}': {error}") from error
        self._count(stage, what, time.perf_counter() - started, settings.work)

    def recall(self, stage: str, what: str, key: str, field: str, *, counted: bool = True) -> Any:
        """Read one field of a finished stage without its arrays, and count the time that the stage took if asked."""
        facts = self.store.facts(stage, what, key)
        if facts is None:
            return None
        if counted and stage not in self.seconds.get(what, {}):
            self._count_stored(stage, what, facts)
        return decode({}, facts["value"]["fields"][field], {})

    def find(self, entry: _Entry, run: Any, claim: ExitStack) -> Any:
        """Find a finished stage; without one give ``_MISSING``, and keep other processes from it until the claim ends.

        Raises
        ------
        StageError
            If the run may do another stage only, and this one is not finished.
        """
        if self.common is not None and entry.common:
            found = self.common.get(entry.function, entry.key, _MISSING)
            if found is not _MISSING:
                if entry.stage:
                    self._count(entry.stage, entry.what, 0.0, [])
                return found
        if not entry.stored:
            return _MISSING
        if (found := self._stored(entry, run)) is not _MISSING:
            return found
        if self.only not in (None, entry.stage) and not entry.needed:
            until = "" if self.only == REPORT else f" --until {self.only}"
            raise StageError(
                f"stage '{entry.stage}' of '{entry.what}' is not finished for these inputs and settings by this "
                f"version of cmsreduce; run `cmsreduce {entry.stage}` on this pipeline first, or `cmsreduce run{until}`"
            )
        if claim.enter_context(self.store.claimed(entry.stage, entry.what, entry.key)):
            return self._stored(entry, run)
        return _MISSING

    def keep(self, entry: _Entry, run: Any, value: Any) -> Any:
        """Store a result, and return it as a later run will read it."""
        stage, what, key = entry.stage, entry.what, entry.key
        if entry.stored:
            encoded, facts = encode(value)
            del value
            # In the layout that is read back: a run that was stopped and goes on rounds as one that was never stopped.
            arrays: Arrays = {
                name: array if mapped_in(array) is not None else np.asarray(array, order="C")
                for name, array in encoded.items()
            }
            del encoded
            done = [asdict(each) for each in self.factorised[what][stage]]
            counted = {"value": facts, "seconds": self.seconds[what][stage], "factorised": done}
            try:
                self.written.append(self.store.save(stage, what, key, arrays, counted))
            except WriteError:
                # Any later result says that the disk is full.
                if not entry.needed:
                    raise
            if any(mapped_in(array) is not None for array in arrays.values()):
                # Mapped in the finished file, so that the temporary one can be removed.
                with solver_settings(self.solver):
                    arrays = (self.store.load(stage, what, key) or (arrays, counted))[0]
            value = decode(arrays, facts, run.given)
        if self.common is not None and entry.common:
            self.common.hold(entry.function, key, value, entry.common)
        return value

    def _stored(self, entry: _Entry, run: Any) -> Any:
        """Result of a stage from disk, unless it is the one to run."""
        if self.only == entry.stage:
            return _MISSING
        with solver_settings(self.solver):
            found = self.store.load(entry.stage, entry.what, entry.key)
        if found is None:
            return _MISSING
        arrays, facts = found
        given: Given = run.given
        value = decode(arrays, facts["value"], given)
        # Only the stage itself knows whether its result is complete.
        if entry.again is not None and self.only != REPORT and entry.again(value):
            return _MISSING
        self._count_stored(entry.stage, entry.what, facts)
        with self._telling:
            self.progress.reused(entry.stage, entry.what)
        return value

    def _count_stored(self, stage: str, what: str, facts: dict[str, Any]) -> None:
        done = [Factorisation(**each) for each in facts["factorised"]]
        self._count(stage, what, float(facts["seconds"]), done)

    def _count(self, stage: str, what: str, seconds: float, done: list[Factorisation]) -> None:
        self.factorised.setdefault(what, {}).setdefault(stage, []).extend(done)
        spent = self.seconds.setdefault(what, {})
        spent[stage] = spent.get(stage, 0.0) + seconds
        # ru_maxrss is in KiB on Linux.
        self.peak_mib[what] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / _KIB


@diagnostic("the notes of '{}'", tuple, about=lambda stage, *_, **__: stage or "a stage")
def _noted(stage: str, notes: Callable[..., Iterable[str]], *args: Any, **named: Any) -> tuple[str, ...]:
    """Notes on the result of a stage."""
    return tuple(notes(*args, **named))


def stage(
    name: str,
    *,
    what: str | Callable[..., str] = "",
    key: Callable[..., str | None] | None = None,
    needs: Sequence[str] = (),
    notes: Callable[..., Iterable[str]] | None = None,
    stored: Literal["always", "in common", "never"] | Callable[..., bool] = "always",
    common: int = 0,
    again: Callable[..., bool] | None = None,
    needed: bool = False,
) -> Callable[[Callable[Concatenate[Any, P], T]], Callable[Concatenate[Any, P], T]]:
    """Make a method of a run a stage that is done once.

    The run has ``stages``, its cache, and ``given``, the bodies and configurations that stored results refer to.

    Parameters
    ----------
    name : str
        Stage that time is counted under, such as ``reduce``; empty for a result that is not timed.
    what : str or callable, optional
        Body or part whose name the result is held and stored under; by default the first argument, or ``system``. A
        callable takes the run and the arguments.
    key : callable, optional
        Takes the run and the arguments, gives the hash of everything that the result depends on; without it nothing
        is stored. Where it gives None, the pipeline has no such stage: the method is called without announcement and
        time.
    needs : sequence of str
        Earlier stages, so that their time is not counted here: properties, or methods that take the same arguments.
    notes : callable, optional
        Takes the run, the result and the arguments, gives what a reader must know, also of a stage that is reused.
    stored : str or callable
        ``always``, ``never``, or ``in common``: on disk only where work is shared with other runs. A callable takes
        the run and the arguments, and tells whether it is stored.
    common : int
        Number of results that runs of a sweep hold together in memory.
    again : callable, optional
        Takes the run, a stored result and the arguments, tells whether a part of it failed or lacks, so that a run
        makes it again; a report shows it.
    needed : bool
        True for a stage that is made in any case, also where another one alone was asked for, and that need not be
        stored, such as where the disk is full.
    """

    def about(run: Any, *args: Any, **named: Any) -> str:
        return what(run, *args, **named) if callable(what) else what or (str(args[0]) if args else "system")

    def decorated(work: Callable[Concatenate[Any, P], T]) -> Callable[Concatenate[Any, P], T]:
        @wraps(work)
        def finished(run: Any, *args: P.args, **named: P.kwargs) -> T:
            stages: Stages = run.stages
            digest = "" if key is None else key(run, *args, **named)
            if digest is None:
                result: Any = work(run, *args, **named)
            else:
                of = about(run, *args, **named)
                on_disk = stored == "always" or (stored == "in common" and stages.common is not None)
                on_disk = stored(run, *args, **named) if callable(stored) else on_disk
                lacks = None if again is None else lambda found: again(run, found, *args, **named)
                entry = _Entry(work.__name__, name, of, digest, on_disk and key is not None, common, lacks, needed)
                with ExitStack() as claim:
                    result = stages.find(entry, run, claim)
                    if result is _MISSING:
                        for need in needs:
                            if callable(earlier := getattr(run, need)):
                                earlier(*args, **named)
                        with stages.timed(name, of) if name else nullcontext():
                            result = work(run, *args, **named)
                        result = stages.keep(entry, run, result)
            if notes is not None:
                for text in _noted(name, notes, run, result, *args, **named):
                    stages.note(text)
            return result  # type: ignore[no-any-return]

        return once(cast(Callable[Concatenate[Any, P], T], finished), about)

    return decorated
