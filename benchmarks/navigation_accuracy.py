"""Hidden biases, lever arms and delays found by ``navigate``, and its consistency.

    python -m benchmarks.navigation_accuracy [--first 301] [--seeds 50] [--seconds 100]

The logs come from the tests' own generator on the simulator's six-degree bodies (``tests/plants/navigation_logs.py``):
a tugboat with GPS and compass, an ROV with DVL, compass and depth. One log of each per seed.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "plants"))

from navigation_logs import log

from benchmarks.results import Figure, headline
from gcs_autotune.navigation import Mounting, navigate, readings_of, store_of

CRAFT = {"tugboat": ("gps", "compass"), "bluerov2-6dof": ("dvl", "compass", "depth")}
JUDGED = ("phi", "theta", "u", "v", "w", "p", "q", "r")
HERE = Path("log.csv")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=int, default=301, help="first seed")
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--seconds", type=float, default=100.0)
    args = parser.parse_args()
    z: dict[str, list[float]] = {}
    nees, nis, seconds, misses = [], [], [], []
    missed: dict[str, dict[str, list[float]]] = {craft: {n: [] for n in JUDGED} for craft in CRAFT}
    for craft, devices in CRAFT.items():
        for seed in range(args.first, args.first + args.seeds):
            run, settings, true = log(craft, seed, args.seconds, devices)
            begin = time.perf_counter()
            own = navigate(readings_of(store_of(run, HERE), HERE), Mounting(tuple(settings["centre"])))[0]
            seconds.append(time.perf_counter() - begin)
            for name, constant in own.constants.items():
                stem, _, axis = name.rpartition(" ")
                truth = settings[stem]["xyzpqr".index(axis) % 3] if stem in settings else settings[name]
                off = (constant.value - truth) / constant.std
                z.setdefault(name, []).append(off)
                if abs(off) > 3.0:
                    misses.append(f"{craft} seed {seed}: {name} {constant.value:.4g}, truth {truth:.4g}, z {off:.1f}")
            names = list(own.values)
            columns = np.hstack([true.at, true.angles, true.velocity, true.rates]).T
            error = np.column_stack([own.values[n] - np.interp(own.t, true.t, columns[i]) for i, n in enumerate(names)])
            at = [names.index(n) for n in JUDGED]
            inverse = np.linalg.inv(own.covariance[:, at][:, :, at])
            nees.append(float(np.mean(np.einsum("ki,kij,kj->k", error[:, at], inverse, error[:, at]))) / len(at))
            nis.append(own.nis)
            for name, i in zip(JUDGED, at, strict=True):
                missed[craft][name].append(float(np.sqrt(np.mean(error[:, i] ** 2))))
    print(f"{2 * args.seeds} logs of {args.seconds:g} s, {np.mean(seconds):.2f} s each")
    print(f"{'constant':24}{'rms z':>8}{'max':>7}{'> 3':>5}")
    for name, values in z.items():
        size = np.abs(values)
        print(f"{name:24}{np.sqrt(np.mean(size**2)):8.2f}{size.max():7.1f}{int(np.sum(size > 3.0)):5d}")
    print("\n".join(misses))
    for craft, rows in missed.items():
        print(f"rms error, {craft}: " + ", ".join(f"{n} {np.mean(v):.2g}" for n, v in rows.items()) + " (SI)")
    every = np.concatenate([np.abs(v) for v in z.values()])
    inside = 100.0 * float(np.mean(every < 3.0))
    print(f"{inside:.1f} % of {len(every)} constants within 3 sigma; NEES {np.mean(nees):.2f}, NIS {np.mean(nis):.2f}")
    figures = [
        Figure(f"hidden constants within 3 standard errors, {2 * args.seeds} logs", inside, "%"),
        Figure("NEES per signal (1 if consistent)", float(np.mean(nees)), ""),
        Figure("NIS (1 if consistent)", float(np.mean(nis)), ""),
    ]
    headline("navigation_accuracy", "a navigation solution of a log", figures)


if __name__ == "__main__":
    main()
