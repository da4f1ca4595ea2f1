"""Coupled models with effects: what identification fits from runs, and diagnosis searches with.

===========  =======================================================================
stretches    runs made ready, the plain base model
base         fitting the base model
fitting      any model with effects, fitted by output error (task, fitted)
===========  =======================================================================
"""
