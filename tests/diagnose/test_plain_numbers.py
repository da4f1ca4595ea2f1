"""Gain, time constant, delay and trim of a foreign simulator compared with the runs."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from open_loop_runs import towed

from gcs_autotune.diagnose import diagnose
from gcs_autotune.diagnose.numbers import if_precise
from gcs_autotune.diagnose.plain_numbers import command_sizes, plain_numbers
from gcs_autotune.diagnose.simulation import stand_in
from gcs_autotune.identify.problems import plain_form
from gcs_autotune.identify.signals import prepare_as_recorded
from gcs_autotune.report import diagnosis_document
from gcs_autotune.report.diagnosis.wording import found_words, given_words, standing
from gcs_autotune.report.toolkit.terminal import render_text
from gcs_autotune.trial import Channel

FEW = ["dead-zone", "input-bias", "input-delay", "quadratic-drag"]


def made_by(runs, *, inertia=2.0, drag=1.0, square=0.0, gain=1.0, delay=0.0, trim=0.0):
    """What a user's own simulator makes of the commands of *runs*: Euler steps of 10 ms, written every 0.1 s."""
    found = []
    for run in runs:
        t_in, commands = run["N"].t, run["N"].values
        stamps, dt = run["r"].t, 0.01
        fine = np.arange(stamps[0], stamps[-1] + dt, dt)
        at = np.searchsorted(t_in, fine - delay + 1e-9, side="right") - 1
        moment = gain * np.where(at >= 0, commands[np.maximum(at, 0)], 0.0) + trim
        r, psi = np.zeros(len(fine)), np.zeros(len(fine))
        for k in range(1, len(fine)):
            r[k] = r[k - 1] + dt * (moment[k - 1] - (drag + square * abs(r[k - 1])) * r[k - 1]) / inertia
            psi[k] = psi[k - 1] + dt * r[k - 1]
        channels = {
            "r": Channel("r", "rad/s", stamps, np.interp(stamps, fine, r)),
            "psi": Channel("psi", "rad", stamps, np.interp(stamps, fine, psi)),
        }
        found.append(replace(run, name=f"sim of {run.name}", channels=channels))
    return found


def held(size, drag, square):
    """Speed a step of *size* ends in, by bisection."""
    low, high = 0.0, size / max(drag, 1e-9) if drag else math.sqrt(size / square)
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if drag * middle + square * middle**2 < size else (low, middle)
    return low


@pytest.mark.parametrize(("drag", "square"), [(1.0, 0.0), (0.5, 0.8), (0.0, 1.5)])
def test_the_numbers_of_a_simulator_are_those_of_a_step_of_command_size(drag, square):
    runs = towed(noise=0.0)
    theirs = made_by(runs, inertia=1.6, drag=drag, square=square, gain=0.8, delay=0.4, trim=0.1)
    driven = [replace(s, channels={**s.channels, "N": r["N"]}) for s, r in zip(theirs, runs, strict=True)]
    form = plain_form(driven)
    segments = prepare_as_recorded(driven, form)[0]
    sizes = command_sizes(form, segments)
    problem, fitted = stand_in(form, segments, lambda *_: None)
    found = plain_numbers(problem, fitted, sizes)
    size, end = 0.8 * sizes["N"], held(0.8 * sizes["N"], drag, square)
    v, t = 0.0, 0.0
    while v < (1.0 - math.exp(-1.0)) * end:
        v += 1e-4 * (size - drag * v - square * v**2) / 1.6
        t += 1e-4
    result = {kind: n for (kind, _), n in found.items()}
    assert result["gain"].value == pytest.approx(end / sizes["N"], rel=0.02)
    assert result["time constant"].value == pytest.approx(t, rel=0.02)
    assert result["delay"].value == pytest.approx(0.4, abs=0.02)
    assert result["trim"].value == pytest.approx(-0.1 / 0.8, rel=0.05)
    for number in result.values():
        assert 0.0 < number.std < 0.02


@pytest.mark.slow
@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        ({"inertia": 3.0}, {"time constant of yaw"}),
        ({"gain": 0.6}, {"gain of yaw"}),
        ({"drag": 1.4, "inertia": 2.8}, {"gain of yaw"}),
        ({"delay": 0.4}, {"delay of N"}),
        ({"trim": 0.2}, {"trim of N"}),
        ({"drag": 0.0, "square": 3.0}, {"gain of yaw", "time constant of yaw"}),
    ],
)
def test_exactly_the_wrong_numbers_of_a_simulator_are_reported_with_intervals(wrong, named):
    runs = towed()
    result = diagnose(runs, simulations=made_by(runs, **wrong), effects=FEW)
    assert result.verdict == "wrong-numbers"
    assert {n.name for n in result.wrong_numbers} == named
    assert result.causes == ()
    assert result.numbers is not None
    right = {"gain of yaw": 1.0, "time constant of yaw": 2.0, "delay of N": 0.0, "trim of N": 0.0}
    for number in result.numbers.rows:
        assert abs(number.value - right[number.name]) < max(4.0 * number.std, 1e-3), number.name
        assert number.std < 0.05, number.name
        assert number.given_std < 0.05, number.name


@pytest.mark.slow
def test_what_a_cause_explains_is_not_a_wrong_number_of_the_simulator():
    runs = towed(("dead-zone", "N", {"width": 0.15}), seed=2)
    result = diagnose(runs, simulations=made_by(runs), effects=FEW)
    assert [c.effect.slug for c in result.causes] == ["dead-zone"]
    assert result.verdict == "effect-found"
    assert result.wrong_numbers == ()


@pytest.mark.slow
def test_a_wrong_gain_is_reported_with_a_cause_that_explains_part_of_it():
    runs = towed(("dead-zone", "N", {"width": 0.15}), seed=2)
    result = diagnose(runs, simulations=made_by(runs, drag=0.7, inertia=1.4), effects=FEW)
    assert [c.effect.slug for c in result.causes] == ["dead-zone"]
    assert [n.name for n in result.wrong_numbers] == ["gain of yaw"]


@pytest.mark.slow
def test_a_number_with_a_large_error_is_shown_as_not_identifiable():
    runs = towed()
    result = diagnose(runs, simulations=made_by(runs, inertia=3.0), effects=FEW)
    assert result.numbers is not None
    value, std = if_precise(0.0, 1400.0, 1.0)
    vague = replace(result.numbers.rows[0], given=value, given_std=std, value=value, std=std, wrong=False)
    assert if_precise(0.27, 0.1, 0.27) == (0.27, 0.1)
    assert given_words(vague) == "not stated"
    assert found_words(vague) == "not identifiable from these runs"
    numbers = replace(result.numbers, rows=(vague, *result.numbers.rows[1:]))
    text = render_text(diagnosis_document(replace(result, numbers=numbers)))
    assert "nan" not in text


@pytest.mark.slow
@pytest.mark.parametrize("bias", [0.1, 0.015])
def test_a_delay_and_a_trim_of_the_craft_are_listed_as_explained_by_causes(bias):
    runs = towed(("input-delay", "N", {"delay": 0.4}), ("input-bias", "yaw", {"bias": bias}))
    result = diagnose(runs, simulations=made_by(runs), effects=["input-bias", "input-delay", "time-offset"])
    assert result.verdict == "effect-found"
    assert result.numbers is not None
    rows = {n.name: n for n in result.numbers.rows}
    assert rows["delay of N"].value == pytest.approx(0.4, abs=0.03)
    assert rows["trim of N"].value == pytest.approx(-bias, rel=0.1)
    assert [n for n, row in rows.items() if row.explained] == ["delay of N", "trim of N"]
    assert [standing(row) for row in rows.values()] == ["agrees"] * 2 + ["explained by a cause"] * 2
