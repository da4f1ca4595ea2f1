"""Commands of a simulation's file beside those of the run: clock, order, signs and units, from the inputs alone."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from gcs_autotune.diagnose.command_match import match_commands
from gcs_autotune.diagnose.simulation_alignment import compared
from gcs_autotune.trial import Channel, Trial

LASTS, ROW, ROW_SIMULATED = 120.0, 0.1, 0.05
NAMES = ("N", "X", "Z")
FACTORS = (0.2, 0.637, 0.925, 1.0, 1.57, 5.0)


def steps(rng):
    """Times and levels of a command that is held for one and a half to six seconds."""
    t = np.r_[0.0, np.cumsum(rng.uniform(1.5, 6.0, 100))]
    t = t[t < LASTS - 1.0]
    return t, rng.choice([-1.0, -0.5, 0.0, 0.5, 1.0], len(t))


def relay(rng, jitter=0.0):
    """Times and levels of a command that changes sides every five seconds or so."""
    t = np.cumsum(np.r_[0.0, 5.0 + jitter * rng.normal(size=40)])
    t = t[t < LASTS - 1.0]
    return t, np.where(np.arange(len(t)) % 2, 0.4, -0.4)


def joystick(rng):
    """Times and levels of a command that is never held."""
    t = np.arange(0.0, LASTS, 0.05)
    slow = quick = 0.0
    levels = []
    for push in rng.normal(size=len(t)).tolist():
        slow = 0.967 * slow + 0.255 * push
        quick += 0.125 * (slow - quick)
        levels.append(0.4 * quick)
    return t, np.clip(np.array(levels), -1.0, 1.0)


def held(command, at):
    t, levels = command
    return levels[np.maximum(np.searchsorted(t, at, side="right") - 1, 0)]


def two(commands, *, factor=1.0, offset=0.0, noise=0.0, starts=0.0, ends=LASTS, order=None, times=None, zeros=None):
    """Return a simulation's and a run's commands: *factor* and *offset* of its clock, and what its columns hold.

    starts, ends : what the simulation's file holds, in seconds of the run. order : index of the command that each of
    its columns holds, *times* so large, from *zeros*.
    """
    rng = np.random.default_rng(8)
    t = np.arange(0.0, LASTS, ROW)
    theirs = np.arange(starts, ends, ROW_SIMULATED / factor)
    run, simulation = {}, {}
    for k, command in enumerate(commands):
        name = NAMES[k]
        run[name] = Channel(name, "1", t, held(command, t) + noise * rng.normal(size=len(t)))
        own = held(commands[k if order is None else order[k]], theirs) + noise * rng.normal(size=len(theirs))
        values = (1.0 if times is None else times[k]) * own + (0.0 if zeros is None else zeros[k])
        simulation[name] = Channel(name, "1", offset + factor * theirs, values)
    return Trial("simulation", simulation), Trial("run", run)


def off(clock, factor, offset, at=0.5 * LASTS):
    """How far a clock is off in the middle of the run, [s of the simulation]."""
    return abs(float(clock.in_simulation(np.array([at]))[0]) - (offset + factor * at))


@pytest.mark.parametrize("factor", FACTORS)
@pytest.mark.parametrize(
    "offset", [3.3, *(pytest.param(offset, marks=pytest.mark.slow) for offset in (0.0, -40.0, 1000.0))]
)
def test_any_clock_is_estimated_from_the_switches_of_a_command(factor, offset):
    for noise, starts, ends in ((0.0, 0.0, LASTS), (0.02, 20.0, LASTS), (0.0, 0.0, 85.0)):
        pair = two(
            [steps(np.random.default_rng(3))], factor=factor, offset=offset, noise=noise, starts=starts, ends=ends
        )
        found = match_commands(*pair)
        assert found.kind == "matched"
        assert abs(found.clock.scale - factor) < max(4.0 * found.clock.scale_std, 1e-5)
        assert found.clock.scale_std < 0.001 * factor
        assert off(found.clock, factor, offset) < 3.0 * found.clock.shift_std
        assert found.clock.shift_std < 0.06 * max(factor, 1.0)


@pytest.mark.parametrize("factor", FACTORS)
def test_a_command_that_is_never_held_is_matched_by_its_shape(factor):
    for noise, starts in ((0.0, 0.0), (0.02, 20.0)):
        pair = two([joystick(np.random.default_rng(2))], factor=factor, offset=-7.0, noise=noise, starts=starts)
        found = match_commands(*pair)
        assert found.kind == "matched"
        assert abs(found.clock.scale - factor) < 5.0 * found.clock.scale_std < 0.01 * factor
        assert off(found.clock, factor, -7.0) < 4.0 * found.clock.shift_std


@pytest.mark.slow
def test_the_standard_error_of_a_clock_is_its_scatter():
    errors = []
    for seed in range(40):
        commands = [steps(np.random.default_rng([seed, 1]))]
        found = match_commands(*two(commands, factor=0.637)).clock
        errors.append((found.scale - 0.637) / found.scale_std)
    assert 0.5 < float(np.std(errors)) < 1.5
    assert abs(float(np.mean(errors))) < 0.5


@pytest.mark.parametrize(
    "order", [*(pytest.param(o, marks=pytest.mark.slow) for o in ((0, 1, 2), (1, 0, 2))), (2, 0, 1)]
)
@pytest.mark.parametrize("times", [(1.0, 1.0, 1.0), (-1.0, 1.0, -1.0), (400.0, 400.0, -400.0)])
def test_the_order_signs_and_units_of_inputs_are_identified(order, times):
    zeros = [1500.0 if abs(t) > 1.0 else 0.0 for t in times]
    for factor in (0.637, 1.0, 1.57):
        commands = [steps(np.random.default_rng([k, 4])) for k in range(3)]
        found = match_commands(*two(commands, factor=factor, order=order, times=times, zeros=zeros, noise=0.01))
        assert found.kind == "matched"
        result = {c.theirs: c for c in found.channels}
        for k, name in enumerate(NAMES):
            assert result[name].ours == NAMES[order[k]]
            assert result[name].factor == pytest.approx(times[k], rel=0.01)
            assert result[name].zero == pytest.approx(zeros[k], abs=0.01 * abs(times[k]))
        assert found.others == ()


def test_commands_with_nothing_in_common_yield_no_clock():
    for make in (steps, joystick):
        for seed in range(8):
            one, other = (make(np.random.default_rng([seed, k])) for k in (1, 2))
            simulation, _ = two([one])
            _, run = two([other])
            assert match_commands(simulation, run).kind == "different"


def test_a_simulator_with_commands_of_its_own_yields_no_clock():
    found = []
    for seed in range(12):
        one, other = (relay(np.random.default_rng([seed, k]), jitter=0.3) for k in (1, 2))
        simulation, _ = two([one])
        _, run = two([other])
        found.append(match_commands(simulation, run).kind)
    assert found.count("repeating") >= 11
    simulation, run = two([relay(np.random.default_rng(1), jitter=0.3)])
    other, _ = two([relay(np.random.default_rng(2), jitter=0.3)])
    result = compared([other], [run])
    assert result.rows == ()
    assert {d.slug for d in result.doubts} == {"commands-repeat", "simulation-driven-otherwise"}


@pytest.mark.parametrize("factor", [0.637, 1.0, 1.57])
def test_a_relay_is_matched_except_for_whole_periods(factor):
    rng = np.random.default_rng(5)
    found = match_commands(*two([relay(rng)], factor=factor, offset=3.3))
    assert found.kind == "matched"
    assert abs(found.clock.scale - factor) < 4.0 * found.clock.scale_std
    late = off(found.clock, factor, 3.3) / factor / 10.0
    assert abs(late - round(late)) < 0.01
    assert found.period == pytest.approx(10.0, abs=0.1)
    result = compared(*([t] for t in two([relay(rng)], factor=factor, offset=3.3)))
    assert "clock-ambiguous" in {d.slug for d in result.doubts}


@pytest.mark.parametrize("factor", FACTORS)
def test_a_slightly_uneven_relay_is_not_ambiguous(factor):
    commands = [relay(np.random.default_rng(6), jitter=0.3)]
    found = match_commands(*two(commands, factor=factor, offset=-40.0))
    assert found.kind == "matched"
    assert found.period == 0.0
    assert off(found.clock, factor, -40.0) < 4.0 * found.clock.shift_std


def test_an_even_relay_cut_short_on_another_clock_is_repeating():
    pair = two([relay(np.random.default_rng(5))], factor=1.57, starts=20.0)
    assert match_commands(*pair).kind == "repeating"


def test_constant_and_absent_commands_are_reported():
    t = np.arange(0.0, 60.0, 0.1)
    still = Channel("N", "1", t, np.full(len(t), 0.3))
    simulation, run = two([steps(np.random.default_rng(3))])
    quiet = replace(simulation, channels={"N": still})
    assert match_commands(quiet, run).kind == "constant"
    assert match_commands(replace(simulation, channels={}), run).kind == "absent"
    assert "commands-constant" in {d.slug for d in compared([quiet], [run]).doubts}


def test_every_fault_of_the_inputs_is_corrected():
    commands = [steps(np.random.default_rng([k, 4])) for k in range(3)]
    simulation, run = two(
        commands, factor=0.637, offset=3.0, order=(1, 0, 2), times=(-1.0, 1.0, 400.0), zeros=(0.0, 0.0, 1500.0)
    )
    found = compared([simulation], [run])
    rows = {n.name: n for n in found.rows}
    assert list(rows) == ["clock scale", "clock offset of 'run'", "sign of X", "unit of Z"]
    assert abs(rows["clock scale"].given - 0.637) < 4.0 * rows["clock scale"].given_std < 0.001
    assert abs(rows["clock offset of 'run'"].given - 3.0) < 0.05
    assert rows["unit of Z"].given == pytest.approx(400.0)
    assert [d.slug for d in found.doubts] == ["commands-exchanged"]
    assert "N is X of the run" in found.doubts[0].cause
    assert "X is N of the run" in found.doubts[0].cause
    for name in NAMES:
        assert found.simulations[0][name] is run[name]


def test_a_command_of_half_the_size_is_scaled_and_not_in_another_unit():
    simulation, run = two([steps(np.random.default_rng(3))], times=(0.5,))
    found = compared([simulation], [run])
    assert found.rows == ()
    assert [d.slug for d in found.doubts] == ["command-scaled"]
    assert "0.5 times as much" in found.doubts[0].cause
    assert np.array_equal(found.simulations[0]["N"].values, simulation["N"].values)


def test_a_channel_on_a_clock_of_its_own_is_reported():
    commands = [steps(np.random.default_rng([k, 4])) for k in range(3)]
    simulation, run = two(commands, factor=0.925)
    late = replace(simulation["Z"], t=0.94 / 0.925 * simulation["Z"].t)
    found = compared([replace(simulation, channels={**simulation.channels, "Z": late})], [run])
    assert [d.slug for d in found.doubts if d.slug == "commands-disagree"] == ["commands-disagree"]
    assert "the changes of Z" in next(d.cause for d in found.doubts if d.slug == "commands-disagree")


def test_an_uneven_clock_is_reported_and_its_own_commands_are_kept():
    commands = [steps(np.random.default_rng([k, 4])) for k in range(3)]
    simulation, run = two(commands, factor=0.637)
    uneven = {n: replace(c, t=c.t + 0.3 * np.sin(2.0 * math.pi * c.t / 25.0)) for n, c in simulation.channels.items()}
    found = compared([replace(simulation, channels=uneven)], [run])
    (row,) = found.rows
    assert abs(row.given - 0.637) < 4.0 * row.given_std < 0.03
    assert [d.slug for d in found.doubts] == ["clock-uneven"]
    assert found.simulations[0]["N"] is not run["N"]


def test_runs_with_different_clocks_have_one_scale_each():
    pairs = [two([steps(np.random.default_rng([k, 4]))], factor=f) for k, f in enumerate((0.64, 0.635))]
    runs = [replace(r, name=f"run{k}") for k, (_, r) in enumerate(pairs)]
    found = compared([s for s, _ in pairs], runs)
    assert [n.name for n in found.rows] == ["clock scale of 'run0'", "clock scale of 'run1'"]
    assert found.rows[0].given == pytest.approx(0.64, abs=5e-4)
    assert found.rows[1].given == pytest.approx(0.635, abs=5e-4)
