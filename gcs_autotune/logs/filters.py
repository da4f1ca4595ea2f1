"""Which channels of a run the autopilot has filtered before it told them, and how much later that makes them.

ArduPilot low-passes the gyro (``INS_GYRO_FILTER``, a second-order Butterworth filter) before ATTITUDE.yawspeed, RATE
and IMU see it; the attitude itself is integrated from samples that are not filtered. At ArduRover's 4 Hz the rate lags
by about 50 ms, which a heading loop of a second's period sees.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

__all__ = ["filters_of"]

PARAMETER = "INS_GYRO_FILTER"
RATES = ("p", "q", "r")


def filters_of(parameters: Mapping[str, float], sources: Mapping[str, str]) -> dict[str, dict[str, Any]]:
    """Return channel -> ``parameter cutoff_hz order delay_s bias_removed`` of each rate in *sources*, if that is known.

    ``delay_s`` [s] is the delay of slow signals, sqrt(2) / (2 pi cutoff); ``bias_removed`` says whether the estimator's
    gyro bias has been taken off.
    """
    cutoff = parameters.get(PARAMETER, 0.0)
    if cutoff <= 0.0:
        return {}
    delay = math.sqrt(2.0) / (2.0 * math.pi * cutoff)
    row = {"parameter": PARAMETER, "cutoff_hz": cutoff, "order": 2, "delay_s": round(delay, 6)}
    return {name: {**row, "bias_removed": sources[name] != "imu"} for name in RATES if name in sources}
