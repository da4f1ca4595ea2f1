"""Kalman filters that fit a model sample by sample, with process noise.

:class:`NoisyProblem` is a fit of one degree of freedom with :class:`ProcessNoise`. Its method ``fit`` fits any effects,
``judge`` evaluates a fit on other segments, and ``ahead`` predicts ahead of the samples. The identification methods of
this package are available through ``METHODS``.

================  ===========================================================================
start             start values: smooth the motion without a model, then regress the equations on it
filter_bank       prepare records, run one pass over them, fit the noise levels
transition        compiled: the step between stamps, linearised or by sigma points
sweep             compiled: the filter forwards, its adjoint backwards
task              a filter's task, with its options checked
ekf               the methods ``ekf`` and ``ukf``: parameters in the state (ZhaoUSV), repeated until they settle
smoother          the method ``smoother``: all states and parameters at once, iterated
noise_filter      filter of one degree of freedom with process noise, for any parameters
process_noise     the disturbances and sensor noise of this filter; ``run_to_run``: differences between runs
noisy_problem     fit of one degree of freedom with process noise
noisy_objective   the likelihood of this fit; ``noisy_fit``: its result
thinning          reduce records to one signal at a suitable interval
waves             compiled: waves as two states, a narrow-band force and an oscillation of the measured signal
linear_pass       compiled: exact transitions for an equation that is linear in its velocity
prediction_error  the method ``prediction-error``: maximum likelihood of parameters and both kinds of noise
report            the ``Fit`` of every method, with its doubts
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
