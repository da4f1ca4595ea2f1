"""The limits and actuator parameters of ArduRover that follow from what a boat can do. Nothing is written here.

Names and meanings: ArduPilot's parameter metadata for Rover 4.5-4.7. Limits use :data:`.authority.RESERVE` of the end
of the 95 % interval that is nearer to zero, on the weaker side.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from gcs_autotune.design.authority import ASTERN, CURVE, DEAD_ZONE, RESERVE, SIDES, Authority, FlownModel
from gcs_autotune.design.laws.rover_speed import pulse_of, throttle_of
from gcs_autotune.design.laws.rover_steering import GRAVITY
from gcs_autotune.design.motor_law import MOST_ASYMMETRY, MOST_FLOOR, law_of_effects
from gcs_autotune.notebook import Displayed

__all__ = ["ParameterLimit", "limits_for", "rudder_trim"]

LEAST_LATERAL = 0.1
"""Smallest lateral acceleration that the firmware uses for ATC_TURN_MAX_G [g] (AR_AttitudeControl)."""
SIGNIFICANT = 2.0
"""Standard errors by which an actuator's number must differ from that of an ideal one."""
LEAST_CURVE, LEAST_BAND, LEAST_RATIO, LEAST_TRIM = 0.05, 0.01, 0.05, 0.005
"""Smallest thrust curve, dead zone, asymmetry and trim [fractions] for which a parameter is proposed. Chosen."""
RUDDER = 26
"""SERVOn_FUNCTION of a rudder."""


@dataclass(frozen=True, slots=True)
class ParameterLimit(Displayed):
    """A proposed value of one parameter, in its own unit, with its rule. ``present``: NaN if unknown."""

    name: str
    present: float
    value: float
    unit: str
    rule: str


def limits_for(authority: Authority) -> tuple[ParameterLimit, ...]:
    """Return the proposals for ArduRover that these figures determine; none for another autopilot."""
    if not authority.models.rover:
        return ()
    settings = authority.models.settings
    motors = tuple(_motors(authority))
    rows = [*motors, *_trim(authority), *_turning(authority), *_speed(authority, {n: v for n, v, _, _ in motors})]
    return tuple(
        ParameterLimit(name, settings.get(name, math.nan), float(f"{value:.4g}"), unit, rule)
        for name, value, unit, rule in rows
    )


Row = tuple[str, float, str, str]


def _turning(authority: Authority) -> Iterator[Row]:
    part = f"{100.0 * RESERVE:.0f} %"
    if (rate := _weaker(authority, "turn-rate")) > 0.0:
        yield "ATC_STR_RAT_MAX", math.degrees(RESERVE * rate), "deg/s", f"{part} of the turn rate to the weaker side"
        if (mean := _weaker(authority, "turn-acceleration-mean")) > 0.0:
            rule = "mean acceleration to that rate at full steering, weaker side"
            yield "ATC_STR_ACC_MAX", math.degrees(mean), "deg/s/s", rule
    circle = _working(authority)
    if circle is None:
        return
    speed, rate = circle
    lateral = RESERVE * speed * rate / GRAVITY
    floor = f". The firmware uses at least {LEAST_LATERAL:g}" if lateral < LEAST_LATERAL else ""
    rule = f"{part} of the lateral acceleration at {speed:.2f} m/s, which is {lateral / RESERVE:.3f} g{floor}"
    yield "ATC_TURN_MAX_G", max(lateral, LEAST_LATERAL), "g", rule
    if rate > 0.0:
        yield "TURN_RADIUS", speed / rate, "m", f"radius at full steering and {speed:.2f} m/s, weaker side"


def _working(authority: Authority) -> tuple[float, float] | None:
    """Return (speed, least sure turn rate) of the circle at the working throttle."""
    working = authority.models.working
    for circle in authority.circles:
        if math.isnan(circle.throttle) or abs(circle.throttle - working) < 1e-9:
            return circle.speed.value, min(figure.sure for figure in circle.rates.values())
    return None


def _weaker(authority: Authority, slug: str) -> float:
    """Return the sure value of a figure on the weaker side; NaN if a side is unknown."""
    both = [authority.figures.get(f"{slug}-{side}") for side, _ in SIDES]
    return min((f.sure if f is not None else math.nan for f in both), default=math.nan) if all(both) else math.nan


def _speed(authority: Authority, motors: Mapping[str, float]) -> Iterator[Row]:
    craft, figures = authority.models, authority.figures
    if "cruise-speed" not in figures:
        return
    cruise, part = figures["cruise-speed"], f"{100.0 * RESERVE:.0f} %"
    throttle = throttle_of(pulse_of(craft.working, craft.settings), {**craft.settings, **motors})
    same = " with the motor parameters above" if motors else ""
    yield "CRUISE_SPEED", cruise.value, "m/s", f"steady speed at {100.0 * craft.working:.0f} % throttle"
    yield "CRUISE_THROTTLE", round(100.0 * throttle), "%", f"throttle of that speed{same}"
    present, most = craft.settings.get("WP_SPEED", 0.0), figures["current"].sure
    wanted = present if present > 0.0 else cruise.value
    rule = "present speed" if present > 0.0 else "speed at the working throttle"
    yield "WP_SPEED", min(wanted, most), "m/s", f"{rule}, at most the speed at {part} throttle"
    if (ahead := figures.get("acceleration")) is not None and ahead.sure > 0.0:
        rule = f"{part} of the mean acceleration from rest at full throttle"
        yield "ATC_ACCEL_MAX", RESERVE * ahead.sure, "m/s/s", rule
    brakes = craft.settings.get("ATC_BRAKE", 1.0) > 0.0
    how = "astern" if brakes and "deceleration-astern" in figures else "coasting"
    if (stop := figures.get(f"deceleration-{how}")) is not None and stop.sure > 0.0:
        words = "with full astern" if how == "astern" else "without thrust"
        yield "ATC_DECEL_MAX", RESERVE * stop.sure, "m/s/s", f"{part} of the mean deceleration {words}"


def _motors(authority: Authority) -> Iterator[Row]:
    """Yield the parameters of ArduRover's motor library that correct what the surge model contains."""
    craft, surge = authority.models, authority.models.surge
    if surge is None:
        return
    dead, _ = _number(surge, DEAD_ZONE, "width", 0.0, LEAST_BAND)
    curve, std = _number(surge, CURVE, "share", 0.0, LEAST_CURVE)
    width = 0.0 if math.isnan(dead) else dead / _full(surge, DEAD_ZONE)
    law = law_of_effects(width, 0.0 if math.isnan(curve) else curve)
    if width > 0.0:
        limit = f", limited to {100.0 * MOST_FLOOR:g}" if law.floor > MOST_FLOOR else ""
        rule = f"thrust of a linear thruster at the edge of the dead zone{limit}"
        yield "MOT_THR_MIN", round(100.0 * law.stored.floor), "%", rule
    if not math.isnan(curve):
        rule = f"quadratic part of the thrust curve, {curve:.2f} ± {std:.2f}"
        yield "MOT_THST_EXPO", law.stored.expo, "", rule
    ratio, std = _number(surge, ASTERN, "ratio", 1.0, LEAST_RATIO)
    if craft.skid and ratio < 1.0:
        rule = f"thrust ahead over thrust astern, which is {ratio:.2f} ± {std:.2f} of it"
        yield "MOT_THST_ASYM", round(min(1.0 / ratio, MOST_ASYMMETRY), 2), "", rule


def _number(model: FlownModel, slug: str, name: str, ideal: float, least: float) -> tuple[float, float]:
    """Return the number of an effect of X and its standard error; NaN unless it differs clearly from *ideal*."""
    own = model.effect(slug, "X")
    if own is None:
        return math.nan, math.nan
    std = model.std(own.label_of(name))
    clear = abs(own[name] - ideal) > max(SIGNIFICANT * std, least * _full(model, slug))
    return (own[name], std) if clear else (math.nan, math.nan)


def _full(model: FlownModel, slug: str) -> float:
    own = model.effect(slug, "X")
    return 1.0 if own is None or slug != DEAD_ZONE else model.full.get(own.place, 1.0)


def _trim(authority: Authority) -> Iterator[Row]:
    """Yield SERVOn_TRIM of a rudder that must be held over to go straight."""
    craft = authority.models
    if not craft.yaw or craft.coupled:
        return
    model = craft.yaw[-1]
    held = model.straight
    std = abs(held / model.model.base["N_0"]) * model.std("N_0") if held else 0.0
    found = rudder_trim(craft.settings, held)
    if found is None or abs(held) < max(SIGNIFICANT * std, LEAST_TRIM):
        return
    rule = (
        f"the rudder holds {100.0 * held:+.1f} % to go straight. Wind has the same effect: `tune actuators` checks it"
    )
    yield found[0], found[1], "us", rule


def rudder_trim(settings: Mapping[str, float], held: float) -> tuple[str, int] | None:
    """Return SERVOn_TRIM of the rudder and the pulse [us] of its output *held* [fraction].

    None if the vehicle has no rudder, or its output's limits are unknown.
    """
    servo = next((n for n in range(1, 17) if settings.get(f"SERVO{n}_FUNCTION") == RUDDER), None)
    names = [f"SERVO{servo}_{end}" for end in ("MIN", "TRIM", "MAX")]
    if servo is None or not all(name in settings for name in names):
        return None
    low, trim, high = (settings[name] for name in names)
    turned = -held if settings.get(f"SERVO{servo}_REVERSED", 0.0) > 0.0 else held
    return names[1], round(trim + turned * (high - trim if turned > 0.0 else trim - low))
