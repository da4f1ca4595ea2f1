"""Identify surge of a boat with speed: inertia, drag and thrust curve together.

Thrust is rarely proportional to throttle, because the thrust of a propeller grows with the square of its speed. The
input is replaced by ``(1 - q) X + q X|X|`` (the affine thruster of Miskovic2010 (2.7), gain 1 at full throttle). The
exact axis fit is repeated at several values of ``q``. The misfit as a function of ``q`` is the profile of ``q``. The
curvature of the profile determines the standard error of ``q``. The slopes of the other parameters along the profile
add this error to their standard errors.

Throttle steps are flown in one direction and then in the opposite one. Speed is measured over ground: a head current or
wind reduces it, a following one raises it. Half the difference is the current along the track. Thrust and drag depend
only on the speed through the water, so the current is subtracted before the fit.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects import EffectInstance
from gcs_autotune.errors import MissingChannel, NotInformative
from gcs_autotune.identify.api import fit_axis
from gcs_autotune.identify.axis.form import Structure, structure_of
from gcs_autotune.identify.doubt import Doubt
from gcs_autotune.identify.free_run import free_run
from gcs_autotune.identify.result import AxisFit, Parameter
from gcs_autotune.trial import Trial

__all__ = [
    "CURVE",
    "AlongTrack",
    "along_track",
    "bent",
    "doubt_of",
    "fit_surge",
    "set_on_the_way_back",
    "square_of",
    "through_water",
]

Array = NDArray[np.float64]

CURVE = "thrust_curve"
"""Key of the thrust curve in ``AxisFit.extra``."""
BY_DESIGN = ("one-sided-input", "saturated-input")
"""Slugs of doubts that are expected for surge runs, in which a boat has speed and a burst of full throttle is flown."""

GRID = (-0.3, 0.2, 0.7, 1.2)
LEAST, MOST = -0.3, 1.3
"""Range of ``q``, the quadratic fraction of the thrust, in the profile. Project choice.

It exceeds the physical range 0 to 1 a little, because an ESC's dead zone bends the curve too.
"""
ROUNDS = 6
"""Maximum number of parabolas fitted in the search for the best ``q``.

Each passes through the best point so far and its neighbours. Project choice.
"""
NEAR, FAR = 0.5, 2.0
"""Limits of the distance, in standard errors, of a neighbour that is used for a parabola. Project choice.

With closer neighbours rounding dominates. Farther neighbours do not lie on the parabola, because the profile is steeper
towards larger ``q``.
"""
FOUND = 0.1
"""Distance from the minimum of the parabola to the nearest point, in standard errors, below which the search ends.

Project choice.
"""
UNKNOWN = 0.25
"""Standard error of ``q`` above which the curve counts as unknown. Project choice."""


@dataclass(frozen=True, slots=True, eq=False)
class _Point:
    square: float
    fit: AxisFit

    @property
    def misfit(self) -> float:
        """Mean square of the residual. As a function of ``q`` it is nearly a parabola, more so than its logarithm."""
        return self.fit.residual_rms**2

    @property
    def samples(self) -> int:
        """Number of samples in the fit."""
        return sum(len(trace.t) for trace in self.fit.traces)

    @property
    def correlation(self) -> float:
        """Number of samples that are equivalent to one independent sample."""
        return max(float(self.fit.extra.get("residual_correlation_time", 1.0)), 1.0)


def bent(trial: Trial, square: float) -> Trial:
    """Return *trial* with the throttle ``X`` (fraction of full throttle) replaced by the thrust (fraction of full
    thrust).

    square : fraction of the thrust that is quadratic in throttle.
    """
    X = trial["X"]
    return replace(
        trial,
        channels={
            **trial.channels,
            "X": replace(X, values=(1.0 - square) * X.values + square * X.values * np.abs(X.values)),
        },
    )


def square_of(fit: AxisFit) -> float:
    """Return the fraction of thrust of *fit* that is quadratic in throttle, at most 1.

    It is 0 if *fit* has no thrust curve.
    """
    return min(float(fit.extra.get(CURVE, {}).get("square", 0.0)), 1.0)


def fit_surge(
    trials: Sequence[Trial],
    *,
    structure: Structure | None = None,
    delay: Literal["auto"] | float = "auto",
    along: AlongTrack | None = None,
    square: tuple[float, float] | None = None,
) -> AxisFit:
    """Identify surge from runs with ``u``, and with ``X`` as a fraction of full throttle.

    along : current from another source, used if the runs do not show it themselves.
    square : quadratic fraction of the thrust and its standard error, if known from a pull test; None: identified.

    Returns
    -------
    AxisFit
        ``extra["thrust_curve"]`` contains ``square`` and ``std``. The other standard errors include the uncertainty of
        the curve. ``X`` of the model is thrust as a fraction of that at full throttle.

    Raises
    ------
    MissingChannel, BadFile, NotInformative
        :func:`gcs_autotune.identify.fit_axis` raised the error.
    """
    along = along_track(trials) or along
    if along is None or not along.matters:
        return _fit(trials, structure, delay, square)
    fitted = _fit([through_water(t, along) for t in trials], structure, delay, square)
    return replace(fitted, doubts=(*fitted.doubts, doubt_of(along)))


def _fit(
    trials: Sequence[Trial],
    structure: Structure | None,
    delay: Literal["auto"] | float,
    known: tuple[float, float] | None = None,
) -> AxisFit:
    first = fit_axis(list(trials), dof="surge", structure=structure, delay=delay)
    lag = first.model.delay

    def at(square: float, drag: Structure | None) -> _Point:
        runs = [bent(t, square) for t in trials]
        return _Point(square, fit_axis(runs, dof="surge", structure=drag, delay=lag))

    if known is None:
        points = _profile(lambda q: at(q, structure or "affine"))
        best = min(points, key=lambda p: p.misfit)
        known = best.square, _spread(points, best)
    square, std = known
    final = fit_axis([bent(t, square) for t in trials], dof="surge", structure=structure, delay=delay)
    slope = _carried(final, lambda q: at(q, structure_of(final.structure)), square, std)
    with_square = _with_square(final, square, std, slope)
    largest = max(float(np.max(np.abs(t["X"].values))) for t in trials)  # not the thrust that it was bent to
    return replace(with_square, extra={**with_square.extra, "largest": {"X": largest}})


def _profile(at: Callable[[float], _Point]) -> list[_Point]:
    """Return the points of the profile: a grid, then the minimum and a point one standard error to each side."""
    points: list[_Point] = []

    def look(square: float) -> None:
        with suppress(NotInformative):
            points.append(at(square))

    for square in GRID:
        look(square)
    if not points:
        return [at(0.0)]
    for _ in range(ROUNDS):
        best = min(points, key=lambda p: p.misfit)
        std = min(_spread(points, best), UNKNOWN)
        sides = [q for q in (best.square - std, best.square + std) if LEAST <= q <= MOST]
        missing = [q for q in sides if not any(_neighbours(p.square - best.square, q - best.square) for p in points)]
        for square in missing:
            look(square)
        top = _top(points)
        if top is None or (not missing and min(abs(p.square - top) for p in points) < FOUND * std):
            break
        look(top)
    return points


def _neighbours(away: float, std: float) -> bool:
    """Return whether a point at the distance *away* can be used instead of one at the distance *std*.

    Both distances are signed, so the point must be on the same side.
    """
    return NEAR < away / std < FAR


def _parabola(points: Sequence[_Point]) -> Array | None:
    """Return the parabola through the best point and a neighbour on each side, if there are any.

    Return None if the parabola has no minimum.
    """
    best = min(points, key=lambda p: p.misfit)
    sides = [[p for p in points if way * (p.square - best.square) > 0.0] for way in (-1.0, 1.0)]
    near = [min(side, key=lambda p: abs(p.square - best.square)) for side in sides if side]
    rest = sorted((p for p in points if p is not best and p not in near), key=lambda p: abs(p.square - best.square))
    three = [best, *near, *rest][:3]
    if len(three) < 3:
        return None
    parabola: Array = np.polyfit([p.square for p in three], [p.misfit for p in three], 2)
    return parabola if parabola[0] > 0.0 else None


def _top(points: Sequence[_Point]) -> float | None:
    curve = _parabola(points)
    if curve is None:
        return None
    return float(np.clip(-curve[1] / (2.0 * curve[0]), LEAST, MOST))


def _spread(points: Sequence[_Point], best: _Point) -> float:
    """Return the standard error of ``q`` from the curvature of the profile, infinite without curvature."""
    curve = _parabola(points)
    if curve is None:
        return math.inf
    return math.sqrt(best.misfit * best.correlation / (best.samples * float(curve[0])))


def _carried(fit: AxisFit, at: Callable[[float], _Point], square: float, std: float) -> Array:
    """Return the change of the five parameters (5,) if ``q`` increases by its standard error."""
    reach = min(std, UNKNOWN)
    if not reach > 0.0:
        return np.zeros(5)
    ends = []
    for q in (square - reach, square + reach):
        try:
            m = at(q).fit.model
        except NotInformative:
            m = fit.model
        ends.append(np.array([m.alpha, m.beta, m.beta_quadratic, m.delta, 0.0]))
    slope: Array = 0.5 * (ends[1] - ends[0])
    return slope


def _with_square(fit: AxisFit, square: float, std: float, slope: Array) -> AxisFit:
    """Return *fit* with the thrust curve: ``q`` is added to the parameters, and its error to all standard errors."""
    reach = np.append(slope, min(std, UNKNOWN))
    covariance = np.outer(reach, reach)
    covariance[:5, :5] += fit.covariance
    curve = EffectInstance("quadratic-actuator", fit.model.axis.force, {"share": min(square, 1.0)}, {"u_ref": 1.0})
    stds = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    known = {n: replace(p, std=float(s)) for (n, p), s in zip(fit.parameters.items(), stds, strict=False)}
    label = curve.label_of("share")
    known[label] = Parameter(label, curve["share"], "1", std)
    doubts = tuple(d for d in fit.doubts if d.slug not in BY_DESIGN)
    if not std <= UNKNOWN:
        unknown = Doubt(
            "thrust-curve-unknown",
            "these runs hardly determine the relation between throttle and thrust",
            "fly with a larger --throttle, so that the throttle levels differ more",
        )
        doubts = (*doubts, unknown)
    extra = {**fit.extra, CURVE: {"square": square, "std": std}}
    return replace(fit, parameters=known, covariance=covariance, doubts=doubts, extra=extra, effects=(curve,))


OPPOSITE = math.cos(math.radians(140.0))
"""Limit for two runs to count as out and back: the cosine of their heading difference must be smaller.

Project choice.
"""
LEAST_CURRENT = 0.04
"""Smallest current that is reported [m/s]. Project choice: about the error of a GPS speed averaged over seconds."""
SHARE = 0.03
"""Largest ratio of current to speed that is ignored.

Project choice: no parameter changes by more than the usual error of the fit.
"""
SURE = 3.0
"""Number of standard errors that a current must exceed to be corrected. Project choice."""
AROUND = 1.5
"""Time [s] before a steady mark over which speed and heading are averaged. Project choice."""
BLOCK, LEAST_BLOCKS = 2.0, 4
"""Settings for the scatter of the speed. Project choice.

- ``BLOCK`` [s]: averaging time, over which the filter of a receiver settles.
- ``LEAST_BLOCKS``: smallest number of means for the scatter.
"""


@dataclass(frozen=True, slots=True)
class AlongTrack:
    """Speeds over ground out and back at the same throttles, from which the current along the track follows.

    - ``out``, ``back`` [m/s]: speeds over ground.
    - ``error`` [m/s]: standard error of the current :attr:`set`.
    - ``heading`` [rad]: heading of the outward run.
    """

    out: float
    back: float
    error: float
    heading: float

    @property
    def set(self) -> float:
        """Current along the track [m/s], or the effect of wind.

        It is half the difference of the speeds, and positive if the outward run was faster.
        """
        return 0.5 * (self.out - self.back)

    @property
    def matters(self) -> bool:
        """Whether the current is significant and large enough to be corrected."""
        speed = 0.5 * (self.out + self.back)
        return abs(self.set) > max(LEAST_CURRENT, SHARE * abs(speed), SURE * self.error)

    @property
    def is_none(self) -> bool:
        """Whether the current is negligible with certainty."""
        speed = 0.5 * (self.out + self.back)
        return abs(self.set) + SURE * self.error <= max(LEAST_CURRENT, SHARE * abs(speed))


def set_on_the_way_back(fit: AxisFit, out: Trial, back: Trial) -> AlongTrack | None:
    """Return the current along the track, from the difference between *back* and its prediction by *fit*.

    *fit* is the fit of the run *out*, and *back* is any run with X, u and psi. The fit absorbs the current of *out* as
    a constant force. On the way back the boat is therefore slower than predicted by twice the current, at any throttle
    (for quadratic drag a sixth less). The standard error follows from the scatter of the means over :data:`BLOCK`
    seconds. It includes errors of the fit at other speeds.

    Return None if *back* is not in the opposite direction, is too short, or cannot be simulated.
    """
    course, _ = _steady(out)
    psi = back["psi"].values
    heading = math.atan2(float(np.mean(np.sin(psi))), float(np.mean(np.cos(psi))))
    if not math.cos(course - heading) < OPPOSITE:
        return None
    try:
        trace = free_run(fit, bent(back, square_of(fit)))
    except (MissingChannel, NotInformative):
        return None
    inner = trace.t >= trace.t[0] + BLOCK  # where its motion began was fitted to it
    block = np.floor((trace.t[inner] - trace.t[0]) / BLOCK)
    late = [(trace.fitted - trace.measured)[inner][block == n] for n in np.unique(block)[:-1]]
    if len(late) < LEAST_BLOCKS:
        return None
    means = np.array([float(np.mean(x)) for x in late])
    error = 0.5 * float(np.std(means, ddof=1)) / math.sqrt(len(means))
    foretold = float(np.mean(trace.fitted[inner]))
    return AlongTrack(foretold, foretold - float(np.mean(means)), error, course)


def along_track(trials: Sequence[Trial]) -> AlongTrack | None:
    """Return the speeds of two runs flown out and back at the same throttles, or None without such runs."""
    runs = [(heading, speeds) for heading, speeds in map(_steady, trials) if speeds]
    for i, (out, first) in enumerate(runs):
        for back, second in runs[i + 1 :]:
            common = first.keys() & second.keys()
            if math.cos(out - back) < OPPOSITE and common:
                return _compared(out, [(first[level], second[level]) for level in sorted(common)])
    return None


def _steady(trial: Trial) -> tuple[float, dict[float, list[float]]]:
    """Return the mean heading [rad] at the steady marks, and throttle level -> steady speeds [m/s]."""
    speeds: dict[float, list[float]] = defaultdict(list)
    headings = []
    for mark in trial.marks:
        if mark.kind == "steady" and "psi" in trial:
            speeds[round(float(mark.detail["level"]), 6)].append(float(mark.detail["u"]))
            headings.append(trial["psi"].between(mark.t - AROUND, mark.t).values)
    psi = np.concatenate(headings) if headings else np.empty(0)
    heading = math.atan2(float(np.mean(np.sin(psi))), float(np.mean(np.cos(psi)))) if len(psi) else math.nan
    return heading, dict(speeds)


def _compared(heading: float, pairs: Sequence[tuple[list[float], list[float]]]) -> AlongTrack:
    out, back = ([float(np.mean(side)) for side in sides] for sides in zip(*pairs, strict=True))
    halves = 0.5 * (np.array(out) - np.array(back))
    again = [np.array(side) - np.mean(side) for pair in pairs for side in pair if len(side) > 1]
    scatter = float(np.sqrt(np.mean(np.concatenate(again) ** 2) * 2.0)) if again else LEAST_CURRENT
    between = float(np.std(halves, ddof=1)) if len(halves) > 1 else 0.0
    return AlongTrack(
        float(np.mean(out)), float(np.mean(back)), max(scatter, between) / math.sqrt(2.0 * len(halves)), heading
    )


def through_water(trial: Trial, along_track: AlongTrack) -> Trial:
    """Return *trial* with the current of *along_track* subtracted from ``u``, according to the heading."""
    u, psi = trial["u"], trial["psi"]
    headings = np.interp(u.t, psi.t, psi.values)
    still = u.values - along_track.set * np.cos(headings - along_track.heading)
    return replace(trial, channels={**trial.channels, "u": replace(u, values=still)})


def doubt_of(along_track: AlongTrack) -> Doubt:
    """Return a doubt about the current or wind along the track, with its value."""
    comes_from = math.degrees(along_track.heading + (math.pi if along_track.set > 0.0 else 0.0)) % 360.0
    return Doubt(
        "set-along-the-track",
        f"at the same throttles the boat made {along_track.out:.2f} m/s over ground one way and {along_track.back:.2f} "
        f"m/s the other. This indicates a current (or wind) of {abs(along_track.set):.2f} m/s from "
        f"{comes_from:03.0f} deg, which was corrected before the fit",
        "repeat in slack water and little wind. The correction covers only the direction of the track and treats "
        "wind as a current",
    )
