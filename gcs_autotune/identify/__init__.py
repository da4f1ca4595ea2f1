"""From recorded runs to a model with its uncertainty.

:func:`fit` is the door (``door.py``), ``METHODS`` the table of methods (``methods.py``). Behind it:

===========  ==================================================================================================
axis         one degree of freedom, exactly: records, likelihood, structure decision, doubts
relay        self-oscillation: limit cycles and what their first harmonic tells (IS-O)
frequency    the empirical frequency response with coherence, and Nomoto's models
open_loop    the methods step and zig-zag
coupled      several degrees of freedom: one record and one case for every method that fits a ``CoupledModel``
regression   least squares and instrumental variables on any form, physical constraints, structure by correlation
kalman       EKF, UKF, iterated smoother, and prediction error by the innovations' likelihood
plan         sequenced experiments: which manoeuvre identifies what, in which order; joint fit of all
information  Fisher information of any fit on its runs, and its Cramer-Rao bounds
result       what comes out: ``Fit``, its parameters, traces and doubts
intake       runs as handed in: split at clock jumps, units checked, useless ones left out by name
cleaning     one channel; ``rails`` clipped sensors, ``input_holes``; ``consistency`` are the runs of one craft?
validate     free run on runs the model has not seen
uncertainty  (in ``axis``) covariance, correlated residuals, Cramer-Rao bound
===========  ==================================================================================================
"""

from __future__ import annotations

from gcs_autotune.identify.axis.uncertainty import cramer_rao
from gcs_autotune.identify.axis.validation import ResidualStatistics, free_run, residual_statistics
from gcs_autotune.identify.cleaning import quantum
from gcs_autotune.identify.door import fit, fit_axis
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
