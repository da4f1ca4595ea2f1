"""Describe the residuals of a model: findings in words, and plot data for every residual."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.diagnose.adequacy import Test, tests_of, whiteness_of
from gcs_autotune.diagnose.result import Portrait, Signature
from gcs_autotune.identify import Trace
from gcs_autotune.identify.problems import Fitted, Problem, Residual
from gcs_autotune.identify.signals import autocorrelation
from gcs_autotune.rounding import HALF_WIDTH
from gcs_autotune.slow_imports import scipy_signal
from gcs_autotune.sname import SIGNALS

__all__ = ["portraits_of", "signature_of"]

Array = NDArray[np.float64]

CLEAR = 0.005
"""Probability, over all tests together, below which a finding is reported."""

MOST = 5
"""Maximum number of findings reported."""

LAGS = 60


def signature_of(problem: Problem, fitted: Fitted) -> tuple[Signature, list[Test]]:
    """Return a description of the residuals of a fit, and the tests that support it."""
    tests = tests_of(problem, fitted)
    significant = sorted((t for t in tests if t.p * len(tests) < CLEAR), key=lambda t: (t.p, -abs(t.size)))
    lines: dict[str, None] = {}
    for test in significant:
        lines.setdefault(_words(test), None)
    return Signature(tuple(list(lines)[:MOST]), whiteness_of(tests)), tests


def _words(test: Test) -> str:
    if not test.signal and math.isnan(test.size):
        return f"the oscillation is correlated with {test.what}, so its cause is probably the craft, not waves"
    if not test.signal:
        return f"the residual is correlated with {test.what} (correlation {test.size:+.2f})"
    if test.what == "one frequency":
        return f"{test.signal}: {100 * test.size:.0f} % of the residual's power is at one frequency"
    if test.what == "heavy tails":
        return f"{test.signal}: the residual has more outliers than noise explains (kurtosis {test.size:+.1f})"
    if test.what == "slow drift":
        return (
            f"{test.signal}: the residual drifts slowly, {math.sqrt(test.size):.1f} times as far as white noise would"
        )
    return f"{test.signal}: successive samples of the residual are correlated"


def portraits_of(problem: Problem, fitted: Fitted) -> tuple[Portrait, ...]:
    """Return the plots of every signal's residual: traces, spectrum, correlations, and residual over other
    quantities."""
    portraits = []
    for name in fitted.levels:
        unit = SIGNALS[name][0]
        rests = [r for r in fitted.rests if r.signal == name]
        traces = tuple(
            Trace(
                problem.segments[r.segment].run,
                r.t,
                r.measured,
                r.predicted,
                np.full(len(r.t), HALF_WIDTH * fitted.levels[name]),
                name,
                unit,
            )
            for r in rests
        )
        lag, rho = _autocorrelation(rests)
        n = max(len(r.t) for r in rests)
        portraits.append(
            Portrait(
                signal=name,
                unit=unit,
                traces=traces,
                against=_against(problem, fitted, name),
                one_step=_one_step(rests),
                spectrum=_spectrum(rests),
                correlation=(lag, rho),
                cross=_cross(problem, rests),
                limit=HALF_WIDTH / math.sqrt(n),
            )
        )
    return tuple(portraits)


def _left(rest: Residual) -> Array:
    left: Array = rest.measured - rest.predicted
    return left


def _autocorrelation(rests: Sequence[Residual]) -> tuple[Array, Array]:
    longest = max(rests, key=lambda r: len(r.t))
    e, t = _left(longest), longest.t
    lags = min(LAGS, len(e) // 3)
    step = float(np.median(np.diff(t)))
    lag = np.asarray(np.arange(1, lags + 1) * step, dtype=np.float64)
    return lag, autocorrelation(e, lags)


def _against(problem: Problem, fitted: Fitted, name: str) -> Mapping[str, tuple[Array, Array, str]]:
    xs: dict[str, list[tuple[Array, Array]]] = {}
    units: dict[str, str] = {"time": "s"}
    for rest in fitted.rests:
        if rest.signal != name:
            continue
        segment = problem.segments[rest.segment]
        left = _left(rest)
        xs.setdefault("time", []).append((rest.t - rest.t[0], left))
        for channel, values in segment.passage.commands.items():
            at = np.maximum(np.searchsorted(segment.passage.t_in, rest.t, side="right") - 1, 0)
            xs.setdefault(channel, []).append((values[at], left))
            units[channel] = problem.data_summary.inputs[channel]
        for signal, own in segment.signals.items():
            value = np.interp(rest.t, own.t, own.values)
            if signal == "psi":
                value = np.mod(value, 2.0 * np.pi)
            xs.setdefault(signal, []).append((value, left))
            units[signal] = SIGNALS[signal][0]
    return {n: (np.concatenate([a for a, _ in p]), np.concatenate([b for _, b in p]), units[n]) for n, p in xs.items()}


def _one_step(rests: Sequence[Residual]) -> tuple[Array, Array]:
    """Return the times and the changes of the residual from one sample to the next, of the longest segment."""
    longest = max(rests, key=lambda r: len(r.t))
    steps: Array = np.diff(_left(longest))
    return longest.t[1:], steps


def _spectrum(rests: Sequence[Residual]) -> tuple[Array, Array] | None:
    longest = max(rests, key=lambda r: len(r.t))
    t, e = longest.t, _left(longest)
    if len(t) < 32:
        return None
    step = float(np.median(np.diff(t)))
    grid = np.arange(t[0], t[-1], step)
    f, power = scipy_signal().welch(np.interp(grid, t, e), fs=1.0 / step, nperseg=min(256, len(grid)))
    return f[1:], power[1:]


def _cross(problem: Problem, rests: Sequence[Residual]) -> Mapping[str, tuple[Array, Array]]:
    longest = max(rests, key=lambda r: len(r.t))
    t, e = longest.t, _left(longest)
    e = e - e.mean()
    segment = problem.segments[longest.segment]
    lags = min(LAGS, len(e) // 4)
    step = float(np.median(np.diff(t)))
    correlations: dict[str, tuple[Array, Array]] = {}
    signals: dict[str, Array] = {}
    for channel, values in segment.passage.commands.items():
        at = np.maximum(np.searchsorted(segment.passage.t_in, t, side="right") - 1, 0)
        signals[channel] = values[at]
    for name, own in segment.signals.items():
        signals[name] = np.interp(t, own.t, own.values)
    for name, x in signals.items():
        x = x - x.mean()
        power = math.sqrt(float(x @ x) * float(e @ e))
        if power <= 0.0:
            continue
        rho = [
            float(e[max(k, 0) : len(e) + min(k, 0)] @ x[max(-k, 0) : len(x) - max(k, 0)]) / power
            for k in range(-lags, lags + 1)
        ]
        lag = np.asarray(np.arange(-lags, lags + 1) * step, dtype=np.float64)
        correlations[name] = (lag, np.array(rho))
    return correlations
