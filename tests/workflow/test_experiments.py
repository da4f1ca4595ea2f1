"""Reading a flown step off its record."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from gcs_autotune.design import step_metrics
from gcs_autotune.manoeuvres import common_windows, windows_of
from gcs_autotune.trial import Channel, Mark, Trial
from gcs_autotune.workflow.accompanying_step import compared_over
from gcs_autotune.workflow.experiments import (
    measure,
    measure_halves,
    noise_as_read,
    resolution,
    steering_throttle,
)

QUANTUM = math.radians(2.0)
STEP = math.radians(30.0)


def flown(quantum: float, standing_error: float = 0.0) -> Trial:
    """A hold, a step and a step back, first-order lags of one second, read at 10 Hz."""
    t = np.arange(0.0, 63.0, 0.1)
    there = np.where(t < 3.0, 0.0, STEP * (1.0 - np.exp(-np.maximum(t - 3.0, 0.0))))
    true = np.where(t < 33.0, there, STEP * np.exp(-np.maximum(t - 33.0, 0.0))) + standing_error
    noise = 0.002 * np.sin(37.0 * t)
    read = np.round(true / quantum) * quantum if quantum else true + noise
    targets = [Mark(0.0, "target", {"value": 0.0}), Mark(3.0, "target", {"value": STEP})]
    return Trial(
        "step",
        {"psi": Channel("psi", "rad", t, read), "N": Channel("N", "1", t, np.zeros_like(t))},
        (*targets, Mark(33.0, "target", {"value": 0.0})),
        "completed",
        meta={"signal": "psi", "duration": 29.0},
    )


def test_the_resolution_of_a_coarse_compass_is_detected() -> None:
    assert resolution(flown(QUANTUM)) == pytest.approx(QUANTUM, rel=1e-6)
    assert resolution(flown(0.0)) == 0.0


def test_a_steady_error_below_the_resolution_is_not_attributed_to_the_gains() -> None:
    trial = flown(QUANTUM, standing_error=0.6 * QUANTUM)
    honest, blind = measure(trial, resolution=resolution(trial)), measure(trial)
    assert blind.itae > 10.0
    assert honest.itae < 1.0
    assert math.isfinite(honest.settling)
    assert honest.overshoot == 0.0


def test_a_fine_sensor_still_shows_a_small_steady_error() -> None:
    trial = flown(0.0, standing_error=0.6 * QUANTUM)
    assert measure(trial, 0.0, resolution(trial)).itae > 10.0


def test_a_step_that_never_started_has_no_metrics() -> None:
    trial = flown(QUANTUM)
    held = Trial(trial.name, trial.channels, trial.marks[:1], "stopped", meta=trial.meta)
    assert math.isnan(measure(held).itae)


def test_a_predicted_speed_step_ignores_the_same_errors_as_the_flown_one() -> None:
    std, size, seconds, rng = 0.02, 0.5, 8.0, np.random.default_rng(5)
    t = np.arange(-2.0, seconds + 0.05, 0.1)
    motion = size * np.where(t < 0.0, 0.0, 1.06 - 1.06 * np.exp(-t.clip(0.0)))  # 6 % too fast to the end
    marks = (Mark(-2.0, "target", {"value": 0.0}), Mark(0.0, "target", {"value": size}))
    found = []
    for _ in range(20):
        u = Channel("u", "m/s", t, motion + rng.normal(0.0, std, len(t)))
        channels = {"u": u, "X": Channel("X", "1", t, np.zeros_like(t))}
        step = Trial("step", channels, marks, "completed", meta={"signal": "u", "duration": seconds})
        found.append(measure(step, std).itae)
    fine = np.arange(0.0, seconds, 0.02)
    steps = size * (1.06 - 1.06 * np.exp(-fine)), np.where(fine > 0.0, size, 0.0), np.zeros_like(fine)
    read, whole = (
        step_metrics(fine, steps[1], steps[0], steps[2], noise_std=noise, noise_time=0.1).itae
        for noise in (noise_as_read(step, std), std)
    )
    assert read == pytest.approx(float(np.mean(found)), rel=0.1)
    assert whole < 0.75 * read


def test_steps_are_compared_over_the_time_both_recorded() -> None:
    long, short = flown(0.0, 0.05), flown(0.0, 0.05)
    short = replace(short.between(0.0, 41.0), meta={**short.meta, "lasted": [8.0, 9.0]})
    early = [replace(m, t=11.0) if m.t == 33.0 else m for m in short.marks]
    short = replace(short, marks=tuple(m for m in early if m.t < 30.0))
    assert windows_of(long) == (29.0, 29.0) and windows_of(short) == (8.0, 9.0)
    assert common_windows(long, short) == common_windows(short, long) == (8.0, 9.0)
    there = [
        measure(replace(trial, marks=trial.marks[:2]), 0.0, 0.0, common_windows(long, short)) for trial in (long, short)
    ]
    assert there[0].itae == pytest.approx(there[1].itae, rel=1e-9)
    assert measure(long).itae > 5.0 * there[0].itae


def test_a_step_back_ended_at_once_by_a_limit_is_omitted_from_both_steps() -> None:
    long, short = flown(0.0, 0.05), flown(0.0, 0.05)
    short = replace(short, meta={**short.meta, "lasted": [29.0, 0.02]})
    alike = common_windows(long, short)
    assert alike == (29.0, 0.02)
    halves = [measure_halves(trial, windows=alike) for trial in (long, short)]
    assert [len(found) for found in halves] == [1, 1]
    assert halves[0][0].itae == pytest.approx(halves[1][0].itae)
    assert (
        compared_over(alike)
        == "both flights are compared over the first 29 s of the step: the shorter flight ends there"
    )


def test_a_half_that_only_one_step_has_is_still_measured() -> None:
    ran_away = Trial("step-before", {}, flown(0.0).marks[:2], "stopped", meta={"signal": "psi", "duration": 29.0})
    assert common_windows(ran_away, flown(0.0)) == (29.0,)
    assert measure(flown(0.0), windows=(29.0,)) == measure(flown(0.0))


def quick(phase: float, late: float = 0.0, reported: float = 0.0, lag: float = 0.0) -> Trial:
    """A turn-rate step over in half a second, read at 10 Hz from *phase* [s] on, *late* [s] after it was sent."""
    t = np.arange(phase, 11.0, 0.1)
    rise = -0.5 + np.where(t < 4.0 + late, 0.0, 1.0 - np.exp(-np.maximum(t - 4.0 - late, 0.0) / 0.15))
    targets = [Mark(at, "target", {"value": value}) for at, value in ((0.0, -0.5), (4.0, 0.5))]
    channels = {"r": Channel("r", "rad/s", t, rise), "N": Channel("N", "1", t, np.zeros_like(t))}
    times = {"loop": reported, "command_to_servo": 0.4 * reported} if reported else {}
    meta = {"signal": "r", "duration": 6.0, "rate_lag": lag, "link_times": times}
    return Trial("step", channels, targets, "completed", meta=meta)


def test_the_clock_of_a_fast_step_starts_with_the_step_not_the_next_sample() -> None:
    true = 0.15**2  # of an exponential
    found = [measure(quick(phase)).itae for phase in (0.01, 0.03, 0.05, 0.07, 0.09)]
    assert np.mean(found) == pytest.approx(true, rel=0.05)
    assert found == pytest.approx([true] * 5, rel=0.25)


def test_the_delay_of_the_link_is_not_counted_as_loop_error() -> None:
    blind, honest = measure(quick(0.03, 0.2)).itae, measure(quick(0.03, 0.2, reported=0.2)).itae
    assert blind > 2.0 * honest
    assert honest == pytest.approx(0.15**2, rel=0.25)


def test_a_turn_rate_recorded_at_its_own_time_is_not_dated_back_again() -> None:
    plain, filtered = (measure(quick(0.03, lag=lag)).itae for lag in (0.0, 0.056))
    assert filtered == plain


VECTORED = {"MOT_VEC_ANGLEMAX": 30.0}


@pytest.mark.parametrize(
    ("driven", "present", "expected"),
    [
        (0.75, VECTORED, 0.75),
        (0.75, {}, 0.4),
        (0.75, {"MOT_VEC_ANGLEMAX": 0.0}, 0.4),
        (1.0, VECTORED, 0.9),
        (0.0, VECTORED, 0.1),
        (0.55, {**VECTORED, "MOT_THR_MIN": 10.0}, 0.5),
    ],
    ids=["vectored", "rudder", "rudder, said", "at its stop", "at rest", "lifted over MOT_THR_MIN"],
)
def test_a_vectored_thruster_is_identified_at_the_throttle_of_the_autopilot(driven, present, expected) -> None:
    step = flown(0.0)
    t = step["psi"].t
    X = Channel("X", "1", t, np.where(t < 0.05, 0.0, driven))
    trial = Trial("step", {**step.channels, "X": X}, step.marks, "completed", meta=step.meta)
    assert steering_throttle(trial, present, 0.4) == pytest.approx(expected)


def test_a_step_without_recorded_throttle_uses_the_cruise_throttle() -> None:
    assert steering_throttle(flown(0.0), VECTORED, 0.4) == 0.4
