"""From recorded runs to a model with its uncertainty.

:func:`fit` (``api.py``) is what others call, ``METHODS`` the table of methods (``methods.py``). The engine
all of them share:

================  =============================================================================================
preparation       runs made into segments; ``intake``, ``cleaning``, ``along_axis`` before it
segment           one uninterrupted stretch: signals, inputs, what is known of its stamps
simulators        what a likelihood asks of a model: one axis, coupled forms, forms with effects
noise             Gaussian, robust, rounded by a coarse sensor
likelihood        of parameters, effects, initial states and the shift of stamps
problem           what is to be fitted, for searches over effects
solution          maximum likelihood, covariance, what coloured residuals cost (``whiteness``, ``reweighting``)
stamp_correction  at which loop an input changed; ``settled_stamps`` for methods that take stamps as exact
initial_guess     where a fit of a form begins; ``first_look`` before any fit
delay             whether the craft answers late: one rule for every form
doubts            reasons not to trust a fit, with cause and cure; ``odd_run``: one of another craft
information       Fisher information of any fit on its runs, and its Cramer-Rao bounds
result            what comes out: ``Fit``, its parameters, traces and doubts; ``free_run`` on runs not seen
================  =============================================================================================

Its users: ``axis`` (one degree of freedom: structure and delay decided), ``coupled`` (forms), ``extended`` (effects,
on a ``base_model``), ``kalman``, ``regression``, ``relay``, ``frequency``, ``open_loop``, ``plan``.
"""

from __future__ import annotations

from gcs_autotune.identify.api import fit, fit_axis
from gcs_autotune.identify.axis.uncertainty import cramer_rao
from gcs_autotune.identify.cleaning import quantum
from gcs_autotune.identify.free_run import ResidualStatistics, free_run, residual_statistics
from gcs_autotune.identify.methods import METHODS
from gcs_autotune.identify.relay.iso import decide
from gcs_autotune.identify.relay.limit_cycle import LimitCycleMonitor, MonitorState, find_cycles
from gcs_autotune.identify.result import AxisFit, Fit, Structure

__all__ = [
    "METHODS",
    "AxisFit",
    "Fit",
    "LimitCycleMonitor",
    "MonitorState",
    "ResidualStatistics",
    "Structure",
    "cramer_rao",
    "decide",
    "find_cycles",
    "fit",
    "fit_axis",
    "free_run",
    "quantum",
    "residual_statistics",
]
