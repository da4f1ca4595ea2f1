"""Kalman filters that fit a model sample by sample, with process noise.

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
prediction_error  ``prediction-error``: maximum likelihood of the innovations over parameters and both kinds of noise
report, doubts    the ``Fit`` of every method
================  ===========================================================================
"""
