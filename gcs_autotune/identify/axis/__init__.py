"""Identify one degree of freedom: fit the model ``SingleDof`` to whole records by maximum likelihood.

==================  ===========================================================================
form                one degree of freedom as a form: damping and parameter names
start               start values of the exact fit
structure           choice of drag structure and delay
evidence            criteria for this choice
uncertainty         covariance, effect of correlated residuals, Cramer-Rao bound
signals             choice of the signals to fit: position, velocity or both
by_output_error     the method ``output-error``, with doubts about its choices
by_iso              the method ``iso``
==================  ===========================================================================
"""
