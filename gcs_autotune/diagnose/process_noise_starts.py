"""Starting points of a search with process noise: the plain model, fitted from several starts.

In rough water a fit without process noise may converge to a wrong gain and time constant. The fit with process noise
therefore starts at several time constants as well, each with the gain that fits the record best. If the fitted time
constant differs much from the start, the runs are thinned again to a suitable interval.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.diagnose.sampling_interval import Plain, judged_at
from gcs_autotune.diagnose.score import MIN_HELD_OUT_GAIN
from gcs_autotune.identify.kalman import LONGEST_WAVE, NoisyFit, NoisyProblem, ProcessNoise, thinned_to
from gcs_autotune.identify.problems import Fitted, Limits, Problem, data_summary_of
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
"""Number of scoring iterations of a rough fit. Project choice."""

PACE = 5.0
"""Number of samples kept per time constant of the craft. Closer samples mainly show the sensor's filter."""

FEWEST = 60
"""Minimum number of samples that a run keeps when thinned, if it has that many."""

FREEDOMS = (math.inf, 8.0, 4.0)
"""Degrees of freedom of Student's distribution for the innovations: normal (inf), and two with heavy tails."""

OWN = 4.0
"""Ratio of squared innovations just after a command to the others, above which the craft itself causes the bursts.

A distribution with heavy tails would then give less weight to the samples that identify the craft.
"""

STIRRED = 0.05
"""Step of a command, relative to its range, after which samples count as just after a command."""

BLUR = 4.0
"""Spacing of the samples kept, in time constants of a sensor's smoother, if errors are large just after commands.

Closer samples depend on the shape of the smoother, of which the model contains only the width.
"""

WIDEST = 2.0
"""Upper limit of the spacing by :data:`BLUR`, in time constants of the craft. The lower limit is one time constant."""

SPACED, NARROWEST = 5.0, 0.4
"""Spacing of the samples kept if a smoother is identified: the smaller of two limits.

SPACED is in samples of the record, NARROWEST in time constants of the craft. Closer samples depend on the shape of the
smoother. With every sample kept, the damping of seven smoothed craft of the blind suite was 0.62 to 1.4 times the true
value. Quadratic drag then gained 5 in log-likelihood; at every fourth sample it gained 28.
"""

FEWEST_TO_COMPARE = 30
"""Minimum number of samples just after commands, and of other samples, for a comparison of their innovations."""

SLOWER = (1.0, 0.3, 3.0)
"""Factors on gain and damping of the fit without process noise, at which fits with process noise start."""

PACES = (3.0, 10.0, 40.0)
"""Additional starting time constants, in samples of the record, because a fit without process noise may be far off."""

NOISES = ((2.0, 1.0), (20.0, 1.0), (20.0, 10.0))
"""Start values of the process noise, in pairs.

The first is the time constant of the force, relative to the craft's. The second is the sensor noise, relative to its
usual start value. Waves that turn the bow act as noise far above any sensor's. Without the last pair, the time constant
of one craft was fitted as 0.7 s instead of 18 s. That fit was 17 nats worse (rough water, seed 275, quadratic
actuator).
"""

MOMENTARY = 2.0
"""Time constant of a drifting force, in samples of the record, up to which it is not a disturbance.

Such a force comes from commands that acted at other times than recorded, or from the sensor's own filter.
"""

FREQUENCIES = 8
"""Number of wave frequencies at which fits with waves start."""

PERIODS = 10.0
"""Minimum number of wave periods in the longest run. A longer wave is not distinguished from a drifting force."""

WAVES = 8.0
"""Log-likelihood that waves must gain to be accepted.

They add four numbers, and several frequencies are tried.
"""

LOOKS = 3
"""Largest number of times the runs are thinned again.

The first fit may be far off, and a smoother may change the interval once more.
"""

FAR_OFF = 1.5
"""Ratio of the new and the present sampling interval, either way, above which the runs are thinned again."""


def plain_with_process_noise(
    problem: Problem, base: Fitted, form: Form, signal: str, say: Say
) -> tuple[NoisyProblem, NoisyFit] | None:
    """Return the runs with *signal* only, at a suitable interval, and the plain model with process noise.

    form : equation of the degree of freedom of *signal*, per unit of inertia.

    Return None if no such model was found.
    """
    theta = per_inertia_of(base, form)
    pace = _pace_of(theta)
    limits = _limits(form)
    noisy = _thinned(problem, form, signal, theta, pace, limits, pace / PACE)
    plain = None if noisy is None else _best_of_starts(noisy, theta, pace, say)
    if noisy is None or plain is None:
        return None
    # A fit without process noise may diverge. The time constant, and so the sampling interval, comes from a fit with
    # process noise.
    looks = [(noisy, plain)]
    for _ in range(LOOKS):
        pace = _pace_of(plain.theta)
        interval = pace / PACE
        if errs_after_commands(noisy, plain):
            interval = max(interval, float(np.clip(BLUR * plain.noise.smoothing, pace, WIDEST * pace)))
        elif plain.noise.smoothing > 0.0:
            least = min(SPACED * problem.data_summary.interval, NARROWEST * pace)
            # With samples too close for the smoother, a fit determines neither time constant nor width.
            interval = least if noisy.interval < least / FAR_OFF else max(interval, least)
        else:
            interval = min(interval, noisy.interval)  # closer samples that did no harm contain more
        again = _thinned(problem, form, signal, plain.theta, pace, limits, interval)
        if again is None or 1.0 / FAR_OFF < again.interval / noisy.interval < FAR_OFF:
            break
        refitted = _best_of_starts(again, plain.theta, pace, say)
        if refitted is None:
            break
        noisy, plain = again, refitted
        looks.append((noisy, plain))
    if _inertia_shown(looks[-1]) < 1.0:
        # Waves that turn the bow rule what is seen close by, and leave no inertia; from further off they are noise.
        noisy, plain = max(looks, key=_inertia_shown)
    return noisy, _with_waves(noisy, plain, say)


def at_the_right_interval(
    problem: Problem, form: Form, signal: str, begun: Plain, slugs: Sequence[str], say: Say
) -> tuple[Plain, NoisyFit | None, str]:
    """Return the result of :func:`plain_with_process_noise`, at another interval if necessary.

    Also return the best fit with one more term, if that was tried, and a description. See :func:`.judged_at`.

    slugs : effects that may be tried.
    """
    theta = begun[1].theta
    pace = _pace_of(theta)

    def at(interval: float) -> Plain | None:
        say("process noise: sampling interval", 0, 1)
        runs = _thinned(problem, form, signal, theta, pace, _limits(form), interval)
        plain = None if runs is None else _best_of_starts(runs, theta, pace, say)
        return None if runs is None or plain is None else (runs, plain)

    return judged_at(begun, at, slugs, MIN_HELD_OUT_GAIN)


def _limits(form: Form) -> Limits:
    """Return the limits of gain and damping.

    With a rudder as input, damping may have either sign. Otherwise it must be stable.
    """
    return Limits({}, {} if "delta" in form.inputs else {form.free[1]: 0.0})


def _inertia_shown(look: tuple[NoisyProblem, NoisyFit]) -> float:
    """Return the craft's time constant in units of the sampling interval of the thinned runs."""
    problem, plain = look
    return 1.0 / (abs(plain.damping) * problem.interval + 1e-12)


def _thinned(
    problem: Problem,
    form: Form,
    signal: str,
    theta: Array,
    pace: float,
    limits: Limits,
    interval: float,
) -> NoisyProblem | None:
    """Return the runs with *signal* only, thinned to *interval* [s] if they are long enough.

    pace : the craft's time constant [s].

    Return None if no run has the signal.
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
    """Return the best fit without any effect, from several starts, with a suitable distribution of its innovations."""
    own = [next(iter(s.signals.values())) for s in problem.segments]
    rate = float(np.median([np.sqrt(np.mean(np.diff(c.values) ** 2) / np.mean(np.diff(c.t)) ** 2) for c in own]))
    sensor = 0.02 * rate * problem.interval
    rough = []
    starts = [(theta * share, pace / share) for share in SLOWER]
    for samples in PACES:
        other = samples * problem.data_summary.interval
        if all(not 0.5 < other / known < 2.0 for _, known in starts):
            # A fit that diverged gives neither gain nor time constant.
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
    """Fit the two most promising rough fits to convergence and return the better one."""
    ends = []
    for k, f in enumerate(sorted(rough, key=lambda f: -f.total)[:2]):
        say("process noise: final fits", k, 2)
        ends.append(problem.fit(f.theta, (), f.noise))
    return max((f for f in ends if f is not None), key=lambda f: f.total, default=None)


def _shaped(problem: NoisyProblem, best: NoisyFit, say: Say) -> NoisyFit:
    """Return *best* with heavy-tailed innovations and a smoother of the signal, if the log-likelihood supports them."""
    for k, freedom in enumerate(FREEDOMS[1:]):
        say("process noise: distribution of the innovations", k, len(FREEDOMS))
        tailed = problem.fit(best.theta, (), replace(best.noise, freedom=freedom))
        if tailed is None or tailed.total <= best.total + MIN_HELD_OUT_GAIN or errs_after_commands(problem, best):
            break
        best = tailed
    say("process noise: distribution of the innovations", len(FREEDOMS) - 1, len(FREEDOMS))
    blurred = problem.fit(best.theta, (), replace(best.noise, smoothing=problem.data_summary.interval))
    return blurred if blurred is not None and blurred.total > best.total + MIN_HELD_OUT_GAIN else best


def _with_waves(problem: NoisyProblem, calm: NoisyFit, say: Say) -> NoisyFit:
    """Return *calm*, or the fit with waves if its log-likelihood is higher by :data:`WAVES`.

    The fit with waves starts at several frequencies and several time constants of the craft. If waves turn the bow, the
    fit without waves may have a wrong time constant.
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
    wavy = _to_the_end(problem, rough, say)
    if wavy is None:
        return calm
    wavy = _shaped(problem, wavy, say)
    # At a limit of their damping these are no waves: a tone in step with the commands, or a drifting force.
    inside = wavy.noise.is_band and wavy.noise.wave_frequency > 1.01 * slowest and not momentary(problem, wavy)
    return wavy if inside and wavy.total > calm.total + WAVES else calm


def momentary(problem: NoisyProblem, fit: NoisyFit) -> bool:
    """Return whether the drifting force has too short a time constant to be a disturbance."""
    return fit.noise.memory <= 1.01 * MOMENTARY * problem.data_summary.interval


def _gain_at(problem: NoisyProblem, pace: float) -> float:
    """Return the gain per inertia with which a craft of time constant *pace* [s] best follows the commands from rest.

    Changes from one sample to the next are compared, because a drifting force accumulates in the position.
    """
    projection, power = 0.0, 0.0
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
        projection, power = projection + float(model @ measured), power + float(model @ model)
    return projection / power if power > 0.0 else 0.0


def errs_after_commands(problem: NoisyProblem, fit: NoisyFit) -> bool:
    """Return whether a model's error is far larger just after commands than elsewhere, which wind would not cause."""
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
