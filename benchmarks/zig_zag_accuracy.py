"""Zig-zags flown over MAVLink, against the craft's hidden truth and its own run without noise.

Run: ``python3 -m benchmarks.zig_zag_accuracy [--craft charlie] [--seeds 20] [--first 1] [--helm 20]``. Every seed
flies one zig-zag of equal angles (without a rudder: ``--steering`` of full) with the noise of heading, gyro, speed and
position of its file, attitude at 10 Hz and servo outputs at 40 Hz. It prints the largest and rms errors of:

* Nomoto's K and T of the fitted model against the truth's reduction (K = G(0), T = T_1 + T_2 - T_3 of sway and yaw at
  the steady speed ahead; goal 3 %),
* the K that ``figures`` prints (per radian of rudder if there is one) against the same truth,
* every other figure against that of the run without noise (goal 1 degree or 2 %).
"""

from __future__ import annotations

import argparse
import math
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from benchmarks.results import Figure, headline
from gcs_autotune.link import MemoryLink
from gcs_autotune.observer import SilentObserver
from gcs_autotune.workflow import CommonSettings, Connection, FlightResult, FlySettings, Unattended, fly
from sitl import load_vehicle, open_vehicle
from sitl.plants import Wrench

FIGURES = ("first-overshoot", "second-overshoot", "initial-turning-time", "reach", "period")
ONE_DEGREE = math.radians(1.0)
NUDGE = 1e-5


def truth(craft: str, share: float) -> tuple[float, float]:
    """Return K [rad/s per full output] and T [s] at the cruise throttle; NaN where the craft is not stable ahead.

    *share*: the steering flown, about which a nonlinear actuator is taken.
    """
    data = load_vehicle(craft)
    body, actuators, wrench = data.make_plant(), data.make_actuators(), Wrench()
    throttle = data.parameters["CRUISE_THROTTLE"] / 100.0
    actuators.apply({"N": 0.0, "X": throttle}, body.parameters, wrench)
    Y_0, N_0, wrench.Y, wrench.N = wrench.Y, wrench.N, 0.0, 0.0
    for _ in range(6000):
        body.step(wrench, 0.02)
    u = body.state.u

    def rates(v: float, r: float, part: float) -> np.ndarray:
        actuators.apply({"N": part, "X": throttle}, body.parameters, wrench)
        wrench.Y, wrench.N = wrench.Y - Y_0, wrench.N - N_0
        _, vdot, _, _, _, rdot = body.acceleration((u, v, 0.0, 0.0, 0.0, r), wrench)
        return np.array([vdot, rdot])

    A = np.column_stack([rates(NUDGE, 0.0, 0.0), rates(0.0, NUDGE, 0.0)]) / NUDGE
    b = (rates(0.0, 0.0, share) - rates(0.0, 0.0, -share)) / (2.0 * share)
    if "sway" not in body.dofs:
        return float(-b[1] / A[1, 1]), float(-1.0 / A[1, 1])
    if np.linalg.eigvals(A).real.max() >= 0.0:
        return math.nan, math.nan
    # r/N = (n_1 s + n_0)/(s^2 + d_1 s + d_0)
    d_1, d_0 = -float(np.trace(A)), float(np.linalg.det(A))
    n_1, n_0 = float(b[1]), float(A[1, 0] * b[0] - A[0, 0] * b[1])
    return n_0 / d_0, d_1 / d_0 - n_1 / n_0


def flown(craft: str, seed: int, options: Mapping[str, float], *, noise: bool = True) -> FlightResult:
    """Fly one zig-zag."""
    server = open_vehicle(craft, seed=seed)
    if not noise:
        sensors = server.vehicle._sensors
        sensors._draws = tuple(lambda: 0.0 for _ in sensors._draws)
    link = MemoryLink(server)
    link.is_simulated = True
    with tempfile.TemporaryDirectory() as place:
        common = CommonSettings(Connection("memory", opened=link), Path(place) / "run")
        return fly(FlySettings("zig-zag", common, options), Unattended(), SilentObserver(), "")


def figures(result: FlightResult) -> dict[str, float]:
    """Return the figures that are compared."""
    return {f.slug: f.reading.value for sheet in result.sheets for f in sheet.figures if f.slug in FIGURES}


def main() -> None:
    """Fly the seeds and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--helm", type=float, default=20.0)
    parser.add_argument("--craft", default="charlie")
    parser.add_argument("--steering", type=float, default=0.3)
    args = parser.parse_args()
    helm = math.radians(args.helm)
    rudder = load_vehicle(args.craft).tables["yaw"].get("full_rudder")
    full = float(rudder["value"]) if rudder else math.nan
    share = helm / full if rudder else args.steering
    options = {"heading": helm, **({"rudder": helm, "full-rudder": full} if rudder else {"steering": share})}
    K, T = truth(args.craft, share)
    if math.isnan(K):
        parser.exit(1, f"{args.craft} is not stable on its course: it has no Nomoto reduction, and flies no zig-zag\n")
    true = figures(flown(args.craft, args.first, options, noise=False))
    errors: dict[str, list[float]] = {name: [] for name in ("K", "T", "K of the sheet", *true)}
    shares: dict[str, list[float]] = {name: [] for name in true}
    for seed in range(args.first, args.first + args.seeds):
        result = flown(args.craft, seed, options)
        if result.fit is not None:
            model = result.fit.model
            errors["K"].append(1.0 / model.beta / K - 1.0 if model.beta else math.nan)
            errors["T"].append(model.alpha / model.beta / T - 1.0 if model.beta else math.nan)
        (sheet,) = result.sheets
        errors["K of the sheet"].append(sheet["K"].reading.value / (K / full if rudder else K) - 1.0)
        for name, value in figures(result).items():
            errors[name].append(value / true[name] - 1.0)
            goal = max(ONE_DEGREE, 0.02 * true[name]) if "overshoot" in name else 0.02 * true[name]
            shares[name].append(abs(value - true[name]) / goal)
    how = f"{args.helm:g}/{args.helm:g}" if rudder else f"{args.helm:g} deg at {share:.0%}"
    kept: list[Figure] = []
    print(f"{args.seeds} zig-zags {how} on {args.craft}: K {K:.4f} rad/s, T {T:.3f} s")
    for name, found in errors.items():
        if not found:
            continue
        rms, worst = math.sqrt(float(np.mean(np.square(found)))), max(map(abs, found))
        goal_of = 3.0 if name in ("K", "T", "K of the sheet") else None
        kept.append(Figure(f"{args.craft}, {name}, worst", 100.0 * worst, "%", most=goal_of))
        missed = sum(s > 1.0 for s in shares[name]) if name in shares else sum(not abs(e) <= 0.03 for e in found)
        print(f"{name:22s} rms {rms:7.2%}  worst {worst:7.2%}  beyond the goal {missed} of {args.seeds}")
    headline("zig_zag_accuracy", "zig-zags flown over MAVLink, compared with the true parameters", kept)


if __name__ == "__main__":
    main()
