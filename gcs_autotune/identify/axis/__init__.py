"""One degree of freedom, exactly: the model ``SingleDof`` fitted to whole records by maximum likelihood.

==================  ===========================================================================
record              signals chosen, cleaned and cut; ``ahead``: surge read off a distance to a wall
start               where the exact fit starts
output_error        the exact fit: ``objective`` what it minimises, ``likelihood`` of noise and rounding,
                    ``residuals`` measured minus simulated
structure           which drag, and is there a delay: candidates weighed by ``evidence``
uncertainty         covariance, correlated residuals, Cramer-Rao bound
signals             position, velocity or both
doubts, fit_doubts  reasons not to trust the result, with cause and cure
validation          free run on a record
by_output_error, by_iso   the methods
==================  ===========================================================================
"""
