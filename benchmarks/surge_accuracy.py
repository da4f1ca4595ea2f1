"""Surge of the simulated boats by ``experiment surge``: errors, in units of the reported standard error, over seeds.

Run: ``python3 -m benchmarks.surge_accuracy [VEHICLE ...] [--seeds 20] [--save FILE]``. For inertia, damping and the
thrust curve's share of the square it prints the mean and rms error in standard errors (1 if these are true), how many
are beyond two, and the standard error. With ``--save FILE`` every flight is a line in FILE, and known ones are not
flown again.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from benchmarks.reach import Aboard
from benchmarks.results import Figure, headline
from gcs_autotune.identify.thrust import CURVE
from gcs_autotune.observer import SilentObserver
from gcs_autotune.workflow import TuneSettings, Unattended, experiment
from sitl import open_vehicle

__all__ = ["BOATS", "fly", "main"]

BOATS: Mapping[str, tuple[float, float]] = {"blueboat": (0.0, 0.0), "charlie": (1.0, 1.0)}
"""Boat -> share of its thrust, and of its damping, that goes with the square."""


def fly(boat: str, seed: int) -> dict[str, tuple[float, float, float]]:
    """Return what was found, its standard error and the truth: inertia, damping (per full thrust) and the share."""
    server = open_vehicle(boat, seed=seed)
    vehicle = server.vehicle
    hull, full = vehicle.plant.axis("surge"), vehicle.actuators.full["surge"]
    truth = {"alpha_u": hull.alpha / full, "beta_u": hull.beta / full, "beta_uu": hull.beta2 / full}
    with tempfile.TemporaryDirectory() as folder:
        settings = TuneSettings(Aboard(server=server), Path(folder) / "run", axis="surge")
        fit = experiment(settings, Unattended(), SilentObserver())
    damping = "beta_uu" if BOATS[boat][1] else "beta_u"
    found = {name: (fit.parameters[name].value, fit.parameters[name].std, truth[name]) for name in ("alpha_u", damping)}
    return {**found, "share": (fit.extra[CURVE]["square"], fit.extra[CURVE]["std"], BOATS[boat][0])}


def table(flights: Sequence[Mapping[str, Sequence[float]]]) -> list[str]:
    """Return a line per parameter of some *flights*."""
    lines = []
    for name in flights[0]:
        value, std, truth = np.array([f[name] for f in flights]).T
        z = (value - truth) / np.maximum(std, 1e-9)  # a damping that the fit removed has no error, and stands out
        lines.append(
            f"{name:<9}{truth[0]:>9.4g}{z.mean():>+8.2f}{np.sqrt(np.mean(z**2)):>7.2f}"
            f"{int(np.sum(np.abs(z) > 2.0)):>4} of {len(z):<4}{np.median(std):>9.2g}"
        )
    return lines


def main(argv: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("boats", nargs="*", metavar="VEHICLE", help=f"default: {', '.join(BOATS)}")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--save", type=Path, metavar="FILE")
    args = parser.parse_args(argv)
    saved: dict[tuple[str, int], dict[str, tuple[float, float, float]]] = {}
    if args.save is not None and args.save.is_file():
        for line in args.save.read_text(encoding="utf-8").splitlines():
            boat, seed, found = json.loads(line)
            saved[boat, seed] = found
    figures = []
    for boat in args.boats or BOATS:
        for seed in range(1, args.seeds + 1):
            if (boat, seed) in saved:
                continue
            saved[boat, seed] = fly(boat, seed)
            if args.save is not None:
                with args.save.open("a", encoding="utf-8") as file:
                    print(json.dumps([boat, seed, saved[boat, seed]]), file=file, flush=True)
        own = [saved[boat, seed] for seed in range(1, args.seeds + 1)]
        print(f"{boat}\n{'':<9}{'truth':>9}{'mean':>8}{'rms':>7}{'beyond 2':>11}{'std':>9}")
        print("\n".join(table(own)), flush=True)
        for name in own[0]:
            value, std, truth = np.array([f[name] for f in own]).T
            has = std > 0.0  # a damping that the fit removed has no standard error
            rms = float(np.sqrt(np.mean(((value - truth)[has] / std[has]) ** 2))) if has.any() else math.inf
            figures.append(Figure(f"{boat}, {name}, rms error / standard error", rms))
    headline("surge_accuracy", "experiment surge: errors, in units of the reported standard error", figures)


if __name__ == "__main__":
    main()
