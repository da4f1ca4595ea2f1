"""From recorded runs to a model with its uncertainty.

:func:`fit` is the door (``door.py``), ``METHODS`` the table of methods (``methods.py``). Behind it:

===========  ==================================================================================================
axis         one degree of freedom, exactly: records, likelihood, structure decision, doubts
relay        self-oscillation: limit cycles and what their first harmonic tells (IS-O)
coupled      several degrees of freedom: one record and one case for every method that fits a ``CoupledModel``
regression   least squares of the equations of motion, instrumental variables, recursive; structure by correlation
result       what comes out: ``Fit``, its parameters, traces and doubts
validate     free run on runs the model has not seen
uncertainty  (in ``axis``) covariance, correlated residuals, Cramer-Rao bound
===========  ==================================================================================================
"""

from __future__ import annotations

from gcs_autotune.identify.axis.uncertainty import cramer_rao
from gcs_autotune.identify.axis.validation import ResidualStatistics, free_run, residual_statistics
from gcs_autotune.identify.cleaning import quantum
from gcs_autotune.identify.door import fit, fit_axis
from gcs_autotune.identify.files import load_runs
from gcs_autotune.identify.methods import METHODS
from gcs_autotune.identify.relay.cycle_reading import find_cycles
from gcs_autotune.identify.relay.decision import decide
from gcs_autotune.identify.relay.limit_cycle import LimitCycleMonitor, MonitorState
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
    "load_runs",
    "quantum",
    "residual_statistics",
]
