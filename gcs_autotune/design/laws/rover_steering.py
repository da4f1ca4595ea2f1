"""ArduRover's steering controller, common to its heading and turn-rate laws: speed scaling, limits, PID.

``servo = scale * (FF rT + P e + I int(e) + D de/dt)``. ``scale`` is ``MOT_SPD_SCA_BASE/V`` at speeds above
MOT_SPD_SCA_BASE and 1 below. At or below that speed the integral cannot grow. The steering of a boat with two thrusters
is not scaled. Vectored thrust is scaled by the throttle.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from gcs_autotune.design.laws.kernel import Cascade
from gcs_autotune.design.laws.law import SKID, THROTTLE, Settings, setting
from gcs_autotune.design.open_loop import Rational, pid_path
from gcs_autotune.models import SingleDof

__all__ = [
    "DEFAULTS",
    "FIXED",
    "GYRO",
    "cascade",
    "ideal_feed_forward",
    "integral_grows",
    "is_skid",
    "matching_speed",
    "most_feed_forward",
    "scale",
    "speed_notes",
    "steering_pid",
    "turn_limit",
    "vectored_angle",
]

FF, P, I, D = "ATC_STR_RAT_FF", "ATC_STR_RAT_P", "ATC_STR_RAT_I", "ATC_STR_RAT_D"  # noqa: E741 - the integral gain
GYRO = "INS_GYRO_FILTER"
FIXED: Settings = {D: 0.0}
DEFAULTS: Settings = {
    "ATC_STR_RAT_IMAX": 1.0,
    "ATC_STR_RAT_FLTT": 0.0,
    "ATC_STR_RAT_FLTE": 10.0,
    "ATC_STR_RAT_FLTD": 0.0,
    "ATC_STR_RAT_MAX": 120.0,
    "ATC_STR_ACC_MAX": 120.0,
    "ATC_STR_DEC_MAX": 0.0,
    "ATC_TURN_MAX_G": 0.6,
    "MOT_SPD_SCA_BASE": 1.0,
    "MOT_VEC_ANGLEMAX": 0.0,
    "CRUISE_SPEED": 2.0,
    "CRUISE_THROTTLE": 50.0,
    "INS_GYRO_FILTER": 4.0,
    "SCHED_LOOP_RATE": 50.0,
}
"""Name -> firmware default of the controller's parameters other than its gains."""
GRAVITY = 9.80665
JUST_ABOVE = 1.0 + 1e-9
MIN_THROTTLE = 0.05
"""Least throttle that is assumed with vectored thrust [fraction].

Project choice: at less throttle there would be almost no steering to tune.
"""
MAX_FEED = 1.3
"""Largest feed-forward, relative to that of the model. Project choice.

On a craft with a fast response, a larger feed-forward with a smaller ATC_STR_ANG_P gives an equal heading step. Turn
rates in other modes would then exceed their command.
"""


def _get(settings: Settings, name: str) -> float:
    return setting(settings, DEFAULTS, name)


def is_skid(settings: Settings) -> bool:
    """Return whether the boat steers by the difference of two thrusters.

    The steering is then not scaled with speed, and its integral is never frozen.
    """
    return settings.get(SKID, 0.0) > 0.0


def _beside(settings: Settings) -> float:
    """Return the throttle that two thrusters drive with while they steer; 0 if it does not reduce the steering."""
    return min(max(settings.get(THROTTLE, 0.0), 0.0), 1.0) if is_skid(settings) else 0.0


def scale(settings: Settings, speed: float | None) -> float:
    """Return the factor from controller output to servo at *speed* [m/s].

    With vectored thrust the servo is at ``atan(output / throttle)`` of MOT_VEC_ANGLEMAX. The factor is then the slope
    of this function at the throttle of the experiment. If that throttle is unknown, CRUISE_THROTTLE and CRUISE_SPEED
    yield the throttle for *speed*.
    """
    if is_skid(settings):
        return 1.0
    widest = vectored_angle(settings)
    if widest > 0.0:
        return 1.0 / (_throttle(settings, speed) * widest)
    base = _get(settings, "MOT_SPD_SCA_BASE")
    return base / speed if speed is not None and speed > base > 0.0 else 1.0


def vectored_angle(settings: Settings) -> float:
    """Return the angle [rad] to which full steering turns the thrust, or 0 for a boat with a rudder."""
    return math.radians(min(max(_get(settings, "MOT_VEC_ANGLEMAX"), 0.0), 90.0))


def _throttle(settings: Settings, speed: float | None) -> float:
    flown = settings.get(THROTTLE, 0.0)
    if flown > 0.0:
        return min(max(flown, MIN_THROTTLE), 1.0)
    cruise = _get(settings, "CRUISE_SPEED")
    share = 1.0 if speed is None or cruise <= 0.0 else speed / cruise
    return min(max(_get(settings, "CRUISE_THROTTLE") / 100.0 * share, MIN_THROTTLE), 1.0)


def integral_grows(settings: Settings, speed: float | None) -> bool:
    """Return whether the integral term can grow at *speed* [m/s]. It cannot grow at or below MOT_SPD_SCA_BASE."""
    if is_skid(settings) or vectored_angle(settings) > 0.0:
        return True
    return speed is None or speed > _get(settings, "MOT_SPD_SCA_BASE") > 0.0


def matching_speed(settings: Settings, speed: float | None) -> float | None:
    """Return *speed*, or a speed just above MOT_SPD_SCA_BASE.

    There the scale is the same as below, but the integral acts.
    """
    if speed is None or is_skid(settings):
        return speed
    return max(speed, JUST_ABOVE * _get(settings, "MOT_SPD_SCA_BASE"))


def turn_limit(settings: Settings, speed: float | None) -> float:
    """Return the smaller of the limits by ATC_STR_RAT_MAX and ATC_TURN_MAX_G at *speed* [rad/s]."""
    rate = math.radians(_get(settings, "ATC_STR_RAT_MAX"))
    lateral = _get(settings, "ATC_TURN_MAX_G") * GRAVITY / max(speed or 0.0, 1.0)
    return min(rate if rate > 0.0 else math.inf, lateral if lateral > 0.0 else math.inf)


def cascade(settings: Settings, speed: float | None) -> Cascade:
    """Return the stages of the turn-rate controller, with limits of acceleration and turn rate."""
    kff, kp, ki, kd = (settings.get(name, 0.0) for name in (FF, P, I, D))
    return Cascade(
        acceleration=math.radians(_get(settings, "ATC_STR_ACC_MAX")),
        velocity_max=turn_limit(settings, speed),
        ff=kff,
        p=kp,
        i=ki,
        d=kd,
        imax=_get(settings, "ATC_STR_RAT_IMAX"),
        target_cutoff=_get(settings, "ATC_STR_RAT_FLTT"),
        error_cutoff=_get(settings, "ATC_STR_RAT_FLTE"),
        slope_cutoff=_get(settings, "ATC_STR_RAT_FLTD"),
        scale=scale(settings, speed),
        grows=float(integral_grows(settings, speed)),
        throttle=_beside(settings),
    )


def steering_pid(settings: Settings, speed: float | None) -> Rational:
    """Return the transfer function from turn rate to servo, without the gyro filter."""
    k = scale(settings, speed)
    return pid_path(
        settings[P] * k,
        settings[I] * k if integral_grows(settings, speed) else 0.0,
        settings[D] * k,
        error_cutoff=_get(settings, "ATC_STR_RAT_FLTE"),
        slope_cutoff=_get(settings, "ATC_STR_RAT_FLTD"),
    )


def ideal_feed_forward(model: SingleDof, settings: Settings, speed: float | None) -> float:
    """Return the feed-forward that follows turn rates exactly at *speed* [m/s]."""
    return model.equivalent_drag(model.steady_velocity(0.5)) / scale(settings, speed)


def most_feed_forward(model: SingleDof, settings: Settings, speed: float | None) -> Mapping[str, float]:
    """Return parameter name -> largest useful feed-forward for *model* at *speed* [m/s]."""
    ideal = ideal_feed_forward(model, settings, speed)
    return {FF: MAX_FEED * ideal} if ideal > 0.0 else {}


def speed_notes(model: SingleDof, settings: Settings, speed: float | None) -> list[str]:
    """Return notes on the speeds at which the gains are valid."""
    base = _get(settings, "MOT_SPD_SCA_BASE")
    if is_skid(settings):
        at = "the speed" if speed is None else f"{speed:.2f} m/s"
        return [
            f"the gains are valid only at {at} and the throttle of the identification runs. With skid steering, the "
            "autopilot does not scale steering with speed. Steering gets stronger with throttle if thrust grows with "
            "the square of the motor output. In that case set MOT_THST_EXPO to linearise the thrust"
        ]
    if vectored_angle(settings) > 0.0:
        known = settings.get(THROTTLE, 0.0) > 0.0
        whence = "" if known else " (from CRUISE_THROTTLE and CRUISE_SPEED)"
        return [
            "vectored thrust (MOT_VEC_ANGLEMAX > 0): the autopilot turns the thrust by atan(steering / throttle). "
            "The gains are valid at the throttle of the experiment, "
            f"{'' if known else 'assumed to be '}{_throttle(settings, speed):.0%} of full throttle{whence}. They are "
            "valid at other throttles only if thrust is proportional to throttle. Without throttle there is no "
            "steering"
        ]
    turn = math.degrees(abs(model.steady_velocity(1.0)))
    seen = (
        f"the model was identified in MANUAL at {speed:.2f} m/s, where full steering turns the boat at {turn:.0f} deg/s"
    )
    if not integral_grows(settings, speed):
        return [
            f"{seen}. That speed is not above MOT_SPD_SCA_BASE = {base:g} m/s. Below MOT_SPD_SCA_BASE the autopilot "
            "does not scale the steering and freezes its integral, so wind or trim leaves an error. The margins are "
            "for just above MOT_SPD_SCA_BASE. Check the gains again before going faster"
        ]
    ideal = ideal_feed_forward(model, settings, speed)
    return [
        f"{seen}. Above MOT_SPD_SCA_BASE = {base:g} m/s the autopilot divides the steering by speed. The gains are "
        f"valid if turn rate per rudder is proportional to speed. For comparison, {FF} = 1/(K base) = {ideal:.3g} "
        "alone gives the commanded steady turn rate, at every speed above it. The chosen value may differ: the design "
        f"chooses all gains together. At or below {base:g} m/s the integral term is frozen"
    ]
