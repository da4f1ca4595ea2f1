"""Identify several degrees of freedom at once: common parts of methods that fit a ``CoupledModel``, and output error.

===============  ======================================================================
one_axis         a single degree of freedom as a form, so that every method for forms fits it too
limits           bounds: those of the user, physical ones, and those from the sampling
local            the fit from the first successful start, with a delay if the evidence is strong
by_output_error  the method ``output-error``
by_global        the method ``global``: two different optimisers, the better result refined by output error
===============  ======================================================================
"""
