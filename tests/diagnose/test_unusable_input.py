"""Unusable input: a clear message of the right kind, and no finding."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from gcs_autotune.diagnose import Diagnosis, diagnose
from gcs_autotune.diagnose.intake import taken_in
from gcs_autotune.errors import AutotuneError, BadFile, MissingChannel, NotInformative, UsageError
from gcs_autotune.trial import Channel, Trial, load_trial

Array = NDArray[np.float64]

DT, T, K = 0.1, 1.5, 0.8
SILENT = ("dead-zone", "input-bias", "compass-deviation")
"""A few effects suffice where none is to be found."""


def sailed(
    command: Callable[[float], float], seconds: float = 60.0, seed: int = 1, noise: float = 0.004, name: str = "run"
) -> Trial:
    """Return a first-order yaw motion under *command*, sampled at 10 Hz."""
    n = round(seconds / DT)
    t = DT * np.arange(n)
    N = np.array([command(float(s)) for s in t])
    r, psi = np.zeros(n), np.zeros(n)
    a = np.exp(-DT / T)
    for k in range(n - 1):
        end = K * N[k]
        r[k + 1] = end + a * (r[k] - end)
        psi[k + 1] = psi[k] + end * DT + T * (1.0 - a) * (r[k] - end)
    rng = np.random.default_rng(seed)
    psi = np.mod(psi + 1.0 + rng.normal(0.0, noise, n), 2.0 * np.pi)
    columns = {"N": ("N m", N), "r": ("rad/s", r + rng.normal(0.0, noise, n)), "psi": ("rad", psi)}
    return Trial(name, {c: Channel(c, unit, t.copy(), x) for c, (unit, x) in columns.items()})


def steps(t: float) -> float:
    """Steps of several sizes both ways."""
    return (0.5, -0.3, 0.2, -0.5, 0.0, 0.4)[int(t / 5.0) % 6]


def with_values(run: Trial, **columns: Array) -> Trial:
    changed = {n: replace(run[n], values=np.asarray(v, dtype=float)) for n, v in columns.items()}
    return replace(run, channels={**run.channels, **changed})


def only(run: Trial, *names: str) -> Trial:
    return replace(run, channels={n: run[n] for n in names})


def at(run: Trial, clock: Callable[[Array], Array]) -> Trial:
    return replace(run, channels={n: replace(c, t=clock(c.t)) for n, c in run.channels.items()})


@pytest.fixture(scope="module")
def good() -> Trial:
    return sailed(steps)


def refusal(*runs: Trial, kind: type[AutotuneError] = NotInformative, **how: object) -> str:
    with pytest.raises(kind) as caught:
        diagnose(list(runs), **how)  # type: ignore[arg-type]
    assert type(caught.value) is kind
    return str(caught.value)


def found(*runs: Trial) -> Diagnosis:
    return diagnose(list(runs), effects=SILENT)


def slugs(diagnosis: Diagnosis) -> set[str]:
    return {d.slug for d in diagnosis.doubts}


# -- nothing to learn from


@pytest.mark.parametrize("ramp", [0.0, 1.0])
def test_one_constant_step_is_rejected(ramp: float) -> None:
    run = sailed(lambda t: 0.4 * min(1.0, max(0.0, (t - 5.0) / max(ramp, 1e-9))))
    assert "change only once" in refusal(run)


def test_a_constant_input_is_rejected_even_if_the_craft_accelerates() -> None:
    assert "ever changes" in refusal(sailed(lambda t: 0.4))


def test_several_single_steps_of_different_sizes_are_enough() -> None:
    runs = [
        sailed(lambda t, s=size: s * (t > 5.0), 20.0, seed=i, name=f"s{i}") for i, size in enumerate((0.3, -0.5, 0.6))
    ]
    assert found(*runs).verdict == "no-effect"


def test_twenty_samples_are_rejected_with_their_number(good: Trial) -> None:
    assert "20 samples" in refusal(good.between(4.0, 5.95))


def test_all_zeros_are_rejected(good: Trial) -> None:
    zero = np.zeros(len(good["N"]))
    message = refusal(with_values(good, N=zero, r=zero, psi=zero))
    assert "ever changes" in message
    assert "motion" in message


def test_a_motion_without_any_command_is_rejected(good: Trial) -> None:
    assert "(N)" in refusal(with_values(good, N=np.zeros(len(good["N"]))))


def test_a_heading_that_never_changes_is_rejected(good: Trial) -> None:
    stuck = with_values(good, psi=np.full(len(good["psi"]), 1.234))
    assert "no motion" in refusal(only(stuck, "N", "psi"))


def test_a_constant_heading_with_a_changing_rate_is_left_out_and_reported(good: Trial) -> None:
    diagnosis = found(with_values(good, psi=np.full(len(good["psi"]), 1.234)))
    assert diagnosis.verdict == "no-effect"
    assert "dead-column" in slugs(diagnosis)
    assert "psi" not in diagnosis.noise


def test_constant_columns_of_a_run_are_one_doubt(good: Trial) -> None:
    t, level = good["psi"].t, np.zeros(len(good["psi"]))
    extra = {name: Channel(name, unit, t, level) for name, unit in (("p", "rad/s"), ("q", "rad/s"))}
    extra |= {name: Channel(name, "rad", t, 0.1 * np.sin(t)) for name in ("phi", "theta")}
    driven = {name: Channel(name, "N m", t, np.sin(t)) for name in ("K", "M")}
    (run,), doubts = taken_in([replace(good, channels={**good.channels, **extra, **driven})])
    assert [d.cause for d in doubts] == ["run 'run': 2 columns left out, constant while the craft moves (p, q)"]
    assert {"p", "q"}.isdisjoint(run.channels)
    (planar,), doubts = taken_in([replace(good, channels={**good.channels, **extra})])
    assert not doubts, "nothing drives roll or pitch, so no model of the run needs them"
    assert {"p", "q"}.isdisjoint(planar.channels)


def test_motion_unrelated_to_the_input_is_rejected(good: Trial) -> None:
    rng = np.random.default_rng(5)
    strange = with_values(good, r=rng.normal(0.0, 0.2, len(good["r"])))
    assert "does not follow the inputs" in refusal(only(strange, "N", "r"))


# -- what is not there


def test_an_empty_run_is_rejected() -> None:
    assert "no samples" in refusal(Trial("hull", {}), kind=BadFile)
    empty = Channel("N", "N m", np.empty(0), np.empty(0))
    assert "no samples" in refusal(Trial("hull", {"N": empty}), kind=BadFile)


def test_a_diagnosis_without_runs_is_a_usage_error() -> None:
    assert "no run" in refusal(kind=UsageError)


def test_columns_without_numbers_count_as_missing(good: Trial) -> None:
    nothing = np.full(len(good["r"]), np.nan)
    assert "no samples" in refusal(with_values(good, N=nothing, r=nothing, psi=nothing), kind=BadFile)
    assert refusal(with_values(good, r=nothing, psi=nothing), kind=MissingChannel)
    assert refusal(with_values(good, N=nothing), kind=MissingChannel)
    diagnosis = found(with_values(good, psi=nothing))
    assert diagnosis.verdict == "no-effect"
    assert "dead-column" in slugs(diagnosis)


def test_inputs_or_motion_alone_are_rejected_with_the_missing_channel(good: Trial) -> None:
    for columns in (("N",), ("r", "psi")):
        assert "N" in refusal(only(good, *columns), kind=MissingChannel)


def test_columns_with_unknown_names_are_rejected(good: Trial) -> None:
    strange = {n: Channel(n, "1", c.t, c.values) for n, c in (("a", good["N"]), ("b", good["r"]))}
    assert "a, b" in refusal(Trial("log", strange), kind=MissingChannel)


# -- columns with wrong labels


def test_a_clock_in_milliseconds_labelled_seconds_is_rejected(good: Trial) -> None:
    message = refusal(at(only(good, "N", "r"), lambda t: 1000.0 * t), kind=BadFile)
    assert "milliseconds" in message
    assert "t[ms]" in message
    assert "milliseconds" in refusal(at(good, lambda t: 1000.0 * t), kind=BadFile)
    assert "microseconds" in refusal(at(good, lambda t: 1e6 * t), kind=BadFile)


def test_a_clock_in_seconds_labelled_milliseconds_is_rejected(good: Trial) -> None:
    assert "t[s]" in refusal(at(good, lambda t: 1e-3 * t), kind=BadFile)


def test_a_heading_not_wrapped_at_a_full_turn_is_rejected(good: Trial) -> None:
    continuous = np.unwrap(good["psi"].values)
    for period in (np.pi, 3.0):
        wrong = with_values(good, psi=np.mod(continuous, period))
        for run in (wrong, only(wrong, "N", "psi")):
            assert "instead of a full turn" in refusal(run, kind=BadFile)


def test_a_heading_averaged_across_north_is_rejected(good: Trial) -> None:
    t = good["psi"].t
    psi = np.mod(np.unwrap(good["psi"].values) - 1.3, 2.0 * np.pi)
    resampled = replace(good["psi"], t=t[:-1] + 0.5 * DT, values=0.5 * (psi[1:] + psi[:-1]))
    assert np.abs(np.diff(psi)).max() > 6.0
    assert "instead of a full turn" in refusal(
        replace(good, channels={**good.channels, "psi": resampled}), kind=BadFile
    )


def test_single_wrong_samples_of_the_heading_do_not_stop_the_diagnosis(good: Trial) -> None:
    spiked = good["psi"].values.copy()
    spiked[[77, 301, 302]] += 1.5
    found(with_values(good, psi=spiked))


def test_both_conventions_of_wrapping_a_heading_are_accepted(good: Trial) -> None:
    for wrapped in (np.mod(good["psi"].values, 2 * np.pi), np.angle(np.exp(1j * good["psi"].values))):
        assert found(with_values(good, psi=wrapped)).verdict == "no-effect"


@pytest.mark.parametrize("output", ["r", "psi"])
def test_a_swapped_input_and_output_are_reported_with_both_names(good: Trial, output: str) -> None:
    swapped = with_values(good, N=good[output].values, **{output: good["N"].values})
    for run in (swapped, only(swapped, "N", output)):
        message = refusal(run, kind=BadFile)
        assert "look swapped" in message and "is smooth and follows" in message
        assert "N" in message
        assert output in message


# -- spoiled in part


def test_an_unusable_run_is_left_out_and_reported(good: Trial) -> None:
    swapped = replace(with_values(good, N=good["r"].values, r=good["N"].values), name="swapped")
    diagnosis = found(good, swapped)
    assert diagnosis.used == ("run",)
    assert diagnosis.verdict == "no-effect"
    assert any(d.slug == "run-left-out" and "'swapped'" in d.cause for d in diagnosis.doubts)


def test_a_clock_that_jumps_back_splits_the_run(good: Trial) -> None:
    diagnosis = found(at(good, lambda t: np.where(t > 30.0, t - 25.0, t)))
    assert diagnosis.used == ("run (part 1)", "run (part 2)")
    assert diagnosis.verdict == "no-effect"
    assert "clock-jump" in slugs(diagnosis)


def test_jittering_time_stamps_are_not_a_cause(good: Trial) -> None:
    rng = np.random.default_rng(3)
    shift = rng.uniform(-0.04, 0.04, len(good["r"])) * (rng.random(len(good["r"])) < 0.2)
    assert found(at(good, lambda t: t + shift)).causes == ()


def test_a_saturated_sensor_is_not_a_cause(good: Trial) -> None:
    diagnosis = found(only(with_values(good, r=np.clip(good["r"].values, -0.2, 0.2)), "N", "r"))
    assert diagnosis.causes == ()


def test_a_run_supplied_twice_counts_once_and_does_not_validate_itself(good: Trial) -> None:
    diagnosis = found(good, replace(good, name="copy"))
    assert diagnosis.used == ("run",)
    assert "run-twice" in slugs(diagnosis)
    assert "both to fit and to validate" in refusal(good, kind=UsageError, unseen=[good])


def test_unusable_files_are_rejected_when_read(tmp_path) -> None:  # type: ignore[no-untyped-def]
    for text in ("", "t[s],N[N m],r[rad/s]\n", "0,1,2\n0.1,1,2\n"):
        path = tmp_path / "run.csv"
        path.write_text(text, encoding="utf-8")
        with pytest.raises((BadFile, MissingChannel)):
            diagnose(load_trial(path))
