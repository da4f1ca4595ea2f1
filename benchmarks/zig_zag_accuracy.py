"""How accurate: zig-zags flown over MAVLink on Charlie, against her hidden truth and her own run without noise.

Run: ``python3 -m benchmarks.zig_zag_accuracy [--seeds 20] [--first 1] [--helm 20]``. Every seed flies one zig-zag of
equal angles with heading, gyro, speed and position noise as in her file, attitude at 10 Hz and servo outputs at 40 Hz.
Printed: the largest and the RMS error of Nomoto's K and T of the fitted model against the truth's reduction
(Miskovic2010, table 7.12, interpolated at the propeller voltage; goal 3 %), and of every figure against the same figure
of the run without noise (goal 1 degree or 2 %).
"""

from __future__ import annotations

import argparse
import math
import tempfile
from pathlib import Path

import numpy as np

from gcs_autotune.link import MemoryLink
from gcs_autotune.watch import SilentWatcher
from gcs_autotune.workflow import Connection, FlightResult, FlySettings, TuneSettings, Unattended, fly
from sitl import open_vehicle

FULL_RUDDER = math.radians(30.0)
FIGURES = ("first-overshoot", "second-overshoot", "initial-turning-time", "reach", "period")
ONE_DEGREE = math.radians(1.0)
VOLTS_SQUARED = (0.8 * 8.0) ** 2
"""CRUISE_THROTTLE 80 % of her 8 V."""


def truth() -> tuple[float, float]:
    """Return K [rad/s per full output] and T [s] at the throttle flown."""
    alpha, beta = (np.interp(VOLTS_SQUARED, [36.0, 49.0], pair) for pair in ([8.2, 9.155], [2.465, 2.745]))
    return FULL_RUDDER / float(beta), float(alpha / beta)


def flown(seed: int, helm: float, *, noise: bool = True) -> FlightResult:
    """Fly one zig-zag of *helm* [rad] to either side."""
    server = open_vehicle("charlie", seed=seed)
    if not noise:
        sensors = server.vehicle._sensors
        sensors._draws = tuple(lambda: 0.0 for _ in sensors._draws)
    link = MemoryLink(server)
    link.is_simulated = True
    with tempfile.TemporaryDirectory() as place:
        common = TuneSettings("heading", Connection("memory", opened=link), Path(place) / "run")
        options = {"heading": helm, "rudder": helm, "full-rudder": FULL_RUDDER}
        return fly(FlySettings("zig-zag", common, options), Unattended(), SilentWatcher(), "")


def figures(result: FlightResult) -> dict[str, float]:
    """Return the figures that are compared."""
    return {f.slug: f.reading.value for sheet in result.sheets for f in sheet.figures if f.slug in FIGURES}


def main() -> None:
    """Fly the seeds and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--helm", type=float, default=20.0)
    args = parser.parse_args()
    helm, (K, T) = math.radians(args.helm), truth()
    true = figures(flown(args.first, helm, noise=False))
    errors: dict[str, list[float]] = {name: [] for name in ("K", "T", *true)}
    shares: dict[str, list[float]] = {name: [] for name in true}
    for seed in range(args.first, args.first + args.seeds):
        result = flown(seed, helm)
        assert result.fit is not None
        model = result.fit.model
        errors["K"].append(1.0 / model.beta / K - 1.0)
        errors["T"].append(model.alpha / model.beta / T - 1.0)
        for name, value in figures(result).items():
            errors[name].append(value / true[name] - 1.0)
            goal = max(ONE_DEGREE, 0.02 * true[name]) if "overshoot" in name else 0.02 * true[name]
            shares[name].append(abs(value - true[name]) / goal)
    print(f"{args.seeds} zig-zags {args.helm:g}/{args.helm:g}: K {K:.4f} rad/s, T {T:.3f} s")
    for name, found in errors.items():
        rms, worst = math.sqrt(float(np.mean(np.square(found)))), max(map(abs, found))
        missed = sum(s > 1.0 for s in shares[name]) if name in shares else sum(abs(e) > 0.03 for e in found)
        print(f"{name:22s} rms {rms:7.2%}  worst {worst:7.2%}  beyond the goal {missed} of {args.seeds}")


if __name__ == "__main__":
    main()
