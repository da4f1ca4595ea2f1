"""The blind suite: effects drawn at random, hidden in runs of the simulator's tank, and looked for by the diagnosis.

===========  ==========================================================================================
craft        a bare hull, its commands' sizes, its sensors and their noise, drawn at random
flying       open-loop manoeuvres drawn at random
sizes        how the place and the numbers of each effect of the book are drawn
foreign      effects that are in nobody's book, kept here
plain        the plain model fitted by hand: how much an effect matters, without asking the diagnosis
case         one case drawn: runs with a secret
referee      the diagnosis asked, its answer against the secret
scoring      confusion matrix, rates with bounds, running tallies
===========  ==========================================================================================

``python3 -m benchmarks.blind`` runs it; ``tests/diagnose/test_blind_small.py`` runs a small fixed part. Drawing knows
the simulator only; the answers come from :func:`gcs_autotune.diagnose.diagnose`, which shares no code with it.
"""
