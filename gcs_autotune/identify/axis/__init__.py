"""One degree of freedom, exactly: the model ``SingleDof`` fitted to whole records by maximum likelihood.

==================  ===========================================================================
form                the axis as a form, its dampings, its numbers by name
start               where the exact fit starts
structure           which drag, and is there a delay: candidates weighed by ``evidence``
uncertainty         covariance, correlated residuals, Cramer-Rao bound
signals             position, velocity or both; ``agreement`` of the two
fit_doubts          reasons not to trust the choice made, with cause and cure
by_output_error, by_iso   the methods
==================  ===========================================================================
"""
