"""ZhaoUSV, table 3: percent errors of CyberShip II's coefficients by filter, least squares and output error.

    python benchmarks/ekf_vs_ls.py [--seeds 3] [--noise 0.001] [--motions circle zigzag]

The paper states neither its noise nor its circle. Here u, v, r (and for least squares their derivatives) are sampled at
10 Hz for 120 s with the printed noise. The circle starts from rest and ends by coasting: in a steady circle every
velocity is constant, and only three sums of the fifteen coefficients can be determined. Fits start as in the paper,
from +20 and -20 for all coefficients, and from 20 % off.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "plants"))

from cybership_plants import BEAM, FORM, KNOWN, TRUTH, sail

from benchmarks.results import Figure, headline
from gcs_autotune.identify import METHODS, fit
from gcs_autotune.trial import Trial

SEED_AVERAGES = {"EKF1": 4.13, "EKF2": 3.83, "LS1": 7.92, "LS2": 7.99}
"""ZhaoUSV, table 3, last row [%]."""

COUNTED = tuple(n for n, v in TRUTH.items() if v != 0.0)

STARTS = {
    "EKF from +20": dict.fromkeys(TRUTH, 20.0),
    "EKF from -20": dict.fromkeys(TRUTH, -20.0),
    "EKF from +20 %": {n: 1.2 * v for n, v in TRUTH.items()},
    "EKF from -20 %": {n: 0.8 * v for n, v in TRUTH.items()},
}


def least_squares(run: Trial) -> dict[str, float]:
    """ZhaoUSV (19)-(26): row by row on measured velocities and accelerations, without the added masses' coupling."""
    u, v, r, du, dv, dr = (run[n].values for n in ("u", "v", "r", "du", "dv", "dr"))
    T_1, T_2 = run["T_1"].values, run["T_2"].values
    m, I_z, x_G = KNOWN["m"], KNOWN["I_z"], KNOWN["x_G"]
    rows: list[tuple[tuple[str, ...], NDArray[np.float64], list[NDArray[np.float64]]]] = [
        (("X_udot", "X_u", "X_uu"), m * (du - v * r - x_G * r**2) - T_1 - T_2, [du, u, abs(u) * u]),
        (
            ("Y_vdot", "Y_rdot", "Y_v", "Y_r", "Y_vv", "Y_rr"),
            m * (dv + u * r + x_G * dr),
            [dv, dr, v, r, abs(v) * v, abs(r) * r],
        ),
        (
            ("N_vdot", "N_rdot", "N_v", "N_r", "N_vv", "N_rr"),
            I_z * dr + m * x_G * (dv + u * r) - BEAM / 2.0 * (T_1 - T_2),
            [dv, dr, v, r, abs(v) * v, abs(r) * r],
        ),
    ]
    found: dict[str, float] = {}
    for names, left, columns in rows:
        found.update(zip(names, np.linalg.lstsq(np.column_stack(columns), left, rcond=None)[0], strict=True))
    return found


def coupled_least_squares(run: Trial) -> dict[str, float]:
    """The same with the added masses' Coriolis forces of ZhaoUSV (1) in all three rows, solved together."""
    u, v, r, du, dv, dr = (run[n].values for n in ("u", "v", "r", "du", "dv", "dr"))
    T_1, T_2 = run["T_1"].values, run["T_2"].values
    m, I_z, x_G, o = KNOWN["m"], KNOWN["I_z"], KNOWN["x_G"], np.zeros_like(u)
    left = [
        m * (du - v * r - x_G * r**2) - T_1 - T_2,
        m * (dv + u * r + x_G * dr),
        I_z * dr + m * x_G * (dv + u * r) - BEAM / 2.0 * (T_1 - T_2),
    ]
    columns = {
        "X_udot": (du, u * r, -u * v),
        "Y_vdot": (-v * r, dv, u * v),
        "Y_rdot": (-(r**2), dr, u * r),
        "N_vdot": (o, o, dv),
        "N_rdot": (o, o, dr),
        "X_u": (u, o, o),
        "X_uu": (abs(u) * u, o, o),
        **{f"Y_{n}": (o, c, o) for n, c in (("v", v), ("r", r), ("vv", abs(v) * v), ("rr", abs(r) * r))},
        **{f"N_{n}": (o, o, c) for n, c in (("v", v), ("r", r), ("vv", abs(v) * v), ("rr", abs(r) * r))},
    }
    A = np.column_stack([np.concatenate(c) for c in columns.values()])
    found = np.linalg.lstsq(A, np.concatenate(left), rcond=None)[0]
    return dict(zip(columns, found, strict=True))


def percent(found: dict[str, float]) -> NDArray[np.float64]:
    """Return the absolute errors (13,) in percent of the truth."""
    return np.array([100.0 * abs(found[n] / TRUTH[n] - 1.0) for n in COUNTED])


def table(motion: str, seeds: int, noise: float) -> dict[str, NDArray[np.float64]]:
    """Return mean absolute percent errors (13,) by estimator, and the Cramer-Rao bound in percent."""
    columns: dict[str, list[NDArray[np.float64]]] = {}
    for seed in range(seeds):
        run = sail(motion, seed, noise=noise, acceleration_noise=10.0 * noise)
        for title, start in STARTS.items():
            found = fit(run, FORM, "ekf", start=start)
            columns.setdefault(title, []).append(percent({n: p.value for n, p in found.parameters.items()}))
        columns.setdefault("LS", []).append(percent(least_squares(run)))
        columns.setdefault("LS coupled", []).append(percent(coupled_least_squares(run)))
        others = [m for m in ("smoother", "prediction-error", "output-error") if METHODS[m].coupled is not None]
        for method in others:
            found = fit(run, FORM, method)
            columns.setdefault(method, []).append(percent({n: p.value for n, p in found.parameters.items()}))
            if method == "smoother":
                bound = [100.0 * abs(found.parameters[n].bound / TRUTH[n]) for n in COUNTED]
                columns.setdefault("bound", []).append(np.array(bound))
    return {title: np.mean(values, axis=0) for title, values in columns.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--noise", type=float, default=0.001, help="of u, v [m/s] and r [rad/s]; accelerations tenfold")
    parser.add_argument("--motions", nargs="+", default=["circle", "zigzag"])
    chosen = parser.parse_args()
    figures = []
    for motion in chosen.motions:
        begun = time.perf_counter()
        found = table(motion, chosen.seeds, chosen.noise)
        print(f"\n{motion}, {chosen.seeds} seeds, noise {chosen.noise:g} m/s and rad/s, accelerations tenfold [%]")
        print(f"{'':9s}" + "".join(f"{title:>18s}" for title in found))
        for i, name in enumerate(COUNTED):
            print(f"{name:9s}" + "".join(f"{column[i]:18.2f}" for column in found.values()))
        print(f"{'average':9s}" + "".join(f"{column.mean():18.2f}" for column in found.values()))
        figures += [Figure(f"{motion}, {title}, mean error", float(c.mean()), "%") for title, c in found.items()]
        print("ZhaoUSV: " + ", ".join(f"{n} {v} %" for n, v in SEED_AVERAGES.items()))
        weak = [n for n, b in zip(COUNTED, found["bound"], strict=True) if b > 10.0]
        print(f"bound above 10 % (not identifiable from this motion): {', '.join(weak) or 'none'}")
        print(f"{time.perf_counter() - begun:.0f} s")
    headline("ekf_vs_ls", "filters, least squares and output error on ZhaoUSV's vessel", figures)


if __name__ == "__main__":
    main()
