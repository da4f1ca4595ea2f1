"""Data and a form as an optimisation problem, its solution, and what the data determine.

A :class:`Problem` is segments and a form. ``Problem.fit`` fits its free numbers together with any effects and returns a
:class:`Fitted`. Costs of fits with different effects can be compared. :func:`fit_base` does it for the plain model of a
simulation. :func:`fitted_model_of` is the way back from a ``Fit``: :func:`information_on` is its Fisher information,
:class:`MostLikely` its likelihood with a parameter held.

================  ===============================================================================
free_numbers      which numbers are free, their order and limits
likelihood        of parameters, effects, initial states and the shift of stamps
simulators        simulate a segment for it: one axis, coupled forms, forms with effects
noise             Gaussian, robust, rounded by a coarse sensor; ``reweighting`` estimates it
least_squares     Levenberg-Marquardt within limits
problem           the fit for searches over effects; ``fitted``: its result
solution          maximum likelihood with covariance, corrected for coloured residuals
initial_guess     start values of a form; ``quick_fit``: estimates before any fit
base_model        the plain model of a simulation, fitted
delay             decides whether there is a delay: one rule for every form
stamp_correction  the autopilot loop at which an input changed
information       Fisher information of a fit on runs; ``most_likely``: its likelihood
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
