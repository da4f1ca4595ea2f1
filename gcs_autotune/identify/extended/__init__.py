"""Coupled models with effects, which identification fits to runs and diagnosis uses in its search.

=================  ================================================================
effect_spec        effects that a user requests by name
forward_selection  adds effects one by one, each from every start and place
by_output_error    the joint fit of all parameters
=================  ================================================================
"""
