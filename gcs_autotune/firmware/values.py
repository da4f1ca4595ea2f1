"""Plausible values of parameters. All values received from a vehicle are checked here before they are used in
computations.

The limits are wide on purpose. A value outside them is an error (damaged storage, an unknown firmware, a forged
message), not just an unwise setting. Names as in ArduPilot's parameter metadata, 4.5 to 4.7.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

from gcs_autotune.errors import PreconditionFailed

__all__ = ["VALUES", "Values", "checked", "checked_all"]


@dataclass(frozen=True, slots=True)
class Values:
    """Range from ``low`` to ``high``, in the parameter's own unit. ``whole``: whole numbers only."""

    low: float
    high: float
    whole: bool = False

    def fault(self, value: float) -> str:
        """Return a sentence on what is wrong with *value*; empty if it is valid."""
        if math.isnan(value):
            return "is nan, not a number"
        if not self.low <= value <= self.high:
            return f"is {value:g}, outside the plausible range {self.low:g} to {self.high:g}"
        if self.whole and value != int(value):
            return f"is {value:g}, not a whole number"
        return ""


_ANY = Values(-1e30, 1e30)
_BITS = Values(-1, 2.0**32, whole=True)
_SWITCH = Values(0, 1, whole=True)
_PERCENT = Values(0, 100)

VALUES: Mapping[str, Values] = {
    r"MAV_SYSID|SYSID_THISMAV|MAV_GCS_SYSID|SYSID_MYGCS": Values(1, 255, whole=True),
    r"MAV_GCS_SYSID_HI": Values(0, 255, whole=True),
    r"(RC|MAV|MANUAL)_OPTIONS|ARMING_(CHECK|SKIPCHK)": _BITS,
    r"RCMAP_\w+": Values(1, 16, whole=True),
    r"RC_OVERRIDE_TIME": Values(-1, 3600),
    r"(RC|SERVO)\d+_(MIN|TRIM|MAX)": Values(500, 2500),
    r"RC\d+_DZ": Values(0, 500),
    r"(RC|SERVO)\d+_REVERSED": _SWITCH,
    r"RC\d+_OPTION": Values(-1, 10000, whole=True),
    r"SERVO\d+_FUNCTION": Values(-1, 1000, whole=True),
    r"MOT_\d+_DIRECTION": Values(-1, 1, whole=True),
    r"FRAME_(CLASS|CONFIG|TYPE)": Values(-1, 127, whole=True),
    r"SCHED_LOOP_RATE": Values(10, 10000),
    r"INS_GYRO_FILTER": Values(0, 1000),
    r"(WP|CRUISE)_SPEED": Values(0, 100),
    r"CRUISE_THROTTLE|MOT_THR_(MIN|MAX)|MOT_SPD_SCA_BASE": _PERCENT,
    r"MOT_VEC_ANGLEMAX": Values(0, 90),
    r"MOT_THST_EXPO": Values(-1, 1),
    r"MOT_THST_HOVER": Values(0, 1),
    r"JS_GAIN_\w+": Values(0, 10),
    r"ACRO_YAW_P": Values(0, 100),
    r"(ATC|PSC)_\w+": Values(0, 1e6),
    r"PILOT_(SPEED|SPD|ACCEL|ACC)_\w+": Values(0, 1e5),
}
"""Pattern of whole names -> valid values of such parameters.

The first matching pattern counts. Without a match any finite number is valid. To add a kind, add a line.
"""

_PATTERNS = tuple((re.compile(pattern), values) for pattern, values in VALUES.items())


def checked(name: str, value: float) -> float:
    """Return *value* of the parameter *name*, if plausible.

    Raises
    ------
    PreconditionFailed
        It is implausible; the message states name and value.
    """
    values = next((v for pattern, v in _PATTERNS if pattern.fullmatch(name)), _ANY)
    fault = values.fault(value)
    if fault:
        raise PreconditionFailed(
            f"{name} {fault}. Correct the value on the vehicle or in the parameter file, and try again"
        )
    return value


def checked_all(values: Mapping[str, float]) -> dict[str, float]:
    """Return *values* by name; errors as for :func:`checked`."""
    return {name: checked(name, value) for name, value in values.items()}
