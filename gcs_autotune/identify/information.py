"""Fisher information of a fitted model on runs, initial states marginalised, and the Cramer-Rao bound it sets.

A fit of any kind is first seen as a coupled model on its runs. White Gaussian noise of level ``sigma`` per signal:
``F = sum J'J/sigma^2`` with ``J`` the exact sensitivities of the simulated signals. Every record's initial states are
unknown too; what they can explain is projected out of ``J`` before squaring, which is the Schur complement without its
loss of digits. The information is kept as a triangular root ``R``, ``F = R'R``: what is hidden in 1e-8 of the largest
singular value of ``R`` would be lost in ``F``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import DataError, NotInformative, UsageError
from gcs_autotune.identify.axis.form import PHYSICAL, SIGNS, axis_form, derivative_names, structure_of
from gcs_autotune.identify.axis.uncertainty import cramer_rao
from gcs_autotune.identify.initial_guess import initial_guess_of
from gcs_autotune.identify.likelihood import Limits, Objective
from gcs_autotune.identify.preparation import prepare, prepare_form, signals_of
from gcs_autotune.identify.problem import Problem
from gcs_autotune.identify.result import AxisFit, Fit, Model, is_of_one_axis
from gcs_autotune.identify.segment import MIN_SAMPLES, Segment
from gcs_autotune.identify.solution import solve_form
from gcs_autotune.models import CoupledModel, Form, Simulator
from gcs_autotune.sname import DOFS
from gcs_autotune.trial import Trial

__all__ = ["BLIND", "FittedModel", "Information", "fitted_model_of", "information_on", "root_of", "with_bounds"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class FittedModel:
    """A model on runs.

    ``theta`` (q,) in the order of ``form.parameters``; ``free`` the form's names of what was fitted, ``names`` what the
    fit calls them (``alpha_r`` for ``N_rdot``), ``signs`` (p,) with ``named value = sign * form's value``; ``initial``
    (n,) fitted states per record; ``noise`` standard deviation per signal, SI units.
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
        """Where ``free`` stands in ``theta`` (p,)."""
        return np.array([self.form.parameters.index(n) for n in self.free], dtype=np.int64)

    @property
    def values(self) -> Array:
        """Values (p,) under the fit's names."""
        return self.signs * self.theta[self.places]

    def objective(self, free: Sequence[str] | None = None) -> Objective:
        """Return the output-error cost of *free* (form's names; all fitted ones when None) and the initial states."""
        names = self.free if free is None else tuple(free)
        return Objective(Problem(self.form, self.records, None, Limits({}, {}), names), self.theta, self.initial)

    def motion(self, record: int) -> tuple[Array, Array]:
        """Return stamps (s,) and simulated states (s, n) of one record.

        Raises
        ------
        NotInformative
            The model runs away.
        """
        own = self.records[record]
        stamps = own.stamps
        found = Simulator(self.form).run(
            self.theta, self.initial[record], own.t_in, own.inputs, stamps, sensitivities=True
        )
        if found is None:
            raise NotInformative(f"the model '{self.form.name}' runs away on run '{own.run}'")
        return stamps, found[0]


def fitted_model_of(fit: Fit[Model], trials: Trial | Sequence[Trial]) -> FittedModel:
    """Return *fit* on *trials*, its initial states fitted to them.

    Noise is what the fit found, and where it says nothing the rms of what the free run leaves.

    Raises
    ------
    UsageError
        The fit's model is of a kind that cannot be simulated, or nothing in it was fitted.
    NotInformative
        The model runs away on a run; and as :func:`prepare_form`.
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
            f"the information in runs about a {type(model).__name__} is not computed here; use diagnose for the next "
            "manoeuvre"
        )
    if not free:
        raise UsageError(f"nothing of '{fit.structure}' was fitted: there is no limit to report")
    records = tuple(r for run in runs for r in prepare_form(run, form, _signals(fit, form, run)))
    ground = initial_guess_of(form, records, model_delay(form, theta))
    found = solve_form(form, records, theta, ground.initial, Limits({}, {}), levels=ground.levels, free=())
    if found is None:
        raise NotInformative(f"the model '{form.name}' runs away on run '{records[0].run}': its drag destabilises it")
    noise = {n: fit.noise[n] if fit.noise.get(n, 0.0) > 0.0 else level for n, level in found.noise.items()}
    units = tuple(fit.parameters[n].unit for n in names)
    return FittedModel(form, theta, free, names, signs, units, records, found.initial, noise)


def model_delay(form: Form, theta: Array) -> float:
    """Return the delay [s] of a model, 0 when it has none."""
    return float(theta[form.parameters.index("delay")]) if "delay" in form.parameters else 0.0


def _of_axis(fit: AxisFit, runs: Sequence[Trial]) -> tuple[Form, Array, tuple[str, ...], tuple[str, ...], Array]:
    model = fit.model
    dof = DOFS[model.dof]
    labels, derivatives = tuple(fit.parameters), derivative_names(dof)
    fitted = [fit.parameters[n].status == "fitted" for n in labels]
    delay = None if fitted[4] else model.delay
    input_name = prepare(runs[0], dof)[0].input_names[0]
    form = axis_form(dof, input_name, structure_of(fit.structure), normalised=model.input_unit == "1", delay=delay)
    numbers = (model.alpha, model.beta, model.beta_quadratic, model.delta, model.delay)
    values = {n: s * v for n, s, v in zip(derivatives, SIGNS, numbers, strict=True)}
    theta = np.array([values[n] for n in form.parameters])
    at = [i for i, n in enumerate(derivatives) if fitted[i] and n in form.free]
    free = tuple(derivatives[i] for i in at)
    return form, theta, free, tuple(labels[i] for i in at), np.array([SIGNS[i] for i in at])


def _signals(fit: Fit[Model], form: Form, run: Trial) -> tuple[str, ...] | None:
    """Return the signals the fit was made from, None when it does not say."""
    there = tuple(n for n in signals_of(form) if n in fit.noise and n in run and len(run[n]) >= MIN_SAMPLES)
    return there or None


ModelT = TypeVar("ModelT", bound=Model)

BLIND = 1e-8
"""Singular value, relative to columns of length one, below which a direction is not seen at all. Chosen: sensitivities
are exact to some 1e-12, and no practical run lies between."""


@dataclass(frozen=True, slots=True, eq=False)
class Information:
    """What runs tell of the parameters ``names`` (p,) at ``values`` (p,): ``F = root' root``, root (p, p)."""

    names: tuple[str, ...]
    values: Array
    root: Array

    @property
    def matrix(self) -> Array:
        """Fisher information (p, p)."""
        F: Array = self.root.T @ self.root
        return F

    @property
    def alone(self) -> Array:
        """Standard errors (p,) if every other parameter were known; infinite where nothing is told."""
        lengths = np.linalg.norm(self.root, axis=0)
        return np.where(lengths > 0.0, 1.0 / np.where(lengths > 0.0, lengths, 1.0), math.inf)

    def modes(self) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Return singular values (k,) and vectors (p, k) of the root with columns of length one, and which are seen.

        Parameters nothing is told of are left out of the vectors (zero rows); ``seen`` (p,) marks the others.
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
        """Cramer-Rao bounds (p,): infinite for what takes part in a direction the runs do not see."""
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
        """Cramer-Rao bound per name."""
        return dict(zip(self.names, self.std.tolist(), strict=True))

    @property
    def correlation(self) -> Array:
        """Correlation (p, p) of an efficient estimate; directions the runs do not see count as seen at ``BLIND``."""
        sigma, vectors, seen = self.modes()
        C = (vectors / np.maximum(sigma, BLIND) ** 2) @ vectors.T + np.diag(np.where(seen, 0.0, 1.0))
        std = np.sqrt(np.diag(C))
        R: Array = C / np.outer(std, std)
        return R

    @property
    def log_determinant(self) -> float:
        """Natural logarithm of det F with parameters in units of their values; minus infinity when something is unseen.

        Units cancel in differences between informations on the same model.
        """
        sign, value = np.linalg.slogdet(self.root)
        return 2.0 * float(value) if sign != 0.0 else -math.inf

    def plus(self, other: Information) -> Information:
        """Return the information of both, from independent runs."""
        return replace(self, root=root_of(np.vstack([self.root, other.root])))


def root_of(rows: Array) -> Array:
    """Return the triangular root (p, p) of ``rows' rows``."""
    p = rows.shape[1]
    R = np.zeros((p, p))
    if len(rows):
        found = np.linalg.qr(rows, mode="r")
        R[: len(found)] = found
    return R


def information_on(subject: FittedModel) -> Information:
    """Return what the subject's runs tell of its fitted parameters.

    Raises
    ------
    NotInformative
        The model runs away.
    """
    objective = subject.objective()
    found = objective.residuals(objective.pack())
    if found is None:
        raise NotInformative(f"the model '{subject.form.name}' runs away: no information can be computed")
    p = len(subject.free)
    _, weight = objective.known()
    rows = []
    end = objective.size - objective.dated  # the shift of stamps, which all segments share, comes last
    for i, columns in enumerate(objective.columns):
        J = np.vstack([r.jacobian / subject.noise[r.signal] for r in found if r.segment == i])
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
    """Return the columns *J* (n, p) less all that the columns *states* (n, s) can explain."""
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


def with_bounds(fit: Fit[ModelT], trials: Trial | Sequence[Trial]) -> Fit[ModelT]:
    """Return *fit* with the Cramer-Rao bound of every fitted parameter, whatever method made it.

    One degree of freedom from its own likelihood, rounding sensors and inexact stamps included; several from
    :func:`information_on`. A parameter the runs cannot tell has an infinite bound. A fit that knows its bounds, or
    whose model cannot be simulated on the runs, stays as it is.
    """
    if all(math.isfinite(p.bound) for p in fit.parameters.values() if p.status == "fitted"):
        return fit
    try:
        if is_of_one_axis(fit):
            bounds = _axis_bounds(fit, trials)
        else:
            bounds = information_on(fitted_model_of(fit, trials)).bounds
    except (DataError, UsageError):
        return fit
    parameters = {n: replace(p, bound=bounds.get(n, p.bound)) for n, p in fit.parameters.items()}
    return replace(fit, parameters=parameters)


def _axis_bounds(fit: AxisFit, trials: Trial | Sequence[Trial]) -> dict[str, float]:
    model = fit.model
    names = dict(zip(PHYSICAL, fit.parameters, strict=True))
    free = [n for n, label in names.items() if fit.parameters[label].status == "fitted"]
    given: Mapping[str, float] = fit.extra.get("sigma") or fit.noise
    noise = {n: float(s) for n, s in given.items() if n in (model.axis.position, model.axis.velocity) and s > 0.0}
    quantum = {n: float(q) for n, q in (fit.extra.get("quantum") or {}).items() if n in noise}
    found = cramer_rao(model, trials, noise or fit.noise_std, free, quantum)
    return {names[n]: bound for n, bound in found.items()}
