"""Exit codes of the program: faults, narrow locales, closed streams, little memory; of its own process where needed."""

from __future__ import annotations

import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from cmsreduce.cli import main
from cmsreduce.cli.__main__ import start

ROOT = Path(__file__).parents[2]
# Patched into the program: reducing meets a fault that nobody foresaw.
BROKEN = """\
import sys
import cmsreduce.pipeline.run.bodies as it
def fail(*args, **named):
    raise {error}
it.orthogonalise = fail
from cmsreduce.cli import main
main(sys.argv[1:], prog_name="cmsreduce")
"""


# Starts once, and forks for each call; a call ends as the program does, with what it still has to write. It looks for
# no garbage among the libraries, which took a third of its time.
SEVERAL = """\
import gc, json, os, sys
from cmsreduce.cli import main
import cmsreduce.pipeline, cmsreduce.report
gc.freeze()
calls, codes = json.loads(sys.argv[1]), []
for sys.argv[1:] in calls:
    child = os.fork()
    if not child:
        main()
    codes.append(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
os.write(int(os.environ["CODES"]), json.dumps(codes).encode())
"""


def program(*args: object, code: str = "from cmsreduce.cli import main; main()", **more) -> subprocess.CompletedProcess:
    environment = {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    environment |= {key: os.environ[key] for key in ("PATH", "HOME") if key in os.environ} | more.pop("env", {})
    streams = {name: more.pop(name, subprocess.PIPE) for name in ("stdout", "stderr")}
    # As in the installed program, the present folder is not searched for modules: where it is gone, Python 3.13 stops.
    command = [sys.executable, "-P", "-c", code, *map(str, args)]
    return subprocess.run(command, env=environment, timeout=120, check=False, **streams, **more)


def programs(*calls: tuple[object, ...], **more) -> tuple[list[int], subprocess.CompletedProcess]:
    """Exit codes of several calls of one program, whose streams they share."""
    reader, writer = os.pipe()
    try:
        environment = {**more.pop("env", {}), "CODES": str(writer)}
        given = json.dumps([[str(arg) for arg in call] for call in calls], ensure_ascii=False)
        done = program(given, code=SEVERAL, env=environment, pass_fds=(writer,), **more)
    finally:
        os.close(writer)
    with os.fdopen(reader) as codes:
        return json.loads(codes.read() or "[]"), done


def called(*args: object) -> Result:
    """The program in this process: what it prints and the code that it leaves with."""
    done = CliRunner().invoke(main, [str(arg) for arg in args])
    assert isinstance(done.exception, SystemExit | None), done.exception
    return done


@pytest.fixture(scope="module")
def study(finished_study: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The good study, run."""
    folder = tmp_path_factory.mktemp("ended") / "study"
    shutil.copytree(finished_study, folder)
    path = folder / "study.yaml"
    path.write_text(path.read_text().replace(str(finished_study), str(folder)))
    done = called("run", path)
    assert done.exit_code == 0, done.output
    return path


def test_a_fault_exits_with_70_and_a_crash_file(study: Path, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    done = program(
        "run", study, "--out", folder, "--json", code=BROKEN.format(error="ZeroDivisionError('odd')"), cwd=tmp_path
    )
    said = done.stderr.decode()
    assert done.returncode == 70 and "Traceback" not in said and "internal error: ZeroDivisionError: odd" in said
    found = json.loads(done.stdout)["error"]
    (crash,) = folder.glob("crash-*.txt")
    assert (found["code"], found["kind"], found["crash_file"]) == (70, "ZeroDivisionError", str(crash))
    text = crash.read_text()
    assert all(word in text for word in ("command: ", "numpy: ", "platform: ", "Traceback", "ZeroDivisionError: odd"))
    assert str(crash) in said and [path.name for path in tmp_path.iterdir()] == ["run"]


def test_without_a_run_directory_the_crash_file_is_among_temporary_files(study: Path, tmp_path: Path) -> None:
    (tmp_path / "t").mkdir()
    code = "import cmsreduce.config as it\ndef fail(): raise KeyError('x')\nit.json_schema = fail\n"
    done = program("schema", code=code + "from cmsreduce.cli import main; main()", env={"TMPDIR": str(tmp_path / "t")})
    assert done.returncode == 70 and len(list((tmp_path / "t").glob("crash-*.txt"))) == 1


@pytest.mark.parametrize(
    ("error", "code"),
    [(MemoryError(), 2), (OSError(12, "Cannot allocate memory"), 2), (KeyboardInterrupt(), 130)],
)
def test_what_is_no_fault_leaves_no_crash_file(
    study: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException, code: int
) -> None:
    def fail(*args: object, **named: object) -> None:
        raise error

    monkeypatch.setattr("cmsreduce.pipeline.run.bodies.orthogonalise", fail)
    monkeypatch.chdir(tmp_path)
    done = called("run", study, "--out", tmp_path / "o", "--json")
    said = done.stderr
    assert done.exit_code == code and "Traceback" not in said, said
    assert json.loads(done.stdout)["error"]["code"] == code
    assert not list(tmp_path.rglob("crash-*"))


INTERRUPTED = """\
import os, runpy, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
class Interrupt:
    def find_spec(self, name, *more):
        if name == "{module}":
            os.kill(os.getpid(), signal.SIGINT)
{at_end}
sys.meta_path.insert(0, Interrupt())
runpy.run_module("cmsreduce.cli", run_name="__main__", alter_sys=True)
"""


@pytest.mark.parametrize(
    ("module", "at_end"),
    [("click", ""), ("cmsreduce.cli.household", ""), ("", "import atexit; atexit.register(os.kill, os.getpid(), 2)")],
    ids=["while click loads", "while the commands load", "after the command"],
)
def test_ctrl_c_before_and_after_the_command_has_no_traceback(module: str, at_end: str) -> None:
    done = program("completion", "bash", code=INTERRUPTED.format(module=module, at_end=at_end))
    assert done.returncode == -signal.SIGINT and done.stderr == b""
    # The output of a command that has ended is whole.
    assert (b"complete" in done.stdout) == bool(at_end)


def test_a_present_folder_that_was_removed_ends_no_run(study: Path, tmp_path: Path) -> None:
    """MKL ended the process there, with a message of its own."""
    gone = tmp_path / "gone"
    gone.mkdir()
    code = "import os; os.rmdir(os.getcwd()); from cmsreduce.cli import main; main()"
    done = program("run", study, "--out", tmp_path / "out", "--quiet", code=code, cwd=gone)
    assert (done.returncode, done.stderr) == (0, b"") and (tmp_path / "out" / "summary.json").is_file()


def test_the_program_has_one_start() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert project["project"]["scripts"] == {"cmsreduce": f"{start.__module__}:{start.__name__}"}


@pytest.mark.parametrize(
    "args", [("run", "none.yaml"), ("check", "nowhere"), ("run", "x", "--only", "y"), ("check", "--wrong")]
)
def test_bad_input_with_json_is_json(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, args: tuple[str, ...]) -> None:
    monkeypatch.chdir(tmp_path)
    done = called(*args, "--json")
    assert done.exit_code == 2 and json.loads(done.stdout)["error"]["code"] == 2, done.output


@pytest.mark.parametrize(
    ("locale", "finished"),
    [
        # Of the streams alone: what stages write does not depend on it.
        ({"PYTHONIOENCODING": "ascii"}, True),
        ({"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"}, False),
    ],
)
def test_a_narrow_locale_loses_letters_and_no_run(
    study: Path, tmp_path: Path, locale: dict[str, str], finished: bool
) -> None:
    path = study.parent / "prüfung.yaml"
    path.write_text(study.read_text(encoding="utf-8"), encoding="utf-8")
    out = tmp_path / "ausgabe-ü"
    if finished:
        shutil.copytree(study.parent / "out" / "stages", out / "stages")
    run = ("run", path, "--out", out, "--log-file", tmp_path / "log")
    codes, done = programs(run, ("report", out), ("check", out), ("inspect", out), ("cache", "ls", out), env=locale)
    assert codes == [0] * 5, done.stderr
    assert b"study: PASS; 5 files in " in done.stdout and b"left out" not in done.stdout
    assert "study: PASS" in (tmp_path / "log").read_text(encoding="utf-8")


def test_a_reader_that_leaves_changes_no_exit_code(study: Path) -> None:
    """The pipe is closed before anything is written, as by `| head -0`; so is that of the progress."""
    reader, writer = os.pipe()
    os.close(reader)
    calls = (("run", study), ("check", study.parent / "out"), ("schema",), ("inspect", study))
    try:
        codes, _ = programs(*calls, stdout=writer, stderr=writer)
    finally:
        os.close(writer)
    assert codes == [0, 0, 0, 0]


@pytest.mark.parametrize("closed", [(1,), (2,), (0, 1, 2)])
def test_closed_streams_change_no_exit_code(study: Path, closed: tuple[int, ...]) -> None:
    def close() -> None:
        for number in closed:
            os.close(number)

    streams = {"stdout": None, "stderr": None} if closed != (1,) else {"stdout": None}
    out = study.parent / "out"
    calls = (("run", study), ("check", out), ("check", out, "--json"), ("check", "none"))
    assert programs(*calls, preexec_fn=close, **streams)[0] == [0, 0, 0, 2]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full here")
def test_a_full_disk_behind_the_output_is_said() -> None:
    with Path("/dev/full").open("w") as full:
        done = program("schema", stdout=full)
    assert done.returncode == 2 and b"No space left" in done.stderr and b"Traceback" not in done.stderr


def test_a_full_disk_under_the_log_is_said_and_stops_nothing(study: Path, tmp_path: Path) -> None:
    """A file that may not grow is as a disk that is full; bad input is said before the log that lacks it."""
    log = tmp_path / "check.log"
    size, most = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, most))
    try:
        checked, bad = (called("check", folder, "--log-file", log) for folder in (study.parent / "out", "none"))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, most))
    assert [checked.exit_code, bad.exit_code] == [2, 2] and " checks passed; " in checked.stdout
    incomplete, missing = (*checked.stderr.splitlines(), *bad.stderr.splitlines())
    assert incomplete.startswith(f"error: --log-file {log}: the log is not complete: File too large; the command did")
    assert missing.startswith("error: none: ")


@pytest.mark.parametrize("megabytes", [250, 400, 700])
def test_little_memory_ends_with_a_code(study: Path, tmp_path: Path, megabytes: int) -> None:
    """Some limits are enough; with others a part is left out, by name, or one message ends the run."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (megabytes * 2**20, megabytes * 2**20))

    done = program("run", study, "--out", tmp_path / "o", preexec_fn=limit)
    said = done.stderr.decode(errors="replace")
    assert done.returncode in (0, 1, 2) and "Traceback" not in said, (done.returncode, said)
    if done.returncode == 1:
        failures = json.loads((tmp_path / "o/summary.json").read_text())["failures"]
        shown = said + done.stdout.decode(errors="replace")
        assert failures and failures[0]["what"] in shown, shown
        assert all(each["what"] in shown for each in failures) or "more notes in the report" in shown, shown
    assert done.returncode != 2 or (said.count("error: ") == 1 and "memory" in said), said


def test_one_verdict_for_run_and_check(study: Path, tmp_path: Path) -> None:
    for limit, code in (("0.05", 0), ("1e-9", 1)):
        out = tmp_path / limit
        assert called("run", study, "--out", out, "--set", f"verify.limits.frf_error={limit}").exit_code == code
        assert called("check", out).exit_code == code
        assert json.loads((out / "summary.json").read_text())["passed"] is (code == 0)
