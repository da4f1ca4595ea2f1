"""ArduSub 4.x (MAV_TYPE 12).

Before 4.7, which added RCMAP_*, the throttle stick ranges from RC3_TRIM, 1100 us, to RC3_MAX, with neutral half-way.
Parameter names and documented ranges: ArduPilot's parameter metadata for Sub 4.5-4.6; later names and their ranges:
``aliases``. ``ATC_RAT_YAW_FF`` is omitted because Sub reads it but never uses it. Motor factors per frame are ArduSub's
own (AP_Motors6DOF). Z is down here but ArduSub's throttle factor is up, so its sign is reversed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from gcs_autotune.firmware.failsafe import DISARMS, Failsafe
from gcs_autotune.firmware.profile import Axis, Firmware, Gain, pid_context

__all__ = ["FIRMWARE"]

_HEADING = Axis(
    name="heading",
    law="sub-heading",
    gains=(
        Gain("ATC_RAT_YAW_P", 0.0, 0.5, "yaw output per yaw-rate error", 0.18),
        Gain("ATC_RAT_YAW_I", 0.0, 0.05, "yaw output per accumulated yaw-rate error", 0.018),
        Gain("ATC_RAT_YAW_D", 0.0, 0.02, "yaw output per rate of change of yaw-rate error", 0.0),
        Gain("ATC_ANG_YAW_P", 0.0, 6.0, "yaw rate per heading error", 6.0),
    ),
    context=(
        *pid_context("ATC_RAT_YAW"),
        "ATC_ACCEL_Y_MAX",
        "ATC_RATE_Y_MAX",
        "ATC_SLEW_YAW",
        "ATC_INPUT_TC",
        "ATC_RATE_FF_ENAB",
        "INS_GYRO_FILTER",
        "SCHED_LOOP_RATE",
    ),
)

_YAW = Axis(
    name="yaw",
    law="sub-yaw",
    gains=(*_HEADING.gains[:3], Gain("ATC_ANG_YAW_P", 1.0, 6.0, "yaw rate per heading error", 6.0)),
    context=tuple(name for name in _HEADING.context if name not in ("ATC_SLEW_YAW", "ATC_INPUT_TC")),
)


def _tilt(name: str, three: str, one: str) -> Axis:
    """Return the loop of roll or pitch, whose parameters contain the letters *three* (gains) and *one* (limits)."""
    return Axis(
        name=name,
        law=f"sub-{name}",
        gains=(
            Gain(f"ATC_RAT_{three}_P", 0.0, 0.3, f"{name} output per {name}-rate error", 0.135),
            Gain(f"ATC_RAT_{three}_I", 0.0, 0.5, f"{name} output per accumulated {name}-rate error", 0.09),
            Gain(f"ATC_RAT_{three}_D", 0.0, 0.02, f"{name} output per rate of change of {name}-rate error", 0.0036),
            Gain(f"ATC_ANG_{three}_P", 3.0, 12.0, f"{name} rate per {name} error", 6.0),
        ),
        context=(
            *pid_context(f"ATC_RAT_{three}"),
            f"ATC_ACCEL_{one}_MAX",
            f"ATC_RATE_{one}_MAX",
            "ATC_INPUT_TC",
            "ATC_RATE_FF_ENAB",
            "INS_GYRO_FILTER",
            "SCHED_LOOP_RATE",
        ),
    )


_DEPTH = Axis(
    name="depth",
    law="sub-depth",
    gains=(
        Gain("PSC_POSZ_P", 1.0, 3.0, "climb rate per depth error", 3.0),
        Gain("PSC_VELZ_P", 1.0, 8.0, "acceleration per climb-rate error", 8.0),
        Gain("PSC_VELZ_I", 0.0, 1.0, "acceleration per accumulated climb-rate error", 0.0),
        Gain("PSC_ACCZ_P", 0.2, 1.5, "throttle per acceleration error", 0.5),
        Gain("PSC_ACCZ_I", 0.0, 3.0, "throttle per accumulated acceleration error", 0.1),
        Gain("PSC_ACCZ_FF", 0.0, 0.5, "throttle per required acceleration", 0.0),
    ),
    context=(
        "PSC_VELZ_IMAX",
        "PSC_VELZ_FLTE",
        "PSC_ACCZ_D",
        "PSC_ACCZ_IMAX",
        "PSC_ACCZ_FLTT",
        "PSC_ACCZ_FLTE",
        "MOT_THST_HOVER",
        "PILOT_SPEED_UP",
        "PILOT_SPEED_DN",
        "PILOT_ACCEL_Z",
        "SCHED_LOOP_RATE",
        "SURFACE_MAX_THR",
    ),
)


def _motor(
    roll: float = 0.0,
    pitch: float = 0.0,
    yaw: float = 0.0,
    throttle: float = 0.0,
    forward: float = 0.0,
    side: float = 0.0,
) -> Mapping[str, float]:
    """Return a motor's factor for each force from ArduSub's columns."""
    return {"K": roll, "M": pitch, "N": yaw, "X": forward, "Y": side, "Z": -throttle}


_VECTORED_PLANE = (
    _motor(yaw=1, forward=-1, side=1),
    _motor(yaw=-1, forward=-1, side=-1),
    _motor(yaw=-1, forward=1, side=1),
    _motor(yaw=1, forward=1, side=-1),
)
_SIDE_BY_SIDE = (_motor(yaw=-1, forward=1), _motor(yaw=1, forward=1))
_SIMPLE_3 = (*_SIDE_BY_SIDE, _motor(throttle=-1))
_SIMPLE_5 = (*_SIDE_BY_SIDE, _motor(roll=1, throttle=-1), _motor(roll=-1, throttle=-1), _motor(side=1))

_FRAMES: Mapping[int, Sequence[Mapping[str, float]]] = {
    0: (
        *_SIDE_BY_SIDE,
        _motor(roll=-0.5, pitch=0.5, throttle=0.45),
        _motor(roll=0.5, pitch=0.5, throttle=0.45),
        _motor(pitch=-1, throttle=1),
        _motor(roll=-0.25, side=1),
    ),
    1: (*_VECTORED_PLANE, _motor(roll=1, throttle=-1), _motor(roll=-1, throttle=-1)),
    2: (
        *_VECTORED_PLANE,
        _motor(roll=1, pitch=-1, throttle=-1),
        _motor(roll=-1, pitch=-1, throttle=-1),
        _motor(roll=1, pitch=1, throttle=-1),
        _motor(roll=-1, pitch=1, throttle=-1),
    ),
    3: (
        _motor(roll=1, pitch=1, throttle=1),
        _motor(yaw=1, forward=1),
        _motor(roll=1, pitch=-1, throttle=1),
        _motor(side=1),
        _motor(side=1),
        _motor(roll=-1, pitch=1, throttle=1),
        _motor(yaw=-1, forward=1),
        _motor(roll=-1, pitch=-1, throttle=1),
    ),
    4: _SIMPLE_3,
    5: _SIMPLE_5,
    6: _SIMPLE_5,
    7: _SIMPLE_3,
}
"""FRAME_CONFIG -> factors of each motor output, in order.

0 BlueROV1, 1 vectored, 2 vectored 6-DOF, 3 vectored 6-DOF with thrusters at right angles, 4 to 6 SimpleROV-3 to -5 (-4
and -5 are the same for the firmware), 7 custom, which in an unmodified firmware is SimpleROV-3. Roll and pitch are
included because the autopilot levels the craft with the vertical motors.
"""

_FAILSAFES = (
    Failsafe(
        "pilot input failsafe",
        enable=("FS_PILOT_INPUT", 0.0),
        waits=(("FS_PILOT_TIMEOUT", 3.0),),
        action=("FS_PILOT_INPUT", 0.0),
        outcomes={2: (DISARMS,)},
        says="lost manual control",
        by_overrides=True,
    ),
    Failsafe(
        "ground station failsafe",
        enable=("FS_GCS_ENABLE", 0.0),
        waits=(("FS_GCS_TIMEOUT", 3.0),),
        action=("FS_GCS_ENABLE", 0.0),
        outcomes={2: (DISARMS,), 3: ("ALT_HOLD",), 4: ("SURFACE", "ALT_HOLD")},
        says="heartbeat lost",
    ),
)

FIRMWARE = Firmware(
    name="ArduSub",
    autopilot=3,
    vehicle_types=(12,),
    kind="rov",
    modes={
        "STABILIZE": 0,
        "ACRO": 1,
        "ALT_HOLD": 2,
        "AUTO": 3,
        "GUIDED": 4,
        "CIRCLE": 7,
        "SURFACE": 9,
        "POSHOLD": 16,
        "MANUAL": 19,
        "MOTOR_DETECT": 20,
        "SURFTRAK": 21,
    },
    manual_mode="MANUAL",
    rest_mode="MANUAL",
    hold_mode="ALT_HOLD",
    position_mode="GUIDED",
    push_mode="POSHOLD",
    channels={"Z": 3, "N": 4, "X": 5, "Y": 6, "K": 2, "M": 1},
    channel_signs={"Z": -1.0, "N": 1.0, "X": 1.0, "Y": 1.0, "K": 1.0, "M": 1.0},
    neutral_pwm=1500,
    axes={
        "heading": _HEADING,
        "yaw": _YAW,
        "depth": _DEPTH,
        "roll": _tilt("roll", "RLL", "R"),
        "pitch": _tilt("pitch", "PIT", "P"),
    },
    frame_parameter="FRAME_CONFIG",
    mixing=_FRAMES,
    motor_span=400.0,
    rc_map={
        "Z": "RCMAP_THROTTLE",
        "N": "RCMAP_YAW",
        "X": "RCMAP_FORWARD",
        "Y": "RCMAP_LATERAL",
        "K": "RCMAP_ROLL",
        "M": "RCMAP_PITCH",
    },
    levelling=("K", "M"),
    from_one_end=("Z",),
    failsafes=_FAILSAFES,
    boots_in=("INITIAL_MODE", 19.0),
    holds_itself=True,
    turns_by_stick=True,
)
