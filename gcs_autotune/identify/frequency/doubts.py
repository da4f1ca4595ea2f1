"""What to doubt about a frequency response and the models fitted to it."""

from __future__ import annotations

import math

from gcs_autotune.identify.frequency.nomoto import EVIDENCE, NomotoFit
from gcs_autotune.identify.frequency.response import COHERENT, FrequencyResponse
from gcs_autotune.identify.frequency.spectrum import STRONG
from gcs_autotune.identify.result import Doubt
from gcs_autotune.models.nomoto import Nomoto1

__all__ = ["frequency_doubts"]

DECADE_PART = 3.0
"""Least ratio of highest to lowest measured frequency that shows a slope. Chosen: half a decade."""

MISFIT = 0.05
"""Fraction of the motion missed beyond noise above which the model is not the response's."""


def frequency_doubts(response: FrequencyResponse, first: NomotoFit, second: NomotoFit | None) -> list[Doubt]:
    """Return the doubts: low coherence, a band too narrow for the corner, a model that misses the response."""
    assert isinstance(first.model, Nomoto1)
    found = [_coherence(response), _band(response, first.model), _misfit(first, second)]
    return [doubt for doubt in found if doubt is not None]


def _coherence(response: FrequencyResponse) -> Doubt | None:
    excited = response.at(response.input_power >= STRONG)
    poor = int((excited.coherence < COHERENT).sum())
    if 2 * poor <= len(excited):
        return None
    return Doubt(
        "low-coherence",
        f"the squared coherence is below {COHERENT:g} at {poor} of {len(excited)} excited frequencies: most of the "
        "motion there is not the input's doing",
        "use a larger input, calmer water, or a longer record; look for other axes at work",
    )


def _band(response: FrequencyResponse, model: Nomoto1) -> Doubt | None:
    measured = response.at((response.input_power >= STRONG) & (response.coherence >= COHERENT))
    if not len(measured):
        return Doubt(
            "narrow-band",
            "no frequency was measured with coherence: gain and time constant are guesses",
            "fly a sweep or a relay with a larger input",
        )
    low, high = float(measured.omega.min()), float(measured.omega.max())
    band = f"the input excited {low:.2g} to {high:.2g} rad/s with coherence"
    corner = 1.0 / abs(model.T) if model.T and math.isfinite(model.T) else 0.0
    if corner < low:
        what = (
            f"{band}, the corner 1/T = {corner:.2g} rad/s lies below: T/K (inertia) is measured, K and T apart are not"
        )
        return Doubt("narrow-band", what, "add slower motion: longer steps, a slower sweep, a relay with a larger x_a")
    if corner > high:
        what = f"{band}, the corner 1/T = {corner:.2g} rad/s lies above: K is measured, T is extrapolated"
        return Doubt("narrow-band", what, "add faster motion: a quicker sweep, a relay with a smaller x_a")
    if high < DECADE_PART * low:
        return Doubt("narrow-band", f"{band}, less than half a decade", "sweep over a wider band")
    return None


def _misfit(first: NomotoFit, second: NomotoFit | None) -> Doubt | None:
    better = second is not None and first.bic - second.bic > EVIDENCE
    if first.misfit <= MISFIT and not better:
        return None
    also = "" if second is None else f", the second by {100 * second.misfit:.0f} %"
    return Doubt(
        "model-misfit",
        f"Nomoto's first order misses {100 * first.misfit:.0f} % of the motion beyond its noise{also}",
        "take the second order from nomoto_2"
        if better
        else "quadratic damping, or runs of different amplitude: method='output-error' weighs that too",
    )
