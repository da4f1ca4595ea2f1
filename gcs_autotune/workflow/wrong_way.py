"""Find reversed outputs and contradicting sensors in a record.

A craft that turns against its steering, or that turns under throttle alone, trips a limit sooner or later. A larger
limit does not help then. The record shows which servo function or direction is wrong.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.crosscheck import contradictions
from gcs_autotune.errors import GuardTripped, PreconditionFailed
from gcs_autotune.firmware import Firmware, ServoMap
from gcs_autotune.trial import Trial
from gcs_autotune.workflow.preflight import crooked, cure_of

__all__ = ["SPUN", "contradiction_in", "straight_throttle", "tripped", "turning_time", "why_tripped"]

Array = NDArray[np.float64]

LOOKED_AT = 8.0
"""Length [s] of the end of a record that is searched for the cause of a tripped limit. Project choice."""
STEERED, IDLE, FELT = 0.04, 0.02, 0.15
"""Rms steering [fraction of full] that counts as steered; smallest throttle; and rms steering above which a turn counts
as made against the steering. Project choice."""
SAME = 0.6
"""Correlation of turn rate and steering (about zero) above which the turn counts as caused by the steering. Project
choice.
"""
FEWEST = 30
"""Smallest number of samples for a regression with three unknowns. Project choice."""
STRAIGHT = 3.0
"""Time [s] under throttle alone in which a reversed or dead thruster would have turned the craft. Project choice."""
LONG = 1.5
"""Distance to turn around with an unknown time constant, in multiples of the shortest possible one. It is enough up to
2.6 times the time constant that has the shortest distance. Project choice."""
SPUN = ("heading excursion", "turn rate")
"""Safety limits that trip when a craft turns in the wrong direction."""
REACTION = (0.0, 0.4, 0.8, 1.5)
"""Delays [s] considered between steering and turning. Project choice."""
LEAST_TURN, MOSTLY = math.radians(20.0), 0.5
"""Turn [rad] that is larger than a heading oscillation, and the fraction of it made without steering. Project
choice."""


def why_tripped(
    trial: Trial, error: GuardTripped, firmware: Firmware, servos: ServoMap, straight: float = 0.0
) -> PreconditionFailed | None:
    """Return the error with the reason why a heading limit tripped, if the manoeuvre's record shows it; else None.

    straight : :func:`straight_throttle` of the earlier records of the run.
    """
    if error.guard not in SPUN or "N" not in trial or "psi" not in trial:
        return None
    limit = tripped(error)
    late = _stretch(trial, LOOKED_AT)
    size = math.sqrt(float(np.mean(late.steering**2))) if len(late.t) else 0.0
    follows = max((_alike(late, seconds) for seconds in REACTION), key=abs)
    whole = _stretch(trial, math.inf)
    by_thrust = len(servos.driving("X")) > 1 and _turned_by_thrust(whole)
    away = follows < -SAME and abs(late.turned) >= LEAST_TURN and _accelerations(late)[0] < 0.0
    if size >= STEERED and away and not by_thrust:
        to, steered = ("starboard", "port") if late.turned > 0.0 else ("port", "starboard")
        cure = cure_of(firmware, [o for o, _ in servos.driving("N")])
        return PreconditionFailed(
            f"{trial.name}: the craft turned {_degrees(late.turned)} to {to} in {late.seconds:.0f} s while "
            f"the steering was to {steered}. {cure}. {limit}"
        )
    idle = np.abs(whole.throttle) > IDLE
    if not by_thrust:
        idle &= np.abs(whole.steering) < STEERED
    steps = np.gradient(whole.t) if len(whole.t) > 1 else whole.t
    by_throttle = float(np.sum((whole.rate * steps)[idle]))
    if abs(by_throttle) < LEAST_TURN or by_throttle * whole.turned < MOSTLY * whole.turned**2:
        return None
    throttle, seconds = float(np.mean(whole.throttle[idle])), float(np.sum(steps[idle]))
    unstable = _unstable_hull(whole, by_throttle)
    turned = f"the craft {_degrees(by_throttle)} to {'starboard' if by_throttle > 0.0 else 'port'} in {seconds:.0f} s"
    if unstable and straight >= MOSTLY * abs(throttle):
        return PreconditionFailed(
            f"{trial.name}: {throttle:.0%} throttle without steering turned {turned}. Earlier in this run the craft "
            f"ran straight with {straight:.0%} throttle. Unless a thruster has failed since, "
            f"{unstable}. Use less --throttle, or set gains with which the craft does not "
            f"oscillate. {limit}"
        )
    cure = _wrong_thruster(firmware, servos, by_throttle) if throttle > 0.0 else ""
    cure = cure or crooked(firmware, [o for o, _ in servos.driving("X")])
    steering = "against the steering" if math.sqrt(float(np.mean(whole.steering**2))) > FELT else "without steering"
    cause = f". Most likely {unstable}. Otherwise {cure}" if unstable else f": {cure}"
    return PreconditionFailed(
        f"{trial.name}: {throttle:.0%} throttle, {steering}, turned {turned} instead of driving it straight "
        f"ahead{cause}. {limit}"
    )


def straight_throttle(trial: Trial) -> float:
    """Return the largest throttle [fraction of full] with which the craft ran straight at the beginning of *trial*,
    without steering; 0 if it did not.
    """
    if "N" not in trial or "psi" not in trial:
        return 0.0
    whole = _stretch(trial, math.inf)
    begin, end = _unsteered(whole)
    return float(np.max(np.abs(whole.throttle[begin:end]))) if _is_straight(whole, begin, end) else 0.0


def _unsteered(whole: _Stretch) -> tuple[int, int]:
    """Return the first and the last index + 1 of the first time under throttle alone; equal if there is none."""
    driven = np.abs(whole.throttle) > IDLE
    if not driven.any():
        return 0, 0
    begin = int(np.argmax(driven))
    steered = np.flatnonzero((np.abs(whole.steering[begin:]) >= STEERED) | ~driven[begin:])
    return begin, begin + int(steered[0]) if len(steered) else len(whole.t)


def _is_straight(whole: _Stretch, begin: int, end: int) -> bool:
    """Return whether the craft ran straight between two indices, for long enough that a dead thruster would show."""
    if end - begin < FEWEST // 3 or float(whole.t[end - 1] - whole.t[begin]) < STRAIGHT:
        return False
    heading = np.cumsum(whole.rate[begin:end] * np.gradient(whole.t[begin:end]))
    return float(np.ptp(heading)) < LEAST_TURN / 4.0


def _unstable_hull(whole: _Stretch, turned: float) -> str:
    """Return a clause if the record fits a hull that does not keep its course by itself; else empty.

    A thruster that is reversed or dead turns the craft as soon as the throttle is applied. An unstable hull continues a
    turn that it had before, or runs straight until it is steered. *turned* [rad]: turn under throttle alone.
    """
    begin, end = _unsteered(whole)
    if end - begin < 2:
        return ""
    start, way = float(np.median(whole.rate[: begin + 1])), math.copysign(1.0, turned)
    mean = way * float(np.mean(whole.rate[begin:end]))
    if 0.0 < MOSTLY * mean < way * start:
        why = f"it was already turning at {_degrees(start)}/s when the throttle was applied"
    elif end < len(whole.t) and _is_straight(whole, begin, end):
        why = "it ran straight under throttle until it was steered"
    else:
        return ""
    return f"the hull does not keep its course by itself: {why}"


def _turned_by_thrust(s: _Stretch) -> bool:
    """Return whether the throttle, and not the steering, turned the craft."""
    if len(s.t) < FEWEST or s.seconds <= 0.0:
        return False
    by_steering, by_throttle = _accelerations(s)
    steered, driven = (
        abs(by) * math.sqrt(float(np.mean(x**2))) for by, x in ((by_steering, s.steering), (by_throttle, s.throttle))
    )
    return driven > steered and abs(float(np.mean(s.throttle))) > IDLE and by_steering > -STEERED * abs(by_throttle)


def turning_time(trial: Trial, output: float) -> float:
    """Return the distance that the craft of *trial* needs to turn around, as the time [s] of straight travel.

    With a constant steering *output* [fraction of full] a craft with time constant T and steady turn rate r goes on
    ahead for T + 1/r (Nomoto1957: first order, small drift). The short pulses of a sign check show the acceleration
    r/T, but hardly T. With T unknown the distance is at least 2/sqrt(r/T), and :data:`LONG` times this is returned. NaN
    if the record does not show the acceleration.
    """
    if "N" not in trial or "psi" not in trial:
        return math.nan
    whole = _stretch(trial, math.inf)
    if len(whole.t) < FEWEST or min(float(np.max(side * whole.steering)) for side in (1.0, -1.0)) < STEERED:
        return math.nan  # without steering to both sides, drag and a constant disturbance look alike
    by_steering, growth = _turning_response(whole)
    if not by_steering > 0.0:
        return math.nan
    unit = 1.0 / math.sqrt(by_steering * output)
    slow = -1.0 / (growth * unit) if growth < 0.0 else math.inf  # T, as a multiple of that of the shortest distance
    return min(slow + 1.0 / slow, 2.0 * LONG) * unit if slow > 1.0 else (slow + 1.0 / slow) * unit


def _turning_response(s: _Stretch) -> tuple[float, float]:
    """Return the turning acceleration [rad/s^2] due to full steering, and that due to the turn rate itself [1/s].

    The equation of motion is integrated twice, so that the heading is not differentiated: its noise would be taken for
    drag. Angle and rate at the start are unknowns.
    """
    steps = np.diff(s.t, prepend=s.t[0])
    turned = np.cumsum(steps * s.rate)
    twice = [np.cumsum(steps * np.cumsum(steps * part)) for part in (s.steering, s.throttle)]
    design = np.column_stack([*twice, np.cumsum(steps * turned), np.ones(len(s.t)), s.t - s.t[0]])
    found = np.linalg.lstsq(design, turned, rcond=None)[0]
    return float(found[0]), float(found[2])


def _accelerations(s: _Stretch) -> tuple[float, float]:
    """Return the turning accelerations [rad/s^2] due to full steering and full throttle.

    They come from a regression of the turn rate on the integrals of both inputs, and on its own integral for the drag.
    A ship that is unstable on course also turns against its steering while it is being corrected, but the steering
    slows that turn.
    """
    steps = np.diff(s.t, prepend=s.t[0])
    design = np.column_stack([np.cumsum(steps * part) for part in (s.steering, s.throttle, s.rate)])
    found = np.linalg.lstsq(design, s.rate - s.rate[0], rcond=None)[0]
    return float(found[0]), float(found[1])


def tripped(error: GuardTripped) -> str:
    """Return a sentence that states which safety limit tripped.

    No larger limit is suggested, because the cause is already reported.
    """
    return f"This exceeded the safety limit '{error.guard}'. The actuators were set to neutral"


def _degrees(angle: float) -> str:
    return f"{abs(math.degrees(angle)):.0f} deg"


def _wrong_thruster(firmware: Firmware, servos: ServoMap, turned: float) -> str:
    """Return which of two thrusters is reversed or dead, judged by the side to which thrust *turned* the craft.

    Empty if unclear.
    """
    if firmware.frame_parameter or len(servos.driving("X")) < 2:
        return ""
    pulls = [o for o, factor in servos.driving("N") if factor * turned < 0.0]
    if len(pulls) != 1:
        return ""
    output = pulls[0]
    now = int(output.sign < 0.0)
    return (
        f"one of the two thrusters is reversed or dead, most likely the one on SERVO{output.channel}. Set "
        f"SERVO{output.channel}_REVERSED to {1 - now} (it is {now}), or repair it"
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Stretch:
    """The last part of a record: time [s], steering and throttle [fraction of full] and turn rate [rad/s], (n,)
    each."""

    t: Array
    steering: Array
    throttle: Array
    rate: Array

    @property
    def seconds(self) -> float:
        return float(self.t[-1] - self.t[0]) if len(self.t) else 0.0

    @property
    def turned(self) -> float:
        return float(np.trapezoid(self.rate, self.t)) if len(self.t) else 0.0


def _stretch(trial: Trial, seconds: float) -> _Stretch:
    """Return the last *seconds* of *trial*; empty if there are too few samples."""
    psi = trial["psi"]
    good = np.isfinite(psi.values) & (psi.t >= psi.t[-1] - seconds)
    t, first = np.unique(psi.t[good], return_index=True)
    if len(t) < 5:
        return _Stretch(*(np.empty(0) for _ in range(4)))
    rate = np.gradient(np.unwrap(psi.values[good][first]), t)
    steering, throttle = (
        np.array([trial[n].held_at(float(moment)) if n in trial and len(trial[n]) else 0.0 for moment in t])
        for n in ("N", "X")
    )
    return _Stretch(t, steering, throttle, rate)


def _alike(s: _Stretch, late: float) -> float:
    """Return the correlation (-1..1, about zero) of the rate with the steering *late* [s] before it."""
    if not len(s.t):
        return 0.0
    before = np.interp(s.t - late, s.t, s.steering)
    size = math.sqrt(float(before @ before) * float(s.rate @ s.rate))
    return float(before @ s.rate) / size if size > 0.0 else 0.0


GRAVE = ("psi against r", "psi against track", "z against w")
"""Pairs of signals that closed loops depend on."""


def contradiction_in(trial: Trial) -> str:
    """Return a sentence on sensors that contradict each other in a record and are used in closed loops; empty if
    none."""
    found = next((c for c in contradictions(trial) if c.pair in GRAVE), None)
    if found is None:
        return ""
    check = found.cure.partition(". Until then")[0]  # a flight uses all signals: no column can be omitted
    return f"{found.cause}. {check[0].upper()}{check[1:]}"
