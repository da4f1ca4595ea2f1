"""Run many tasks of one kind, in sequence, in several processes or on a cluster, with the same results.

The function is passed once, the tasks one by one. Both must be picklable: a function of a module (or a
``functools.partial`` of one), and tasks that are plain frozen data. Limits of work and time, and stored results, are
passed with them, so it does not matter how a process was started.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import queue
import signal
import sys
import traceback
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from threading import Thread
from types import ModuleType
from typing import Any, Protocol, TypeVar

from gcs_autotune.clock import Budget, Deadline, OutOfTime, WallClock, current_effort, limited_to
from gcs_autotune.kept_results import KeptResults, current_kept_results, keeping

__all__ = ["DaskExecutor", "Executor", "KeptProcess", "ProcessExecutor", "SerialExecutor", "executor_for"]

Task = TypeVar("Task")
Result = TypeVar("Result")

Progress = Callable[[int, int], None]
"""Callback with (tasks done, all tasks), called after each task."""


class Executor(Protocol):
    """Interface: runs many tasks with one function."""

    def map(
        self, function: Callable[[Task], Result], tasks: Sequence[Task], progress: Progress | None = None
    ) -> Iterator[Result]:
        """Yield ``function(task)`` for each task, in order.

        The results do not depend on the number of simultaneous tasks. Work done in other processes is counted here, in
        the order of the tasks.

        Raises
        ------
        OutOfTime
            The present :class:`.Budget` is used up. If it is the work, this is at the same task for every executor.
        ChildProcessError
            All processes were ended from outside. An exception in a task is raised here.
        """


class SerialExecutor:
    """Runs one task after the other, in this process."""

    def map(
        self, function: Callable[[Task], Result], tasks: Sequence[Task], progress: Progress | None = None
    ) -> Iterator[Result]:
        """Yield ``function(task)`` for each task, in order, as :meth:`Executor.map`."""
        for i, task in enumerate(tasks):
            yield function(task)
            if progress is not None:
                progress(i + 1, len(tasks))


def executor_for(jobs: int) -> Executor:
    """Return an executor for *jobs* simultaneous tasks."""
    return SerialExecutor() if jobs <= 1 else ProcessExecutor(jobs)


class ProcessExecutor:
    """Runs tasks in several processes on this computer.

    Parameters
    ----------
    jobs : number of processes.
    start_method : start method of ``multiprocessing``; empty: ``fork`` if available, which avoids repeated imports.
    """

    def __init__(self, jobs: int, start_method: str = "") -> None:
        self._jobs = jobs
        methods = multiprocessing.get_all_start_methods()
        self._method = start_method or ("fork" if "fork" in methods else methods[0])

    def map(
        self, function: Callable[[Task], Result], tasks: Sequence[Task], progress: Progress | None = None
    ) -> Iterator[Result]:
        """Yield ``function(task)`` for each task, in order, as :meth:`Executor.map`. The processes are started for this
        call and end with it.
        """
        if min(self._jobs, len(tasks)) < 2:
            yield from SerialExecutor().map(function, tasks, progress)
            return
        order = _Order(function, _Limits.present(), current_kept_results())
        with _Processes(order, min(self._jobs, len(tasks)), self._method) as processes:
            for i, outcome in enumerate(processes.outcomes(tasks)):
                _take_account(outcome)
                yield outcome.result
                if progress is not None:
                    progress(i + 1, len(tasks))


_AHEAD = 2
"""Tasks submitted to Dask per thread of its workers, so that no worker waits for the next one. Project choice."""
_LOOK = 1.0
"""Time [s] between two looks at the workers and the connection. Project choice."""
_SHORT = 0.25
"""Time [s] after which a worker returns a group of short tasks. Dask needs 10 to 20 ms for a task. Project choice."""
_MOST_TOGETHER = 256
"""Largest number of tasks that are submitted as one. Project choice."""


class DaskExecutor:
    """Runs tasks on a Dask cluster. The client was connected by the caller.

    Short tasks are submitted in groups. A worker returns the tasks of a group that it has not begun after a while.
    A task whose worker is killed is repeated by itself. After its last but one try it runs alone, because until then
    another task on that worker may have been the cause.

    Parameters
    ----------
    client : a ``distributed.Client``.
    in_order : whether results are yielded in the order of the tasks; otherwise each one as soon as it is known.
    tries : how often a task whose worker is killed is begun.
    lost : returns the result of a task after its last try; None: ``ChildProcessError`` is raised.
    unsuited : called on the worker before a task; returns why this worker must not be used, or an empty text. Such a
        worker receives no further tasks.
    reports : called with a sentence about workers that are refused or missing.
    """

    def __init__(
        self,
        client: Any,
        *,
        in_order: bool = True,
        tries: int = 3,
        lost: Callable[[Any, int], Any] | None = None,
        unsuited: Callable[[], str] | None = None,
        reports: Callable[[str], None] = lambda text: None,
    ) -> None:
        self._client, self._in_order, self._tries = client, in_order, tries
        self._lost, self._unsuited, self._reports = lost, unsuited, reports
        self._refused: dict[str, str] = {}
        self._threads: dict[str, int] = {}
        self._looked, self._waits, self._together = -_LOOK, False, 1

    def map(
        self, function: Callable[[Task], Result], tasks: Sequence[Task], progress: Progress | None = None
    ) -> Iterator[Result]:
        """Yield ``function(task)`` for each task, as :meth:`Executor.map`.

        Raises
        ------
        ConnectionError
            The scheduler has gone away. RuntimeError: every worker is unsuited.
        """
        order = _Order(function, _Limits.present(), None)
        done, early = 0, dict[int, _Outcome]()
        for i, outcome in self._outcomes(order, tasks):
            early[i] = outcome
            while early and (not self._in_order or done in early):
                outcome = early.pop(done if self._in_order else i)
                _take_account(outcome)
                done += 1
                yield outcome.result
                if progress is not None:
                    progress(done, len(tasks))

    def _outcomes(self, order: _Order, tasks: Sequence[Any]) -> Iterator[tuple[int, _Outcome]]:
        """Yield (number of the task, outcome) as they become known."""
        ended: queue.SimpleQueue[Any] = queue.SimpleQueue()
        fresh, again, alone = deque(range(len(tasks))), deque[int](), deque[int]()
        busy: dict[Any, list[int]] = {}
        killed: dict[int, int] = {}

        def submit(group: list[int]) -> None:
            busy[self._submitted(order, tuple(tasks[i] for i in group), ended)] = group

        try:
            while fresh or again or alone or busy:
                room = self._room()
                while len(busy) < room and (again or fresh):
                    most = min(self._together, len(fresh))
                    submit([again.popleft()] if again else [fresh.popleft() for _ in range(most)])
                if room and alone and not busy:
                    submit([alone.popleft()])
                if not room:
                    self._await_workers()
                    continue
                futures = [future for future in self._next(ended) if future in busy]
                for future, answer in zip(futures, self._answers_of(futures), strict=True):
                    group = busy.pop(future)
                    if isinstance(answer, BaseException):
                        raise answer
                    if isinstance(answer, _Unsuited):
                        self._refuse(answer)
                        fresh.extendleft(reversed(group))
                    elif not isinstance(answer, _Killed):
                        fresh.extendleft(reversed(group[len(answer.outcomes) :]))
                        self._together = answer.next_size
                        for i, outcome in zip(group, answer.outcomes, strict=False):
                            if isinstance(outcome, BaseException):
                                raise outcome
                            yield i, outcome
                    else:
                        for i in group:
                            killed[i] = killed.get(i, 0) + answer.times
                            if killed[i] < self._tries or len(group) > 1:
                                (alone if killed[i] >= self._tries - 1 else again).append(i)
                            elif self._lost is None:
                                raise ChildProcessError(
                                    f"task {i} was given up: {killed[i]} workers ended while it ran"
                                )
                            else:
                                yield i, _Outcome(self._lost(tasks[i], killed[i]))
        finally:
            with suppress(Exception):
                self._client.cancel(list(busy))

    def _submitted(self, order: _Order, group: tuple[Any, ...], ended: queue.SimpleQueue[Any]) -> Any:
        """Submit tasks as one, to suited workers only if there are others. The future is put into *ended*."""
        only = [w for w in self._threads if w not in self._refused] if self._refused else None
        try:
            future = self._client.submit(
                _on_worker, order, self._unsuited, group, pure=False, workers=only, allow_other_workers=bool(only)
            )
        except Exception:  # Dask has a class of its own for a client whose scheduler has closed
            self._verify_connected()
            raise
        future.add_done_callback(ended.put)
        return future

    def _next(self, ended: queue.SimpleQueue[Any]) -> list[Any]:
        """Return the futures that have ended since the last call; none after a while.

        Raises
        ------
        ConnectionError
            The scheduler has gone away.
        """
        found = []
        with suppress(queue.Empty):
            found.append(ended.get(timeout=_LOOK))
            while True:
                found.append(ended.get_nowait())
        if not found:
            self._verify_connected()
        return found

    def _verify_connected(self) -> None:
        if self._client.status != "running":
            raise ConnectionError(f"{self._scheduler} has gone away")

    @property
    def _scheduler(self) -> str:
        """The scheduler's name in a sentence: with its address, unless it is of this process."""
        address = self._client._start_arg
        return f"the scheduler {address}" if isinstance(address, str) else "the scheduler"

    def _room(self) -> int:
        """Return how many tasks may be submitted at a time."""
        now = WallClock().now()
        if now - self._looked >= _LOOK:
            self._looked = now
            self._verify_connected()
            with suppress(OSError, TimeoutError, AttributeError):  # the last: the client was closed just now
                self._threads = dict(self._client.nthreads())
        suited = sum(n for worker, n in self._threads.items() if worker not in self._refused)
        if self._threads and not suited:
            raise RuntimeError(f"every worker is refused: {'; '.join(dict.fromkeys(self._refused.values()))}")
        self._waits &= not suited
        return _AHEAD * suited

    def _await_workers(self) -> None:
        """Wait until there is a worker, or for a while."""
        self._verify_connected()
        if not self._waits:
            self._reports("no worker is connected to the scheduler. Waiting for one")
        self._waits = True
        with suppress(TimeoutError, OSError):
            self._client.wait_for_workers(1, timeout=_LOOK)
        self._looked = -_LOOK

    def _refuse(self, answer: _Unsuited) -> None:
        if answer.worker not in self._refused:
            self._refused[answer.worker] = answer.why
            self._reports(f"worker {answer.worker} is not used: {answer.why}")

    def _answers_of(self, futures: Sequence[Any]) -> list[Any]:
        """Return what became of tasks: also the errors of their function."""
        try:
            found: list[Any] = self._client.gather(list(futures))  # at once: one transfer takes as long as many
        except Exception:  # noqa: BLE001  one of them has an error, which its future states
            return [self._answer_of(future) for future in futures]
        return found

    def _answer_of(self, future: Any) -> _Answers | _Unsuited | _Killed | BaseException:
        if future.status == "cancelled":
            raise ConnectionError(f"{self._scheduler} has gone away, or another client cancelled the tasks")
        if future.status == "error":
            error = future.exception()
            return _Killed(int(error.allowed_failures) + 1) if type(error).__name__ == "KilledWorker" else error
        answer: _Answers | _Unsuited = future.result()
        return answer


@dataclass(frozen=True, slots=True)
class _Unsuited:
    """Why a worker must not be used."""

    worker: str
    why: str


@dataclass(frozen=True, slots=True)
class _Killed:
    """How often the worker of a task was killed."""

    times: int


@dataclass(frozen=True, slots=True)
class _Answers:
    """Outcomes of the first tasks of a group, and the time [s] that they took."""

    outcomes: tuple[_Outcome | BaseException, ...]
    seconds: float

    @property
    def next_size(self) -> int:
        """Number of such tasks that take :data:`_SHORT`; at most twice as many as these."""
        done = len(self.outcomes)
        return max(1, min(int(_SHORT * done / max(self.seconds, 1e-6)), 2 * done, _MOST_TOGETHER))


def _on_worker(order: _Order, unsuited: Callable[[], str] | None, group: tuple[Any, ...]) -> _Answers | _Unsuited:
    """Run tasks on a worker of Dask until :data:`_SHORT` has passed, unless the worker is unsuited."""
    if unsuited is not None and (why := unsuited()):
        from distributed import get_worker

        return _Unsuited(get_worker().address, why)
    began, found = WallClock().now(), list[_Outcome | BaseException]()
    while len(found) < len(group) and (not found or WallClock().now() - began < _SHORT):
        found.append(_outcome(order, group[len(found)]))
    return _Answers(tuple(found), WallClock().now() - began)


_POLITE = 5
"""Niceness of a kept process, so that the process that started it has priority. Project choice."""
_GRACE = 5.0
"""Time [s] that a terminated process may take to end. Project choice."""


class KeptProcess:
    """A process that is started in advance and kept between calls, for a caller that must not wait.

    It is a new process without open files or ports of the caller. It does not import the caller's main module, which
    may be a script that opens a link. It has its own session, so that Ctrl-C at the terminal does not reach it, and
    prints to standard error. It ends as soon as the caller's process ends, even while working.
    """

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, there = context.Pipe()
        self._process = context.Process(target=_serve_apart, args=(there,), daemon=True)
        with _holding_signals(), _without_main_module():
            self._process.start()
        there.close()

    @property
    def pid(self) -> int | None:
        """Id of the process."""
        return self._process.pid

    @property
    def is_alive(self) -> bool:
        """Whether the process can run further tasks."""
        return self._process.is_alive()

    def map(
        self, function: Callable[[Task], Result], tasks: Sequence[Task], progress: Progress | None = None
    ) -> Iterator[Result]:
        """Yield ``function(task)`` for each task, in order, as :meth:`Executor.map`. Raises ``ChildProcessError`` with
        the exit code if the process ends.
        """
        limits, kept = _Limits.present(), current_kept_results()
        for i, task in enumerate(tasks):
            try:
                self._pipe.send((_Order(function, limits, kept), task))
                outcome = self._pipe.recv()
            except (EOFError, OSError) as error:
                self._process.join(_GRACE)
                raise ChildProcessError(f"code {self._process.exitcode}; {error or type(error).__name__}") from error
            if isinstance(outcome, BaseException):
                raise outcome
            _take_account(outcome)
            yield outcome.result
            if progress is not None:
                progress(i + 1, len(tasks))

    def kill(self) -> None:
        """Terminate the process even while working. A caller waiting for it receives an error."""
        self._process.kill()

    def close(self) -> None:
        """Terminate the process and wait until it has ended. No caller may be waiting for it."""
        self.kill()
        self._process.join(_GRACE)
        self._pipe.close()


@dataclass(frozen=True, slots=True)
class _Limits:
    """Rest of the present budget: work [samples], time [s]; None: no limit was set."""

    work: float
    seconds: float | None

    @classmethod
    def present(cls) -> _Limits | None:
        effort = current_effort()
        if effort is None:
            return None
        return cls(effort.work - effort.done, None if effort.deadline is None else effort.deadline.remaining)

    def budget(self) -> Budget:
        deadline = None if self.seconds is None else Deadline.after(WallClock(), self.seconds)
        return Budget(self.work, deadline)


@dataclass(frozen=True, slots=True)
class _Order:
    """Data that a process needs before its first task."""

    function: Callable[[Any], Any]
    limits: _Limits | None
    kept: KeptResults | None


@dataclass(frozen=True, slots=True)
class _Outcome:
    """Result of a task, its ``work`` [samples], and whether it used up the budget."""

    result: Any
    work: float = 0.0
    stopped: bool = False


def _take_account(outcome: _Outcome) -> None:
    """Count the work of a task done elsewhere, and stop if the budget is used up."""
    effort = current_effort()
    if effort is None:
        return
    effort.done += outcome.work
    effort.check()
    if outcome.stopped:
        effort.stop()


class _Processes:
    """Processes with one pipe each, so that one terminated in the middle of an answer does not block the others.

    A pool with one queue for all answers may wait for ever if a process is terminated during a long answer.
    """

    def __init__(self, order: _Order, count: int, method: str) -> None:
        self._order, self._count, self._method = order, count, method
        self._pipes: list[Connection] = []
        self._processes: list[multiprocessing.process.BaseProcess] = []

    def __enter__(self) -> _Processes:
        context = multiprocessing.get_context(self._method)
        # What is sent to a process before it has forgotten its parent's handlers waits until it has: a parent's handler
        # that swallows SIGTERM would leave it alive, and the process that ended it would wait for ever.
        with _holding_signals():
            for _ in range(self._count):
                here, there = context.Pipe()
                self._pipes.append(here)
                inherited = tuple(self._pipes) if self._method == "fork" else ()
                process = context.Process(  # type: ignore[attr-defined]
                    target=_serve, args=(self._order, there, inherited), daemon=True
                )
                process.start()
                self._processes.append(process)
                there.close()
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._processes:
            process.terminate()
        for process, pipe in zip(self._processes, self._pipes, strict=False):
            process.join()
            pipe.close()

    def outcomes(self, tasks: Sequence[Any]) -> Iterator[_Outcome]:
        """Yield the outcome of every task, in order; errors as for :meth:`Executor.map`."""
        waiting, done = deque(range(len(tasks))), dict[int, _Outcome | BaseException]()
        busy: dict[Connection, int] = {}
        idle = list(self._pipes)
        for i in range(len(tasks)):
            while i not in done:
                while idle and waiting:
                    pipe = idle.pop()
                    if _is_sent(pipe, tasks[waiting[0]]):
                        busy[pipe] = waiting.popleft()
                if not busy:
                    raise ChildProcessError("all worker processes were ended from outside. Check the free memory")
                for ready in wait(list(busy)):
                    assert isinstance(ready, Connection)
                    at, outcome = busy.pop(ready), _received(ready)
                    if outcome is None:
                        waiting.appendleft(at)
                        continue
                    done[at] = outcome
                    idle.append(ready)
            next_one = done.pop(i)
            if isinstance(next_one, BaseException):
                raise next_one
            yield next_one


def _is_sent(pipe: Connection, task: Any) -> bool:
    """Send *task*. Return False if the process has ended; the others then do its tasks."""
    try:
        pipe.send(task)
    except BrokenPipeError:
        return False
    return True


def _received(pipe: Connection) -> _Outcome | BaseException | None:
    """Return the answer of a process; None if the process has ended."""
    try:
        outcome: _Outcome | BaseException = pipe.recv()
    except (EOFError, ConnectionResetError):
        return None
    return outcome


@contextmanager
def _holding_signals() -> Iterator[None]:
    """Defer SIGTERM and SIGINT if the system can. Windows cannot, but does not fork."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    unblocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM, signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, unblocked)


def _begin() -> None:
    """Reset the parent's signal handlers: ignore Ctrl-C, which the parent handles, and end on SIGTERM."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM, signal.SIGINT})


@contextmanager
def _without_main_module() -> Iterator[None]:
    """Prevent a process started within this context from importing the main module, by hiding it from
    ``multiprocessing``."""
    main = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


def _serve_apart(pipe: Connection) -> None:
    """Run the tasks received, each with its own order; see :class:`KeptProcess`."""
    _begin()
    if hasattr(os, "setsid"):
        os.setsid()
        os.nice(_POLITE)
    os.dup2(2, 1)  # standard output is the caller's
    Thread(target=_end_with_parent, daemon=True).start()
    with suppress(EOFError, OSError):
        while True:
            _answer(pipe, _next_outcome(pipe))


def _next_outcome(pipe: Connection) -> _Outcome | BaseException:
    try:
        order, task = pipe.recv()
    except (EOFError, OSError):
        raise
    except Exception as error:  # noqa: BLE001  whatever an object does when it is unpacked is raised in the parent
        return error
    with keeping(order.kept):
        return _outcome(order, task)


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(0)


def _serve(order: _Order, pipe: Connection, inherited: Sequence[Connection]) -> None:
    """Run one task after the other, until the parent terminates this process or ends itself."""
    _begin()
    for other in inherited:
        other.close()
    with suppress(EOFError, BrokenPipeError), keeping(order.kept):
        while True:
            _answer(pipe, _outcome(order, pipe.recv()))


def _answer(pipe: Connection, outcome: _Outcome | BaseException) -> None:
    """Send the outcome. An error that cannot be pickled is sent as text."""
    try:
        if isinstance(outcome, BaseException):
            pickle.loads(pickle.dumps(outcome))  # many an error can be packed and not unpacked
        pipe.send(outcome)
    except Exception as error:  # noqa: BLE001  whatever an object does when it is packed
        if isinstance(outcome, BaseException):
            pipe.send(RuntimeError(f"{type(outcome).__name__}: {outcome}"))
        else:
            pipe.send(RuntimeError(f"the result of a task, a {type(outcome.result).__name__}, cannot be sent: {error}"))


def _outcome(order: _Order, task: Any) -> _Outcome | BaseException:
    """Return the outcome of a task: its result, or the error it raised.

    Each task may use the budget left when the processes were started. The parent adds up the work and stops at the
    right task.
    """
    budget = Budget() if order.limits is None else order.limits.budget()
    try:
        with limited_to(budget):
            return _Outcome(order.function(task), budget.done)
    except OutOfTime:
        return _Outcome(None, budget.done, stopped=True)
    except Exception as error:  # noqa: BLE001  it is raised in the parent
        error.add_note("".join(traceback.format_exception(error)))
        return error
