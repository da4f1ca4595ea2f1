"""Erunsal2017's sequence of experiments on its tugboat: percent error of all 23 parameters (table 1, errata applied).

    python -m benchmarks.tugboat_sequence [--seeds 3]

The runs come from the tests' own simulator (``tests/plants/tug_plants.py`` has the truth and the noise).
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "plants"))

from tug_plants import NOISE, TUG, WIND_NOISE, sea_trials

from benchmarks.results import Figure, headline
from gcs_autotune.identify.plan import run_plan
from gcs_autotune.identify.plan.plan import PLANS


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=3)
    seeds = parser.parse_args().seeds
    values, stds, means, finals, seconds = [], [], [], [], []
    for seed in range(1, seeds + 1):
        trials = sea_trials(seed)
        begin = time.perf_counter()
        result = run_plan(PLANS["usv_6dof"], trials)
        seconds.append(time.perf_counter() - begin)
        values.append([result.parameters[n].value for n in TUG])
        stds.append([result.parameters[n].std for n in TUG])
        plain = {a.name: a.mean for a in result.agreements}
        own = {n: p.value for s in result.steps for n, p in s.fit.parameters.items() if n in s.step.isolated}
        means.append([plain.get(n, own.get(n, result.combined[n])) for n in TUG])
        finals.append(np.nan if result.final is None else result.final.fit_percent)
    truth = np.array(list(TUG.values()))
    error, plain_error = np.array(values) - truth, np.array(means) - truth
    z = error / np.array(stds)
    print(f"noise: {', '.join(f'{n} {s:g}' for n, s in NOISE.items())}; wind {WIND_NOISE:g} m/s (SI); {seeds} seeds")
    print(f"{'':8}{'truth':>10}{'rms error %':>13}{'plain mean %':>14}{'std %':>9}{'rms z':>8}")
    for i, name in enumerate(TUG):
        scale = 100.0 / abs(truth[i])
        row = [np.sqrt(np.mean(e[:, i] ** 2)) * scale for e in (error, plain_error)]
        std = float(np.mean(np.array(stds)[:, i])) * scale
        print(f"{name:8}{truth[i]:10.4f}{row[0]:13.2f}{row[1]:14.2f}{std:9.2f}{np.sqrt(np.mean(z[:, i] ** 2)):8.2f}")
    inside = 100.0 * np.mean(np.abs(z) < 1.96)
    print(f"95 % intervals cover {inside:.0f} % of {z.size} estimates; final validation {np.mean(finals):.1f} %")
    sizes = np.sqrt(np.mean(error**2, axis=0)) / np.abs(truth) * 100.0
    figures = [
        Figure(f"rms error, median of {len(TUG)} parameters, {seeds} seeds", float(np.median(sizes)), "%"),
        Figure("95 % intervals that cover", float(inside), "%"),
    ]
    headline("tugboat_sequence", "a sequence of experiments (Erunsal2017)", figures)
    print(f"{np.mean(seconds):.1f} s a sequence. Y_r is zero but for its last digit: read its error as absolute.")


if __name__ == "__main__":
    main()
