"""Under a file's name stands the old file or the new one, whatever happens in between."""

import multiprocessing
import os
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import h5py
import pytest

from cmsreduce.errors import WriteError
from cmsreduce.write import atomic_path, hdf5_file

ENDLESS = """
import sys, time
from pathlib import Path
from cmsreduce.write import atomic_path
with atomic_path(Path(sys.argv[1])) as temporary:
    temporary.write_text("half")
    print("ready", flush=True)
    time.sleep(60)
"""


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.fixture
def writer():
    """Start processes that write half a file and wait; none outlives the test."""
    started = []

    def start(path: Path) -> subprocess.Popen:
        child = subprocess.Popen([sys.executable, "-c", ENDLESS, str(path)], stdout=subprocess.PIPE)
        started.append(child)
        assert child.stdout.readline() == b"ready\n"
        return child

    yield start
    for child in started:
        child.kill()
        child.wait()
        child.stdout.close()


def test_a_file_appears_whole_in_folders_that_are_made(tmp_path):
    path = tmp_path / "a" / "b" / "result.txt"
    with atomic_path(path) as temporary:
        assert temporary.parent == path.parent
        assert temporary.name.startswith(".")
        temporary.write_text("whole")
        assert not path.exists()
    assert names(path.parent) == ["result.txt"]
    assert path.read_text() == "whole"


def test_an_error_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "result.txt"
    path.write_text("old")
    with pytest.raises(ZeroDivisionError), atomic_path(path) as temporary:
        temporary.write_text("half")
        raise ZeroDivisionError
    assert names(tmp_path) == ["result.txt"]
    assert path.read_text() == "old"


@pytest.mark.parametrize("old", [None, "old"])
def test_a_killed_writer_leaves_no_half_file(tmp_path, writer, old):
    path = tmp_path / "result [1].txt"
    if old:
        path.write_text(old)
    child = writer(path)
    child.send_signal(signal.SIGKILL)
    child.wait()
    assert len(names(tmp_path)) == 1 + bool(old)
    assert (path.read_text() if path.exists() else None) == old
    with atomic_path(path) as temporary:
        temporary.write_text("whole")
    assert names(tmp_path) == [path.name]
    assert path.read_text() == "whole"


def test_what_a_living_process_or_another_machine_writes_is_left_alone(tmp_path, writer):
    path = tmp_path / "result.txt"
    writer(path)
    elsewhere = tmp_path / ".result.txt.0badcafe-1-00000000.tmp"
    elsewhere.write_text("half")
    other = tmp_path / ".result.txt.mine.tmp"
    other.write_text("not ours")
    before = set(names(tmp_path))
    with atomic_path(path) as temporary:
        temporary.write_text("whole")
    assert set(names(tmp_path)) == before | {"result.txt"}


def test_writers_of_one_file_do_not_meet(tmp_path):
    path = tmp_path / "result.txt"

    def write(text: str) -> None:
        with atomic_path(path) as temporary:
            temporary.write_text(text)

    whole = [letter * 10_000 for letter in "abcdefgh"]
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(write, whole))
    assert path.read_text() in whole
    assert names(tmp_path) == ["result.txt"]


def test_a_file_that_another_writer_makes_between_two_looks_is_no_device(tmp_path, monkeypatch):
    path, look = tmp_path / "result.txt", Path.is_file

    def made_after(self: Path) -> bool:
        found = look(self)
        path.touch()
        return found

    monkeypatch.setattr(Path, "is_file", made_after)
    with atomic_path(path) as temporary:
        temporary.write_text("whole")
    assert path.read_text() == "whole"


def test_a_folder_that_cannot_be_made_is_said_clearly(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(WriteError, match=r"x\.json cannot be written"), atomic_path(tmp_path / "file" / "x.json"):
        pass


def test_a_folder_in_the_place_of_the_file(tmp_path):
    (tmp_path / "x.json" / "inside").mkdir(parents=True)
    with pytest.raises(WriteError, match=r"x\.json cannot be written"), atomic_path(tmp_path / "x.json") as temporary:
        temporary.write_text("{}")
    assert names(tmp_path) == ["x.json"]


def test_a_pipe_in_the_place_of_the_file_stays(tmp_path):
    """A rename over it would remove it; so it would /dev/null, for all programs, where the superuser runs this."""
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", Path("/dev/null"), Path("/dev/stdout")):
        with pytest.raises(WriteError, match="it is a device or a pipe"), atomic_path(path):
            raise AssertionError("a file would be written")
    assert (tmp_path / "pipe").is_fifo()


def _write_as_nobody(path: Path, answers) -> None:
    if os.geteuid() == 0:
        # Nothing is read-only to the superuser.
        os.setuid(65534)
    try:
        with atomic_path(path) as temporary:
            temporary.write_text("{}")
    except WriteError as error:
        answers.put(str(error))
    else:
        answers.put("written")


def test_a_read_only_folder_is_said_clearly(tmp_path):
    tmp_path.chmod(0o500)
    context = multiprocessing.get_context("fork")
    answers = context.Queue()
    child = context.Process(target=_write_as_nobody, args=(tmp_path / "x.json", answers))
    child.start()
    try:
        assert "Permission denied" in answers.get(timeout=60)
        child.join()
        assert names(tmp_path) == []
    finally:
        tmp_path.chmod(0o700)


def _write_beyond(path: Path, limit: int, answers) -> None:
    import resource

    from cmsreduce.write import write_system
    from tests.write.test_system_file import pendulum

    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
    try:
        write_system(path, [pendulum()], provenance={"notes": ["n" * 100 for _ in range(5)]})
    except WriteError as error:
        answers.put(str(error))
    else:
        answers.put("written")


@pytest.mark.skipif(sys.platform == "win32", reason="file sizes are limited by POSIX only")
@pytest.mark.parametrize(("limit", "says"), [(10**6, "written"), (2000, "cannot be written: File too large")])
def test_a_disk_that_is_full_is_said_clearly(tmp_path, limit, says):
    context = multiprocessing.get_context("spawn")
    answers = context.Queue()
    child = context.Process(target=_write_beyond, args=(tmp_path / "system.h5", limit, answers))
    child.start()
    assert says in answers.get(timeout=60)
    child.join()
    assert names(tmp_path) == (["system.h5"] if says == "written" else [])


def test_two_hdf5_files_of_one_name_at_once(tmp_path):
    """Runs in threads write stages of equal names into their folders."""
    with hdf5_file(tmp_path / "a" / "x.h5") as one, hdf5_file(tmp_path / "b" / "x.h5") as other:
        one["K"], other["K"] = [1.0], [2.0]
    for folder, value in (("a", 1.0), ("b", 2.0)):
        with h5py.File(tmp_path / folder / "x.h5") as file:
            assert file["K"][0] == value
