"""How well a craft steps to a position and holds it against a push, and whether other gains are better."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from statistics import fmean

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.design.verdict import Verdict
from gcs_autotune.notebook import Displayed

__all__ = ["UNSTABLE", "PositionMetrics", "Stay", "holds_better", "position_metrics"]

Array = NDArray[np.float64]
Track = NDArray[np.complex128]

CALM = 1.0
"""Length of the moving mean of positions [s]. Project choice: it takes two thirds of the noise of a position at 10 Hz,
and is shorter than an ROV's step."""
RISEN = 0.9
"""Share of the step at which it counts as done."""
RATIO = 0.95
"""Largest ratio of the new to the old figures: at least 5 % lower on average. Project choice, as for steps."""
EACH = 1.1
"""Largest ratio of each of the figures. Project choice: two steps with the same gains differ by that much."""
OVERSHOOT, MORE = 0.15, 0.05
"""Overshoot that is always allowed, and increase that counts as scatter [fraction of the step]. Project choice."""
TRAVEL, TRAVEL_RATIO = 1.0, 3.0
"""Actuator travel that is always allowed [full strokes per second], and its largest ratio: as for steps."""


@dataclass(frozen=True, slots=True)
class Stay:
    """A phase of a flight: where the craft should be (``place``, north + i east, m) from ``start`` to ``end`` [s].

    ``before``: where it should have been before; equal to ``place`` if it only holds.
    """

    start: float
    end: float
    place: complex
    before: complex


@dataclass(frozen=True, slots=True)
class PositionMetrics(Displayed):
    """Figures of a step out and back, and of holding; infinite for an unstable loop.

    ``itae``: integral of time and distance from the target, relative to the step [s^2]. ``rise``: time to
    90 % of the step [s]; NaN if it is not reached. ``overshoot``: beyond the target [fraction of the step].
    ``hold``: rms distance while the position is held without a push [m].
    ``push``: rms distance during pushes and after them [m]; ``excursion``: the greatest one; NaN without a push.
    ``travel``: motion of the busiest actuator [full strokes per second].
    """

    itae: float
    rise: float
    overshoot: float
    hold: float
    push: float
    excursion: float
    travel: float

    def to_dict(self) -> dict[str, float]:
        """Return plain data."""
        return asdict(self)


UNSTABLE = PositionMetrics(math.inf, math.nan, math.inf, math.inf, math.inf, math.inf, math.inf)
"""Figures of a loop that did not hold its position."""


def position_metrics(
    step: tuple[Array, Track],
    steps: Sequence[Stay],
    push: tuple[Array, Track] | None,
    pushes: Sequence[Stay],
    held: Sequence[Stay],
    travel: float,
) -> PositionMetrics:
    """Return the figures of a step flight and of a push flight.

    step, push : times (n,) [s] and positions (n,) [m] of the two flights. steps, held : phases of the first;
    pushes : of the second. travel : as measured.
    """
    t, track = step[0], _calmed(*step)
    answers = [_step(t, track, stay) for stay in steps]
    itae, rise, overshoot = (fmean(values) for values in zip(*answers, strict=True))
    hold = _rms(np.concatenate([_away(t, track, stay) for stay in held]))
    if push is None or not pushes:
        return PositionMetrics(itae, rise, overshoot, hold, math.nan, math.nan, travel)
    track = _calmed(*push)
    pushed = np.concatenate([_away(push[0], track, stay) for stay in pushes])
    return PositionMetrics(itae, rise, overshoot, hold, _rms(pushed), float(pushed.max()), travel)


def _step(t: Array, track: Track, stay: Stay) -> tuple[float, float, float]:
    inside = (t >= stay.start) & (t < stay.end)
    since, size = t[inside] - stay.start, abs(stay.place - stay.before)
    gone = (track[inside] - stay.before) / (stay.place - stay.before)
    itae = float(np.trapezoid(since * np.abs(gone - 1.0), since)) if size > 0.0 else math.nan
    there = np.flatnonzero(gone.real >= RISEN)
    rise = float(since[there[0]]) if len(there) else math.nan
    return itae, rise, max(float(gone.real.max()) - 1.0, 0.0)


def _away(t: Array, track: Track, stay: Stay) -> Array:
    distance: Array = np.abs(track[(t >= stay.start) & (t < stay.end)] - stay.place)
    return distance


def _calmed(t: Array, track: Track) -> Track:
    """Return the centred moving mean of *track* (n,) over :data:`CALM`."""
    half = max(round(0.5 * CALM / float(np.median(np.diff(t)))), 1)
    padded = np.concatenate([np.full(half, track[0]), track, np.full(half, track[-1])])
    mean: Track = np.convolve(padded, np.full(2 * half + 1, 1.0 / (2 * half + 1)), mode="valid")
    return mean


def _rms(values: Array) -> float:
    return math.sqrt(float(np.mean(values**2))) if len(values) else math.nan


def holds_better(before: PositionMetrics, after: PositionMetrics, *, pushed: bool = True) -> Verdict:
    """Compare two flights: step and push must be better on average, and nothing clearly worse.

    pushed : whether pushes are flown. Otherwise the distance while holding is compared, as for a boat, which current
    and wind carry away.
    """
    if not math.isfinite(after.itae):
        return Verdict(((False, "with the new gains the craft went far off its target, as with an unstable loop"),))
    if not math.isfinite(before.itae):
        return Verdict(
            ((True, "with the old gains the craft went far off its target, and with the new ones it did not"),)
        )
    pairs = [("step error (ITAE)", "s^2", before.itae, after.itae)]
    if not pushed:
        pairs.append(("distance while holding, rms", "m", before.hold, after.hold))
    elif math.isfinite(before.push) and math.isfinite(after.push):
        pairs.append(("distance under the push, rms", "m", before.push, after.push))
    ratios = [new / old for _, _, old, new in pairs]
    lines = []
    for (what, unit, old, new), ratio in zip(pairs, ratios, strict=True):
        tail = "" if ratio <= EACH else f", more than {EACH:.0%} of it"
        lines.append((ratio <= EACH, f"{what} {old:.3g} -> {new:.3g} {unit}{tail}"))
    mean = fmean(ratios)
    tail = "" if mean <= RATIO else f"; at least {1.0 - RATIO:.0%} lower is required"
    lines.append((mean <= RATIO, f"on average {abs(1.0 - mean):.0%} {'lower' if mean <= 1.0 else 'higher'}{tail}"))
    most = max(OVERSHOOT, before.overshoot + MORE)
    tail = "" if after.overshoot <= most else f", more than the {most:.0%} allowed"
    lines.append(
        (after.overshoot <= most, f"overshoot {before.overshoot:.0%} -> {after.overshoot:.0%} of the step{tail}")
    )
    most = max(TRAVEL, TRAVEL_RATIO * before.travel)
    tail = "" if after.travel <= most else f", more than the {most:.2f} allowed"
    lines.append(
        (after.travel <= most, f"actuator travel {before.travel:.2f} -> {after.travel:.2f} strokes per second{tail}")
    )
    return Verdict(tuple(lines))
