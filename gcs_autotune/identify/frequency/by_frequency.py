"""The method ``frequency``: measure the frequency response, fit Nomoto's models to it, and collect doubts."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative, UsageError
from gcs_autotune.identify.case import Case
from gcs_autotune.identify.doubt import Doubt
from gcs_autotune.identify.doubts import Findings, doubts_about
from gcs_autotune.identify.fit_builder import AxisDetails, Motion, axis_table, fit_of
from gcs_autotune.identify.frequency.nomoto import EVIDENCE, NomotoFit, fit_nomoto
from gcs_autotune.identify.frequency.response import COHERENT, FrequencyResponse
from gcs_autotune.identify.frequency.spectrum import (
    STRONG,
    TAPERS,
    constant_force,
    harmonic_response,
    spectral_response,
)
from gcs_autotune.identify.method import Method
from gcs_autotune.identify.relay.limit_cycle import PERIODS, SCATTER
from gcs_autotune.identify.result import AxisFit, Status
from gcs_autotune.models import Nomoto1, SingleDof

__all__ = ["METHOD", "OPTIONS", "fit_by_frequency", "frequency_doubts"]

DECADE_PART = 3.0
"""Minimum ratio of the highest to the lowest measured frequency from which a slope can be determined: half a decade.

Project choice.
"""

MISFIT = 0.05
"""Fraction of the motion, beyond noise, that the model may leave unexplained.

Above it a misfit is reported. Project choice.
"""


def frequency_doubts(response: FrequencyResponse, first: NomotoFit, second: NomotoFit | None) -> list[Doubt]:
    """Return the doubts about coherence, about the width of the measured band, and about the misfit of the model."""
    assert isinstance(first.model, Nomoto1)
    doubts = [_coherence(response), _band(response, first.model), _misfit(first, second)]
    return [doubt for doubt in doubts if doubt is not None]


def _coherence(response: FrequencyResponse) -> Doubt | None:
    excited = response.at(response.input_power >= STRONG)
    poor = int((excited.coherence < COHERENT).sum())
    if 2 * poor <= len(excited):
        return None
    return Doubt(
        "low-coherence",
        f"the squared coherence is below {COHERENT:g} at {poor} of {len(excited)} excited frequencies. At those "
        "frequencies the input does not cause most of the motion",
        "use a larger input, calmer water, or a longer record. Check for motion of other axes",
    )


def _band(response: FrequencyResponse, model: Nomoto1) -> Doubt | None:
    measured = response.at((response.input_power >= STRONG) & (response.coherence >= COHERENT))
    if not len(measured):
        return Doubt(
            "narrow-band",
            "no frequency was measured with enough coherence, so gain and time constant are unreliable",
            "fly a sweep or a relay with a larger input",
        )
    low, high = float(measured.omega.min()), float(measured.omega.max())
    band = f"the coherent frequencies range from {low:.2g} to {high:.2g} rad/s"
    corner = 1.0 / abs(model.T) if model.T and math.isfinite(model.T) else 0.0
    if corner < low:
        what = (
            f"{band}. The corner 1/T = {corner:.2g} rad/s is lower. The runs determine T/K (inertia), but not K "
            "and T separately"
        )
        return Doubt(
            "narrow-band",
            what,
            "fly slower motion, such as longer steps, a slower sweep or a relay with a larger x_a (switching value)",
        )
    if corner > high:
        what = f"{band}. The corner 1/T = {corner:.2g} rad/s is higher, so K is measured but T is extrapolated"
        return Doubt(
            "narrow-band",
            what,
            "fly faster motion, such as a faster sweep or a relay with a smaller x_a (switching value)",
        )
    if high < DECADE_PART * low:
        return Doubt("narrow-band", f"{band}, less than half a decade", "sweep over a wider band")
    return None


def _misfit(first: NomotoFit, second: NomotoFit | None) -> Doubt | None:
    better = second is not None and first.bic - second.bic > EVIDENCE
    if first.misfit <= MISFIT and not better:
        return None
    also = "" if second is None else f", and the second-order model {100 * second.misfit:.0f} %"
    return Doubt(
        "model-misfit",
        f"the first-order Nomoto model leaves {100 * first.misfit:.0f} % of the motion unexplained beyond noise{also}",
        "use the second-order model (nomoto_2)"
        if better
        else "check for quadratic damping or runs of different amplitude. method='output-error' models both",
    )


SOURCES = ("auto", "harmonics", "spectrum")

OPTIONS = (
    ("source", "data source: harmonics (of a relay's limit cycles), spectrum (any run), or auto"),
    (
        "tapers",
        f"number of spectra averaged at low frequency (default: {TAPERS}). More give a smoother, coarser response",
    ),
)


def fit_by_frequency(case: Case) -> AxisFit:
    """Fit Nomoto's first-order model (linear drag) to the empirical frequency response of *case*.

    ``extra`` contains the response in the format that ``FrequencyResponse.from_dict`` reads. It also contains the
    models ``nomoto`` and ``nomoto_2`` with their standard errors, and the order that the Bayesian criterion prefers.

    Raises
    ------
    NotInformative
        The record is too short, or too few frequencies have enough coherence.
    UsageError
        Drag other than linear is requested, or the source is unknown.
    """
    if case.structure not in (None, "linear"):
        raise UsageError(
            f"method 'frequency' fits linear damping only, not {case.structure}, because a frequency response does "
            "not depend on amplitude. Use method='output-error'"
        )
    response = _response(case)
    used = response.at((response.input_power >= STRONG) & (response.coherence > 1.0 / response.averages))
    first = fit_nomoto(used, 1, case.delay)
    second, refused = _second(used, case.delay)
    model, covariance = _model(case, first)
    states: list[Status] = ["fitted", "fitted", "absent", "fitted", _delay_status(case, model)]
    table = axis_table(model, covariance, states)
    motion = _motion(model, case)
    doubts = doubts_about(Findings(case, model, "linear", table.parameters, None, motion.rms, motion.fit_percent))
    main = case.records[0].main.name
    return fit_of(
        case,
        "frequency",
        model,
        table,
        motion,
        structure="linear",
        doubts=(*doubts, *frequency_doubts(response, first, second), *([] if motion.traces else [_runs_away(first)])),
        extra={
            "signals": [main],
            "response": response.to_dict(),
            "nomoto": first.to_dict(),
            "nomoto_2": None if second is None else second.to_dict(),
            "nomoto_2_refused": refused,
            "preferred_order": 1 if second is None or first.bic <= second.bic else 2,
        },
        axis=AxisDetails(main),
    )


def _motion(model: SingleDof, case: Case) -> Motion:
    """Return the free run of the model. If it diverges, all of the motion counts as residual."""
    motion = Motion.freely(model, case.records)
    if motion.traces:
        return motion
    return replace(
        motion, fit_percent=0.0, rms=math.sqrt(float(np.mean([np.var(r.main.values) for r in case.records])))
    )


def _runs_away(first: NomotoFit) -> Doubt:
    assert isinstance(first.model, Nomoto1)
    T = first.model.T
    early = f"the motion responds {-1000.0 * T:.0f} ms before the input's time stamp" if T < 0.0 else f"T = {T:.3g} s"
    return Doubt(
        "runs-away",
        f"the model cannot be simulated on its own run ({early}). The inertia is too small to measure, or the time "
        "stamps are not synchronous",
        "check the time stamps of input and output. Record faster, or sweep over a wider band",
    )


def _settled(case: Case) -> bool:
    """Return whether all runs are settled relay experiments, by the rule of Miskovic2010, 6.7."""
    settled = [c for c in case.cycles if c.periods >= PERIODS and c.scatter <= SCATTER]
    return len(settled) >= len(case.trials) and len(settled) == len(case.cycles)


def _response(case: Case) -> FrequencyResponse:
    source = str(case.options.get("source", "auto"))
    if source not in SOURCES:
        raise UsageError(f"unknown source '{source}'. Use {', '.join(SOURCES)}")
    tapers = int(case.options.get("tapers", TAPERS))
    if tapers < 2:
        raise UsageError(f"the coherence cannot be computed from {tapers} tapers. Use 2 or more")
    dof = case.records[0].dof
    if source == "harmonics":
        return harmonic_response(case.trials, dof)
    if source == "auto" and _settled(case):
        try:
            return harmonic_response(case.trials, dof)
        except NotInformative:
            pass
    return spectral_response(case.trials, dof, tapers)


def _second(response: FrequencyResponse, delay: float | None) -> tuple[NomotoFit | None, str]:
    try:
        return fit_nomoto(response, 2, delay), ""
    except NotInformative as error:
        return None, str(error)


def _model(case: Case, first: NomotoFit) -> tuple[SingleDof, NDArray[np.float64]]:
    """Return the model and its covariance (5, 5), in the order (alpha, beta, beta_quadratic, delta, delay)."""
    beta, alpha, delay = (float(v) for v in first.physical)
    if alpha == 0.0:
        raise NotInformative("the response shows no inertia. Record faster, or sweep to a higher frequency")
    delta, scatter = constant_force(case.records, alpha, beta)
    record = case.records[0]
    covariance = np.zeros((5, 5))
    at = [1, 0, 4]
    covariance[np.ix_(at, at)] = first.covariance
    covariance[3, 3] = scatter**2
    return SingleDof(record.dof.name, record.input_units[0], alpha, beta, delta=delta, delay=delay), covariance


def _delay_status(case: Case, model: SingleDof) -> Status:
    if case.delay is not None:
        return "fixed"
    return "fitted" if model.delay > 0.0 else "absent"


METHOD = Method(
    "frequency",
    "Nomoto model fitted to the Bode response of a sweep or relay",
    axis=fit_by_frequency,
    options=OPTIONS,
)
