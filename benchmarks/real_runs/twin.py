"""Limit of prediction for a course-unstable craft, with a simulated tanker whose model form is exact.

``python3 -m benchmarks.real_runs.twin [--seeds 4] [--moment 0.000775]`` fits the form to the measured zig-zags. It then
simulates the same zig-zags with the fitted craft, a drifting yaw moment and sensor noise. The form is fitted again to
four of these runs, and simulated on the other three. The remaining error is due neither to the form nor to the method.
``--moment``: standard deviation of the moment [rad/s^2], as ``diagnose`` estimates it; 0: none.
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
"""Correlation time of the moment [s], as ``diagnose`` estimates it."""

NOISE = np.array([2e-3, 2e-3, 1e-4, 5e-4])
"""Standard deviation of u, v [m/s], r [rad/s] and psi [rad], close to that of the measured runs."""

HELM_RATE = math.radians(15.8)
"""Rate of the rudder [rad/s]."""

FINER = 4
"""Simulation steps per sample."""


def simulated(real: Run, coefficients: Sequence[Array], moment: float, seed: int) -> Run:
    """Return the zig-zag *real*, simulated with these coefficients."""
    match = re.match(r"Z_(\d+)_(\d+)", real.name)
    assert match is not None
    helm, check = (math.radians(float(n)) for n in match.groups())
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
    measured = states + rng.normal(size=states.shape) * NOISE
    return Run(real.name, real.t, helms, measured[:, :3], measured[:, 3], np.ones((len(real.t), 3), dtype=bool))


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the fit of every held-out run by seed."""
    parser = argparse.ArgumentParser(prog="python3 -m benchmarks.real_runs.twin", description=__doc__)
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--moment", type=float, default=7.75e-4)
    options = parser.parse_args(arguments)
    craft = CRAFTS["kvlcc2"]
    real = {n: gridded(load(craft, n), craft.inputs) for n in (*craft.train, *craft.held)}
    truth = fitted([real[n] for n in craft.train], craft.form)
    coefficients = [np.array([truth[n] for n in row]) for row in TERMS]
    print(f"fit of {', '.join(OUTPUTS)}, psi [%] on", ", ".join(craft.held))
    first: list[float] = []
    for seed in range(1, options.seeds + 1):
        runs = {n: simulated(r, coefficients, options.moment, 100 * seed + i) for i, (n, r) in enumerate(real.items())}
        with np.errstate(all="ignore"):
            predict = train([runs[n] for n in craft.train], craft.form)
            scores = [fit_percents(runs[n], *predict(runs[n])) for n in craft.held]
        first.append(scores[0][OUTPUTS[0]])
        texts = (" ".join(f"{max(v, -999.0):.0f}" for v in s.values()) for s in scores)
        print(f"seed {seed}:", " | ".join(texts), flush=True)
    name = f"{craft.held[0]}, {OUTPUTS[0]}"
    figures = [
        Figure(f"{name}, best of {options.seeds} seeds of the true form", max(first), "%"),
        Figure(f"{name}, worst of {options.seeds} seeds of the true form", min(first), "%"),
    ]
    headline("real_runs.twin", "limit of prediction for a course-unstable craft", figures)


if __name__ == "__main__":
    main()
