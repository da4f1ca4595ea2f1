"""Bad data for one axis: never a traceback, never a confident wrong answer."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from axis_plants import DEG, Levels, Relay

from gcs_autotune.cli import main
from gcs_autotune.errors import BadFile, MissingChannel, NotInformative
from gcs_autotune.identify import Fit, fit, form_of
from gcs_autotune.identify.outlier_run import CraftEstimate, outlier_runs
from gcs_autotune.identify.problems import plain_form
from gcs_autotune.identify.signals.cleaning import clipped, within_range
from gcs_autotune.trial import Channel, Trial, save_trial

Record = Callable[..., Trial]
TRUTH = (0.36, 0.2, 0.0, 0.02)
OTHER = (0.36 * 1.6, 0.2, 0.0, 0.02)


@pytest.fixture(scope="module")
def good(record: Record) -> Trial:
    return record(TRUTH, Relay(0.4, 8 * DEG), 60.0, noise=0.003, rate_noise=0.004, seed=3, name="good")


def with_channel(trial: Trial, name: str, **changes: object) -> Trial:
    channels = dict(trial.channels)
    channels[name] = dataclasses.replace(channels[name], **changes)  # type: ignore[arg-type]  # t, values, unit
    return dataclasses.replace(trial, channels=channels)


def on_every_channel(trial: Trial, change: Callable[[Channel], Channel]) -> Trial:
    return dataclasses.replace(trial, channels={n: change(c) for n, c in trial.channels.items()})


def slugs(found: Fit) -> set[str]:
    return {d.slug for d in found.doubts}


def is_right(found: Fit, truth: tuple[float, ...] = TRUTH) -> bool:
    pairs = zip(list(found.parameters.values())[:4], truth, strict=True)
    return all(abs(p.value - true) <= 4.0 * p.std + 1e-9 for p, true in pairs)


def test_gaps_in_the_record_do_not_bias_the_fit(good: Trial) -> None:
    def holed(c: Channel) -> Channel:
        keep = ~(((c.t > 15.0) & (c.t < 18.0)) | ((c.t > 40.0) & (c.t < 47.0)))
        return dataclasses.replace(c, t=c.t[keep], values=c.values[keep])

    drive = good["N"]
    found = fit(dataclasses.replace(on_every_channel(good, holed), channels={
        **on_every_channel(good, holed).channels, "N": drive}), structure="linear")  # fmt: skip
    assert "gaps" in slugs(found)
    assert is_right(found)


def test_repeated_stamps_are_dropped_and_reported(good: Trial) -> None:
    doubled = on_every_channel(
        good, lambda c: dataclasses.replace(c, t=np.repeat(c.t, 2), values=np.repeat(c.values, 2))
    )
    found = fit(doubled, structure="linear")
    assert "repeated-stamps" in slugs(found)
    assert found.parameters["alpha_r"] == dataclasses.replace(fit(good, structure="linear").parameters["alpha_r"])


def test_a_clock_that_restarts_splits_the_run(good: Trial) -> None:
    def restarted(c: Channel) -> Channel:
        return dataclasses.replace(c, t=np.where(c.t >= 30.0, c.t - 25.0, c.t))

    found = fit(on_every_channel(good, restarted), structure="linear")
    assert "clock-jump" in slugs(found)
    assert found.used == ("good (part 1)", "good (part 2)")
    assert is_right(found)


def test_a_few_late_samples_are_sorted_and_reported(good: Trial) -> None:
    def shuffled(c: Channel) -> Channel:
        t, values = c.t.copy(), c.values.copy()
        for i in (50, 200, 380):
            t[[i, i + 1]], values[[i, i + 1]] = t[[i + 1, i]], values[[i + 1, i]]
        return dataclasses.replace(c, t=t, values=values)

    found = fit(on_every_channel(good, shuffled), structure="linear")
    assert "late-samples" in slugs(found)
    assert is_right(found)


def test_a_clock_that_jumps_on_one_channel_only_is_rejected_with_the_time(good: Trial) -> None:
    t = good["psi"].t.copy()
    t[200:] -= 5.0
    with pytest.raises(BadFile, match=r"jumps back after t = 19\.9"):
        fit(with_channel(good, "psi", t=t))


def test_samples_and_stamps_that_are_not_numbers_are_left_out(good: Trial) -> None:
    values, t = good["psi"].values.copy(), good["psi"].t.copy()
    values[[5, 80, 81]], t[150], values[300] = np.nan, np.nan, np.inf
    found = fit(with_channel(good, "psi", t=t, values=values), structure="linear")
    assert any(d.slug == "missing-samples" and d.cause.startswith("5 samples of psi") for d in found.doubts)
    assert is_right(found)


def test_a_constant_input_is_not_informative(good: Trial) -> None:
    with pytest.raises(NotInformative, match="never changes"):
        fit(with_channel(good, "N", values=np.full(len(good["N"]), 0.4)), dof="yaw")


def test_a_run_without_information_is_left_out_and_reported(good: Trial, record: Record) -> None:
    still = dataclasses.replace(
        with_channel(record(TRUTH, Relay(0.4, 8 * DEG)), "N", values=np.full(400, 0.3)), name="still"
    )
    found = fit([good, still], structure="linear", dof="yaw")
    assert found.used == ("good",)
    assert any(d.slug == "run-left-out" and "'still'" in d.cause for d in found.doubts)
    assert is_right(found)


@pytest.mark.parametrize(
    ("channel", "factor"),
    [("psi", 180.0 / np.pi), ("psi", np.pi / 180.0), ("r", 180.0 / np.pi), ("r", np.pi / 180.0)],
)
def test_degrees_labelled_radians_contradict_the_other_column_and_are_rejected(
    good: Trial, channel: str, factor: float
) -> None:
    wrong = with_channel(good, channel, values=good[channel].values * factor)
    with pytest.raises(BadFile, match=r"psi turns .*run 'good'.*The factor of degrees is 57\.3"):
        fit(wrong)


@pytest.mark.parametrize(("factor", "words"), [(180.0 / np.pi, "degrees"), (np.pi / 180.0, "radians")])
def test_the_wrap_of_a_heading_reveals_its_unit(record: Record, factor: float, words: str) -> None:
    spin = record(TRUTH, lambda t, _: 0.15 + 0.1 * np.sign(np.sin(0.5 * t)), 60.0, noise=0.003, name="spin")
    assert np.ptp(np.unwrap(spin["psi"].values)) > 4.0 * np.pi
    with pytest.raises(BadFile, match=f"wraps round at .* the numbers are {words}"):
        fit(with_channel(spin, "psi", values=spin["psi"].values * factor))


def test_a_heading_in_degrees_that_never_wraps_is_doubted_for_its_rate(record: Record) -> None:
    relay = record((*TRUTH[:3], 0.0), Relay(0.04, 6 * DEG), 120.0, noise=0.002, name="fast")
    degrees = with_channel(relay, "psi", values=relay["psi"].values * 180.0 / np.pi)
    assert any(d.slug == "unit" and "turns faster" in d.cause for d in fit(degrees, structure="linear").doubts)
    assert "unit" not in slugs(fit(relay, structure="linear"))


def test_a_gap_in_the_input_is_a_gap_in_the_record(good: Trial) -> None:
    drive = good["N"]
    known = (drive.t < 20.0) | (drive.t > 26.0)
    assert len(set(drive.between(20.0, 26.0).values)) > 1
    found = fit(with_channel(good, "N", t=drive.t[known], values=drive.values[known]), structure="linear")
    assert {"input-gaps", "gaps"} <= slugs(found)
    assert is_right(found)


def test_depth_in_centimetres_with_a_climb_rate_in_metres_is_rejected(record: Record) -> None:
    dive = record((12.0, 4.0, 15.0, 0.0), Relay(10.0, 0.3), 80.0, noise=0.01, rate_noise=0.01, dof="heave", name="dive")
    with pytest.raises(BadFile, match=r"z changes 100 times as much as w integrates to .*is in cm"):
        fit(with_channel(dive, "z", values=dive["z"].values * 100.0))


def test_a_depth_and_a_vertical_speed_of_opposite_sign_are_doubted(record: Record) -> None:
    dive = record((12.0, 4.0, 15.0, 0.0), Relay(10.0, 0.3), 80.0, noise=0.01, rate_noise=0.01, dof="heave", name="dive")
    found = fit(with_channel(dive, "z", values=-dive["z"].values))
    assert {"contradiction", "reversed-input"} <= slugs(found)


def test_knots_labelled_metres_per_second_are_doubted(record: Record) -> None:
    rng = np.random.default_rng(5)
    run = record((60.0, 25.0, 40.0, 0.0), Levels(rng, 60.0, 6.0), 120.0, noise=0.05, rate_noise=0.01, dof="surge")
    knots = with_channel(run, "u", values=run["u"].values * 3600.0 / 1852.0)
    still = Channel("y", "m", run["x"].t, np.zeros(len(run["x"])))
    sideways = Channel("v", "m/s", run["u"].t, np.zeros(len(run["u"])))
    found = fit(dataclasses.replace(knots, channels={**knots.channels, "y": still, "v": sideways}), dof="surge")
    assert any(d.slug == "contradiction" and "knots" in d.cause for d in found.doubts)


def test_a_correct_record_raises_no_doubt_about_its_units(good: Trial) -> None:
    assert not slugs(fit(good)) & {"unit", "sign", "clipped", "clock-jump", "late-samples", "run-apart"}


def test_a_clipped_gyro_is_reported_and_its_clipped_samples_left_out(record: Record) -> None:
    run = record(TRUTH, Relay(0.4, 20 * DEG), 80.0, rate_noise=0.004, seed=4, name="fast")
    rate_only = Trial("fast", {"N": run["N"], "r": run["r"]})
    limit = 0.75 * float(np.max(np.abs(run["r"].values)))
    clipped = with_channel(rate_only, "r", values=np.clip(run["r"].values, -limit, limit))
    found = fit(clipped, structure="linear", dof="yaw")
    assert "clipped" in slugs(found)
    assert is_right(found)
    assert "clipped" not in slugs(fit(rate_only, structure="linear", dof="yaw"))


def test_a_craft_that_levels_off_at_its_steady_speed_is_not_clipped() -> None:
    """A climb rate in whole centimetres per second, at ten a second, of a craft that dwells near its greatest speed."""
    down = (-4, -28, -43, -52, -55, -59, -60, -60, -60, -26, 1, 25, 41, 50, 54, 57, 58, 57, 57, 59, 25)
    slow = (-5, -28, -44, -52, -56, -59, -59, -59, -59, -27, 1, 25, 41, 50, 54, 57, 57, 58, 58, 58, 24)
    w = 0.01 * np.array((*down, *slow) * 3)
    assert not clipped(Channel("w", "m/s", 0.1 * np.arange(len(w)), w)).any()


def test_the_peak_of_a_smooth_speed_is_not_clipped() -> None:
    """A climb rate in whole centimetres per second, at ten a second: an ROV with a short push up."""
    push = (0, -8, -36, -56, -65, -69, -69, -69, -68, -65, -64, -61, -58, -55, -50, -45, -41, -35, -31, -28, -24)
    settled = [-20, -20, -17, -15, -11, -9, -9, -6, -4, -1, -1, 0, 1, 1] * 8
    w = 0.01 * np.array((*push, *settled))
    assert not clipped(Channel("w", "m/s", 0.1 * np.arange(len(w)), w)).any()
    cut = np.maximum(w, -0.5)
    assert clipped(Channel("w", "m/s", 0.1 * np.arange(len(w)), cut)).sum() == np.sum(w <= -0.5)


def test_a_heading_that_turns_back_quickly_is_not_clipped() -> None:
    t = 0.1 * np.arange(400)
    turned = Channel("psi", "rad", t, np.round(np.clip(3.0 * np.sin(0.7 * t), -2.5, 2.5), 3))
    notes: list[Any] = []
    assert within_range(dataclasses.replace(turned, name="theta"), "run", notes) is not turned
    assert [n.slug for n in notes] == ["clipped"]
    assert within_range(turned, "run", notes) is turned


def test_rest_and_a_coarse_scale_are_not_clipping(record: Record) -> None:
    def pulses(t: float, _: float) -> float:
        return 0.3 if t % 40.0 < 3.0 else -0.3 if 20.0 < t % 40.0 < 23.0 else 0.0

    exact = record((0.36, 0.4, 0.0, 0.0), pulses, 80.0, name="pulses", rate_noise=0.0)
    coarse = with_channel(
        record(TRUTH, Relay(0.4, 8 * DEG), 80.0), "psi",
        values=np.round(record(TRUTH, Relay(0.4, 8 * DEG), 80.0)["psi"].values / DEG) * DEG,
    )  # fmt: skip
    for trial in (exact, coarse):
        assert "clipped" not in slugs(fit(trial, structure="linear", dof="yaw"))


@pytest.mark.slow
def test_a_run_of_another_craft_is_reported_with_its_distance(record: Record) -> None:
    mine = [
        record(TRUTH, Relay(C, 8 * DEG), 60.0, noise=0.003, rate_noise=0.004, seed=k, name=f"mine {k}")
        for k, C in enumerate((0.3, 0.4, 0.6))
    ]
    strange = record(OTHER, Relay(0.4, 8 * DEG), 60.0, noise=0.003, rate_noise=0.004, seed=9, name="strange")
    found = fit([mine[0], strange, *mine[1:]], structure="linear")
    apart = [d for d in found.doubts if d.slug == "run-apart"]
    assert [("'strange'" in d.cause, "standard errors" in d.cause) for d in apart] == [(True, True)]
    assert not slugs(fit(mine, structure="linear")) & {"run-apart", "runs-disagree"}


def test_two_runs_that_differ_are_both_reported(record: Record) -> None:
    runs = [
        record(p, Relay(0.4, 8 * DEG), 60.0, noise=0.003, seed=k, name=f"run {k}") for k, p in enumerate((TRUTH, OTHER))
    ]
    (doubt,) = (d for d in fit(runs, structure="linear").doubts if d.slug == "run-apart")
    assert "'run 0' and 'run 1'" in doubt.cause


def test_runs_of_one_craft_are_rarely_reported_as_different() -> None:
    """The chi-squared law itself, on estimates drawn with their covariance."""
    rng = np.random.default_rng(0)
    C = np.array([[0.09, 0.05], [0.05, 0.04]])
    false = 0
    for _ in range(400):
        draws = rng.multivariate_normal([1.0, 2.0], C, size=4)

        def estimate(which: tuple[int, ...], draws: np.ndarray = draws) -> CraftEstimate:
            return CraftEstimate(draws[list(which)].mean(axis=0), C / len(which))

        false += bool(outlier_runs(("a", "b", "c", "d"), estimate, sigmas=3.0))
    assert false <= 10  # four comparisons of 0.27 % each: about 4 in 400


def test_positions_at_1_hz_with_inputs_at_10_hz_identify_surge(record: Record) -> None:
    rng = np.random.default_rng(5)
    truth = (60.0, 25.0, 0.0, 1.0)
    run = record(truth, Levels(rng, 60.0, 6.0), 200.0, noise=0.3, dof="surge", seed=2)
    gps = Trial("gps", {"X": run["X"], "x": Channel("x", "m", run["x"].t[::10], run["x"].values[::10])})
    assert is_right(fit(gps, structure="linear"), truth)


def test_surge_is_taken_along_the_track_and_not_towards_north(record: Record) -> None:
    rng = np.random.default_rng(5)
    truth = (60.0, 25.0, 0.0, 1.0)
    run = record(truth, Levels(rng, 60.0, 6.0), 200.0, noise=0.1, dof="surge", seed=2)
    t, s = run["x"].t, run["x"].values
    heading = 1.2
    track = {"X": run["X"], "x": Channel("x", "m", t, s * np.cos(heading)),
             "y": Channel("y", "m", t, s * np.sin(heading)),
             "psi": Channel("psi", "rad", t, np.full(len(t), heading))}  # fmt: skip
    assert is_right(fit(Trial("track", track), structure="linear", dof="surge"), truth)
    circling = {**track, "psi": Channel("psi", "rad", t, 0.05 * t)}
    with pytest.raises(NotInformative, match="horizontal"):
        fit(Trial("circle", circling), structure="linear", dof="surge")


@pytest.mark.parametrize("seed", range(40))
def test_a_randomly_damaged_file_gives_a_result_or_one_clear_message(
    good: Trial, seed: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = np.random.default_rng(seed)
    save_trial(good.between(0.0, 30.0), tmp_path / "run.csv")
    (tmp_path / "run.json").unlink()
    lines = (tmp_path / "run.csv").read_text().splitlines()
    for _ in range(int(rng.integers(1, 6))):
        kind, i = int(rng.integers(6)), int(rng.integers(1, len(lines) - 30))
        if kind == 0:
            lines[i] = ",".join(["nan", *lines[i].split(",")[1:]])
        elif kind == 1:
            lines[i : i + 20] = lines[i : i + 20][::-1]
        elif kind == 2:
            lines[i] = lines[i].replace("0", "1e30", 1)
        elif kind == 3:
            lines += lines[i : i + 25]
        elif kind == 4:
            del lines[i : i + 25]
        else:
            lines[i] = lines[i][: int(rng.integers(len(lines[i])))]
    (tmp_path / "run.csv").write_text("\n".join(lines) + "\n")
    code = main(
        ["identify", str(tmp_path / "run.csv"), "--dof", "yaw", "--structure", "linear", "--no-check", "--json"]
    )
    out, err = capsys.readouterr()
    assert code in (0, 6)
    assert "Traceback" not in err
    assert (code == 0) == bool(out)
    if code == 0:
        answer = json.loads(out)
        answer = answer.get("fit", answer)
        inertia = answer["parameters"]["alpha_r"]
        assert abs(inertia["value"] - TRUTH[0]) <= 4.0 * inertia["std"]
    if code:
        assert err.startswith("gcs-autotune: ") and err.count("\n") == 1


def driven_by_two_thrusters(good: Trial) -> Trial:
    channels = {n: c for n, c in good.channels.items() if n != "N"}
    halves = {n: dataclasses.replace(good["N"], values=s * good["N"].values, unit="N") for n, s in SIDES.items()}
    return dataclasses.replace(good, channels={**channels, **halves}, meta={})


SIDES = {"force_left": 0.5, "force_right": -0.5}


def test_runs_of_two_thrusters_use_the_twin_thruster_form(good: Trial) -> None:
    twin = driven_by_two_thrusters(good)
    form = form_of(None, None, [twin, twin])
    assert form is not None and form.name == "twin-thruster"
    assert form_of("linear", None, [twin]) is None  # damping was asked for: of one degree of freedom
    assert form_of(None, None, [twin, good]) is None
    both = dataclasses.replace(twin, channels={**twin.channels, "N": good["N"]})
    assert form_of(None, None, [both]) is None
    assert form_of(None, None, []) is None


def test_yaw_of_two_thrusters_is_fitted_with_the_form_of_a_diagnosis(good: Trial) -> None:
    twin = driven_by_two_thrusters(good)
    found = fit(twin, dof="yaw")
    assert found.model.form == plain_form([twin], "yaw")
    with pytest.raises(MissingChannel, match="several degrees of freedom at once: --dof twin-thruster"):
        fit(twin, structure="linear")
    with pytest.raises(MissingChannel, match=r"needs \(N or delta with psi or r\)\. Its columns are [a-z, ]*$"):
        fit(dataclasses.replace(good, channels={n: c for n, c in good.channels.items() if n != "N"}), dof="yaw")
