"""Bias, scatter and coverage of least squares and instrumental variables on the VideoRay's S-manoeuvres (Miskovic2007).

Run from the repository root: ``python -m benchmarks.regression_bias [seeds] [noise]``. The runs come from the tests'
own simulator (tests/plants/regression_plants.py), which shares nothing with the code under test.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "plants"))

from regression_plants import TRUTH, coupled, velocity_run

from benchmarks.results import Figure, headline
from gcs_autotune.identify import fit

VARIANTS = (
    ("least-squares", "derivative"),
    ("least-squares", "integral"),
    ("instrumental-variables", "derivative"),
    ("instrumental-variables", "integral"),
)


def assess(method: str, equation: str, seeds: int, noise: float) -> Figure:
    """Print the table of a variant and return its largest bias."""
    errors, stds, began = [], [], time.perf_counter()
    for seed in range(seeds):
        runs = [velocity_run(2 * seed, 2.0, 0.06, noise), velocity_run(2 * seed + 1, 1.5, 0.09, noise)]
        found = fit(runs, coupled(), method, equation=equation)
        errors.append([found.parameters[n].value - v for n, v in TRUTH.items()])
        stds.append([found.parameters[n].std for n in TRUTH])
    spent = (time.perf_counter() - began) / seeds
    print(f"\n{method}, {equation}: {seeds} seeds, noise {noise} m/s and rad/s, {spent:.2f} s each")
    print(f"{'':>8} {'bias %':>8} {'scatter %':>10} {'std %':>8} {'in 95 %':>8}")
    biases = []
    for i, (name, truth) in enumerate(TRUTH.items()):
        e, s = np.array(errors)[:, i], np.array(stds)[:, i]
        inside = 100.0 * np.mean(np.abs(e) < 1.96 * s)
        share = 100.0 / abs(truth)
        biases.append(share * abs(float(e.mean())))
        print(f"{name:>8} {share * e.mean():8.2f} {share * e.std():10.2f} {share * s.mean():8.2f} {inside:7.0f}%")
    return Figure(f"{method}, {equation}: largest bias, {seeds} seeds", max(biases), "%")


def main() -> None:
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 40
    noise = float(sys.argv[2]) if len(sys.argv) > 2 else 0.03
    figures = [assess(method, equation, seeds, noise) for method, equation in VARIANTS]
    headline("regression_bias", "bias of least squares and instrumental variables", figures)


if __name__ == "__main__":
    main()
