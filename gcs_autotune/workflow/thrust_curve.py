"""Thrusters that are weak for small commands: two oscillations of different size show it, one model of both needs it.

A propeller's thrust goes with n|n|, and ArduSub sends its demands to the thrusters as they are, so that an ROV's gain
grows with the size of the command. Without it the smaller oscillation is that of another craft than the larger.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gcs_autotune.design import Proposal, Spec, design_from
from gcs_autotune.effects.extended import ExtendedModel
from gcs_autotune.errors import AutotuneError
from gcs_autotune.firmware import Axis
from gcs_autotune.identify import AxisFit, Fit, fit
from gcs_autotune.trial import Trial

__all__ = ["design_with_curve", "fit_thrust_curve", "told"]

_EFFECT = "quadratic-actuator"
_UNEXPLAINED = 0.8
"""The curve must bring what is left unexplained below this share of what it was..."""
_STDS = 5.0
"""...and be this many standard errors from a straight line. Both chosen: a curve that matters passes both by far."""
_SHARES = (0.1, 1.5)
"""What the share of n|n| can be."""


def fit_thrust_curve(runs: Sequence[Trial], plain: AxisFit) -> Fit | None:
    """Return a model with a thrust curve when the *runs* clearly call for one, else None.

    plain : the model without, of the same runs.
    """
    channel = plain.model.axis.force
    try:
        found = fit(list(runs), "affine", dof=plain.model.dof, effects=(f"{_EFFECT}@{channel}",))
    except AutotuneError:
        return None
    share = found.parameters[f"{_EFFECT}@{channel}.share"]
    left, was = 100.0 - found.fit_percent, 100.0 - plain.fit_percent
    clear = left < _UNEXPLAINED * was and share.value > _STDS * share.std
    return found if clear and _SHARES[0] < share.value < _SHARES[1] else None


def told(found: Fit, plain: AxisFit) -> str:
    """Return the finding in a sentence."""
    share = next(p for name, p in found.parameters.items() if name.startswith(_EFFECT))
    return (
        "the two oscillations speak of thrusters that are weak for small commands "
        f"({share.value:.0%} of the thrust goes with the square of the command): with that the model explains "
        f"{found.fit_percent:.0f} % of the motion instead of {plain.fit_percent:.0f} %"
    )


def design_with_curve(found: Fit, axis: Axis, present: Mapping[str, float], spec: Spec) -> Proposal:
    """Return gains designed with the curve in the loop; errors as those of :func:`gcs_autotune.design.design_from`."""
    std = np.array([parameter.std for parameter in found.parameters.values()])
    covariance = np.nan_to_num(found.correlation) * np.outer(std, std)
    model = found.model
    assert isinstance(model, ExtendedModel)
    units = dict.fromkeys(model.base.form.inputs, "1")
    return design_from(model, axis, present, spec, inputs=units, names=tuple(found.parameters), covariance=covariance)
