"""Compare positions with the integrals of their rates: heading, roll, pitch and depth."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from gcs_autotune.crosscheck.agreement import Comparison, Expected, compare
from gcs_autotune.crosscheck.contradiction import Contradiction
from gcs_autotune.crosscheck.windows import Series, integral, series
from gcs_autotune.crosscheck.wording import contradiction_from
from gcs_autotune.sname import SIGNALS
from gcs_autotune.trial import Channel, Trial

__all__ = ["compared_with_rate", "rate_contradictions"]

FULL_TURN = 2.0 * math.pi
_TURN = Expected(offset=math.radians(0.5), floor=math.radians(0.4), way=math.radians(45.0))
_CLIMB = Expected(offset=0.03, floor=0.02, way=0.5, shift=0.6, tolerance=0.25)
"""The tolerance is larger than for turns: in oscillations with a period of 3 s, the depth that ArduSub's EKF reports
changes 1.10 to 1.13 times as much as that of the hull, and its vertical speed is right (measured with ArduSub of
December 2025 on our hull). Slow motion is right in both. Errors of a unit (feet: 3.28) are far larger.
"""

Rates = Callable[[Trial], Channel | None]


@dataclass(frozen=True, slots=True)
class _Pair:
    """A position and its rate.

    - ``verb``: text for the motion of the position.
    - ``earth``: function that rotates the rate to the earth frame by the attitude.
    """

    position: str
    rate: str
    verb: str
    expected: Expected
    angle: bool
    earth: Rates


def _with(trial: Trial, main: str, *others: str) -> Mapping[str, np.ndarray] | None:
    """Return channel *main* with the *others* at its stamps; return None if one is missing."""
    if any(n not in trial or len(trial[n]) < 2 for n in (main, *others)):
        return None
    t = trial[main].t
    found = {main: trial[main].values}
    for name in others:
        other = trial[name]
        good = np.isfinite(other.t) & np.isfinite(other.values)
        if good.sum() < 2:
            return None
        found[name] = np.interp(t, other.t[good], other.values[good])
    return found


def _heading_rate(trial: Trial) -> Channel | None:
    c = _with(trial, "r", "q", "phi", "theta")
    if c is None:
        return None
    rate = (c["q"] * np.sin(c["phi"]) + c["r"] * np.cos(c["phi"])) / np.maximum(np.cos(c["theta"]), 0.2)
    return replace(trial["r"], values=rate)


def _roll_rate(trial: Trial) -> Channel | None:
    c = _with(trial, "p", "q", "r", "phi", "theta")
    if c is None:
        return None
    turning = c["q"] * np.sin(c["phi"]) + c["r"] * np.cos(c["phi"])
    return replace(trial["p"], values=c["p"] + turning * np.tan(np.clip(c["theta"], -1.3, 1.3)))


def _pitch_rate(trial: Trial) -> Channel | None:
    c = _with(trial, "q", "r", "phi")
    return None if c is None else replace(trial["q"], values=c["q"] * np.cos(c["phi"]) - c["r"] * np.sin(c["phi"]))


def _climb(trial: Trial) -> Channel | None:
    c = _with(trial, "w", "u", "theta")
    if c is None:
        return None
    return replace(trial["w"], values=c["w"] * np.cos(c["theta"]) - c["u"] * np.sin(c["theta"]))


_PAIRS = (
    _Pair("psi", "r", "turns", _TURN, True, _heading_rate),
    _Pair("phi", "p", "turns", _TURN, True, _roll_rate),
    _Pair("theta", "q", "turns", _TURN, True, _pitch_rate),
    _Pair("z", "w", "changes", _CLIMB, False, _climb),
)


def rate_contradictions(trial: Trial, course: Callable[[Trial], Series | None]) -> Iterator[Contradiction]:
    """Yield the contradictions between positions and their rates in *trial*.

    course : function that returns the course over ground [rad] of a run, for comparison with the heading.
    """
    for pair in _PAIRS:
        if pair.position not in trial or pair.rate not in trial:
            continue
        position = series(trial[pair.position], angle=pair.angle)
        if position is None:
            continue
        found = _compared(position, trial[pair.rate], pair.expected)
        if found is None or found.kind == "agrees":
            continue
        turned = pair.earth(trial)
        if turned is not None:
            other = _compared(position, turned, pair.expected)
            if other is None or other.kind == "agrees":  # None: a heeled craft that turns has q without any pitching
                continue
        suspect = _suspect(trial, pair, found, position, course)
        yield contradiction_from(trial.name, pair.position, pair.rate, pair.verb, found, suspect)


def compared_with_rate(position: Channel, rate: Channel) -> Comparison | None:
    """Return the comparison of *position* with *rate*, or None if the two are not a known pair, or if there is too
    little motion.
    """
    pair = next((p for p in _PAIRS if (p.position, p.rate) == (position.name, rate.name)), None)
    known = None if pair is None else series(position, angle=pair.angle)
    return None if pair is None or known is None else _compared(known, rate, pair.expected)


def _compared(position: Series, rate: Channel, expected: Expected) -> Comparison | None:
    known = series(rate)
    return None if known is None else compare(position, known, integral(known), expected)


def _suspect(
    trial: Trial, pair: _Pair, comparison: Comparison, position: Series, course: Callable[[Trial], Series | None]
) -> str:
    """Return the column that is more likely wrong: one that does not change, or that a third one contradicts."""
    if comparison.kind == "still-position":
        return pair.position
    if comparison.kind == "still-rate":
        return pair.rate
    if not SIGNALS[pair.position].wraps:
        return ""
    track = course(trial)
    if track is not None:
        rate = series(trial[pair.rate])
        by_rate = None if rate is None else compare(track, rate, integral(rate), _TURN)
        by_heading = compare(track, position, position.x, _TURN)
        rate_agrees = by_rate is not None and by_rate.kind == "agrees" and by_rate.coherence > 0.5
        heading_agrees = by_heading is not None and by_heading.kind == "agrees" and by_heading.coherence > 0.5
        if rate_agrees != heading_agrees:
            return pair.position if rate_agrees else pair.rate
    if comparison.kind in ("factor", "sign") and _wraps(trial["psi"]):
        return pair.rate if comparison.kind == "factor" and abs(comparison.coherence) > 0.9 else ""
    return ""


def _wraps(psi: Channel) -> bool:
    """Return whether the heading jumps by a full turn somewhere, which confirms its scale."""
    steps = np.abs(np.diff(psi.values[np.isfinite(psi.values)]))
    return bool(np.any(np.abs(steps / FULL_TURN - 1.0) < 0.1))
