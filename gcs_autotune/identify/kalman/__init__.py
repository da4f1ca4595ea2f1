"""Kalman filters that fit a model sample by sample, with process noise.

:class:`NoisyProblem` is the problem of one degree of freedom whose model has a :class:`ProcessNoise`: ``fit`` it with
any effects, ``judge`` a fit on other segments, predict ``ahead``. The methods need no door: ``METHODS`` names them.

================  ===========================================================================
start             starting values: smooth the motion without a model, then regress on it
filter_bank       prepare records, run one pass over them, fit the noise levels
transition        compiled: the step between stamps, linearised or by sigma points
sweep             compiled: the filter forwards, its adjoint backwards
task              a fit's task, with its options checked
ekf               ``ekf``, ``ukf``: parameters in the state (ZhaoUSV), repeated until they settle
smoother          ``smoother``: all states and parameters at once, iterated
noisy_problem     one degree of freedom with process noise (``noisy_objective``: its likelihood; ``thinning``)
waves             compiled: waves as two states, a narrow-band force and an oscillation of the measured signal
linear_pass       compiled: exact transitions for an equation that is linear in its velocity
prediction_error  ``prediction-error``: maximum likelihood of the innovations over parameters and both noises
report, doubts    the ``Fit`` of every method
================  ===========================================================================
"""

from __future__ import annotations

from gcs_autotune.identify.kalman.noisy_fit import NoisyFit, Tangent
from gcs_autotune.identify.kalman.noisy_problem import NoisyProblem
from gcs_autotune.identify.kalman.process_noise import LONGEST_WAVE, ProcessNoise
from gcs_autotune.identify.kalman.run_to_run import RunLikelihoods, RunOffset
from gcs_autotune.identify.kalman.thinning import thinned_to

__all__ = [
    "LONGEST_WAVE",
    "NoisyFit",
    "NoisyProblem",
    "ProcessNoise",
    "RunLikelihoods",
    "RunOffset",
    "Tangent",
    "thinned_to",
]
