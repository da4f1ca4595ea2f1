"""Parameters with several names: their names in different ArduPilot versions, and the conversion of their values.

The *canonical* name is the one used by our laws and axes: that of 4.5 and 4.6, except for the MAVLink system ids.
Sources: "Parameter Name Changes", 4.6 to 4.7 (ardupilot.org, common-param-name-changes), and the control loops and
metadata of ArduPilot 8264a9b4a2 (December 2025, "4.7.0-dev"). That version has the new names PSC_D_*, MAV_* and
ARMING_SKIPCHK, but the old names ATC_ACCEL_Y_MAX, ATC_SLEW_YAW and Sub's PILOT_*. A vehicle usually has a mixture of
old and new names, so every name is resolved separately.

The unit of the acceleration loop changed from throttle per cm/s^2 x 0.001 to throttle per m/s^2. So the factor is 0.1
for all its gains, including FF. ArduPilot's own conversion of stored values (AC_PosControl.cpp, ``convert_parameters``)
leaves FF unscaled. Sub does not run that conversion, so after an update it has the new defaults.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

__all__ = ["ALIASES", "FIXED_OUTPUTS", "Alias"]

_ALL_CHECKS = 1
_CHECK_BITS = (1 << 21) - 2
"""Bits of ARMING_CHECK without the first one, which means all of them."""
_SKIP_ALL = -1


@dataclass(frozen=True, slots=True)
class Alias:
    """Another name of a parameter.

    Attributes
    ----------
    name : the other name.
    scale : value under the other name, divided by the canonical value.
    low, high : range documented under that name, in its own unit; None when it is the canonical one's, scaled.
    inverted_bits : whether the value is a mask of arming checks to skip, while the canonical one has those to run.
    is_sign : whether the value is 1, or -1 for reversed, while the canonical one is 0, or 1 for reversed.
    """

    name: str
    scale: float = 1.0
    low: float | None = None
    high: float | None = None
    inverted_bits: bool = False
    is_sign: bool = False

    def to_own(self, value: float) -> float:
        """Return the value under this name for the canonical *value*."""
        if self.is_sign:
            return -1.0 if value else 1.0
        return _skipped(int(value)) if self.inverted_bits else value * self.scale

    def to_canonical(self, value: float) -> float:
        """Return the canonical value for *value* under this name."""
        if self.is_sign:
            return float(value < 0.0)
        return _run(int(value)) if self.inverted_bits else value / self.scale


def _skipped(checks: int) -> float:
    if checks == 0:
        return float(_SKIP_ALL)
    return 0.0 if checks & _ALL_CHECKS else float(~checks & _CHECK_BITS)


def _run(skipped: int) -> float:
    if skipped == _SKIP_ALL:
        return 0.0
    return float(_ALL_CHECKS) if skipped == 0 else float(~skipped & _CHECK_BITS)


ALIASES: Mapping[str, tuple[Alias, ...]] = {
    "PSC_POSZ_P": (Alias("PSC_D_POS_P", low=0.5, high=4.0),),
    "PSC_VELZ_P": (Alias("PSC_D_VEL_P", low=1.0, high=10.0),),
    "PSC_VELZ_I": (Alias("PSC_D_VEL_I", low=0.0, high=10.0),),
    "PSC_VELZ_D": (Alias("PSC_D_VEL_D", low=0.0, high=2.0),),
    "PSC_VELZ_FF": (Alias("PSC_D_VEL_FF", low=0.0, high=2.0),),
    "PSC_VELZ_IMAX": (Alias("PSC_D_VEL_IMAX", 0.01),),
    "PSC_VELZ_FLTE": (Alias("PSC_D_VEL_FLTE"),),
    "PSC_VELZ_FLTD": (Alias("PSC_D_VEL_FLTD"),),
    "PSC_ACCZ_P": (Alias("PSC_D_ACC_P", 0.1, 0.01, 0.25),),
    "PSC_ACCZ_I": (Alias("PSC_D_ACC_I", 0.1, 0.0, 0.5),),
    "PSC_ACCZ_D": (Alias("PSC_D_ACC_D", 0.1, 0.0, 0.1),),
    "PSC_ACCZ_FF": (Alias("PSC_D_ACC_FF", 0.1, 0.0, 0.1),),
    "PSC_ACCZ_D_FF": (Alias("PSC_D_ACC_D_FF", 0.1, 0.0, 0.05),),
    "PSC_ACCZ_IMAX": (Alias("PSC_D_ACC_IMAX", 0.001),),
    "PSC_ACCZ_FLTT": (Alias("PSC_D_ACC_FLTT"),),
    "PSC_ACCZ_FLTE": (Alias("PSC_D_ACC_FLTE"),),
    "PSC_ACCZ_FLTD": (Alias("PSC_D_ACC_FLTD"),),
    "PSC_JERK_Z": (Alias("PSC_JERK_D"),),
    "PSC_POSXY_P": (Alias("PSC_NE_POS_P"),),
    "PSC_VELXY_P": (Alias("PSC_NE_VEL_P"),),
    "PSC_VELXY_I": (Alias("PSC_NE_VEL_I"),),
    "PSC_VELXY_D": (Alias("PSC_NE_VEL_D"),),
    "PSC_VELXY_FLTE": (Alias("PSC_NE_VEL_FLTE"),),
    "PSC_JERK_XY": (Alias("PSC_JERK_NE"),),
    "ATC_ACCEL_R_MAX": (Alias("ATC_ACC_R_MAX", 0.01),),
    "ATC_ACCEL_P_MAX": (Alias("ATC_ACC_P_MAX", 0.01),),
    "ATC_ACCEL_Y_MAX": (Alias("ATC_ACC_Y_MAX", 0.01),),
    "ATC_SLEW_YAW": (Alias("ATC_RATE_WPY_MAX", 0.01),),
    "ANGLE_MAX": (Alias("ATC_ANGLE_MAX", 0.01),),
    "PILOT_SPEED_UP": (Alias("PILOT_SPD_UP", 0.01),),
    "PILOT_SPEED_DN": (Alias("PILOT_SPD_DN", 0.01),),
    "PILOT_ACCEL_Z": (Alias("PILOT_ACC_Z", 0.01),),
    "MAV_GCS_SYSID": (Alias("SYSID_MYGCS"),),
    "MAV_SYSID": (Alias("SYSID_THISMAV"),),
    "ARMING_CHECK": (Alias("ARMING_SKIPCHK", inverted_bits=True),),
}
"""Canonical name -> its other names. To add a name, add a line."""

FIXED_OUTPUTS: Mapping[str, tuple[Alias, float]] = {
    "SERVO{n}_FUNCTION": (Alias("RC{n}_FUNCTION"), 0.0),
    "SERVO{n}_MIN": (Alias("RC{n}_MIN"), 1100.0),
    "SERVO{n}_TRIM": (Alias("RC{n}_TRIM"), 1500.0),
    "SERVO{n}_MAX": (Alias("RC{n}_MAX"), 1900.0),
    "SERVO{n}_REVERSED": (Alias("RC{n}_REV", is_sign=True), 1.0),
}
"""Canonical name of output n -> its name before SERVOn_FUNCTION, with the default value of that time.

Output n then used the limits of RC channel n (RC_Channel of ArduRover 2.4 to 3.1).
"""
