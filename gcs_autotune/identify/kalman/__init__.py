"""Filters: what was measured when, one sample after the other, with process noise.

================  ===========================================================================
start             motion smoothed without a model, and the regression on it that begins
filter_bank       records made ready, one pass over them, noise levels of greatest likelihood
transition        compiled: between stamps with inputs that jump, linear or by sigma points
sweep             compiled: the filter forwards, its adjoint backwards
task              a question with its options read
ekf               ``ekf``, ``ukf``: parameters in the state (ZhaoUSV), passes until they settle
smoother          ``smoother``: all states and parameters at once, iterated
noisy_problem     one degree of freedom with process noise (``noisy_objective``: its likelihood; ``thinning``)
waves             compiled: waves as two states of either filter, a force in a narrow band and a swing of what is seen
linear_pass       compiled: that filter where the equation is linear in its velocity, by exact transitions
prediction_error  ``prediction-error``: innovations' likelihood over parameters and both noises
report, doubts    the ``Fit`` of any of them
================  ===========================================================================
"""
