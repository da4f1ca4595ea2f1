"""A servo with a limited rate and thrust that lags are identified from two oscillations, and designed with."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.identify import AxisFit, fit_axis
from gcs_autotune.identify.thrust import describe_slow_actuator, fit_slow_actuator
from gcs_autotune.trial import Channel, Trial
from gcs_autotune.workflow.proof import reduction_of_extended

INERTIA, DAMPING, DT = 0.7, 0.9, 0.002
RATE, LAG = 1.6, 0.8
SLIP, SLIPS = 0.7, 1.0


def oscillation(output: float, half_period: float, rate: float = np.inf, lag: float = 0.0, slip: float = 0.0) -> Trial:
    """Return the turn of a boat under a square wave, recorded at 25 Hz.

    The servo has a largest *rate* and a *lag*. A hull that slips sideways is turned back by *slip* of its turn rate.
    """
    n, swing = 15_000, round(half_period / DT)
    u = np.where((np.arange(n) + swing // 2) // swing % 2 == 0, output, -output)
    psi, r, rudder, sideways = np.zeros(n), np.zeros(n), u[0], 0.0
    for k in range(1, n):
        towards = u[k - 1] - rudder
        rudder += float(np.clip(towards * (DT / lag if lag else 1.0), -rate * DT, rate * DT))
        r[k] = r[k - 1] + DT * (rudder - DAMPING * (r[k - 1] + slip * sideways)) / INERTIA
        sideways += DT * (r[k - 1] - sideways) / SLIPS
        psi[k] = psi[k - 1] + DT * r[k - 1]
    rng, kept, t = np.random.default_rng(7), slice(None, None, 20), DT * np.arange(n)
    measured = {"psi": ("rad", psi), "r": ("rad/s", r)}
    channels = {
        name: Channel(name, unit, t[kept], value[kept] + rng.normal(0.0, 0.002, len(t[kept])))
        for name, (unit, value) in measured.items()
    }
    return Trial(f"relay-{output}", {**channels, "N": Channel("N", "1", t[kept], u[kept])}, meta={"C": output})


def two(**servo: float) -> tuple[list[Trial], AxisFit]:
    runs = [oscillation(0.3, 1.28, **servo), oscillation(0.6, 1.68, **servo)]
    return runs, fit_axis(runs, dof="yaw")


def test_the_limited_rate_of_a_servo_is_identified_reported_and_used_in_the_design() -> None:
    runs, plain = two(rate=RATE)
    found = fit_slow_actuator(runs, plain)
    assert found is not None
    assert found.parameters["rate-limit@N.rate"].value == pytest.approx(RATE, rel=0.05)
    assert -found.parameters["N_rdot"].value == pytest.approx(INERTIA, rel=0.05)
    assert "it takes 0.62 s from neutral to full output" in describe_slow_actuator(found, plain)
    actuator = reduction_of_extended(found, FIRMWARE["ardurover"].axes["yaw"]).actuator
    assert actuator.rate == pytest.approx(RATE, rel=0.05)


def test_lagging_thrust_is_not_mistaken_for_a_limited_rate() -> None:
    runs, plain = two(lag=LAG)
    found = fit_slow_actuator(runs, plain)
    assert found is not None
    assert found.parameters["actuator-lag@N.time_constant"].value == pytest.approx(LAG, rel=0.1)
    assert "a time constant of 0.79 s" in describe_slow_actuator(found, plain)


def test_a_servo_without_lag_has_no_slow_actuator() -> None:
    assert fit_slow_actuator(*two()) is None


def test_a_limited_rate_that_explains_only_a_part_is_not_used_in_the_design() -> None:
    """The hull also slips sideways: 14 % of the motion is unexplained without the limited rate, and 8 % with it."""
    assert fit_slow_actuator(*two(rate=0.5 * RATE, slip=SLIP)) is None
