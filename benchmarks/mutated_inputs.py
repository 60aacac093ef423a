"""Damaged files of every kind: each is read, or refused with one message, within 20 s of a processor and 2 GB.

``python benchmarks/mutated_inputs.py [COUNT] [--seed N] [--only NAME]`` damages the good files of ``tests/hard`` COUNT
times (5000 if not given) and prints one row a file. Each case runs in a process of its own, whose address space is
limited. It exits with 1 if a case ends in a traceback, a crash, a warning of numpy, or beyond a limit.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import pickle
import random
import resource
import select
import sys
import tempfile
import traceback
import warnings
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
# The good files live with the tests, which are not installed.
sys.path.insert(0, str(ROOT))

from cmsreduce.errors import CmsReduceError  # noqa: E402
from tests.hard.good_files import actions, good_files  # noqa: E402
from tests.read.mutations import damaged  # noqa: E402

SECONDS, MEMORY = 20.0, 2 * 2**30
# A busy machine takes longer: seconds are those of a processor, and the clock only ends what hangs.
WAITING = 4
_GOOD: dict[str, bytes] = {}


@dataclass
class Row:
    """Results of one file's cases."""

    cases: int = 0
    read: int = 0
    refused: int = 0
    failed: int = 0
    slowest: float = 0.0
    most_mib: float = 0.0
    reasons: Counter[str] = field(default_factory=Counter)


def main() -> None:
    """Run the cases and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("count", nargs="?", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--only", default="", help="part of a file's name")
    parser.add_argument("--keep", type=Path, help="folder for the files that fail")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        good = {name: content for name, content in good_files(folder).items() if given.only in name}
        rows: dict[str, Row] = {name: Row() for name in good}
        names = list(good)
        cases = [(folder, number, names[number % len(names)], given.seed) for number in range(given.count)]
        # Forked: a case starts with all libraries loaded.
        with ProcessPoolExecutor(given.jobs, get_context("fork"), _start, (good,)) as pool:
            for (_, number, name, _), found in zip(cases, pool.map(_case, cases, chunksize=20), strict=True):
                _count(rows[name], *found)
                if found[0] == "failed" and given.keep is not None:
                    given.keep.mkdir(parents=True, exist_ok=True)
                    (given.keep / f"{number:05d}_{name}").write_bytes(_content(good[name], given.seed, name, number))
    _print(rows)
    sys.exit(any(row.failed for row in rows.values()))


def _start(good: dict[str, bytes]) -> None:
    _GOOD.update(good)


def _content(good: bytes, seed: int, name: str, number: int) -> bytes:
    return damaged(good, random.Random(f"{seed} {name} {number}"))


def _case(case: tuple[Path, int, str, int]) -> tuple[str, str, float, float]:
    """Outcome, reason, seconds and MiB of one case, in a folder of this process."""
    folder, number, name, seed = case
    own = folder / f"process{os.getpid()}"
    if not own.is_dir():
        own.mkdir()
        for beside in ("beam.op4", "beam.bdf", "part.yaml"):
            (own / beside).write_bytes((folder / beside).read_bytes())
    path = own / name
    path.write_bytes(_content(_GOOD[name], seed, name, number))
    outcome, text, seconds, mib = _in_a_process(lambda: _use(path))
    if seconds > SECONDS:
        outcome, text = "failed", f"more than {SECONDS:g} s: {text}"
    return outcome, text, seconds, mib


def _count(row: Row, outcome: str, text: str, seconds: float, mib: float) -> None:
    row.cases += 1
    row.slowest, row.most_mib = max(row.slowest, seconds), max(row.most_mib, mib)
    setattr(row, outcome, getattr(row, outcome) + 1)
    if outcome == "failed":
        row.reasons[text] += 1


def _use(path: Path) -> tuple[str, str]:
    """Do everything with a file that commands do."""
    # Only warnings of numbers count: libraries may warn of odd files.
    warnings.simplefilter("ignore")
    warnings.simplefilter("error", RuntimeWarning)
    refused = False
    for action in actions(path):
        try:
            with contextlib.redirect_stdout(io.StringIO()) as printed:
                action()
        except CmsReduceError as error:
            refused = True
            if _of_memory(error):
                return "failed", f"out of memory: {_place(error)}"
            if not str(error) or len(str(error)) > 5000:
                return "failed", f"a message of {len(str(error))} characters: {_place(error)}"
        except BaseException as error:
            return "failed", f"{type(error).__name__}: {str(error)[:100]} | {_place(error)}"
        if printed.getvalue():
            return "failed", f"it prints {printed.getvalue()[:60]!r}"
    return ("refused" if refused else "read"), ""


def _of_memory(error: BaseException | None) -> bool:
    while error is not None:
        if isinstance(error, MemoryError):
            return True
        error = error.__cause__ or error.__context__
    return False


def _place(error: BaseException) -> str:
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if "cmsreduce/" in frame.filename]
    last = traceback.extract_tb(error.__traceback__)[-1]
    named = [*(frames[-1:] if frames and frames[-1] is not last else []), last]
    return " > ".join(f"{Path(frame.filename).name}:{frame.lineno} {frame.name}" for frame in named)


def _in_a_process(work: Callable[[], tuple[str, str]]) -> tuple[str, str, float, float]:
    """Outcome of work in a forked process with limits, its seconds of a processor and its peak memory in MiB."""
    reading, writing = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.close(reading)
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, 2)
        try:
            os.write(writing, pickle.dumps(work()))
        finally:
            os._exit(0)
    os.close(writing)
    ready, _, _ = select.select([reading], [], [], WAITING * SECONDS)
    said = os.read(reading, 1 << 16) if ready else b""
    os.close(reading)
    if not ready:
        os.kill(pid, 9)
    _, status, used = os.wait4(pid, 0)
    outcome = pickle.loads(said) if said else ("failed", "no end" if not ready else f"the process died: {status}")
    return *outcome, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024


def _print(rows: dict[str, Row]) -> None:
    out = sys.stdout.write
    out("| file | cases | read | refused | failed | slowest, s | most memory, MiB |\n|---|---|---|---|---|---|---|\n")
    for name, row in rows.items():
        out(f"| {name} | {row.cases} | {row.read} | {row.refused} | {row.failed} | {row.slowest:.2f} |")
        out(f" {row.most_mib:.0f} |\n")
    every = rows.values()
    counts = " | ".join(str(sum(getattr(row, key) for row in every)) for key in ("cases", "read", "refused", "failed"))
    out(f"| all | {counts} | {max(row.slowest for row in every):.2f} | {max(row.most_mib for row in every):.0f} |\n")
    for name, row in rows.items():
        for reason, times in row.reasons.most_common():
            out(f"{name}: {times} times {reason}\n")


if __name__ == "__main__":
    main()
