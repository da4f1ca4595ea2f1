"""ArduRover 4.x: boats (MAV_TYPE 11) and ground rovers (10).

Parameter names and documented ranges: ArduPilot's parameter metadata for Rover 4.5-4.7 (unchanged there). Channels:
RCMAP defaults, steering on 1, throttle on 3. Outputs up to 3.1 ("APM:Rover", "ArduRover v2.46") have the numbers of
these channels, which RCMAP changes too. With SKID_STEER_OUT the left thruster is on the steering channel and the right
one on the throttle channel (ArduRover 2.46 to 3.1, ``mix_skid_steering``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from gcs_autotune.firmware.failsafe import DISARMS, Failsafe
from gcs_autotune.firmware.profile import Axis, Firmware, FixedOutputs, Gain, Unsuited, pid_context

__all__ = ["FIRMWARE"]

_HEADING = Axis(
    name="heading",
    law="rover-heading",
    gains=(
        Gain("ATC_STR_RAT_FF", 0.0, 3.0, "steering output per required turn rate", 0.2),
        Gain("ATC_STR_RAT_P", 0.0, 2.0, "steering output per turn-rate error", 0.2),
        Gain("ATC_STR_RAT_I", 0.0, 2.0, "steering output per accumulated turn-rate error", 0.2),
        Gain("ATC_STR_RAT_D", 0.0, 0.4, "steering output per rate of change of turn-rate error", 0.0),
        Gain("ATC_STR_ANG_P", 1.0, 10.0, "turn rate per heading error", 2.0),
    ),
    context=(
        *pid_context("ATC_STR_RAT"),
        "ATC_STR_RAT_MAX",
        "ATC_STR_ACC_MAX",
        "ATC_STR_DEC_MAX",
        "ATC_TURN_MAX_G",
        "MOT_SPD_SCA_BASE",
        "MOT_VEC_ANGLEMAX",
        "INS_GYRO_FILTER",
        "SCHED_LOOP_RATE",
        "WP_SPEED",
        "CRUISE_SPEED",
        "CRUISE_THROTTLE",
    ),
    needs_speed=True,
)

_YAW = Axis(
    name="yaw",
    law="rover-yaw",
    gains=_HEADING.gains[:4],
    context=(*_HEADING.context, "ATC_STR_ANG_P"),
    needs_speed=True,
)

_SPEED = Axis(
    name="speed",
    law="rover-speed",
    gains=(
        Gain("ATC_SPEED_P", 0.01, 2.0, "throttle per speed error", 0.2),
        Gain("ATC_SPEED_I", 0.0, 2.0, "throttle per accumulated speed error", 0.2),
        Gain("ATC_SPEED_D", 0.0, 0.4, "throttle per rate of change of speed error", 0.0),
        Gain("ATC_SPEED_FF", 0.0, 0.5, "throttle per required speed, added to the cruise throttle", 0.0),
        Gain("CRUISE_SPEED", 0.0, 100.0, "cruise speed, reached at CRUISE_THROTTLE", 2.0),
        Gain("CRUISE_THROTTLE", 0.0, 100.0, "cruise throttle, which gives CRUISE_SPEED", 50.0),
    ),
    context=(
        *pid_context("ATC_SPEED"),
        "ATC_ACCEL_MAX",
        "ATC_DECEL_MAX",
        "ATC_BRAKE",
        "MOT_SLEWRATE",
        "MOT_THR_MAX",
        "MOT_THR_MIN",
        "MOT_THST_EXPO",
        "SCHED_LOOP_RATE",
        "WP_SPEED",
    ),
    needs_speed=True,
)

_UNSUITED = (
    Unsuited(
        "SAIL_ENABLE",
        (1,),
        "a sailboat. Its speed depends on wind and sail trim, not on throttle, so no identified model would be "
        "valid. To tune it under power, lower the sails, set SAIL_ENABLE to 0 and restart the autopilot. Set "
        "SAIL_ENABLE back afterwards",
    ),
    Unsuited(
        "FRAME_TYPE",
        (1, 2, 3, 4),
        "an omni frame (1 Omni3, 2 OmniX, 3 OmniPlus, 4 Omni3Mecanum), which mixes three or four motors to turn and "
        "move sideways. Only a rudder, a vectored thruster, or two thrusters side by side can be tuned. If the "
        "vehicle has another frame, set FRAME_TYPE to 0 and restart the autopilot",
    ),
    Unsuited(
        "FRAME_CLASS",
        (3,),
        "a balance bot, which drives to stay upright, so surge and turn cannot be tested separately. If the vehicle "
        "is another type, set FRAME_CLASS to 2 (boat) or 1 (rover) and restart the autopilot",
    ),
)

_FAILSAFE_ACTIONS: Mapping[int, Sequence[str]] = {
    1: ("RTL",),
    2: ("HOLD",),
    3: ("SMART_RTL", "RTL"),
    4: ("SMART_RTL", "HOLD"),
    5: (DISARMS,),
    6: ("LOITER", "HOLD"),
}
"""FS_ACTION -> resulting mode or state."""
_FAILSAFES = (
    Failsafe(
        "radio failsafe",
        enable=("FS_THR_ENABLE", 1.0),
        waits=(("RC_FS_TIMEOUT", 0.5), ("FS_TIMEOUT", 1.5)),
        action=("FS_ACTION", 2.0),
        outcomes=_FAILSAFE_ACTIONS,
        says="radio failsafe",
        by_overrides=True,
    ),
    Failsafe(
        "ground station failsafe",
        enable=("FS_GCS_ENABLE", 0.0),
        waits=(("FS_GCS_TIMEOUT", 5.0), ("FS_TIMEOUT", 1.5)),
        action=("FS_ACTION", 2.0),
        outcomes=_FAILSAFE_ACTIONS,
        says="failsafe",
    ),
)
"""Failsafes of ArduRover.

Neither acts in HOLD and RTL. The one for the ground station was also observed with the text "Radio Failsafe".
"""

FIRMWARE = Firmware(
    name="ArduRover",
    autopilot=3,
    vehicle_types=(10, 11),
    kind="boat",
    modes={
        "MANUAL": 0,
        "ACRO": 1,
        "STEERING": 3,
        "HOLD": 4,
        "LOITER": 5,
        "FOLLOW": 6,
        "SIMPLE": 7,
        "DOCK": 8,
        "CIRCLE": 9,
        "AUTO": 10,
        "RTL": 11,
        "SMART_RTL": 12,
        "GUIDED": 15,
        "INITIALISING": 16,
    },
    manual_mode="MANUAL",
    rest_mode="HOLD",
    hold_mode="GUIDED",
    mission_mode="AUTO",
    position_mode="GUIDED",
    channels={"N": 1, "X": 3},
    channel_signs={"N": 1.0, "X": 1.0},
    neutral_pwm=1500,
    axes={"heading": _HEADING, "yaw": _YAW, "speed": _SPEED},
    servo_functions={26: "N", 70: "X"},
    skid_functions={73: {"X": 1.0, "N": 1.0}, 74: {"X": 1.0, "N": -1.0}},
    motor_span=500.0,
    manual_dead_zone=True,
    rc_map={"N": "RCMAP_ROLL", "X": "RCMAP_THROTTLE"},
    fixed_outputs=FixedOutputs(
        last=(3, 2),
        skid_parameter="SKID_STEER_OUT",
        skid={"N": 73, "X": 74},
        marks=r"RC\d+_REV|SKID_STEER_(IN|OUT)",
    ),
    unsuited=_UNSUITED,
    failsafes=_FAILSAFES,
    stops_in=("HOLD",),
    needs_way=True,
    floats=True,
    needs_position=True,
)
