"""Spirals and pull-outs: the steady yaw rate over the rudder angle, and directional stability.

*Direct* spiral (Dieudonne): the rudder is held at one angle after the other, from one side to the other and back, each
until the rate is steady. A directionally unstable craft jumps at different angles in the two directions, which gives a
loop. *Reverse* spiral (Bech): the yaw rate is kept constant and the mean rudder angle is measured. An unstable craft
then has a curve with a backward slope. *Pull-out*: the rudder goes amidships from a steady turn. After turns to both
sides, a stable craft has the same small yaw rate (trim and wind). An unstable craft keeps turning in either direction.
The procedures are ITTC 7.5-04-02-01; stability is defined as in IMO MSC/Circ.1053.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify import Doubt
from gcs_autotune.identify.open_loop import (
    Reading,
    ShipLog,
    StepReading,
    find_holds,
    mean_reading,
    rate_of,
    read_steps,
    steered,
)
from gcs_autotune.identify.signals import prepare
from gcs_autotune.rounding import counted
from gcs_autotune.trial import Trial

__all__ = ["PullOut", "Spiral", "SpiralPoint", "read_pull_out", "read_reverse_spiral", "read_spiral"]

Array = NDArray[np.float64]

CLEAR = 3.0
"""Number of standard errors from which a loop, a backward slope or a difference is significant. Project choice."""

Verdict = Literal["stable", "unstable", "undecided"]


@dataclass(frozen=True, slots=True)
class SpiralPoint:
    """One steady state of a spiral.

    - ``helm`` [unit of the input], ``rate`` [rad/s]: helm and yaw rate.
    - ``way``: +1 if the helm was increased to this value, -1 if it was decreased, 0 for neither.
    """

    helm: Reading
    rate: Reading
    way: float


@dataclass(frozen=True, slots=True, eq=False)
class Spiral:
    """Curve of a spiral, with the verdict on directional stability.

    - ``residual_rate`` [rad/s]: for a direct spiral, half the difference of the rates in both directions at zero helm.
      For a reverse spiral, the rate at which the curve crosses zero helm away from the middle. It is 0 for a stable
      craft.
    - ``width``: helm between the jumps (direct) or between the turning points of the curve (reverse).
    - ``slope`` [rad/s per unit of helm]: slope of the curve at zero helm, in the direction of the helm; NaN inside a
      loop.
    """

    run: str
    kind: Literal["direct", "reverse"]
    points: tuple[SpiralPoint, ...]
    residual_rate: Reading
    width: Reading
    slope: float
    verdict: Verdict
    doubts: tuple[Doubt, ...]


def read_spiral(trial: Trial, log: ShipLog) -> Spiral:
    """Return the direct spiral in *trial*.

    Raises
    ------
    NotInformative
        There are fewer than three steady helm angles in each direction.
    """
    orders = [m.t for m in trial.marks if m.kind == "execute"]
    trial = steered(trial)
    readings = read_steps(prepare(trial.between(orders[0], trial.end) if orders else trial, "yaw"))
    steady = [r for r in readings if r.settled]
    ways = _ways([r.tau for r in steady])
    points = tuple(
        SpiralPoint(Reading(r.tau, 0.0, log.steering.unit), r.k_ss, way) for r, way in zip(steady, ways, strict=True)
    )
    up, down = [p for p in points if p.way > 0.0], [p for p in points if p.way < 0.0]
    if min(len(up), len(down)) < 3:
        raise NotInformative(
            f"run '{log.name}' contains no usable spiral: {len(up)} steady helm angles with rising helm and "
            f"{len(down)} with falling helm. At least three of each are needed"
        )
    sense = float(np.sign(np.polyfit([p.helm.value for p in points], [p.rate.value for p in points], 1)[0])) or 1.0
    residual, at_up, at_down = _loop(up, down, sense)
    noise = max(residual.std, 1e-12)
    unstable = residual.value > CLEAR * noise and at_up * at_down < 0.0 and sense * at_down > 0.0
    width = _jump_width(up, down, sense) if unstable else Reading(0.0, math.nan, log.steering.unit)
    doubts = list(log.doubts)
    restless = len(readings) - len(steady)
    if restless:
        doubts.append(
            Doubt(
                "not-settled",
                f"left out, without a steady turn rate: {counted(restless, 'helm angle')}",
                "hold each angle until the turn rate is steady",
            )
        )
    smallest = min(abs(p.helm.value) for p in points)
    largest = max(abs(p.helm.value) for p in points)
    verdict: Verdict = "unstable" if unstable else "stable"
    if not unstable and smallest > 0.25 * largest:
        verdict = "undecided"
        doubts.append(
            Doubt(
                "no-small-helm",
                "no helm near amidships was held, so a hysteresis loop may be missed",
                "use smaller helm steps near amidships",
            )
        )
    slope = math.nan if unstable else _central_slope(points)
    return Spiral(log.name, "direct", points, residual, width, slope, verdict, tuple(doubts))


def _ways(helms: Sequence[float]) -> list[float]:
    """Return for every helm whether it was reached by raising (+1) or lowering (-1); 0 for the first."""
    steps = [float(np.sign(b - a)) for a, b in itertools.pairwise(helms)]
    return [0.0, *steps] if helms else []


def _at_zero(points: Sequence[SpiralPoint]) -> Reading:
    """Return the rate at zero helm, interpolated between the nearest helms on both sides."""
    ordered = sorted(points, key=lambda p: p.helm.value)
    helms = np.array([p.helm.value for p in ordered])
    if helms[0] > 0.0 or helms[-1] < 0.0:
        return Reading(math.nan, math.nan, "rad/s")
    exact = np.flatnonzero(np.abs(helms) <= 0.01 * float(np.ptp(helms)))
    if len(exact):
        return ordered[int(exact[0])].rate
    i = int(np.searchsorted(helms, 0.0))
    share = -helms[i - 1] / (helms[i] - helms[i - 1])
    a, b = ordered[i - 1].rate, ordered[i].rate
    return Reading((1.0 - share) * a.value + share * b.value, math.hypot((1.0 - share) * a.std, share * b.std), "rad/s")


def _loop(up: Sequence[SpiralPoint], down: Sequence[SpiralPoint], sense: float) -> tuple[Reading, float, float]:
    """Return half the loop's height at zero helm, and the rates in both directions."""
    one, other = _at_zero(up), _at_zero(down)
    # coming down from large helm the craft keeps turning to that side: sense * (down - up) > 0 in a loop
    half = 0.5 * sense * (other.value - one.value)
    return Reading(half, 0.5 * math.hypot(one.std, other.std), "rad/s"), one.value, other.value


def _jump_width(up: Sequence[SpiralPoint], down: Sequence[SpiralPoint], sense: float) -> Reading:
    """Return the helm between the jumps: the difference of the helm at which the rate changes side, up and down."""
    borders = []
    for points, side in ((up, 1.0), (down, -1.0)):
        ordered = sorted(points, key=lambda p: side * p.helm.value)
        for a, b in itertools.pairwise(ordered):
            if a.rate.value * b.rate.value <= 0.0:
                borders.append((0.5 * (a.helm.value + b.helm.value), 0.5 * abs(b.helm.value - a.helm.value)))
                break
    if len(borders) < 2:
        return Reading(math.nan, math.nan, up[0].helm.unit)
    spread = math.hypot(borders[0][1], borders[1][1]) / math.sqrt(3.0)  # the jump lies anywhere between two helms
    return Reading(abs(borders[0][0] - borders[1][0]), spread, up[0].helm.unit)


def _central_slope(points: Sequence[SpiralPoint]) -> float:
    near = sorted(points, key=lambda p: abs(p.helm.value))[: max(4, len(points) // 3)]
    if len({round(p.helm.value, 9) for p in near}) < 2:
        return math.nan
    return float(np.polyfit([p.helm.value for p in near], [p.rate.value for p in near], 1)[0])


def read_reverse_spiral(trial: Trial, log: ShipLog) -> Spiral:
    """Return the reverse spiral in *trial*, from stretches of steady yaw rate and the mean helm of each stretch.

    The stretches are those between the marks ``rate`` of *trial*, if it has any.

    Raises
    ------
    NotInformative
        There are fewer than five steady rates, or none to one side.
    """
    measured = log.channel("r")
    if measured is not None:
        t, r = measured.t, measured.values
    else:
        t, r = (
            log.t,
            rate_of(log.t, log.psi, max(10.0 * float(np.median(np.diff(log.t))), (log.end - log.t[0]) / 200.0)),
        )
    smooth = np.convolve(np.pad(r, 4, mode="edge"), np.full(9, 1.0 / 9.0), mode="valid")
    stretch = (float(t[-1]) - float(t[0])) / 60.0
    points = []
    ordered = [*(m.t for m in trial.marks if m.kind == "rate"), trial.end]
    holds = find_holds(t, smooth, float(t[-1]), stretch) if len(ordered) == 1 else ()
    for start, end in [*((h.start, h.end) for h in holds), *itertools.pairwise(ordered)]:
        late = start + (0.3 if holds else 0.5) * (end - start)
        keep = (t >= late) & (t <= end)
        helm = log.steering.between(late, end)
        if int(keep.sum()) < 8 or len(helm) < 8:
            continue
        points.append(
            SpiralPoint(
                mean_reading(helm.t, helm.values, log.steering.unit), mean_reading(t[keep], r[keep], "rad/s"), 0.0
            )
        )
    points.sort(key=lambda p: p.rate.value)
    if len(points) < 5 or not points[0].rate.value < 0.0 < points[-1].rate.value:
        port = sum(p.rate.value < 0.0 for p in points)
        starboard = sum(p.rate.value > 0.0 for p in points)
        raise NotInformative(
            f"run '{log.name}' contains no usable reverse spiral: {len(points)} steady turn rates, {port} to port and "
            f"{starboard} to starboard. At least five are needed, with some to each side"
        )
    rates, helms = np.array([p.rate.value for p in points]), np.array([p.helm.value for p in points])
    weights = 1.0 / np.maximum([p.helm.std for p in points], 1e-3 * float(np.ptp(helms)))
    # helm = c0 + c1 r + c2 r^2 + c3 r^3: the simplest curve that can run back in its middle
    scale = float(np.max(np.abs(rates)))
    table = np.vander(rates / scale, 4, increasing=True) * weights[:, None]
    inverse = np.linalg.pinv(table.T @ table)
    c = inverse @ (table.T @ (helms * weights))
    left = helms * weights - table @ c
    spread = math.sqrt(float(inverse[1, 1]) * max(float(left @ left) / max(len(points) - 4, 1), 1e-12))
    sense = float(np.sign(helms[-1] - helms[0])) or 1.0
    slope = sense * float(c[1])
    verdict: Verdict = "unstable" if slope < -CLEAR * spread else "stable" if slope > CLEAR * spread else "undecided"
    nothing = Reading(0.0, math.nan, "rad/s")
    residual, width = nothing, replace(nothing, unit=log.steering.unit)
    if verdict == "unstable" and sense * c[3] > 0.0:
        rate = scale * math.sqrt(-float(c[1]) / float(c[3]))
        residual = Reading(rate, rate * spread / (2.0 * abs(slope)), "rad/s")
        turn = math.sqrt(-float(c[1]) / (3.0 * float(c[3])))
        width = Reading(abs(4.0 / 3.0 * float(c[1]) * turn), 2.0 * spread * turn, log.steering.unit)
    central = math.nan if verdict == "unstable" or c[1] == 0.0 else scale / float(c[1])
    return Spiral(log.name, "reverse", tuple(points), residual, width, central, verdict, log.doubts)


AMIDSHIPS = 0.15
"""Largest helm that counts as amidships, relative to the helm before it. Project choice."""

SMALL = 0.02
"""Residual yaw rate, relative to that of the turn, below which the craft has stopped turning. Project choice."""


@dataclass(frozen=True, slots=True, eq=False)
class PullOut:
    """Residual turning after the helm went amidships.

    - ``after_starboard``, ``after_port`` [rad/s]: residual yaw rates after a turn to starboard and to port, NaN if not
      flown.
    - ``turning`` [rad/s]: mean yaw rate of the turns before the pull-outs.
    - ``residual``: half the difference of the two residual rates, zero for a stable craft.
    - ``offset``: mean of the two residual rates, due to trim and wind.
    """

    run: str
    after_starboard: Reading
    after_port: Reading
    turning: Reading
    residual: Reading
    offset: Reading
    verdict: Literal["stable", "unstable", "undecided"]
    doubts: tuple[Doubt, ...]


def read_pull_out(trial: Trial, log: ShipLog) -> PullOut:
    """Return the pull-outs in *trial*.

    Raises
    ------
    NotInformative
        The helm never goes amidships from a steady turn, or not for long enough.
    """
    largest = float(np.max(np.abs(log.steering.values)))
    pulls = [
        s
        for s in read_steps(prepare(steered(trial), "yaw"))
        if abs(s.before) > 0.3 * largest and abs(s.tau) < AMIDSHIPS * abs(s.before) and not s.steady_only
    ]
    if not pulls:
        raise NotInformative(f"run '{log.name}' contains no pull-out: the helm is never set amidships in a turn")
    starboard, port = _mean([p for p in pulls if p.nu_0.value > 0.0]), _mean([p for p in pulls if p.nu_0.value < 0.0])
    turning = float(np.mean([abs(p.nu_0.value) for p in pulls]))
    residual = Reading(0.5 * (starboard.value - port.value), 0.5 * math.hypot(starboard.std, port.std), "rad/s")
    offset = Reading(0.5 * (starboard.value + port.value), residual.std, "rad/s")
    doubts = list(log.doubts)
    settled = all(p.settled for p in pulls)
    if not settled:
        doubts.append(
            Doubt(
                "not-settled",
                "the turn rate was not yet steady at the end of a pull-out",
                "record until the turn rate is steady",
            )
        )
    verdict: Literal["stable", "unstable", "undecided"] = "undecided"
    if math.isfinite(residual.value):
        small = abs(residual.value) < max(SMALL * turning, CLEAR * residual.std)
        verdict = "stable" if small else "unstable" if settled and residual.value > 0.0 else "undecided"
    else:
        doubts.append(
            Doubt(
                "one-side",
                "pull-outs from one side only do not distinguish trim from instability",
                "fly pull-outs from both sides",
            )
        )
    return PullOut(
        log.name, starboard, port, Reading(turning, math.nan, "rad/s"), residual, offset, verdict, tuple(doubts)
    )


def _mean(pulls: list[StepReading]) -> Reading:
    """Return the mean residual rate of pull-outs from one side."""
    if not pulls:
        return Reading(math.nan, math.nan, "rad/s")
    values = np.array([p.k_ss.value for p in pulls])
    noise = math.sqrt(sum(p.k_ss.std**2 for p in pulls)) / len(pulls)
    scatter = float(values.std(ddof=1)) / math.sqrt(len(values)) if len(values) > 1 else 0.0
    return Reading(float(values.mean()), max(noise, scatter), "rad/s")
