"""A program `cmsreduce` that starts at once: a process that has loaded the libraries forks off one for each call.

``python forked.py SOCKET`` waits for calls; a program made by `write_program` passes on what it is called with, where,
and its streams, and leaves with the exit code of the command.
"""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn

from tests.pipeline.killed import load_libraries

__all__ = ["waiting", "write_program"]

PROGRAM = """\
#!{python} -IS
import json, os, socket, sys
with socket.socket(socket.AF_UNIX) as there:
    there.connect({address!r})
    call = json.dumps([sys.argv[1:], os.getcwd(), dict(os.environ)]).encode()
    socket.send_fds(there, [call], [0, 1, 2])
    sys.exit(int(there.recv(8)))
"""
# More than arguments and environment of a call take.
MOST = 2**18


def write_program(path: Path, address: Path) -> None:
    """Write an executable file that has its calls carried out by the process at an address."""
    path.write_text(PROGRAM.format(python=sys.executable, address=str(address)))
    path.chmod(0o755)


@contextmanager
def waiting(address: Path) -> Iterator[None]:
    """A process that waits for calls, for as long as the block lasts; no longer path than a socket may have."""
    root = str(Path(__file__).parents[2])
    program = [sys.executable, __file__, str(address)]
    with subprocess.Popen(program, stdout=subprocess.PIPE, env={**os.environ, "PYTHONPATH": root}) as process:
        assert process.stdout is not None and process.stdout.readline() == b"ready\n"
        try:
            yield
        finally:
            process.kill()


def carry_out(caller: socket.socket, call: bytes, streams: list[int]) -> NoReturn:
    """Be the program that was called."""
    from cmsreduce.cli import main

    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    for number, stream in enumerate(streams):
        os.dup2(stream, number)
    arguments, folder, environment = json.loads(call)
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    code: object = 99
    try:
        main(arguments, prog_name="cmsreduce")
    except SystemExit as left:
        code = left.code or 0
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        caller.sendall(str(code).encode())
        os._exit(0)


if __name__ == "__main__":
    load_libraries()
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(sys.argv[1])
        server.listen()
        sys.stdout.write("ready\n")
        sys.stdout.flush()
        while True:
            caller, _ = server.accept()
            call, streams, *_ = socket.recv_fds(caller, MOST, 3)
            if os.fork() == 0:
                server.close()
                carry_out(caller, call, streams)
            for stream in streams:
                os.close(stream)
            caller.close()
