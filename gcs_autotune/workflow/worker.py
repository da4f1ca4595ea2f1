"""A worker process that computes for a run, so that the control loop never waits.

A thread is not sufficient: Python and NumPy code rarely releases the interpreter lock, so overrides would pause. The
process is started before it is needed.
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
"""Time [s] within which the end of a process is noticed. Project choice."""


class Worker:
    """Runs one piece of work at a time in another process.

    Parameters
    ----------
    apart : whether to use another process. Otherwise the work is done at once, while simulated time stands still.
    """

    def __init__(self, *, apart: bool = True) -> None:
        self.apart = apart
        self._process: KeptProcess | None = KeptProcess() if apart else None
        self._job: _Job | None = None
        self._abandoned = False

    def begin(self, work: Callable[[], Any]) -> None:
        """Start *work*. The function and its result must be picklable."""
        if self._process is not None and (self._abandoned or not self._process.is_alive):
            self._end()
        if self.apart and self._process is None:
            self._process = KeptProcess()
        self._job = _Job(work, self._process)

    @property
    def done(self) -> bool:
        """Whether the last work is done."""
        return self._job is not None and self._job.done

    def result(self) -> Any:
        """Return the result when :attr:`done`; raise its exception here.

        Raises
        ------
        AutotuneError
            The process ended before the work was done.
        """
        assert self._job is not None
        job, self._job = self._job, None
        return job.result()

    def abandon(self) -> None:
        """Discard the pending result."""
        if self._job is not None and not self._job.done and self._process is not None:
            self._process.kill()
            self._abandoned = True

    def close(self) -> None:
        """End the process even if it is working. It may be called twice."""
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
    """One piece of work and its result, computed at once or by *process* with a thread that waits for it."""

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
