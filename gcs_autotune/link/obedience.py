"""Before anything is measured: does the vehicle take our overrides, and do its outputs do what we say?

Every way of being deaf is silent in MAVLink: a wrong system id, an option bit, a switch, another station's stream, a
safety button. So both halves of the way are looked at, and the cause of a failure is asked for and said.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from gcs_autotune.clock import Deadline
from gcs_autotune.craft import Actuate
from gcs_autotune.errors import PreconditionFailed
from gcs_autotune.firmware import Firmware
from gcs_autotune.link.driver import FOLLOW_TIMEOUT, Driver
from gcs_autotune.link.overrides import why_deaf
from gcs_autotune.link.parameters import Parameters
from gcs_autotune.link.session import Session
from gcs_autotune.link.sticks import Sticks
from gcs_autotune.link.telemetry import Telemetry

__all__ = ["TWITCH", "see_outputs_follow", "see_overrides_taken"]

TWITCH = 0.05
"""Chosen: fraction of full output by which the steering is moved, without thrust, to see that it obeys."""
_LEVELS = (TWITCH, -TWITCH, TWITCH, -TWITCH, 0.0)


def see_overrides_taken(
    session: Session, driver: Driver, sticks: Sticks, parameters: Parameters, firmware: Firmware
) -> None:
    """Send overrides that are as good as neutral and yet known again, and look for them in RC_CHANNELS.

    Raises
    ------
    PreconditionFailed
        They are not there, with the likely cause and its cure.
    """
    heard = sticks.count
    taken = driver.nudge()
    if not taken and sticks.count > heard:
        raise PreconditionFailed(
            f"the vehicle does not take our overrides: RC_CHANNELS shows {driver.differing}. "
            + why_deaf(parameters, firmware, session.source_system)
        )
    if not taken:
        session.notes.append(
            "the vehicle sends no RC_CHANNELS: that it takes our overrides is seen at its outputs only"
        )
    driver.rest()
    session.wait_for(lambda: driver.is_obeyed or None, 1.0)


def see_outputs_follow(driver: Driver, telemetry: Telemetry, observe: Callable[[], object], mode: str) -> None:
    """Twitch the steering by 5 % each way, without thrust, and look for that in SERVO_OUTPUT_RAW.

    observe : waits for the next control tick; commands go out on ticks, so that the loop is timed as it will be used.

    Raises
    ------
    PreconditionFailed
        The output does not follow.
    """
    for level in _LEVELS:
        driver.command(Actuate(N=level))
        deadline = Deadline.after(driver.clock, FOLLOW_TIMEOUT)
        while not abs(telemetry.outputs.get("N", math.nan) - level) < 0.5 * TWITCH:
            if deadline.expired:
                raise _deaf_outputs(level, driver, telemetry, mode)
            observe()


def _deaf_outputs(level: float, driver: Driver, telemetry: Telemetry, mode: str) -> PreconditionFailed:
    output = telemetry.outputs.get("N", math.nan)
    what = "RC_CHANNELS shows our overrides, but" if driver.is_obeyed else "neither RC_CHANNELS nor"
    return PreconditionFailed(
        f"the steering output does not follow: {level:+.0%} was sent, {what} SERVO_OUTPUT_RAW shows it "
        f"({output:+.0%} in {mode}). Check SERVOn_FUNCTION and the motor directions, the safety switch "
        "(BRD_SAFETY_DEFLT), and that no failsafe is active"
    )
