"""Run a pipeline again and again, each run killed while it writes a file, and say what each has left.

``python killed.py PIPELINE NUMBER...``: one run for each number, which kills itself at so many files that it writes,
when the file is whole under a temporary name but has not its own yet; 0 lets the run finish. One line of JSON for each.

``python killed.py``: for each line ``[MOMENT, PIPELINE, OPTION...]`` one run, which is killed as it tells of the
moment. The answer is its status.
"""

from __future__ import annotations

import gc
import json
import os
import signal
import sys
from importlib import import_module
from pathlib import Path

import h5py

from cmsreduce.cli import main
from cmsreduce.config import load_pipeline
from cmsreduce.write import read_component

# Loaded before the runs fork, so that every one of them starts at once.
LIBRARIES = ("cmsreduce.pipeline", "pyyeti.nastran", "plotly.graph_objects", "rich.table")


def load_libraries() -> None:
    """Load what a run needs, before runs are forked off; they look for no garbage among it."""
    for library in LIBRARIES:
        import_module(library)
    gc.freeze()


def killed_at(number: int, path: Path) -> int:
    """Status of a run that is killed while it writes the file of that number; the run forks, so starts at once."""
    child = os.fork()
    if child:
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    rename, written = os.replace, 0

    def count(*names: os.PathLike[str]) -> None:
        nonlocal written
        written += 1
        if written == number:
            os.kill(os.getpid(), signal.SIGKILL)
        rename(*names)

    os.replace = count
    try:
        # One body after the other, so that files come in a known order.
        main(["run", str(path), "--quiet", "--set", "solver.threads=1"])
    except SystemExit as left:
        os._exit(int(left.code or 0))
    os._exit(99)


def killed_when(moment: str, path: str, *options: str) -> int:
    """Status of a run that is killed as it tells of a moment."""
    said, tells = os.pipe()
    child = os.fork()
    if not child:
        os.dup2(tells, 2)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        os.close(said)
        try:
            main(["run", path, "--verbose", *options])
        except SystemExit as left:
            os._exit(int(left.code or 0))
        os._exit(99)
    os.close(tells)
    with os.fdopen(said) as lines:
        if any(moment in line for line in lines):
            os.kill(child, signal.SIGKILL)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def left_behind(folder: Path) -> dict[str, list[str]]:
    """Files under their own names, all of them whole, and temporary ones."""
    whole, temporary = [], []
    for file in sorted(item for item in folder.rglob("*") if item.is_file()):
        name = str(file.relative_to(folder))
        if name.endswith(".tmp"):
            temporary.append(name)
            continue
        # The claim of a process that was killed ended with it; the next claim of the entry removes the file.
        if name.endswith(".lock"):
            continue
        whole.append(name)
        if file.suffix == ".json":
            json.loads(file.read_text())
        elif file.suffix == ".html":
            assert file.read_text().rstrip().endswith("</html>")
        elif file.parent.name != "stages" and file.name != "system.h5":
            read_component(file)
        else:
            with h5py.File(file) as opened:
                # Reading checks the checksum of every dataset.
                opened.visititems(lambda _, item: item[()] if isinstance(item, h5py.Dataset) else None)
    return {"whole": whole, "temporary": temporary}


def files_one_by_one(pipeline: Path, numbers: list[int]) -> None:
    """Runs that are killed while they write files."""
    out = load_pipeline(pipeline).output
    for number in numbers:
        status = killed_at(number, pipeline)
        left = left_behind(out) if out.is_dir() else {}
        sys.stdout.write(json.dumps({"status": status, **left}) + "\n")
        # The next run forks with what is not written yet, and may write it, too.
        sys.stdout.flush()


if __name__ == "__main__":
    load_libraries()
    if sys.argv[1:]:
        files_one_by_one(Path(sys.argv[1]), [int(number) for number in sys.argv[2:]])
    for call in sys.stdin if not sys.argv[1:] else ():
        sys.stdout.write(f"{killed_when(*json.loads(call))}\n")
        sys.stdout.flush()
