"""The blind suite: it hides random effects in runs of the open-loop simulator, and diagnoses the runs.

===========  ==========================================================================================
craft        random hull, largest commands, sensors and sampling
manoeuvres   random open-loop manoeuvres
recipes      random place and parameters of each effect of the catalogue
foreign      effects that are not in the catalogue
plain_model  fit of the plain model without the diagnosis: how large the error due to an effect is
case         one random case: runs with hidden effects
referee      the diagnosis of a case, compared with the hidden effects
scoring      confusion matrix, rates with confidence bounds
===========  ==========================================================================================

``python3 -m benchmarks.blind`` runs it; ``tests/diagnose/test_blind_small.py`` runs a small fixed part. The cases
come from the simulator alone. It shares no code with :func:`gcs_autotune.diagnose.diagnose`.
"""
