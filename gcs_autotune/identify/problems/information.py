"""Calculate the Fisher information of runs on a fitted model, and the Cramer-Rao bounds that follow from it.

A fit of any kind is first converted to a coupled model on its runs. For white Gaussian noise of level ``sigma`` per
signal, the information is ``F = sum J'J/sigma^2``. ``J`` are the exact sensitivities of the simulated signals. The
initial states of every record are unknown too. The part of ``J`` that they can explain is projected out before
squaring. This equals the Schur complement but loses fewer digits. The information is stored as a triangular root ``R``,
``F = R'R``. In ``F`` itself, singular values of ``R`` below 1e-8 of the largest one would be lost.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative, UsageError
from gcs_autotune.identify.axis.form import SIGNS, axis_form, derivatives_of, structure_of
from gcs_autotune.identify.problems.initial_guess import RecordedMotion, initial_guess_of
from gcs_autotune.identify.problems.likelihood import Limits, Objective
from gcs_autotune.identify.problems.problem import Problem
from gcs_autotune.identify.problems.solution import solve_form
from gcs_autotune.identify.result import AxisFit, Fit, Model, is_of_one_axis
from gcs_autotune.identify.signals.preparation import prepare, prepare_form, signals_of
from gcs_autotune.identify.signals.segment import MIN_SAMPLES, Segment
from gcs_autotune.models import CoupledModel, Form, Simulator
from gcs_autotune.sname import DOFS
from gcs_autotune.trial import Trial

__all__ = ["BLIND", "FittedModel", "Information", "fitted_model_of", "information_on", "root_of"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class FittedModel:
    """A fitted model together with its runs.

    - ``theta`` (q,): all parameters, in the order of ``form.parameters``.
    - ``free``: names of the fitted parameters in the form.
    - ``names``: their names in the fit (``alpha_r`` for ``N_rdot``).
    - ``signs`` (p,): value in the fit = sign * value in the form.
    - ``initial``: fitted initial states (n,) per record.
    - ``noise``: name of the signal -> standard deviation of its noise, in SI units.
    """

    form: Form
    theta: Array
    free: tuple[str, ...]
    names: tuple[str, ...]
    signs: Array
    units: tuple[str, ...]
    records: tuple[Segment, ...]
    initial: tuple[Array, ...]
    noise: Mapping[str, float]

    @property
    def places(self) -> NDArray[np.int64]:
        """Indices (p,) of the parameters ``free`` in ``theta``."""
        return np.array([self.form.parameters.index(n) for n in self.free], dtype=np.int64)

    @property
    def values(self) -> Array:
        """Values (p,) of the fitted parameters, with the signs they have in the fit."""
        return self.signs * self.theta[self.places]

    def objective(self, free: Sequence[str] | None = None) -> Objective:
        """Return the output-error cost as a function of *free* and of the initial states.

        free : names of parameters in the form; None takes all fitted ones.
        """
        names = self.free if free is None else tuple(free)
        return Objective(Problem(self.form, self.records, None, Limits({}, {}), names), self.theta, self.initial)

    def motion(self, record: int) -> tuple[Array, Array]:
        """Return the stamps (s,) [s] and the simulated states (s, n) of the record with the index *record*.

        Raises
        ------
        NotInformative
            The model diverges.
        """
        own = self.records[record]
        stamps = own.stamps
        motion = Simulator(self.form).run(
            self.theta, self.initial[record], own.t_in, own.inputs, stamps, sensitivities=True
        )
        if motion is None:
            raise NotInformative(f"the model '{self.form.name}' diverges on run '{own.run}'")
        return stamps, motion[0]

    def recorded_motion(self, record: int) -> RecordedMotion:
        """Return the simulated motion of the record with the index *record*, with accelerations and inputs.

        Exceptions are those of :meth:`motion`.
        """
        own = self.records[record]
        t, X = self.motion(record)
        t, at = np.unique(t, return_index=True)
        k = len(self.form.dofs)
        nu_dot = np.gradient(X[at, k : 2 * k], t, axis=0) if len(t) > 1 else np.zeros((len(t), k))
        row = np.searchsorted(own.t_in, t - model_delay(self.form, self.theta), side="right") - 1
        inputs = np.ascontiguousarray(own.inputs[np.maximum(row, 0)])
        return RecordedMotion(t, np.ascontiguousarray(X[at]), nu_dot, inputs, np.ones(k, dtype=bool))


def fitted_model_of(fit: Fit[Model], trials: Trial | Sequence[Trial]) -> FittedModel:
    """Return the model of *fit* on *trials*, with the initial states fitted to *trials*.

    The noise levels are those of *fit* or, if it has none, the rms residuals of the free run.

    Raises
    ------
    UsageError
        This kind of model cannot be simulated, or none of its parameters was fitted.
    NotInformative
        The model diverges on a run, or :func:`prepare_form` raised the error.
    """
    runs = (trials,) if isinstance(trials, Trial) else tuple(trials)
    model = fit.model
    if isinstance(model, CoupledModel):
        form, theta = model.form, model.theta
        free = tuple(n for n in form.parameters if n in fit.parameters and fit.parameters[n].status == "fitted")
        names, signs = free, np.ones(len(free))
    elif is_of_one_axis(fit):
        form, theta, free, names, signs = _of_axis(fit, runs)
    else:
        raise UsageError(
            f"the information content of runs is not available for a {type(model).__name__}. Use `diagnose` to "
            "choose the next manoeuvre"
        )
    if not free:
        raise UsageError(f"no parameter of '{fit.structure}' was fitted, so there is no error bound to report")
    records = tuple(r for run in runs for r in prepare_form(run, form, _signals(fit, form, run)))
    ground = initial_guess_of(form, records, model_delay(form, theta))
    solution = solve_form(form, records, theta, ground.initial, Limits({}, {}), levels=ground.levels, free=())
    if solution is None:
        raise NotInformative(
            f"the model '{form.name}' diverges on run '{records[0].run}' because its drag is destabilising"
        )
    noise = {n: fit.noise[n] if fit.noise.get(n, 0.0) > 0.0 else level for n, level in solution.noise.items()}
    units = tuple(fit.parameters[n].unit for n in names)
    return FittedModel(form, theta, free, names, signs, units, records, solution.initial, noise)


def model_delay(form: Form, theta: Array) -> float:
    """Return the delay [s] of a model with the parameters *theta*, or 0 if *form* has no delay."""
    return float(theta[form.parameters.index("delay")]) if "delay" in form.parameters else 0.0


def _of_axis(fit: AxisFit, runs: Sequence[Trial]) -> tuple[Form, Array, tuple[str, ...], tuple[str, ...], Array]:
    model = fit.model
    dof = DOFS[model.dof]
    labels, values = tuple(fit.parameters), derivatives_of(model)
    derivatives, signs = tuple(values), (*SIGNS, -1.0)
    fitted = [fit.parameters[n].status == "fitted" for n in labels]
    delay = None if fitted[4] else model.delay
    input_name = prepare(runs[0], dof)[0].input_names[0]
    form = axis_form(dof, input_name, structure_of(fit.structure), normalised=model.input_unit == "1", delay=delay)
    theta = np.array([values[n] for n in form.parameters])
    at = [i for i, n in enumerate(derivatives) if fitted[i] and n in form.free]
    free = tuple(derivatives[i] for i in at)
    return form, theta, free, tuple(labels[i] for i in at), np.array([signs[i] for i in at])


def _signals(fit: Fit[Model], form: Form, run: Trial) -> tuple[str, ...] | None:
    """Return the signals that the fit used, or None if it does not list them."""
    there = tuple(n for n in signals_of(form) if n in fit.noise and n in run and len(run[n]) >= MIN_SAMPLES)
    return there or None


BLIND = 1e-8
"""Limit of a singular value below which a direction of the parameters is not observable. Project choice.

It applies after scaling the columns to unit length. Sensitivities are exact to about 1e-12. No singular value of a
practical run is between the two.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Information:
    """Fisher information of runs on parameters.

    - ``names``: names of the parameters.
    - ``values`` (p,): their values.
    - ``root`` (p, p): triangular root of the information, ``F = root' root``.
    """

    names: tuple[str, ...]
    values: Array
    root: Array

    @property
    def matrix(self) -> Array:
        """Fisher information matrix (p, p)."""
        F: Array = self.root.T @ self.root
        return F

    @property
    def alone(self) -> Array:
        """Standard error (p,) of each parameter if all other parameters were known, infinite without information."""
        lengths = np.linalg.norm(self.root, axis=0)
        return np.where(lengths > 0.0, 1.0 / np.where(lengths > 0.0, lengths, 1.0), math.inf)

    def modes(self) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Return the observable and unobservable directions of the parameters: ``sigma``, ``vectors`` and ``seen``.

        ``sigma`` (k,) and ``vectors`` (p, k) are singular values and vectors of the root with columns scaled to unit
        length. ``seen`` (p,) marks the parameters with information. The others have zero rows in the vectors.
        """
        seen = np.isfinite(self.alone)
        scaled = self.root[:, seen] * self.alone[seen]
        _, sigma, V = np.linalg.svd(scaled, full_matrices=True)
        sigma = np.concatenate([sigma, np.zeros(V.shape[0] - len(sigma))])
        vectors = np.zeros((len(self.names), V.shape[0]))
        vectors[seen] = V.T
        return sigma, vectors, seen

    @property
    def std(self) -> Array:
        """Cramer-Rao bound (p,) of each parameter, infinite if it contributes to an unobservable direction."""
        sigma, vectors, seen = self.modes()
        shares = vectors**2
        lost = sigma <= BLIND
        variance = (shares[:, ~lost] / sigma[~lost] ** 2).sum(axis=1)
        std = np.full(len(self.names), math.inf)
        std[seen] = np.sqrt(variance[seen]) * self.alone[seen]
        std[(shares[:, lost] > 1e-12).any(axis=1)] = math.inf
        return std

    @property
    def bounds(self) -> dict[str, float]:
        """Name of the parameter -> Cramer-Rao bound."""
        return dict(zip(self.names, self.std.tolist(), strict=True))

    @property
    def correlation(self) -> Array:
        """Correlation matrix (p, p) of an efficient estimate.

        Unobservable directions count as if their singular value were :data:`BLIND`.
        """
        sigma, vectors, seen = self.modes()
        C = (vectors / np.maximum(sigma, BLIND) ** 2) @ vectors.T + np.diag(np.where(seen, 0.0, 1.0))
        std = np.sqrt(np.diag(C))
        R: Array = C / np.outer(std, std)
        return R

    @property
    def log_determinant(self) -> float:
        """Natural logarithm of det F, or minus infinity if a direction has no information.

        The unit cancels in the difference of two values for the same model.
        """
        sign, value = np.linalg.slogdet(self.root)
        return 2.0 * float(value) if sign != 0.0 else -math.inf

    def plus(self, other: Information) -> Information:
        """Return the sum of this and the *other* information, from independent runs."""
        return replace(self, root=root_of(np.vstack([self.root, other.root])))


def root_of(rows: Array) -> Array:
    """Return the triangular root (p, p) of ``rows' rows``."""
    p = rows.shape[1]
    R = np.zeros((p, p))
    if len(rows):
        root = np.linalg.qr(rows, mode="r")
        R[: len(root)] = root
    return R


def information_on(subject: FittedModel) -> Information:
    """Return the information of the runs of *subject* on its fitted parameters.

    Raises
    ------
    NotInformative
        The model diverges.
    """
    objective = subject.objective()
    residuals = objective.residuals(objective.pack())
    if residuals is None:
        raise NotInformative(f"the model '{subject.form.name}' diverges, so no information can be computed")
    p = len(subject.free)
    _, weight = objective.known()
    rows = []
    end = objective.size - objective.dated  # the shift of stamps, which all segments share, comes last
    for i, columns in enumerate(objective.columns):
        J = np.vstack([r.jacobian / subject.noise[r.signal] for r in residuals if r.segment == i])
        own = (columns >= p) & (columns < end)
        known = np.diag(np.sqrt(weight[columns]))[own & (weight[columns] > 0.0)]
        J = np.vstack([J, known])
        rows.append(root_of(_without(J[:, ~own], J[:, own])))
    if objective.dated:
        rows.append(np.append(np.zeros(p), np.sqrt(weight[-1]))[None, :])
    root = root_of(np.vstack(rows))
    root = root_of(_without(root[:, :p], root[:, p:])) * subject.signs
    return Information(subject.names, subject.values, root)


def _without(J: Array, states: Array) -> Array:
    """Return the columns *J* (n, p) without the part that the columns *states* (n, s) can explain."""
    lengths = np.linalg.norm(J, axis=0)
    used = np.linalg.norm(states, axis=0) > 0.0
    if used.any():
        scaled = states[:, used] / np.linalg.norm(states[:, used], axis=0)
        U, sigma, _ = np.linalg.svd(scaled, full_matrices=False)
        U = U[:, sigma > 1e-10]
        J = J - U @ (U.T @ J)
        J -= U @ (U.T @ J)
    left: Array = np.where(np.linalg.norm(J, axis=0) > BLIND * lengths, J, 0.0)
    return left
