"""The closed heading loop: Miskovic2010, eq. (6.52), Algorithm 8.7, relays of Table 7.13."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest
from linear_plants import relay_run

from gcs_autotune.control import simplify
from gcs_autotune.errors import MissingChannel, NoGainsMeetSpec
from gcs_autotune.identify.frequency import harmonic_response
from gcs_autotune.identify.relay import loop_cycles, loop_process, loop_trial
from gcs_autotune.identify.relay.linear_process import experiments_needed, heading_loop
from gcs_autotune.models import TransferFunction

DEG = math.pi / 180.0
K, T = 0.3, 1.5
"""Steering (8.30): psi/delta = K/(s (T s + 1)); its autopilots below are rows of Miskovic2010, Table 8.1."""


def pi_d(K_P: float, K_I: float, K_D: float) -> TransferFunction:
    return TransferFunction((1.0, K_P / K_I), (1.0, K_P / K_I, (1.0 + K * K_D) / (K * K_I), T / (K * K_I)))


def i_pd(K_P: float, K_I: float, K_D: float) -> TransferFunction:
    return TransferFunction((1.0, 0.0), pi_d(K_P, K_I, K_D).denominator)


def flown(loop: TransferFunction, relays: list[tuple[float, float]]) -> list:
    b, a = loop.numerator, loop.denominator
    return [relay_run(b, a, C * DEG, x_a * DEG, 120.0, channels=("psi_ref", "psi")) for C, x_a in relays]


CASES = {
    "PI-D, relays of case 1": (pi_d(3.0, 0.8, 8.0), [(20, 5), (15, 5)], (0.3, 0.45)),
    "PI-D, relays of case 2": (pi_d(3.0, 0.8, 8.0), [(10, 5), (30, 10)], (0.15, 0.30)),
    "I-PD, relays of case 2": (i_pd(3.0, 0.5, 4.0), [(10, 5), (30, 10)], (1.5, 2.0)),
}
"""Loop, relays of Table 7.13 (C, x_a in deg), and between what limits the worst error of the denominator lies when it
rests on describing functions. For the I-PD loop they even make a_3 negative: an unstable loop that is none."""


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_two_experiments_identify_the_loop_roughly_by_first_harmonics_and_exactly_by_three(name: str) -> None:
    truth, relays, rough = CASES[name]
    runs = flown(truth, relays)
    cycles = loop_cycles(runs)
    assert len(cycles) == 2
    assert cycles[0].C == pytest.approx(relays[0][0] * DEG)
    found = heading_loop(*cycles)
    assert found.numerator[0] == 1.0
    worst = float(np.max(np.abs(np.array(found.denominator) / truth.denominator - 1.0)))
    assert rough[0] < worst < rough[1]
    exact = loop_process(harmonic_response([loop_trial(r) for r in runs], "yaw", (1, 3)), 3, 1, gain=1.0)
    assert exact.denominator == pytest.approx(truth.denominator, rel=5e-3)
    assert exact.numerator[1] == pytest.approx(truth.numerator[1], abs=0.02)
    simple = simplify(exact)
    # What is dropped is of second order in omega over the pole taken out.
    p = float(truth.poles().real.min())
    omega = np.geomspace(0.02, 0.1, 20) * -p
    dropped = np.abs(simple.numerator[1] * omega**2 / p)
    assert np.all(np.abs(simple.response(omega) / truth.response(omega) - 1.0) < 1.2 * dropped + 0.01)


def cardano(loop: TransferFunction) -> tuple[float, float, float, float]:
    """Algorithm 8.7 step by step, as printed."""
    _, a_1, a_2, a_3 = loop.denominator
    Q = (3 * a_1 * a_3 - a_2**2) / (9 * a_3**2)
    R = (9 * a_3 * a_2 * a_1 - 27 * a_3**2 - 2 * a_2**3) / (54 * a_3**3)
    D = Q**3 + R**2
    assert D >= 0.0
    S, U = (math.copysign(abs(v) ** (1 / 3), v) for v in (R + math.sqrt(D), R - math.sqrt(D)))
    p = -a_2 / a_3 / 3 + S + U
    omega_n = math.sqrt(-1 / (p * a_3))
    zeta = math.sqrt(-p * a_3) / 2 * (a_2 / a_3 + p)
    return p, loop.numerator[1] + 1 / p, 2 * zeta / omega_n, 1 / omega_n**2


def test_the_simplification_is_algorithm_8_7() -> None:
    loop = pi_d(3.0, 0.8, 8.0)
    p, b_1, a_1, a_2 = cardano(loop)
    assert min(abs(p - q) for q in loop.poles()) < 1e-9
    simple = simplify(loop)
    assert simple.numerator == pytest.approx((1.0, b_1))
    assert simple.denominator == pytest.approx((1.0, a_1, a_2))


def test_the_fastest_of_three_real_poles_is_removed() -> None:
    times = (2.0, 0.7, 0.1)
    a = np.poly([-1.0 / v for v in times])
    loop = TransferFunction((1.0, 0.3), tuple((a / a[-1])[::-1]))
    simple = simplify(loop)
    assert simple.denominator == pytest.approx((1.0, 2.7, 1.4))
    assert simple.numerator == pytest.approx((1.0, 0.2))
    assert not any(cmath.isnan(v) for v in simple.poles())


def test_an_unstable_pole_is_not_simplified_away() -> None:
    with pytest.raises(NoGainsMeetSpec, match="unstable"):
        simplify(TransferFunction((1.0, 0.0), (1.0, -1.0, 1.0, -0.5)))


def test_a_known_gain_saves_an_experiment_and_a_run_without_the_command_is_rejected() -> None:
    assert experiments_needed(3, 1) == 3
    assert experiments_needed(3, 1, gain_known=True) == 2
    with pytest.raises(MissingChannel, match="psi_ref"):
        loop_trial(relay_run((1.0,), (1.0, 1.0), 0.1, 0.01, 5.0, integrators=1))
