"""Commands of this program, one after the other, each in a process of its own that starts in milliseconds.

A new interpreter imports for three seconds of processor before a command begins. Here one process per worker imports
once, and is forked for each command. It computes nothing itself, so each command starts from the same state. All end
with the worker.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import os
import runpy
import subprocess
import sys
import tempfile
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

__all__ = ["CommandServer", "Ended", "serve"]

_IMPORTED = ("gcs_autotune.cli", "gcs_autotune.workflow", "gcs_autotune.diagnose", "gcs_autotune.report", "scipy.stats")
"""What most commands need."""


class Ended(NamedTuple):
    """How a command ended: its exit code, or minus the signal that ended it, and what it printed."""

    code: int
    out: bytes
    err: bytes


class CommandServer:
    """The process that runs commands, from the worker's side. It is started by the first command, and again if it was
    killed. A context manager, for a server that does not last as long as this process.
    """

    def __init__(self) -> None:
        self._turn = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> CommandServer:
        return self

    def __exit__(self, *_: object) -> None:
        self._end()

    def _end(self) -> None:
        if self._process is not None:
            self._process.communicate()  # its standard input ends, and with it the process
            self._process = None

    def run(self, line: Sequence[str]) -> Ended:
        """Run ``gcs-autotune`` with the arguments *line*, after the commands that are waiting."""
        with self._turn, tempfile.TemporaryDirectory() as name:
            out, err = Path(name) / "out", Path(name) / "err"
            server = self._started()
            assert server.stdin is not None
            assert server.stdout is not None
            code = b""
            with contextlib.suppress(BrokenPipeError):
                server.stdin.write(json.dumps([str(out), str(err), *line]).encode() + b"\n")
                server.stdin.flush()
                code = server.stdout.readline()
            if not code:  # it was killed, and with it the command
                self._end()
                return Ended(-abs(server.returncode) or -1, b"", b"")
            return Ended(int(code), out.read_bytes(), err.read_bytes())

    def _started(self) -> subprocess.Popen[bytes]:
        if self._process is None or self._process.poll() is not None:
            environment = {**os.environ, "GCS_AUTOTUNE_CONFIG": "none", "OPENBLAS_NUM_THREADS": "1"}
            self._process = subprocess.Popen(
                [sys.executable, "-c", f"from {__name__} import serve; serve()"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env=environment,
            )
        return self._process


def serve() -> None:
    """Run the commands that standard input contains, until it ends."""
    answers = os.dup(1)
    os.dup2(2, 1)  # what an import prints must not pass for an answer
    if hasattr(os, "fork"):
        for module in _IMPORTED:
            importlib.import_module(module)
    while request := _next_request():
        out, err, *line = json.loads(request)
        if hasattr(os, "fork"):
            child = os.fork()
            if child == 0:
                _become(out, err, line)
            code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        else:
            with Path(out).open("wb") as output, Path(err).open("wb") as errors:
                command = [sys.executable, "-m", "gcs_autotune", *line]
                code = subprocess.run(
                    command, stdin=subprocess.DEVNULL, stdout=output, stderr=errors, check=False
                ).returncode
        with contextlib.suppress(BrokenPipeError):  # the worker was killed: standard input has ended, too
            os.write(answers, b"%d\n" % code)


def _next_request() -> bytes:
    """Return the next line of standard input. Unbuffered: a forked command reads from it too."""
    line = b""
    while not line.endswith(b"\n"):
        byte = os.read(0, 1)
        if not byte:
            return b""
        line += byte
    return line


def _become(out: str, err: str, line: Sequence[str]) -> None:
    """Become the command *line*, which prints into two files. Never returns."""
    code = 1
    try:
        for descriptor, file in ((1, out), (2, err)):
            os.dup2(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), descriptor)
        threading.Thread(target=_end_with_the_worker, daemon=True).start()
        sys.argv = ["gcs-autotune", *line]
        runpy.run_module("gcs_autotune", run_name="__main__")
    except SystemExit as ended:
        code = ended.code if isinstance(ended.code, int) else int(ended.code is not None)
    except BaseException as error:  # noqa: BLE001 - the fork must not return into the server's loop
        sys.stderr.write(f"gcs-autotune: {type(error).__name__}: {error}\n")
    finally:
        with contextlib.suppress(Exception):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)


def _end_with_the_worker() -> None:
    """End this process at once when the worker has ended: only then does standard input end. No command reads it."""
    while os.read(0, 1):
        pass
    os._exit(1)
