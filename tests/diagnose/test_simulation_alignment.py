"""A simulation's file beside the measured one: clock, signs and units found before anything is fitted."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from gcs_autotune.diagnose import diagnose
from gcs_autotune.diagnose.simulation_alignment import compared
from gcs_autotune.report import diagnosis_document
from gcs_autotune.report.toolkit.terminal import render_text
from gcs_autotune.trial import Channel, Trial

SEEDS = range(24)
FULL, LASTS, STEP = 0.6, 80.0, 0.1
CRAFT = {"inertia": 2.0, "drag": 1.0, "square": 0.0, "gain": 1.0, "delay": 0.0}
OTHER = {"inertia": 3.0, "drag": 0.4, "square": 2.0, "delay": 0.3}
"""A simulator of a very different craft."""


def coloured_noise(rng, count, dt, size, memory=2.0):
    """An Ornstein-Uhlenbeck moment."""
    keeps = np.exp(-dt / memory)
    pushes = (size * np.sqrt(1.0 - keeps**2) * rng.normal(size=count)).tolist()
    moment = [0.0]
    for push in pushes[1:]:
        moment.append(float(keeps) * moment[-1] + push)
    return np.array(moment)


def turned(rng, stamps, t_in, commands, disturbance, craft):
    """Turn rate and heading, by Euler steps of 20 ms: of plain numbers, which take a third of the time of NumPy's."""
    dt = 0.02
    fine = np.arange(0.0, stamps[-1] + dt, dt)
    at = np.maximum(np.searchsorted(t_in, fine - craft["delay"], side="right") - 1, 0)
    moment = (craft["gain"] * commands[at] + coloured_noise(rng, len(fine), dt, disturbance)).tolist()
    inertia, linear, square = craft["inertia"], craft["drag"], craft["square"]
    r, psi, rate, heading = [0.0], [0.0], 0.0, 0.0
    for now in moment[:-1]:
        heading = heading + dt * rate
        rate = rate + dt * (now - (linear + square * abs(rate)) * rate) / inertia
        r.append(rate)
        psi.append(heading)
    return np.interp(stamps, fine, r), np.interp(stamps, fine, psi)


def filed(name, t, r, psi, commands=None):
    channels = {"r": Channel("r", "rad/s", t, r), "psi": Channel("psi", "rad", t, psi)}
    if commands is not None:
        channels["N"] = Channel("N", "1", *commands)
    return Trial(name, channels)


def two(seed, *, clock=1.0, offset=0.0, disturbance=(0.4, 0.4), theirs=None, commands=False, times=None, runs=2):
    """Return simulations and runs of the same commands, both in *disturbance* (shares of the command)."""
    rng = np.random.default_rng([seed, 77])
    simulations, measured = [], []
    for k in range(runs):
        t_in = np.r_[0.0, np.cumsum(rng.uniform(1.5, 5.0, 40))]
        t_in = t_in[t_in < LASTS - 1.0]
        result = FULL * rng.choice([-1.0, -0.5, 0.0, 0.5, 1.0], len(t_in))
        t = np.arange(0.0, LASTS, STEP)
        r, psi = turned(rng, t, t_in, result, disturbance[0] * 0.45, CRAFT)
        noise = 0.002 * rng.normal(size=(2, len(t)))
        measured.append(filed(f"run{k}", t, r + noise[0], psi + noise[1], (t_in, result)))
        r, psi = turned(rng, t, t_in, result, disturbance[1] * 0.45, {**CRAFT, **(theirs or {})})
        stamps = clock * t + offset
        seen = result[np.searchsorted(t_in, t, side="right") - 1]
        by = times or {}
        own = (stamps, seen) if commands else None
        simulations.append(filed(f"sim{k}", stamps, by.get("r", 1.0) * r, by.get("psi", 1.0) * psi, own))
    return simulations, measured


def rows(*case, **others):
    return {n.name: n for n in compared(*two(*case, **others)).rows}


@pytest.mark.slow
@pytest.mark.parametrize("theirs", [None, OTHER], ids=["the same craft", "another craft"])
def test_a_wrong_clock_is_identified_although_disturbances_move_both_records(theirs):
    right, near = 0, 0
    for seed in SEEDS:
        clock = (0.98, 1.02, 1.05, 0.99)[seed % 4]
        found = rows(seed, clock=clock, theirs=theirs)
        if list(found) == ["clock scale"]:
            number = found["clock scale"]
            right += abs(number.given - clock) < 0.002
            near += abs(number.given - clock) < 3.0 * number.given_std
    assert right >= 23
    assert near >= 21


@pytest.mark.slow
@pytest.mark.parametrize("theirs", [None, OTHER, {"gain": 0.4}, {"drag": 0.3, "delay": 1.0}])
def test_a_simulator_of_another_craft_has_no_wrong_clock_sign_or_unit(theirs):
    assert [list(rows(seed, theirs=theirs)) for seed in SEEDS] == [[]] * len(SEEDS)


def test_the_simulation_is_moved_to_the_clock_of_the_runs():
    simulations, runs = two(1, clock=1.03, disturbance=(0.0, 0.0))
    found = compared(simulations, runs)
    assert [n.name for n in found.rows] == ["clock scale"]
    (number,) = found.rows
    assert number.wrong
    assert number.of_record
    assert number.value == 1.0
    placed = found.simulations[0]["r"]
    error = runs[0]["r"].values - np.interp(runs[0]["r"].t, placed.t, placed.values)
    assert np.std(error) < 0.005
    before = runs[0]["r"].values - np.interp(runs[0]["r"].t, simulations[0]["r"].t, simulations[0]["r"].values)
    assert np.std(before) > 0.05


@pytest.mark.parametrize("offset", [0.5, -0.5])
def test_a_clock_offset_is_estimated_from_the_commands_of_both_records(offset):
    found = rows(2, offset=offset, commands=True)
    assert list(found) == ["clock offset"]
    assert abs(found["clock offset"].given - offset) < 0.05
    assert found["clock offset"].given_std < 0.05


def test_commands_logged_at_the_simulations_own_rows_cause_no_clock_offset():
    assert rows(2, commands=True) == {}


def test_a_clock_scale_and_a_clock_offset_are_distinguished():
    found = rows(3, clock=1.02, offset=0.5, commands=True, disturbance=(0.2, 0.2))
    assert list(found) == ["clock scale", "clock offset"]
    assert abs(found["clock scale"].given - 1.02) < 0.001
    assert abs(found["clock offset"].given - 0.5) < 0.05


def test_a_simulation_stamped_from_zero_is_aligned_with_its_run():
    simulations, runs = two(4, offset=1000.0, commands=True, disturbance=(0.0, 0.0))
    found = compared(simulations, runs)
    assert found.rows == ()
    assert {d.slug for d in found.doubts} == {"simulation-elsewhere"}
    assert abs(found.simulations[0]["r"].t[0]) < 0.1


@pytest.mark.parametrize(
    ("times", "named"),
    [
        ({"r": np.degrees(1.0)}, {"unit of r": np.degrees(1.0)}),
        ({"r": -1.0, "psi": -1.0}, {"sign of r": -1.0, "sign of psi": -1.0}),
        ({"psi": -1.0}, {"sign of psi": -1.0}),
    ],
)
def test_wrong_signs_and_degrees_are_reported_and_corrected(times, named):
    for seed in range(5):
        found = compared(*two(seed, times=times))
        assert {n.name: n.given for n in found.rows} == pytest.approx(named)
        clean = two(seed)[0]
        for name in ("r", "psi"):
            assert found.simulations[0][name].values == pytest.approx(clean[0][name].values)


def test_a_simulation_takes_the_runs_commands_where_equal_and_differences_are_reported():
    simulations, runs = two(5, commands=True, disturbance=(0.0, 0.0))
    assert compared(simulations, runs).simulations[0]["N"] is runs[0]["N"]
    halves = [replace(s["N"], values=0.5 * s["N"].values) for s in simulations]
    others = [replace(s, channels={**s.channels, "N": half}) for s, half in zip(simulations, halves, strict=True)]
    found = compared(others, runs)
    assert np.array_equal(found.simulations[0]["N"].values, halves[0].values)
    assert {d.slug for d in found.doubts} == {"command-scaled"}


@pytest.mark.slow
def test_a_wrong_clock_is_reported_first_although_both_records_drift():
    simulations, runs = two(6, clock=1.02, disturbance=(0.3, 0.2))
    result = diagnose(runs, simulations=simulations, effects=["input-delay", "input-bias", "time-scale"])
    assert result.verdict not in ("unexplained", "no-effect")
    assert result.wrong_numbers[0].name == "clock scale"
    assert "time-scale" not in [c.effect.slug for c in result.causes]
    text = " ".join(render_text(diagnosis_document(result)).replace("│", "").split())
    assert "wrong number in the simulation: clock scale (simulation seconds per second of these runs) is 1.0" in text
    assert "diverges" not in text
    as_it_stands, set_right = (float(e) for e in re.findall(r"[ ,] r by ([0-9.]+) rad/s", text))
    assert "With clock, signs and units corrected it differs in psi by" in text
    assert set_right < 0.9 * as_it_stands  # the disturbance of each record remains
