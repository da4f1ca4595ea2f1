"""The computing of a run, done by an executor in a process of its own. The loop that holds the sticks never waits.

A thread would not do: what computes in Python and NumPy lets go of the interpreter only now and then, and the overrides
pause meanwhile. The process is started ahead.
"""

from __future__ import annotations

from collections.abc import Callable
from threading import Thread
from types import TracebackType
from typing import Any, Self

from gcs_autotune.errors import AutotuneError
from gcs_autotune.executor import Executor, KeptProcess, SerialExecutor

__all__ = ["Worker"]

_GRACE = 5.0
"""Chosen [s]: so long it may take until it shows that a process is gone."""


class Worker:
    """One piece of work at a time, done elsewhere.

    Parameters
    ----------
    apart : whether in a process of its own; else the work is done at once: simulated time stands still for it.
    """

    def __init__(self, *, apart: bool = True) -> None:
        self.apart = apart
        self._process: KeptProcess | None = KeptProcess() if apart else None
        self._job: _Job | None = None
        self._abandoned = False

    def begin(self, work: Callable[[], Any]) -> None:
        """Have *work* done; everything it refers to, and its result, must be what ``pickle`` takes."""
        if self._process is not None and (self._abandoned or not self._process.is_alive):
            self._end()
        if self.apart and self._process is None:
            self._process = KeptProcess()
        self._job = _Job(work, self._process)

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
        """The result is not needed any more."""
        if self._job is not None and not self._job.done and self._process is not None:
            self._process.kill()
            self._abandoned = True

    def close(self) -> None:
        """End the process, at work or not. Closing twice does nothing."""
        self.apart = False
        self._end()

    def _end(self) -> None:
        process, self._process, self._abandoned = self._process, None, False
        if process is None:
            return
        process.kill()
        if self._job is not None:
            self._job.join(_GRACE)
        process.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class _Job:
    """One piece of work and what came of it: done at once, or by *process*, in a thread that only waits for it."""

    def __init__(self, work: Callable[[], Any], process: KeptProcess | None) -> None:
        self.done = False
        self._result: Any = None
        self._error: Exception | None = None
        self._thread: Thread | None = None
        if process is None:
            self._run(SerialExecutor(), work)
            return
        self._thread = Thread(target=self._run, args=(process, work), name="worker", daemon=True)
        self._thread.start()

    def _run(self, executor: Executor, work: Callable[[], Any]) -> None:
        try:
            (self._result,) = executor.map(_call, [work])
        except ChildProcessError as error:
            self._error = AutotuneError(
                f"the computing process ended unexpectedly ({error}). Check the free memory, close other programs and "
                "try again"
            )
        except Exception as error:  # noqa: BLE001 - it is raised where the result is taken
            self._error = error
        self.done = True

    def result(self) -> Any:
        self.join()
        if self._error is not None:
            raise self._error
        return self._result

    def join(self, patience: float | None = None) -> None:
        if self._thread is not None:
            self._thread.join(patience)


def _call(work: Callable[[], Any]) -> Any:
    return work()
