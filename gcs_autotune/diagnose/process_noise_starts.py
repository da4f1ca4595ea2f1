"""Where a search with process noise begins: the plain model, fitted from several starts.

In rough water a fit without process noise may have the gain and the time constant of another craft. So the fit with it
begins at several time constants as well, each with the gain that the record shows there. Where it finds another craft
than it began with, the runs are thinned again to suit that one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.diagnose.sampling_interval import Plain, judged_at
from gcs_autotune.diagnose.score import WORTH
from gcs_autotune.identify import (
    LEAST_DAMPING,
    LONGEST_WAVE,
    MOST_DAMPING,
    Fitted,
    Limits,
    NoisyFit,
    NoisyProblem,
    Problem,
    ProcessNoise,
    data_summary_of,
    thinned_to,
)
from gcs_autotune.models import Form
from gcs_autotune.sname import DOFS

__all__ = [
    "FEWEST_TO_COMPARE",
    "ROUGH",
    "WAVES",
    "Say",
    "at_the_right_interval",
    "errs_after_commands",
    "momentary",
    "per_inertia_of",
    "plain_with_process_noise",
]

Array = NDArray[np.float64]

Say = Callable[[str, int, int], None]

ROUGH = 2
"""Scoring rounds of a rough fit."""

PACE = 5.0
"""Chosen: samples judged per time constant of the craft; closer ones tell of the sensor's own filter."""

FEWEST = 60
"""Samples a run keeps at least, where it has them."""

FREEDOMS = (math.inf, 8.0, 4.0)
"""Degrees of freedom of the innovations' law to choose among: normal, and two with bursts."""

OWN = 4.0
"""Chosen: squares of innovations just after a command, over those elsewhere, from which on bursts are of the craft's
own making: a law with bursts would then make light of just what tells the craft."""

STIRRED = 0.05
"""Chosen: step of a command, in shares of its range, after which a craft is stirred."""

BLUR = 4.0
"""Chosen: time constants of a sensor's smoother between samples: closer ones tell of its shape, of which this one knows
the width alone."""

WIDEST = 2.0
"""Chosen: time constants of the craft between samples, at most, on that account."""

SPACED, NARROWEST = 5.0, 0.4
"""Chosen: samples of the record between those judged where a smoother is found, and time constants of the craft at
most. Closer ones are ruled by its shape: of seven smoothed craft of the blind suite judged at every sample damping came
out at 0.62 to 1.4 times the truth, and quadratic drag was worth 5 in log-likelihood that at every fourth was worth 28.
"""

FEWEST_TO_COMPARE = 30
"""Samples from which on innovations are compared: just after commands with elsewhere, or with the commands."""

SLOWER = (1.0, 0.3, 3.0)
"""Chosen: shares of the numbers fitted without it at which a fit with process noise begins."""

PACES = (3.0, 10.0, 40.0)
"""Chosen: samples of the record in a time constant at which it begins besides: without weather a fit of rough water may
end anywhere."""

NOISES = ((2.0, 1.0), (20.0, 1.0), (20.0, 10.0))
"""Chosen: time constants of the craft that the force is remembered for, and noise of the sensor in shares of the usual,
at which a fit begins: waves that turn the bow are noise far above any sensor's. Without the last a craft of 18 s came
out as one of 0.7, 17 nats short (rough water, seed 275, quadratic actuator)."""

MOMENTARY = 2.0
"""Chosen: samples of the record within which a force that is forgotten is no weather: commands that took effect at
other moments than recorded, or what the sensor's own filter does."""

FREQUENCIES = 8
"""Chosen: of waves, at which a fit with them begins."""

PERIODS = 10.0
"""Chosen: periods of the longest run from which on a band of frequencies is told from a drifting force."""

WAVES = 8.0
"""Log-likelihood by which waves must beat none to be there: four numbers more, and the best of several frequencies."""

LOOKS = 3
"""Chosen: times the runs are looked at anew, at most: a first fit may be lost, the second ruled by a smoother."""

FAR_OFF = 1.5
"""Factor between the interval that suited the fit without process noise and the one that suits it with it, from which
on the runs are looked at again."""


def plain_with_process_noise(
    problem: Problem, base: Fitted, form: Form, signal: str, say: Say
) -> tuple[NoisyProblem, NoisyFit] | None:
    """Return the runs with *signal* alone, as closely as suits the craft, and the plain model with process noise.

    form : of the degree of freedom that *signal* is of, per unit of inertia. None where no such model was found.
    """
    theta = per_inertia_of(base, form)
    pace = _pace_of(theta)
    limits = _limits(form)
    noisy = _thinned(problem, form, signal, theta, pace, limits, pace / PACE)
    plain = None if noisy is None else _best_of_starts(noisy, theta, pace, say)
    if noisy is None or plain is None:
        return None
    # A fit without weather may be lost altogether; how fast the craft is, and so how closely it is looked at, is told
    # by one that knows of weather.
    looks = [(noisy, plain)]
    for _ in range(LOOKS):
        pace = _pace_of(plain.theta)
        interval = pace / PACE
        if errs_after_commands(noisy, plain):
            interval = max(interval, float(np.clip(BLUR * plain.noise.smoothing, pace, WIDEST * pace)))
        elif plain.noise.smoothing > 0.0:
            least = min(SPACED * problem.data_summary.interval, NARROWEST * pace)
            # Too close for its smoother a fit knows neither pace nor width: what is seen from further off tells.
            interval = least if noisy.interval < least / FAR_OFF else max(interval, least)
        else:
            interval = min(interval, noisy.interval)  # what was seen closer by without harm tells more
        again = _thinned(problem, form, signal, plain.theta, pace, limits, interval)
        if again is None or 1.0 / FAR_OFF < again.interval / noisy.interval < FAR_OFF:
            break
        found = _best_of_starts(again, plain.theta, pace, say)
        if found is None:
            break
        noisy, plain = again, found
        looks.append((noisy, plain))
    if _inertia_shown(looks[-1]) < 1.0:
        # Waves that turn the bow rule what is seen close by, and leave no inertia; from further off they are noise.
        noisy, plain = max(looks, key=_inertia_shown)
    return noisy, _with_waves(noisy, plain, say)


def at_the_right_interval(
    problem: Problem, form: Form, signal: str, begun: Plain, slugs: Sequence[str], say: Say
) -> tuple[Plain, NoisyFit | None, str]:
    """Return what :func:`plain_with_process_noise` found, at another interval where that is needed, the best fit with
    one term more where that was looked for, and words on it.

    See :func:`.judged_at`. slugs : effects that may be tried.
    """
    theta = begun[1].theta
    pace = _pace_of(theta)

    def at(interval: float) -> Plain | None:
        say("process noise: sampling interval", 0, 1)
        runs = _thinned(problem, form, signal, theta, pace, _limits(form), interval)
        plain = None if runs is None else _best_of_starts(runs, theta, pace, say)
        return None if runs is None or plain is None else (runs, plain)

    return judged_at(begun, at, slugs, WORTH)


def _limits(form: Form) -> Limits:
    """Return the limits of gain and damping: behind a rudder either sign, else damping damps."""
    return Limits({}, {} if "delta" in form.inputs else {form.free[1]: 0.0})


def _inertia_shown(look: tuple[NoisyProblem, NoisyFit]) -> float:
    """Return the craft's time constant in intervals between the samples judged."""
    problem, plain = look
    return 1.0 / (abs(float(plain.theta[1])) * problem.interval + 1e-12)


def _thinned(
    problem: Problem,
    form: Form,
    signal: str,
    theta: Array,
    pace: float,
    limits: Limits,
    interval: float,
) -> NoisyProblem | None:
    """Return the runs with *signal* alone, no closer than *interval* [s] where they are long enough; None where none
    has it. pace : the craft's time constant [s].
    """
    longest = max(float(s.stamps[-1]) - s.start for s in problem.segments)
    segments = thinned_to(problem.segments, signal, min(interval, longest / FEWEST))
    if not segments:
        return None
    own = dict(zip(form.free, theta.tolist(), strict=True))
    data = replace(data_summary_of(form, segments, own), time_constant=pace, interval=problem.data_summary.interval)
    return NoisyProblem(form, segments, data, limits)


def _pace_of(theta: Array) -> float:
    """Return the time constant [s] of gain and damping per inertia."""
    return 1.0 / max(abs(float(theta[1])), 1e-3)


def per_inertia_of(base: Fitted, form: Form) -> Array:
    """Return gain and damping per inertia (2,) of a fit, in the degree of freedom of *form*."""
    d, model = DOFS[form.dofs[0]], base.model.base
    i = model.form.dofs.index(form.dofs[0])
    inertia = float(model.inertia[i, i])
    gain = 1.0
    for pairs in model.form.inputs.values():
        for force, share in pairs:
            if force == d.force:
                gain = model[share.lstrip("-")] if isinstance(share, str) else abs(share)
    damping = model[f"{d.force}_{d.velocity}"] / inertia
    return np.array([gain / inertia, damping])


def _best_of_starts(problem: NoisyProblem, theta: Array, pace: float, say: Say) -> NoisyFit | None:
    """Return the best fit without any effect, from several starts, with the law that suits its innovations."""
    own = [next(iter(s.signals.values())) for s in problem.segments]
    rate = float(np.median([np.sqrt(np.mean(np.diff(c.values) ** 2) / np.mean(np.diff(c.t)) ** 2) for c in own]))
    sensor = 0.02 * rate * problem.interval
    rough = []
    starts = [(theta * share, pace / share) for share in SLOWER]
    for samples in PACES:
        other = samples * problem.data_summary.interval
        if all(not 0.5 < other / known < 2.0 for _, known in starts):
            # A fit that was lost knows the gain no better than the pace.
            starts.append((np.array([_gain_at(problem, other), -1.0 / other]), other))
    for k, (begun, own_pace) in enumerate(starts):
        for memory, more in NOISES:
            say("process noise", k, len(starts))
            noise = ProcessNoise(0.2 * rate / own_pace, memory * own_pace, more * sensor)
            fit = problem.fit(begun, (), noise, rounds=ROUGH)
            rough += [] if fit is None else [fit]
    best = _to_the_end(problem, rough, say)
    return None if best is None else _shaped(problem, best, say)


def _to_the_end(problem: NoisyProblem, rough: list[NoisyFit], say: Say) -> NoisyFit | None:
    """Return the best of the two most promising, fitted to the end."""
    ends = []
    for k, f in enumerate(sorted(rough, key=lambda f: -f.total)[:2]):
        say("process noise: final fits", k, 2)
        ends.append(problem.fit(f.theta, (), f.noise))
    return max((f for f in ends if f is not None), key=lambda f: f.total, default=None)


def _shaped(problem: NoisyProblem, best: NoisyFit, say: Say) -> NoisyFit:
    """Return *best* with the law that suits its innovations, and a smoother of the signal, where these pay."""
    for k, freedom in enumerate(FREEDOMS[1:]):
        say("process noise: distribution of the innovations", k, len(FREEDOMS))
        tailed = problem.fit(best.theta, (), replace(best.noise, freedom=freedom))
        if tailed is None or tailed.total <= best.total + WORTH or errs_after_commands(problem, best):
            break
        best = tailed
    say("process noise: distribution of the innovations", len(FREEDOMS) - 1, len(FREEDOMS))
    blurred = problem.fit(best.theta, (), replace(best.noise, smoothing=problem.data_summary.interval))
    return blurred if blurred is not None and blurred.total > best.total + WORTH else best


def _with_waves(problem: NoisyProblem, calm: NoisyFit, say: Say) -> NoisyFit:
    """Return *calm*, or the fit with waves where it is likelier by :data:`WAVES`.

    It begins at several frequencies, and at several paces: waves that turn the bow may have had a fit without them lose
    the craft.
    """
    longest = max(float(s.stamps[-1]) - s.start for s in problem.segments)
    slowest = 2.0 * math.pi / min(LONGEST_WAVE, longest / PERIODS)
    quickest = 0.9 * math.pi / problem.interval
    if quickest <= slowest:
        return calm
    own = replace(calm.noise, smoothing=0.0, freedom=math.inf)
    others = [samples * problem.data_summary.interval for samples in PACES]
    thetas = [calm.theta, *(np.array([_gain_at(problem, pace), -1.0 / pace]) for pace in others)]
    rough = []
    for k, omega in enumerate(np.geomspace(slowest, quickest, FREQUENCIES).tolist()):
        say("process noise: waves", k, FREQUENCIES)
        for theta in thetas:
            noise = replace(own, wave_swing=4.0 * own.sensor, wave_force=0.5 * own.size, wave_frequency=omega)
            fit = problem.fit(theta, (), noise, rounds=ROUGH)
            rough += [] if fit is None else [fit]
    found = _to_the_end(problem, rough, say)
    if found is None:
        return calm
    found = _shaped(problem, found, say)
    within = 1.01 * LEAST_DAMPING < found.noise.wave_damping < 0.99 * MOST_DAMPING
    # At a limit these are no waves: a tone in step with the commands, or a drifting force in another way.
    inside = within and found.noise.wave_frequency > 1.01 * slowest and not momentary(problem, found)
    return found if inside and found.total > calm.total + WAVES else calm


def momentary(problem: NoisyProblem, fit: NoisyFit) -> bool:
    """Whether what wanders is forgotten so soon that it is no weather."""
    return fit.noise.memory <= 1.01 * MOMENTARY * problem.data_summary.interval


def _gain_at(problem: NoisyProblem, pace: float) -> float:
    """Return the gain per inertia with which a craft of that *pace* [s] best follows the commands from rest.

    From one sample to the next, for what a drifting force did before adds up in the position itself.
    """
    told, drawn = 0.0, 0.0
    for segment in problem.segments:
        own = next(iter(segment.signals.values()))
        push = np.zeros(len(segment.t_in))
        for name, column in zip(segment.input_names, segment.inputs.T, strict=True):
            for _, share in problem.form.inputs.get(name, ()):
                push += -column if str(share).startswith("-") else column
        t = np.union1d(segment.t_in, own.t)
        force = push[np.maximum(np.searchsorted(segment.t_in, t, side="right") - 1, 0)]
        held = np.diff(t)
        velocity = np.zeros(len(t))
        for k, kept in enumerate(np.exp(-held / pace).tolist()):
            velocity[k + 1] = kept * velocity[k] + (1.0 - kept) * pace * force[k]
        path = velocity
        if own.name == problem.dof.position:
            path = pace * (np.append(0.0, np.cumsum(force[:-1] * held)) - velocity)
        model, measured = np.diff(path[np.searchsorted(t, own.t)]), np.diff(own.values)
        told, drawn = told + float(model @ measured), drawn + float(model @ model)
    return told / drawn if drawn > 0.0 else 0.0


def errs_after_commands(problem: NoisyProblem, fit: NoisyFit) -> bool:
    """Whether a model errs just after its commands far more than elsewhere: no wind waits for these."""
    window = 2.0 * max(_pace_of(fit.theta), problem.interval)
    squares: list[list[Array]] = [[], []]
    for segment, (t, e, S) in zip(problem.segments, fit.innovations, strict=True):
        stirred = np.zeros(len(t), dtype=bool)
        for name, column in zip(segment.input_names, segment.inputs.T, strict=True):
            if name in problem.form.inputs:
                steps = segment.t_in[1:][np.abs(np.diff(column)) > STIRRED * np.ptp(column)]
                since = np.append(-np.inf, steps)[np.searchsorted(steps, t, side="right")]
                stirred |= t - since < window
        for k in (0, 1):
            squares[k].append((e * e / S)[stirred == bool(k)])
    calm, after = (np.concatenate(s) for s in squares)
    return min(len(calm), len(after)) >= FEWEST_TO_COMPARE and float(after.mean()) > OWN * float(calm.mean())
