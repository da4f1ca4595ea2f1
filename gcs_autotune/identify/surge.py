"""Surge of a boat under way: inertia, drag and the thrust curve together.

Thrust is rarely proportional to throttle: a propeller's goes with the square of its speed. The input is bent by
``(1 - q) X + q X|X|`` (the affine thruster of Miskovic2010 (2.7), gain 1 at full throttle), and the exact axis fit is
made at several shares ``q``; the misfit along them is the profile of ``q``, its curvature gives the standard error,
and the slope of the other numbers along it carries that error into theirs.

Throttle steps are flown one way and then the other. Speed is measured over ground; with a current, or a wind, from
ahead the boat is slower by it, with it from astern quicker. Half the difference is the current along the track; thrust
and drag know only the speed through the water, so it is taken off before they are fitted.
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
from gcs_autotune.identify.free_numbers import label_of
from gcs_autotune.identify.free_run import free_run
from gcs_autotune.identify.result import AxisFit, Doubt, Parameter
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
"""Where in ``AxisFit.extra`` the thrust curve is told."""
BY_DESIGN = ("one-sided-input", "saturated-input")
"""Doubts of runs that are flown so on purpose: a boat under way, with a burst of full throttle."""

GRID = (-0.3, 0.2, 0.7, 1.2)
LEAST, MOST = -0.3, 1.3
"""The profile may end a little beyond the physical 0 to 1: an ESC's dead zone bends the curve, too."""
ROUNDS = 6
"""Parabolas at most, each through the best point so far and its neighbours on either side."""
NEAR, FAR = 0.5, 2.0
"""A neighbour is good for a parabola when it lies between so many standard errors away: nearer, and rounding shows;
farther, and the valley, which is steeper towards the larger shares, is no parabola any more."""
FOUND = 0.1
"""The valley's bottom is found when it moves by less than so many standard errors."""
UNKNOWN = 0.25
"""A standard error of the share above which the curve counts as unknown."""


@dataclass(frozen=True, slots=True, eq=False)
class _Point:
    square: float
    fit: AxisFit

    @property
    def misfit(self) -> float:
        """Mean square of what the model leaves over: nearly a parabola in the share, far more so than its logarithm."""
        return self.fit.residual_rms**2

    @property
    def samples(self) -> int:
        """How many samples were fitted."""
        return sum(len(trace.t) for trace in self.fit.traces)

    @property
    def correlation(self) -> float:
        """How many samples make one independent one."""
        return max(float(self.fit.extra.get("residual_correlation_time", 1.0)), 1.0)


def bent(trial: Trial, square: float) -> Trial:
    """Return *trial* with its throttle ``X`` (fractions of full) replaced by the thrust it gives."""
    X = trial["X"]
    return replace(
        trial,
        channels={
            **trial.channels,
            "X": replace(X, values=(1.0 - square) * X.values + square * X.values * np.abs(X.values)),
        },
    )


def square_of(fit: AxisFit) -> float:
    """Return the share of thrust that goes with throttle squared, 1 at most; 0 when *fit* knows of none."""
    return min(float(fit.extra.get(CURVE, {}).get("square", 0.0)), 1.0)


def fit_surge(
    trials: Sequence[Trial],
    *,
    structure: Structure | None = None,
    delay: Literal["auto"] | float = "auto",
    along: AlongTrack | None = None,
) -> AxisFit:
    """Identify surge from runs with ``X`` as a fraction of full throttle and ``u``.

    along : the set seen otherwise, for runs that do not show it themselves.

    Returns
    -------
    AxisFit
        ``extra["thrust_curve"]`` holds ``square`` and ``std``, the curve's uncertainty is in the other standard
        errors. ``X`` of the model is thrust as a fraction of that at full throttle.

    Raises
    ------
    MissingChannel, BadFile, NotInformative
        As :func:`gcs_autotune.identify.fit_axis`.
    """
    along = along_track(trials) or along
    if along is None or not along.matters:
        return _fit(trials, structure, delay)
    found = _fit([through_water(t, along) for t in trials], structure, delay)
    return replace(found, doubts=(*found.doubts, doubt_of(along)))


def _fit(trials: Sequence[Trial], structure: Structure | None, delay: Literal["auto"] | float) -> AxisFit:
    first = fit_axis(list(trials), dof="surge", structure=structure, delay=delay)
    lag = first.model.delay

    def at(square: float, drag: Structure | None) -> _Point:
        runs = [bent(t, square) for t in trials]
        return _Point(square, fit_axis(runs, dof="surge", structure=drag, delay=lag))

    points = _profile(lambda q: at(q, structure or "affine"))
    best = min(points, key=lambda p: p.misfit)
    std = _spread(points, best)
    final = fit_axis([bent(t, best.square) for t in trials], dof="surge", structure=structure, delay=delay)
    slope = _carried(final, lambda q: at(q, structure_of(final.structure)), best.square, std)
    found = _with_square(final, best.square, std, slope)
    largest = max(float(np.max(np.abs(t["X"].values))) for t in trials)  # not the thrust that it was bent to
    return replace(found, extra={**found.extra, "largest": {"X": largest}})


def _profile(at: Callable[[float], _Point]) -> list[_Point]:
    """Return the points looked at: a grid, then the bottom of the valley and, a standard error away, its sides."""
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
    """Whether a point so far *away* does for one that is wanted at a distance *std*, on the same side."""
    return NEAR < away / std < FAR


def _parabola(points: Sequence[_Point]) -> Array | None:
    """Return the parabola through the best point and one on either side (if there is); None if it is no valley."""
    best = min(points, key=lambda p: p.misfit)
    sides = [[p for p in points if way * (p.square - best.square) > 0.0] for way in (-1.0, 1.0)]
    near = [min(side, key=lambda p: abs(p.square - best.square)) for side in sides if side]
    rest = sorted((p for p in points if p is not best and p not in near), key=lambda p: abs(p.square - best.square))
    three = [best, *near, *rest][:3]
    if len(three) < 3:
        return None
    found: Array = np.polyfit([p.square for p in three], [p.misfit for p in three], 2)
    return found if found[0] > 0.0 else None


def _top(points: Sequence[_Point]) -> float | None:
    curve = _parabola(points)
    if curve is None:
        return None
    return float(np.clip(-curve[1] / (2.0 * curve[0]), LEAST, MOST))


def _spread(points: Sequence[_Point], best: _Point) -> float:
    """Return the standard error of the share from the valley's curvature; infinite when it has none."""
    curve = _parabola(points)
    if curve is None:
        return math.inf
    return math.sqrt(best.misfit * best.correlation / (best.samples * float(curve[0])))


def _carried(fit: AxisFit, at: Callable[[float], _Point], square: float, std: float) -> Array:
    """Return by how much the five change (5,) when the share does by its standard error."""
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
    """Return *fit* with the curve: its share among the parameters, its error in all of them."""
    reach = np.append(slope, min(std, UNKNOWN))
    covariance = np.outer(reach, reach)
    covariance[:5, :5] += fit.covariance
    curve = EffectInstance("quadratic-actuator", fit.model.axis.force, {"share": min(square, 1.0)}, {"u_ref": 1.0})
    stds = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    known = {n: replace(p, std=float(s)) for (n, p), s in zip(fit.parameters.items(), stds, strict=False)}
    label = label_of(curve, "share")
    known[label] = Parameter(label, curve["share"], "1", std)
    doubts = tuple(d for d in fit.doubts if d.slug not in BY_DESIGN)
    if not std <= UNKNOWN:
        unknown = Doubt(
            "thrust-curve-unknown",
            "these runs hardly determine thrust over throttle",
            "fly with a larger --throttle, so that the levels lie further apart",
        )
        doubts = (*doubts, unknown)
    extra = {**fit.extra, CURVE: {"square": square, "std": std}}
    return replace(fit, parameters=known, covariance=covariance, doubts=doubts, extra=extra, effects=(curve,))


OPPOSITE = math.cos(math.radians(140.0))
"""Runs whose headings differ by less are no way out and way back."""
LEAST_CURRENT = 0.04
"""Chosen [m/s]: about what a GPS speed is worth when it is averaged over seconds."""
SHARE = 0.03
"""Chosen: a difference below this share of the speed shifts no parameter by more than the fit's usual errors."""
SURE = 3.0
"""Standard errors that it must exceed."""
AROUND = 1.5
"""Seconds before a steady mark over which it was taken."""
BLOCK, LEAST_BLOCKS = 2.0, 4
"""Chosen [s]: a receiver's filter has forgotten by then; so many means tell their scatter."""


@dataclass(frozen=True, slots=True)
class AlongTrack:
    """Speeds over ground [m/s] out and back, at the same throttles; ``set`` [m/s] is half their difference, positive
    when the way out was quicker, with standard error; ``heading`` [rad] of the way out.
    """

    out: float
    back: float
    error: float
    heading: float

    @property
    def set(self) -> float:
        """Half the difference [m/s]: the current along the track, or what a wind does."""
        return 0.5 * (self.out - self.back)

    @property
    def matters(self) -> bool:
        """Whether it is more than noise, and more than a trifle."""
        speed = 0.5 * (self.out + self.back)
        return abs(self.set) > max(LEAST_CURRENT, SHARE * abs(speed), SURE * self.error)

    @property
    def is_none(self) -> bool:
        """Whether it is a trifle for sure."""
        speed = 0.5 * (self.out + self.back)
        return abs(self.set) + SURE * self.error <= max(LEAST_CURRENT, SHARE * abs(speed))


def set_on_the_way_back(fit: AxisFit, out: Trial, back: Trial) -> AlongTrack | None:
    """Return the set that *back* shows beside what the *fit* of *out* foretells of it; any run with X, u and psi.

    A set along the way out is in the forces of its fit. So on the way back the boat is slower than foretold by twice
    the set, whatever is asked of it meanwhile (of a boat whose drag goes with the square a sixth less). The error is
    the scatter of the means over ``BLOCK`` seconds, with which what the fit does not know of other speeds shows, too.

    None when *back* is no way back, too short to tell, or not to be foretold.
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
    """Compare the steady speeds of runs flown out and back; None when no two were."""
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


def through_water(trial: Trial, found: AlongTrack) -> Trial:
    """Return *trial* with its ``u`` less what the set contributes to it, heading by heading."""
    u, psi = trial["u"], trial["psi"]
    headings = np.interp(u.t, psi.t, psi.values)
    still = u.values - found.set * np.cos(headings - found.heading)
    return replace(trial, channels={**trial.channels, "u": replace(u, values=still)})


def doubt_of(found: AlongTrack) -> Doubt:
    """Return the doubt that a current or wind along the track calls for, with its number."""
    comes_from = math.degrees(found.heading + (math.pi if found.set > 0.0 else 0.0)) % 360.0
    return Doubt(
        "set-along-the-track",
        f"at the same throttles it made {found.out:.2f} m/s over ground one way and {found.back:.2f} m/s the other: a "
        f"current (or wind) of {abs(found.set):.2f} m/s from {comes_from:03.0f} deg, corrected before the fit",
        "tune in slack water and little wind: the correction holds along the track only, and the force of wind differs "
        "from a current",
    )
