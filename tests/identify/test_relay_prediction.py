"""The limit cycle of a relay, predicted from the first harmonic and compared with the simulated one."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
import pytest

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.relay import predict_cycle
from gcs_autotune.models import SingleDof

EXAMPLE = SingleDof("yaw", "1", 0.3 / 50.0, 1.0 / 50.0)
"""50/(s(0.3s+1)) of Miskovic2010, examples 6.2 and 6.3, with a relay of C = 1."""


def swung(model: SingleDof, C: float, x_a: float, sample_time: float, seconds: float) -> tuple[float, float, float]:
    """Return (amplitude, period, position at the switching) of a simulated relay, looked at every *sample_time* [s]."""
    inside = 100
    dt = sample_time / inside
    late = deque([0.0] * round(model.delay / dt))
    eta = nu = 0.0
    high, switched, path = True, [], []
    for k in range(round(seconds / sample_time)):
        if eta >= x_a if high else eta <= -x_a:
            high = not high
            switched.append((k, abs(eta)))
        for _ in range(inside):
            late.append(C if high else -C)
            drag = (model.beta + model.beta_quadratic * abs(nu)) * nu
            nu += dt * (late.popleft() + model.delta - drag) / model.alpha
            eta += dt * nu
            path.append(eta)
    (first, _), (last, at) = switched[-11], switched[-1]
    cycles = np.array(path[inside * first : inside * last])
    return 0.5 * float(np.ptp(cycles)), 0.2 * (last - first) * sample_time, at


def test_the_relay_of_example_6_3_oscillates_as_predicted() -> None:
    amplitude, period, at = swung(EXAMPLE, 1.0, 16.0, 0.1, 60.0)
    assert (amplitude, period, at) == pytest.approx((24.47, 2.8, 20.28), rel=0.02)
    cycle = predict_cycle(EXAMPLE, 1.0, at)
    assert cycle.X_m == pytest.approx(24.47, rel=0.03)
    assert cycle.period == pytest.approx(2.8, rel=0.03)


@pytest.mark.parametrize(
    ("model", "x_a"),
    [
        (SingleDof("yaw", "1", 1.0, 0.5, delay=0.3), 0.2),
        (SingleDof("yaw", "1", 1.0, 0.0, 0.8, delay=0.3), 0.2),
        (SingleDof("yaw", "1", 1.0, 0.1, 0.8, 0.1, 0.2), 0.2),
        (SingleDof("yaw", "1", 1.0, 0.5, delta=-0.15), 0.3),
        (SingleDof("heave", "1", 5.0, 0.5), 0.2),
    ],
)
def test_a_simulated_relay_oscillates_as_predicted_within_the_error_of_the_first_harmonic(
    model: SingleDof, x_a: float
) -> None:
    cycle = predict_cycle(model, 0.5, x_a, sample_time=0.02)
    amplitude, period, _ = swung(model, 0.5, x_a, 0.02, 250.0)
    assert cycle.X_m == pytest.approx(amplitude, rel=0.10)
    assert cycle.period == pytest.approx(period, rel=0.10)
    assert math.copysign(1.0, cycle.x_0) == math.copysign(1.0, model.delta)


def test_the_cycle_is_where_the_nyquist_plot_meets_the_inverse_of_the_describing_function() -> None:
    model = SingleDof("yaw", "1", 1.0, 0.1, 0.8, 0.1, 0.2)
    cycle = predict_cycle(model, 0.5, 0.2)
    (process,), (inverse,) = cycle.process(model, np.array([cycle.omega])), cycle.inverse(np.array([cycle.X_m]))
    assert abs(process - inverse) < 1e-6 * abs(process)


@pytest.mark.parametrize(
    ("model", "x_a", "why"),
    [
        (SingleDof("yaw", "1", 1.0, 0.5), 0.0, "without hysteresis"),
        (SingleDof("yaw", "1", 1.0, 0.0), 0.2, "no drag"),
        (SingleDof("yaw", "1", 1.0, 0.5, delta=0.6), 0.2, "constant force"),
    ],
)
def test_a_relay_that_causes_no_limit_cycle_is_rejected_with_the_reason(model: SingleDof, x_a: float, why: str) -> None:
    with pytest.raises(NotInformative, match=why):
        predict_cycle(model, 0.5, x_a)
