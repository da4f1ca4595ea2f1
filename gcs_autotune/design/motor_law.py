"""ArduRover's motor library as a map from command to thrust, and its parameters for a measured thrust curve.

``AP_MotorsUGV`` multiplies the commands astern of two thrusters by MOT_THST_ASYM, raises each command above
MOT_THR_MIN, and then undoes the thrust curve ``(1 - e) p + e p^2`` of the output ``p``, with ``e`` of MOT_THST_EXPO. So
thrust is proportional to the command if it is proportional to ``(1 - e) p + e p^2 - MOT_THR_MIN`` outside a dead zone,
and weaker astern by MOT_THST_ASYM (ArduPilot 4.6, ``get_scaled_throttle`` and ``output_skid_steering``).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gcs_autotune.design.laws.rover_speed import pulse_of, throttle_of
from gcs_autotune.design.result import Change
from gcs_autotune.errors import NotInformative
from gcs_autotune.notebook import Displayed

__all__ = [
    "Linearity",
    "MotorFit",
    "MotorLaw",
    "fit_motor_law",
    "is_more_linear",
    "law_of_effects",
    "linearity",
    "motor_changes",
]

Array = NDArray[np.float64]

MOST_FLOOR, MOST_ASYMMETRY = 0.2, 10.0
"""Largest documented MOT_THR_MIN [fraction] and MOT_THST_ASYM. ArduRover limits the former."""
CURVES, FLOORS = np.linspace(-1.0, 1.0, 101), np.linspace(0.0, MOST_FLOOR, 41)
"""Thrust curves and dead zones that are tried."""
LEAST_ASYMMETRY, LEAST_CURVE, LEAST_FLOOR = 0.05, 0.05, 0.02
"""Smallest difference from an ideal actuator for which a parameter is written. Project choice."""
NUDGE = 0.03
"""Change of the command over which the slope of the thrust is taken."""
LEAST_FACTOR, LEAST_CHANGE = 0.25, 0.15
"""Smallest factor of gains, and the smallest change of them, that is written. Project choice."""
SURE = 2.0
"""Standard errors by which a measured difference must exceed its noise."""
CLEARLY = 0.8
"""Largest ratio of the departures from proportionality after and before. Project choice."""


@dataclass(frozen=True, slots=True)
class MotorLaw:
    """MOT_THR_MIN [fraction], MOT_THST_EXPO and MOT_THST_ASYM."""

    floor: float = 0.0
    expo: float = 0.0
    asymmetry: float = 1.0

    @classmethod
    def of(cls, settings: Mapping[str, float], *, skid: bool) -> MotorLaw:
        """Return the law with the parameters *settings*. ArduRover uses the asymmetry for two thrusters only."""
        asymmetry = max(settings.get("MOT_THST_ASYM", 1.0), 1.0) if skid else 1.0
        return cls(settings.get("MOT_THR_MIN", 0.0) / 100.0, settings.get("MOT_THST_EXPO", 0.0), asymmetry)

    @property
    def stored(self) -> MotorLaw:
        """The law as the parameters can store it, within their documented ranges: MOT_THR_MIN in whole percent."""
        return MotorLaw(
            round(100.0 * min(max(self.floor, 0.0), MOST_FLOOR)) / 100.0,
            round(min(max(self.expo, -1.0), 1.0), 2),
            round(min(max(self.asymmetry, 1.0), MOST_ASYMMETRY), 2),
        )

    def reachable(self, commands: ArrayLike) -> Array:
        """Return *commands* [fraction], limited astern to what the weaker direction can give."""
        result: Array = np.maximum(np.asarray(commands, dtype=np.float64), -1.0 / self.asymmetry)
        return result

    def outputs(self, commands: ArrayLike) -> Array:
        """Return the outputs [fraction] that the autopilot sends for *commands* [fraction]."""
        return np.array(
            [pulse_of(c * (self.asymmetry if c < 0.0 else 1.0), self._own) for c in self.reachable(commands)]
        )

    def thrust(self, outputs: ArrayLike) -> Array:
        """Return the relative thrust at *outputs* [fraction] of the thruster for which this law is exact."""
        found = [throttle_of(p, self._own) / (self.asymmetry if p < 0.0 else 1.0) for p in np.asarray(outputs)]
        return np.array(found, dtype=np.float64)

    @property
    def _own(self) -> dict[str, float]:
        return {"MOT_THR_MIN": 100.0 * self.floor, "MOT_THST_EXPO": self.expo}


@dataclass(frozen=True, slots=True)
class Linearity(Displayed):
    """How far thrust is from proportional to the command.

    ``commands``, ``thrusts`` (n,): command [fraction], and thrust relative to the best proportional one. ``departure``:
    rms difference [fraction of full command], and its standard error ``std``. ``astern``: thrust astern over thrust
    ahead at the same command; NaN if one direction was not flown.
    """

    commands: tuple[float, ...]
    thrusts: tuple[float, ...]
    departure: float
    std: float
    astern: float

    def to_dict(self) -> dict[str, object]:
        """Return the numbers as data for JSON."""
        return {
            "commands": list(self.commands),
            "thrusts": list(self.thrusts),
            "departure": self.departure,
            "std": self.std,
            "astern": self.astern,
        }


def linearity(law: MotorLaw, commands: Array, forces: Array, stds: Array, *, skid: bool) -> Linearity:
    """Return how proportional *forces* (n,) are to *commands* (n,) [fraction] under the parameters *law*.

    Commands beyond what the weaker direction can give count as its limit. Without two thrusters no parameter corrects
    weak thrust astern, so that each direction then has its own slope.
    """
    reached = law.reachable(commands)
    ahead, astern = commands > 0.0, commands < 0.0
    slopes = [_slope(reached[side], forces[side]) for side in (ahead, astern)]
    own = slopes if not skid else [_slope(reached, forces)] * 2
    scale = np.where(ahead, own[0], own[1])
    thrusts, noise = forces / scale, stds / scale
    apart = (thrusts - reached) / np.max(np.abs(commands))
    departure = float(np.sqrt(np.mean(apart**2)))
    return Linearity(
        tuple(map(float, reached)),
        tuple(map(float, thrusts)),
        departure,
        float(np.sqrt(np.mean(noise**2))),
        slopes[1] / slopes[0],
    )


def _slope(commands: Array, forces: Array) -> float:
    return float(commands @ forces / (commands @ commands)) if len(commands) else math.nan


def is_more_linear(before: Linearity, after: Linearity) -> bool:
    """Return whether thrust is clearly nearer to proportional *after* than *before*."""
    gained = before.departure - after.departure
    return after.departure <= CLEARLY * before.departure and gained > math.hypot(before.std, after.std)


@dataclass(frozen=True, slots=True)
class MotorFit(Displayed):
    """The motor law for a measured thrust curve.

    ``law`` has only the parameters that the Bayesian information criterion supports. ``closest`` has all of them, and
    describes the thrust best. ``expo_std``: standard error of its curve.
    """

    law: MotorLaw
    closest: MotorLaw
    expo_std: float


def fit_motor_law(outputs: Array, forces: Array, stds: Array, *, skid: bool) -> MotorFit:
    """Return the law for *forces* (n,) with standard errors *stds* at *outputs* (n,).

    skid : two thrusters, whose weakness astern a parameter corrects.

    Raises
    ------
    NotInformative
        The forces do not rise with the output.
    """
    noise = np.maximum(stds, 1e-3 * np.max(np.abs(forces)))
    none = np.zeros(1)
    grids = {(e, f): (CURVES if e else none, FLOORS if f else none) for e in (False, True) for f in (False, True)}
    fits = {kind: _best(outputs, forces, noise, *grid) for kind, grid in grids.items()}
    all_of_it = fits[True, True]
    size = max(all_of_it.chi / max(len(outputs) - 4, 1), 1.0)  # no curve is exact
    kind = min(fits, key=lambda kind: fits[kind].chi / size + sum(kind) * math.log(len(outputs)))
    law = fits[kind].law
    if not all_of_it.rises:
        raise NotInformative("the thrust does not rise with the output. Check the propeller and the signs of the map")
    weak = law.asymmetry - 1.0 > max(SURE * fits[kind].asymmetry_std * math.sqrt(size), LEAST_ASYMMETRY)
    law = MotorLaw(
        law.floor if law.floor >= LEAST_FLOOR else 0.0,
        law.expo if abs(law.expo) >= LEAST_CURVE else 0.0,
        law.asymmetry if skid and weak else 1.0,
    )
    return MotorFit(law, all_of_it.law, all_of_it.expo_std * math.sqrt(size))


@dataclass(frozen=True, slots=True)
class _Found:
    chi: float
    law: MotorLaw
    asymmetry_std: float
    expo_std: float
    rises: bool


def _best(outputs: Array, forces: Array, noise: Array, curves: Array, floors: Array) -> _Found:
    """Return the law with the smallest chi-squared of those with *curves* and *floors*."""
    e, f = (grid.ravel()[:, None] for grid in np.meshgrid(curves, floors, indexing="ij"))
    p = np.abs(outputs)
    shape = np.copysign(np.maximum((1.0 - e) * p + e * p * p - f, 0.0) / (1.0 - f), outputs)
    chi, sides = np.zeros(len(e)), []
    for side in (outputs > 0.0, outputs < 0.0):
        part, pulled, own = shape[:, side], forces[side], noise[side]
        weight = np.maximum(np.sum((part / own) ** 2, axis=1), 1e-300)
        slope = np.sum(part * pulled / own**2, axis=1) / weight
        chi += np.sum(((pulled - slope[:, None] * part) / own) ** 2, axis=1)
        sides.append((slope, weight**-0.5))
    best = int(np.argmin(chi))
    (ahead, ahead_std), (astern, astern_std) = ((float(slope[best]), float(std[best])) for slope, std in sides)
    known = ahead > 0.0 and astern > 0.0
    ratio = ahead / astern if known else 1.0
    std = ratio * math.hypot(ahead_std / ahead, astern_std / astern) if known else math.inf
    weights = np.exp(-0.5 * (chi - chi[best]))
    weights /= np.sum(weights)
    spread = float(np.sqrt(np.sum(weights * (e[:, 0] - np.sum(weights * e[:, 0])) ** 2)))
    law = MotorLaw(float(f[best, 0]), float(e[best, 0]), ratio)
    return _Found(float(chi[best]), law, std, spread, ahead > 0.0 or astern > 0.0)


def law_of_effects(dead: float, curve: float) -> MotorLaw:
    """Return the law for a thruster with a subtracted dead zone of half-width *dead* and a quadratic part *curve*.

    Its thrust ``(1 - curve) (p - dead) + curve (p - dead)^2`` is that of the law times a constant.
    """
    square, linear, off = curve, 1.0 - curve - 2.0 * curve * dead, (1.0 - curve) * dead - curve * dead * dead
    return MotorLaw(off / (square + linear), square / (square + linear))


SPEED_GAINS: Mapping[str, tuple[float, float]] = {"ATC_SPEED_P": (0.01, 2.0), "ATC_SPEED_I": (0.0, 2.0)}
STEERING_GAINS: Mapping[str, tuple[float, float]] = {
    "ATC_STR_RAT_FF": (0.0, 3.0),
    "ATC_STR_RAT_P": (0.0, 2.0),
    "ATC_STR_RAT_I": (0.0, 2.0),
    "ATC_STR_RAT_D": (0.0, 0.4),
}
"""Gain -> documented range. Two thrusters steer by the same thrust curve, so that the latter change with it."""


def motor_changes(fit: MotorFit, present: Mapping[str, float], *, skid: bool) -> list[Change]:
    """Return the parameters to change of those *present* on the vehicle, so that the motor library follows the law
    *fit*.

    CRUISE_THROTTLE and MOT_THR_MAX are changed with them, so that they mean the same thrust as before, and the gains of
    the loops, so that the loop gain at cruise is that of before.
    """
    return [
        Change(name, present[name], new, low, high, why)
        for name, new, low, high, why in _rows(fit, present, skid=skid)
        if not math.isclose(new, present[name], rel_tol=1e-3, abs_tol=1e-6)
    ]


Row = tuple[str, float, float, float, str]


def _rows(fit: MotorFit, present: Mapping[str, float], *, skid: bool) -> Iterator[Row]:
    old, new = MotorLaw.of(present, skid=skid), fit.law.stored
    motors = (
        ("MOT_THR_MIN", round(100.0 * new.floor), 0.0, 100.0 * MOST_FLOOR, "dead zone of the thrusters"),
        ("MOT_THST_EXPO", new.expo, -1.0, 1.0, "quadratic part of the thrust curve"),
        ("MOT_THST_ASYM", new.asymmetry, 1.0, MOST_ASYMMETRY, "thrust ahead over thrust astern"),
    )
    yield from (row for row in motors if row[0] in present)
    if (new.floor, new.expo) == (old.floor, old.expo):
        return
    for name, low in (("CRUISE_THROTTLE", 1.0), ("MOT_THR_MAX", 30.0)):
        if (name == "CRUISE_THROTTLE" or present.get(name, 100.0) < 100.0) and name in present:
            same = _same_thrust(old, new, present[name] / 100.0)
            yield name, float(min(max(round(100.0 * same), low), 100.0)), low, 100.0, "the same thrust as before"
    cruise = present.get("CRUISE_THROTTLE", 0.0) / 100.0
    if not cruise > 0.0:
        return
    less = _slope_of(old, fit.closest, cruise) / _slope_of(new, fit.closest, _same_thrust(old, new, cruise))
    if not LEAST_FACTOR <= less <= 1.0 / LEAST_FACTOR or abs(less - 1.0) < LEAST_CHANGE:
        return
    for name, (low, high) in {**SPEED_GAINS, **(STEERING_GAINS if skid else {})}.items():
        if present.get(name, 0.0) > 0.0:
            gain = float(f"{min(max(less * present[name], low), high):.3g}")
            yield name, gain, low, high, f"{less:.2f} times, so that the loop gain at cruise stays"


def _same_thrust(old: MotorLaw, new: MotorLaw, command: float) -> float:
    """Return the command [fraction] under *new* that gives the output of *command* under *old*."""
    return float(new.thrust(old.outputs([command]))[0])


def _slope_of(law: MotorLaw, thruster: MotorLaw, command: float) -> float:
    """Return the slope of the thrust over the command at *command* [fraction], with the parameters *law*."""
    low, high = thruster.thrust(law.outputs([command - NUDGE, min(command + NUDGE, 1.0)]))
    return max(float(high - low), 1e-3 * NUDGE) / (min(command + NUDGE, 1.0) - (command - NUDGE))
