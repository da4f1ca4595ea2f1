"""Several degrees of freedom at once: what every method that fits a ``CoupledModel`` shares.

==========  ===========================================================================
record      runs cleaned and cut for a form
case        one question, as every method gets it
one_axis    a single degree of freedom as the smallest form: every method here fits axes too
free_run    a model let loose on a run's inputs
==========  ===========================================================================
"""
