"""Decide whether an apparent wave is ringing of the craft itself, after its commands.

A filter that predicts each sample treats any oscillation at one frequency as a wave. It leaves white noise, so tests of
the residuals find nothing. The two explanations are therefore compared as models of the same runs. The phase of a wave
is unpredictable. The phase of a spring and mass excited by the command follows from the commands.

The ringing model is the model without the wave, with two more forces: position and speed of the spring. It is first
evaluated to first order in its parameters, which is enough in most cases. If it is not clearly likelier than the wave,
the whole model is fitted. A fit of the whole model is needed if the craft is as slow as its spring, because its other
parameters then change a lot.

Both steps modify the commands. The response to a small modification is a difference of two simulations.
:func:`memories` uses such responses to test whether the residuals depend on past commands. One test uses earlier
commands (a linear system of higher order). Another uses the direction of the last change (up or down).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from gcs_autotune.clock import check_effort
from gcs_autotune.diagnose.score import ALIKE
from gcs_autotune.effects import EffectResidual, ExtendedSimulator, Passage, rung
from gcs_autotune.identify.problems import Fitted, Problem, judged_by

__all__ = ["memories", "resonance_checks"]

Array = NDArray[np.float64]


Bend = Callable[[Array, Array], Array]

LAGS = (1, 2, 4, 8, 16)
"""Delays of the command, in samples of the run, that are tested."""

STEP = 1e-3
"""Relative modification of the command for difference quotients."""


def memories(problem: Problem, fitted: Fitted) -> Iterator[tuple[str, Array]]:
    """Yield, for each input and kind of memory, its description and its effects on the residual (n, k)."""
    sample = float(np.median([np.median(np.diff(s.passage.stamps)) for s in problem.segments]))
    for channel, pairs in fitted.form.inputs.items():
        if not pairs:
            continue
        ways: list[Bend] = [*(_ago(lag * sample) for lag in LAGS), lambda t, command: command * _direction(command)]
        columns = bent_by(problem, fitted, channel, ways)
        if columns is not None:
            yield f"earlier values of {channel}", columns[:, :-1]
            yield f"the direction of the last change of {channel}", columns[:, -1:]


def bent_by(problem: Problem, fitted: Fitted, channel: str, bends: Sequence[Bend]) -> Array | None:
    """Return the effect (n, k) of small modifications of a command on the residual, relative to the noise levels.

    Return None if the motion diverges.
    """
    check_effort()
    simulator = ExtendedSimulator(fitted.form, fitted.effects)
    rows, at = [], 0
    for i, segment in enumerate(problem.segments):
        passage = dense(segment.passage_at(fitted.shift))
        command = passage.commands[channel]
        ways = [command, *(command + STEP * bend(passage.t_in, command) for bend in bends)]
        flown = [replace(passage, commands={**passage.commands, channel: way}) for way in ways]
        motions = [simulator.run(fitted.theta, fitted.effects, fitted.initial[i], way) for way in flown]
        moved = [f for f in motions if f is not None]
        if len(moved) < len(motions):
            return None
        for name in segment.signals:
            rest, level = fitted.rests[at], fitted.levels[name]
            at += 1
            left = EffectResidual(segment.run, name, rest.t, rest.measured - rest.predicted, rest.measured, level)
            change = np.column_stack([f[name][0] - moved[0][name][0] for f in moved[1:]]) / STEP
            _, columns, _ = judged_by(fitted.effects, left, change)
            rows.append(columns[np.isfinite(rest.judged)] / level)
    return np.vstack(rows)


def dense(passage: Passage) -> Passage:
    """Return the segment with its inputs at every sample.

    A modified command changes at every sample, not only where the command itself changes.
    """
    t = np.union1d(passage.t_in, passage.stamps)
    at = np.maximum(np.searchsorted(passage.t_in, t, side="right") - 1, 0)
    return replace(passage, t_in=t, commands={name: levels[at] for name, levels in passage.commands.items()})


def _ago(seconds: float) -> Bend:
    def bend(t: Array, command: Array) -> Array:
        return command[np.maximum(np.searchsorted(t, t - seconds, side="right") - 1, 0)] if len(t) else command

    return bend


def _direction(command: Array) -> Array:
    """Return the direction (j,) of the last change of a command: +1 up, -1 down, +1 before any change."""
    change = np.sign(np.diff(command, prepend=command[:1]))
    last = np.maximum.accumulate(np.where(change != 0.0, np.arange(len(command)), 0))
    direction = change[last]
    return np.where(direction == 0.0, 1.0, direction)


WAVE = "wave-disturbance"
NEAR = np.linspace(-0.45, 0.45, 13)
"""Trial frequencies of the spring: logarithm of the ratio to the wave's frequency.

A range is needed, because the craft shifts the spectral peak of the spring.
"""
DAMPING = (0.02, 0.08, 0.25)
LEAST, MOST = 0.003, 0.6
"""Bounds of the damping ratio of a spring. DAMPING contains the values tried first."""
NUMBERS = 4
"""Number of parameters of the ringing: frequency, damping and two gains."""
AT, SPEED = "spring's place", "spring's speed"
"""Names of the two inputs that a spring adds: its position and its speed."""
FEW_NEAR, FEW_DAMPING = (-0.35, 0.0, 0.35, 0.7), (0.04, 0.15)
"""Trial frequencies and damping ratios (as NEAR and DAMPING) for fits of the whole model.

They extend to higher frequencies, because a filter that follows the spring underestimates its frequency.
"""
TRIALS = 20
ROUNDS = 4
"""Number of iterations in which the signals are weighted by their residuals. Project choice."""


def resonance_checks(problem: Problem, fitted: Fitted) -> Iterator[tuple[str, float]]:
    """Yield, for every input of a model with a wave, a description and the likelihood ratio of wave over ringing.

    The ratio is at most 1 and includes Schwarz's cost for the parameters of the ringing. It is small if the commands
    predict the oscillation better than a filter that follows it.
    """
    waves = [e for e in fitted.effects if e.slug == WAVE]
    if not waves:
        return
    still = tuple(e for e in fitted.effects if e.slug != WAVE)
    plain = problem.fit(fitted.theta, still, fitted.initial, learn=False, shift=fitted.shift)
    if plain is None:
        return
    wanted = plain.cost - fitted.cost + NUMBERS * math.log(max(fitted.samples, 2))
    for channel, pairs in fitted.form.inputs.items():
        if pairs:
            ahead = max(_gain(problem, plain, channel, e["frequency"]) for e in waves) - wanted
            if ahead < ALIKE:
                more = 2 * len(problem.segments) * len(pairs) * math.log(max(fitted.samples, 2))
                whole = max(_whole_gain(problem, plain, channel, e["frequency"]) for e in waves)
                ahead = max(ahead, whole - wanted - more)
            yield f"ringing after every change of {channel}", math.exp(-0.5 * max(ahead, 0.0))


def _whole_gain(problem: Problem, plain: Fitted, channel: str, omega: float) -> float:
    """Return the same as :func:`_gain`, from a joint fit of craft and spring."""

    def cost(p: Array) -> float:
        if abs(p[0]) > 2.0 * NEAR[-1] or not LEAST < math.exp(p[1]) < MOST:
            return math.inf
        sprung = _sprung(problem, plain, channel, omega * math.exp(p[0]), math.exp(p[1]))
        return math.inf if sprung is None else sprung.cost

    starts = [np.array([a, math.log(z)]) for a in FEW_NEAR for z in FEW_DAMPING]
    first = min(starts, key=cost)
    best = minimize(
        cost,
        first,
        method="Nelder-Mead",
        options={
            "initial_simplex": first + np.array([[0.0, 0.0], [0.05, 0.0], [0.0, 0.4]]),
            "xatol": 1e-3,
            "fatol": 0.1,
            "maxfev": 40,
        },
    )
    return plain.cost - float(best.fun)


def _sprung(problem: Problem, plain: Fitted, channel: str, omega: float, zeta: float) -> Fitted | None:
    """Fit the craft together with a spring of this frequency and damping, excited by *channel*.

    The spring's state at the start of each segment does not depend on commands and is fitted too. Return None if the
    motion diverges.
    """
    responses = [_spring_responses(s.passage, channel, omega, zeta) for s in problem.segments]
    own = [AT, SPEED, *(f"{word} at the start of segment {i}" for i in range(len(responses)) for word in (AT, SPEED))]
    pushed = [force for force, _ in plain.form.inputs[channel]]
    gains = {word: tuple((force, f"{force} by the {word}") for force in pushed) for word in own}
    names = tuple(name for pairs in gains.values() for _, name in pairs)
    form = replace(plain.form, inputs={**plain.form.inputs, **gains}, free=(*plain.form.free, *names))
    segments = []
    for i, (segment, (passage, forced, free)) in enumerate(zip(problem.segments, responses, strict=True)):
        begun = [x if i == k // 2 else np.zeros_like(x) for k, x in enumerate(list(free) * len(responses))]
        commands = {**passage.commands, **dict(zip(own, [*forced, *begun], strict=True))}
        segments.append(segment.driven(passage.t_in, commands))
    other = Problem(form, segments, problem.data_summary, problem.limits, (*problem.free, *names))
    values = dict(zip(plain.form.parameters, plain.theta.tolist(), strict=True))
    start = np.array([values.get(n, 0.0) for n in form.parameters])
    return other.fit(start, plain.effects, plain.initial, trials=TRIALS, learn=False, shift=plain.shift)


def _spring_responses(
    passage: Passage, channel: str, omega: float, zeta: float
) -> tuple[Passage, list[Array], list[Array]]:
    """Return a passage with enough samples, and the spring's forced and free response (position and speed)."""
    passage = _finer(dense(passage), 0.5 / omega)
    command = passage.commands[channel]
    at, speed = rung(omega, zeta, passage.t_in, command)
    since = passage.t_in - passage.stamps[0]
    decay = np.where(since >= 0.0, np.exp(-zeta * omega * np.maximum(since, 0.0)), 0.0)
    damped = omega * math.sqrt(1.0 - zeta * zeta)
    free = [decay * np.cos(damped * since), decay * np.sin(damped * since)]
    return passage, [_midway(at) - command, _midway(speed)], [_midway(x) for x in free]


def _finer(passage: Passage, longest: float) -> Passage:
    """Return the passage with an input sample at least every *longest* [s]."""
    steps = np.diff(passage.t_in)
    counts = np.maximum(np.ceil(steps / longest).astype(int), 1)
    starts = np.repeat(passage.t_in[:-1], counts)
    within = np.arange(len(starts)) - np.repeat(np.cumsum(counts) - counts, counts)
    t = np.append(starts + within * np.repeat(steps / counts, counts), passage.t_in[-1:])
    at = np.append(np.repeat(np.arange(len(steps)), counts), len(steps))
    return replace(passage, t_in=t, commands={name: levels[at] for name, levels in passage.commands.items()})


def _midway(x: Array) -> Array:
    """Return (n,) the mean of each value and the next, so that a zero-order hold is right on average."""
    return np.append(0.5 * (x[1:] + x[:-1]), x[-1:])


def _gain(problem: Problem, plain: Fitted, channel: str, omega: float) -> float:
    """Return the reduction of minus twice the log-likelihood by the best spring that *channel* excites."""
    starts = [np.array([a, math.log(z)]) for a in NEAR for z in DAMPING]
    table = bent_by(problem, plain, channel, [bend for p in starts for bend in _springs(omega, p)])
    if table is None:
        return 0.0

    def cost(p: Array) -> float:
        if abs(p[0]) > 1.2 * NEAR[-1] or not LEAST < math.exp(p[1]) < MOST:
            return math.inf
        columns = bent_by(problem, plain, channel, _springs(omega, p))
        return math.inf if columns is None else _left(plain, columns)

    tried = [_left(plain, table[:, 2 * i : 2 * i + 2]) for i in range(len(starts))]
    first = starts[int(np.argmin(tried))]
    simplex = first + np.array([[0.0, 0.0], [0.03, 0.0], [0.0, 0.4]])
    best = minimize(
        cost,
        first,
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "xatol": 1e-3, "fatol": 0.1, "maxfev": 60},
    )
    return _left(plain, np.empty((len(table), 0))) - float(best.fun)


def _springs(omega: float, p: Array) -> list[Bend]:
    """Return position and speed of a spring with frequency *omega* exp(p[0]) and damping ratio exp(p[1])."""

    def bend(which: int) -> Bend:
        return lambda t, command: rung(omega * math.exp(p[0]), math.exp(p[1]), t, command)[which]

    return [bend(0), bend(1)]


def _left(plain: Fitted, columns: Array) -> float:
    """Return minus twice the log-likelihood, up to a constant, of the fit with *columns* (n, k) added."""
    signal = np.concatenate([np.full(int(np.isfinite(r.judged).sum()), r.signal) for r in plain.rests])
    error, X = plain.residual, np.column_stack([plain.jacobian, columns])
    size = np.linalg.norm(X, axis=0)
    X = X[:, size > 0.0] / size[size > 0.0]
    weight, levels = np.ones(len(error)), dict.fromkeys(plain.levels, 1.0)
    for _ in range(ROUNDS):
        left = error - X @ np.linalg.lstsq(X * weight[:, None], error * weight, rcond=1e-9)[0]
        levels = {s: max(float(np.sqrt(np.mean(left[signal == s] ** 2))), 1e-12) for s in levels}
        weight = 1.0 / np.array([levels[s] for s in signal])
    return sum(2.0 * int((signal == s).sum()) * math.log(v) for s, v in levels.items())
