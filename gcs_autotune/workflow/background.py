"""Compute and ask while an armed vehicle is in the water: the link must not fall silent.

ArduSub disarms three seconds after the last pilot input, ArduRover changes to HOLD after two. So neutral overrides are
sent while the worker computes in its own process, or while the operator thinks.
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
"""Seconds between two checks whether the work is done. Chosen."""


def run_in_background(
    craft: MavlinkCraft,
    worker: Worker,
    bear: Callable[[AutotuneError], bool],
    work: Callable[P, T],
    *args: P.args,
    **named: P.kwargs,
) -> T:
    """Return the result of *work*, done by the *worker* while the link is served; its exceptions are raised here.

    *bear* returns whether trouble with the craft is over; then the work continues. On a lock-stepped link time stands
    still, so there the work is done at once.
    """
    if isinstance(craft.clock, ManualClock):
        return work(*args, **named)
    hold_neutral(craft)
    worker.begin(partial(work, *args, **named))
    found: T = await_worker(craft, worker, bear)
    return found


def await_worker(craft: MavlinkCraft, worker: Worker, bear: Callable[[AutotuneError], bool]) -> Any:
    """Return the result begun at the *worker*, in the same way."""
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
    """Monitor the craft until the *worker* is done, and return the result, in the same way."""
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
    """Return the result of *work*, done in a thread while the link is served; for writing files, not for computing.

    The operator has to wait. If the link is lost, the work is still finished.
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
    """Return the operator's answer; until it comes the craft is held and monitored."""
    if craft.armed:
        hold_neutral(craft)
    return operator.ask(question, craft.observe)


def agreed(craft: MavlinkCraft, operator: Operator, observer: Observer, question: str) -> bool:
    """Return whether the operator agrees; a simulated vehicle needs no answer, which is reported."""
    if craft.session.transport.is_simulated:
        observer.say(f"{question} Simulated vehicle: yes.")
        return True
    return ask(craft, operator, question)


def ask_now(craft: MavlinkCraft, operator: Operator, observer: Observer, question: str) -> bool:
    """Return the operator's answer to a question that ``--yes`` does not answer; False without an operator.

    The mode is left as it is, and the sticks neutral.
    """
    if not answers_questions(operator):
        observer.say(f"{question} No operator to ask (--yes): no.")
        return False
    return operator.ask(question, craft.session.pump)


def hold_neutral(craft: MavlinkCraft) -> None:
    """Change to the hold mode, unless already in it; sticks neutral."""
    if craft.mode == craft.firmware.hold_mode:
        craft.send(Actuate())
    else:
        _hold(craft)


def _hold(craft: MavlinkCraft) -> None:
    """Let an ROV hold depth and heading (in manual mode it would drift up), sticks neutral."""
    if craft.firmware.holds_itself:
        craft.set_mode(craft.firmware.hold_mode)
    craft.send(Actuate())
