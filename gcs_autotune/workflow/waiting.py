"""Thinking and asking while a vehicle is armed in the water: the link must not fall silent meanwhile.

ArduSub disarms three seconds after the last pilot input, ArduRover goes to HOLD after two. So neutral
overrides keep flowing from this thread while the desk works in another, or while the operator thinks.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from gcs_autotune.clock import ManualClock
from gcs_autotune.craft import Actuate
from gcs_autotune.link import MavlinkCraft
from gcs_autotune.watch import Watcher
from gcs_autotune.workflow.operator import Operator

__all__ = ["agreed", "ask", "think"]

T = TypeVar("T")


def think(craft: MavlinkCraft, work: Callable[[], T]) -> T:
    """Return ``work()``, keeping the craft company meanwhile; what it raises is raised here.

    On a lock-stepped link time stands still while we think, so there the work is simply done.
    """
    if isinstance(craft.clock, ManualClock):
        return work()
    _keep_company(craft)
    pool = ThreadPoolExecutor(max_workers=1, thread_name_prefix="desk")
    try:
        result = pool.submit(work)
        while not result.done():
            craft.observe()
        return result.result()
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def ask(craft: MavlinkCraft, operator: Operator, question: str) -> bool:
    """Return the operator's answer, keeping the craft company until it comes."""
    if craft.armed:
        _keep_company(craft)
    return operator.ask(question, craft.observe)


def agreed(craft: MavlinkCraft, operator: Operator, watcher: Watcher, question: str) -> bool:
    """Whether the operator agrees; of a simulated vehicle it is said that nobody is asked."""
    if craft.session.transport.is_simulated:
        watcher.say(f"{question} Simulated vehicle: not asking.")
        return True
    return ask(craft, operator, question)


def _keep_company(craft: MavlinkCraft) -> None:
    """Let an ROV hold depth and heading by itself (in manual mode it would drift up), sticks neutral."""
    if craft.firmware.kind == "rov":
        craft.set_mode(craft.firmware.hold_mode)
    craft.send(Actuate())
