"""Accuracy of single-axis identification over noise seeds against the Cramer-Rao bound, and its speed.

Run from the repository root: ``python -m benchmarks.identification_accuracy [seeds]``. It is the study
``benchmarks/studies/identification_accuracy.toml``; a stopped run continues. The records come from the tests' own
simulator (tests/plants/axis_plants.py), which shares nothing with the code under test.
"""

from __future__ import annotations

import sys
import time
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "plants"))

from axis_plants import DEG, Relay, fly

from benchmarks.results import Figure, headline
from benchmarks.studies import rows_of
from gcs_autotune.identify import fit_axis
from gcs_autotune.identify.cramer_rao import cramer_rao
from gcs_autotune.models import SingleDof
from gcs_autotune.trial import Channel, Trial

NAMES = {"alpha_r": "alpha", "beta_r": "beta", "beta_rr": "beta_quadratic"}
BOATS = {
    "boat, affine drag": ((0.36, 0.12, 0.05, 0.02), 0.0, (0.3, 0.6), 8.0, 0.003),
    "videoray, nonlinear": ((0.0309, 0.0, 0.0689, 0.003), 0.0, (0.04, 0.12), 15.0, 0.01),
    "videoray, delay 0.2 s": ((0.0309, 0.0, 0.0689, 0.003), 0.2, (0.04, 0.12), 15.0, 0.01),
    "automarine, nonlinear": ((0.0413, 0.0, 0.0722, 0.0), 0.0, (0.034, 0.0646), 15.0, 0.01),
    "falcon, affine": ((80.0, 300.0, 10.0, 0.0), 0.0, (150.0, 300.0), 12.0, 0.002),
}
"""Name -> (plant, delay [s], relay outputs, x_a [deg], heading noise [rad])."""


@cache
def flown(boat: str, duration: float = 60.0) -> list[Trial]:
    plant, delay, outputs, x_a, _ = BOATS[boat]
    trials = []
    for C in outputs:
        t, psi, _, N = fly(plant, Relay(C, x_a * DEG), duration, dt=0.1, delay=delay, h=0.01)
        trials.append(Trial(f"C = {C}", {"psi": Channel("psi", "rad", t, psi), "N": Channel("N", "N m", t, N)}))
    return trials


def noisy(trial: Trial, std: float, rng: np.random.Generator) -> Trial:
    psi = trial["psi"]
    values = psi.values + rng.normal(0.0, std, len(psi))
    return Trial(trial.name, {"psi": Channel("psi", "rad", psi.t, values), "N": trial["N"]})


def fitted(seed: int, boat: str) -> dict[str, Any]:
    """Return structure, parameters with standard errors, and the mean result of IS-O under one seed."""
    found = fit_axis([noisy(t, BOATS[boat][-1], np.random.default_rng(seed)) for t in flown(boat)])
    numbers = {
        name: {
            "value": found.parameters[name].value,
            "std": found.parameters[name].std,
            "iso": np.mean([getattr(e, key) for e in found.iso]),
        }
        for name, key in NAMES.items()
    }
    return {**numbers, "structure": found.structure}


def assess(boat: str, seeds: int) -> list[float]:
    """Print the table of *boat* and return the rms errors of its parameters over their Cramer-Rao bounds."""
    plant, delay, _, _, std = BOATS[boat]
    clean = flown(boat)
    truth = dict(zip(NAMES, plant, strict=False))
    free = [n for n, v in zip(("alpha", "beta", "beta_quadratic"), plant, strict=False) if v] + ["delta"]
    bound = cramer_rao(SingleDof("yaw", "N m", *plant, delay=delay), clean, std, free + ["delay"] * (delay > 0.0))
    rows = rows_of("identification_accuracy", 1, only={"argument.boat": (boat,)}, repeats=seeds)
    structures = ", ".join(sorted({row["structure"] for row in rows}))
    print(f"\n{boat}: {seeds} seeds, heading noise {std} rad, chosen: {structures}")
    print(f"{'':>9} {'truth':>9} {'bias/limit':>10} {'rms/bound':>9} {'in 95 %':>8} {'rms':>8} {'IS-O rms':>9}")
    over_bound = []
    for name, key in NAMES.items():
        if key not in free:
            continue
        errors = np.array([row[f"{name}.value"] for row in rows]) - truth[name]
        stds = np.array([row[f"{name}.std"] for row in rows])
        iso = np.array([row[f"{name}.iso"] for row in rows]) - truth[name]
        limit = 2.5 * errors.std(ddof=1) / np.sqrt(seeds)
        rms = np.sqrt(np.mean(errors**2))
        over_bound.append(float(rms / bound[key]))
        print(
            f"{name:>9} {truth[name]:9.4g} {abs(errors.mean()) / limit:10.2f} {rms / bound[key]:9.2f} "
            f"{100 * np.mean(np.abs(errors) <= 1.96 * stds):7.0f}% {100 * rms / truth[name]:7.2f}% "
            f"{100 * np.sqrt(np.mean(iso**2)) / truth[name]:8.1f}%"
        )
    return over_bound


def time_it() -> None:
    rng = np.random.default_rng(0)
    trials = [noisy(t, 0.01, rng) for t in flown("videoray, nonlinear", 150.0)]
    fit_axis(trials)
    begin = time.perf_counter()
    for _ in range(5):
        fit_axis(trials)
    print(f"\nfit of 2 runs x {len(trials[0]['psi'])} samples, warm: {(time.perf_counter() - begin) / 5:.3f} s")


def main() -> None:
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 50
    print("bias/limit: |mean error| over 2.5 standard errors of the mean, must stay below 1")
    print("rms/bound: over the Cramer-Rao bound, must stay below 1.3")
    worst = [
        Figure(f"{boat}, rms error / Cramér-Rao bound, worst", max(assess(boat, seeds)), most=1.3) for boat in BOATS
    ]
    measures = "one axis: bias, scatter against the Cramér-Rao bound, coverage"
    headline("identification_accuracy", measures, sorted(worst, key=lambda figure: -figure.value))
    time_it()


if __name__ == "__main__":
    main()
