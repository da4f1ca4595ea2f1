"""The general matrix algorithm on known processes."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify import LimitCycle
from gcs_autotune.identify.relay.iso import relay
from gcs_autotune.identify.relay.linear_process import experiments_needed, identify_process


def balanced_cycle(value: complex, omega: float, X_m: float) -> LimitCycle:
    """A limit cycle whose describing function balances a process' frequency response exactly: (P + jQ) G = -1."""
    target = -1.0 / value
    ratio = abs(target.imag) / abs(target)
    x_a = ratio * X_m
    C = abs(target) * np.pi * X_m / 4.0
    P, Q = relay(C, X_m, x_a)
    assert complex(P, Q) == pytest.approx(target)
    half = np.pi / omega
    return LimitCycle(C, x_a, x_a, X_m, 0.0, omega, half, half, 5, 0.0, True)


@pytest.mark.parametrize(("integrators", "delay"), [(1, 0.0), (1, 0.05)])
def test_poles_and_a_zero_are_identified_from_exactly_balanced_cycles(integrators: int, delay: float) -> None:
    b, a = (3.0, 0.4), (1.0, 0.9, 0.2)

    def response(omega: float) -> complex:
        s = 1j * omega
        return (b[0] + b[1] * s) / (a[0] + a[1] * s + a[2] * s**2) * np.exp(-s * delay) / s**integrators

    cycles = [balanced_cycle(complex(response(w)), w, X) for w, X in ((1.0, 0.3), (2.0, 0.2))]
    found = identify_process(cycles, n=2, m=1, integrators=integrators, delay=delay)
    assert found.numerator == pytest.approx(b, rel=1e-9)
    assert found.denominator == pytest.approx(a, rel=1e-9)


def test_the_number_of_cycles_follows_from_the_number_of_unknowns() -> None:
    assert experiments_needed(3, 1) == 3
    assert experiments_needed(1, 0) == 1
    assert experiments_needed(2, 0) == 2


def test_too_few_or_equal_cycles_are_rejected_with_advice() -> None:
    cycle = balanced_cycle(complex(-0.5, -0.4), 1.0, 0.3)
    with pytest.raises(NotInformative, match="needs 2 limit cycles"):
        identify_process([cycle], n=2, m=0)
    with pytest.raises(NotInformative, match="too similar"):
        identify_process([cycle, cycle], n=2, m=1)
