"""Use methods for forms on one degree of freedom, with the result in physical parameters.

``alpha nu_dot + (beta + beta_nn |nu|) nu = tau + Delta`` is a form. For yaw its derivatives are ``N_rdot = -alpha``,
``N_r = -beta``, ``N_rr = -beta_nn`` and ``N_0 = Delta``. The other degrees of freedom have corresponding ones.
Estimates and covariances of the two descriptions differ only by signs.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects import ExtendedModel
from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.axis.form import FREE, SIGNS, Structure
from gcs_autotune.identify.case import Case
from gcs_autotune.identify.doubt import Doubt, once
from gcs_autotune.identify.doubts import OF_THE_RUNS
from gcs_autotune.identify.fit_builder import AxisDetails, Motion, Table, axis_table, fit_of
from gcs_autotune.identify.free_run import rms_of
from gcs_autotune.identify.result import AxisFit, Fit, Model, Status, StructureFit
from gcs_autotune.models import SingleDof
from gcs_autotune.sname import Dof

__all__ = ["axis_fit", "for_axis", "with_actuator"]

Array = NDArray[np.float64]


def axis_fit(case: Case, structure: Structure, fit: Fit[Model]) -> AxisFit:
    """Return *fit*, whose form has one degree of freedom, as an ``AxisFit`` with physical parameters."""
    record = case.records[0]
    model, table = _in_words(record.dof, record.input_units[0], structure, fit)
    main = record.main.name
    motion = Motion(fit.traces, fit.fit_percent, _rms(fit, main), fit.noise)
    return fit_of(
        case,
        fit.method,
        model,
        table,
        motion,
        structure=structure,
        doubts=_in_own_names(record.dof, table, fit.doubts),
        extra=fit.extra,
        axis=AxisDetails(main),
    )


def _rms(fit: Fit[Model], signal: str) -> float:
    """Return the root mean square residual of *signal*, or of all signals if it was not fitted."""
    return rms_of([t for t in fit.traces if t.signal == signal] or list(fit.traces))


def _log_likelihood(fit: AxisFit) -> float:
    """Return the log-likelihood of the free run in all signals, without constants.

    Angle and rate both show the drag.
    """
    if not fit.traces:
        return -math.log(max(fit.residual_rms, 1e-300))
    log_likelihood = 0.0
    for signal in {t.signal for t in fit.traces}:
        own = [t for t in fit.traces if t.signal == signal]
        log_likelihood -= sum(len(t.t) for t in own) * math.log(max(rms_of(own), 1e-300))
    return log_likelihood


def with_actuator(fit: Fit[Model], plain: AxisFit) -> AxisFit:
    """Return *fit*, a model of one axis with actuator effects, as an ``AxisFit``.

    plain : fit of the same runs without these effects. The result keeps its readings of limit cycles and its doubts
        about the runs. It omits the doubts about the model of *plain* and its choice of drag, which do not apply to
        *fit*.
    """
    assert isinstance(fit.model, ExtendedModel)
    axis, main = plain.model.axis, plain.traces[0].signal if plain.traces else plain.model.axis.position
    model, table = _in_words(axis, plain.model.input_unit, "affine", fit)
    effects = tuple(e for e in fit.model.effects if e.place == axis.force)
    labels = [n for n in fit.parameters if n.startswith(tuple(f"{e.slug}@{e.place}." for e in effects))]
    order = list(fit.parameters)
    plainly, own_signs = _derivatives(axis)
    names, signs = [*plainly, *labels], np.array([*own_signs, *(1.0 for _ in labels)])
    places = [i for i, n in enumerate(names) if n in order]
    at = [order.index(names[i]) for i in places]
    whole = np.zeros((len(names),) * 2)
    whole[np.ix_(places, places)] = np.outer(signs[places], signs[places]) * fit.covariance[np.ix_(at, at)]
    whole[: len(plainly), : len(plainly)] = table.covariance
    table = Table({**table.parameters, **{n: fit.parameters[n] for n in labels}}, whole)
    own = tuple(t for t in fit.traces if t.signal == main)
    rms = _rms(fit, main)
    return replace(
        plain,
        structure="affine",
        method=fit.method,
        model=model,
        parameters=table.parameters,
        covariance=table.covariance,
        noise=fit.noise,
        noise_std=fit.noise.get(main, rms),
        residual_rms=rms,
        fit_percent=fit.fit_percent,
        used=fit.used,
        doubts=once([*(d for d in plain.doubts if d.slug in OF_THE_RUNS), *_in_own_names(axis, table, fit.doubts)]),
        traces=own or fit.traces,
        extra=fit.extra,
        decision=None,
        candidates=(),
        effects=effects,
    )


def _derivatives(dof: Dof) -> tuple[tuple[str, ...], tuple[float, ...]]:
    """Return the derivatives that correspond to the parameters of one axis, and the signs between them."""
    if not dof.restored:
        return dof.derivative_names(), SIGNS
    return (*dof.derivative_names(), dof.restoring_derivative), (*SIGNS, -1.0)


def _in_own_names(dof: Dof, table: Table, doubts: Sequence[Doubt]) -> tuple[Doubt, ...]:
    """Return *doubts* about the derivatives of one axis with the names that its *table* gives them."""
    names = dict(zip(_derivatives(dof)[0], table.parameters, strict=False))
    longest_first = sorted(names, key=len, reverse=True)
    word = re.compile(rf"(?<!\w)({'|'.join(map(re.escape, longest_first))})(?!\w)")

    def renamed(text: str) -> str:
        return word.sub(lambda match: names[match[1]], text)

    return tuple(replace(doubt, cause=renamed(doubt.cause), cure=renamed(doubt.cure)) for doubt in doubts)


def _in_words(dof: Dof, unit: str, structure: Structure, fit: Fit[Model]) -> tuple[SingleDof, Table]:
    """Return the model in physical parameters and their table, from the fit of a form of one axis."""
    names, all_signs = _derivatives(dof)
    order = list(fit.parameters)
    values = [s * fit.parameters[n].value if n in order else 0.0 for n, s in zip(names, all_signs, strict=True)]
    places = [i for i, n in enumerate(names) if n in order]
    at, signs = [order.index(names[i]) for i in places], np.array(all_signs)[places]
    covariance = np.zeros((len(names),) * 2)
    covariance[np.ix_(places, places)] = np.outer(signs, signs) * fit.covariance[np.ix_(at, at)]
    bounds = [fit.parameters[n].bound if n in order else math.nan for n in names]
    model = SingleDof(dof.name, unit, *(float(v) for v in values))
    status: list[Status] = ["fitted" if on else "absent" for on in FREE[structure]]
    status += [fit.parameters[n].status if n in order else "absent" for n in names[4:]]
    return model, axis_table(model, covariance, status, bounds)


def for_axis(method: Callable[[Case], Fit[Model]], *, fits_delay: bool = False) -> Callable[[Case], AxisFit]:
    """Return a method for single axes that uses *method*, which fits forms.

    fits_delay : whether *method* fits an unknown delay.

    Without a requested structure, all three drag structures are fitted. The one whose free run has the lowest Bayesian
    information criterion over all signals is kept. The other structures are listed in ``candidates``.
    """

    def fit_one_axis(case: Case) -> AxisFit:
        if case.structure is not None:
            return axis_fit(case, case.structure, method(case.as_form(case.structure, fits_delay=fits_delay)))
        fits: list[tuple[float, AxisFit]] = []
        candidates: list[StructureFit] = []
        for structure in FREE:
            try:
                fit = axis_fit(case, structure, method(case.as_form(structure, fits_delay=fits_delay)))
            except NotInformative:
                continue
            n = sum(len(t.t) for t in fit.traces)
            spent = sum(FREE[structure])
            log_likelihood = _log_likelihood(fit)
            bic = -2.0 * log_likelihood + spent * math.log(max(n, 2))
            sane = fit.model.alpha * fit.model.beta >= 0.0 and fit.model.alpha * fit.model.beta_quadratic >= 0.0
            candidates.append(StructureFit(structure, fit.model, fit.residual_rms, log_likelihood, spent, bic))
            fits.append((bic if sane else bic + 1e6, fit))
        if not fits:
            raise NotInformative(
                f"run '{case.names[0]}': this method could not fit any drag structure. Use method='output-error'"
            )
        return replace(min(fits, key=lambda pair: pair[0])[1], candidates=tuple(candidates))

    return fit_one_axis
