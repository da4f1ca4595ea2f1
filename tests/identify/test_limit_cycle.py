"""Limit cycles, read after the run and followed while it runs."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest
from axis_plants import DEG, Levels, Relay, fly

from gcs_autotune.identify.relay import LimitCycleMonitor
from gcs_autotune.identify.relay.iso import decide, estimate, relay, relay_bias
from gcs_autotune.identify.relay.limit_cycle import MonitorState, find_cycles, settled_cycles
from gcs_autotune.identify.signals import prepare
from gcs_autotune.trial import Channel, Mark, Trial

Record = Callable[..., Trial]
PLANT = (0.36, 0.12, 0.05, 0.0)


def follow(trial: Trial, C: float, x_a: float, sign: float = 1.0, **rule: float) -> list[MonitorState]:
    monitor = LimitCycleMonitor(C, x_a, **rule)  # type: ignore[arg-type]  # periods is an int
    psi, N = trial["psi"], trial["N"]
    return [monitor.update(t, sign * x, bool(n > 0)) for t, x, n in zip(psi.t, psi.values, N.values, strict=True)]


def test_the_describing_function_is_the_first_harmonic_of_the_relay() -> None:
    C, X, x_a, x_0 = 2.0, 5.0, 3.0, 0.7
    phase = np.linspace(0.0, 2.0 * np.pi, 400_001)
    x = x_0 + X * np.sin(phase)
    high, out = False, np.empty_like(x)
    for turn in range(2):
        for i, value in enumerate(x):
            high = True if value > x_a else False if value < -x_a else high
            out[i] = C if high else -C
        assert turn < 2
    P, Q = relay(C, X, x_a, x_0)
    assert np.trapezoid(out * np.sin(phase), phase) / (np.pi * X) == pytest.approx(P, rel=1e-4)
    assert np.trapezoid(out * np.cos(phase), phase) / (np.pi * X) == pytest.approx(Q, rel=1e-4)
    assert np.trapezoid(out, phase) / (2.0 * np.pi) == pytest.approx(relay_bias(C, X, x_a, x_0), rel=1e-3)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_monitor_stops_after_five_equal_periods_and_agrees_with_the_later_analysis(
    sign: float, record: Record
) -> None:
    trial = record(PLANT, Relay(0.3, 8 * DEG), 60.0, dt=0.02)
    states = follow(trial, 0.3, 8 * DEG, sign)
    settled = next(s for s in states if s.settled)
    assert settled.periods == 5
    assert settled.switchings >= 11
    live = settled.cycle
    (after,) = find_cycles(trial, "yaw")
    assert live is not None
    assert abs(live.C - 0.3) < 1e-9
    assert abs(after.C - 0.3) < 1e-9
    for name in ("X_m", "omega", "x_a_star", "T_H"):
        assert getattr(live, name) == pytest.approx(getattr(after, name), rel=0.04)
    assert estimate(live).alpha == pytest.approx(estimate(after).alpha, rel=0.05)


def test_a_period_that_breaks_the_amplitude_condition_clears_the_count() -> None:
    monitor = LimitCycleMonitor(1.0, 0.1)
    states = []
    for k in range(60):
        swing = 0.3 if k // 6 != 5 else 0.02
        t, high = 0.5 * k, k % 2 == 0
        states.append(monitor.update(t, 0.1 if high else -0.1, high))
        states.append(monitor.update(t + 0.2, swing if high else -swing, high))
    counts = [s.periods for s in states]
    drop = next(i for i in range(1, len(counts)) if counts[i] < counts[i - 1])
    assert counts[drop] == 0
    assert not states[drop].proper
    assert states[-1].settled


def test_a_period_below_the_condition_only_by_noise_is_counted() -> None:
    def counted(noise: float, swing: float) -> list[int]:
        monitor, rng, counts = LimitCycleMonitor(1.0, 0.1, noise=noise), np.random.default_rng(1), []
        for k in range(40):
            sign = 1.0 if k % 2 == 0 else -1.0
            monitor.update(0.5 * k, sign * (0.1 + abs(rng.normal(0.0, 0.01))), sign > 0.0)
            counts.append(monitor.update(0.5 * k + 0.2, sign * (swing + rng.normal(0.0, 0.01)), sign > 0.0).periods)
        return counts

    assert max(counted(0.01, 0.115)) == 5
    assert max(counted(0.0, 0.115)) < 5  # without the noise every single period must satisfy it
    assert max(counted(0.01, 0.1)) < 5  # the mean still must


def test_samples_that_are_not_numbers_do_not_disturb_the_monitor(record: Record) -> None:
    trial = record(PLANT, Relay(0.3, 8 * DEG), 60.0, dt=0.05)
    values = trial["psi"].values.copy()
    values[100:103] = math.nan
    psi = dataclasses.replace(trial["psi"], values=values)
    spoilt = dataclasses.replace(trial, channels={**trial.channels, "psi": psi})
    assert follow(spoilt, 0.3, 8 * DEG)[-1].settled


def test_growing_oscillations_are_not_settled() -> None:
    monitor = LimitCycleMonitor(1.0, 0.1)
    for k in range(40):
        high, swing = k % 2 == 0, 0.2 * 1.2 ** (k / 2)
        monitor.update(0.5 * k, 0.1 if high else -0.1, high)
        monitor.update(0.5 * k + 0.2, swing if high else -swing, high)
    assert not monitor.state.settled
    assert monitor.state.cycle is not None
    assert monitor.state.cycle.scatter > 0.1


def test_a_constant_force_shows_as_bias_and_is_identified_with_its_sign(record: Record) -> None:
    for delta in (0.06, -0.06):
        (cycle,) = find_cycles(record((0.36, 0.3, 0.0, delta), Relay(0.3, 8 * DEG), 60.0, dt=0.02), "yaw")
        assert estimate(cycle).delta == pytest.approx(delta, rel=0.1)
        assert cycle.valid


def test_every_relay_setting_of_a_run_has_its_own_cycle(record: Record) -> None:
    def growing(t: float, eta: float, relays: tuple[Relay, Relay] = (Relay(0.2, 0.14), Relay(0.4, 0.14))) -> float:
        outputs = [r(t, eta) for r in relays]
        return outputs[0] if t < 30.0 else outputs[1]

    cycles = find_cycles(record(PLANT, growing, 60.0, dt=0.05), "yaw")
    assert [round(c.C, 6) for c in cycles] == [0.2, 0.4]
    assert decide(estimate(cycles[0]), estimate(cycles[1])).verdict == "linear"


def test_an_input_that_is_not_a_relay_has_no_limit_cycle(record: Record) -> None:
    rng = np.random.default_rng(2)
    levels = Levels(rng, 0.3, 2.0)
    flips = rng.choice([-0.3, 0.3], 200)
    assert find_cycles(record(PLANT, levels, 60.0), "yaw") == ()
    assert find_cycles(record(PLANT, lambda t, eta: float(flips[int(t / 1.5)]), 60.0), "yaw") == ()


def test_marked_switchings_are_used_if_the_input_channel_shows_none(record: Record) -> None:
    trial = record(PLANT, Relay(0.3, 8 * DEG), 40.0, dt=0.05)
    (plain,) = find_cycles(trial, "yaw")
    N = trial["N"]
    switched = N.t[1:][np.diff(N.values) != 0.0]
    shifted = dataclasses.replace(N, values=N.values + 5.0)
    marks = tuple(Mark(float(t), "switch") for t in switched)
    marked = dataclasses.replace(trial, channels={**trial.channels, "N": shifted}, marks=marks)
    (found,) = find_cycles(marked, "yaw")
    assert found.X_m == pytest.approx(plain.X_m, rel=1e-6)
    assert found.offset == pytest.approx(5.0, abs=0.01)


def test_wrapped_heading_across_south_does_not_break_the_reading(record: Record) -> None:
    trial = record(PLANT, Relay(0.3, 8 * DEG), 40.0)
    psi = trial["psi"]
    turned = np.arctan2(np.sin(psi.values + np.pi), np.cos(psi.values + np.pi))
    channels = {**trial.channels, "psi": dataclasses.replace(psi, values=turned)}
    (plain,), (south,) = (
        find_cycles(trial, "yaw"),
        find_cycles(dataclasses.replace(trial, channels=channels), "yaw"),
    )
    assert south.X_m == pytest.approx(plain.X_m, rel=1e-9)


@pytest.mark.parametrize("cruise", [0.0, 0.5])
def test_the_return_to_neutral_at_the_end_is_not_a_switching(cruise: float) -> None:
    """A relay on a velocity oscillates about the mean of whole periods: a half period would shift it."""
    end = 62.0

    def record_until(end: float) -> Trial:
        relay = Relay(0.3, 0.15)
        t, _, u, tau = fly(
            (1.0, 0.4, 0.0, 0.0), lambda t, x: relay(t, x) if t < 61.0 else -cruise, end, dt=0.1, delay=0.0, h=0.01
        )
        return Trial("surge", {"u": Channel("u", "m/s", t, u), "X": Channel("X", "1", t, tau + cruise)})

    (whole,) = find_cycles(record_until(end), "surge")
    (without,) = find_cycles(record_until(61.0), "surge")
    assert whole.nu_0 == pytest.approx(without.nu_0, abs=1e-3)
    assert whole.X_m == pytest.approx(without.X_m, rel=1e-3)
    assert (whole.periods, whole.C) == (without.periods, pytest.approx(without.C))


def test_a_relay_that_stops_at_a_switching_includes_its_last_half_period(record: Record) -> None:
    """The stop rule ends a relay just where it switches: the last period is whole, though neutral follows at once."""
    relay = Relay(0.3, 8 * DEG)
    whole = record(PLANT, relay, 60.0, dt=0.05)
    N = whole["N"]
    switched = N.t[1:][np.diff(N.values) != 0.0]
    end = float(switched[10])
    t = np.arange(0.0, end + 1.0, 0.05)
    levels = np.where(t < end - 0.02, N.values[np.searchsorted(N.t, t + 1e-9, side="right") - 1], 0.0)
    stopped = dataclasses.replace(
        whole,
        channels={**whole.channels, "N": Channel("N", "1", t, levels)},
        marks=tuple(Mark(float(s), "switch") for s in switched[:11]),
    )
    (stretch,) = prepare(stopped, "yaw")
    (found,) = settled_cycles(stopped, stretch)
    assert found.edges[-1] == pytest.approx(end, abs=0.051)
    (bare,) = settled_cycles(dataclasses.replace(stopped, marks=()), stretch)
    assert bare.edges[-1] == pytest.approx(switched[9], abs=0.051)  # without a mark it may be a return to neutral


@pytest.mark.parametrize("first", [1.0, -1.0])
def test_the_start_of_a_short_relay_is_not_a_switching(first: float) -> None:
    """The way from the start to the first switching is shorter than a half period, and is left out of the period."""
    dt, output, x_a = 0.02, 0.3, 0.1
    psi, r, N, rows, switches = 0.0, 0.0, 0.0, [], []
    for k in range(6000):
        if k * dt >= 2.0 and N == 0.0:
            N = first * output
        elif N != 0.0 and psi * np.sign(N) >= x_a:
            N = -N
            switches.append(k * dt)
        rows.append((k * dt, psi, r, N))
        if len(switches) == 4:
            break
        r += dt * (N - 0.5 * r) / 0.6
        psi += dt * r
    t, psi_of, r_of, N_of = np.array(rows).T
    run = Trial(
        "relay",
        {"psi": Channel("psi", "rad", t, psi_of), "r": Channel("r", "rad/s", t, r_of), "N": Channel("N", "1", t, N_of)},
        meta={"manoeuvre": "relay", "x_a": x_a},
    )
    (cycle,) = find_cycles(run, "yaw")
    assert cycle.periods == 1
    assert 2.0 * math.pi / cycle.omega == pytest.approx(switches[-1] - switches[-3], rel=0.02) or (
        2.0 * math.pi / cycle.omega == pytest.approx(switches[-2] - switches[0], rel=0.02)
    )
