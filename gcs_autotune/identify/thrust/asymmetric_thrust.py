"""Report thrust that is weaker in one direction.

A model of one degree of freedom has one gain for both directions.
"""

from __future__ import annotations

import math
import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from gcs_autotune.identify.doubt import Doubt
from gcs_autotune.identify.result import AxisFit
from gcs_autotune.identify.thrust.thrust_curve import LOPSIDED, effect_number, fit_with_actuator
from gcs_autotune.sname import SIDES
from gcs_autotune.trial import Trial

__all__ = ["with_doubt_of_thrust"]

_USED = 0.1
"""Fraction of full output above which a direction of thrust counts as used."""
_STDS, _EVIDENCE = 5.0, 10.0
"""Standard errors and BIC difference above which thrust is reported to differ between directions."""


def with_doubt_of_thrust(fit: AxisFit, used: Sequence[Trial], directory: Path) -> AxisFit:
    """Return *fit* with a doubt if thrust is clearly weaker in one direction."""
    force = fit.model.axis.force
    shares = np.concatenate([run[force].values for run in used])
    if not (shares.min() < -_USED and shares.max() > _USED):
        return fit
    other = fit_with_actuator(used, fit, LOPSIDED)
    if other is None:
        return fit
    ratio, size = effect_number(other, LOPSIDED), len(shares)
    evidence = -2.0 * size * math.log(max(other.unexplained, 1e-9) / fit.unexplained) - math.log(size)
    if evidence < _EVIDENCE or not abs(1.0 - ratio.value) > _STDS * ratio.std:
        return fit
    one, way = SIDES[fit.model.dof]
    name, inertia = fit.model.axis.parameter_names()[0], other.parameters[f"{force}_{fit.model.axis.velocity}dot"]
    doubt = Doubt(
        "lopsided-thrust",
        f"thrust {way} is {100.0 * ratio.value:.0f} ± {100.0 * ratio.std:.0f} % of that {one}, but this model has "
        f"one gain for both. With two gains, {name} is {abs(inertia.value):.3g} ± {inertia.std:.2g}",
        f"fit two gains: gcs-autotune identify {shlex.quote(str(directory))} --dof {fit.model.dof} --effects "
        f"{LOPSIDED}@{force}",
    )
    return replace(fit, doubts=(*fit.doubts, doubt))
