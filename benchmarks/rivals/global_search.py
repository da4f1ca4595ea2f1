"""Start of the oracle: the best gains of a global search on a simulation of the true hull.

Only the oracle uses the true hull. The result is flown like all other gains. The simulation is that of the
firmware's heading loops in :mod:`gcs_autotune.design`, which leaves out the firmware's estimator and the T200's top.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import differential_evolution, least_squares

from benchmarks.rivals.fleet import Job, Vessel
from gcs_autotune.design import Actuator, StepMetrics, combine, step_metrics
from gcs_autotune.design.laws import LAWS, Scenario
from gcs_autotune.models import SingleDof

__all__ = ["SIMULATED_LAWS", "best_simulated", "true_hull"]

SIMULATED_LAWS = ("rover-heading", "sub-heading")
_LEAD = 3.0
_GENERATIONS, _CROWD = 12, 8
_NOISE = math.radians(0.05)
_PRICE = 20.0

Array = NDArray[np.float64]


def true_hull(vessel: Vessel) -> tuple[SingleDof, Actuator]:
    """Return the true yaw dynamics of the vessel, with normalised input, and its actuator."""
    yaw = vessel.data.tables["yaw"]
    value = {name: row["value"] for name, row in yaw.items()}
    if vessel.data.is_boat:
        full = value["full_rudder"]
        alpha, beta = value["alpha"][0] / full, value["beta"][0] / full
        return SingleDof("yaw", "1", alpha, beta, 0.0, value["bias"] / full, 0.0), Actuator()
    full = value["authority"]
    hull = SingleDof("yaw", "1", value["alpha"] / full, value["beta"] / full, value["beta2"] / full, 0.0, 0.0)
    thruster = vessel.data.tables["thruster"]
    return hull, _actuator(thruster["odd"]["value"], thruster["dead"]["value"])


def _actuator(odd: Sequence[float], dead: float) -> Actuator:
    """Return the dead zone and thrust curve closest to an odd polynomial of the command with a dead zone."""
    u = np.linspace(0.0, 1.0, 101)
    thrust = sum(c * u ** (2 * k + 1) for k, c in enumerate(odd)) * (u > dead) / sum(odd)

    def shaped(x: Array) -> Actuator:
        return Actuator(dead_zone=dead, square=float(x[0]), ahead=float(x[1]), astern=float(x[1]))

    found = least_squares(lambda x: shaped(x).static(u) - thrust, [0.5, 1.0])
    return shaped(found.x)


def best_simulated(
    law_name: str,
    vessel: Vessel,
    job: Job,
    ranges: Mapping[str, tuple[float, float]],
    present: Mapping[str, float],
    max_overshoot: float,
) -> dict[str, float]:
    """Return the gains of least simulated ITAE with an overshoot of at most *max_overshoot*."""
    law, names = LAWS[law_name], list(ranges)
    low, high = (np.array([ranges[n][i] for n in names]) for i in (0, 1))
    hull, actuator = true_hull(vessel)
    speed = vessel.data.parameters.get("CRUISE_SPEED")
    delay = 1.5 * law.loop_period(present)

    def fly(gains: Mapping[str, float]) -> StepMetrics:
        found = []
        for size in (job.step, -job.step):
            motion = law.simulate(hull, gains, Scenario(size, job.duration + _LEAD, lead=_LEAD), speed, delay, actuator)
            on = motion.t >= _LEAD
            target = np.where(np.arange(int(on.sum())) == 0, 0.0, size)
            t = motion.t[on] - _LEAD
            found.append(step_metrics(t, target, motion.position[on], motion.output[on], noise_std=_NOISE))
        return combine(found)

    def cost(x: Array) -> float:
        m = fly({**present, **gains_of(x)})
        return (m.itae if math.isfinite(m.itae) else 1e6) * (1.0 + _PRICE * max(0.0, m.overshoot - max_overshoot))

    def gains_of(x: Array) -> dict[str, float]:
        return {n: float(v) for n, v in zip(names, low + np.square(x) * (high - low), strict=True)}

    found = differential_evolution(
        cost, [(0.0, 1.0)] * len(names), maxiter=_GENERATIONS, popsize=_CROWD, seed=1, polish=False
    )
    return gains_of(found.x)
