"""Is what looks like a wave the craft's own ringing? Something aboard that swings on after every command.

A predicting filter takes any swinging at one frequency for a wave, and leaves white noise; tests of what it leaves
find nothing. So the two are held against each other as models of the same runs: the wave, whose phase nobody foretells,
and a spring and mass rung by the command, whose phase the commands foretell. The craft with the latter is the model
without the wave, to first order in its parameters, with two forces more: position and speed of the spring.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from gcs_autotune.diagnose.history import Bend, bent_by
from gcs_autotune.effects.narrow_band import rung
from gcs_autotune.identify.extended.fitting import Fitted, Problem

__all__ = ["rings"]

Array = NDArray[np.float64]

WAVE = "wave-disturbance"
NEAR = np.linspace(-0.45, 0.45, 13)
"""Logarithms of the spring's frequency over the wave's that are tried: the craft about it shifts the peak."""
DAMPING = (0.02, 0.08, 0.25)
LEAST, MOST = 0.003, 0.6
"""Damping ratios of a spring: those tried first, and the bounds."""
NUMBERS = 4
"""What the ringing has to be told: frequency, damping, and the two shares."""
ROUNDS = 4
"""Of weighing the signals by what is left of each."""


def rings(problem: Problem, fitted: Fitted) -> Iterator[tuple[str, float]]:
    """Yield, for every input of a model with a wave, words and how much likelier the wave is than ringing, at most 1.

    (A likelihood ratio, less Schwarz's price for the numbers of the ringing: small where the commands foretell the
    swinging better than any filter follows it.)
    """
    waves = [e for e in fitted.effects if e.slug == WAVE]
    if not waves:
        return
    still = tuple(e for e in fitted.effects if e.slug != WAVE)
    plain = problem.fit(fitted.theta, still, fitted.initial, learn=False, shift=fitted.shift)
    if plain is None:
        return
    for channel, pairs in fitted.form.inputs.items():
        if pairs:
            gain = max(_gain(problem, plain, channel, e["frequency"]) for e in waves)
            ahead = gain - NUMBERS * math.log(max(fitted.samples, 2)) - (plain.cost - fitted.cost)
            yield f"every change of {channel}, after which it rings", math.exp(-0.5 * max(ahead, 0.0))


def _gain(problem: Problem, plain: Fitted, channel: str, omega: float) -> float:
    """Return by how much a spring rung by *channel*, at its best, lowers minus twice the log-likelihood of *plain*."""
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
    """Return position and speed of a spring of frequency *omega* exp(p[0]) and damping ratio exp(p[1])."""

    def bend(which: int) -> Bend:
        return lambda t, told: rung(omega * math.exp(p[0]), math.exp(p[1]), t, told)[which]

    return [bend(0), bend(1)]


def _left(plain: Fitted, columns: Array) -> float:
    """Return minus twice the log-likelihood with *columns* (n, k) besides all that was fitted, up to a constant."""
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
