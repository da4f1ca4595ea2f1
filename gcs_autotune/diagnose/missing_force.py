"""Estimate the force that no cause explains, with the filter: its dependence on related quantities, and a
description."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.diagnose.process_noise import NoiseSearch
from gcs_autotune.diagnose.result import MissingCurve, MissingForce, Waves
from gcs_autotune.diagnose.run_to_run import days_of
from gcs_autotune.diagnose.score import CandidateScore, key_of
from gcs_autotune.effects import effect_at, force_unit
from gcs_autotune.identify.kalman import NoisyFit, ProcessNoise
from gcs_autotune.rounding import HALF_WIDTH
from gcs_autotune.sensor import moves
from gcs_autotune.sname import DOFS, SIGNALS

__all__ = ["missing_of", "next_of", "words_of", "words_of_noise"]

Array = NDArray[np.float64]

BINS, FEWEST = 9, 8
"""BINS: number of points of a curve of the missing force. FEWEST: minimum number of samples at each point.
Project choice.
"""

WAY_ON = 0.1
"""Smallest surge speed, relative to the largest in the run, at which a drift angle is calculated."""

UNITS: Mapping[str, str] = {"time": "s", "drift": "rad", **{n: row[0] for n, row in SIGNALS.items()}}
"""Quantity that the missing force is plotted over -> its unit."""

REPORTED_SHARE = 0.1
"""Smallest fraction of the missing force that a quantity must predict in other runs to be reported."""

READINGS = 0.01
"""Force behind an oscillation, relative to the drifting force, below which only the readings oscillate. Project choice.
"""


@dataclass(frozen=True, slots=True, eq=False)
class _Estimate:
    """The missing force (n,) of one run at stamps (n,), its standard deviation, and the quantities it may depend on."""

    run: str
    t: Array
    force: Array
    std: Array
    beside: Mapping[str, Array]


def missing_of(search: NoiseSearch) -> MissingForce | None:
    """Return the drifting force that the filter estimates in addition to the model's, over the whole record, in the
    base model's units.

    Return None if it cannot be estimated.
    """
    data = search.problem.data_summary if search.whole is None else search.whole.data_summary
    unit, inertia = force_unit(search.dof, data), search.inertia
    estimates = _estimated(search, inertia)
    if not estimates:
        return None
    noise = search.fit.noise
    pushed = np.concatenate([e.beside["command"] for e in estimates])
    commanded = float(np.sqrt(np.mean(pushed**2)))
    size = noise.size * abs(inertia)
    curves = {}
    units = {**UNITS, **search.problem.data_summary.inputs}
    for name in dict.fromkeys(n for e in estimates for n in e.beside):
        curve = _curve_over(name, units.get(name, ""), [e for e in estimates if name in e.beside])
        if curve is not None:
            curves[name] = curve
    curves = dict(sorted(curves.items(), key=lambda item: -item[1].share))
    share = size / commanded if commanded > 0.0 else math.nan
    days = days_of(search.problem, search.fit, inertia)
    low, high = search.fit.interval_of("size")
    size95 = low * abs(inertia), high * abs(inertia)
    longest = max(float(s.stamps[-1]) - s.start for s in search.problem.segments)
    own = (days, _waves_of(noise, inertia), size95, search.fit.interval_of("memory"), longest)
    return MissingForce(search.dof, unit, size, noise.memory, share, curves, *own)


def _waves_of(noise: ProcessNoise, inertia: float) -> Waves | None:
    if not noise.wavy:
        return None
    period = 2.0 * math.pi / noise.wave_frequency
    return Waves(period, noise.wave_damping, noise.wave_swing, noise.wave_force * abs(inertia))


def _estimated(search: NoiseSearch, inertia: float) -> list[_Estimate]:
    done = search.problem.run(search.fit.theta, search.fit.effects, search.fit.noise, full=True)
    if done is None:
        return []
    bank, result, levels = done
    smoothed = bank.smooth(result, levels)
    d, n = DOFS[search.dof], len(bank.states)
    rate = bank.states.index(d.velocity)
    estimates = []
    gain = search.fit.gain
    for track, path, var, original in zip(
        bank.tracks, smoothed.trajectories, smoothed.variances, search.problem.segments, strict=True
    ):
        t = track.stamps
        row = np.maximum(np.searchsorted(original.t_in, t, side="right") - 1, 0)
        pushes = {}
        for k, channel in enumerate(original.input_names):
            for letter, share in search.problem.form.inputs.get(channel, ()):
                if letter == d.force:
                    pushes[channel] = original.inputs[row, k] * (-1.0 if str(share).startswith("-") else 1.0)
        command = np.sum([*pushes.values()], axis=0) * gain * inertia
        beside = {"command": command, d.velocity: path[:, rate], "time": t - t[0]}
        if len(pushes) > 1:  # one of several thrusters may be at fault
            beside |= {c: original.inputs[row, original.input_names.index(c)] for c in pushes}
        if search.dof == "yaw":
            beside["psi"] = np.mod(path[:, bank.states.index("psi")], 2.0 * np.pi)
        for name in ("u", "v"):
            if name in original.measured and name != d.velocity:
                own = original.measured[name]
                known = np.isfinite(own.values)
                if known.sum() > FEWEST and moves(own.values[known]):
                    beside[name] = np.interp(t, own.t[known], own.values[known])
        if "u" in beside and "v" in beside and np.min(beside["u"]) > WAY_ON * np.max(beside["u"]):
            beside["drift"] = np.arctan2(-beside["v"], beside["u"])
        force, std = path[:, n] * inertia, np.sqrt(var[:, n]) * abs(inertia)
        estimates.append(_Estimate(original.run, t, force, std, beside))
    return estimates


def _places(x: Array) -> tuple[Array, Array]:
    """Return the centres (b,) and the edges (b + 1,) of bins along *x*.

    If *x* has at most BINS different values, each of them is a centre.
    """
    values = np.unique(x)
    if len(values) <= BINS:
        between = 0.5 * (values[1:] + values[:-1])
        return values, np.concatenate([values[:1], between, values[-1:]])
    edges = np.unique(np.quantile(x, np.linspace(0.0, 1.0, BINS + 1)))
    return 0.5 * (edges[1:] + edges[:-1]), edges


def _curve_over(name: str, unit: str, estimates: Sequence[_Estimate]) -> MissingCurve | None:
    """Return the mean missing force over *name*, and the fraction of it that the curve of the other runs predicts.

    For a single run, each half predicts the other.
    """
    pieces = [(e.beside[name], e.force, e.std) for e in estimates]
    alone = len(pieces) == 1
    if alone:
        pieces = [tuple(part) for part in zip(*(np.array_split(a, 2) for a in pieces[0]), strict=True)]
    x, y, std = (np.concatenate([p[k] for p in pieces]) for k in range(3))
    middle, edges = _places(x)
    if len(edges) < 3:
        return None

    def means(x: Array, y: Array) -> Array:
        own = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 2)
        count = np.bincount(own, minlength=len(edges) - 1)
        total = np.bincount(own, y, minlength=len(edges) - 1)
        return np.where(count >= FEWEST, total / np.maximum(count, 1), np.nan)

    left, whole = 0.0, 0.0
    for k, (own_x, own_y, _) in enumerate(pieces):
        others = [p for j, p in enumerate(pieces) if j != k]
        curve = means(np.concatenate([p[0] for p in others]), np.concatenate([p[1] for p in others]))
        at = np.clip(np.searchsorted(edges, own_x, side="right") - 1, 0, len(edges) - 2)
        constant = float(np.mean(np.concatenate([p[1] for p in others])))
        predicted = np.where(np.isfinite(curve[at]), curve[at], constant)
        left += float(np.sum((own_y - predicted) ** 2))
        whole += float(np.sum((own_y - constant) ** 2))
    # Between runs, for samples of one run are not independent; what one alone has seen has no band.
    each = np.array([means(p[0], p[1]) for p in pieces])
    count = np.sum(np.isfinite(each), axis=0)
    spread, repeated = np.full(len(edges) - 1, np.nan), count > 1
    spread[repeated] = np.nanstd(each[:, repeated], axis=0) / np.sqrt(count[repeated] - 1)
    force = means(x, y)
    known = np.isfinite(force) & np.isfinite(spread)
    if known.sum() < 2:
        return None
    band = np.hypot(HALF_WIDTH * spread, means(x, std) / math.sqrt(len(x) / BINS))
    share = 1.0 - left / whole if whole > 0.0 else 0.0
    return MissingCurve(name, unit, middle[known], force[known], band[known], share, "half" if alone else "runs")


AXES: Mapping[str, str] = {
    "command": "the command",
    "r": "the turn rate",
    "u": "the speed ahead",
    "v": "the speed sideways",
    "w": "the speed down",
    "drift": "the drift angle",
    "psi": "the heading",
    "time": "the time since the run started",
}

TELLING: Mapping[str, str] = {
    "command": "fly steps of four sizes each way and hold each until the rate is steady. A force that depends on the "
    "command usually comes from the actuator",
    "r": "fly turning circles at three rates each way, a full turn at each. A force that depends on the turn rate "
    "is usually damping",
    "u": "fly the same zig-zag at slow, half and full speed. Start each at a steady speed",
    "v": "fly pull-outs at two speeds: turn hard, then give no command until the craft runs straight. Record the "
    "sideways speed",
    "drift": "fly turning circles at two rudder angles each way, then pull-outs. Record the sideways speed",
    "w": "send equal vertical commands up and down at two depths",
    "psi": "make two slow full turns, one each way. A force that depends on the heading may be wind, current, "
    "a tether or a compass error",
    "time": "repeat the first manoeuvre at the end of the run. A force that changes with time may come from "
    "the battery, fouling, wind or current",
}
"""Quantity that the missing force depends on -> the manoeuvre that identifies the cause."""


def words_of_noise(search: NoiseSearch) -> str:
    """Return a description of the size and correlation time of the drifting force."""
    noise = search.fit.noise
    size = f"{math.degrees(noise.size):.3g} deg/s^2" if DOFS[search.dof].angular else f"{noise.size:.3g} m/s^2"
    bursts = "" if math.isinf(noise.freedom) else ", in bursts"
    return f"{size} standard deviation, correlation time {noise.memory:.3g} s{bursts}"


def _percent(share: float) -> str:
    return "below 1 %" if share < 0.01 else f"{100.0 * share:.0f} %"


def words_of(search: NoiseSearch, missing: MissingForce | None) -> tuple[str, ...]:
    """Return a description of the missing force, and why causes that fit the runs were rejected."""
    lines = []
    if missing is not None:
        kind = "moment" if DOFS[missing.dof].angular else "force"
        share = "" if math.isnan(missing.share) else f", {_percent(missing.share)} of the command (rms)"
        lines.append(
            f"a drifting {kind} of {missing.size:.3g} {_of(missing)} (standard deviation{share}) acts in "
            f"{missing.dof} and is not in the model. Its correlation time is {missing.memory:.3g} "
            f"s{_sure_of(missing)}"
        )
        if missing.waves is not None:
            lines.append(_words_of_waves(missing, missing.waves, next(iter(search.problem.segments[0].signals))))
        dependencies = [c for c in missing.curves.values() if c.share > REPORTED_SHARE and c.varies]
        for curve in dependencies[:2]:
            low, high = int(np.argmin(curve.force)), int(np.argmax(curve.force))
            x = f" {curve.unit}" if curve.unit else ""
            lines.append(
                f"{100.0 * curve.share:.0f} % of the drifting force depends on {AXES.get(curve.over, curve.over)}, "
                f"as predicted by {curve.predicted_by}. It is {curve.force[low]:+.3g} +- {curve.band[low]:.2g} at "
                f"{curve.x[low]:.3g}{x} and {curve.force[high]:+.3g} +- {curve.band[high]:.2g} at "
                f"{curve.x[high]:.3g}{x}"
            )
        if not dependencies:
            others = f" ({', '.join(missing.curves)})" if missing.curves else ""
            origin = "waves, wind, current or a quantity that was not recorded"
            cause = f"may be constant or come from {origin}" if _may_be_constant(missing) else f"may come from {origin}"
            lines.append(f"the drifting force does not clearly depend on a recorded quantity{others}. It {cause}")
    accepted = {key_of(a.effect) for a in search.accepted}
    last = {key_of(a.effect): a for step in search.steps for a in step.judged}  # beside all accepted before it
    short = {k: a for k, a in last.items() if a.gained > a.needed and (a.unsound or not a.holds)}
    lines += [_shortfall_of(a) for k, a in short.items() if k not in accepted]
    return tuple(lines)


def _sure_of(missing: MissingForce) -> str:
    """Return the 95 % intervals in words, and whether the force may be a constant; empty if no interval is known."""
    (low, high), (soon, late) = missing.size95, missing.memory95
    if not math.isfinite(high):
        return ""
    until = f"{late:.3g} s" if math.isfinite(late) else "no limit"
    words = f" (95 % intervals: size {low:.2g} to {high:.2g}, time {soon:.2g} s to {until})"
    return words + ". These runs do not distinguish it from a constant force" * _may_be_constant(missing)


def _may_be_constant(missing: MissingForce) -> bool:
    """Return whether the force may drift more slowly than the longest run lasts."""
    return missing.memory95[1] > missing.longest


def _words_of_waves(missing: MissingForce, waves: Waves, signal: str) -> str:
    unit = SIGNALS[signal][0]
    amplitude = f"{math.degrees(waves.swing):.2g} deg" if unit == "rad" else f"{waves.swing:.2g} {unit}"
    kind = "moment" if DOFS[missing.dof].angular else "force"
    what = f"{AXES.get(signal, signal)} also oscillates by {amplitude} with a period of {waves.period:.2g} s"
    if waves.force < READINGS * missing.size:
        return (
            f"{what} (standard deviation), without a {kind} behind it. It is in the readings, as from rounding or a "
            "loose sensor mount. This is not counted as a cause"
        )
    return (
        f"{what}, as from waves or a loose sensor mount. The {kind} behind it is {waves.force:.2g} {_of(missing)}. "
        "Both sizes are standard deviations. This is not counted as a cause"
    )


def _of(missing: MissingForce) -> str:
    return "of full output" if missing.unit == "1" else missing.unit


def _shortfall_of(unnamed: CandidateScore[NoisyFit]) -> str:
    """Return, in words, why a candidate that fits the supplied runs is not reported."""
    fits = f"{effect_at(unnamed.effect)} improves the log-likelihood of the fitted runs by {unnamed.gained:.1f}"
    if unnamed.unsound:
        return f"{fits}. It is rejected because {unnamed.unsound}"
    if unnamed.held_out_gain > 0.0 and unnamed.interval[0] < 0.0:
        low, high = unnamed.interval
        return (
            f"{fits} and that of the held-out runs by {unnamed.held_out_gain:+.1f} (90 % interval {low:+.1f} to "
            f"{high:+.1f}). This is too uncertain to report it as a cause"
        )
    if unnamed.held_out_gain > 0.0:
        together = f"that of the held-out data by {unnamed.held_out_gain:+.1f}"
        short = "but not of every part of it" if min(unnamed.parts) <= 0.0 else "which is too little"
        return f"{fits} and {together}, {short}. It is not reported as a cause"
    return f"{fits}, but lowers that of the held-out runs ({unnamed.held_out_gain:+.1f}). It is rejected"


def next_of(missing: MissingForce | None) -> str | None:
    """Return the manoeuvre that would identify the cause of the missing force; None if there is no missing force."""
    if missing is None or not missing.curves:
        return None
    best = next((c for c in missing.curves.values() if c.varies), None)
    if best is None or best.share <= REPORTED_SHARE:
        return (
            "repeat the manoeuvre in calm water, or make it four times as long. A drifting force of "
            f"{missing.size:.2g} {_of(missing)} hides smaller effects"
        )
    return TELLING.get(best.over, TELLING["command"])
