"""The method ``step``: one model from the step responses of all runs, with readings weighted by their accuracy.

Each step has two residuals that are zero for the right model. One is the balance at the steady velocity, ``tau + Delta
- (beta + beta_nn*|k_ss|)*k_ss``. The other is the lag ``(eta_0 - eps_v) - lag(model)``, or the time to the knee. For
  one step, one drag and no Delta the result equals Miskovic2010, table 4.1, if the response has settled.

With quadratic drag and little force the response never settles completely, because the velocity decays as one over the
time. The model's response is therefore evaluated over the same interval as the record, so that both contain the same
transient.
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
from gcs_autotune.identify.doubt import Doubt
from gcs_autotune.identify.method import Method
from gcs_autotune.identify.open_loop.answer import axis_answer
from gcs_autotune.identify.open_loop.readings import Reading
from gcs_autotune.identify.open_loop.step_table import lag, row_of, time_to, unevenness_doubts
from gcs_autotune.identify.open_loop.steps import ENOUGH, StepReading, read_steps
from gcs_autotune.identify.result import AxisFit
from gcs_autotune.rounding import counted

__all__ = ["METHOD", "StepModel", "fit_by_steps", "fit_readings"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class StepModel:
    """Model fitted to the readings of all steps.

    - ``theta`` (4,): alpha, beta, beta_quadratic and Delta.
    - ``fitted`` (4,): whether each element of ``theta`` was fitted.
    - ``covariance`` (4, 4): covariance of ``theta``. It is multiplied by chi2/spare if this exceeds 1, because the
      steps then differ by more than their noise.
    - ``chi2``: sum of the squares of the residuals, each divided by its standard error.
    - ``spare``: number of readings minus number of parameters.
    """

    structure: Structure
    theta: Array
    covariance: Array
    fitted: tuple[bool, bool, bool, bool]
    chi2: float
    spare: int

    @property
    def scatter(self) -> float:
        """Ratio of the differences between steps to the noise of the readings, at least 1."""
        return math.sqrt(max(self.chi2 / self.spare, 1.0)) if self.spare > 0 else 1.0


def fit_readings(readings: Sequence[StepReading], structure: Structure) -> StepModel:
    """Return one model with the drag *structure*, fitted to all *readings*.

    ``Delta`` is fitted if the steps end at enough different inputs. With a single input value, ``Delta`` is 0 as in
    Miskovic2010.

    Raises
    ------
    NotInformative
        No reading determines the inertia, or there are too few input values for the drags of *structure*.
    """
    if not any(r.has_lag or r.has_knee for r in readings):
        raise NotInformative(
            "no step starts from a known velocity, so the inertia cannot be measured. Start recording before the step"
        )
    drags = 2 if structure == "affine" else 1
    levels = _levels(readings)
    if levels < drags:
        raise NotInformative(
            f"the steps have {counted(levels, 'level')} of input, which cannot determine "
            f"{counted(drags, 'drag term')}. Step to more levels"
        )
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

        optimum = least_squares(residual, theta[free] / scale, method="trf", x_scale=1.0)
        theta = theta.copy()
        theta[free] = optimum.x * scale
    jacobian = np.asarray(optimum.jac, dtype=float)
    information = jacobian.T @ jacobian
    chi2, spare = 2.0 * float(optimum.cost), len(optimum.fun) - len(free)
    covariance = np.zeros((4, 4))
    small = np.linalg.pinv(information) * np.outer(scale, scale)
    covariance[np.ix_(free, free)] = small * (max(chi2 / spare, 1.0) if spare > 0 else 1.0)
    return StepModel(structure, theta, covariance, fitted, chi2, spare)


def _levels(readings: Sequence[StepReading]) -> int:
    """Return the number of different input levels.

    Levels closer than a fiftieth of the largest input count as one.
    """
    taus = np.sort([r.tau for r in readings])
    span = max(float(np.max(np.abs(taus))), 1e-300)
    return 1 + int(np.sum(np.diff(taus) > 0.02 * span))


def _steady_part(readings: Sequence[StepReading], fitted: tuple[bool, ...]) -> Array:
    """Return (0, beta, beta_quadratic, Delta), from plain least squares on the steady velocities."""
    k = np.array([r.k_ss.value for r in readings])
    table = np.column_stack([k, np.abs(k) * k, -np.ones_like(k)])[:, list(fitted[1:])]
    theta = np.zeros(4)
    tau = np.array([r.tau for r in readings])
    theta[np.flatnonzero(fitted[1:]) + 1] = np.linalg.lstsq(table, tau, rcond=None)[0]
    return theta


def _inertia(readings: Sequence[StepReading], theta: Array) -> float:
    """Return the median inertia of the steps for the drags in *theta*."""
    values = []
    for r in readings:
        unit = _dynamics(r, np.array([1.0, *theta[1:]]))
        if unit is not None and abs(unit) > 0.0 and math.isfinite(unit):
            values.append((r.lag.value if r.has_lag else r.knee.value) / unit)
    return float(np.median(values)) if values else 1.0


def _dynamics(r: StepReading, theta: Array) -> float | None:
    """Return the lag, or the time to the knee, that a model predicts; None if the reading has neither."""
    inertia, linear, quadratic, constant = theta.tolist()
    drags, force = (linear, quadratic), r.tau + constant
    if r.has_lag:
        return lag(inertia, drags, force, r.nu_0.value)
    return time_to(inertia, drags, force, r.nu_0.value, r.level) if r.has_knee else None


POINTS, TOP = 240, 20.0
"""Settings for the integration of a response. Project choice.

- ``POINTS``: number of steps.
- ``TOP``: limit of the velocity, as a multiple of the largest one in the reading.
"""


def _as_read(readings: Sequence[StepReading], theta: Array) -> list[tuple[float, float, float]]:
    """Return (k_ss, lag) of the model's responses, read over the same seconds as the record's.

    The third value is the difference between the velocity at the end and that k_ss. All are NaN if the window of a
    reading, or its initial velocity, is unknown.
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
    responses = iter([_read_off(r, nus[:, i], etas[:, i]) for i, r in enumerate(chosen)])
    return [next(responses) if is_known else (math.nan, math.nan, math.nan) for is_known in known]


def _read_off(r: StepReading, nu: Array, eta: Array) -> tuple[float, float, float]:
    """Return (k_ss, lag, difference at the end) of one simulated response, as :func:`_as_read` does.

    nu, eta : (POINTS + 1,) velocity, and position from zero.
    """
    t = np.linspace(0.0, r.window[1], POINTS + 1)
    late = t >= min(r.window[0], float(t[-3]))
    if not r.has_lag:
        mean = float(nu[late].mean())
        return mean, math.nan, float(nu[-1]) - mean
    k, intercept = np.polyfit(t[late], eta[late], 1)
    return float(k), -float(intercept), float(nu[-1] - k)


def _errors(r: StepReading, theta: Array, read: tuple[float, float, float]) -> Array:
    """Return the residuals of a reading.

    read : the same values read off the model's response.
    """

    _, linear, quadratic, constant = theta.tolist()

    def drag(nu: float) -> float:
        return float((linear + quadratic * abs(nu)) * nu)

    driving = r.tau + constant if math.isnan(read[0]) else drag(read[0])
    balance = driving - drag(r.k_ss.value)
    predicted = read[1] if r.has_lag and math.isfinite(read[1]) else _dynamics(r, theta)
    if predicted is None:
        return np.array([balance])
    return np.array([balance, (r.lag.value if r.has_lag else r.knee.value) - predicted])


def _whitener(r: StepReading, theta: Array) -> Array:
    """Return the matrix that makes the residuals of a step uncorrelated, with unit variance."""
    _, linear, quadratic, _ = theta.tolist()
    std, slope = r.k_ss.std, abs(linear + 2.0 * quadratic * abs(r.k_ss.value))
    least = 1e-9 * max(abs(r.tau), max(abs(linear), abs(quadratic)) * abs(r.k_ss.value), 1e-12)
    force = (slope * std) ** 2 + 2.0 * (quadratic * std**2) ** 2 + least**2
    predicted = _dynamics(r, theta)
    if predicted is None:
        return np.array([[1.0 / math.sqrt(force)]])
    reading = r.lag if r.has_lag else r.knee
    variance = reading.std**2 + (_sensitivity(r, theta) * r.nu_0.std) ** 2 + (1e-9 * abs(predicted)) ** 2
    sign = math.copysign(1.0, linear + quadratic)
    shared = -sign * slope * r.shared if r.has_lag else 0.0
    covariance = np.array([[force, shared], [shared, variance]])
    result: Array = np.linalg.inv(np.linalg.cholesky(covariance))
    return result


def _sensitivity(r: StepReading, theta: Array) -> float:
    """Return the derivative of the predicted lag, or time to the knee, by the velocity at the step."""
    h = max(abs(r.k_ss.value) * 1e-4, 1e-9)
    inertia, linear, quadratic, constant = theta.tolist()
    drags, force = (linear, quadratic), r.tau + constant
    if r.has_lag:
        low, high = (lag(inertia, drags, force, r.nu_0.value + d) for d in (-h, h))
    else:
        low, high = (time_to(inertia, drags, force, r.nu_0.value + d, r.level) for d in (-h, h))
    return (high - low) / (2.0 * h)


MOVES = 3.0
"""Number of standard errors by which a velocity must differ from zero to count as motion. Project choice."""

CLOSE = 2.0
"""Difference of the Bayesian information criterion below which the choice between two structures counts as undecided.

Source: Kass1995.
"""


def fit_by_steps(case: Case) -> AxisFit:
    """Return the fit of one degree of freedom from steps of its input.

    ``extra["steps"]`` contains the readings. ``extra["table_4_1"]`` contains the result of each single step from rest.

    Raises
    ------
    NotInformative
        No step is long enough to be evaluated, or the steps do not determine the requested structure.
    """
    everything = read_steps(case.records)
    readings = [r for r in everything if r.settled]
    if not any(r.has_lag or r.has_knee for r in readings):
        raise NotInformative(
            f"run '{case.names[0]}' contains no usable step. The input must be constant before the step. After it, "
            "the input must stay constant for at least five time constants, until the velocity has settled. For "
            "other inputs use method='output-error'"
        )
    models = _candidates(readings, case.structure)
    if not models:
        raise NotInformative(
            f"the steps of run '{case.names[0]}' do not determine structure '{case.structure}'. Step to more levels"
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
    models = []
    for name in wanted:
        try:
            model = fit_readings(readings, name)
        except NotInformative:
            continue
        if structure is not None or name == "linear" or model.spare > 0:
            models.append(model)
    return models


def _choose(models: Sequence[StepModel]) -> tuple[StepModel, bool]:
    """Return the structure with the lowest BIC, and whether the choice was close.

    The noise is raised to the smallest misfit per spare reading of all structures.
    """
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
    """Return whether both drags have the same sign as the inertia."""
    return bool(np.all(model.theta[1:3] * model.theta[0] >= 0.0))


def _from_rest_or_steady(readings: Sequence[StepReading], model: StepModel) -> list[StepReading]:
    """Return *readings* without those of holds that are too short according to *model*.

    A reading keeps its start value only if the velocity at the step is known. It is taken from a straight line through
    the motion before. If that motion was still curved, the start value is dropped.
    """
    kept: list[StepReading] = []
    bends, off, nan = False, 0.0, Reading(math.nan, math.nan)
    for r, read in zip(readings, _as_read(readings, model.theta), strict=True):
        bent = bends or abs(off) > r.nu_0.std
        short = _still_moving(r, model)
        if not short:
            kept.append(replace(r, lag=nan, knee=nan, steady_only=True) if bent and not r.steady_only else r)
        bends, off = short, read[2] if math.isfinite(read[2]) else 0.0
    return kept


def _still_moving(r: StepReading, model: StepModel) -> bool:
    """Return whether the first hold of a record was too short, according to *model*, for earlier motion to settle."""
    if not r.steady_only or abs(r.k_ss.value) < MOVES * r.k_ss.std:
        return False
    alpha, beta, quadratic, _ = model.theta
    slope = beta + 2.0 * quadratic * abs(r.k_ss.value)
    return not r.window[1] * slope / alpha >= ENOUGH if alpha != 0.0 else False


def _doubts(everything: Sequence[StepReading], used: int, model: StepModel) -> list[Doubt]:
    doubts = []
    short = len(everything) - used
    if short:
        doubts.append(
            Doubt(
                "not-settled",
                f"left out: {short} of {counted(len(everything), 'step')}, not settled when the input changed",
                "hold each step for at least five time constants",
            )
        )
    if not model.fitted[3]:
        doubts.append(
            Doubt(
                "no-disturbance",
                "one input level cannot separate drag from a constant force. No constant force was assumed",
                "fly steps in both directions",
            )
        )
    if model.spare > 0 and model.scatter > 2.0:
        doubts.append(
            Doubt(
                "steps-disagree",
                f"the steps differ {model.scatter:.1f} times more than their noise explains. The standard errors "
                "were increased",
                "try the other structure. Check whether load, battery or current changed between the steps",
            )
        )
    return doubts


def _undecided() -> Doubt:
    return Doubt(
        "structure-undecided",
        "these steps cannot distinguish linear from quadratic damping. The simpler model was used",
        "fly steps to clearly different levels",
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


METHOD = Method("step", "settled responses to input steps (Miskovic2010, table 4.1)", axis=fit_by_steps)
