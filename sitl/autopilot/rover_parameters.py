"""ArduRover's own parameters with the firmware's compiled defaults (boat frame)."""

from __future__ import annotations

from sitl.autopilot.parameters import Definition, parse_table
from sitl.autopilot.shared_parameters import shared_parameters

__all__ = ["ROVER_PARAMETERS"]

_OWN = """
ACRO_TURN_RATE    f32 180
ARMING_NEED_LOC   i8  0
ARMING_REQUIRE    i8  1
ATC_ACCEL_MAX     f32 1
ATC_BRAKE         i8  1
ATC_DECEL_MAX     f32 0
ATC_SPEED_D       f32 0
ATC_SPEED_D_FF    f32 0
ATC_SPEED_FF      f32 0
ATC_SPEED_FLTD    f32 0
ATC_SPEED_FLTE    f32 10
ATC_SPEED_FLTT    f32 0
ATC_SPEED_I       f32 0.2
ATC_SPEED_IMAX    f32 1
ATC_SPEED_P       f32 0.2
ATC_SPEED_PDMX    f32 0
ATC_SPEED_SMAX    f32 0
ATC_STOP_SPEED    f32 0.1
ATC_STR_ACC_MAX   f32 120
ATC_STR_ANG_P     f32 2
ATC_STR_DEC_MAX   f32 0
ATC_STR_RAT_D     f32 0
ATC_STR_RAT_D_FF  f32 0
ATC_STR_RAT_FF    f32 0.2
ATC_STR_RAT_FLTD  f32 0
ATC_STR_RAT_FLTE  f32 10
ATC_STR_RAT_FLTT  f32 0
ATC_STR_RAT_I     f32 0.2
ATC_STR_RAT_IMAX  f32 1
ATC_STR_RAT_MAX   f32 120
ATC_STR_RAT_P     f32 0.2
ATC_STR_RAT_PDMX  f32 0
ATC_STR_RAT_SMAX  f32 0
ATC_TURN_MAX_G    f32 0.6
CRUISE_SPEED      f32 2
CRUISE_THROTTLE   i8  50
FORMAT_VERSION    i16 16 ro
FRAME_CLASS       i8  2     # boat: an owner sets it (compiled default: 0)
FRAME_TYPE        i8  0
FS_ACTION         i8  2
FS_EKF_ACTION     i8  1
FS_GCS_ENABLE     i8  0
FS_OPTIONS        i32 0
FS_THR_ENABLE     i8  1
FS_THR_VALUE      i16 910
FS_TIMEOUT        f32 1.5
GUID_OPTIONS      i32 0
INITIAL_MODE      i8  0
LOIT_RADIUS       f32 2
LOIT_SPEED_GAIN   f32 0.5
LOIT_TYPE         i8  0
MIS_DONE_BEHAVE   i8  0
MANUAL_OPTIONS    i32 0
MANUAL_STR_EXPO   f32 0
MODE_CH           i8  8
RCMAP_PITCH       i8  2
RCMAP_ROLL        i8  1
RCMAP_THROTTLE    i8  3
RCMAP_YAW         i8  4
MODE1             i8  0
MODE2             i8  0
MODE3             i8  11
MODE4             i8  10
MODE5             i8  2
MODE6             i8  0
MOT_SLEWRATE      i16 100
MOT_SPD_SCA_BASE  f32 1
MOT_STR_THR_MIX   f32 0.5
MOT_THR_MAX       i8  100
MOT_THR_MIN       i8  0
MOT_THST_ASYM     f32 1
MOT_THST_EXPO     f32 0
MOT_VEC_ANGLEMAX  f32 0
PILOT_STEER_TYPE  i8  0
PSC_POS_P         f32 0.2
PSC_VEL_D         f32 0
PSC_VEL_FF        f32 0
PSC_VEL_FLTD      f32 5
PSC_VEL_FLTE      f32 5
PSC_VEL_I         f32 0
PSC_VEL_IMAX      f32 1
PSC_VEL_P         f32 1
RCMAP_PITCH       i8  2
RCMAP_ROLL        i8  1
RCMAP_THROTTLE    i8  3
RCMAP_YAW         i8  4
RTL_SPEED         f32 0
SAIL_ENABLE       i8  0
SPEED_MAX         f32 0
STICK_MIXING      i8  0
TURN_RADIUS       f32 0.9
WP_ACCEL          f32 0
WP_JERK           f32 0
WP_PIVOT_ANGLE    i16 60
WP_PIVOT_DELAY    f32 0
WP_PIVOT_RATE     i16 60
WP_RADIUS         f32 2
WP_SPEED          f32 2
"""

_OVERRIDES = {"INS_GYRO_FILTER": 4.0, "RC_OPTIONS": 32.0}


def _definitions() -> tuple[Definition, ...]:
    shared = shared_parameters((30, 0, 30, 30, 0, 0, 0, 0), (26, 0, 70, 0, 0, 0, 0, 0), wide={1, 3})
    adapted = (Definition(d.name, d.kind, _OVERRIDES.get(d.name, d.default), d.read_only) for d in shared)
    return (*adapted, *parse_table(_OWN))


ROVER_PARAMETERS = _definitions()
"""Definitions of all parameters of the simulated Rover firmware."""
