"""One degree of freedom as the smallest coupled form, so that every method for coupled models fits single axes too.

``alpha nu_dot + (beta + beta_nn |nu|) nu = tau + Delta`` is a form with the derivatives ``N_rdot = -alpha``,
``N_r = -beta``, ``N_rr = -beta_nn``, ``N_0 = Delta`` (yaw; likewise for the others), so estimates and covariances carry
over by a change of sign.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects import ExtendedModel
from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.axis.case import Case, named_parameters
from gcs_autotune.identify.axis.structure import FREE
from gcs_autotune.identify.coupled.case import CoupledCase
from gcs_autotune.identify.doubts import OF_THE_RUNS, once
from gcs_autotune.identify.free_run import rms_of
from gcs_autotune.identify.result import AxisFit, Fit, Parameter, Status, Structure, StructureFit
from gcs_autotune.identify.segment import Segment
from gcs_autotune.models import Form, SingleDof
from gcs_autotune.sname import DOFS, Dof

__all__ = ["axis_fit", "axis_form", "coupled_case", "derivative_names", "for_axis", "with_actuator"]

Array = NDArray[np.float64]

SIGNS = (-1.0, -1.0, -1.0, 1.0, 1.0)
"""Derivative times sign gives (alpha, beta, beta_quadratic, delta, delay)."""


def derivative_names(dof: Dof) -> tuple[str, str, str, str, str]:
    """Return the derivatives behind (alpha, beta, beta_quadratic, delta, delay)."""
    force, nu = dof.force, dof.velocity
    return (f"{force}_{nu}dot", f"{force}_{nu}", f"{force}_{nu}{nu}", f"{force}_0", "delay")


def axis_form(dof: Dof, input_name: str, structure: Structure, *, normalised: bool, delay: float | None = 0.0) -> Form:
    """Return the form of one axis; *delay* None makes it a free parameter, 0 leaves it out."""
    names = derivative_names(dof)
    free = [n for n, on in zip(names[:4], FREE[structure], strict=True) if on]
    known = {} if not delay else {"delay": float(delay)}
    return Form(
        name=f"{dof.name}/{structure}",
        title=f"{dof.name}, {structure} damping",
        dofs=(dof.name,),
        free=tuple(free if delay is not None else [*free, "delay"]),
        known=known,
        inputs={input_name: ((dof.force, 1.0),)},
        coriolis=False,
        normalised=normalised,
    )


def coupled_case(case: Case, structure: Structure) -> CoupledCase:
    """Return *case* as a question about a form of one degree of freedom; an unknown delay is taken as none."""
    first = case.records[0]
    form = axis_form(
        first.dof, first.input_names[0], structure, normalised=first.input_units[0] == "1", delay=case.delay or 0.0
    )
    return CoupledCase(
        form=form,
        records=tuple(_used(r, case.use) for r in case.records),
        delay=case.delay or 0.0,
        robust=case.robust,
        names=case.names,
        trials=case.trials,
        options=case.options,
    )


def _used(segment: Segment, use: object) -> Segment:
    """Return *segment* with the signals asked for, by name or as ``position`` and ``velocity``."""
    wanted = tuple(use) if isinstance(use, (tuple, list)) else ()
    kinds = {segment.dof.position: "position", segment.dof.velocity: "velocity"}
    return segment.only([n for n in segment.signals if not wanted or kinds[n] in wanted or n in wanted])


def axis_fit(case: Case, structure: Structure, fit: Fit) -> AxisFit:
    """Return what a coupled method found for :func:`coupled_case` in the words of one axis."""
    dof: Dof = DOFS[case.records[0].dof.name]
    model, parameters, covariance = _in_words(dof, case.records[0].input_units[0], structure, fit)
    main = case.records[0].main.name
    rms = _left(fit, main)
    return AxisFit(
        dof=dof.name,
        structure=structure,
        method=fit.method,
        model=model,
        parameters=parameters,
        covariance=covariance,
        noise=fit.noise,
        noise_std=fit.noise.get(main, rms),
        residual_rms=rms,
        fit_percent=fit.fit_percent,
        used=case.names,
        doubts=fit.doubts,
        traces=fit.traces,
        extra=fit.extra,
    )


def with_actuator(fit: Fit, plain: AxisFit) -> AxisFit:
    """Return *fit*, a model of one axis with effects of its actuator, in the words of one axis.

    plain : the model of the same runs without them. Of it the readings of limit cycles stay and what is doubtful about
    the runs themselves; what it doubts of itself, and how its drag was chosen, does not hold for *fit*.
    """
    assert isinstance(fit.model, ExtendedModel)
    axis, main = plain.model.axis, plain.traces[0].signal if plain.traces else plain.model.axis.position
    structure: Structure = "affine"
    model, parameters, covariance = _in_words(axis, plain.model.input_unit, structure, fit)
    effects = tuple(e for e in fit.model.effects if e.place == axis.force)
    labels = [n for n in fit.parameters if n.startswith(tuple(f"{e.slug}@{e.place}." for e in effects))]
    order = list(fit.parameters)
    names, signs = [*derivative_names(axis), *labels], np.array([*SIGNS, *(1.0 for _ in labels)])
    places = [i for i, n in enumerate(names) if n in order]
    at = [order.index(names[i]) for i in places]
    whole = np.zeros((len(names),) * 2)
    whole[np.ix_(places, places)] = np.outer(signs[places], signs[places]) * fit.covariance[np.ix_(at, at)]
    whole[:5, :5] = covariance
    of_the_runs = [d for d in plain.doubts if d.slug in OF_THE_RUNS]
    own = tuple(t for t in fit.traces if t.signal == main)
    rms = _left(fit, main)
    return replace(
        plain,
        structure=structure,
        method=fit.method,
        model=model,
        parameters={**parameters, **{n: fit.parameters[n] for n in labels}},
        covariance=whole,
        noise=fit.noise,
        noise_std=fit.noise.get(main, rms),
        residual_rms=rms,
        fit_percent=fit.fit_percent,
        used=fit.used,
        doubts=once([*of_the_runs, *fit.doubts]),
        traces=own or fit.traces,
        extra=fit.extra,
        decision=None,
        candidates=(),
        effects=effects,
    )


def _in_words(dof: Dof, unit: str, structure: Structure, fit: Fit) -> tuple[SingleDof, dict[str, Parameter], Array]:
    """Return model, parameters and their covariance (5, 5) of a form of one axis."""
    names = derivative_names(dof)
    order = list(fit.parameters)
    values = [s * fit.parameters[n].value if n in fit.parameters else 0.0 for n, s in zip(names, SIGNS, strict=True)]
    covariance = np.zeros((5, 5))
    bounds = [math.nan] * 5
    for i, (n, s) in enumerate(zip(names, SIGNS, strict=True)):
        if n in order:
            bounds[i] = fit.parameters[n].bound
        for j, (o, z) in enumerate(zip(names, SIGNS, strict=True)):
            if n in order and o in order:
                covariance[i, j] = s * z * fit.covariance[order.index(n), order.index(o)]
    model = SingleDof(dof.name, unit, *(float(v) for v in values))
    status: list[Status] = ["fitted" if on else "absent" for on in FREE[structure]]
    status.append(fit.parameters["delay"].status if "delay" in order else "absent")
    return model, named_parameters(model, covariance, status, bounds), covariance


def _left(fit: Fit, signal: str) -> float:
    """Return the root mean square of what is left of *signal*, or of everything where it was not fitted."""
    own = [t for t in fit.traces if t.signal == signal] or list(fit.traces)
    return rms_of(own)


def for_axis(method: Callable[[CoupledCase], Fit]) -> Callable[[Case], AxisFit]:
    """Make a method for coupled models one for single axes.

    Without a structure asked for, all three drags are fitted and the one with the least Bayesian information
    criterion of its free run is kept; its rivals stand in ``candidates``.
    """

    def fit_one_axis(case: Case) -> AxisFit:
        if case.structure is not None:
            return axis_fit(case, case.structure, method(coupled_case(case, case.structure)))
        found: list[tuple[float, AxisFit]] = []
        candidates: list[StructureFit] = []
        for structure in FREE:
            try:
                fit = axis_fit(case, structure, method(coupled_case(case, structure)))
            except NotInformative:
                continue
            n = sum(len(t.t) for t in fit.traces)
            spent = sum(FREE[structure])
            log_likelihood = -n * math.log(max(fit.residual_rms, 1e-300))
            bic = -2.0 * log_likelihood + spent * math.log(max(n, 2))
            sane = fit.model.alpha * fit.model.beta >= 0.0 and fit.model.alpha * fit.model.beta_quadratic >= 0.0
            candidates.append(StructureFit(structure, fit.model, fit.residual_rms, log_likelihood, spent, bic))
            found.append((bic if sane else bic + 1e6, fit))
        if not found:
            raise NotInformative(f"run '{case.names[0]}': no drag structure could be fitted by this method")
        best = min(found, key=lambda pair: pair[0])[1]
        return AxisFit(**{**{n: getattr(best, n) for n in _FIELDS}, "candidates": tuple(candidates)})

    return fit_one_axis


_FIELDS = tuple(AxisFit.__dataclass_fields__)
