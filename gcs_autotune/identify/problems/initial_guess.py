"""Find start values for the fit of a form by smoothing the motion and regressing the equations on it.

Signals are smoothed by local polynomials, each at its own stamps. The equations (Miskovic2007, eq. (4)) are linear in
the parameters (:mod:`gcs_autotune.models.coupled.regressors`), so bounded least squares gives start values. Parameters
that this regression cannot determine (delay, lag, current, walls) start at :data:`SPECIAL_START`. If the simulation
diverges with these values, more cautious start values follow. One axis has a more reliable method, :mod:`..axis.start`.
Filters use their own smoother.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from gcs_autotune.identify.problems.free_numbers import StampedProblem
from gcs_autotune.identify.problems.least_squares import Rules, descend
from gcs_autotune.identify.problems.likelihood import Limits, Objective, first_input
from gcs_autotune.identify.problems.noise import gaussian_noise
from gcs_autotune.identify.problems.quick_fit import first_levels
from gcs_autotune.identify.signals.segment import Segment, Signal
from gcs_autotune.models import (
    COEFFICIENTS,
    LEVER_ARM,
    SPECIAL,
    WALLS,
    Form,
    balance_of,
    inertia_of,
    program_of,
    states_of,
)
from gcs_autotune.smoothing import best_width, local_polynomials
from gcs_autotune.sname import DOFS

__all__ = [
    "SPECIAL_START",
    "InitialGuess",
    "RecordedMotion",
    "Regression",
    "SpecialStart",
    "initial_guess_of",
    "regression_of",
]

Array = NDArray[np.float64]

WIDTHS = (5, 11, 25, 61)
"""Numbers of samples that a local polynomial may cover. The best one is chosen for each signal. Project choice."""

MOST = 400
"""Maximum number of stamps per record at which the equations are evaluated. Project choice."""

RIDGE = 1e-6
"""Ridge added to each regressor, as a fraction of its power.

It keeps the parameters of weakly excited terms small. Project choice.
"""

ROUNDS = 3
"""Number of rounds in which each driven equation is weighted by its residual. Project choice.

An equation without inputs keeps its weight, because zero parameters would satisfy it best.
"""

LEAST = 1e-3
"""Smallest residual that is used to weight an equation, relative to the largest known force. Project choice."""

PIECES = 15
"""Maximum number of pieces of a record in the search for a start. Project choice.

Each piece starts at the measured state, so that the simulation of no piece diverges.
"""

SHORTEST = 12
"""Smallest number of stamps in a piece of a record. Project choice."""

TRIALS, ROUGH = 25, 1e-4
"""Number of trials on the pieces, and relative decrease of the cost that ends them. Project choice.

A start need not be exact.
"""

FEW = 2
"""Number of trials on the pieces after which the misfits of different forms are compared. Project choice."""

LIGHTEST = 0.02
"""Smallest inertia of a start. Project choice.

The unit is the inertia at which the measured acceleration would need all known forces.
"""

SHARE = 0.1
"""Initial noise level of a signal, as a fraction of its standard deviation. Project choice."""


class SpecialStart(NamedTuple):
    """Start value of a parameter that the regression cannot determine.

    - ``value``: start value, in the parameter's unit.
    - ``spread``: standard deviation of the true value about ``value``, in the parameter's unit.
    """

    value: float
    spread: float


SPECIAL_START: Mapping[str, SpecialStart] = {
    "delay": SpecialStart(0.0, 0.2),
    "lag": SpecialStart(0.2, 0.3),
    **dict.fromkeys(("V_x", "V_y", "drift_x", "drift_y"), SpecialStart(0.0, 0.3)),
    **dict.fromkeys(COEFFICIENTS, SpecialStart(0.0, 0.1)),
    **dict.fromkeys(LEVER_ARM, SpecialStart(0.0, 0.5)),
    "reach": SpecialStart(1.0, 1.0),
    "bottom": SpecialStart(0.0, 3.0),
    **dict.fromkeys(WALLS, SpecialStart(0.0, 1.0)),
}
"""Name in ``derivatives.SPECIAL`` -> start value and spread.

Most parameters start at zero: no delay, no current, no compass error, a sensor amidships, no wall. The lag starts at a
typical value for a thruster [s]. Project choice. The reach of the bottom effect starts at 1 m, because the effect
cannot be computed for zero.
"""


@dataclass(frozen=True, slots=True, eq=False)
class RecordedMotion:
    """Smoothed or simulated states of a record at some of its stamps.

    - ``t`` (s,): stamps.
    - ``X`` (s, n): states in the order of ``states_of(form)``, 0 if not measured.
    - ``nu_dot`` (s, k): accelerations, in the order of the form's degrees of freedom. ``inputs`` (s, m): values of the
      inputs.
    - ``known`` (k,): whether each velocity was measured or derived.
    """

    t: Array
    X: Array
    nu_dot: Array
    inputs: Array
    known: NDArray[np.bool_]


def smoothed_motion(form: Form, record: Segment, delay: float = 0.0) -> RecordedMotion:
    """Return the smoothed states of *record*, with its inputs delayed by *delay* [s]."""
    begin = max(float(s.t[0]) for s in record.signals.values())
    end = min(float(s.t[-1]) for s in record.signals.values())
    stamps = record.stamps
    t = stamps[(stamps >= begin) & (stamps <= end)]
    t = t if len(t) > 3 else stamps
    t = t[:: max(1, len(t) // MOST)]
    states, k = states_of(form), len(form.dofs)
    X, nu_dot, known = np.zeros((len(t), len(states))), np.zeros((len(t), k)), np.zeros(k, dtype=bool)
    fits = {name: _local(signal, t, 2 if name in "uvwpqr" else 3) for name, signal in record.signals.items()}
    psi = fits["psi"][0] if "psi" in fits else np.zeros(len(t))
    for place, dof in enumerate(DOFS[d] for d in form.dofs):
        if dof.position in fits:
            X[:, states.index(dof.position)] = fits[dof.position][0]
        if dof.velocity in fits:
            value, rate, _ = fits[dof.velocity]
        elif dof.along_ground and {"x", "y"} & set(fits):
            value, rate = _through_the_body(fits, psi, dof.name)
        elif dof.position in fits:
            _, value, rate = fits[dof.position]
        else:
            continue
        X[:, states.index(dof.velocity)], nu_dot[:, place], known[place] = value, rate, True
    row = np.maximum(np.searchsorted(record.t_in, t - delay, side="right") - 1, 0)
    inputs = np.ascontiguousarray(record.inputs[row])
    if "lag" in form.parameters:
        X[:, 2 * k :] = inputs
    return RecordedMotion(t, X, nu_dot, inputs, known)


def _through_the_body(fits: dict[str, tuple[Array, Array, Array]], psi: Array, dof: str) -> tuple[Array, Array]:
    """Return the surge or sway velocity and its rate of change, from north and east positions."""
    zero = (np.zeros_like(psi),) * 3
    _, x_1, x_2 = fits.get("x", zero)
    _, y_1, y_2 = fits.get("y", zero)
    r = fits["r"][0] if "r" in fits else fits["psi"][1] if "psi" in fits else np.zeros_like(psi)
    c, s = np.cos(psi), np.sin(psi)
    u, v = c * x_1 + s * y_1, c * y_1 - s * x_1
    if dof == "surge":
        return u, c * x_2 + s * y_2 + r * v
    return v, c * y_2 - s * x_2 - r * u


def _local(signal: Signal, t: Array, order: int) -> tuple[Array, Array, Array]:
    """Return the value and its first and second derivative at *t*.

    They come from local polynomials of degree *order*.
    """
    widths = [w for w in WIDTHS if w <= len(signal.t) and w > order + 1]
    if not widths:
        return np.interp(t, signal.t, signal.values), np.zeros_like(t), np.zeros_like(t)
    width, _ = best_width(signal.t, signal.values, widths, order)
    polynomials = local_polynomials(signal.t, signal.values, signal.t, width, order)
    value, first, second = (np.interp(t, signal.t, polynomials.derivative(k)) for k in range(3))
    return value, first, second


@dataclass(frozen=True, slots=True, eq=False)
class Regression:
    """Linear equations for the start values: the force imbalances (s, k) are ``base + J @ values``.

    - ``names`` (f,): parameters to regress.
    - ``theta`` (p,): all parameters, with known and start values, and 0 for those to regress.
    - ``usable`` (k,): equations whose velocity was measured.
    - ``driven`` (k,): usable equations with a known force.
    - ``force`` (k,): rms of the known forces in each equation; for equations without any, the largest rms.
    """

    form: Form
    names: tuple[str, ...]
    theta: Array
    base: Array
    J: Array
    usable: NDArray[np.bool_]
    driven: NDArray[np.bool_]
    force: Array

    @property
    def scales(self) -> Array:
        """Scale (f,) of each parameter: the value at which its term is as large as the known forces.

        The scale is 0 for a parameter whose term is always zero.
        """
        rms = np.sqrt(np.mean(self.J**2, axis=0)) / self.force[:, None]
        share = rms.max(axis=0)
        scales: Array = np.where(share > 1e-12, 1.0 / np.maximum(share, 1e-12), 0.0)
        return scales

    def with_values(self, values: Array) -> Array:
        """Return all parameters (p,), with the regressed ones set to *values* (f,)."""
        theta = self.theta.copy()
        theta[[self.form.parameters.index(n) for n in self.names]] = values
        return theta

    def solve(self, limits: Limits) -> Array:
        """Return start values (p,) within *limits*.

        Each driven equation is weighted by its residual.
        """
        if not self.names:
            return self.theta
        low, high = limits.of(self.names)
        weight = np.where(self.usable, 1.0 / self.force, 0.0)
        values = np.zeros(len(self.names))
        for _ in range(ROUNDS):
            A = (self.J * weight[None, :, None]).reshape(-1, len(self.names))
            values = _bounded(A, -(self.base * weight).ravel(), low, high)
            rms = np.sqrt(np.mean((self.base + self.J @ values) ** 2, axis=0))
            weight = np.where(self.driven, 1.0 / np.maximum(rms, LEAST * self.force.max()), weight)
        return self.with_values(values)


def _known_theta(form: Form) -> Array:
    """Return all parameters (p,): known values, and start values of free parameters.

    A free parameter starts at ``form.start``, :data:`SPECIAL_START` or 0.
    """
    values = {**{n: s.value for n, s in SPECIAL_START.items()}, **form.start, **form.known}
    return np.array([values.get(n, 0.0) for n in form.parameters])


def regression_of(form: Form, motions: Sequence[RecordedMotion], delay: float | None = None) -> Regression:
    """Return the regression equations of *form* for *motions*.

    Parameters with start values, delay, lag and current are not regressed.
    """
    theta = _known_theta(form)
    if delay is not None and "delay" in form.parameters:
        theta[form.parameters.index("delay")] = delay
    names = tuple(n for n in form.free if n not in SPECIAL and n not in form.start)
    balances = [balance_of(program_of(form), theta, m.X, m.nu_dot, m.inputs) for m in motions]
    base = np.vstack([b.values for b in balances])
    J = np.vstack([b.by for b in balances])[:, :, [form.parameters.index(n) for n in names]]
    usable = np.all([m.known for m in motions], axis=0)
    usable = usable if usable.any() else np.ones_like(usable)
    rms = np.sqrt(np.mean(base**2, axis=0))
    largest = float(rms.max()) or 1.0
    driven = usable & (rms > 1e-9 * largest)
    return Regression(form, names, theta, base, J, usable, driven, np.where(driven, rms, largest))


def _bounded(A: Array, b: Array, low: Array, high: Array) -> Array:
    """Return the least-squares solution within bounds.

    It solves the normal equations, with columns scaled to unit length.
    """
    scale = np.sqrt(np.maximum(np.sum(A * A, axis=0), 1e-300))
    G = (A.T @ A) / np.outer(scale, scale) + RIDGE * np.eye(len(scale))
    R = np.linalg.cholesky(G).T
    target = np.linalg.solve(R.T, A.T @ b / scale)
    if np.all(np.isneginf(low)) and np.all(np.isposinf(high)):
        solution: Array = np.linalg.solve(R, target) / scale
        return solution
    bounded: Array = lsq_linear(R, target, (low * scale, high * scale)).x / scale
    return bounded


@dataclass(frozen=True, slots=True, eq=False)
class InitialGuess:
    """Information available before any simulation: smoothed motions, regression and initial states.

    - ``rough``: scatter of each signal about its neighbours, which is the smallest noise a fit can reach.
    - ``levels``: initial noise level of each signal, as a fraction of the motion. It is larger than ``rough``, because
      the residual of an inexact model is far larger than the scatter.
    """

    form: Form
    records: tuple[Segment, ...]
    motions: tuple[RecordedMotion, ...]
    regression: Regression
    initial: tuple[Array, ...]
    rough: Mapping[str, float]
    levels: Mapping[str, float]

    def starts(self, limits: Limits) -> Iterator[Array]:
        """Yield start values (p,), the most likely first.

        First comes the regression. Second comes the regression with positive inertia and damping drag, improved on
        short pieces. Third comes an uncoupled craft of the right size, improved on short pieces.
        """
        yield self.regression.solve(limits)
        sturdy = self.sturdy(limits)
        for theta in (self.regression.solve(sturdy), self._plain(sturdy)):
            better = self.on_pieces(theta, sturdy)
            if better is not None:
                yield better[0]

    def misfit(self, limits: Limits) -> float:
        """Return the cost of the form on short pieces after a few trials, infinite if the simulation diverges.

        Costs for records of the same size can be compared.
        """
        sturdy = self.sturdy(limits)
        end = self.on_pieces(self.regression.solve(sturdy), sturdy, FEW)
        return math.inf if end is None else end[1]

    def sturdy(self, limits: Limits) -> Limits:
        """Return *limits* restricted to models that can be simulated: drag that damps, and inertia not near zero."""
        high = {}
        for name, scale in zip(self.regression.names, self.regression.scales.tolist(), strict=True):
            inertia = inertia_of(name) if name.endswith("dot") else None
            if inertia is not None and inertia.row == inertia.column and not _has_rigid_body(self.form):
                high[name] = -LIGHTEST * (scale or 1.0)
        return limits.within(Limits({}, high)).within(Limits.physical(self.form))

    def pieces(self) -> tuple[tuple[Segment, ...], tuple[Array, ...]]:
        """Return the records cut into short pieces, and the smoothed initial state (n,) of each piece."""
        pieces, initial = [], []
        for record, motion in zip(self.records, self.motions, strict=True):
            for piece in _pieces(record):
                pieces.append(piece)
                x_0 = np.array([np.interp(piece.start, motion.t, column) for column in motion.X.T])
                initial.append(_lagged(x_0, piece, self.form))
        return tuple(pieces), tuple(initial)

    def on_pieces(self, theta: Array, limits: Limits, trials: int = TRIALS) -> tuple[Array, float] | None:
        """Fit the parameters to short pieces, starting at *theta*, and return them (p,) with the cost.

        The pieces start at smoothed states. The result is None if a simulation of the pieces diverges.
        """
        pieces, initial = self.pieces()
        objective = Objective(StampedProblem(self.form, pieces, None, limits), theta, initial, fixed_states=True)
        at = partial(objective.at, noise=gaussian_noise(self.levels, robust=True))
        minimum = descend(at, objective.pack(), *objective.limits(), trials=trials, rules=Rules(ROUGH))
        return None if minimum is None else (objective.unpack(minimum.x)[0], minimum.cost)

    def _plain(self, limits: Limits) -> Array:
        """Return parameters (p,) of an uncoupled craft whose inertia and drag match the size of its forces."""
        r = self.regression
        low, high = limits.of(r.names)
        values = np.where(high <= 0.0, -0.5, np.where(low >= 0.0, 0.5, 0.0)) * r.scales
        return r.with_values(np.clip(values, low, high))


def initial_guess_of(form: Form, records: Sequence[Segment], delay: float | None = None) -> InitialGuess:
    """Return the initial guess for *form* on *records*.

    delay : start value [s] of a free delay.
    """
    known = form.known.get("delay", 0.0) if delay is None else delay
    motions = tuple(smoothed_motion(form, record, known) for record in records)
    initial = tuple(_lagged(m.X[0].copy(), r, form) for r, m in zip(records, motions, strict=True))
    regression = regression_of(form, motions, delay)
    rough = first_levels(records)
    spread = {n: max(float(np.std(r.signals[n].values)) for r in records if n in r.signals) for n in rough}
    levels = {n: max(level, SHARE * spread[n]) for n, level in rough.items()}
    return InitialGuess(form, tuple(records), motions, regression, initial, rough, levels)


def _lagged(x_0: Array, record: Segment, form: Form) -> Array:
    k = 2 * len(form.dofs)
    if len(x_0) > k:
        x_0[k:] = first_input(record)
    return x_0


def _has_rigid_body(form: Form) -> bool:
    return any(name in form.known for name in ("m", "I_x", "I_y", "I_z"))


def _pieces(record: Segment) -> list[Segment]:
    return record.pieces(max(1, min(PIECES, len(record.stamps) // SHORTEST)))
