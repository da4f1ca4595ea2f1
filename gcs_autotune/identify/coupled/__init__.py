"""Several degrees of freedom at once: what every method that fits a ``CoupledModel`` shares, and output error.

===============  ======================================================================
one_axis         a single degree of freedom as the smallest form: every method of forms fits axes too
limits           bounds: the user's, physical ones, what the record can resolve
local            the fit from the first start that leads somewhere, with a delay where the evidence is strong
global_search    two optimisers of different kind, the better kept and polished
by_output_error  the method ``output-error``
by_global        the method ``global``
===============  ======================================================================
"""
