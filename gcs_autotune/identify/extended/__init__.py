"""Coupled models with effects, which identification fits to runs and diagnosis uses in its search.

=================  ================================================================
effect_spec        effects that a user requests by name
by_output_error    adds effects one by one, each from every start and place, then fits all together
=================  ================================================================
"""
