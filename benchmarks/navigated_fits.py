"""Parameters identified from navigated logs, with and without what ``navigate`` states about its errors.

    python -m benchmarks.navigated_fits [--first 1] [--seeds 20]

A tugboat of the simulator is driven by X, Y and N, with hidden biases, lever arm, delays and compass errors. The GPS is
lost from 30 to 50 s and from 70 to 85 s of 100 s, so u and v are less certain there. ``navigate`` states standard
deviations, correlation times and common errors. The bound is that of Cramer and Rao for such errors.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "plants"))

from navigation_logs import log
from tug_plants import HULL, TUG

from benchmarks.results import Figure, headline
from gcs_autotune.identify import fit
from gcs_autotune.identify.cramer_rao import with_bounds
from gcs_autotune.models import form_from
from gcs_autotune.navigation import Mounting, navigate_file
from gcs_autotune.trial import Trial, save_trial

LOST = ((30.0, 50.0), (70.0, 85.0))
FREE = ("X_udot", "X_u", "X_uu", "Y_vdot", "Y_rdot", "N_rdot", "Y_v", "Y_vv", "N_v", "N_r", "N_rr")
FORM = form_from(
    {
        "name": "tug",
        "dofs": ["surge", "sway", "yaw"],
        "free": list(FREE),
        "known": {"m": HULL["m"], "I_z": TUG["I_z"], "Y_r": TUG["Y_r"]},
        "inputs": {letter: {letter: 1} for letter in "XYN"},
    },
    "this benchmark",
)


def navigated(seed: int) -> Trial:
    """Return the run of a simulated log with gaps of GPS, as the command ``navigate`` writes it."""
    run, settings, _ = log("tugboat", seed, driven="XYN")
    channels = dict(run.channels)
    for name, own in run.channels.items():
        if name.startswith("gps"):
            kept = ~np.any([(own.t > a) & (own.t < b) for a, b in LOST], axis=0)
            channels[name] = replace(own, t=own.t[kept], values=own.values[kept])
    with tempfile.TemporaryDirectory() as folder:
        save_trial(replace(run, channels=channels), Path(folder) / "log.csv")
        return navigate_file(Path(folder) / "log.csv", Mounting(tuple(settings["centre"]))).runs[0]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--seeds", type=int, default=20)
    args = parser.parse_args()
    truth = np.array([TUG[n] for n in FREE])
    errors, stds, bounds = (np.zeros((args.seeds, 2, len(FREE))) for _ in range(3))
    for k in range(args.seeds):
        run = navigated(args.first + k)
        plain = replace(
            run, channels={n: c for n, c in run.channels.items() if not n.startswith(("std_", "memory_", "common"))}
        )
        for j, own in enumerate((run, plain)):
            found = with_bounds(fit(own, FORM, use=("u", "v", "r")), own).parameters
            errors[k, j] = [found[n].value for n in FREE] - truth
            stds[k, j], bounds[k, j] = np.array([(found[n].std, found[n].bound) for n in FREE]).T
        print(f"seed {args.first + k}: " + ", ".join(f"{np.sqrt(np.mean(e**2)):.2f}" for e in errors[k] / bounds[k, 0]))
    over = np.sqrt(np.mean((errors / bounds[:, :1]) ** 2, axis=0))
    inside = 100.0 * np.mean(np.abs(errors) < 1.96 * stds, axis=(0, 2))
    print(f"{'':8}{'rms error / bound, with both':>30}{'without':>10}{'rms z with':>12}")
    for i, name in enumerate(FREE):
        z = np.sqrt(np.mean((errors[:, 0, i] / stds[:, 0, i]) ** 2))
        print(f"{name:8}{over[0, i]:30.2f}{over[1, i]:10.2f}{z:12.2f}")
    ratio = float(np.exp(np.mean(np.log(over[0] / over[1]))))
    print(f"mean ratio of the errors with and without: {ratio:.2f}; 95 % intervals cover {inside[0]:.0f} % with and")
    print(f"{inside[1]:.0f} % without, of {args.seeds * len(FREE)} estimates")
    names = f"{args.seeds} logs with gaps of GPS"
    headline(
        "navigated_fits",
        "parameters from navigated logs",
        [
            Figure(f"error with what navigate states over that without, {names}", ratio, ""),
            Figure("rms error over the Cramer-Rao bound, median, with them", float(np.median(over[0])), ""),
            Figure("rms error over the Cramer-Rao bound, median, without", float(np.median(over[1])), ""),
            Figure("95 % intervals that cover, with them", float(inside[0]), "%"),
            Figure("95 % intervals that cover, without", float(inside[1]), "%"),
        ],
    )


if __name__ == "__main__":
    main()
