"""Coupled models with effects: what identification fits from runs, and diagnosis searches with.

===========  =======================================================================
fitting      any model with effects, fitted by output error (task, fitted)
===========  =======================================================================
"""
