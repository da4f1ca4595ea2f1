"""Coupled models with effects: what identification fits from runs, and diagnosis searches with.

=================  ================================================================
effect_spec        effects asked for by name
forward_selection  one after the other, each from every start and place
by_output_error    the fit of all together
=================  ================================================================
"""
