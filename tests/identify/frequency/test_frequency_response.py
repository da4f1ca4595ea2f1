"""The empirical response against plants whose response is known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from axis_plants import Levels, Relay, fly
from linear_plants import relay_run

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.frequency import FrequencyResponse, harmonic_response
from gcs_autotune.identify.frequency.nomoto import fit_nomoto
from gcs_autotune.identify.frequency.spectrum import STRONG, spectral_response
from gcs_autotune.models import Nomoto1, Nomoto2
from gcs_autotune.report import frequency_plot
from gcs_autotune.trial import Channel, Trial

ALPHA, BETA = 0.36, 0.12


def chirp(amplitude: float, low: float, high: float, duration: float) -> Callable[[float, float], float]:
    return lambda t, eta: amplitude * float(np.sin(low * t + (high - low) * t * t / (2.0 * duration)))


def yaw(
    command: Callable[[float, float], float],
    duration: float,
    *,
    delay: float = 0.0,
    noise: float = 0.0,
    seed: int = 0,
    rate: bool = False,
    delta: float = 0.0,
) -> Trial:
    t, psi, r, N = fly((ALPHA, BETA, 0.0, delta), command, duration, dt=0.1, delay=delay, h=0.01)
    error = noise * np.random.default_rng(seed).normal(size=len(t))
    seen = Channel("r", "rad/s", t, r + error) if rate else Channel("psi", "rad", t, psi + error)
    return Trial("run", {seen.name: seen, "N": Channel("N", "N m", t, N)})


def truth(omega: np.ndarray, delay: float = 0.0) -> np.ndarray:
    s = 1j * omega
    return np.exp(-s * delay) / (ALPHA * s + BETA)


def strong(response: FrequencyResponse) -> FrequencyResponse:
    return response.at(response.input_power >= STRONG)


@pytest.mark.parametrize("rate", [False, True])
@pytest.mark.parametrize("delay", [0.0, 0.3])
def test_a_sweep_without_noise_shows_the_plant_to_one_percent(rate: bool, delay: float) -> None:
    run = yaw(chirp(0.3, 0.05, 3.0, 120.0), 120.0, delay=delay, rate=rate)
    response = strong(spectral_response(run, "yaw"))
    assert len(response) >= 8
    assert response.omega[0] < 0.2
    assert np.max(np.abs(response.value / truth(response.omega, delay) - 1.0)) < 0.01
    assert response.coherence.min() > 0.99


@pytest.mark.slow
def test_the_confidence_circles_contain_the_truth_as_often_as_stated() -> None:
    inside = []
    for seed in range(12):
        run = yaw(Levels(np.random.default_rng(1), 0.4, 3.0), 100.0, noise=0.01, seed=seed)
        response = strong(spectral_response(run, "yaw"))
        inside.append(np.abs(response.value - truth(response.omega)) <= response.radius(0.95))
    assert 0.90 < float(np.mean(np.concatenate(inside))) < 0.99


def test_noise_alone_has_low_coherence_and_more_noise_wider_circles() -> None:
    command = chirp(0.3, 0.05, 3.0, 120.0)
    quiet, loud = (strong(spectral_response(yaw(command, 120.0, noise=n), "yaw")) for n in (0.002, 0.02))
    assert np.all(loud.std > 3.0 * quiet.std)
    assert loud.coherence.mean() < quiet.coherence.mean()
    run = yaw(command, 120.0)
    r = Channel("r", "rad/s", run["N"].t, np.random.default_rng(5).normal(size=len(run["N"])))
    nothing = spectral_response(Trial("noise", {"N": run["N"], "r": r}), "yaw")
    assert np.mean(nothing.coherence) < 0.45
    assert np.mean(np.abs(nothing.value) <= nothing.radius(0.95)) > 0.85


def test_uneven_stamps_and_a_gap_do_not_bias_the_response() -> None:
    run = yaw(chirp(0.3, 0.05, 3.0, 150.0), 150.0, noise=0.002)
    rng = np.random.default_rng(2)
    t, psi = run["psi"].t, run["psi"].values
    at = np.sort(rng.uniform(t[0], t[-1], 1400))
    at = at[(at < 60.0) | (at > 70.0)]
    uneven = Trial("uneven", {"psi": Channel("psi", "rad", at, np.interp(at, t, psi)), "N": run["N"]})
    response = strong(spectral_response(uneven, "yaw"))
    low = response.omega < 2.5
    assert int(low.sum()) >= 5
    assert np.max(np.abs(response.value / truth(response.omega) - 1.0)[low]) < 0.05


@pytest.mark.parametrize("delta", [0.0, 0.05])
def test_three_harmonics_of_a_relay_lie_on_the_plant(delta: float) -> None:
    response = harmonic_response([yaw(Relay(C, 0.2), 60.0, noise=0.001, delta=delta) for C in (0.2, 0.5)], "yaw")
    assert len(response) == 6
    assert np.all(np.diff(response.omega) > 0.0)
    miss = np.abs(response.value - truth(response.omega))
    assert np.all(miss < response.radius(0.99))
    assert np.all(np.sort(miss / response.magnitude)[:4] < 0.04)


def test_a_sway_coupled_plant_shows_its_second_order() -> None:
    K, T_1, T_2, T_3 = 0.5, 6.0, 0.8, 2.0
    runs = [
        relay_run((K, K * T_3), (1.0, T_1 + T_2, T_1 * T_2), 0.3, x_a, 200.0, every=20, integrators=1, noise=5e-4)
        for x_a in (0.02, 0.2)
    ]
    response = harmonic_response(runs, "yaw")
    first, second = (fit_nomoto(response, order, 0.0) for order in (1, 2))
    assert isinstance(second.model, Nomoto2)
    assert (second.model.K, second.model.T_1, second.model.T_2, second.model.T_3) == pytest.approx(
        (K, T_1, T_2, T_3), rel=0.08
    )
    assert second.bic < first.bic - 10.0
    assert second.misfit < 0.2 * first.misfit
    for name, true in (("K", K), ("T_1", T_1), ("T_2", T_2), ("T_3", T_3)):
        assert abs(getattr(second.model, name) - true) < 4.0 * second.std[name]


@pytest.mark.slow
def test_standard_errors_of_gain_and_time_constant_match_repeated_runs() -> None:
    values, result = [], []
    for seed in range(14):
        run = yaw(Levels(np.random.default_rng(1), 0.4, 3.0), 100.0, noise=0.02, seed=seed)
        fitted = fit_nomoto(strong(spectral_response(run, "yaw")), 1, 0.0)
        assert isinstance(fitted.model, Nomoto1)
        values.append((fitted.model.K, fitted.model.T))
        result.append((fitted.std["K"], fitted.std["T"]))
    spread, mean_told = np.std(values, axis=0, ddof=1), np.mean(result, axis=0)
    assert np.all(0.5 < mean_told / spread)
    assert np.all(mean_told / spread < 2.5)
    assert np.mean(values, axis=0) == pytest.approx((1.0 / BETA, ALPHA / BETA), rel=0.02)


def test_the_plot_shows_gain_phase_and_coherence_with_the_models() -> None:
    response = spectral_response(yaw(chirp(0.3, 0.05, 3.0, 120.0), 120.0, noise=0.01), "yaw")
    figure = frequency_plot(response, {"plant": Nomoto1(1.0 / BETA, ALPHA / BETA)})
    gain, phase, coherence = figure.axes
    assert (gain.get_ylabel(), phase.get_ylabel()) == ("gain [dB]", "phase [deg]")
    assert coherence.get_xscale() == "log"
    drawn = gain.lines[-1].get_ydata()
    assert float(np.max(drawn)) == pytest.approx(20.0 * np.log10(1.0 / BETA), abs=1.0)
    assert "plant" in [text.get_text() for text in gain.get_legend().get_texts()]
    figure.canvas.draw()


def test_a_response_survives_serialisation_and_short_runs_are_rejected() -> None:
    response = spectral_response(yaw(chirp(0.3, 0.05, 3.0, 60.0), 60.0, noise=0.01), "yaw")
    again = FrequencyResponse.from_dict(response.to_dict())
    assert again.value == pytest.approx(response.value)
    assert again.source == "spectrum"
    with pytest.raises(NotInformative, match="too short"):
        spectral_response(yaw(chirp(0.3, 1.0, 3.0, 60.0), 2.5), "yaw", tapers=8)
    with pytest.raises(NotInformative, match="settled"):
        harmonic_response(yaw(chirp(0.3, 0.05, 3.0, 60.0), 60.0), "yaw")
