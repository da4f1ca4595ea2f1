"""Work shared among processes on request: forks that inherit everything and send back only what they found."""

from __future__ import annotations

import multiprocessing
import signal
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from multiprocessing.context import ForkProcess
from typing import Any, TypeVar

from gcs_autotune.clock import Budget, OutOfTime, current_effort

__all__ = ["in_parallel"]

Result = TypeVar("Result")


def in_parallel(
    task: Callable[[int], Result],
    count: int,
    jobs: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> list[Result]:
    """Return ``[task(0), ..., task(count - 1)]``, from *jobs* processes where the system can fork.

    The answers do not depend on *jobs*. *task* may refer to anything, but must not be meant to change it: what a
    process changes stays there. Work done there counts here, in the order of the tasks.

    Raises
    ------
    OutOfTime
        The :class:`.Budget` is used up: at the same task for any number of *jobs*, where it is the work.
    """
    found: list[Result] = []
    if jobs <= 1 or count < 2 or "fork" not in multiprocessing.get_all_start_methods():
        for i in range(count):
            found.append(task(i))
            if progress is not None:
                progress(i + 1, count)
        return found
    effort = current_effort()
    begun = 0.0 if effort is None else effort.done
    with _Workers(task, begun, min(jobs, count)) as workers:
        for result, samples, stopped in workers.results(count):
            _take_account(samples, stopped=stopped)
            found.append(result)
            if progress is not None:
                progress(len(found), count)
    return found


def _take_account(samples: float, *, stopped: bool) -> None:
    """Add the work of a task done elsewhere, and stop where the effort is used up."""
    effort = current_effort()
    if effort is None:
        return
    effort.done += samples
    effort.check()
    if stopped:
        effort.stop()


def _begin() -> None:
    """Forget the parent's signal handlers: Ctrl-C is the parent's business, and who is told to end, ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})


Outcome = tuple[Any, float, bool]
"""What a task returned, its work [samples], and whether the effort was used up in it."""


class _Workers:
    """Forked processes, each with a pipe of its own: one that is ended in the middle of an answer holds up no other.

    A pool has one queue for all answers; to end it while a long answer is under way may wait for ever.
    """

    def __init__(self, task: Callable[[int], Any], begun: float, count: int) -> None:
        self.task, self.begun, self.count = task, begun, count
        self.pipes: list[Connection] = []
        self.processes: list[ForkProcess] = []

    def __enter__(self) -> _Workers:
        context = multiprocessing.get_context("fork")
        # What is sent to a process before it has forgotten its parent's handlers waits until it has: a parent's handler
        # that swallows SIGTERM would leave it alive, and whoever told it to end waiting for ever.
        unblocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
        try:
            for _ in range(self.count):
                here, there = context.Pipe()
                self.pipes.append(here)
                process = context.Process(target=self._work, args=(there,), daemon=True)
                process.start()
                self.processes.append(process)
                there.close()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, unblocked)
        return self

    def __exit__(self, *_: object) -> None:
        for process in self.processes:
            process.terminate()
        for process, pipe in zip(self.processes, self.pipes, strict=False):
            process.join()
            pipe.close()

    def results(self, count: int) -> Iterator[Outcome]:
        """Yield the outcome of every task, in order.

        Raises
        ------
        ChildProcessError
            All processes were ended from outside. What a task raises is raised here.
        """
        waiting, done = deque(range(count)), dict[int, Outcome | BaseException]()
        busy: dict[Connection, int] = {}
        idle = list(self.pipes)
        for i in range(count):
            while i not in done:
                while idle and waiting:
                    pipe = idle.pop()
                    with suppress(BrokenPipeError):  # its process was ended: the others do its share
                        pipe.send(waiting[0])
                        busy[pipe] = waiting.popleft()
                if not busy:
                    raise ChildProcessError("all processes of the search were ended: is there memory enough?")
                for ready in wait(list(busy)):
                    assert isinstance(ready, Connection)
                    at = busy.pop(ready)
                    try:
                        done[at] = ready.recv()
                        idle.append(ready)
                    except (EOFError, ConnectionResetError):
                        waiting.appendleft(at)
            outcome = done.pop(i)
            if isinstance(outcome, BaseException):
                raise outcome
            yield outcome

    def _work(self, pipe: Connection) -> None:
        """Answer for one task after the other, until the parent ends this process or is gone."""
        _begin()
        for other in self.pipes:
            other.close()
        with suppress(EOFError, BrokenPipeError):
            while True:
                pipe.send(self._outcome(pipe.recv()))

    def _outcome(self, i: int) -> Outcome | BaseException:
        """Return the outcome of task *i*, or what it raised.

        Each task may use what was left when the processes were made: the parent adds up, and stops at the right one.
        """
        effort = current_effort() or Budget()
        effort.done, effort.stopped = self.begun, ""
        try:
            return self.task(i), effort.done - self.begun, False
        except OutOfTime:
            return None, effort.done - self.begun, True
        except Exception as error:  # noqa: BLE001  it is raised in the parent
            return error
