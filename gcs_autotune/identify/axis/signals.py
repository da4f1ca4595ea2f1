"""Choose the measured signals to fit: position, velocity, or both.

A position with its own sensor (heading, depth) is used first. A velocity is added only if it agrees with the motion
fitted to the position: same scale, no lag, white errors. A gyro normally agrees. A filtered, delayed or differentiated
velocity does not, and would bias the fit. Surge and sway are fitted to velocity if there is one, because ``x`` and
``y`` are north and east, not ahead and starboard.

If the fitted motion misses the position by more than noise, the velocity cannot be compared with it. The sensors are
then compared with each other (:mod:`gcs_autotune.crosscheck`). For example, sideslip delays the motion of a one-axis
model relative to the gyro.

Otherwise the comparison takes into account how uncertain the fitted motion is. A wrong constant force looks like a bias
of the velocity, and a wrong inertia like a lag. Scale, lag and bias of the velocity are therefore fitted together with
corrections ``x`` of the position's fit. The covariance ``C`` of that fit sets their cost::

    minimise  |error - J x - T (gain, lag, bias)|^2 / sigma^2 + x' C^-1 x

This is one Gauss-Newton step of the joint fit of both channels. Some input changes may have happened one autopilot loop
earlier or later (:mod:`gcs_autotune.identify.problems.stamp_correction`). Their time shifts are part of ``x``. The
standard errors are those of the difference between the two channels. The test is that of Hausman1978 for two estimates.
It covers only typical velocity errors: scale, lag and bias.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.crosscheck import compared_with_rate
from gcs_autotune.errors import MissingChannel, UsageError
from gcs_autotune.identify.axis.form import Explicit
from gcs_autotune.identify.problems.solution import Solution
from gcs_autotune.identify.problems.stamp_correction import switches_of
from gcs_autotune.identify.signals.segment import Segment
from gcs_autotune.identify.signals.whiteness import autocorrelation
from gcs_autotune.models import simulate_explicit

__all__ = ["KINDS", "VelocityConsistency", "agreement", "first_names", "objection", "wanted_names"]

KINDS = ("position", "velocity")
"""Kinds of signal that the option ``use`` accepts."""

GAIN, LAG, BIAS, COLOUR = 0.02, 0.1, 0.02, 0.2
"""Limits within which a measured velocity is added to the fit.

They are the gain error [1], the lag [sampling steps], the bias [fraction of rms] and the autocorrelation of the errors.
Within these limits no parameter changes by more than about 2 %. Project choice.
"""

SURELY = 3.0
"""Number of standard errors above which a scale error, lag or bias is significant.

Project choice: a false alarm in 0.3 % of cases.
"""


def wanted_names(records: Sequence[Segment], use: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the signals that the user chose for the fit.

    use : names of signals (``("psi", "r")``) or their kinds (``("position",)``).

    Raises
    ------
    UsageError
        *use* is empty or contains another word.
    MissingChannel
        A run has none of the chosen signals.
    """
    axis = records[0].dof
    called = {word: getattr(axis, kind) for kind in KINDS for word in (kind, getattr(axis, kind))}
    if not use or any(u not in called for u in use):
        raise UsageError(
            f"--use {','.join(use)} is not valid. {axis.name} is fitted to {axis.position} ('position'), "
            f"{axis.velocity} ('velocity') or both"
        )
    names = tuple(getattr(axis, kind) for kind in KINDS if getattr(axis, kind) in {called[u] for u in use})
    for record in records:
        if not set(names) & set(record.signals):
            raise MissingChannel(f"run '{record.run}' has no {' or '.join(names)}. Omit use= (--use), or omit that run")
    return names


def first_names(records: Sequence[Segment]) -> tuple[str, ...]:
    """Return the names of the signals of the first fit: the position, or else the velocity.

    Both names are returned if neither of the two signals is present in all runs.
    """
    axis = records[0].dof
    prefer = (axis.velocity, axis.position) if axis.along_ground else (axis.position, axis.velocity)
    for name in prefer:
        if all(name in r.signals for r in records):
            return (name,)
    return (axis.position, axis.velocity)


def objection(records: Sequence[Segment], solution: Solution) -> str:
    """Return the reason why measured velocities must not be added to the fit, or an empty text if there is none.

    A scale error, lag or bias is a reason if it exceeds its limit and three standard errors. The standard errors
    include those of the fit to the position (:func:`gcs_autotune.identify.axis.signals.agreement`). If the model does
    not reproduce the position but the sensors agree, the model causes the scale error or lag. It is then no reason.
    """
    for record in records:
        if record.velocity is None:
            return f"run '{record.run}' has no velocity"
    consistency = agreement(records, solution)
    if consistency is None:
        return "the motion fitted without the velocity diverges, so no comparison is possible"
    std = consistency.std
    scaled, late = (
        abs(consistency.gain) > max(GAIN, SURELY * std[0]),
        abs(consistency.lag) > max(LAG * consistency.step, SURELY * std[1]),
    )
    if (scaled or late) and not solution.white and all(_sensors_agree(record, solution) for record in records):
        return ""
    if scaled:
        return f"its scale differs by {100.0 * consistency.gain:+.1f} %"
    if late:
        return f"it lags by {1000.0 * consistency.lag:.0f} ms"
    if abs(consistency.bias) > max(BIAS * consistency.rms, SURELY * std[2]):
        return f"it is biased by {consistency.bias:.3g}"
    colour = max(float(np.max(np.abs(autocorrelation(e, 3)))) for e in consistency.errors)
    if colour > max(COLOUR, 4.0 / np.sqrt(min(len(e) for e in consistency.errors))):
        return f"its errors are correlated ({colour:.2f}). It is filtered or derived, or the model lacks a term"
    return ""


SLOW = 0.25
"""Fraction of the craft's time constant below which a lag between two sensors is negligible. Project choice."""


def _sensors_agree(record: Segment, solution: Solution) -> bool:
    """Return whether position and velocity of a stretch show the same motion, without scale error or lag.

    The limit of the lag depends on the craft's time constant. The lag of a gyro filter as slow as the craft would be
    fitted as part of the craft.
    """
    main, rate = (record.measured.get(name) for name in (record.dof.position, record.dof.velocity))
    comparison = None if main is None or rate is None else compared_with_rate(main, rate)
    if comparison is None or comparison.kind != "agrees":
        return False
    step = float(np.median(np.diff(record.signals[record.dof.velocity].t)))
    scaled = abs(comparison.factor - 1.0) > max(GAIN, SURELY * comparison.std)
    rate_constant = abs(solution.value("a"))
    slow = rate_constant * (abs(comparison.shift) + SURELY * comparison.shift_std + 0.5 * step) < SLOW
    return not scaled and slow and abs(comparison.shift) <= max(LAG * step, SURELY * comparison.shift_std)


Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class VelocityConsistency:
    """Differences between the measured velocities and the fitted motion.

    ``gain`` [1], ``lag`` [s] and ``bias`` [rad/s or m/s].

    - ``std``: their standard errors, including those of the fit.
    - ``rms`` [rad/s or m/s]: of the fitted motion.
    - ``step`` [s]: sampling interval of the densest velocity.
    - ``errors``: per stretch, after correction of the motion by velocity and position together.
    """

    gain: float
    lag: float
    bias: float
    std: tuple[float, float, float]
    rms: float
    step: float
    errors: tuple[Array, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Compared:
    """Comparison of one stretch.

    - ``error`` (n,): measured minus simulated velocity.
    - ``nu``, ``acceleration`` (n,): simulated motion.
    - ``J`` (n, packed): derivatives by the vector of the fit.
    - ``shifts`` (n, k): derivatives by the uncertain stamps of the input, times their uncertainty.
    """

    error: Array
    nu: Array
    acceleration: Array
    J: Array
    shifts: Array
    step: float


def agreement(records: Sequence[Segment], solution: Solution) -> VelocityConsistency | None:
    """Return how the measured velocities of all records differ from *solution*, a fit to the positions alone.

    Return None if the simulation diverges.
    """
    parts = [_compared(records, i, solution) for i in range(len(records))]
    error, nu, slope = (np.concatenate([getattr(p, n) for p in parts]) for n in ("error", "nu", "acceleration"))
    fitted = np.vstack([p.J for p in parts]) @ _root(_raised_covariance(solution))
    known = np.hstack([fitted, _side_by_side([p.shifts for p in parts])])
    known = known[:, np.isfinite(known).all(axis=0)]  # what the fit does not know at all cannot be corrected by it
    table = np.column_stack([nu, -slope, np.ones_like(nu)])
    if not (np.isfinite(error).all() and np.isfinite(table).all()):
        return None
    sigma = _scatter(error, np.hstack([known, table]))
    coefficients, covariance = _ridged(error, known, table, sigma)
    moved = known @ _ridged(error, known, table[:, :0], sigma)[0]
    ends = np.cumsum([len(p.error) for p in parts])[:-1]
    gain, lag, bias = (float(v) for v in coefficients[-3:])
    std = np.sqrt(np.diag(covariance)[-3:])
    return VelocityConsistency(
        gain,
        lag,
        bias,
        (float(std[0]), float(std[1]), float(std[2])),
        float(np.sqrt(np.mean(nu**2))),
        min(p.step for p in parts),
        tuple(np.split(error - moved, ends)),
    )


def _compared(records: Sequence[Segment], i: int, solution: Solution) -> _Compared:
    record = records[i]
    assert record.velocity is not None
    t = record.velocity.t
    keep = t >= float(record.main.t[0])
    stamps = np.union1d(record.main.t[:1], t[keep])
    numbers, names = Explicit(*solution.theta.tolist()).later(solution.shift), Explicit._fields
    p = np.concatenate([numbers, solution.initial[i]])
    motion, at = simulate_explicit(p, record.t_in, record.tau, stamps), np.searchsorted(stamps, t[keep])
    nu, by = motion.nu[at], motion.nu_by[at]
    seen = replace(record, signals={**record.signals, record.velocity.name: record.velocity.since(float(stamps[0]))})
    switches = switches_of(solution.form, seen, np.array(numbers), solution.initial[i])
    states = np.zeros((len(nu), 2 * len(records)))
    states[:, 2 * i : 2 * i + 2] = by[:, len(names) :]
    late = [by[:, names.index("delay")][:, None]] if solution.shift_std > 0.0 else []
    count = len(solution.free) + states.shape[1] + len(late)
    common = np.zeros((len(nu), len(solution.whole) - count))  # errors of the record, no part of the motion
    return _Compared(
        record.velocity.values[keep] - nu,
        nu,
        _acceleration(numbers, record, t[keep], nu),
        np.hstack([by[:, [names.index(n) for n in solution.free]], states, common, *late]),
        switches.by[record.velocity.name] * record.slack[switches.which],
        float(np.median(np.diff(t))),
    )


def _raised_covariance(solution: Solution) -> Array:
    raised: Array = solution.whole * np.outer(solution.raised, solution.raised)
    return raised


def _acceleration(numbers: Explicit, record: Segment, t: Array, nu: Array) -> Array:
    b, a, c, d, delay = numbers
    held = np.maximum(np.searchsorted(record.t_in, t - delay, side="right") - 1, 0)
    acceleration: Array = b * record.tau[held] - a * nu - c * np.abs(nu) * nu + d
    return acceleration


def _side_by_side(tables: Sequence[Array]) -> Array:
    """Return the block diagonal matrix of *tables*, because every stretch has its own time shifts."""
    whole = np.zeros((sum(len(t) for t in tables), sum(t.shape[1] for t in tables)))
    row = column = 0
    for t in tables:
        whole[row : row + len(t), column : column + t.shape[1]] = t
        row, column = row + len(t), column + t.shape[1]
    return whole


def _root(covariance: Array) -> Array:
    """Return ``R`` (p, p) with ``R R' = covariance``.

    The covariance may be singular. If it is not finite, ``R`` is NaN.
    """
    if not np.isfinite(covariance).all():
        return np.full_like(covariance, np.nan)
    values, vectors = np.linalg.eigh(covariance)
    root: Array = vectors * np.sqrt(np.maximum(values, 0.0))
    return root


def _scatter(error: Array, table: Array) -> float:
    """Return the standard deviation of the part of *error* that *table* (n, p) cannot explain."""
    residual = error - table @ np.linalg.lstsq(table, error, rcond=1e-9)[0]
    return float(np.sqrt(residual @ residual / max(len(residual) - table.shape[1], 1)))


def _ridged(error: Array, known: Array, table: Array, sigma: float) -> tuple[Array, Array]:
    """Fit ``known z + table y`` to *error*, with the prior ``z ~ N(0, 1)``.

    Return (z, y) and their covariance.
    """
    size = known.shape[1]
    A = np.vstack([np.hstack([known, table]), sigma * np.eye(size, size + table.shape[1])])
    inverse = np.linalg.pinv(A, rcond=1e-12)
    return inverse @ np.concatenate([error, np.zeros(size)]), sigma**2 * inverse @ inverse.T
