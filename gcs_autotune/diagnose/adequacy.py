"""Test whether a fit leaves anything unexplained, without a particular cause in mind.

The tests of each signal are pooled. They are Ljung1978 over short and long lags, the variance of block means (slow
drifts), and the largest line of the periodogram (Fisher1929). An apparent wave is compared with ringing of the craft
(:mod:`.resonance_check`). Score tests look for forces that no base model has: cubes, moduli, sines of twice the
heading, past commands and others. Each uses the sensitivity of the motion to that force. A Bonferroni correction covers
all tests.

A cause may also fit by the wrong law. At nearly constant speed, cubic drag is almost the same as quadratic drag. Each
reported law is therefore compared with a generic law of the same kind. If the generic law is likelier by odds of twenty
to one, the cause is only a hypothesis.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune import chi_square
from gcs_autotune.diagnose.resonance_check import memories, resonance_checks
from gcs_autotune.diagnose.score import ALIKE, SIGNIFICANCE, SearchStep
from gcs_autotune.effects import EFFECTS, EffectInstance, EffectResidual, ExtendedSimulator, columns_of
from gcs_autotune.errors import BadFile
from gcs_autotune.identify.problems import Fitted, Problem, judged_by
from gcs_autotune.identify.signals import autocorrelation
from gcs_autotune.models import Form, term_of
from gcs_autotune.slow_imports import scipy_stats
from gcs_autotune.sname import DOFS

__all__ = [
    "WHITE",
    "Test",
    "correlation_of",
    "explains_all",
    "leaves_nothing",
    "nonparametric_rivals",
    "tests_of",
    "whiteness_of",
]

Array = NDArray[np.float64]


SHORT, LONG = 8, 40
"""Maximum lags, in samples, of the two portmanteau tests (Ljung1978)."""

LATE, RESPONSE, MOST_MEMORY = "measurement-delay", 2.5, 3
"""Constants for sensors that report late.

LATE: slug of the effect. RESPONSE: duration of the response of a low-pass filter (Butterworth, second order), in units
of its delay. MOST_MEMORY: maximum number of lags that the tests omit because of the filter. The remaining lags are
tested with the variance of Bartlett1946.
"""

WHITE = 0.005
"""Probability that the tests together reject a complete model."""

FEWEST_FOR_TAILS = 50

ROUNDED = 1.25
"""Largest residual that counts as rounding, relative to the standard deviation of the rounding error. The excess leaves
space for the noise of the sensor. Project choice.
"""

BLOCK = 25
"""Number of samples per block in the test of block means."""


@dataclass(frozen=True, slots=True)
class Test:
    """One test of the residuals: what it examines (in words), the signal, its p-value, and a size to report
    (may be NaN).
    """

    what: str
    signal: str
    p: float
    size: float = math.nan


def whiteness_of(tests: list[Test]) -> float:
    """Return the smallest p-value of the tests against white noise, with a Bonferroni correction for their number."""
    return min(1.0, len(tests) * min((t.p for t in tests), default=1.0))


def tests_of(problem: Problem, fitted: Fitted) -> list[Test]:
    """Return all tests of the residuals of a fit: correlation, drift, spectral lines, tails, generic forces,
    ringing."""
    ringing = [Test(words, "", p) for words, p in resonance_checks(problem, fitted)]
    return [*_portmanteaus(fitted, problem.data_summary.lags), *_scores(problem, fitted), *ringing]


def correlation_of(fitted: Fitted) -> float:
    """Return the number of correlated samples that carry as much information as one independent sample.

    The signal with the largest number decides.
    """
    worst = 1.0
    for name in fitted.levels:
        times = []
        for series in _series(fitted, name):
            if len(series) < 3 * SHORT:
                continue
            rho = autocorrelation(series, len(series) // 4)
            if len(series) * float(np.sum(rho[:SHORT] ** 2)) < chi_square.threshold(0.01, SHORT):
                times.append(1.0)
                continue
            below = np.flatnonzero(rho < 0.05)
            times.append(1.0 + 2.0 * float(rho[: int(below[0]) if len(below) else len(rho)].sum()))
        if times:
            worst = max(worst, float(np.median(times)))
    return worst


def _series(fitted: Fitted, name: str) -> list[Array]:
    return [(r.judged[np.isfinite(r.judged)] / fitted.levels[name]) for r in fitted.rests if r.signal == name]


def _portmanteaus(fitted: Fitted, lags_aboard: Mapping[str, float]) -> Iterator[Test]:
    for name in fitted.levels:
        series = [s for s in _series(fitted, name) if len(s) > 2 * SHORT]
        if not series:
            continue
        memory = _memory(fitted, name, lags_aboard.get(name, 0.0))
        for lags, words in ((SHORT, "short-term correlation"), (LONG, "correlation over many samples")):
            total, freedom, first = 0.0, 0, []
            for s in series:
                n, own = len(s), min(lags, len(s) // 4)
                rho = autocorrelation(s, own)
                lag = np.arange(1, own + 1)
                wider = 1.0 + 2.0 * float(np.sum(rho[:memory] ** 2))
                total += n * (n + 2) * float(np.sum(rho[memory:] ** 2 / (n - lag[memory:]))) / wider
                freedom += own - memory
                first.append(float(rho[memory]))
            yield Test(words, name, float(chi_square.exceeded_by_chance(total, freedom)), float(np.mean(first)))
        yield _drift(series, name, memory)
        yield _tails(_normal(fitted, name), name)
        yield _line(series, name)


def _memory(fitted: Fitted, name: str, known: float) -> int:
    """Return the number of lags over which a sensor's filter correlates the noise of a signal that it also delays."""
    late = known + sum(e.values["delay"] for e in fitted.effects if e.slug == LATE and name in columns_of(e.place))
    steps = [float(np.median(np.diff(r.t))) for r in fitted.rests if r.signal == name and len(r.t) > 1]
    return min(int(RESPONSE * late / min(steps)), MOST_MEMORY) if late and steps else 0


def _drift(series: list[Array], name: str, memory: int) -> Test:
    total, freedom = 0.0, 0
    for s in series:
        count = max(2, len(s) // BLOCK)
        parts = np.array_split(s, count)
        wider = 1.0 + 2.0 * max(float(np.sum(autocorrelation(s, SHORT)[:memory])), 0.0)
        total += sum(len(p) * float(p.mean()) ** 2 for p in parts) / float(np.mean(s**2) or 1.0) / wider
        freedom += count
    return Test("slow drift", name, float(chi_square.exceeded_by_chance(total, freedom)), total / freedom)


def _normal(fitted: Fitted, name: str) -> list[Array]:
    """Return the standardised residuals of a signal.

    If rounding is the only disturbance of the fit, return the noise before rounding instead.
    """
    judging = [e for e in fitted.effects if EFFECTS[e.slug].is_disturbance]
    mine = [e for e in judging if EFFECTS[e.slug].is_rounding and name in columns_of(e.place)]
    if not mine or not all(EFFECTS[e.slug].is_rounding for e in judging):
        return _series(fitted, name)
    residuals, level = [], fitted.levels[name]
    for r in fitted.rests:
        if r.signal == name:
            left = EffectResidual("", name, r.t, r.measured - r.predicted, r.measured, level)
            noise = EFFECTS[mine[0].slug].normal(mine[0], left)
            residuals.append(noise[np.isfinite(noise)])
    return residuals


def _tails(series: list[Array], name: str) -> Test:
    """Return the one-sided test of kurtosis (DAgostino1970) for tails heavier than those of a normal distribution."""
    joined = np.concatenate(series)
    if len(joined) < FEWEST_FOR_TAILS or scipy_stats().kurtosis(joined) <= 0.0:
        return Test("heavy tails", name, 1.0)
    result = scipy_stats().kurtosistest(joined, alternative="greater")
    return Test("heavy tails", name, float(result.pvalue), float(scipy_stats().kurtosis(joined)))


def _line(series: list[Array], name: str) -> Test:
    """Return Fisher's test for the strongest spectral line of any segment."""
    best, size = 1.0, 0.0
    for s in series:
        power = np.abs(np.fft.rfft(s - s.mean()))[1:-1] ** 2
        m = len(power)
        if m < 4 or power.sum() <= 0.0:
            continue
        g = float(power.max() / power.sum())
        p = min(1.0, m * (1.0 - g) ** (m - 1))
        if p * len(series) < best:
            best, size = min(1.0, p * len(series)), g
    return Test("one frequency", name, best, size)


def generic_terms(form: Form) -> dict[str, str]:
    """Return generic forces: name of the derivative -> description."""
    terms: dict[str, str] = {}
    for dof in form.dofs:
        d = DOFS[dof]
        f, nu = d.force, d.velocity
        own = {
            f"{f}_0": "a constant force",
            f"{f}_{nu}{nu}": f"drag proportional to {nu} squared",
            f"{f}_{nu}{nu}{nu}": f"drag proportional to {nu} cubed",
        }
        if "yaw" in form.dofs:
            own |= {
                f"{f}_sinpsi": "a force proportional to the sine of the heading",
                f"{f}_cospsi": "a force proportional to the cosine of the heading",
            }
        if dof in ("yaw", "heave"):
            own[f"{f}_{d.position}"] = f"a force proportional to {d.position}"
        for channel, pairs in form.inputs.items():
            if any(force == f for force, _ in pairs):
                own[f"{f}_{channel}{channel}"] = f"a force proportional to {channel} squared"
                own[f"{f}_{channel}{channel}{channel}"] = f"a force proportional to {channel} cubed"
                own[f"{f}_|{channel}|{nu}"] = f"a force proportional to |{channel}| times {nu}"
                own[f"{f}_|{channel}|"] = f"a force proportional to |{channel}|"
        for other in form.dofs:
            if other != dof:
                own[f"{f}_{DOFS[other].velocity}"] = f"a force proportional to {DOFS[other].velocity}"
        for name, words in own.items():
            try:
                term_of(name, tuple(form.inputs))
            except BadFile:
                continue
            terms[name] = words
    return terms


def _scores(problem: Problem, fitted: Fitted) -> Iterator[Test]:
    """Yield a score test for each generic force, added to the fitted model."""
    terms = {n: w for n, w in generic_terms(fitted.form).items() if n not in fitted.free}
    columns = _columns(problem, fitted, tuple(terms))
    if columns is None:
        return
    residual = fitted.residual
    norms = np.linalg.norm(fitted.jacobian, axis=0)
    U, s, _ = np.linalg.svd(fitted.jacobian / np.where(norms > 0.0, norms, 1.0), full_matrices=False)
    Q = U[:, s > 1e-7 * s[0]] if len(s) else U
    variance = float(residual @ residual) / max(len(residual) - Q.shape[1], 1)
    own = ((words, columns[:, j : j + 1]) for j, words in enumerate(terms.values()))
    for words, group in (*own, *memories(problem, fitted)):
        basis = _directions(group, Q)
        if not basis.shape[1]:
            continue
        score = basis.T @ residual
        statistic, power = float(score @ score), float(residual @ residual)
        side = float(group[:, 0] @ basis[:, 0]) * float(score[0]) if basis.shape[1] == 1 else 1.0
        size = math.copysign(math.sqrt(statistic / power), side)
        yield Test(words, "", float(chi_square.exceeded_by_chance(statistic / variance, basis.shape[1])), size)


def _directions(group: Array, Q: Array) -> Array:
    """Return an orthonormal basis (n, k) of the part of *group* (n, j) outside the span of the columns of *Q*."""
    free = group - Q @ (Q.T @ group)
    before, after = np.linalg.norm(group, axis=0), np.linalg.norm(free, axis=0)
    free = free[:, (after > 1e-3 * before) & (after > 0.0)]
    if not free.shape[1]:
        return free
    U, s, _ = np.linalg.svd(free / np.linalg.norm(free, axis=0), full_matrices=False)
    return U[:, s > 1e-4 * s[0]]


def _columns(problem: Problem, fitted: Fitted, names: tuple[str, ...]) -> Array | None:
    """Return the sensitivities (n, k) of all signals to generic forces of size zero, divided by the noise levels."""
    form = fitted.form.freeing(*(n for n in names if n not in fitted.form.parameters))
    simulator = ExtendedSimulator(form, fitted.effects, names)
    values = dict(zip(fitted.form.parameters, fitted.theta.tolist(), strict=True))
    theta = np.array([values.get(n, 0.0) for n in form.parameters])
    rows, at = [], 0
    for i, segment in enumerate(problem.segments):
        passage = segment.passage_at(fitted.shift)
        predicted = simulator.run(theta, fitted.effects, fitted.initial[i], passage, sensitivities=True)
        if predicted is None:
            return None
        for name in segment.signals:
            rest, level = fitted.rests[at], fitted.levels[name]
            at += 1
            left = EffectResidual(segment.run, name, rest.t, rest.measured - rest.predicted, rest.measured, level)
            _, columns, _ = judged_by(fitted.effects, left, predicted[name][1])
            rows.append(columns[np.isfinite(rest.judged)] / level)
    return np.vstack(rows)


def leaves_nothing(problem: Problem, fit: Fitted) -> bool:
    """Return whether the residuals of a fit, on the fitted runs, are compatible with white noise and with rounding.

    The rounding error of a slow signal is not white. A signal is not tested if its residual is as small.
    """
    steps = problem.data_summary.quantum
    rounded = {n for n, level in fit.levels.items() if level <= ROUNDED * steps.get(n, 0.0) / math.sqrt(12.0)}
    return whiteness_of([t for t in tests_of(problem, fit) if t.signal not in rounded]) >= SIGNIFICANCE


def explains_all(problem: Problem, step: SearchStep[Fitted]) -> bool:
    """Return whether some candidate of a step leaves only noise on the fitted runs.

    The prediction of held-out data is not considered.
    """
    return any(leaves_nothing(problem, j.fit) for j in step.judged if j.evidence > 0.0)


TRIALS = 30


def _cubic_drag(own: EffectInstance, form: Form) -> Sequence[str]:
    dof = DOFS[own.place]
    return (dof.force + "_" + 3 * dof.velocity,)


def _cubic_thrust(own: EffectInstance, form: Form) -> Sequence[str]:
    return [force + "_" + 3 * own.place for force, _ in form.inputs[own.place]]


LAWS: Mapping[str, tuple[Callable[[EffectInstance, Form], Sequence[str]], str]] = {
    "quadratic-drag": (_cubic_drag, "a cubic drag law fits better than a quadratic one"),
    "quadratic-actuator": (_cubic_thrust, "a cubic thrust curve fits better than a quadratic one"),
}
"""Slug of a cause -> derivatives of the generic law to compare it with, and the meaning of a better fit of that law."""


def nonparametric_rivals(problem: Problem, fitted: Fitted) -> tuple[str, ...]:
    """Return descriptions of the generic laws that are likelier than the causes of *fitted* that they replace."""
    rivals = []
    for own in fitted.effects:
        if own.slug not in LAWS:
            continue
        law, words = LAWS[own.slug]
        names = [n for n in law(own, fitted.form) if n not in fitted.form.parameters]
        rest = tuple(e for e in fitted.effects if e is not own)
        form = fitted.form.freeing(*names)
        other = Problem(form, problem.segments, problem.data_summary, problem.limits, (*problem.free, *names))
        values = dict(zip(fitted.form.parameters, fitted.theta.tolist(), strict=True))
        start = np.array([values.get(n, 0.0) for n in form.parameters])
        fit = other.fit(start, rest, fitted.initial, trials=TRIALS, shift=fitted.shift) if names else None
        if fit is not None and fit.cost < fitted.cost - ALIKE:
            rivals.append(words)
    return tuple(rivals)
