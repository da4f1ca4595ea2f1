"""The method zig-zag and its figures: simulated ships of known K and T, and a measured tanker."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ship_plants import DEG, ZigZag, nomoto, sail

from gcs_autotune.errors import BadFile, NotInformative
from gcs_autotune.identify import fit_axis, validate
from gcs_autotune.identify.open_loop import rows_of
from gcs_autotune.identify.open_loop.zigzag_integrals import half_periods
from gcs_autotune.identify.signals import prepare
from gcs_autotune.seatrials import Particulars, ship_figures
from gcs_autotune.seatrials.criteria import helm_text
from gcs_autotune.trial import Channel, load_trial

K, T = 0.25, 4.0


def zigzag(bias=0.0, noise=0.0, seed=0, helm=20.0, heading=20.0, duration=150.0, **more):
    return sail(
        nomoto(K, T, bias), ZigZag(helm * DEG, heading * DEG), duration, noise=noise, seed=seed, name="zz", **more
    )


@pytest.fixture(scope="module")
def tanker():
    folder = Path(__file__).parents[2] / ".." / "shared" / "data" / "kvlcc2_hsva"
    if not folder.exists():
        pytest.skip("kvlcc2_hsva is not beside the repository (../shared/data)")
    return lambda name: load_trial(folder / f"{name}.csv")


def test_plain_half_periods_match_the_integrals_of_the_thesis_without_a_bias():
    rows = rows_of(prepare(zigzag(), "yaw")[0])
    values = half_periods(rows)
    alphas = [h.alpha for h in values if math.isfinite(h.alpha)]
    betas = [h.beta for h in values if math.isfinite(h.beta)]
    assert len(alphas) > 4
    assert np.allclose(alphas, T / K, rtol=2e-3)
    assert np.allclose(betas, 1.0 / K, rtol=2e-3)


def test_gain_time_constant_and_rudder_bias_are_identified_together():
    fit = fit_axis(zigzag(bias=1.0 * DEG), method="zig-zag", length=7.0, speed=1.0)
    assert fit.extra["K"] == pytest.approx(K, rel=3e-3)
    assert fit.extra["T"] == pytest.approx(T, rel=3e-3)
    assert fit.model.delta == pytest.approx(1.0 * DEG, rel=0.03)
    assert fit.extra["K_prime"] == pytest.approx(7.0 * K, rel=3e-3)
    assert fit.extra["T_prime"] == pytest.approx(T / 7.0, rel=3e-3)


@pytest.mark.slow
def test_standard_errors_cover_the_truth_with_a_noisy_compass():
    z = []
    for seed in range(12):
        fit = fit_axis(zigzag(bias=0.5 * DEG, noise=0.3 * DEG, seed=seed), method="zig-zag")
        z += [(fit.extra[n] - truth) / fit.extra[f"{n}_std"] for n, truth in (("K", K), ("T", T))]
    assert 0.5 < np.std(z) < 1.5
    assert abs(np.mean(z)) < 0.7


def test_a_nonlinear_ship_is_reported_and_fitted_on_request():
    def yaw(r, delta):
        return (delta + 0.01 - (1.0 + 30.0 * abs(r)) * r) / 8.0

    run = sail(yaw, ZigZag(20 * DEG, 20 * DEG), 150.0, noise=0.1 * DEG, seed=4)
    assert "nonlinear-drag" in {d.slug for d in fit_axis(run, method="zig-zag").doubts}
    fit = fit_axis(run, method="zig-zag", structure="affine")
    for name, truth in (("alpha_r", 8.0), ("beta_r", 1.0), ("beta_rr", 30.0), ("delta", 0.01)):
        assert abs(fit.parameters[name].value - truth) < 4.0 * fit.parameters[name].std + 0.02 * truth, name


def test_the_gain_of_a_rudder_recorded_as_normalised_output_is_per_radian():
    run, full = zigzag(noise=0.05 * DEG), 30.0 * DEG
    delta = run["delta"]
    share = Channel("N", "1", delta.t, delta.values / full)
    channels = {n: c for n, c in run.channels.items() if n != "delta"}
    flown = replace(run, channels={**channels, "N": share}, meta={"full_rudder": full})
    both = replace(run, channels={**run.channels, "N": share})
    for record in (flown, both):
        (sheet,) = ship_figures(record, Particulars(length=7.0, speed=1.0))
        assert sheet["helm"].reading.value == pytest.approx(20.0 * DEG, rel=1e-3)
        assert sheet["K"].reading.value == pytest.approx(K, rel=0.01)
        assert sheet["K"].reading.unit == "1/s"
        assert sheet["K-prime"].reading.value == pytest.approx(7.0 * K, rel=0.02)  # at 1 m/s
        assert sheet["T"].reading.value == pytest.approx(T, rel=0.02)


def test_the_gain_of_thrusters_is_per_full_output():
    run = zigzag()
    share = Channel("N", "1", run["delta"].t, run["delta"].values)
    (sheet,) = ship_figures(replace(run, channels={**{n: run[n] for n in ("psi", "x", "y")}, "N": share}))
    assert sheet["K"].reading.value == pytest.approx(K, rel=0.01)
    assert sheet["K"].reading.unit == "rad/s"


def test_a_slow_rudder_does_not_bias_gain_and_time_constant():
    fit = fit_axis(zigzag(rudder_rate=5.0 * DEG), method="zig-zag")
    assert fit.extra["K"] == pytest.approx(K, rel=0.01)
    assert fit.extra["T"] == pytest.approx(T, rel=0.02)


def test_overshoots_and_times_match_the_exact_solution():
    (sheet,) = ship_figures(zigzag(helm=10.0, heading=10.0, noise=0.05 * DEG, seed=1), Particulars(7.0))
    # from the first execute: psi = K delta (t - T (1 - exp(-t/T))); after the reversal the rate passes zero
    helm, t = 10.0 * DEG, 0.0
    for _ in range(60):
        turned = K * helm * (t - T * (1.0 - math.exp(-t / T)))
        t += (10.0 * DEG - turned) / (K * helm * (1.0 - math.exp(-t / T)) + 1e-9)
    rate = K * helm * (1.0 - math.exp(-t / T))
    check = T * math.log((rate + K * helm) / (K * helm))
    over = (rate + K * helm) * T * (1.0 - math.exp(-check / T)) - K * helm * check
    turning = sheet["initial-turning-time"].reading.value
    late = turning - t  # the helmsman looks every 0.1 s
    assert -1e-6 <= late <= 0.1 + 1e-6
    assert sheet["first-overshoot"].reading.value == pytest.approx(over, rel=0.03)
    assert sheet["time-to-check"].reading.value == pytest.approx(check, abs=0.1)
    assert sheet["initial-turning"].reading.value == pytest.approx(turning, rel=1e-2)  # at 1 m/s
    assert sheet.title == "10/10 zig-zag, first to starboard"
    assert sheet["overshoot-3"].name == "third overshoot angle"


def test_the_title_states_the_ordered_angles():
    flown = replace(
        zigzag(helm=20.0, heading=20.0), meta={"heading": 20.0 * DEG, "steering": -2 / 3, "full_rudder": 30.0 * DEG}
    )
    turned = flown["psi"].values * 1.3  # the turn goes on until the helm is over
    late = replace(flown, channels={**flown.channels, "psi": replace(flown["psi"], values=turned)})
    assert ship_figures(late)[0].title.startswith("20/20 zig-zag")
    by_share = replace(late.channels["delta"], name="N", unit="1", values=late["delta"].values / (30.0 * DEG))
    shares = replace(
        late, meta={"heading": 20.0 * DEG, "steering": 2 / 3}, channels={"psi": late["psi"], "N": by_share}
    )
    (sheet,) = ship_figures(shares)
    assert sheet.title.startswith("67 %/20° zig-zag")
    assert next(f.name for f in sheet.figures if f.slug == "helm") == "helm"
    weaker = replace(by_share, values=0.9 * by_share.values)  # a mixer that saturates sends less
    (sheet,) = ship_figures(replace(shares, channels={**shares.channels, "N": weaker}))
    assert sheet.title.startswith("67 %/20° zig-zag")
    assert next(f.name for f in sheet.figures if f.slug == "helm") == "helm at the output (ordered: 67 %)"


def test_the_title_of_a_record_without_orders_uses_likely_round_numbers():
    run = zigzag(helm=20.0, heading=10.0)
    late = replace(run, channels={**run.channels, "psi": replace(run["psi"], values=1.1 * run["psi"].values)})
    assert ship_figures(late)[0].title.startswith("20/10 zig-zag")


def test_criteria_follow_length_over_speed_at_full_scale():
    run = zigzag(helm=10.0, heading=10.0)
    model, full = (ship_figures(run, Particulars(7.0, scale=s))[0]["first-overshoot"] for s in (1.0, 9.0))
    assert math.degrees(model.limit.value) == pytest.approx(10.0)  # 7 s
    assert math.degrees(full.limit.value) == pytest.approx(5.0 + 0.5 * 21.0, rel=1e-3)
    assert model.verdict in ("meets", "fails")
    assert ship_figures(run)[0]["first-overshoot"].limit is None


def test_a_rudder_of_the_other_sign_gives_the_same_figures():
    run = zigzag()
    turned = replace(run.channels["delta"], values=-run.channels["delta"].values)
    mirrored = replace(run, channels={**run.channels, "delta": turned})
    (one,), (other,) = ship_figures(run), ship_figures(mirrored)
    assert [f.reading.value for f in one.figures] == pytest.approx([f.reading.value for f in other.figures])
    assert fit_axis(mirrored, method="zig-zag").parameters["beta_r"].value == pytest.approx(-1.0 / K, rel=5e-3)


def test_a_log_of_time_heading_and_rudder_alone_is_enough(tmp_path):
    run = zigzag(noise=0.1 * DEG)
    rows = zip(run["psi"].t, run["psi"].values / DEG, run["delta"].values / DEG, strict=True)
    path = tmp_path / "zigzag.csv"
    path.write_text("t[s],psi[deg],delta[deg]\n" + "\n".join(f"{t:.1f},{p:.1f},{d:.0f}" for t, p, d in rows) + "\n")
    (sheet,) = ship_figures(load_trial(path))
    assert sheet.manoeuvre == "zig-zag"
    assert sheet["K"].reading.value == pytest.approx(K, rel=0.02)


def test_degrees_without_a_unit_are_rejected_with_the_cure(tmp_path):
    path = tmp_path / "zigzag.csv"
    run = zigzag()
    rows = zip(run["psi"].t, run["psi"].values / DEG, run["delta"].values / DEG, strict=True)
    path.write_text("t,psi,delta\n" + "\n".join(f"{t:.1f},{p:.2f},{d:.2f}" for t, p, d in rows) + "\n")
    with pytest.raises(BadFile, match=r"delta\[deg\]"):
        ship_figures(load_trial(path))


def test_a_heading_sampled_too_slowly_for_rates_gives_angles_but_no_indices():
    run = zigzag(noise=0.1 * DEG)
    slow = replace(run["psi"], t=run["psi"].t[::10], values=run["psi"].values[::10])
    seldom = replace(run, channels={"psi": slow, "delta": run["delta"]})
    (sheet,) = ship_figures(seldom)
    (doubt,) = (d for d in sheet.doubts if d.slug == "slow-sampling")
    assert "times from one helm order to the next" in doubt.cause
    assert "K" not in {f.slug for f in sheet.figures}
    assert sheet["period"].reading.value == pytest.approx(ship_figures(run)[0]["period"].reading.value, rel=0.02)
    with pytest.raises(NotInformative, match="often enough"):
        fit_axis(seldom, method="zig-zag")


def test_noise_is_not_a_zigzag():
    run = zigzag()
    wild = replace(run["psi"], values=np.random.default_rng(1).normal(size=len(run["psi"])))
    with pytest.raises(NotInformative):
        ship_figures(replace(run, channels={"psi": wild, "delta": run["delta"]}))


def test_a_steady_course_is_not_a_zigzag():
    run = sail(nomoto(K, T), lambda t, psi: 1.0 * DEG if t > 30.0 else 0.0, 60.0)
    with pytest.raises(NotInformative, match="no zig-zag"):
        ship_figures(run, manoeuvre="zig-zag")


def test_the_measured_tanker_has_positive_figures_for_either_rudder_sign(tanker):
    (sheet,) = ship_figures(tanker("Z_10_10_S"), Particulars(7.0, scale=45.714))
    assert sheet.title == "10/10 zig-zag, first to starboard"
    first, second = sheet["first-overshoot"], sheet["second-overshoot"]
    assert 5.0 < math.degrees(first.reading.value) < 15.0 < math.degrees(second.reading.value) < 30.0
    assert (first.verdict, second.verdict) == ("meets", "meets")
    assert sheet["approach"].reading.value == pytest.approx(1.177, abs=0.01)
    (other,) = ship_figures(tanker("Z_20_10_P"))
    assert other.title.endswith("first to port")


def test_as_many_parameters_as_half_periods_are_rejected(tanker):
    with pytest.raises(NotInformative, match="Fly more"):
        fit_axis(tanker("Z_10_10_S"), method="zig-zag", structure="affine")


def test_a_tankers_zigzag_predicts_another_one(tanker):
    fit = fit_axis(tanker("Z_20_05"), method="zig-zag", length=7.0, speed=1.177)
    assert fit.model.beta < 0.0  # positive rudder turns to port in these files
    assert validate(fit.model, tanker("Z_20_10_P")).fit_percent > 75.0


@pytest.mark.parametrize(
    ("helm", "unit", "words"), [(math.radians(20.0), "rad", "20"), (2 / 3, "1", "67 %"), (12.34, "N m", "12.3")]
)
def test_a_helm_is_printed_in_degrees_or_percent_of_full_output(helm: float, unit: str, words: str) -> None:
    assert helm_text(helm, unit) == words


@pytest.mark.slow
def test_the_distance_to_the_second_execute_is_not_biased_by_position_noise():
    z = []
    for seed in range(12):
        run = zigzag(seed=seed)
        t, psi = run["psi"].t, run["psi"].values
        noise = 0.05 * np.random.default_rng(seed).standard_normal((2, len(t)))
        steps = np.stack([np.cos(psi), np.sin(psi)]) * np.gradient(t)
        x, y = np.cumsum(steps, axis=1) + noise
        channels = {**run.channels, "x": Channel("x", "m", t, x), "y": Channel("y", "m", t, y)}
        (sheet,) = ship_figures(replace(run, channels=channels))
        result = {f.slug: f.reading for f in sheet.figures}
        run_at_one_metre_per_second = result["initial-turning-time"].value
        assert result["initial-turning"].value == pytest.approx(run_at_one_metre_per_second, rel=0.03)
        z.append((result["initial-turning"].value - run_at_one_metre_per_second) / result["initial-turning"].std)
    assert np.std(z) < 1.5
    assert abs(np.mean(z)) < 0.7
