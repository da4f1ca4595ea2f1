"""Identify an actuator that follows its command slowly, from the oscillations of a tune.

The servo of a rudder or an outboard turns at a limited rate, and the thrust of a large propeller lags. A model without
this takes the slow start of each turn for inertia, and gains are designed for another craft. A relay commands full
reversals, so a rate limit shows in every half period.

A rate limit and a lag are compared, because each explains a part of the other. Each also explains a part of a hull that
slips sideways. So a slow actuator is accepted only if the model with it explains nearly all of the motion.
"""

from __future__ import annotations

from collections.abc import Sequence

from gcs_autotune.identify.result import AxisFit, Fit, Model
from gcs_autotune.identify.thrust.thrust_curve import LINEAR_ENOUGH, effect_number, fit_with_actuator, pays
from gcs_autotune.trial import Trial

__all__ = ["LAG", "RATE_LIMIT", "describe_slow_actuator", "fit_slow_actuator"]

RATE_LIMIT = "rate-limit"
LAG = "actuator-lag"


def fit_slow_actuator(runs: Sequence[Trial], plain: AxisFit) -> Fit[Model] | None:
    """Return a model with a rate limit or a lag of the actuator if the *runs* require that and no more, else None.

    plain : model of the same runs with an actuator that acts at once.
    """
    if plain.unexplained < LINEAR_ENOUGH:
        return None
    at_once = fit_with_actuator(runs, plain)
    if at_once is None:
        return None
    tried = [(slug, fit_with_actuator(runs, plain, slug)) for slug in (RATE_LIMIT, LAG)]
    fits = [fit for slug, fit in tried if fit is not None and pays(fit, at_once, slug)]
    best = min(fits, key=lambda fit: fit.unexplained, default=None)
    return best if best is not None and best.unexplained < LINEAR_ENOUGH else None


def describe_slow_actuator(fit: Fit[Model], plain: AxisFit) -> str:
    """Return one sentence that reports the rate limit or lag in *fit*.

    plain : model of the same runs with an actuator that acts at once.
    """
    if any(name.startswith(RATE_LIMIT) for name in fit.parameters):
        seconds = 1.0 / effect_number(fit, RATE_LIMIT).value
        what = f"an actuator with a limited rate: it takes {seconds:.2g} s from neutral to full output"
    else:
        what = f"an actuator that follows with a time constant of {effect_number(fit, LAG).value:.2g} s"
    explained = f"{fit.fit_percent:.0f} % of the motion instead of {plain.fit_percent:.0f} %"
    return f"the oscillations indicate {what}. With this the model explains {explained}"
