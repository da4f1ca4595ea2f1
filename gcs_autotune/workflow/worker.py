"""A process of its own for the computing of a run, so that the loop that holds the sticks never waits for it.

A thread would not do: what computes in Python and NumPy lets go of the interpreter only now and then, and the overrides
pause meanwhile. The process is started ahead, gets work and gives answers by pipe (pickled), and ends as soon as the
pipe closes, however this program ends. It has a session of its own: Ctrl-C at the terminal is not for it.
"""

from __future__ import annotations

import os
import pickle
import queue
import subprocess
import sys
import traceback
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from threading import Thread
from types import TracebackType
from typing import Any, BinaryIO, Self

from gcs_autotune.errors import AutotuneError

__all__ = ["Worker", "serve"]

_COMMAND = "from gcs_autotune.workflow.worker import serve; serve()"
_POLITE = 5
"""Chosen: niceness; the loop that holds the sticks, and the simulator beside it, come first."""
_GRACE = 5.0
"""Chosen: seconds that an ended process may take to be gone."""


class Worker:
    """One piece of work at a time, done elsewhere.

    Parameters
    ----------
    apart : whether in a process of its own; else the work is done at once, where it is asked for: in simulated time
        nothing waits for us.
    """

    def __init__(self, *, apart: bool = True) -> None:
        self.apart = apart
        self._process: subprocess.Popen[bytes] | None = None
        self._job: _Job | None = None
        self._abandoned = False
        if apart:
            self._start()

    def begin(self, work: Callable[[], Any]) -> None:
        """Have *work* done; everything it refers to, and its answer, must be what ``pickle`` takes."""
        if self._process is not None and (self._abandoned or self._process.poll() is not None):
            self._end()
        if self.apart and self._process is None:
            self._start()
        self._job = _Job(self._process, work)

    @property
    def done(self) -> bool:
        """Whether the work begun last is done."""
        return self._job is not None and self._job.done

    def result(self) -> Any:
        """Return what it came to, when :attr:`done`; what it raised is raised here.

        Raises
        ------
        AutotuneError
            The process has ended in the midst of it.
        """
        assert self._job is not None
        job, self._job = self._job, None
        return job.result()

    def abandon(self) -> None:
        """Nobody wants the answer any more."""
        if self._job is not None and not self._job.done and self._process is not None:
            self._process.kill()
            self._abandoned = True

    def close(self) -> None:
        """End the process, at work or not. Closing twice does nothing."""
        self.apart = False
        self._end()

    def _start(self) -> None:
        here = os.pathsep.join(str(Path(entry).absolute()) for entry in sys.path)
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", _COMMAND],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": here},
            start_new_session=True,
            creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
        )

    def _end(self) -> None:
        process, self._process, self._abandoned = self._process, None, False
        if process is None:
            return
        process.kill()
        process.wait(_GRACE)
        if self._job is not None:
            self._job.join(_GRACE)
        for pipe in (process.stdin, process.stdout):
            with suppress(OSError):  # what was not sent any more
                assert pipe is not None
                pipe.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class _Job:
    """One piece of work on its way there and back, in a thread that only waits for pipes."""

    def __init__(self, process: subprocess.Popen[bytes] | None, work: Callable[[], Any]) -> None:
        self._answer: tuple[bool, Any] | None = None
        self._thread: Thread | None = None
        if process is None:
            self._answer = _answer_to(work)
            return
        self._thread = Thread(target=self._run, args=(process, work), name="worker", daemon=True)
        self._thread.start()

    def _run(self, process: subprocess.Popen[bytes], work: Callable[[], Any]) -> None:
        assert process.stdin is not None and process.stdout is not None
        try:
            data = pickle.dumps(work)
            process.stdin.write(data)
            process.stdin.flush()
            self._answer = pickle.load(process.stdout)
        except (EOFError, OSError, ValueError, pickle.UnpicklingError) as error:
            self._answer = False, _lost(process, error)
        except Exception as error:  # noqa: BLE001 - what cannot be pickled says so in many ways; it is raised in `result`
            self._answer = False, error

    @property
    def done(self) -> bool:
        return self._answer is not None

    def result(self) -> Any:
        self.join()
        assert self._answer is not None
        fine, answer = self._answer
        if not fine:
            raise answer
        return answer

    def join(self, patience: float | None = None) -> None:
        if self._thread is not None:
            self._thread.join(patience)


def _lost(process: subprocess.Popen[bytes], error: Exception) -> AutotuneError:
    with suppress(subprocess.TimeoutExpired):
        process.wait(_GRACE)
    return AutotuneError(
        f"the computing process ended unexpectedly (code {process.returncode}; {error or type(error).__name__}). "
        "Check the free memory, close other programs and try again"
    )


def _answer_to(work: Callable[[], Any]) -> tuple[bool, Any]:
    """Return (True, what *work* comes to), or (False, what it raises)."""
    try:
        return True, work()
    except Exception as error:  # noqa: BLE001 - it is raised again where the answer is taken
        return False, error


def _packed(fine: bool, answer: Any) -> bytes:
    """Return the answer as bytes; an error that does not survive the way is told in words."""
    try:
        if not fine:
            answer.add_note("".join(traceback.format_exception(answer)))
        data = pickle.dumps((fine, answer))
        if not fine:
            pickle.loads(data)
        return data
    except Exception as error:  # noqa: BLE001 - whatever a foreign object does when it is packed
        what = f"{type(answer).__name__}: {answer}" if not fine else f"{type(answer).__name__} cannot be sent: {error}"
        return pickle.dumps((False, RuntimeError(what)))


def serve() -> None:
    """Do what comes in by standard input until that closes; answers go to standard output."""
    if hasattr(os, "nice"):
        os.nice(_POLITE)
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # whatever prints must not get between the answers
    jobs: queue.Queue[Callable[[], Any]] = queue.Queue()
    Thread(target=partial(_receive, sys.stdin.buffer, jobs), daemon=True).start()
    while True:
        answers.write(_packed(*_answer_to(jobs.get())))
        answers.flush()


def _receive(pipe: BinaryIO, jobs: queue.Queue[Callable[[], Any]]) -> None:
    """Hand on what comes in; nobody left to answer to is the end, in the midst of work too."""
    try:
        while True:
            jobs.put(pickle.load(pipe))
    except (EOFError, OSError):
        os._exit(0)
    except Exception as error:  # noqa: BLE001 - whatever a foreign object does when it is unpacked
        jobs.put(partial(_fail, error))


def _fail(error: Exception) -> None:
    raise error
