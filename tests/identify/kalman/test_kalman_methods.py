"""EKF, UKF, smoother and prediction error on CyberShip II runs of our own water."""

from __future__ import annotations

import json

import numpy as np
import pytest
from cybership_plants import FORM, TRUTH, sail

from gcs_autotune.errors import NotInformative, UsageError
from gcs_autotune.identify import METHODS, fit
from gcs_autotune.report.study.figures import convergence_of, draw_convergence
from gcs_autotune.trial import Channel, Trial


def misses(found) -> np.ndarray:
    """Return (estimate - truth) / standard error of all free parameters."""
    return np.array([(found.parameters[n].value - v) / found.parameters[n].std for n, v in TRUTH.items()])


@pytest.fixture(scope="module")
def zigzag() -> Trial:
    return sail("zigzag", 1, noise=0.01, duration=64.0)


@pytest.fixture(scope="module")
def by_ekf(zigzag):
    return fit(zigzag, FORM, "ekf")


def test_the_filter_identifies_all_fifteen_coefficients_within_its_errors(by_ekf):
    z = misses(by_ekf)
    assert np.max(np.abs(z)) < 4.0
    assert 0.4 < np.sqrt(np.mean(z**2)) < 1.7
    assert by_ekf.noise == pytest.approx(dict.fromkeys("uvr", 0.01), rel=0.1)
    assert not by_ekf.doubts


def test_starting_all_coefficients_at_plus_or_minus_20_gives_the_same_result(zigzag, by_ekf):
    for value in (20.0, -20.0):
        other = fit(zigzag, FORM, "ekf", start=dict.fromkeys(TRUTH, value))
        assert set(other.parameters) == set(by_ekf.parameters) >= set(FORM.free)
        for name, parameter in by_ekf.parameters.items():
            assert abs(other.parameters[name].value - parameter.value) <= 0.2 * parameter.std + 1e-12


@pytest.mark.slow
def test_the_average_error_on_the_published_circle_is_below_the_published_best():
    """ZhaoUSV, table 3: 3.83 %; noise 1 mm/s and 1 mrad/s, circle entered from rest and left by coasting."""
    found = fit(sail("circle", 0, noise=0.001), FORM, "ekf", start=dict.fromkeys(TRUTH, -20.0))
    errors = [100.0 * abs(found.parameters[n].value / v - 1.0) for n, v in TRUTH.items() if v]
    assert np.mean(errors) < 3.83


def test_missing_samples_and_uneven_stamps_only_reduce_information(zigzag):
    rng = np.random.default_rng(5)
    channels = dict(zigzag.channels)
    for name in "uvr":
        channel = zigzag[name]
        keep = np.sort(rng.choice(len(channel), len(channel) // 2, replace=False))
        channels[name] = Channel(name, channel.unit, channel.t[keep], channel.values[keep])
    found = fit(Trial("holes", channels), FORM, "smoother")
    assert np.max(np.abs(misses(found))) < 4.0
    assert not [d for d in found.doubts if d.slug == "filter-inconsistent"]


def test_velocities_and_parameters_are_estimated_from_1_hz_positions_and_10_hz_heading():
    whole = sail("zigzag", 1, noise=0.01, duration=96.0, signals=("x", "y", "psi", "u", "v"))
    channels = {n: whole[n] for n in ("T_1", "T_2", "psi")}
    channels |= {n: Channel(n, "m", whole[n].t[::10], whole[n].values[::10]) for n in "xy"}
    found = fit(Trial("gps", channels), FORM, "smoother")
    assert np.max(np.abs(misses(found))) < 4.0
    (seen,) = found.extra["smoothed"]
    for name in "uv":
        at = np.round(np.array(seen["t"]) / 0.1).astype(int)
        exact = sail("zigzag", 1, noise=0.0, duration=96.0)[name].values[at]
        off = np.array(seen["value"][name]) - exact
        assert np.sqrt(np.mean(off**2)) < 0.01
        assert np.max(np.abs(off) / np.maximum(seen["std"][name], 1e-9)) < 6.0


def test_a_diverging_regression_does_not_stop_the_smoother():
    """Noise of seed 10 makes the regression's inertia nearly singular."""
    found = fit(sail("zigzag", 10, noise=0.01, duration=64.0), FORM, "smoother")
    assert np.max(np.abs(misses(found))) < 4.0


def test_sigma_points_agree_with_the_linearised_filter_at_low_curvature():
    run = sail("zigzag", 3, noise=0.005, duration=24.0)
    form = FORM.fixing({n: v for n, v in TRUTH.items() if n not in ("N_r", "N_rr", "X_u", "X_uu")})
    ekf, ukf = fit(run, form, "ekf"), fit(run, form, "ukf")
    assert set(form.free) == {"N_r", "N_rr", "X_u", "X_uu"} & set(TRUTH)
    for name in form.free:
        p = ekf.parameters[name]
        assert abs(ukf.parameters[name].value - p.value) < 0.3 * p.std
        assert ukf.parameters[name].std == pytest.approx(p.std, rel=0.1)


def test_gusts_are_distinguished_from_measurement_noise():
    found = fit(sail("zigzag", 2, noise=0.01, duration=64.0, gust=0.02), FORM, "prediction-error")
    assert found.noise == pytest.approx(dict.fromkeys("uvr", 0.01), rel=0.15)
    assert found.extra["state_noise"] == pytest.approx(dict.fromkeys("uvr", 0.02), rel=0.25)
    assert np.max(np.abs(misses(found))) < 4.0


def test_a_result_is_plain_json_with_history_and_innovations(by_ekf):
    data = json.loads(by_ekf.to_json())
    (history,) = data["history"]["runs"]
    assert len(history["t"]) == len(history["value"]["X_u"]) == len(history["std"]["X_u"]) <= 200
    assert history["std"]["X_u"][-1] < history["std"]["X_u"][0]
    assert set(data["innovations"][history["run"]]) == {"u", "v", "r"}


def test_the_report_plots_the_convergence_of_every_parameter(by_ekf):
    ((run, history),) = convergence_of(by_ekf)
    figure = draw_convergence(by_ekf, history)
    assert run and figure is not None
    assert [axes.get_ylabel() for axes in figure.axes] == list(history["value"])[:12]
    line = figure.axes[0].lines[0].get_ydata()
    first = next(iter(history["value"]))
    assert abs(line[-1] - by_ekf.parameters[first].value) < 1e-6 * abs(line[-1])


def test_noise_levels_supplied_by_the_user_are_kept(zigzag):
    given = dict.fromkeys("uvr", 0.02)
    found = fit(zigzag, FORM, "ekf", measurement_noise=given, state_noise=0.0, passes=4)
    assert found.noise == pytest.approx(given)
    assert set(found.extra["state_noise"].values()) == {0.0}
    assert "filter-inconsistent" in {d.slug for d in found.doubts}


def test_a_model_without_its_drag_has_a_doubt(zigzag):
    poor = FORM.without("Y_vv", "Y_v", "Y_r", "Y_rr")
    found = fit(zigzag, poor, "ekf", state_noise=0.0, passes=6, measurement_noise=dict.fromkeys("uvr", 0.01))
    assert {"filter-inconsistent", "innovations-coloured"} & {d.slug for d in found.doubts}


@pytest.mark.parametrize(
    "options",
    [{"start": {"X_w": 1.0}}, {"state_noise": -1.0}, {"state_noise": {"w": 1.0}}, {"passes": 0}, {"spread": 0.0}],
)
def test_invalid_options_are_rejected(zigzag, options):
    with pytest.raises(UsageError):
        fit(zigzag, FORM, "ekf", **options)


def test_a_form_without_free_parameters_is_rejected(zigzag):
    with pytest.raises(NotInformative):
        fit(zigzag, FORM.fixing(TRUTH), "ekf")


@pytest.mark.parametrize("name", ["ekf", "ukf", "smoother", "prediction-error"])
def test_every_filter_is_registered_for_axes_and_forms(name):
    assert METHODS[name].axis is not None
    assert METHODS[name].coupled is not None
