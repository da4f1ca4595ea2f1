"""Two oscillations of different size tell a thruster that is weak for small commands from a straight one."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_autotune.identify import fit_axis
from gcs_autotune.trial import Channel, Trial
from gcs_autotune.workflow.thrust_curve import fit_thrust_curve, told

ALPHA, DRAG = 0.026, 0.065


def oscillation(name: str, output: float, half_period: float, share: float) -> Trial:
    """A square wave on an ROV's yaw, thrust ``u (1 - share + share |u|)``."""
    dt, n = 0.002, 10_000
    t = dt * np.arange(n)
    swing = round(half_period / dt)
    u = np.where((np.arange(n) + swing // 2) // swing % 2 == 0, output, -output)
    psi, r = np.zeros(n), 0.0
    for k in range(1, n):
        r += dt * (u[k - 1] * (1.0 - share + share * abs(u[k - 1])) - DRAG * abs(r) * r) / ALPHA
        psi[k] = psi[k - 1] + dt * r
    rng = np.random.default_rng(7)
    kept = slice(None, None, 20)
    return Trial(
        name,
        {
            "psi": Channel("psi", "rad", t[kept], psi[kept] + rng.normal(0.0, 0.002, len(t[kept]))),
            "N": Channel("N", "1", t[kept], u[kept]),
        },
    )


def two(share: float) -> list[Trial]:
    return [oscillation("relay-1", 0.3, 0.8, share), oscillation("relay-2", 0.6, 0.6, share)]


def test_a_thruster_weak_for_small_commands_is_found_and_said():
    runs = two(0.8)
    plain = fit_axis(runs, dof="yaw")
    found = fit_thrust_curve(runs, plain)
    assert found is not None
    assert found.parameters["quadratic-actuator@N.share"].value == pytest.approx(0.75, abs=0.15)
    assert 100.0 - found.fit_percent < 0.4 * (100.0 - plain.fit_percent)
    assert "weak for small commands" in told(found, plain)


def test_a_straight_thruster_gets_no_curve():
    runs = two(0.0)
    assert fit_thrust_curve(runs, fit_axis(runs, dof="yaw")) is None
