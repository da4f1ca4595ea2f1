"""Rules for the parameters by which ArduRover follows the legs of a mission and rounds their corners.

``AR_WPNav`` moves a target along the legs. It brakes for a waypoint with WP_ACCEL and speeds up on the next leg at the
same time, so that a corner of angle theta takes ``V / WP_ACCEL`` seconds. A hull that turns at r at most, with a lag T,
needs ``theta / r + LAGS T``. The corner is rounded only if the target passes the waypoint within WP_RADIUS, which is
``sin(theta/2) V^2 / (4 WP_ACCEL)`` away from it. ``AR_PosControl`` follows the target with PSC_POS_P and PSC_VEL_P.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gcs_autotune.design.laws.rover_speed import CRUISE, throttle_of
from gcs_autotune.design.result import Change
from gcs_autotune.design.track_metrics import TrackMetrics

__all__ = ["LINE_PARAMETERS", "HullTurn", "OnLeg", "current_on", "line_changes", "pivots_wide", "too_short"]

CORNER = math.radians(90.0)
"""The corner that a boat rounds without leaving the route by more than it must. Project choice: the most common one."""
SHARE = 0.8
"""Share of the greatest turn rate that corners use; the rest is for corrections. Project choice."""
LAGS = 3.0
"""Time constants until a turn rate is reached and again is over. Found with four simulated hulls."""
WIDER = 1.1
"""WP_RADIUS as a multiple of the distance at which the target passes a U-turn. Project choice."""
VELOCITY_GAIN = 1.5
"""PSC_VEL_P [1/s]. Found by a search on four simulated hulls; from 1.4 to 3 the distance from the route is flat."""
LAG_PRODUCT, POSITION_GAIN = 0.4, (0.1, 0.2)
"""PSC_POS_P times the lag, and its limits [1/s]. ``T s^2 + s + P`` has a damping of 0.8 where P T is 0.4.

The upper limit is ArduPilot's default: the lag of the yaw contains no sway. With 0.5 the rms distance of the BlueBoat
with sway was twice that with 0.2, and without sway the same."""
ATTAINABLE, NEARLY_FULL = 0.9, 0.9
"""WP_SPEED relative to the speed on the slowest leg, if that leg was driven with nearly full throttle [fraction of
full] and was slower than WP_SPEED by as much: some thrust is left for steering. Project choice."""
FEED_FORWARD = 0.1
"""Error of the throttle by the cruise pair [fraction of full] above which the pair is set again. Project choice."""
AWAY = 0.5
"""Distance of a pivoting boat from the route, relative to the radius of its turns, from which it should turn under way
instead. Project choice."""
GRAVITY = 9.80665
DIGITS = 2

LINE_PARAMETERS: Mapping[str, tuple[float, float, str]] = {
    "WP_ACCEL": (0.0, 100.0, "braking for corners"),
    "WP_RADIUS": (0.0, 100.0, "radius in which a corner is rounded"),
    "WP_PIVOT_ANGLE": (0.0, 360.0, "heading error above which the boat pivots"),
    "PSC_POS_P": (0.1, 2.0, "speed per distance from the moving target"),
    "PSC_VEL_P": (0.1, 6.0, "acceleration per speed error"),
    "WP_SPEED": (0.0, 100.0, "speed of a mission"),
    "CRUISE_SPEED": (0.0, 100.0, "cruise speed, reached at CRUISE_THROTTLE"),
    "CRUISE_THROTTLE": (0.0, 100.0, "cruise throttle, which gives CRUISE_SPEED"),
    "ATC_STR_RAT_MAX": (0.0, 1000.0, "limit of the turn rate"),
    "ATC_STR_ACC_MAX": (0.0, 1000.0, "limit of the turn acceleration"),
    "ATC_TURN_MAX_G": (0.1, 10.0, "limit of the lateral acceleration"),
}
"""Parameter -> documented range and meaning. That of PSC_POS_P begins at 0.5, above ArduPilot's own default of 0.2."""


@dataclass(frozen=True, slots=True)
class OnLeg:
    """How the boat drove the third quarter of one leg, as means.

    ``psi``: heading [rad]. ``velocity``: over ground [m/s, north + i east]. ``output``: ahead, as measured [fraction of
    full].
    """

    psi: float
    velocity: complex
    output: float

    @property
    def speed(self) -> float:
        """Speed over ground [m/s]."""
        return abs(self.velocity)


def current_on(legs: Sequence[OnLeg]) -> complex:
    """Return the current [m/s, north + i east] that explains by how much the boat was set sideways on the *legs*.

    It is the least-squares solution of ``n . velocity = n . current``, n the direction to starboard, for a boat that
    does not move sideways through the water. Legs of one direction only give the part of the current across them.
    """
    across = [1j * cmath.exp(1j * leg.psi) for leg in legs]
    A = np.array([(n.real, n.imag) for n in across])
    b = np.array([(n.conjugate() * leg.velocity).real for n, leg in zip(across, legs, strict=True)])
    north, east = np.linalg.lstsq(A, b, rcond=None)[0]
    return complex(north, east)


@dataclass(frozen=True, slots=True)
class HullTurn:
    """What a hull can turn at its working ``speed`` [m/s].

    ``rate``: greatest turn rate [rad/s]. ``lag``: its time constant with the delay [s].
    ``pivots``: whether the autopilot turns it on the spot at sharp corners. ``pivots_wide``: whether it moves away
    while it turns, by half the radius of a turn under way or more. ``legs``: how it drove straight legs; none if
    unknown. ``bandwidth``: that of the style, relative to the fastest corners and corrections.
    """

    speed: float
    rate: float
    lag: float
    pivots: bool = False
    pivots_wide: bool = False
    legs: Sequence[OnLeg] = ()
    bandwidth: float = 1.0

    @property
    def used(self) -> float:
        """Share of the greatest turn rate that corners use."""
        return SHARE * self.bandwidth

    @property
    def rounds(self) -> bool:
        """Whether it shall round corners under way."""
        return not self.pivots or self.pivots_wide

    @property
    def corner(self) -> float:
        """Duration of a corner of 90 degrees [s]."""
        return CORNER / (self.used * self.rate) + LAGS * self.lag

    @property
    def radius(self) -> float:
        """Smallest radius of its turns [m]."""
        return self.speed / self.rate


def pivots_wide(flown: TrackMetrics, radius: float) -> bool:
    """Return whether a boat that pivots moved away while turning, by half the *radius* [m] of a turn under way or more.

    The widest corner counts: a current carries the boat back onto the route at another.
    """
    return max(flown.corners) > AWAY * radius


def line_changes(hull: HullTurn, present: Mapping[str, float]) -> list[Change]:
    """Return the parameters to change of those *present* on the vehicle, with the reason of each."""
    return [
        Change(name, present[name], new, *LINE_PARAMETERS[name][:2], f"{LINE_PARAMETERS[name][2]}: {why}")
        for name, new, why in _chosen(hull, present)
        if name in present and not math.isclose(new, present[name], rel_tol=0.02)
    ]


def too_short(hull: HullTurn, leg: float) -> str:
    """Return why corners of 90 degrees do not fit on legs of length *leg* [m]; empty if they do.

    A corner begins ``V t/2`` before the waypoint and ends as far behind it, t its duration.
    """
    needs = hull.speed * hull.corner
    if needs <= leg or not hull.rounds:
        return ""
    return (
        f"the corner is tighter than the boat turns: 90 deg take {hull.corner:.0f} s and {0.5 * needs:.0f} m of each "
        f"leg (smallest radius {hull.radius:.0f} m), and the legs are {leg:.0f} m. Use --leg-length "
        f"{math.ceil(needs)} or more, or a lower WP_SPEED"
    )


def _chosen(hull: HullTurn, present: Mapping[str, float]) -> Iterator[tuple[str, float, str]]:
    """Yield (parameter, value, reason)."""
    speed = _attainable(hull)
    if speed < hull.speed:
        slowest = min(leg.speed for leg in hull.legs)
        yield (
            "WP_SPEED",
            speed,
            f"with nearly full throttle the boat drove its slowest leg at {slowest:.2f} m/s; the rest is for steering",
        )
        hull = replace(hull, speed=speed)
    yield from _cruise(hull, present)
    yield from _turn_limits(hull, present)
    if hull.rounds:
        yield from _for_corners(hull)
    yield "PSC_VEL_P", VELOCITY_GAIN, "a gain that suits slow and quick hulls"
    yield "PSC_POS_P", _position_gain(hull), _position_reason(hull)


def _attainable(hull: HullTurn) -> float:
    """Return the working speed, or a lower one if the boat did not reach it on one of the legs."""
    if not hull.legs:
        return hull.speed
    slowest = min(hull.legs, key=lambda leg: leg.speed)
    if slowest.output < NEARLY_FULL or slowest.speed > ATTAINABLE * hull.speed:
        return hull.speed
    return _rounded(ATTAINABLE * slowest.speed)


def _cruise(hull: HullTurn, present: Mapping[str, float]) -> Iterator[tuple[str, float, str]]:
    """Set the cruise pair again if its throttle is wrong at the speed of the legs."""
    if not hull.legs or not all(present.get(name, 0.0) > 0.0 for name in (*CRUISE, "WP_SPEED")):
        return
    made = float(np.mean([leg.speed for leg in hull.legs]))
    throttle = throttle_of(float(np.mean([leg.output for leg in hull.legs])), present)
    speed, percent = (present[name] for name in CRUISE)
    by_pair = percent / 100.0 * made / speed
    if not 0.0 < throttle < NEARLY_FULL or abs(by_pair - throttle) < FEED_FORWARD:
        return
    why = f"the boat drove {made:.2f} m/s with {throttle:.0%} of throttle, where the pair gives {by_pair:.0%}"
    yield "CRUISE_SPEED", _rounded(made), why
    yield "CRUISE_THROTTLE", float(round(100.0 * throttle)), why


def _turn_limits(hull: HullTurn, present: Mapping[str, float]) -> Iterator[tuple[str, float, str]]:
    """Raise the limits that are below what the hull can do; a limit of 0 is off.

    Higher ones stay: a limit at what the hull can turn also limits corrections on a leg.
    """
    rate, lateral = math.degrees(hull.rate), hull.speed * hull.rate / GRAVITY
    does = {
        "ATC_STR_RAT_MAX": (rate, f"the hull turns with {rate:.0f} deg/s"),
        "ATC_STR_ACC_MAX": (rate / hull.lag, f"the hull reaches {rate:.0f} deg/s with a lag of {hull.lag:.1f} s"),
        "ATC_TURN_MAX_G": (lateral, f"{hull.speed:.1f} m/s at {rate:.0f} deg/s are {lateral:.2f} g"),
    }
    for name, (needed, why) in does.items():
        if 0.0 < present.get(name, 0.0) < needed:
            yield name, _rounded(needed), f"{why}, more than the present limit"


def _position_gain(hull: HullTurn) -> float:
    low, high = POSITION_GAIN
    return _rounded(min(max(hull.bandwidth * LAG_PRODUCT / hull.lag, low), high))


def _position_reason(hull: HullTurn) -> str:
    low, high = POSITION_GAIN
    return f"{hull.bandwidth * LAG_PRODUCT:g} over the lag of {hull.lag:.1f} s, from {low:g} to {high:g}"


def _for_corners(hull: HullTurn) -> Iterator[tuple[str, float, str]]:
    needs = hull.corner
    braking = _rounded(hull.speed / needs)
    yield (
        "WP_ACCEL",
        braking,
        f"a corner of 90 deg takes {needs:.1f} s at {hull.used:.0%} of {math.degrees(hull.rate):.0f} deg/s with a lag "
        f"of {hull.lag:.1f} s",
    )
    passes = hull.speed**2 / (4.0 * braking)
    yield (
        "WP_RADIUS",
        _rounded(WIDER * passes),
        f"the moving target passes the corner up to {passes:.1f} m inside; beyond the radius it would stop there",
    )
    if hull.pivots:
        yield "WP_PIVOT_ANGLE", 0.0, "the hull moves away while it turns on the spot; it turns under way instead"


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
