"""From ArduRover's throttle to the servo pulse and back: MOT_THR_MIN, MOT_THST_EXPO, MOT_THR_MAX.

Fractions of full throughout. The firmware lifts the throttle over MOT_THR_MIN first and bends it then, so that thrust
``(1 - e) u + e u^2`` of the pulse becomes proportional to the throttle for ``e = MOT_THST_EXPO``.
"""

from __future__ import annotations

import math

from gcs_autotune.design.laws.kernel import shaped_throttle
from gcs_autotune.design.laws.law import Settings, setting

__all__ = ["DEFAULTS", "pulse_of", "throttle_of", "throttle_shape"]

DEFAULTS: Settings = {"MOT_THR_MIN": 0.0, "MOT_THR_MAX": 100.0, "MOT_THST_EXPO": 0.0}


def throttle_shape(settings: Settings) -> tuple[float, float]:
    """Return (least pulse [fraction], expo) in force."""
    return setting(settings, DEFAULTS, "MOT_THR_MIN") / 100.0, setting(settings, DEFAULTS, "MOT_THST_EXPO")


def pulse_of(throttle: float, settings: Settings) -> float:
    """Return the pulse [fraction] that the firmware makes of *throttle* [fraction]."""
    return shaped_throttle(throttle, *throttle_shape(settings))


def throttle_of(pulse: float, settings: Settings) -> float:
    """Return the throttle [fraction] that gives *pulse* [fraction]: the inverse of :func:`pulse_of`."""
    least, expo = throttle_shape(settings)
    size = abs(pulse)
    if expo != 0.0 and -1.0 <= expo <= 1.0:
        size = (1.0 - expo) * size + expo * size * size
    size = max(size - least, 0.0) / max(1.0 - least, 1e-9)
    return math.copysign(size, pulse)
