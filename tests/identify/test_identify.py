"""The interface: results for good, odd and unusable records."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from axis_plants import DEG, Levels, Relay

from gcs_autotune.errors import BadFile, DataError, MissingChannel, NotInformative, UnknownName, UsageError
from gcs_autotune.identify import METHODS, fit_axis
from gcs_autotune.identify.axis.by_output_error import _check_that_something_is_known
from gcs_autotune.identify.free_run import free_run, residual_statistics
from gcs_autotune.identify.problems.delay import weigh_delay
from gcs_autotune.logs import load_runs
from gcs_autotune.models import SingleDof
from gcs_autotune.trial import Channel, Trial, save_trial

Record = Callable[..., Trial]
AFFINE = (0.36, 0.12, 0.05, 0.02)
LINEAR = (0.5, 0.25, 0.0, 0.01)
QUADRATIC = (0.031, 0.0, 0.069, 0.003)


def slugs(fit: object) -> set[str]:
    return {d.slug for d in fit.doubts}  # type: ignore[attr-defined]  # Fit, kept loose for brevity


def changed(trial: Trial, name: str, **changes: object) -> Trial:
    channels = dict(trial.channels)
    channels[name] = dataclasses.replace(channels[name], **changes)  # type: ignore[arg-type]  # t, values, unit
    return dataclasses.replace(trial, channels=channels)


@pytest.fixture(scope="module")
def relays(record: Record) -> list[Trial]:
    return [
        record(AFFINE, Relay(C, 8 * DEG), noise=0.003, rate_noise=0.004, seed=s, name=f"relay {C}")
        for s, C in enumerate((0.3, 0.6))
    ]


@pytest.mark.parametrize(
    ("plant", "structure", "amplitude"),
    [(AFFINE, "affine", 0.3), (LINEAR, "linear", 0.3), (QUADRATIC, "nonlinear", 0.08)],
)
@pytest.mark.parametrize("kind", ["relay", "levels"])
def test_inertia_and_drag_are_identified_within_their_errors_for_any_excitation(
    plant: tuple[float, ...], structure: str, amplitude: float, kind: str, record: Record
) -> None:
    def command(C: float) -> object:
        return Relay(C, 10 * DEG) if kind == "relay" else Levels(np.random.default_rng(4), C, 2.5)

    trials = [record(plant, command(k * amplitude), 50.0, noise=0.004, rate_noise=0.004, seed=k) for k in (1, 2)]
    fit = fit_axis(trials)
    assert fit.structure == structure
    for parameter, truth in zip(list(fit.parameters.values())[:4], plant, strict=True):
        assert abs(parameter.value - truth) <= 4.0 * parameter.std, parameter
        assert parameter.value == pytest.approx(truth, rel=0.05, abs=0.002)
        assert (parameter.status == "absent") == (truth == 0.0)
    assert fit.extra["signals"] == ["psi", "r"]
    assert not slugs(fit) - {"runs-disagree", "second-drag-undecided"}  # chance doubts, one seed in a hundred


def test_the_result_is_plain_json_with_all_four_parameters_and_the_delay(relays: list[Trial]) -> None:
    data = json.loads(json.dumps(fit_axis(relays).to_dict(), allow_nan=False))
    assert list(data["parameters"]) == ["alpha_r", "beta_r", "beta_rr", "delta", "delay"]
    assert data["parameters"]["alpha_r"]["unit"] == "N m s^2/rad"
    assert data["parameters"]["delay"] == {"value": 0.0, "unit": "s", "std": 0.0, "bound": None, "status": "absent"}
    assert data["dof"] == "yaw"


def test_the_same_record_gives_the_same_result_to_the_last_bit(relays: list[Trial]) -> None:
    assert fit_axis(relays).parameters == fit_axis(relays).parameters


def test_a_delay_is_identified_with_its_error_and_reported(record: Record) -> None:
    trials = [record(QUADRATIC, Relay(C, 15 * DEG), delay=0.2, noise=0.01, seed=3) for C in (0.08, 0.16)]
    fit = fit_axis(trials)
    delay = fit.parameters["delay"]
    assert abs(delay.value - 0.2) < 4.0 * delay.std < 0.05
    assert delay.status == "fitted"
    assert "delay-fitted" in slugs(fit)
    assert fit.parameters["alpha_r"].value == pytest.approx(0.031, rel=0.03)


def test_a_known_delay_is_kept_without_a_doubt(record: Record) -> None:
    trial = record(QUADRATIC, Relay(0.08, 15 * DEG), delay=0.2, noise=0.005)
    fit = fit_axis(trial, delay=0.2)
    assert fit.parameters["delay"].status == "fixed"
    assert fit.parameters["alpha_r"].value == pytest.approx(0.031, rel=0.03)
    assert "delay-fitted" not in slugs(fit)


def test_a_reversed_rudder_gives_negative_parameters_and_a_doubt(record: Record) -> None:
    trial = record((-0.5, -0.25, 0.0, 0.01), Relay(0.3, 8 * DEG, reverse=True), noise=0.003)
    drive = trial["N"]
    rudder = dataclasses.replace(drive, name="delta", unit="rad")
    fit = fit_axis(dataclasses.replace(trial, channels={"psi": trial["psi"], "delta": rudder}), structure="linear")
    assert fit.parameters["alpha_r"].value == pytest.approx(-0.5, rel=0.05)
    assert fit.parameters["beta_r"].unit == "rad s/rad"
    assert "reversed-input" in slugs(fit)
    assert all(e.alpha < 0 and e.cycle.valid for e in fit.iso)


def test_a_lagging_gyro_is_left_out_with_its_reason(record: Record) -> None:
    trial = record(LINEAR, Relay(0.3, 8 * DEG), 60.0, noise=0.001, rate_noise=0.002)
    rate = trial["r"]
    late = np.interp(rate.t - 0.05, rate.t, rate.values)
    fit = fit_axis(changed(trial, "r", values=late))
    assert fit.extra["signals"] == ["psi"]
    assert "lags" in fit.extra["signals_left_out"]["r"]
    assert fit.parameters["alpha_r"].value == pytest.approx(0.5, rel=0.02)


def test_a_differentiated_heading_is_not_counted_as_a_second_sensor(record: Record) -> None:
    trial = record(LINEAR, Relay(0.3, 8 * DEG), 60.0, noise=0.004, rate_noise=0.0)
    derived = np.gradient(np.unwrap(trial["psi"].values), trial["psi"].t)
    assert fit_axis(changed(trial, "r", values=derived)).extra["signals"] == ["psi"]


@pytest.mark.parametrize(("dof", "drop"), [("surge", "x"), ("surge", None), ("heave", None), ("sway", "y")])
def test_other_degrees_of_freedom_work_from_what_was_measured(dof: str, drop: str | None, record: Record) -> None:
    command = Levels(np.random.default_rng(8), 20.0, 4.0)
    trial = record((12.0, 4.0, 15.0, 2.0), command, 120.0, noise=0.01, rate_noise=0.01, dof=dof)
    channels = {n: c for n, c in trial.channels.items() if n != drop}
    fit = fit_axis(dataclasses.replace(trial, channels=channels))
    assert fit.dof == dof
    alpha = next(iter(fit.parameters.values()))
    assert abs(alpha.value - 12.0) < 4.0 * alpha.std < 2.0


def test_a_gap_in_the_telemetry_does_not_bias_the_fit(relays: list[Trial]) -> None:
    trial = relays[0]
    holed = trial
    for name in trial.channels:
        c = trial[name]
        keep = (c.t < 14.0) | (c.t > 18.3)
        holed = changed(holed, name, t=c.t[keep], values=c.values[keep])
    fit = fit_axis(holed)
    assert "gaps" in slugs(fit)
    assert fit.parameters["alpha_r"].value == pytest.approx(0.36, rel=0.02)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_gaps_of_half_a_second_do_not_bias_the_fit_of_a_small_craft(seed: int, record: Record) -> None:
    plant = (0.2, 0.75, 0.025, 0.0)
    trial = record(plant, Relay(0.3, 10 * DEG), 16.0, dt=0.025, h=0.005, noise=0.003, rate_noise=0.004, seed=seed)
    gaps = np.random.default_rng(seed).uniform(2.0, 15.0, 4)
    holed = trial
    for name in trial.channels:
        c = trial[name]
        keep = np.all([(c.t < gap) | (c.t > gap + 0.6) for gap in gaps], axis=0)
        holed = changed(holed, name, t=c.t[keep], values=c.values[keep])
    fit = fit_axis(holed)
    assert {"gaps", "input-gaps"} <= slugs(fit)
    alpha, beta, beta_rr = (fit.parameters[name].value for name in ("alpha_r", "beta_r", "beta_rr"))
    assert alpha == pytest.approx(plant[0], rel=0.03)
    assert beta + 0.5 * beta_rr == pytest.approx(plant[1] + 0.5 * plant[2], rel=0.03)


def test_a_coarse_compass_is_reported_and_the_fit_stays_within_a_few_percent(record: Record) -> None:
    trials = []
    for C in (0.08, 0.16):
        trial = record(QUADRATIC, Relay(C, 15 * DEG), 60.0)
        step = 2.0 * DEG
        trials.append(changed(trial, "psi", values=np.round(trial["psi"].values / step) * step))
    fit = fit_axis(trials)
    assert "quantised" in slugs(fit)
    assert fit.noise_std >= 2.0 * DEG / np.sqrt(12.0) * 0.99
    assert fit.parameters["alpha_r"].value == pytest.approx(0.031, rel=0.05)


def test_samples_that_are_no_numbers_are_left_out_and_counted(relays: list[Trial]) -> None:
    values = relays[0]["psi"].values.copy()
    values[[40, 41, 90]] = np.nan
    fit = fit_axis(changed(relays[0], "psi", values=values))
    assert any(d.slug == "missing-samples" and d.cause.startswith("3 samples") for d in fit.doubts)


def test_outliers_are_reported_and_the_robust_loss_tolerates_them(relays: list[Trial]) -> None:
    values = relays[0]["psi"].values.copy()
    values[30::60] += 0.6
    spoilt = changed(relays[0], "psi", values=values)
    plain = fit_axis(spoilt, use=["position"], structure="affine")
    robust = fit_axis(spoilt, use=["position"], structure="affine", loss="soft_l1")
    assert "outliers" in slugs(plain)
    assert robust.parameters["alpha_r"].value == pytest.approx(0.36, rel=0.02)


def test_the_requested_structure_is_fitted(relays: list[Trial]) -> None:
    fit = fit_axis(relays, structure="linear")
    assert (fit.structure, fit.parameters["beta_rr"].status, fit.parameters["beta_rr"].value) == (
        "linear",
        "absent",
        0,
    )


@pytest.mark.parametrize("method", [m for m in METHODS if m != "step"])  # a relay's steps never settle
def test_every_method_identifies_a_known_model_and_returns_curves(method: str, record: Record) -> None:
    trials = [record(LINEAR, Relay(C, 8 * DEG), noise=0.001, dt=0.05, name=str(C)) for C in (0.2, 0.4)]
    fit = fit_axis(trials, method=method, structure="linear")
    assert fit.method == method
    for name, truth in zip(("alpha_r", "beta_r"), LINEAR, strict=False):
        assert abs(fit.parameters[name].value - truth) <= 3.5 * fit.parameters[name].std
    assert len(fit.traces) == 2
    assert fit.used == ("0.2", "0.4")


def test_a_free_run_on_a_fresh_record_stays_close_to_its_noise(relays: list[Trial], record: Record) -> None:
    fresh = record(AFFINE, Levels(np.random.default_rng(1), 0.4, 3.0), 40.0, noise=0.003, seed=77)
    statistics = residual_statistics(free_run(fit_axis(relays), fresh))
    assert statistics.rms < 0.01
    assert statistics.fit_percent > 99.5


def test_a_wrong_model_shows_in_the_free_run(relays: list[Trial]) -> None:
    wrong = SingleDof("yaw", "N m", 0.5, 0.3)
    statistics = residual_statistics(free_run(wrong, relays[0]))
    assert statistics.whiteness_p < 1e-6
    assert statistics.lag_one > 0.5


def unusable(record: Record) -> dict[str, tuple[Trial, type[DataError]]]:
    good = record(LINEAR, Relay(0.3, 8 * DEG), noise=0.003)
    n = len(good["N"])
    noise = np.random.default_rng(0).normal(0.0, 0.01, n)
    backwards = good["psi"].t.copy()
    backwards[200:] -= 5.0
    return {
        "too short": (good.between(0.0, 1.0), NotInformative),
        "constant input": (changed(good, "N", values=np.full(n, 0.3)), NotInformative),
        "all zeros": (changed(changed(good, "N", values=np.zeros(n)), "psi", values=np.zeros(n)), NotInformative),
        "no motion": (changed(good, "psi", values=np.full(n, 1.2)), NotInformative),
        "only noise": (changed(good, "psi", values=noise), NotInformative),
        "clock runs back": (changed(good, "psi", t=backwards), BadFile),
        "no input": (Trial("x", {"psi": good["psi"]}), MissingChannel),
        "no output": (Trial("x", {"N": good["N"]}), MissingChannel),
        "empty": (Trial("x", {}), MissingChannel),
    }


def test_an_uninformative_run_is_not_reported_as_hardly_moving() -> None:
    """A zig-zag of ArduPilot's stock boat, 48 degrees there and back within 0.6 s, received 25 times a second."""
    unknown = {name: SimpleNamespace(name=name, value=0.1, std=0.09, status="fitted") for name in ("alpha_r", "beta_r")}
    dof = SimpleNamespace(parameter_names=lambda: [*unknown])
    with pytest.raises(NotInformative, match=r"determines no parameter of the craft .*\. It is too short, sampled too"):
        _check_that_something_is_known([SimpleNamespace(run="zig-zag", dof=dof)], unknown)  # type: ignore[list-item, arg-type]


CASES = ("too short", "constant input", "all zeros", "no motion", "only noise", "clock runs back", "no input",
         "no output", "empty")  # fmt: skip


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("dof", [None, "yaw"])
def test_an_unusable_record_gives_an_error_of_the_right_kind(case: str, dof: str | None, record: Record) -> None:
    trial, error = unusable(record)[case]
    with pytest.raises(error) as raised:
        fit_axis(trial, dof=dof)
    assert len(str(raised.value)) > 40


def test_iso_without_a_relay_is_rejected_with_another_method(record: Record) -> None:
    trial = record(LINEAR, Levels(np.random.default_rng(3), 0.3, 2.5), noise=0.003)
    with pytest.raises(NotInformative, match="output-error"):
        fit_axis(trial, method="iso")


def test_a_run_that_moves_in_two_axes_requires_a_choice(record: Record) -> None:
    yaw = record(LINEAR, Relay(0.3, 8 * DEG))
    heave = record((12.0, 4.0, 15.0, 0.0), Relay(10.0, 0.3), dof="heave")
    both = Trial("both", {**yaw.channels, **heave.channels})
    with pytest.raises(UsageError, match="yaw, heave"):
        fit_axis(both)
    assert fit_axis(both, dof="heave").dof == "heave"
    assert fit_axis(dataclasses.replace(both, meta={"dof": "yaw"})).dof == "yaw"


@pytest.mark.parametrize(
    "wrong", [{"method": "magic"}, {"structure": "cubic"}, {"dof": "jaw"}, {"use": ["u"]}, {"delay": -1.0}]
)
def test_wrong_arguments_are_usage_errors(wrong: dict[str, object], relays: list[Trial]) -> None:
    with pytest.raises(UsageError):
        fit_axis(relays, **wrong)  # type: ignore[arg-type]  # wrong on purpose


def test_a_misspelt_method_is_rejected_with_the_nearest_name(relays: list[Trial]) -> None:
    with pytest.raises(UnknownName, match="output-error"):
        fit_axis(relays, method="output_error")


def test_only_the_relay_trials_of_a_run_directory_are_loaded(tmp_path: Path, relays: list[Trial]) -> None:
    folder = tmp_path / "trials"
    folder.mkdir()
    for name, kind in (("relay_1", "relay"), ("relay_2", "relay"), ("step", "step")):
        save_trial(dataclasses.replace(relays[0], name=name, meta={"manoeuvre": kind}), folder / f"{name}.csv")
    assert [t.name for t in load_runs(tmp_path)] == ["relay_1", "relay_2"]
    assert [t.name for t in load_runs(folder / "step.csv")] == ["step"]
    fit = fit_axis(load_runs(tmp_path))
    assert fit.parameters["alpha_r"].value == pytest.approx(0.36, rel=0.01)


@pytest.mark.parametrize("make", ["missing", "empty", "steps only"])
def test_a_path_without_a_relay_run_is_a_bad_file(make: str, tmp_path: Path, relays: list[Trial]) -> None:
    place = tmp_path / "run"
    if make != "missing":
        (place / "trials").mkdir(parents=True)
    if make == "steps only":
        save_trial(dataclasses.replace(relays[0], meta={"manoeuvre": "step"}), place / "trials" / "a.csv")
    with pytest.raises(BadFile):
        load_runs(place)


def test_a_channel_of_another_length_and_rate_is_used_at_its_own_stamps(record: Record) -> None:
    trial = record(LINEAR, Relay(0.3, 8 * DEG), noise=0.002)
    psi, N = trial["psi"], trial["N"]
    jumps = np.concatenate([[True], np.diff(N.values) != 0.0])
    sparse = Trial("sparse", {"psi": psi, "N": Channel("N", "N m", N.t[jumps], N.values[jumps])})
    full, few = fit_axis(trial, structure="linear"), fit_axis(sparse, structure="linear")
    assert few.parameters["alpha_r"].value == pytest.approx(full.parameters["alpha_r"].value, rel=1e-9)


def test_a_delay_that_is_neither_proved_nor_excluded_is_a_doubt(record: Record) -> None:
    trial = record((0.36, 0.2, 0.0, 0.0), Relay(0.1, 0.02), 30.0, delay=0.1, noise=0.02, seed=1)
    fit = fit_axis(trial, structure="linear")
    known = fit_axis(trial, structure="linear", delay=0.1)
    inertia, right = fit.parameters["alpha_r"], known.parameters["alpha_r"]
    assert abs(inertia.value - 0.36) > 3.0 * inertia.std
    assert slugs(fit) == {"delay-undecided"}
    assert abs(right.value - 0.36) <= 4.0 * right.std


def test_doubts_do_not_mention_a_relay_that_was_not_flown(record: Record) -> None:
    """A zig-zag switches at two headings as a relay does; a run steered by hand has no relay."""
    trial = record((0.36, 0.2, 0.0, 0.0), Relay(0.1, 0.02), 6.0, delay=0.1, noise=0.004, seed=1)
    flown = dataclasses.replace(trial, meta={"manoeuvre": "relay"})
    result, doubted = (fit_axis(run, structure="affine").doubts for run in (trial, flown))
    assert "few-periods" in {d.slug for d in doubted}
    assert "relay" in " ".join(d.cure for d in doubted)
    assert result
    assert "few-periods" not in {d.slug for d in result}
    enough = dataclasses.replace(trial, meta={"manoeuvre": "relay", "enough": True})
    slugs_of_enough = {d.slug for d in fit_axis(enough, structure="affine").doubts}
    assert not slugs_of_enough & {"few-periods", "unsettled"}, "it was ended on purpose"
    assert not any("relay" in d.cause + d.cure or "oscillation" in d.cause for d in result)


def test_the_inertia_of_a_craft_faster_than_its_sampling_is_unresolved(
    record: Record,
) -> None:
    trial = record((0.0005, 0.25, 0.0, 0.0), Levels(np.random.default_rng(6), 0.3, 2.0), h=0.0005, noise=0.003)
    fit = fit_axis(trial, structure="linear")
    inertia, drag = fit.parameters["alpha_r"], fit.parameters["beta_r"]
    assert inertia.status == "at_bound" or inertia.std > 0.3 * inertia.value
    assert slugs(fit) & {"inertia-unresolved", "weakly-excited"}
    assert drag.value == pytest.approx(0.25, rel=0.02)


@pytest.mark.parametrize(("at_bound", "is_kept"), [((), True), (("a",), False)])
def test_a_delay_that_replaces_the_whole_inertia_is_not_kept(at_bound: tuple[str, ...], is_kept: bool) -> None:
    plain = SimpleNamespace(at_bound=(), bic=lambda _: 0.0)
    lagged = SimpleNamespace(
        at_bound=at_bound,
        bic=lambda _: -100.0,
        value=lambda _: 0.3,
        correlation=1.0,
        free=("a", "delay"),
        raised_covariance=np.diag([0.0, 1e-4]),
    )
    assert weigh_delay(lambda _: (cast(Any, plain), cast(Any, lagged))).kept is is_kept
