"""Rules for the parameters by which ArduRover follows the legs of a mission and rounds their corners.

``AR_WPNav`` moves a target along the legs. It brakes for a waypoint with WP_ACCEL and speeds up on the next leg at the
same time, so that a corner of angle theta takes ``V / WP_ACCEL`` seconds. A hull that turns at r at most, with a lag T,
needs ``theta / r + LAGS T``. The corner is rounded only if the target passes the waypoint within WP_RADIUS, which is
``sin(theta/2) V^2 / (4 WP_ACCEL)`` away from it. ``AR_PosControl`` follows the target with PSC_POS_P and PSC_VEL_P.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from gcs_autotune.design.result import Change

__all__ = ["LINE_PARAMETERS", "HullTurn", "line_changes"]

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
LAG_PRODUCT, POSITION_GAIN = 0.4, (0.1, 0.5)
"""PSC_POS_P times the lag, and its limits [1/s]. ``T s^2 + s + P`` has a damping of 0.8 where P T is 0.4."""
DIGITS = 2

LINE_PARAMETERS: Mapping[str, tuple[float, float, str]] = {
    "WP_ACCEL": (0.0, 100.0, "braking for corners"),
    "WP_RADIUS": (0.0, 100.0, "radius in which a corner is rounded"),
    "WP_PIVOT_ANGLE": (0.0, 360.0, "heading error above which the boat pivots"),
    "PSC_POS_P": (0.1, 2.0, "speed per distance from the moving target"),
    "PSC_VEL_P": (0.1, 6.0, "acceleration per speed error"),
}
"""Parameter -> documented range and meaning. That of PSC_POS_P begins at 0.5, above ArduPilot's own default of 0.2."""


@dataclass(frozen=True, slots=True)
class HullTurn:
    """What a hull can turn at its working ``speed`` [m/s].

    ``rate``: greatest turn rate [rad/s]. ``lag``: its time constant with the delay [s].
    ``pivots``: whether the autopilot turns it on the spot at sharp corners. ``pivots_wide``: whether it moves away
    meanwhile, by half the radius of a turn under way or more.
    """

    speed: float
    rate: float
    lag: float
    pivots: bool = False
    pivots_wide: bool = False

    @property
    def radius(self) -> float:
        """Smallest radius of its turns [m]."""
        return self.speed / self.rate


def line_changes(hull: HullTurn, present: Mapping[str, float]) -> list[Change]:
    """Return the parameters to change of those *present* on the vehicle, with the reason of each."""
    return [
        Change(name, present[name], new, *LINE_PARAMETERS[name][:2], f"{LINE_PARAMETERS[name][2]}: {why}")
        for name, new, why in _chosen(hull, present)
        if name in present and not math.isclose(new, present[name], rel_tol=0.02)
    ]


def _chosen(hull: HullTurn, present: Mapping[str, float]) -> Iterator[tuple[str, float, str]]:
    """Yield (parameter, value, reason)."""
    if not hull.pivots or hull.pivots_wide:
        yield from _for_corners(hull)
    yield "PSC_VEL_P", VELOCITY_GAIN, "a gain that suits slow and quick hulls"
    yield "PSC_POS_P", _position_gain(hull), f"{LAG_PRODUCT:g} over the lag of {hull.lag:.1f} s"


def _position_gain(hull: HullTurn) -> float:
    low, high = POSITION_GAIN
    return _rounded(min(max(LAG_PRODUCT / hull.lag, low), high))


def _for_corners(hull: HullTurn) -> Iterator[tuple[str, float, str]]:
    needs = CORNER / (SHARE * hull.rate) + LAGS * hull.lag
    braking = _rounded(hull.speed / needs)
    yield (
        "WP_ACCEL",
        braking,
        f"a corner of 90 deg takes {needs:.1f} s at {SHARE:.0%} of {math.degrees(hull.rate):.0f} deg/s with a lag of "
        f"{hull.lag:.1f} s",
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
