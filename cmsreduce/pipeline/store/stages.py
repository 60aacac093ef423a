"""What a run tells whoever watches it.

What has been done, how long it took, and what need not be done again.
"""

from __future__ import annotations

import resource
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError, StageError
from cmsreduce.linalg.machine import SolverSettings, solver_settings
from cmsreduce.model import Factorisation, mapped_in
from cmsreduce.pipeline.store.stage_store import STAGES_FOLDER, StageStore

__all__ = [
    "Ledger",
    "Progress",
    "REPORT",
    "Silent",
]


class Progress(Protocol):
    """Listener of a run; the command line shows it as a bar or as plain lines."""

    def stage(self, stage: str, what: str) -> None:
        """Begin a piece of work, such as ``reduce rotor``."""

    def reused(self, stage: str, what: str) -> None:
        """Report that a finished stage was found and is not run again."""

    def advance(self, done: int, total: int) -> None:
        """Report how far the current piece of work is."""

    def note(self, text: str) -> None:
        """Report something the reader must know."""


class Silent:
    """A listener that says nothing."""

    def stage(self, stage: str, what: str) -> None:
        """Ignore."""

    def reused(self, stage: str, what: str) -> None:
        """Ignore."""

    def advance(self, done: int, total: int) -> None:
        """Ignore."""

    def note(self, text: str) -> None:
        """Ignore."""


REPORT = "report"
"""Not a stage: named as the only one, it lets nothing be computed."""

Arrays = Mapping[str, NDArray[Any]]
T = TypeVar("T")


class Ledger:
    """Runs a piece of work, or takes it from the store if it is finished.

    Parameters
    ----------
    folder : Path
        Run directory.
    progress : Progress
        Told what happens.
    only : str, optional
        The one stage that may be run; every other must be finished.
    solver : SolverSettings, optional
        How work factorises its matrices.
    """

    def __init__(
        self, folder: Path, progress: Progress, only: str | None = None, solver: SolverSettings | None = None
    ) -> None:
        # What outgrows memory while it is made lies beside the finished stages, on the same disk.
        self.solver = replace(SolverSettings() if solver is None else solver, scratch=folder / STAGES_FOLDER)
        self.factorised: dict[str, dict[str, list[Factorisation]]] = {}
        self.store, self.progress, self.only = StageStore(folder, progress.note), progress, only
        self.seconds: dict[str, dict[str, float]] = {}
        self.peak_mib: dict[str, float] = {}
        self.written: list[Path] = []
        self.notes: list[str] = []

    def once(
        self,
        stage: str,
        what: str,
        key: str,
        work: Callable[[], T],
        pack: Callable[[T], tuple[Arrays, Mapping[str, Any]]],
        unpack: Callable[[Arrays, Mapping[str, Any]], T],
        prepare: Callable[[], object] = lambda: None,
    ) -> T:
        """Do a stage, or read it back if the store has it under the same key.

        Parameters
        ----------
        stage, what : str
            Such as ``reduce`` and ``rotor``.
        key : str
            Hash of everything the stage depends on.
        work : callable
            Does it.
        pack, unpack : callable
            To arrays and facts, and back.
        prepare : callable, optional
            Sees to the earlier stages the work needs, so that their time is not counted here.

        Raises
        ------
        StageError
            If another stage alone was asked for and this one is not finished.
        """
        if (found := self._finished(stage, what, key)) is not None:
            return unpack(*found)
        if self.only not in (None, stage):
            whole = "" if self.only == REPORT else f" --until {self.only}"
            raise StageError(
                f"stage '{stage}' of '{what}' is not finished for these inputs and settings; run `cmsreduce {stage}` "
                f"on this pipeline first, or `cmsreduce run{whole}`"
            )
        with self.store.claimed(stage, what, key) as shared:
            if shared and (found := self._finished(stage, what, key)) is not None:
                return unpack(*found)
            prepare()
            packed, described = pack(self.timed(stage, what, work))
            # Laid out as what is read back, so that a run that goes on from here rounds as one that was never stopped.
            arrays: Arrays = {
                name: array if mapped_in(array) is not None else np.asarray(array, order="C")
                for name, array in packed.items()
            }
            del packed
            done = [asdict(each) for each in self.factorised[what][stage]]
            facts = {**described, "seconds": self.seconds[what][stage], "factorised": done}
            self.written.append(self.store.save(stage, what, key, arrays, facts))
            if any(mapped_in(array) is not None for array in arrays.values()):
                # From the finished file, so that the other one goes.
                arrays = (self._load(stage, what, key) or (arrays, facts))[0]
        return unpack(arrays, facts)

    def recall(self, stage: str, what: str, key: str) -> None:
        """Take the time of a finished stage that a later one made needless to read."""
        if stage not in self.seconds.get(what, {}):
            facts = self.store.facts(stage, what, key)
            if facts is not None:
                self._recall(stage, what, facts)

    def timed(self, stage: str, what: str, work: Callable[[], T]) -> T:
        """Do a piece of work and note how long it took, and what it factorised."""
        self.progress.stage(stage, what)
        settings = replace(self.solver, work=[])
        started = time.perf_counter()
        try:
            with solver_settings(settings):
                result = work()
        except MatrixError as error:
            # Linear algebra does not know whose matrices it is given.
            if f"'{what}'" in str(error):
                raise
            raise MatrixError(f"{stage} of '{what}': {error}") from error
        self._add(stage, what, time.perf_counter() - started, settings.work)
        return result

    def share_memory(self, most: float | None) -> None:
        """Let a factor take no more than so many bytes, unless the pipeline says how many: others work beside."""
        if self.solver.memory is None and most is not None:
            self.solver = replace(self.solver, memory=most)

    def note(self, text: str) -> None:
        """Keep something a reader must know, and say it."""
        if text not in self.notes:
            self.notes.append(text)
            self.progress.note(text)

    def _finished(self, stage: str, what: str, key: str) -> tuple[Arrays, Mapping[str, Any]] | None:
        """Take a stage from the store, unless it is the one to be done."""
        if self.only == stage or (found := self._load(stage, what, key)) is None:
            return None
        self._recall(stage, what, found[1])
        self.progress.reused(stage, what)
        return found

    def _load(self, stage: str, what: str, key: str) -> tuple[Arrays, Mapping[str, Any]] | None:
        with solver_settings(self.solver):
            return self.store.load(stage, what, key)

    def _recall(self, stage: str, what: str, facts: Mapping[str, Any]) -> None:
        done = [Factorisation(**each) for each in facts.get("factorised", ())]
        self._add(stage, what, float(facts["seconds"]), done)

    def _add(self, stage: str, what: str, seconds: float, done: list[Factorisation]) -> None:
        self.factorised.setdefault(what, {}).setdefault(stage, []).extend(done)
        spent = self.seconds.setdefault(what, {})
        spent[stage] = spent.get(stage, 0.0) + seconds
        # ru_maxrss is in KiB on Linux.
        self.peak_mib[what] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
