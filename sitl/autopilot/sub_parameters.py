"""ArduSub's own parameters with the firmware's compiled defaults."""

from __future__ import annotations

from sitl.autopilot.parameters import Definition, parse_table
from sitl.autopilot.shared_parameters import shared_parameters

__all__ = ["SUB_PARAMETERS"]

_OWN = """
ACRO_BAL_PITCH    f32 1
ACRO_BAL_ROLL     f32 1
ACRO_EXPO         f32 0.3
ACRO_RP_P         f32 4.5
ACRO_YAW_P        f32 3.375
ANGLE_MAX         i16 4500
ATC_ACCEL_P_MAX   f32 110000
ATC_ACCEL_R_MAX   f32 110000
ATC_ACCEL_Y_MAX   f32 110000
ATC_ANGLE_BOOST   i8  1
ATC_ANG_PIT_P     f32 6
ATC_ANG_RLL_P     f32 6
ATC_ANG_YAW_P     f32 6
ATC_INPUT_TC      f32 0.15
ATC_RATE_FF_ENAB  i8  1
ATC_RATE_P_MAX    f32 0
ATC_RATE_R_MAX    f32 0
ATC_RATE_Y_MAX    f32 180
ATC_RAT_PIT_D     f32 0.0036
ATC_RAT_PIT_I     f32 0.09
ATC_RAT_PIT_IMAX  f32 0.444
ATC_RAT_PIT_P     f32 0.135
ATC_RAT_RLL_D     f32 0.0036
ATC_RAT_RLL_I     f32 0.09
ATC_RAT_RLL_IMAX  f32 0.444
ATC_RAT_RLL_P     f32 0.135
ATC_RAT_YAW_D     f32 0
ATC_RAT_YAW_D_FF  f32 0
ATC_RAT_YAW_FF    f32 0     # read and never used by this firmware
ATC_RAT_YAW_FLTD  f32 5
ATC_RAT_YAW_FLTE  f32 0
ATC_RAT_YAW_FLTT  f32 5
ATC_RAT_YAW_I     f32 0.018
ATC_RAT_YAW_IMAX  f32 0.222
ATC_RAT_YAW_P     f32 0.18
ATC_RAT_YAW_PDMX  f32 0
ATC_RAT_YAW_SMAX  f32 0
ATC_SLEW_YAW      f32 6000
BARO_SPEC_GRAV    f32 1
FLTMODE1          i8  19
FLTMODE2          i8  19
FLTMODE3          i8  0
FLTMODE4          i8  0
FLTMODE5          i8  9
FLTMODE6          i8  9
FORMAT_VERSION    i16 1 ro
FRAME_CONFIG      i8  1
FS_EKF_ACTION     i8  0
FS_GCS_ENABLE     i8  2
FS_LEAK_ENABLE    i8  1
FS_PILOT_INPUT    i8  2
FS_PILOT_TIMEOUT  f32 3
FS_PRESS_ENABLE   i8  0
FS_PRESS_MAX      i32 105000
FS_TEMP_ENABLE    i8  0
FS_TEMP_MAX       i8  62
FS_TERRAIN_ENAB   i8  0
FS_THR_ENABLE     i8  0
FS_THR_VALUE      i16 975
JS_GAIN_DEFAULT   f32 0.5
JS_GAIN_MAX       f32 1
JS_GAIN_MIN       f32 0.25
JS_GAIN_STEPS     i8  4
JS_THR_GAIN       f32 1
MOT_1_DIRECTION   i8  1
MOT_2_DIRECTION   i8  1
MOT_3_DIRECTION   i8  1
MOT_4_DIRECTION   i8  1
MOT_5_DIRECTION   i8  1
MOT_6_DIRECTION   i8  1
MOT_7_DIRECTION   i8  1
MOT_8_DIRECTION   i8  1
MOT_FV_CPLNG_K    f32 1
MOT_PWM_MAX       i16 1900
MOT_PWM_MIN       i16 1100
MOT_THST_HOVER    f32 0.5
PILOT_ACCEL_Z     i16 200
PILOT_SPEED       i16 200
PILOT_SPEED_DN    i16 0
PILOT_SPEED_UP    i16 200
PILOT_THR_FILT    f32 0
PSC_ACCZ_D        f32 0
PSC_ACCZ_D_FF     f32 0
PSC_ACCZ_FF       f32 0
PSC_ACCZ_FLTD     f32 0
PSC_ACCZ_FLTE     f32 20
PSC_ACCZ_FLTT     f32 0
PSC_ACCZ_I        f32 0.1
PSC_ACCZ_IMAX     f32 100
PSC_ACCZ_P        f32 0.5
PSC_ACCZ_PDMX     f32 0
PSC_ACCZ_SMAX     f32 0
PSC_JERK_XY       f32 5
PSC_JERK_Z        f32 8
PSC_POSXY_P       f32 1
PSC_POSZ_P        f32 3
PSC_VELXY_D       f32 0
PSC_VELXY_FF      f32 0
PSC_VELXY_FLTD    f32 5
PSC_VELXY_FLTE    f32 5
PSC_VELXY_I       f32 0.5
PSC_VELXY_IMAX    f32 1000
PSC_VELXY_P       f32 6
PSC_VELZ_D        f32 0
PSC_VELZ_FF       f32 0
PSC_VELZ_FLTD     f32 5
PSC_VELZ_FLTE     f32 5
PSC_VELZ_I        f32 0
PSC_VELZ_IMAX     f32 1000
PSC_VELZ_P        f32 8
RCMAP_FORWARD     i8  5
RCMAP_LATERAL     i8  6
RCMAP_PITCH       i8  1
RCMAP_ROLL        i8  2
RCMAP_THROTTLE    i8  3
RCMAP_YAW         i8  4
RC_SPEED          i16 200
SURFACE_DEPTH     f32 -10
SURFACE_MAX_THR   f32 0.1
THR_DZ            i16 100
WPNAV_ACCEL       f32 250
WPNAV_ACCEL_Z     f32 100
WPNAV_JERK        f32 1
WPNAV_RADIUS      f32 200
WPNAV_SPEED       f32 100
WPNAV_SPEED_DN    f32 150
WPNAV_SPEED_UP    f32 250
WP_YAW_BEHAVIOR   i8  4
XTRACK_ANG_LIM    i16 45
"""

_OVERRIDES = {"ARMING_CHECK": 448.0, "INS_ACCEL_FILTER": 20.0, "SCHED_LOOP_RATE": 400.0}


def _definitions() -> tuple[Definition, ...]:
    shared = shared_parameters((30, 30, 30, 40, 30, 30, 0, 0), (33, 34, 35, 36, 37, 38, 0, 0), wide=())
    adapted = (Definition(d.name, d.kind, _OVERRIDES.get(d.name, d.default), d.read_only) for d in shared)
    return (*adapted, *parse_table(_OWN))


SUB_PARAMETERS = _definitions()
"""Definitions of all parameters of the simulated Sub firmware."""
