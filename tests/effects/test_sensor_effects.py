"""Sensors that deviate, lag, round and have outliers, and waves: laws, and consistent likelihoods."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import lfilter
from scipy.stats import kurtosis, multivariate_normal, norm

from gcs_autotune.effects import EFFECTS, DataSummary, EffectInstance, EffectResidual, Observed, grid_step
from gcs_autotune.effects.kernels import earlier
from gcs_autotune.effects.narrow_band import Oscillator, whitened
from gcs_autotune.models import form_from

UNITS = {"psi": "rad", "r": "rad/s", "u": "m/s", "v": "m/s", "x": "m", "y": "m"}
BASE = {"N_rdot": -2.0, "N_r": -1.0}
PLANE = form_from(
    {"name": "plane", "dofs": ["surge", "sway", "yaw"], "free": ["X_udot", "Y_vdot", "N_rdot"], "coriolis": False},
    "test",
)


def data_summary(*signals: str, base: dict[str, float] | None = None) -> DataSummary:
    form = form_from({"name": "yaw", "dofs": ["yaw"], "free": ["N_rdot", "N_r"], "inputs": {"N": {"N": 1.0}}}, "test")
    return DataSummary(
        form=form,
        inputs={"N": "N m"},
        signals={s: UNITS[s] for s in signals},
        amplitude={"N": 0.5},
        spread=dict.fromkeys(signals, 0.5),
        level=dict.fromkeys(signals, 0.01),
        channels=frozenset(("N", *signals)),
        interval=0.1,
        time_constant=2.0,
        duration=60.0,
        extent=dict.fromkeys(signals, (-1.5, 1.2)),
        base=BASE if base is None else base,
    )


def left(error: np.ndarray, signal: str = "psi", predicted: np.ndarray | None = None, run: str = "a") -> EffectResidual:
    t = 0.1 * np.arange(len(error))
    motion = np.sin(0.3 * t) if predicted is None else predicted
    return EffectResidual(run, signal, t, error, motion + error, float(np.std(error)))


def begun(slug: str, place: str, about: DataSummary) -> EffectInstance:
    effect = EFFECTS[slug]
    return EffectInstance(slug, place, effect.starts(place, about)[0], effect.constants(place, about))


def cost_of(slug: str, own: EffectInstance, rests: Sequence[EffectResidual]) -> tuple[float, float]:
    """Return minus twice the log-likelihood (less n (1 + log 2 pi)) with and without the effect, one signal's."""
    raw = np.concatenate([x.error for x in rests])
    judged = [EFFECTS[slug].judge(own, x, np.zeros((len(x.error), 1))) for x in rests]
    after = np.concatenate([j[0] for j in judged])
    penalty = sum(j[2] for j in judged)
    return len(after) * math.log(float(np.mean(after**2))) + penalty, len(raw) * math.log(float(np.mean(raw**2)))


# -- deviation and bias


@pytest.mark.parametrize(
    "slug", ["sensor-position", "compass-deviation", "gyro-bias", "measurement-delay", "quantisation", "outliers"]
)
def test_starts_are_within_bounds_and_every_place_has_some(slug: str) -> None:
    effect, about = EFFECTS[slug], data_summary("psi", "r", "u", "v", "x", "y")
    assert effect.places(about)
    for place in effect.places(about):
        bounds = effect.bounds(place, about)
        for start in effect.starts(place, about):
            assert set(start) <= {q.name for q in effect.parameters}
            assert all(bounds[n][0] <= v <= bounds[n][1] for n, v in start.items())


def test_a_misaligned_compass_is_searched_only_with_a_track() -> None:
    effect = EFFECTS["compass-deviation"]
    assert all("A" not in s for s in effect.starts("psi", data_summary("psi", "r")))
    assert all("A" in s for s in effect.starts("psi", data_summary("psi", "r", "x", "y")))
    assert effect.places(data_summary("psi", "u", "v")) == ("psi", "psi+u+v")
    assert effect.places(data_summary("r")) == ()


def test_a_sensor_off_the_centre_is_a_candidate_where_measurements_show_it() -> None:
    effect = EFFECTS["sensor-position"]
    assert effect.places(data_summary("psi", "r")) == ()
    assert effect.places(data_summary("psi", "u")) == ("u",)
    assert effect.places(data_summary("psi", "x", "y")) == ()  # a base that only turns has no track to compare
    plane = replace(data_summary("psi", "u", "v", "x", "y"), form=PLANE)
    assert effect.places(plane) == ("u+v", "x+y", "u+v+x+y")
    assert effect.places(replace(plane, form=PLANE.freeing("x_P"))) == ()
    assert effect.starts("u", data_summary("psi", "u"))[0].keys() == {"y_P"}


def test_turning_appears_as_sway_at_a_sensor_ahead_and_as_surge_at_one_aside() -> None:
    still = dict.fromkeys(("u", "v", "x", "y"), np.zeros(3))
    seen = Observed(np.zeros(3), {**still, "r": np.full(3, 0.5), "psi": np.full(3, math.pi / 2.0)}, 0.0)
    where = EffectInstance("sensor-position", "u+v+x+y", {"x_P": 2.0, "y_P": 1.0})
    shown = EFFECTS["sensor-position"].observe(where, seen).signals
    found = [shown[n][0] for n in ("u", "v", "x", "y")]
    np.testing.assert_allclose(found, [-0.5, 1.0, -1.0, 2.0], atol=1e-12)


def test_velocities_turned_by_a_wrong_compass_keep_their_size() -> None:
    psi = np.linspace(0.0, 6.0, 50)
    u, v = 1.0 + 0.1 * psi, 0.3 * np.cos(psi)
    seen = Observed(psi, {"psi": psi, "u": u, "v": v}, 0.0)
    values = {"A": 0.1, "B": 0.2, "C": -0.3}
    shown = EFFECTS["compass-deviation"].observe(EffectInstance("compass-deviation", "psi+u+v", values), seen).signals
    d = 0.1 + 0.2 * np.sin(psi) - 0.3 * np.cos(psi)
    np.testing.assert_allclose(shown["psi"], psi + d)
    # Over ground the motion is the same, whichever heading it is turned by.
    np.testing.assert_allclose(
        (shown["u"] + 1j * shown["v"]) * np.exp(1j * shown["psi"]), (u + 1j * v) * np.exp(1j * psi)
    )
    alone = EFFECTS["compass-deviation"].observe(EffectInstance("compass-deviation", "psi", values), seen).signals
    np.testing.assert_array_equal(alone["u"], u)


def test_a_gyro_bias_is_added_only_to_the_rate() -> None:
    effect = EFFECTS["gyro-bias"]
    assert effect.places(data_summary("psi", "r")) == ("r",)
    seen = effect.observe(
        EffectInstance("gyro-bias", "r", {"bias": 0.2}),
        Observed(np.zeros(2), {"r": np.ones(2), "psi": np.ones(2)}, 0.0),
    )
    np.testing.assert_allclose(seen.signals["r"], 1.2)
    np.testing.assert_array_equal(seen.signals["psi"], np.ones(2))


# -- delay


def stepped(t: np.ndarray, T: float) -> tuple[np.ndarray, np.ndarray]:
    """Return rate and angle of ``T r' + r = N`` with N = 1 from 1 s, -1 from 3 s, 0 from 6 s on, exactly."""
    r, psi = np.zeros_like(t), np.zeros_like(t)
    for at, jump in ((1.0, 1.0), (3.0, -2.0), (6.0, 1.0)):
        s = np.maximum(t - at, 0.0)
        r += jump * (1.0 - np.exp(-s / T))
        psi += jump * (s - T * (1.0 - np.exp(-s / T)))
    return r, psi


@pytest.mark.parametrize("delay", [0.01, 0.04, 0.1, 0.23, 0.7])
@pytest.mark.parametrize("T", [0.5, 2.0, 20.0])
def test_a_delayed_motion_is_accurate_to_a_thousandth_across_command_jumps(delay: float, T: float) -> None:
    t = 0.1 * np.arange(100)
    r, psi = stepped(t, T)
    r_then, psi_then = stepped(t - delay, T)
    assert np.max(np.abs(earlier(t, r, delay, coasting=False) - r_then)) < 1e-3 * np.ptp(r)
    assert np.max(np.abs(earlier(t, psi, delay, coasting=True) - psi_then)) < 1e-3 * np.ptp(psi)


def test_close_stamps_of_several_channels_do_not_reduce_the_accuracy() -> None:
    t = np.sort(np.concatenate([0.1 * np.arange(100), 0.1 * np.arange(100) + 2e-4, 0.1 * np.arange(100) + 0.05]))
    r, _ = stepped(t, 0.5)
    assert np.max(np.abs(earlier(t, r, 0.13, coasting=False) - stepped(t - 0.13, 0.5)[0])) < 1e-3 * np.ptp(r)


def test_before_the_first_stamp_a_position_coasts_and_a_velocity_holds() -> None:
    t = 0.1 * np.arange(20)
    np.testing.assert_allclose(earlier(t, 2.0 + 0.5 * t, 0.3, coasting=True), 2.0 + 0.5 * (t - 0.3), atol=1e-12)
    assert earlier(t, 2.0 + 0.5 * t, 0.3, coasting=False)[0] == 2.0


def test_a_delay_has_the_right_derivative() -> None:
    t = 0.1 * np.arange(100)
    h = 1e-3
    for delay in (0.0303, 0.1203, 0.2503):
        for T in (1.0, 5.0):
            r, _ = stepped(t, T)
            got = (earlier(t, r, delay + h, coasting=False) - earlier(t, r, delay, coasting=False)) / h
            true = (stepped(t - delay - h, T)[0] - stepped(t - delay, T)[0]) / h
            assert np.max(np.abs(got - true)) < 0.03 * np.max(np.abs(true))


def test_a_delay_applies_to_all_signals_or_to_each_alone() -> None:
    effect = EFFECTS["measurement-delay"]
    assert effect.places(data_summary("psi", "r")) == ("psi", "r", "psi+r")
    assert effect.places(data_summary("psi")) == ("psi",)
    t = 0.1 * np.arange(100)
    r, psi = stepped(t, 2.0)
    seen = effect.observe(
        EffectInstance("measurement-delay", "psi", {"delay": 0.2}), Observed(t, {"r": r, "psi": psi}, 0.0)
    )
    np.testing.assert_array_equal(seen.signals["r"], r)
    assert np.max(np.abs(seen.signals["psi"] - psi)) > 0.1


# -- quantisation


@pytest.mark.parametrize("ratio", [2.6, 5.0, 20.0])
def test_rounded_readings_identify_the_noise_before_rounding(ratio: float) -> None:
    rng = np.random.default_rng(3)
    predicted = 2.0 * np.sin(0.05 * np.arange(900))
    level, about = 0.01, data_summary("psi")
    step = ratio * level
    read = np.round((predicted + level * rng.standard_normal(900)) / step) * step
    rest = left(read - predicted, predicted=predicted)
    own = EFFECTS["quantisation"].learn(begun("quantisation", "psi", about), [rest])
    assert own["step"] == pytest.approx(step, rel=1e-6)
    judged, _, _ = EFFECTS["quantisation"].judge(own, rest, np.zeros((900, 1)))
    assert np.sqrt(np.mean(judged**2)) == pytest.approx(level, rel=0.25 if ratio > 10.0 else 0.12)
    with_it, without = cost_of("quantisation", own, [rest])
    assert with_it < without - 300.0


def test_the_interval_likelihood_is_that_of_the_rounding_cells() -> None:
    rng = np.random.default_rng(4)
    predicted = 2.0 * np.sin(0.05 * np.arange(500))
    step, level = 0.05, 0.02
    read = np.round((predicted + level * rng.standard_normal(500)) / step) * step
    rest = left(read - predicted, predicted=predicted)
    own = EFFECTS["quantisation"].learn(begun("quantisation", "psi", data_summary("psi")), [rest])
    s = own.constants["level"]
    cells = norm.cdf((rest.error + step / 2) / s) - norm.cdf((rest.error - step / 2) / s)
    # Over the density's unit, less the constant, less one bit per reading that lies on the grid.
    expected = -2.0 * np.sum(np.log(cells / step)) - 500 * (1.0 + math.log(2.0 * math.pi)) - 1000 * math.log(2.0)
    assert cost_of("quantisation", own, [rest])[0] == pytest.approx(expected, abs=1e-6)


def test_a_worse_prediction_costs_more_with_noise_learnt_from_either() -> None:
    rng = np.random.default_rng(6)
    predicted = 2.0 * np.sin(0.05 * np.arange(900))
    read = np.round((predicted + 0.004 * rng.standard_normal(900)) / 0.035) * 0.035
    good = left(read - predicted, predicted=predicted)
    bad = left(read - 1.02 * predicted, predicted=1.02 * predicted)
    costs = {}
    for name, taught in (("good", good), ("bad", bad)):
        own = EFFECTS["quantisation"].learn(begun("quantisation", "psi", data_summary("psi")), [taught])
        costs[name] = [cost_of("quantisation", own, [x])[0] for x in (good, bad)]
        assert costs[name][0] < costs[name][1] - 100.0
    # Each prediction is likeliest with the noise it was taught by.
    assert costs["good"][0] < costs["bad"][0] and costs["bad"][1] < costs["good"][1]


@pytest.mark.parametrize("ratio", [3.0, 9.0])
def test_noise_sampled_within_the_rounding_cells_is_normal(ratio: float) -> None:
    rng = np.random.default_rng(7)
    predicted = 2.0 * np.sin(0.05 * np.arange(4000))
    step = 0.004 * ratio
    read = np.round((predicted + 0.004 * rng.standard_normal(4000)) / step) * step
    rest = left(read - predicted, predicted=predicted)
    own = EFFECTS["quantisation"].learn(begun("quantisation", "psi", data_summary("psi")), [rest])
    judged = EFFECTS["quantisation"].judge(own, rest, np.zeros((4000, 1)))[0]
    drawn = EFFECTS["quantisation"].normal(own, rest)
    assert kurtosis(judged) > 2.0 or ratio < 5.0
    assert abs(kurtosis(drawn)) < 0.25
    assert np.std(drawn) == pytest.approx(1.0, abs=0.05)
    assert np.all(np.abs(drawn * own.constants["level"] - rest.error) <= 0.5 * step * (1.0 + 1e-6))


@pytest.mark.parametrize("step", [1e-9, 0.002])
def test_a_grid_finer_than_the_noise_is_not_reported(step: float) -> None:
    rng = np.random.default_rng(5)
    predicted = 2.0 * np.sin(0.05 * np.arange(900))
    read = np.round((predicted + 0.01 * rng.standard_normal(900)) / step) * step
    rest = left(read - predicted, predicted=predicted)
    own = EFFECTS["quantisation"].learn(begun("quantisation", "psi", data_summary("psi")), [rest])
    assert own["step"] == 0.0
    judged, _, penalty = EFFECTS["quantisation"].judge(own, rest, np.zeros((900, 1)))
    np.testing.assert_array_equal(judged, rest.error)
    assert penalty == 0.0


def test_the_quantum_of_noise_free_readings_is_identified() -> None:
    predicted = 2.0 * np.sin(0.05 * np.arange(600))
    rest = left(np.round(predicted / 0.1) * 0.1 - predicted, predicted=predicted)
    own = EFFECTS["quantisation"].learn(begun("quantisation", "psi", data_summary("psi")), [rest])
    assert own["step"] == pytest.approx(0.1)
    judged, columns, penalty = EFFECTS["quantisation"].judge(own, rest, np.ones((600, 1)))
    assert np.all(np.isfinite(judged)) and np.all(np.isfinite(columns)) and math.isfinite(penalty)
    assert np.sqrt(np.mean(judged**2)) < 0.1 * np.sqrt(np.mean(rest.error**2))


def test_grids_are_detected_in_numbers_written_with_few_digits() -> None:
    degrees = np.round(40.0 * np.sin(0.1 * np.arange(300)))
    assert grid_step(np.round(np.radians(degrees), 6)) == pytest.approx(math.pi / 180.0, rel=1e-4)
    assert grid_step(np.random.default_rng(1).standard_normal(300)) == 0.0
    assert grid_step(np.zeros(300)) == 0.0


# -- outliers


def spiky(n: int, share: float, size: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    hit = rng.random(n) < share
    return 0.01 * rng.standard_normal(n) + hit * size * rng.standard_normal(n), hit


@pytest.mark.parametrize(("share", "size"), [(0.02, 0.1), (0.1, 0.08), (0.01, 1.0)])
def test_the_fraction_and_size_of_outliers_are_identified(share: float, size: float) -> None:
    runs = [left(spiky(600, share, size, 10 + k)[0], run=str(k)) for k in range(3)]
    effect = EFFECTS["outliers"]
    own = effect.learn(begun("outliers", "psi", data_summary("psi")), runs)
    std = effect.uncertainty(own, runs)
    assert abs(own["share"] - share) < 3.0 * std["share"]
    assert abs(own["size"] - size) < 3.0 * std["size"]
    with_it, without = cost_of("outliers", own, runs)
    assert with_it < without - 100.0


def test_the_cost_of_outliers_matches_their_distribution() -> None:
    rest = left(spiky(800, 0.05, 0.2, 4)[0])
    own = EFFECTS["outliers"].learn(begun("outliers", "psi", data_summary("psi")), [rest])
    level = own.constants["level"]
    broad = math.hypot(own["size"], level)
    one = np.log(own["share"]) + norm.logpdf(rest.error, scale=broad)
    other = np.log1p(-own["share"]) + norm.logpdf(rest.error, scale=level)
    exact = -2.0 * float(np.sum(np.logaddexp(one, other))) - 800 * (1.0 + math.log(2.0 * math.pi))
    got = cost_of("outliers", own, [rest])[0]
    # Each sample wholly of one law: never better than the mixture by more than the noise level's own fit.
    assert exact - 2.0 < got < exact + 0.1 * 800


@pytest.mark.parametrize("seed", range(20))
def test_normal_noise_does_not_support_outliers(seed: int) -> None:
    rest = left(0.01 * np.random.default_rng(seed).standard_normal(600))
    own = EFFECTS["outliers"].learn(begun("outliers", "psi", data_summary("psi")), [rest])
    with_it, without = cost_of("outliers", own, [rest])
    assert with_it > without - 2.0 * math.log(600)


def test_spikes_at_every_change_of_motion_are_not_outliers() -> None:
    rng = np.random.default_rng(7)
    at = np.arange(30, 600, 30)
    predicted = np.zeros(600)
    for k, i in enumerate(at):
        predicted[i:] += (-1.0) ** k
    error = 0.01 * rng.standard_normal(600)
    error[at] += 0.3 * np.sign(predicted[at] - predicted[at - 1])
    own = EFFECTS["outliers"].learn(begun("outliers", "psi", data_summary("psi")), [left(error, predicted=predicted)])
    assert own["share"] == 0.0
    bursts = 0.01 * rng.standard_normal(600)
    for i in at[::2]:
        bursts[i : i + 3] += 0.3
    own = EFFECTS["outliers"].learn(begun("outliers", "psi", data_summary("psi")), [left(bursts)])
    assert own["share"] == 0.0


def test_a_perfect_prediction_changes_no_disturbance() -> None:
    rests = [left(np.zeros(300), s) for s in ("psi", "r")]
    for slug, place in (("outliers", "psi"), ("quantisation", "psi"), ("wave-disturbance", "yaw")):
        own = EFFECTS[slug].learn(begun(slug, place, data_summary("psi", "r")), rests)
        for rest in rests:
            judged, _, penalty = EFFECTS[slug].judge(own, rest, np.ones((300, 2)))
            np.testing.assert_array_equal(judged, rest.error)
            assert penalty == 0.0


def test_single_outliers_in_noise_free_readings_are_detected() -> None:
    error = np.zeros(300)
    error[[50, 120, 200]] = (0.2, -0.3, 0.25)
    own = EFFECTS["outliers"].learn(begun("outliers", "psi", data_summary("psi")), [left(error)])
    assert own["share"] == pytest.approx(0.01, rel=0.1)


# -- waves


def wavy(
    n: int, frequency: float, bandwidth: float, force: float, seed: int, noise: float = 0.01, drift: float = 0.0
) -> list[EffectResidual]:
    """Return what a narrow-band moment leaves of heading and rate of ``2 r' + r = N``, by exact fine steps.

    drift : rms of a further moment, which follows the square of the envelope about its mean.
    """
    rng = np.random.default_rng(seed)
    w, z = frequency, bandwidth
    A = np.array([[0.0, w, 0.0, 0.0], [-w, -2 * z * w, 0.0, 0.0], [0.0, 0.5 * force, -0.5, 0.0], [0.0, 0.0, 1.0, 0.0]])
    dt = 0.02
    F = expm(A * dt)
    kick = math.sqrt(4.0 * z * w * dt)
    x = np.array([rng.standard_normal(), rng.standard_normal(), 0.0, 0.0])
    out = []
    for i in range(5 * (n + 200)):
        x = F @ x
        x[1] += kick * rng.standard_normal()
        x[2] += 0.5 * dt * drift * (0.5 * (x[0] ** 2 + x[1] ** 2) - 1.0)
        if i >= 1000 and i % 5 == 0:
            out.append(x[2:].copy())
    rows = np.array(out)
    psi = rows[:, 1] - rows[:, 1].mean()
    return [
        left(psi + noise * rng.standard_normal(n), "psi", run=str(seed)),
        left(rows[:, 0] + noise * rng.standard_normal(n), "r", run=str(seed)),
    ]


@pytest.mark.parametrize(("frequency", "bandwidth"), [(2.0, 0.05), (1.2, 0.15)])
def test_waves_are_identified_with_their_force_frequency_and_bandwidth(frequency: float, bandwidth: float) -> None:
    effect = EFFECTS["wave-disturbance"]
    rests = [x for k in range(3) for x in wavy(600, frequency, bandwidth, 0.1, 20 + k)]
    own = effect.learn(begun("wave-disturbance", "yaw", data_summary("psi", "r")), rests)
    std = effect.uncertainty(own, rests)
    for name, true in (("frequency", frequency), ("bandwidth", bandwidth), ("amplitude", 0.1)):
        assert std[name] < 0.5 * true
        assert abs(own[name] - true) < 3.0 * std[name], name
    for signal in ("psi", "r"):
        mine = [x for x in rests if x.signal == signal]
        with_it, without = cost_of("wave-disturbance", own, mine)
        assert with_it < without - 100.0
        white = np.concatenate([effect.judge(own, x, np.zeros((600, 1)))[0] for x in mine])
        rho = np.correlate(white, white, "full")[len(white) : len(white) + 8] / (white @ white)
        assert len(white) * float(np.sum(rho**2)) < 30.0


@pytest.mark.parametrize(("bandwidth", "drift", "seed"), [(0.1, 0.1, 40), (0.02, 0.005, 60)])
def test_waves_are_identified_together_with_the_slow_force_of_their_envelope(
    bandwidth: float, drift: float, seed: int
) -> None:
    """The weak slow force leaves a band without it acceptable, but seven times too wide."""
    effect = EFFECTS["wave-disturbance"]
    rests = [x for k in range(3) for x in wavy(600, 2.0, bandwidth, 0.1, seed + k, drift=drift)]
    own = effect.learn(begun("wave-disturbance", "yaw", data_summary("psi", "r")), rests)
    std = effect.uncertainty(own, rests)
    for name, true in (("frequency", 2.0), ("bandwidth", bandwidth), ("amplitude", 0.1), ("drift", drift)):
        assert std[name] < 0.5 * true
        assert abs(own[name] - true) < 3.0 * std[name], name
    for signal in ("psi", "r"):
        mine = [x for x in rests if x.signal == signal]
        white = np.concatenate([effect.judge(own, x, np.zeros((600, 1)))[0] for x in mine])
        rho = np.correlate(white, white, "full")[len(white) : len(white) + 8] / (white @ white)
        assert len(white) * float(np.sum(rho**2)) < 30.0


def test_one_sine_of_unknown_phase_is_a_wave_of_almost_no_bandwidth() -> None:
    t = 0.1 * np.arange(600)
    rng = np.random.default_rng(8)
    rest = left(0.03 * np.sin(3.0 * t + 1.0) + 0.01 * rng.standard_normal(600), "r")
    own = EFFECTS["wave-disturbance"].learn(begun("wave-disturbance", "yaw", data_summary("r")), [rest])
    assert own["frequency"] == pytest.approx(3.0, rel=0.01)
    assert own["bandwidth"] < 0.01
    # Of ``2 r' + r = N``: the rms of N behind a rate of 0.03 sin(3 t).
    assert own["amplitude"] == pytest.approx(0.03 / math.sqrt(2.0) * math.hypot(6.0, 1.0), rel=0.15)


def test_the_filter_gives_the_likelihood_of_the_whole_series() -> None:
    law = Oscillator(2.0, 0.1, 1.5, True, 4.0)
    t = np.sort(np.random.default_rng(2).uniform(0.0, 6.0, 40))
    A = np.array([[0.0, 2.0, 0.0], [-2.0, -0.4, 0.0], [1 / 1.5, 0.0, -1 / 1.5]])
    cov = np.eye(3)
    cov[2, :2] = cov[:2, 2] = np.linalg.solve(np.eye(2) / 1.5 - A[:2, :2], [1 / 1.5, 0.0])
    cov[2, 2] = cov[2, 0]
    h = np.array([1.0, 0.0, -1.0]) / math.sqrt(1.0 - cov[2, 0])
    K = np.array([[h @ expm(A * abs(a - b)) @ cov @ h for b in t] for a in t])
    K = 4.0 * np.tril(K) + 4.0 * np.tril(K, -1).T + np.eye(40)
    y = np.random.default_rng(3).multivariate_normal(np.zeros(40), K)
    E, deviation = whitened(law, t, y[:, None])
    got = -0.5 * float(E[:, 0] @ E[:, 0]) - float(np.sum(np.log(deviation))) - 20.0 * math.log(2.0 * math.pi)
    assert got == pytest.approx(float(multivariate_normal(np.zeros(40), K).logpdf(y)), rel=1e-9)


def colours(seed: int) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return residuals that are no waves, with the motion they go with."""
    rng = np.random.default_rng(seed)
    n = 900
    command = np.repeat(rng.choice([-1.0, 1.0], n // 30 + 1), 30)[:n]
    zigzag = np.sign(np.sin(0.07 * np.arange(n)))
    motion = np.zeros(n)
    relay = np.zeros(n)
    for i in range(1, n):
        motion[i] = motion[i - 1] + 0.05 * (command[i - 1] - motion[i - 1])
        relay[i] = relay[i - 1] + 0.05 * (zigzag[i - 1] - relay[i - 1])
    late = np.r_[np.zeros(4), motion[:-4]] - motion
    ringing = np.zeros(n)
    x = v = 0.0
    for i in range(1, n):
        v += 0.1 * (-25.0 * x - 0.3 * v) + 5.0 * (motion[i] - motion[i - 1])
        x += 0.1 * v
        ringing[i] = x
    walk = np.cumsum(0.01 * rng.standard_normal(n))
    slow = lfilter([0.03], [1.0, -0.97], lfilter([0.05], [1.0, -0.95], 0.3 * rng.standard_normal(n)))
    noise = 0.01 * rng.standard_normal(n)
    return {
        "late": (late + noise, motion),
        "weak": (0.2 * np.abs(relay) * relay + noise, relay),
        "relay phase": (np.r_[np.zeros(5), relay[:-5]] - relay + noise, relay),
        "ringing after its own motion": (ringing + noise, motion),
        "slow force": (slow + noise, motion),
        "random walk": (walk - walk.mean() + noise, motion),
        "white": (noise, motion),
    }


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("kind", list(colours(0)))
def test_coloured_residuals_without_a_narrow_band_are_not_waves(kind: str, seed: int) -> None:
    error, motion = colours(seed)[kind]
    own = begun("wave-disturbance", "yaw", data_summary("r"))
    learnt = EFFECTS["wave-disturbance"].learn(own, [left(error, "r", motion)])
    assert learnt["amplitude"] == 0.0


def test_residuals_of_a_smoothed_record_are_not_waves() -> None:
    """The zig-zags of a ship model, filtered by the basin, ended as waves."""
    rng = np.random.default_rng(7)
    swell, push = np.zeros(3000), rng.normal(size=3000)
    for i in range(2, 3000):
        swell[i] = 2.0 * 0.997 * np.cos(0.03) * swell[i - 1] - 0.997**2 * swell[i - 2] + push[i]
    error = np.convolve(swell, np.hanning(40) / np.hanning(40).sum(), "valid")
    error *= 0.1 / np.std(error)
    seen = error + rng.normal(0.0, 0.01, len(error))
    found = [
        EFFECTS["wave-disturbance"].learn(begun("wave-disturbance", "yaw", data_summary("r")), [left(e, "r")])
        for e in (error, seen)
    ]
    assert [own["amplitude"] > 0.0 for own in found] == [False, True]


def test_ringing_is_distinguished_from_waves_only_by_the_motion_of_the_craft(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gcs_autotune.effects.wave_disturbance.OWN", 1.0)
    error, motion = colours(1)["ringing after its own motion"]
    learnt = EFFECTS["wave-disturbance"].learn(
        begun("wave-disturbance", "yaw", data_summary("r")), [left(error, "r", motion)]
    )
    assert learnt["amplitude"] > 0.0


def test_a_wave_has_no_force_without_a_known_craft() -> None:
    about = data_summary("r", base={})
    own = begun("wave-disturbance", "yaw", about)
    assert "amplitude" not in own.values
    rests = [x for x in wavy(600, 2.0, 0.05, 0.1, 31) if x.signal == "r"]
    learnt = EFFECTS["wave-disturbance"].learn(own, rests)
    assert learnt["frequency"] == pytest.approx(2.0, rel=0.05)
    assert "amplitude" not in learnt.values


def test_curves_are_plotted_from_the_learnt_values() -> None:
    about = data_summary("psi", "r")
    wave = EFFECTS["wave-disturbance"].learn(begun("wave-disturbance", "yaw", about), wavy(600, 2.0, 0.1, 0.1, 5))
    spectrum = EFFECTS["wave-disturbance"].curve(wave, about)
    assert spectrum is not None
    # The area under a spectrum is the variance.
    assert np.trapezoid(spectrum.y, spectrum.x) == pytest.approx(wave["amplitude"] ** 2, rel=0.1)
    spikes = EFFECTS["outliers"].learn(begun("outliers", "psi", about), [left(spiky(600, 0.05, 0.2, 1)[0])])
    law = EFFECTS["outliers"].curve(spikes, about)
    assert law is not None
    assert np.trapezoid(law.y, law.x) == pytest.approx(1.0, abs=0.02)
    stairs = EFFECTS["quantisation"].curve(EffectInstance("quantisation", "psi", {"step": 0.1}), about)
    assert stairs is not None
    assert np.ptp(stairs.y - stairs.x) == pytest.approx(0.1, rel=0.05)
