"""Compute, or wait for an answer, while an armed vehicle is in the water; the link must stay active.

ArduSub disarms three seconds after the last pilot input. ArduRover changes to HOLD after two. So neutral overrides are
sent while the worker process computes or while the operator decides.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from typing import Any, ParamSpec, TypeVar

from gcs_autotune.clock import ManualClock
from gcs_autotune.craft import Actuate
from gcs_autotune.errors import AutotuneError, LinkError
from gcs_autotune.link import MavlinkCraft
from gcs_autotune.observer import Observer
from gcs_autotune.workflow.operator import Operator, answers_questions
from gcs_autotune.workflow.worker import Worker

__all__ = ["agreed", "ask", "ask_now", "await_worker", "beside", "finish", "hold_neutral", "run_in_background"]

T = TypeVar("T")
P = ParamSpec("P")

_GLANCE = 0.01
"""Interval [s] between checks for the result. Project choice: short compared with a control tick."""


def run_in_background(
    craft: MavlinkCraft,
    worker: Worker,
    bear: Callable[[AutotuneError], bool],
    work: Callable[P, T],
    *args: P.args,
    **named: P.kwargs,
) -> T:
    """Return the result of *work*, computed by the *worker* while the link is served. Raise its exceptions here.

    *bear* returns whether a fault of the craft is over; the work then continues. On a lock-stepped link, simulated time
    stands still, so the work is done at once.
    """
    if isinstance(craft.clock, ManualClock):
        return work(*args, **named)
    hold_neutral(craft)
    worker.begin(partial(work, *args, **named))
    found: T = await_worker(craft, worker, bear)
    return found


def await_worker(craft: MavlinkCraft, worker: Worker, bear: Callable[[AutotuneError], bool]) -> Any:
    """Return the result that the *worker* is computing, while the link is served."""
    while True:
        try:
            _watch(craft, worker)
        except AutotuneError as error:
            if not bear(error):
                worker.abandon()
                raise
            _hold(craft)  # whatever mode it shows: what brought it there was not us
        except BaseException:
            worker.abandon()
            raise
        else:
            return worker.result()


def finish(craft: MavlinkCraft, worker: Worker, meanwhile: Callable[[], None] = lambda: None) -> Any:
    """Monitor the craft until the *worker* is done, and return the result."""
    try:
        _watch(craft, worker, meanwhile)
    except BaseException:
        worker.abandon()
        raise
    return worker.result()


def _watch(craft: MavlinkCraft, worker: Worker, meanwhile: Callable[[], None] = lambda: None) -> None:
    while True:
        craft.observe()  # once at least: how long the work takes decides nothing about the craft
        meanwhile()
        if worker.done:
            return


def beside(craft: MavlinkCraft, work: Callable[[], T]) -> T:
    """Return the result of *work*, done in a thread while the link is served. Use it to write files, not to compute.

    The operator waits for the result. If the link is lost, the work is still completed.
    """
    if isinstance(craft.clock, ManualClock):
        return work()
    pool = ThreadPoolExecutor(max_workers=1, thread_name_prefix="files")
    try:
        result = pool.submit(work)
        with craft.session.operator.shielded(), suppress(LinkError):
            while not result.done():
                craft.session.pump(_GLANCE)
        return result.result()
    finally:
        pool.shutdown()


def ask(craft: MavlinkCraft, operator: Operator, question: str) -> bool:
    """Return the operator's answer. Hold and monitor the craft until it comes."""
    if craft.armed:
        hold_neutral(craft)
    return operator.ask(question, craft.observe)


def agreed(craft: MavlinkCraft, operator: Operator, observer: Observer, question: str) -> bool:
    """Return whether the operator agrees. A simulated vehicle needs no answer; the log reports this."""
    if craft.session.transport.is_simulated:
        observer.say(f"{question} yes (simulated vehicle)")
        return True
    return ask(craft, operator, question)


def ask_now(craft: MavlinkCraft, operator: Operator, observer: Observer, question: str) -> bool:
    """Ask the operator a question that ``--yes`` does not answer. Return False if no operator is present.

    The flight mode stays unchanged and the sticks stay neutral.
    """
    if not answers_questions(operator):
        observer.say(f"{question} no (--yes: no operator to ask)")
        return False
    return operator.ask(question, craft.session.pump)


def hold_neutral(craft: MavlinkCraft) -> None:
    """Change to the hold mode if necessary, with the sticks neutral."""
    if craft.mode == craft.firmware.hold_mode:
        craft.send(Actuate())
    else:
        _hold(craft)


def _hold(craft: MavlinkCraft) -> None:
    """Command an ROV to hold depth and heading with the sticks neutral. In manual mode it could float up."""
    if craft.firmware.holds_itself:
        craft.set_mode(craft.firmware.hold_mode)
    craft.send(Actuate())
