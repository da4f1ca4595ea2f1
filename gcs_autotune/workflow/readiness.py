"""Waiting until the vehicle is ready: its own checks passed, its position known where a mode needs that.

A freshly booted ArduRover passes its checks after half a minute, and takes GUIDED (while armed) only when its
estimator has a position, most of a minute after boot: measured 23 s and 42 s on ArduPilot's own simulator.
"""

from __future__ import annotations

import math

from gcs_autotune.clock import Deadline
from gcs_autotune.craft import Actuate
from gcs_autotune.errors import PreconditionFailed
from gcs_autotune.foreign_text import quoted
from gcs_autotune.link import MavlinkCraft
from gcs_autotune.watch import Watcher

__all__ = ["make_ready"]

_CHECKS_PATIENCE = 30.0
_POSITION_PATIENCE = 90.0
_SILENT = 2.5
"""Chosen [s]: a vehicle that has not reported on its estimator by then (asked at 2 Hz) does not do so at all."""
_REPORT = "EKF_STATUS_REPORT"
_POS_HORIZ_ABS = 1 << 4
"""ESTIMATOR_POS_HORIZ_ABS, and the same by prediction, of ``flags``."""
_PRED_POS_HORIZ_ABS = 1 << 9


class _Estimator:
    """What the vehicle's estimator last said of itself."""

    def __init__(self, craft: MavlinkCraft) -> None:
        self.flags: int | None = None
        self._quiet_until = craft.clock.now() + _SILENT
        self._clock = craft.clock
        self._stop = craft.session.listen(_REPORT, self._take)
        craft.rates.request({_REPORT: 2.0})

    def _take(self, message: object) -> None:
        self.flags = int(message.flags)  # type: ignore[attr-defined]

    @property
    def has_position(self) -> bool:
        """Whether it has one; a vehicle that does not report is believed."""
        if self.flags is None:
            return self._clock.now() >= self._quiet_until
        return bool(self.flags & (_POS_HORIZ_ABS | _PRED_POS_HORIZ_ABS))

    def close(self) -> None:
        self._stop()


def make_ready(craft: MavlinkCraft, watcher: Watcher) -> None:
    """Wait, neutral overrides flowing, until a disarmed vehicle passes its checks and a boat knows where it is.

    Whether the checks pass is for arming to say: after half a minute they are left to that, with the reasons.

    Raises
    ------
    PreconditionFailed
        A boat without a position estimate after a minute and a half.
    """
    craft.send(Actuate())
    _await_checks(craft, watcher)
    if craft.firmware.needs_position:
        _await_position(craft, watcher)


def _await_checks(craft: MavlinkCraft, watcher: Watcher) -> None:
    deadline, said = Deadline.after(craft.clock, _CHECKS_PATIENCE), False
    while not craft.armed and craft.telemetry.latest.get("prearm_ok", math.nan) == 0.0 and not deadline.expired:
        if not said:
            watcher.say(f"waiting for the vehicle's own checks{_reasons(craft)}")
            said = True
        craft.observe()


def _await_position(craft: MavlinkCraft, watcher: Watcher) -> None:
    estimator, said = _Estimator(craft), False
    deadline = Deadline.after(craft.clock, _POSITION_PATIENCE)
    try:
        while not estimator.has_position:
            if estimator.flags is not None and not said:
                watcher.say(f"waiting for the vehicle's position estimate, which {craft.firmware.hold_mode} needs")
                said = True
            if deadline.expired:
                raise PreconditionFailed(
                    f"the vehicle has had no position estimate for {_POSITION_PATIENCE:g} s, without which it refuses "
                    f"{craft.firmware.hold_mode}: check the GPS (sky view, fix type) and compass, and try again"
                )
            craft.observe()
    finally:
        estimator.close()


def _reasons(craft: MavlinkCraft) -> str:
    said = dict.fromkeys(t.text for t in craft.session.texts if t.text.startswith("PreArm:"))
    return f" (it says: {quoted(list(said)[-3:])})" if said else ""
