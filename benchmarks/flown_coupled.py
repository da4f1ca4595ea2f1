"""S-manoeuvres flown over MAVLink on the coupled VideoRay, identified as a coupled model.

Run: ``python3 -m benchmarks.flown_coupled [--seeds 5] [--first 1] [--duration 60]``. Every seed flies one S-manoeuvre
ahead and astern (half of full thrust, 40 % yaw moment) with the noise, the 2 degree compass and the link of its file.
It prints the terms kept of the form ``horizontal``, each parameter's error in standard errors and percent of the truth
(Miskovic2007, final matrix; goal 3 standard errors and 3 %), how often all are within, and the Coriolis products if
they are free: rv in surge, ur in sway, uv in yaw.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.results import count, headline
from gcs_autotune.experiments import eliminate
from gcs_autotune.identify import Fit, fit
from gcs_autotune.link import MemoryLink
from gcs_autotune.models import FORMS
from gcs_autotune.observer import SilentObserver
from gcs_autotune.trial import Trial
from gcs_autotune.workflow import CommonSettings, Connection, FlySettings, Unattended, fly
from sitl import open_vehicle

FULL = {"X": 8.0, "N": 0.1709}
TRUTH = {
    "X_udot": -8.2372,
    "Y_vdot": -8.2372,
    "N_rdot": -0.0372,
    "X_u": -4.4283,
    "Y_v": -14.9571,
    "N_r": -0.0997,
}
PRODUCTS = {"X_vr": 8.2372, "Y_ur": -8.2372, "N_uv": 0.0}
"""What Coriolis' forces come to with these inertias: in yaw, surge and sway cancel."""


def flown(seed: int, duration: float) -> Trial:
    """Fly one S-manoeuvre and return its record in N and N m."""
    server = open_vehicle("videoray-coupled", seed=seed, parameters={"SCHED_LOOP_RATE": 100.0})
    link = MemoryLink(server)
    link.is_simulated = True
    with tempfile.TemporaryDirectory() as place:
        common = CommonSettings(Connection("memory", opened=link), Path(place) / "run", throttle=0.5)
        settings = FlySettings("s-manoeuvre", common, {"steering": 0.4, "duration": duration})
        trial = fly(settings, Unattended(), SilentObserver(), "").trial
    assert trial is not None
    return trial.with_full_scale(FULL)


def products(run: Trial) -> Fit:
    """Return the fit whose Coriolis forces are products of their own."""
    free = (*TRUTH, "N_0", *PRODUCTS)
    plain = FORMS["horizontal"].without(*(n for n in FORMS["horizontal"].free if n not in free))
    # nothing drives sway: per unit of its inertia
    return fit(run, replace(plain.fixing({"Y_vdot": TRUTH["Y_vdot"]}).freeing(*PRODUCTS), coriolis=False))


def main() -> None:
    """Fly the seeds and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--duration", type=float, default=60.0)
    args = parser.parse_args()
    kept: Counter[str] = Counter()
    errors: dict[str, list[tuple[float, float]]] = {n: [] for n in TRUTH}
    coriolis: dict[str, list[tuple[float, float]]] = {n: [] for n in PRODUCTS}
    within = 0
    for seed in range(args.first, args.first + args.seeds):
        run = flown(seed, args.duration)
        chosen = eliminate(run, FORMS["horizontal"]).chosen
        found = chosen.fit
        assert found is not None
        kept.update(n for n in chosen.form.free if n not in TRUTH)
        for name, true in TRUTH.items():
            p = found.parameters[name]
            errors[name].append(((p.value - true) / p.std, p.value / true - 1.0))
        within += all(abs(errors[n][-1][0]) <= 3.0 and abs(errors[n][-1][1]) <= 0.03 for n in TRUTH)
        free = products(run)
        for name in PRODUCTS:
            coriolis[name].append((free.parameters[name].value, free.parameters[name].std))
    all_six = count("runs with all terms within 3 standard errors and 3 %", within, args.seeds, least=1.0)
    headline("flown_coupled", "S-manoeuvres flown over MAVLink, read back as a coupled model", [all_six])
    for name, found_errors in errors.items():
        z, rel = np.abs(np.array(found_errors)).T
        print(f"{name:7s} worst {z.max():5.2f} standard errors, {rel.max():6.2%}; rms {np.sqrt(np.mean(rel**2)):6.2%}")
    print("kept beside them:", ", ".join(f"{n} {k} times" for n, k in kept.most_common()) or "nothing")
    for name, pairs in coriolis.items():
        mean, std = np.mean(pairs, axis=0)
        print(f"{name:5s} {mean:8.3f} +- {std:.3f}, truth {PRODUCTS[name]:.3f}")


if __name__ == "__main__":
    main()
