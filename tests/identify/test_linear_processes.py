"""The matrix algorithm on simulated processes: what the first harmonic costs, and what three harmonics give back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from linear_plants import relay_run

from gcs_autotune.identify.frequency import harmonic_response
from gcs_autotune.identify.relay.iso import quadratic_drag, relay_bias
from gcs_autotune.identify.relay.limit_cycle import find_cycles
from gcs_autotune.identify.relay.linear_process import identify_process, process_from_response
from gcs_autotune.models import TransferFunction
from gcs_autotune.trial import Trial


@dataclass(frozen=True)
class Process:
    """b and a in rising powers, the relays (C, x_a), and the worst error [%] of the describing function."""

    b: tuple[float, ...]
    a: tuple[float, ...]
    relays: tuple[tuple[float, float], ...]
    worst: tuple[float, float]
    integrators: int = 0
    delay: float = 0.0
    every: int = 1

    def runs(self, noise: float = 0.0) -> list[Trial]:
        how = {"delay": self.delay, "integrators": self.integrators, "every": self.every, "noise": noise}
        return [relay_run(self.b, self.a, C, x_a, 60.0, **how) for C, x_a in self.relays]

    @property
    def order(self) -> tuple[int, int, int, float]:
        return len(self.a) - 1, len(self.b) - 1, self.integrators, self.delay

    def errors(self, found: TransferFunction) -> np.ndarray:
        got = np.array([*found.numerator, *found.denominator[1:]])
        return 100.0 * np.abs(got / np.array([*self.b, *self.a[1:]]) - 1.0)


PROCESSES = {
    "type 1": Process((3.0,), (1.0, 0.9, 0.2), ((1, 0.2), (1, 0.6)), (5.0, 8.0), integrators=1),
    "type 1, delay": Process((3.0,), (1.0, 0.9, 0.2), ((1, 0.4), (1, 1.2)), (14.0, 18.0), integrators=1, delay=0.2),
    "type 1, sampled": Process((3.0,), (1.0, 0.9, 0.2), ((1, 0.2), (1, 0.6)), (4.0, 9.0), integrators=1, every=20),
    "type 2, lead": Process((1.0, 1.5), (1.0, 0.3), ((1, 0.2), (1, 0.8)), (0.0, 60.0), integrators=2),
    "unstable zero": Process((2.0, -0.4), (1.0, 1.5, 0.5), ((1, 0.3), (1, 0.8)), (150.0, 250.0)),
    "3 poles, 1 zero": Process((1.0, 0.8), (1.0, 2.2, 1.6, 0.5), ((1, 0.1), (1, 0.35), (1, 0.6)), (100.0, 140.0)),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", PROCESSES)
def test_the_first_harmonic_has_a_known_error_and_three_harmonics_are_exact(name: str) -> None:
    process = PROCESSES[name]
    runs = process.runs()
    cycles = [cycle for run in runs for cycle in find_cycles(run, "yaw")]
    assert all(cycle.valid for cycle in cycles)
    by_describing_function = process.errors(identify_process(cycles, *process.order))
    low, high = process.worst
    assert low < by_describing_function.max() < high
    response = harmonic_response(runs, "yaw", (1, 3))
    exact = process_from_response(response.omega, response.value / (1j * response.omega), *process.order)
    assert process.errors(exact).max() < 0.5


def test_harmonics_of_noisy_cycles_still_beat_the_describing_function() -> None:
    process = PROCESSES["type 1, sampled"]
    response = harmonic_response(process.runs(noise=0.01), "yaw", (1, 3))
    s = 1j * response.omega
    found = process_from_response(response.omega, response.value / s, *process.order, std=response.std / response.omega)
    assert process.errors(found).max() < 4.0


def test_a_biased_input_shifts_the_mean_of_the_relay() -> None:
    run = relay_run((3.0,), (1.0, 0.9), 1.0, 0.6, 60.0, bias=0.2, integrators=1)
    (cycle,) = find_cycles(run, "yaw")
    mean = cycle.C * (cycle.T_H - cycle.T_L) / (cycle.T_H + cycle.T_L)
    assert mean == pytest.approx(-0.2, rel=0.01)
    # Miskovic2010 (5.11) from the bias of the motion, which the relay sees reversed, has the sign and hardly the size:
    # the higher harmonics decide when a biased relay switches. The times (6.47) are exact, so they are what is used.
    by_bias = -relay_bias(cycle.C, cycle.X_m, cycle.x_a_star, cycle.x_0)
    assert 0.4 < by_bias / mean < 0.8
    found = identify_process([cycle], 1, 0, 1)
    assert found.numerator[0] == pytest.approx(3.0, rel=0.05)
    assert found.denominator[1] == pytest.approx(0.9, rel=0.05)


@pytest.mark.parametrize("nu_0", [0.0, 0.3, -0.7, 1.0, 2.5])
def test_quadratic_drag_around_a_mean_speed_has_the_fourier_integrals_of_its_curve(nu_0: float) -> None:
    phase = 2.0 * np.pi * (np.arange(200_000) + 0.5) / 200_000
    nu = nu_0 + 0.9 * np.sin(phase)
    drag = np.abs(nu) * nu
    mean, gain = quadratic_drag(nu_0, 0.9)
    assert mean == pytest.approx(float(drag.mean()), abs=1e-8)
    assert gain == pytest.approx(float(2.0 * (drag * np.sin(phase)).mean() / 0.9), rel=1e-8)
