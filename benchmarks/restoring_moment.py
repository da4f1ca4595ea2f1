"""Relays and free decays in pitch, flown on the simulated BlueROV2: error of what is identified from them.

    python -m benchmarks.restoring_moment [--seeds 5] [--runs DIR]

The commands are those of ``docs/fly.md``, with ``--force M``. ``--runs`` keeps the runs in a directory and reuses those
that are there. The seeds change the noise of the sensors only. Restoring moment and damping are compared per inertia,
because the unit of a normalised output depends on the size of the relay.

At the end the vehicle's body is released without an autopilot, from rest and from a drift. While the thrusters hold the
tilt they also push the craft ahead, so a flown craft is released from a drift.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.results import Figure, headline
from gcs_autotune.cli import main as gcs_autotune
from gcs_autotune.identify import AxisFit, fit_axis
from gcs_autotune.logs import load_runs
from gcs_autotune.trial import Channel, Mark, Trial
from sitl.catalogue import load_vehicle
from sitl.craft import Craft
from sitl.plants import Wrench, values_of

VEHICLE = "bluerov2-6dof"
PITCH, BODY = (values_of(load_vehicle(VEHICLE).tables[name]) for name in ("pitch", "body"))
"""Tables of its file."""
WEIGHT, BUOYANCY, ARM = BODY["weight"], BODY["buoyancy"], -BODY["z_B"]
"""N, N, m. The centre of gravity is the origin."""
TRUTH = {
    "gamma_theta": BUOYANCY * ARM / PITCH["alpha"],
    "beta_q": PITCH["beta"] / PITCH["alpha"],
    "beta_qq": PITCH["beta2"] / PITCH["alpha"],
}
"""Restoring moment, linear and quadratic damping per inertia, in SI."""
WORDS = {"gamma_theta": "restoring moment", "beta_q": "linear damping", "beta_qq": "quadratic damping"}
TILT, DRIFT = 0.28, 0.06
"""Angle [rad] and speed ahead [m/s] at the release of the flown runs. At constant depth w = u tan(theta)."""


def flown(folder: Path, name: str, seed: int) -> Trial:
    """Return the run of manoeuvre *name*, from *folder* if it is there."""
    at = folder / f"{name}-M-{seed}"
    if not at.exists():
        link = f"sitl:{VEHICLE}?seed={seed}"
        gcs_autotune(["fly", name, "--force", "M", "--connect", link, "--yes", "--out", str(at)])
    (run,) = load_runs(at / "trials" / f"03-{name}.csv")
    return run


def released(u: float) -> Trial:
    """Return a free decay of the vehicle's body from the speed *u* [m/s] ahead, at constant depth and without noise."""
    plant = Craft(load_vehicle(VEHICLE)).plant
    at, rows = plant.state, []
    at.z, at.theta, at.u, at.w = 5.0, TILT, u, u * math.tan(TILT)
    for k in range(6000):
        t = 1e-3 * k
        if k % 20 == 0:
            rows.append((t, at.theta, at.q, BUOYANCY * ARM * math.sin(TILT) if t < 1.0 else 0.0))
        if t >= 1.0:
            plant.step(Wrench(Z=(BUOYANCY - WEIGHT) * math.cos(at.theta)), 1e-3)
    t, theta, q, M = np.array(rows).T
    columns = (("theta", "rad", theta), ("q", "rad/s", q), ("M", "N m", M))
    return Trial("release", {n: Channel(n, unit, t, v) for n, unit, v in columns}, (Mark(1.0, "release"),))


def ratios(fit: AxisFit) -> dict[str, tuple[float, float]]:
    """Return name -> relative error of the ratio to the inertia, and its standard error."""
    names, found = list(fit.parameters), {}
    inertia = fit.parameters["alpha_q"]
    for name, truth in TRUTH.items():
        p = fit.parameters[name]
        if p.value == 0.0:
            continue
        a, b = inertia.std / inertia.value, p.std / p.value
        common = float(fit.correlation[names.index("alpha_q")][names.index(name)])
        found[name] = (p.value / inertia.value / truth - 1.0, math.sqrt(max(a * a + b * b - 2.0 * common * a * b, 0.0)))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--runs", type=Path)
    args = parser.parse_args()
    folder, figures = args.runs or Path(tempfile.mkdtemp()), []
    for kind in ("relay and decay", "decay alone"):
        rows = []
        for seed in range(1, args.seeds + 1):
            runs = [flown(folder, "free-decay", seed)]
            if kind == "relay and decay":
                runs.insert(0, flown(folder, "relay", seed))
            rows.append(ratios(fit_axis(runs, dof="pitch")))
            text = ", ".join(f"{WORDS[n]} {100.0 * e:+.1f} ± {100.0 * s:.1f} %" for n, (e, s) in rows[-1].items())
            print(f"{kind}, seed {seed}: {text}", flush=True)
        for name, word in WORDS.items():
            pairs = np.array([row[name] for row in rows if name in row])
            figures += [
                Figure(f"{kind}: mean error of {word}, {len(pairs)} seeds", 100.0 * float(pairs[:, 0].mean()), "%"),
                Figure(
                    f"{kind}: largest error of {word} / standard error", float(np.abs(pairs[:, 0] / pairs[:, 1]).max())
                ),
            ]
    for u, word in ((0.0, "from rest"), (DRIFT, f"at {DRIFT:g} m/s ahead")):
        error = ratios(fit_axis(released(u), dof="pitch"))["gamma_theta"][0]
        figures.append(Figure(f"body released {word}, without noise: error of restoring moment", 100.0 * error, "%"))
    headline("restoring_moment", "relays and free decays in pitch, identified together", figures)


if __name__ == "__main__":
    main()
