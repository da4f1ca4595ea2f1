"""Published tuning rules. Gains have canonical names (:mod:`gcs_autotune.firmware`)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from gcs_autotune.design.laws.sub_depth import OUTPUT

__all__ = ["Cycle", "quiktune", "ziegler_nichols"]

_SPEED_SCALING_BASE = 1.0
"""MOT_SPD_SCA_BASE [m/s]."""


@dataclass(frozen=True, slots=True)
class Cycle:
    """A relay's limit cycle: normalised output, amplitude and hysteresis [rad or m], frequency [rad/s]."""

    output: float
    amplitude: float
    hysteresis: float
    omega: float

    @property
    def ultimate(self) -> tuple[float, float]:
        """Return ultimate gain [1/rad or 1/m] and period [s], by the relay's describing function."""
        across = math.sqrt(max(self.amplitude**2 - self.hysteresis**2, 1e-12))
        return 4.0 * self.output / (math.pi * across), math.tau / self.omega


def quiktune(ratio: float, gyro_filter: float) -> dict[str, float]:
    """Return the gains of ArduPilot's rover-quicktune: FF = 0.9 of the measured ratio [s], P = I = 0.5 FF, filters."""
    ff = 0.9 * ratio
    return {
        "ATC_STR_RAT_FF": ff,
        "ATC_STR_RAT_P": 0.5 * ff,
        "ATC_STR_RAT_I": 0.5 * ff,
        "ATC_STR_RAT_FLTT": 0.5 * gyro_filter,
        "ATC_STR_RAT_FLTD": 0.5 * gyro_filter,
    }


def ziegler_nichols(law: str, cycle: Cycle, speed: float, present: Mapping[str, float]) -> dict[str, float]:
    """Return ArduPilot's gains with which its cascade is the classic Ziegler-Nichols PID (0.6 Ku, Tu/2, Tu/8).

    Heading: u = P (A e - r) + I int(A e - r) is a PID with Kp = P A + I, Ki = I A, Kd = P; no feed-forward. A boat's
    output is scaled by MOT_SPD_SCA_BASE/V, so its Ku is that of the servo times V over it. Depth: the climb-rate gain
    stays; position and acceleration gains give the PID (a fifth of them per m/s^2).
    """
    ku, tu = cycle.ultimate
    if law == "rover-heading":
        ku *= max(speed, _SPEED_SCALING_BASE) / _SPEED_SCALING_BASE
    kp = 0.6 * ku
    if law == "sub-depth":
        B = present["PSC_VELZ_P"]
        e = 1.0 + 2.0 / (tu * B)
        A = 4.0 / tu * (e + math.sqrt(e * e - 1.0))
        i = 2.0 * kp / (tu * B * A)
        p = max(kp * tu / 8.0 - i, 0.0) / B
        return {"PSC_POSZ_P": A, "PSC_ACCZ_P": p / OUTPUT, "PSC_ACCZ_I": i / OUTPUT, "PSC_ACCZ_FF": 0.0}
    rate_p, rate_i, angle_p = kp * tu / 8.0, 0.5 * kp, 4.0 / tu
    if law == "rover-heading":
        return {"ATC_STR_RAT_FF": 0.0, "ATC_STR_RAT_P": rate_p, "ATC_STR_RAT_I": rate_i, "ATC_STR_ANG_P": angle_p}
    return {"ATC_RAT_YAW_P": rate_p, "ATC_RAT_YAW_I": rate_i, "ATC_ANG_YAW_P": angle_p}
