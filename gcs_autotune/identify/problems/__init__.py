"""Define a fit as an optimisation problem, solve it, and calculate the information in the data.

A :class:`Problem` consists of segments and a form. ``Problem.fit`` fits its free parameters together with any effects
and returns a :class:`Fitted`. Costs of fits with different effects can be compared. :func:`fit_base` fits the base
model of a diagnosis. :func:`fitted_model_of` converts a ``Fit`` to a model on its runs. :func:`information_on` returns
the Fisher information of this model. :class:`MostLikely` refits this model with one parameter fixed.

================  ===============================================================================
free_numbers      the free parameters, their order and limits
likelihood        likelihood of parameters, effects, initial states and the shift of stamps
simulators        simulators of a segment: one axis, coupled forms, forms with effects
noise             noise models: Gaussian, robust, rounded by a coarse sensor; ``reweighting``: their levels
least_squares     Levenberg-Marquardt search within limits
problem           the fit used in searches over effects; ``fitted``: its result
solution          maximum likelihood with covariance, corrected for coloured residuals
initial_guess     start values of a form; ``quick_fit``: estimates before any fit
base_model        the base model of a diagnosis and its fit
delay             decision whether there is a delay, for every form
stamp_correction  decision at which autopilot loop an input changed
information       Fisher information of runs on a fit; ``most_likely``: likelihood with one parameter fixed
================  ===============================================================================
"""

from __future__ import annotations

from gcs_autotune.identify.problems.base_model import (
    THRUSTERS,
    base_limits,
    data_summary_of,
    fit_base,
    given_base,
    overlooked,
    plain_form,
)
from gcs_autotune.identify.problems.fitted import Fitted
from gcs_autotune.identify.problems.information import (
    BLIND,
    FittedModel,
    Information,
    fitted_model_of,
    information_on,
)
from gcs_autotune.identify.problems.initial_guess import initial_guess_of
from gcs_autotune.identify.problems.least_squares import Local, descend, inverse_of
from gcs_autotune.identify.problems.likelihood import Residual, judged_by
from gcs_autotune.identify.problems.limits import Limits
from gcs_autotune.identify.problems.most_likely import MostLikely
from gcs_autotune.identify.problems.problem import Problem

__all__ = [
    "BLIND",
    "THRUSTERS",
    "Fitted",
    "FittedModel",
    "Information",
    "Limits",
    "Local",
    "MostLikely",
    "Problem",
    "Residual",
    "base_limits",
    "data_summary_of",
    "descend",
    "fit_base",
    "fitted_model_of",
    "given_base",
    "information_on",
    "initial_guess_of",
    "inverse_of",
    "judged_by",
    "overlooked",
    "plain_form",
]
