"""Parameters of both firmwares. Values are ArduPilot's defaults as read from a running one; names are those of
4.7-dev.

Parameters without a counterpart in this simulator are only stored and reported. ``SIM_RC_FAIL 1`` is a project choice:
a craft without an RC receiver, controlled only from the ground station.
"""

from __future__ import annotations

from collections.abc import Container, Sequence

from sitl.autopilot.parameters import Definition, parse_table

__all__ = ["shared_parameters"]

_TABLE = """
AHRS_EKF_TYPE     i8  3
AHRS_ORIENTATION  i8  0
ARMING_ACCTHRESH  f32 0.75
ARMING_CHECK      i32 1
ARMING_MAGTHRESH  i16 100
ARMING_MIS_ITEMS  i32 0
ARMING_OPTIONS    i32 0
BATT_AMP_OFFSET   f32 0
BATT_AMP_PERVLT   f32 17
BATT_ARM_MAH      i32 0
BATT_ARM_VOLT     f32 0
BATT_CAPACITY     i32 20000   # Chosen: room for a long rehearsal (ArduPilot: 3300)
BATT_CRT_MAH      f32 0
BATT_CRT_VOLT     f32 0
BATT_FS_CRT_ACT   i8  0
BATT_FS_LOW_ACT   i8  0
BATT_FS_VOLTSRC   i8  0
BATT_LOW_MAH      f32 0
BATT_LOW_TIMER    i8  10
BATT_LOW_VOLT     f32 0
BATT_MONITOR      i8  4
BATT_VOLT_MULT    f32 10.1
COMPASS_DEC       f32 0
COMPASS_ENABLE    i8  1
COMPASS_LEARN     i8  0
COMPASS_USE       i8  1
EK3_ENABLE        i8  1
FENCE_ENABLE      i8  0
FENCE_RADIUS      f32 300
FENCE_TYPE        i8  6
FS_CRASH_CHECK    i8  0
FS_EKF_THRESH     f32 0.8
FS_GCS_TIMEOUT    f32 5
GCS_PID_MASK      i16 0
GPS1_TYPE         i8  1
INS_ACCEL_FILTER  i16 10
INS_GYRO_FILTER   i16 20
LOG_BACKEND_TYPE  i8  1
LOG_DISARMED      i8  0
MAV_GCS_SYSID     i16 255
MAV_OPTIONS       i16 0
MAV_SYSID         i16 1
MAV_TELEM_DELAY   i8  0
MIS_OPTIONS       i16 0
MIS_RESTART       i8  0
MOT_PWM_TYPE      i8  0
MOT_SAFE_DISARM   i8  0
RC_FS_TIMEOUT     f32 1
RC_OPTIONS        i32 0
RC_OVERRIDE_TIME  f32 3
RC_PROTOCOLS      i32 1
SCHED_DEBUG       i8  0
SCHED_LOOP_RATE   i16 50 ro   # acts at boot only, as on a real one; see loop_rate
SCHED_OPTIONS     i8  0
SCR_DIR_DISABLE   i16 0
SCR_ENABLE        i8  0      # acts at boot only
SCR_HEAP_SIZE     i32 204800
SCR_USER1         f32 0
SCR_USER2         f32 0
SCR_USER3         f32 0
SCR_USER4         f32 0
SCR_USER5         f32 0
SCR_USER6         f32 0
SIM_BATT_VOLTAGE  f32 12.6
SIM_RC_FAIL       i8  1
STAT_BOOTCNT      i16 1 ro
STAT_RUNTIME      i32 0 ro
"""

_CHANNEL = """
RC{n}_DZ          i16 {dz}
RC{n}_MAX         i16 {high}
RC{n}_MIN         i16 {low}
RC{n}_OPTION      i16 0
RC{n}_REVERSED    i8  0
RC{n}_TRIM        i16 1500
SERVO{n}_FUNCTION i16 {function}
SERVO{n}_MAX      i16 {high}
SERVO{n}_MIN      i16 {low}
SERVO{n}_REVERSED i8  0
SERVO{n}_TRIM     i16 1500
"""


def shared_parameters(
    dead_zones: Sequence[int], functions: Sequence[int], wide: Container[int]
) -> tuple[Definition, ...]:
    """Return the definitions of the parameters of both firmwares, with these dead zones and servo functions of channels
    1 to 8.

    Channels in *wide* range from 1000 to 2000 us, the others from 1100 to 1900 us.
    """
    rows = [_TABLE]
    for n, (dz, function) in enumerate(zip(dead_zones, functions, strict=True), start=1):
        low, high = (1000, 2000) if n in wide else (1100, 1900)
        rows.append(_CHANNEL.format(n=n, dz=dz, function=function, low=low, high=high))
    return parse_table("".join(rows))
