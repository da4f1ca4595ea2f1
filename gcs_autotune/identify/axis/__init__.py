"""Identify one degree of freedom: fit the model ``SingleDof`` to whole records by maximum likelihood.

==================  ===========================================================================
form                one degree of freedom as a form: damping and parameter names
start               start values of the exact fit
structure           choice of drag structure and delay
evidence            criteria for the choice of drag structure
uncertainty         covariance, effect of correlated residuals
signals             choice of the signals to fit: position, velocity or both
run_comparison      search for runs that differ from the others
by_output_error     the method ``output-error``
by_iso              the method ``iso``
==================  ===========================================================================
"""
