"""Error of the describing function: the worst parameter error of the matrix algorithm, and with measured harmonics.

Run from the repository root: ``python -m benchmarks.first_harmonic``. The processes of the tests, under a relay in
exact simulation, without noise and with noise of 1 % of the amplitude.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "plants"))
sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "identify"))

from test_heading_loop import CASES, flown
from test_linear_processes import PROCESSES, Process

from benchmarks.results import Figure, headline
from gcs_autotune.identify.frequency import harmonic_response
from gcs_autotune.identify.relay import loop_cycles, loop_process, loop_trial
from gcs_autotune.identify.relay.limit_cycle import find_cycles
from gcs_autotune.identify.relay.linear_process import heading_loop, identify_process, process_from_response
from gcs_autotune.models import TransferFunction


def by_harmonics(process: Process, noise: float) -> float:
    response = harmonic_response(process.runs(noise), "yaw", (1, 3))
    s = 1j * response.omega
    std = response.std / response.omega
    found = process_from_response(response.omega, response.value / s, *process.order, std=std)
    return float(process.errors(found).max())


def worst(found: TransferFunction, truth: TransferFunction) -> float:
    pairs = zip(found.denominator[1:], truth.denominator[1:], strict=True)
    return 100.0 * max(abs(f / t - 1.0) for f, t in pairs)


def main() -> None:
    head = ("process", "describing function", "harmonics", "with noise")
    print(f"{head[0]:>26} {head[1]:>20} {head[2]:>10} {head[3]:>11}   worst error [%]")
    rough_errors, exact_errors = [], []
    for name, process in PROCESSES.items():
        runs = process.runs()
        cycles = [cycle for run in runs for cycle in find_cycles(run, "yaw")]
        rough = float(process.errors(identify_process(cycles, *process.order)).max())
        noise = 0.01 * min(cycle.X_m for cycle in cycles)
        rough_errors.append(rough)
        exact_errors.append(by_harmonics(process, 0.0))
        print(f"{name:>26} {rough:20.1f} {exact_errors[-1]:10.2f} {by_harmonics(process, noise):11.1f}")
    for name, (truth, relays, _) in CASES.items():
        runs = flown(truth, relays)
        exact = loop_process(harmonic_response([loop_trial(r) for r in runs], "yaw", (1, 3)), 3, 1, gain=1.0)
        print(f"{name:>26} {worst(heading_loop(*loop_cycles(runs)), truth):20.1f} {worst(exact, truth):10.2f}")
    figures = [
        Figure("describing function, worst parameter error of all processes", max(rough_errors), "%"),
        Figure("measured harmonics, worst parameter error", max(exact_errors), "%"),
    ]
    headline("first_harmonic", "error of the describing function", figures)


if __name__ == "__main__":
    main()
