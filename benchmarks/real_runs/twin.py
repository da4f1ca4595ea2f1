"""How well can a course-unstable craft be foretold at all? A tanker that *is* the form, in the moment that wanders.

``python3 -m benchmarks.real_runs.twin [--seeds 4] [--moment 0.000775]`` fits the form to the measured zig-zags, sails
the fitted craft through the same zig-zags (its rudder answers its own heading) in a yaw moment that wanders, adds the
noise of the sensors, fits the form anew to the same four runs and lets it loose on the other three: what is lost there
is neither the form's fault nor the method's. ``--moment`` [rad/s^2]: its standard deviation as ``diagnose`` finds it
beside its causes; 0 for none.
"""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from benchmarks.real_runs.methods.ours import fitted, train
from benchmarks.real_runs.methods.plain_scipy import rudder
from benchmarks.real_runs.runs import CRAFTS, OUTPUTS, STEP, Run, gridded, load
from benchmarks.real_runs.score import fit_percents
from benchmarks.results import Figure, headline

Array = NDArray[np.float64]

TERMS = (
    ("X_0", "X_uu", "X_vr", "X_|r||r|", "X_|delta||delta|"),
    ("Y_uv", "Y_ur", "Y_|v|v", "Y_|r|r", "Y_delta"),
    ("N_uv", "N_ur", "N_|v|v", "N_|r|r", "N_delta"),
)
"""The form's derivatives in the order of :func:`.plain_scipy.rudder`."""

MEMORY = 6.6
"""Seconds the moment lasts, as ``diagnose`` finds it."""

NOISE = np.array([2e-3, 2e-3, 1e-4, 5e-4])
"""Standard deviation of u, v [m/s], r [rad/s] and psi [rad], about that of the basin's records."""

HELM_RATE = math.radians(15.8)
"""Of the model's rudder [rad/s]."""

FINER = 4
"""Steps of the simulation to a sample."""


def sailed(real: Run, coefficients: Sequence[Array], moment: float, seed: int) -> Run:
    """Return the run *real*, a zig-zag by its name, as the craft of these coefficients sails it."""
    named = re.match(r"Z_(\d+)_(\d+)", real.name)
    assert named is not None
    helm, check = (math.radians(float(n)) for n in named.groups())
    rng, h = np.random.default_rng(seed), STEP / FINER
    kept = math.exp(-h / MEMORY)
    first = int(np.argmax(np.abs(real.U[:, 0]) > 0.6 * helm))
    goal, begun = helm * float(np.sign(real.U[first, 0])), real.t[first]
    answers = float(np.sign(coefficients[2][-1]))
    x, delta, push = np.array([real.Y[0, 0], 0.0, 0.0, 0.0]), 0.0, 0.0
    states, helms = np.zeros((len(real.t), 4)), np.zeros((len(real.t), 1))
    for k, t in enumerate(real.t):
        states[k], helms[k] = x, delta
        for _ in range(FINER):
            if t >= begun:
                if x[3] * answers * math.copysign(1.0, goal) > check:
                    goal = -goal
                delta += float(np.clip(goal - delta, -HELM_RATE * h, HELM_RATE * h))
            rows = rudder(x[:3, None], np.array([[delta]]))
            slope = [float(c @ np.ravel(row)) for c, row in zip(coefficients, rows, strict=True)]
            push = kept * push + rng.normal(0.0, moment * math.sqrt(1.0 - kept**2))
            x = x + h * np.array([slope[0], slope[1], slope[2] + push, x[2]])
    seen = states + rng.normal(size=states.shape) * NOISE
    return Run(real.name, real.t, helms, seen[:, :3], seen[:, 3], np.ones((len(real.t), 3), dtype=bool))


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the fit of every held-out run, seed by seed."""
    parser = argparse.ArgumentParser(prog="python3 -m benchmarks.real_runs.twin", description=__doc__)
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--moment", type=float, default=7.75e-4)
    asked = parser.parse_args(arguments)
    craft = CRAFTS["kvlcc2"]
    real = {n: gridded(load(craft, n), craft.inputs) for n in (*craft.train, *craft.held)}
    truth = fitted([real[n] for n in craft.train], craft.form)
    coefficients = [np.array([truth[n] for n in row]) for row in TERMS]
    print(f"fit of {', '.join(OUTPUTS)}, psi [%] on", ", ".join(craft.held))
    first: list[float] = []
    for seed in range(1, asked.seeds + 1):
        runs = {n: sailed(r, coefficients, asked.moment, 100 * seed + i) for i, (n, r) in enumerate(real.items())}
        with np.errstate(all="ignore"):
            foretell = train([runs[n] for n in craft.train], craft.form)
            scores = [fit_percents(runs[n], *foretell(runs[n])) for n in craft.held]
        first.append(scores[0][OUTPUTS[0]])
        told = (" ".join(f"{max(v, -999.0):.0f}" for v in s.values()) for s in scores)
        print(f"seed {seed}:", " | ".join(told), flush=True)
    name = f"{craft.held[0]}, {OUTPUTS[0]}"
    figures = [
        Figure(f"{name}, best of {asked.seeds} seeds of the true form", max(first), "%"),
        Figure(f"{name}, worst of {asked.seeds} seeds of the true form", min(first), "%"),
    ]
    headline("real_runs.twin", "limit of prediction for a course-unstable craft", figures)


if __name__ == "__main__":
    main()
