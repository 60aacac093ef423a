"""Runs that are killed, disturbed, or short of disk space: the table of benchmarks/faults.md.

After every fault another run must end well and write the same results as an undisturbed run. Faults of disks need a
file system of their own, which only root can mount; otherwise their rows say so.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import h5py
import numpy as np

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "benchmarks" / "faults.md"
PIPELINE = ROOT / "pipelines" / "hub_beams.yaml"
# Settings of the runs in turn, so that a run finds finished stages of another one in its folder.
CUTOFFS = ("20", "10", "15")
_BEGIN, _END = "<!-- table: begin -->", "<!-- table: end -->"
# Keys that differ between equal runs: times, memory, and the seal over them.
_OWN = {"seal", "seconds", "peak_mib", "speed", "solver", "reduce_s", "full_frf_s", "reduced_frf_s", "certificate"}
_SEED = 20


@dataclass(frozen=True)
class Row:
    """One fault, how often it was tried, and what happened."""

    fault: str
    tried: int
    happened: str
    good: bool


def settings(cutoff: str) -> list[str]:
    """Arguments of a run without limits, because a low cutoff would break them."""
    return ["--set", f"reduce.cutoff={cutoff}", "--set", "verify.limits={}"]


def run(folder: Path, cutoff: str = CUTOFFS[0], *before: str) -> subprocess.CompletedProcess[str]:
    """A run in a process of its own."""
    program = [*before, sys.executable, "-m", "cmsreduce.cli", "run", str(PIPELINE), "--out", str(folder), "--quiet"]
    program += settings(cutoff)
    return subprocess.run(program, cwd=ROOT, capture_output=True, text=True, check=False)


def forked(folder: Path, cutoff: str) -> int:
    """Process id of a run that starts at once, because all modules are loaded."""
    child = os.fork()
    if child:
        return child
    quiet = os.open(os.devnull, os.O_WRONLY)
    os.dup2(quiet, 1)
    os.dup2(quiet, 2)
    from cmsreduce.cli import main

    try:
        main(["run", str(PIPELINE), "--out", str(folder), "--quiet", *settings(cutoff)])
    except SystemExit as left:
        os._exit(int(left.code or 0))
    os._exit(99)


def results(folder: Path) -> dict[str, Any]:
    """Results of a run, without times, memory and date."""
    found: dict[str, Any] = {"summary": _untimed(json.loads((folder / "summary.json").read_text()))}
    for path in sorted(folder.glob("*.h5")):
        with h5py.File(path) as file:
            file.visititems(
                lambda name, item, path=path: (
                    found.update({f"{path.name}:{name}": np.asarray(item[()]).tobytes()})
                    if isinstance(item, h5py.Dataset) and "provenance" not in name
                    else None
                )
            )
    return found


def _untimed(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _untimed(item) for key, item in value.items() if key not in _OWN}
    if isinstance(value, list):
        return [_untimed(item) for item in value]
    return value


def torn(folder: Path) -> list[str]:
    """Incomplete files under their final names."""
    bad = []
    for path in folder.rglob("*"):
        if path.is_file() and not path.name.endswith(".tmp"):
            try:
                if path.suffix == ".h5":
                    with h5py.File(path) as file:
                        file.visititems(lambda _, item: item[()] is None if isinstance(item, h5py.Dataset) else None)
                elif path.suffix == ".json":
                    json.loads(path.read_text())
            except (OSError, ValueError, RuntimeError):
                bad.append(path.name)
    return bad


class Trials:
    """Every fault, tried in a folder of its own against what undisturbed runs write."""

    def __init__(self, scratch: Path, count: int) -> None:
        self.scratch, self.count, self.random = scratch, count, random.Random(_SEED)
        self.reference = {}
        for cutoff in CUTOFFS:
            folder = scratch / f"reference-{cutoff}"
            done = run(folder, cutoff)
            if done.returncode:
                raise SystemExit(f"an undisturbed run failed: {done.stderr}")
            self.reference[cutoff] = results(folder)

    def killed(self) -> Row:
        """Runs in one folder, one after the other, each killed at a random moment."""
        for name in ("cmsreduce.pipeline", "pyyeti.nastran", "plotly.graph_objects", "rich.table"):
            import_module(name)
        folder = self.scratch / "killed"
        started = time.perf_counter()
        os.waitpid(forked(folder, CUTOFFS[0]), 0)
        whole_run = time.perf_counter() - started
        shutil.rmtree(folder)
        died = wrong = half = ended = 0
        for number in range(self.count):
            cutoff = self.random.choice(CUTOFFS)
            child = forked(folder, cutoff)
            # Every tenth run is not killed: it must be right beside the remains of the others.
            if number % 10 != 9:
                time.sleep(self.random.uniform(0, 1.1 * whole_run))
                os.kill(child, signal.SIGKILL)
            status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
            half += len(torn(folder))
            if status == 0:
                ended += 1
                wrong += results(folder) != self.reference[cutoff]
            else:
                died += 1
                wrong += status != -signal.SIGKILL
        good = not wrong and not half
        said = f"{died} died, {ended} came to their end; {half} torn files, {wrong} wrong results"
        return Row(
            "`kill -9` at a random moment, 500 runs in one folder with changing settings", self.count, said, good
        )

    def together(self) -> Row:
        """Two runs on one folder at the same time."""
        tried, wrong = 5, 0
        for number in range(tried):
            folder = self.scratch / f"together-{number}"
            pair = [forked(folder, cutoff) for cutoff in CUTOFFS[:2]]
            codes = [os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) for child in pair]
            # The results must be those of one run, not of both mixed.
            wrong += codes != [0, 0] or results(folder) not in [self.reference[c] for c in CUTOFFS[:2]]
        said = f"the second waits for the first, both exit with 0; {wrong} mixed results"
        return Row("two runs with different settings on one output folder at once", tried, said, not wrong)

    def corrupted(self) -> Row:
        """Finished stages with bytes changed or cut off."""
        folder, tried, wrong, noticed = self.scratch / "corrupted", 0, 0, 0
        run(folder)
        for path in sorted((folder / "stages").glob("*.h5")):
            for _ in range(4):
                content = bytearray(path.read_bytes())
                if self.random.random() < 0.5:
                    content = content[: self.random.randrange(len(content))]
                else:
                    at = self.random.randrange(len(content) - 16)
                    content[at : at + 16] = self.random.randbytes(16)
                path.write_bytes(content)
                done = run(folder)
                tried += 1
                noticed += "is damaged and is made again" in (folder / "summary.json").read_text() + done.stderr
                wrong += done.returncode != 0 or results(folder) != self.reference[CUTOFFS[0]]
        said = f"made again, or the change lay in unused bytes; exit code 0, {wrong} wrong results"
        return Row("a finished stage cut short, or 16 bytes of it overwritten", tried, said, not wrong)

    def truncated(self) -> Row:
        """Component files cut short, and the commands that read them."""
        folder = self.scratch / "truncated"
        run(folder)
        whole, bad, tried, wrong = folder / "right.h5", folder / "cut.h5", 0, []
        content = whole.read_bytes()
        for share in (0, 0.001, 0.1, 0.5, 0.9, 0.999):
            bad.write_bytes(content[: int(share * len(content))])
            for verb in (["check"], ["inspect"], ["convert", "--format", "exudyn"]):
                target = [str(folder / "cut.npz")] if verb[0] == "convert" else []
                program = [sys.executable, "-m", "cmsreduce.cli", verb[0], str(bad), *target, *verb[1:]]
                done = subprocess.run(program, cwd=ROOT, capture_output=True, text=True, check=False)
                tried += 1
                if done.returncode != 2 or "Traceback" in done.stderr or str(bad) not in done.stderr:
                    wrong.append(f"{verb[0]} of {share}: {done.returncode} {done.stderr[-200:]}")
        said = f"exit code 2, one message that names the file; {len(wrong)} others{': ' + wrong[0] if wrong else ''}"
        return Row("a component file cut short: `check`, `inspect`, `convert`", tried, said, not wrong)

    def other_clock(self) -> Row:
        """A clock that jumps between runs, and files from the future."""
        folder, tried, wrong = self.scratch / "clock", 0, 0
        fake = shutil.which("faketime")
        moments = ("2001-02-03 04:05:06", "2038-01-20 00:00:00", "1970-01-02 00:00:00")
        for moment in moments:
            before = (fake, moment) if fake else ()
            wrong += run(folder, CUTOFFS[0], *before).returncode != 0
            wrong += results(folder) != self.reference[CUTOFFS[0]]
            stamp = time.mktime(time.strptime(moment, "%Y-%m-%d %H:%M:%S"))
            for path in folder.rglob("*"):
                os.utime(path, (stamp, stamp))
            wrong += run(folder, CUTOFFS[1], *before).returncode != 0
            wrong += results(folder) != self.reference[CUTOFFS[1]]
            tried += 2
        how = "the clock set by faketime, and time stamps of all files" if fake else "time stamps of all files"
        return Row(f"{how} in 1970, 2001 and 2038", tried, f"exit code 0, {wrong} wrong results", not wrong)

    def full_disk(self) -> Row:
        """Disks with too little room, and then with enough."""
        fault, tried, wrong = "a disk that is full after so many KiB, then enlarged", 0, []
        for size in (8, 64, 100, 150, 300, 400, 1000, 2000):
            with mounted(self.scratch / f"disk-{size}", f"size={size}k") as folder:
                if folder is None:
                    return Row(fault, 0, "not tried: mounting needs root", True)
                tried += 1
                done = run(folder / "out")
                if done.returncode != 2 or "cannot be written" not in done.stderr or "Traceback" in done.stderr:
                    wrong.append(f"{size} KiB: {done.returncode} {done.stderr[-200:]}")
                if torn(folder):
                    wrong.append(f"{size} KiB: torn {torn(folder)}")
                subprocess.run(["mount", "-o", "remount,size=64m", str(folder)], check=True)
                if run(folder / "out").returncode or results(folder / "out") != self.reference[CUTOFFS[0]]:
                    wrong.append(f"{size} KiB: the next run is wrong")
        said = f"exit code 2 and the file that could not be written; the next run is right; {len(wrong)} others"
        return Row(fault, tried, said + (": " + wrong[0] if wrong else ""), not wrong)

    def read_only(self) -> Row:
        """An output folder that cannot be written."""
        fault = "an output folder that is read-only, empty or with an earlier run, then writable"
        with mounted(self.scratch / "read-only", "size=64m") as folder:
            if folder is None:
                return Row(fault, 0, "not tried: mounting needs root", True)
            wrong = []
            for number, cutoff in enumerate(CUTOFFS[:2]):
                subprocess.run(["mount", "-o", "remount,ro", str(folder)], check=True)
                done = run(folder / "out", cutoff)
                if done.returncode != 2 or "cannot be written" not in done.stderr:
                    wrong.append(f"{done.returncode} {done.stderr[-200:]}")
                if number and results(folder / "out") != self.reference[CUTOFFS[0]]:
                    wrong.append("the earlier results are gone")
                subprocess.run(["mount", "-o", "remount,rw", str(folder)], check=True)
                if run(folder / "out", cutoff).returncode or results(folder / "out") != self.reference[cutoff]:
                    wrong.append("the next run is wrong")
        said = f"exit code 2, earlier results untouched, the next run is right; {len(wrong)} others"
        return Row(fault, 2, said + (": " + wrong[0] if wrong else ""), not wrong)


@contextmanager
def mounted(folder: Path, options: str) -> Iterator[Path | None]:
    """Mount a file system in memory; None if the mount fails."""
    folder.mkdir()
    done = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(folder)], capture_output=True, check=False
    )
    try:
        yield None if done.returncode else folder
    finally:
        if not done.returncode:
            subprocess.run(["umount", str(folder)], check=True)


def table(rows: list[Row]) -> str:
    """The rows in Markdown."""
    lines = ["| what was done | times | what happened | |", "|---|---|---|---|"]
    lines += [f"| {row.fault} | {row.tried} | {row.happened} | {'good' if row.good else '**bad**'} |" for row in rows]
    return "\n".join(lines)


def main() -> None:
    """Try everything and print, or write, the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=500, help="runs that are killed")
    parser.add_argument("--write", action="store_true", help=f"put the table into {PAGE.relative_to(ROOT)}")
    parser.add_argument("--only", nargs="*", help="faults to try, by name")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        trials = Trials(Path(scratch), arguments.runs)
        every: dict[str, Callable[[], Row]] = {
            name: getattr(trials, name)
            for name in ("killed", "together", "corrupted", "truncated", "other_clock", "full_disk", "read_only")
        }
        rows = []
        for name in arguments.only or every:
            rows.append(every[name]())
            print(f"{name}: {rows[-1]}", file=sys.stderr, flush=True)
    text = table(rows)
    print(text)
    if arguments.write:
        page = PAGE.read_text(encoding="utf-8")
        before, rest = page.split(_BEGIN)
        PAGE.write_text(f"{before}{_BEGIN}\n{text}\n{_END}{rest.split(_END)[1]}", encoding="utf-8")
    if not all(row.good for row in rows):
        raise SystemExit(1)


if __name__ == "__main__":
    main()
