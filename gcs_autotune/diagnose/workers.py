"""Work shared among processes on request: forks that inherit everything and send back only what they found."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable
from typing import Any, TypeVar

__all__ = ["in_parallel"]

Result = TypeVar("Result")


_task: Callable[[int], Any] | None = None
"""What the forked processes work at; set just before they are made."""


def in_parallel(
    task: Callable[[int], Result],
    count: int,
    jobs: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> list[Result]:
    """Return ``[task(0), ..., task(count - 1)]``, from *jobs* processes where the system can fork.

    The answers do not depend on *jobs*. *task* may refer to anything, but must not be meant to change it: what a
    process changes stays there.
    """
    found: list[Result] = []
    if jobs <= 1 or count < 2 or "fork" not in multiprocessing.get_all_start_methods():
        for i in range(count):
            found.append(task(i))
            if progress is not None:
                progress(i + 1, count)
        return found
    global _task
    _task = task
    try:
        # What is sent to a process before it has forgotten its parent's handlers waits until it has: a parent's handler
        # that swallows SIGTERM would leave it alive, and whoever told it to end waiting for ever.
        unblocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
        try:
            pool = multiprocessing.get_context("fork").Pool(min(jobs, count), _begin)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, unblocked)
        with pool:
            for result in pool.imap(_at, range(count)):
                found.append(result)
                if progress is not None:
                    progress(len(found), count)
    finally:
        _task = None
    return found


def _begin() -> None:
    """Forget the parent's signal handlers: Ctrl-C is the parent's business, and who is told to end, ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})


def _at(i: int) -> Any:
    assert _task is not None
    return _task(i)
