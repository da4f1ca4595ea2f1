"""The method ``step``: one model from the step responses of all runs, each reading weighted by what it is worth.

Two residuals a step, each zero when the model is right: the balance at the steady velocity,
``tau + Delta - (beta + beta_nn*|k_ss|)*k_ss``, and the lag ``(eta_0 - eps_v) - lag(model)`` (or the time to the knee).
With one step, one drag and no Delta this is Miskovic2010, table 4.1 exactly, once the response has settled. With
quadratic drag and little force it never quite has: the velocity then dies out as one over the time. So the model's own
response is read over the same seconds as the record's, and what is left of the transient stands in both.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.axis.form import Structure
from gcs_autotune.identify.case import Case
from gcs_autotune.identify.method import Method
from gcs_autotune.identify.open_loop.answer import axis_answer
from gcs_autotune.identify.open_loop.readings import Reading
from gcs_autotune.identify.open_loop.step_table import lag, row_of, time_to, unevenness_doubts
from gcs_autotune.identify.open_loop.steps import ENOUGH, StepReading, read_steps
from gcs_autotune.identify.result import AxisFit, Doubt

__all__ = ["METHOD", "StepModel", "fit_by_steps", "fit_readings"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class StepModel:
    """``theta`` = (alpha, beta, beta_quadratic, Delta), its covariance (4, 4), which of them were fitted, the misfit.

    ``chi2`` is the sum of squared residuals over their standard errors; ``spare`` the readings beyond parameters.
    ``covariance`` is raised by chi2/spare when that exceeds 1: the steps then differ by more than their noise.
    """

    structure: Structure
    theta: Array
    covariance: Array
    fitted: tuple[bool, bool, bool, bool]
    chi2: float
    spare: int

    @property
    def scatter(self) -> float:
        """Factor by which the steps differ beyond their noise, at least 1."""
        return math.sqrt(max(self.chi2 / self.spare, 1.0)) if self.spare > 0 else 1.0


def fit_readings(readings: Sequence[StepReading], structure: Structure) -> StepModel:
    """Fit one model to all readings.

    ``Delta`` is fitted when the steady readings suffice for it; with a single level it is taken as 0, as Miskovic2010
    does.

    Raises
    ------
    NotInformative
        No reading tells the inertia, or too few levels for the drags asked for.
    """
    if not any(r.has_lag or r.has_knee for r in readings):
        raise NotInformative("no step starts from a known velocity: its inertia cannot be read; record before the step")
    drags = 2 if structure == "affine" else 1
    levels = _levels(readings)
    if levels < drags:
        raise NotInformative(f"{levels} level(s) of input do not determine {drags} drag terms: step to more levels")
    fitted = (True, structure != "nonlinear", structure != "linear", levels > drags)
    theta = _steady_part(readings, fitted)
    theta[0] = _inertia(readings, theta)
    free = np.flatnonzero(fitted)
    for _ in range(3):
        whiteners = [_whitener(r, theta) for r in readings]
        scale = np.where(theta[free] != 0.0, np.abs(theta[free]), max(np.max(np.abs([r.tau for r in readings])), 1e-9))

        def residual(x: Array, at: Array = theta, units: Array = scale, w: Sequence[Array] = whiteners) -> Array:
            moved = at.copy()
            moved[free] = x * units
            errors = zip(readings, _as_read(readings, moved), w, strict=True)
            return np.concatenate([m @ _errors(r, moved, read) for r, read, m in errors])

        found = least_squares(residual, theta[free] / scale, method="trf", x_scale=1.0)
        theta = theta.copy()
        theta[free] = found.x * scale
    jacobian = np.asarray(found.jac, dtype=float)
    information = jacobian.T @ jacobian
    chi2, spare = 2.0 * float(found.cost), len(found.fun) - len(free)
    covariance = np.zeros((4, 4))
    small = np.linalg.pinv(information) * np.outer(scale, scale)
    covariance[np.ix_(free, free)] = small * (max(chi2 / spare, 1.0) if spare > 0 else 1.0)
    return StepModel(structure, theta, covariance, fitted, chi2, spare)


def _levels(readings: Sequence[StepReading]) -> int:
    """Return how many different inputs were held, to a fiftieth of their range."""
    taus = np.sort([r.tau for r in readings])
    span = max(float(np.max(np.abs(taus))), 1e-300)
    return 1 + int(np.sum(np.diff(taus) > 0.02 * span))


def _steady_part(readings: Sequence[StepReading], fitted: tuple[bool, ...]) -> Array:
    """Return (0, beta, beta_quadratic, Delta) from the steady velocities by plain least squares."""
    k = np.array([r.k_ss.value for r in readings])
    table = np.column_stack([k, np.abs(k) * k, -np.ones_like(k)])[:, list(fitted[1:])]
    theta = np.zeros(4)
    tau = np.array([r.tau for r in readings])
    theta[np.flatnonzero(fitted[1:]) + 1] = np.linalg.lstsq(table, tau, rcond=None)[0]
    return theta


def _inertia(readings: Sequence[StepReading], theta: Array) -> float:
    """Return the median inertia of the steps at these drags."""
    values = []
    for r in readings:
        unit = _dynamics(r, np.array([1.0, *theta[1:]]))
        if unit is not None and abs(unit) > 0.0 and math.isfinite(unit):
            values.append((r.lag.value if r.has_lag else r.knee.value) / unit)
    return float(np.median(values)) if values else 1.0


def _dynamics(r: StepReading, theta: Array) -> float | None:
    """Return the lag or the time to the knee that a model predicts; None when there is none to compare with."""
    drags = (float(theta[1]), float(theta[2]))
    force = r.tau + float(theta[3])
    if r.has_lag:
        return lag(float(theta[0]), drags, force, r.nu_0.value)
    return time_to(float(theta[0]), drags, force, r.nu_0.value, r.level) if r.has_knee else None


POINTS, TOP = 240, 20.0
"""Chosen: steps in which a response is integrated, and how many times its fastest it may be before it runs away."""


def _as_read(readings: Sequence[StepReading], theta: Array) -> list[tuple[float, float, float]]:
    """Return (k_ss, lag) that are read off the model's responses over the seconds they were read off the record's.

    And, third, by how much the velocity at the end of them still differs from that k_ss. NaN where a reading does not
    say which these were, or where it started from is not known.
    """
    alpha, beta, quadratic, delta = (float(value) for value in theta)
    known = [
        not r.steady_only and all(map(math.isfinite, r.window)) and r.window[1] > 0.0 and alpha != 0.0 for r in readings
    ]
    chosen = [r for r, is_known in zip(readings, known, strict=True) if is_known]
    force = np.array([r.tau + delta for r in chosen])
    step = np.array([r.window[1] for r in chosen]) / POINTS
    nu = np.array([r.nu_0.value for r in chosen])
    top = TOP * np.array([max(abs(r.nu_0.value), abs(r.k_ss.value), 1e-9) for r in chosen])

    def slope(at: Array) -> Array:
        at = np.clip(at, -top, top)
        result: Array = (force - (beta + quadratic * np.abs(at)) * at) / alpha
        return result

    velocity, position = [nu], [np.zeros(len(chosen))]
    for _ in range(POINTS):
        k_1 = slope(nu)
        k_2 = slope(nu + 0.5 * step * k_1)
        k_3 = slope(nu + 0.5 * step * k_2)
        k_4 = slope(nu + step * k_3)
        position.append(position[-1] + step * (nu + step * (k_1 + k_2 + k_3) / 6.0))
        nu = np.clip(nu + step * (k_1 + 2.0 * k_2 + 2.0 * k_3 + k_4) / 6.0, -top, top)
        velocity.append(nu)
    nus, etas = np.array(velocity), np.array(position)
    found = iter([_read_off(r, nus[:, i], etas[:, i]) for i, r in enumerate(chosen)])
    return [next(found) if is_known else (math.nan, math.nan, math.nan) for is_known in known]


def _read_off(r: StepReading, nu: Array, eta: Array) -> tuple[float, float, float]:
    """Return what :func:`_as_read` does of a response (POINTS + 1,) from zero position."""
    t = np.linspace(0.0, r.window[1], POINTS + 1)
    late = t >= min(r.window[0], float(t[-3]))
    if not r.has_lag:
        mean = float(nu[late].mean())
        return mean, math.nan, float(nu[-1]) - mean
    k, intercept = np.polyfit(t[late], eta[late], 1)
    return float(k), -float(intercept), float(nu[-1] - k)


def _errors(r: StepReading, theta: Array, read: tuple[float, float, float]) -> Array:
    """Return the residuals of a reading; *read*: the same two numbers read off the model's response."""

    def drag(nu: float) -> float:
        return float((theta[1] + theta[2] * abs(nu)) * nu)

    asked = r.tau + float(theta[3]) if math.isnan(read[0]) else drag(read[0])
    balance = asked - drag(r.k_ss.value)
    predicted = read[1] if r.has_lag and math.isfinite(read[1]) else _dynamics(r, theta)
    if predicted is None:
        return np.array([balance])
    return np.array([balance, (r.lag.value if r.has_lag else r.knee.value) - predicted])


def _whitener(r: StepReading, theta: Array) -> Array:
    """Return the matrix that makes a step's residuals uncorrelated with unit variance."""
    std, slope = r.k_ss.std, abs(theta[1] + 2.0 * theta[2] * abs(r.k_ss.value))
    least = 1e-9 * max(abs(r.tau), float(np.max(np.abs(theta[1:3]))) * abs(r.k_ss.value), 1e-12)
    force = (slope * std) ** 2 + 2.0 * (theta[2] * std**2) ** 2 + least**2
    predicted = _dynamics(r, theta)
    if predicted is None:
        return np.array([[1.0 / math.sqrt(force)]])
    reading = r.lag if r.has_lag else r.knee
    variance = reading.std**2 + (_sensitivity(r, theta) * r.nu_0.std) ** 2 + (1e-9 * abs(predicted)) ** 2
    sign = math.copysign(1.0, theta[1] + theta[2])
    shared = -sign * slope * r.shared if r.has_lag else 0.0
    covariance = np.array([[force, shared], [shared, variance]])
    result: Array = np.linalg.inv(np.linalg.cholesky(covariance))
    return result


def _sensitivity(r: StepReading, theta: Array) -> float:
    """Return how the predicted lag changes with the velocity at the step."""
    h = max(abs(r.k_ss.value) * 1e-4, 1e-9)
    drags, force = (float(theta[1]), float(theta[2])), r.tau + float(theta[3])
    if r.has_lag:
        low, high = (lag(float(theta[0]), drags, force, r.nu_0.value + d) for d in (-h, h))
    else:
        low, high = (time_to(float(theta[0]), drags, force, r.nu_0.value + d, r.level) for d in (-h, h))
    return (high - low) / (2.0 * h)


MOVES = 3.0
"""Chosen: standard errors from which on a velocity is not zero."""

CLOSE = 2.0
"""Difference of the criterion below which two structures count as undecided."""


def fit_by_steps(case: Case) -> AxisFit:
    """Identify one degree of freedom from steps of its input.

    ``extra["steps"]`` lists the readings, ``extra["table_4_1"]`` each step from rest by itself.

    Raises
    ------
    NotInformative
        No step long enough to be read.
    """
    everything = read_steps(case.records)
    readings = [r for r in everything if r.settled]
    if not any(r.has_lag or r.has_knee for r in readings):
        raise NotInformative(
            f"run '{case.names[0]}' holds no step that can be read: the input must stand still before it, and after it "
            "for five time constants or more until the velocity has settled; method='output-error' takes any input"
        )
    models = _candidates(readings, case.structure)
    if not models:
        raise NotInformative(
            f"the steps of run '{case.names[0]}' do not determine structure '{case.structure}': step to more levels"
        )
    model, undecided = _choose(models)
    steady = _from_rest_or_steady(readings, model)
    if steady != readings:
        again = _candidates(steady, case.structure)
        if again:
            readings, (model, undecided) = steady, _choose(again)
    rows = [row for row in map(row_of, readings) if row is not None]
    doubts = [*_doubts(everything, len(readings), model), *unevenness_doubts(rows, model.structure)]
    if undecided and case.structure is None:
        doubts.append(_undecided())
    extra = {
        "steps": [_plain(r) for r in everything],
        "table_4_1": [asdict(row) for row in rows],
        "scatter_beyond_noise": model.scatter,
    }
    return axis_answer(case, "step", model.structure, model.theta, model.covariance, model.fitted, doubts, extra)


def _candidates(readings: Sequence[StepReading], structure: Structure | None) -> list[StepModel]:
    wanted: tuple[Structure, ...] = ("linear", "nonlinear", "affine") if structure is None else (structure,)
    found = []
    for name in wanted:
        try:
            model = fit_readings(readings, name)
        except NotInformative:
            continue
        if structure is not None or name == "linear" or model.spare > 0:
            found.append(model)
    return found


def _choose(models: Sequence[StepModel]) -> tuple[StepModel, bool]:
    """Return the structure of least BIC, the noise raised to what the richest one leaves, and whether it was close."""
    models = [m for m in models if _damps(m)] or models
    if len(models) == 1:
        return models[0], models[0].spare <= 0
    unit = max(1.0, min(m.chi2 / max(m.spare, 1) for m in models))
    n = max(m.spare + sum(m.fitted) for m in models)
    scored = sorted(models, key=lambda m: m.chi2 / unit + sum(m.fitted) * math.log(n))
    gap = (scored[1].chi2 - scored[0].chi2) / unit + (sum(scored[1].fitted) - sum(scored[0].fitted)) * math.log(n)
    if gap >= CLOSE:
        return scored[0], False
    if "affine" in (scored[0].structure, scored[1].structure):
        return min(scored[:2], key=lambda m: sum(m.fitted)), False
    return min(scored[:2], key=lambda m: m.structure), True


def _damps(model: StepModel) -> bool:
    """Whether both drags have the sign of the inertia."""
    return bool(np.all(model.theta[1:3] * model.theta[0] >= 0.0))


def _from_rest_or_steady(readings: Sequence[StepReading], model: StepModel) -> list[StepReading]:
    """Return *readings* without holds too short by the *model*, and where they start from only where that is known.

    A step continues in a straight line what was before it; where that still bends, it starts elsewhere.
    """
    found: list[StepReading] = []
    bends, off, nan = False, 0.0, Reading(math.nan, math.nan)
    for r, read in zip(readings, _as_read(readings, model.theta), strict=True):
        bent = bends or abs(off) > r.nu_0.std
        short = _still_moving(r, model)
        if not short:
            found.append(replace(r, lag=nan, knee=nan, steady_only=True) if bent and not r.steady_only else r)
        bends, off = short, read[2] if math.isfinite(read[2]) else 0.0
    return found


def _still_moving(r: StepReading, model: StepModel) -> bool:
    """Whether a hold that the record begins in was too short, by the *model*, for what moved then to have settled."""
    if not r.steady_only or abs(r.k_ss.value) < MOVES * r.k_ss.std:
        return False
    alpha, beta, quadratic, _ = model.theta
    slope = beta + 2.0 * quadratic * abs(r.k_ss.value)
    return not r.window[1] * slope / alpha >= ENOUGH if alpha != 0.0 else False


def _doubts(everything: Sequence[StepReading], used: int, model: StepModel) -> list[Doubt]:
    found = []
    short = len(everything) - used
    if short:
        found.append(
            Doubt(
                "not-settled",
                f"{short} of {len(everything)} step(s) had not settled when the input changed: left out",
                "hold each step for at least five time constants",
            )
        )
    if not model.fitted[3]:
        found.append(
            Doubt(
                "no-disturbance",
                "one level of input does not separate drag from a constant force; none was assumed",
                "step to both sides",
            )
        )
    if model.spare > 0 and model.scatter > 2.0:
        found.append(
            Doubt(
                "steps-disagree",
                f"the steps differ {model.scatter:.1f} times more than their noise; standard errors were raised for it",
                "try the other structure; did load, battery or current change between the steps?",
            )
        )
    return found


def _undecided() -> Doubt:
    return Doubt(
        "structure-undecided",
        "these steps do not distinguish linear from quadratic damping; the simpler was chosen",
        "step to clearly different levels",
    )


def _plain(r: StepReading) -> dict[str, float | str | bool]:
    return {
        "run": r.run,
        "t": r.t,
        "tau": r.tau,
        "k_ss": r.k_ss.value,
        "k_ss_std": r.k_ss.std,
        "lag": r.lag.value,
        "lag_std": r.lag.std,
        "knee": r.knee.value,
        "knee_std": r.knee.std,
        "nu_0": r.nu_0.value,
        "settled": r.settled,
    }


METHOD = Method("step", "settled responses to steps of the input (Miskovic2010, table 4.1)", axis=fit_by_steps)
