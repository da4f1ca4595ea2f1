from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gcs_autotune.craft import Actuate, Command, Observation
from gcs_autotune.manoeuvres import Envelope, Outlet, Sequencer, SignCheck, SignCheckSettings
from gcs_autotune.manoeuvres.pulse_response import Pulse, PulseResponse, pulse_response
from gcs_autotune.manoeuvres.sign_messages import not_followed
from gcs_autotune.observer import SilentObserver
from gcs_autotune.trial import Trial

from .toy_craft import Buoyant, PondCraft

STEERING = (Outlet(1, 1500.0, 500.0),)


def check(craft: PondCraft, signal: str = "psi", **changes: Any) -> tuple[SignCheck, Trial]:
    manoeuvre = SignCheck(
        SignCheckSettings(signal, "N" if signal == "psi" else "Z", outlets=STEERING, cure="Turn it round", **changes)
    )
    flown = Sequencer(craft, Envelope(depth_excursion=100.0), SilentObserver(), lambda trial: None).fly(manoeuvre)
    return manoeuvre, flown


def test_unreported_outputs_count_as_not_followed() -> None:
    rest, forward, back = ([(0.1 * k, 0.001 * (k % 2), math.nan) for k in range(n, n + 20)] for n in (0, 19, 38))
    found = pulse_response(0.3, rest, forward, back, 0.05)
    assert found.unheeded is found.forward
    assert found.is_silent
    assert "does not report its Y output" in not_followed(found.forward, "Y", STEERING)


@pytest.mark.parametrize(("gain", "drag"), [(1.0, 0.8), (0.3, 0.1), (8.0, 10.0), (0.15, 0.0), (0.4, 0.4)])
def test_a_correct_actuator_passes_on_any_craft(gain: float, drag: float) -> None:
    craft = PondCraft(gain=gain, drag=drag)
    manoeuvre, flown = check(craft)
    assert flown.ending == "completed"
    assert manoeuvre.answer is not None
    assert manoeuvre.answer.signs == (1, 1)
    assert flown.duration < 40.0
    assert abs(craft.psi) < math.radians(30.0)
    assert craft.command.N == 0.0  # type: ignore[union-attr]


@pytest.mark.parametrize("bias", [0.0, 0.05, -0.05])
def test_a_reversed_actuator_is_rejected_with_a_remedy_after_two_small_pulses(bias: float) -> None:
    craft = PondCraft(gain=-1.0, bias=bias)
    _, flown = check(craft)
    assert [m.detail["N"] for m in flown.marks] == [0.15, -0.15, 0.15, -0.15]
    assert flown.ending == "aborted"
    assert "+0.15 of full N output turned the craft" in flown.reason
    assert "to port" in flown.reason
    assert flown.reason.endswith("the wrong way. Turn it round")
    assert abs(craft.psi) < math.radians(60.0)


class Noisy(PondCraft):
    """A boat that turns already, in wind, with a poor compass."""

    def __init__(self, seed: int, **options: float) -> None:
        super().__init__(**options)
        self.noise, self.r = np.random.default_rng(seed), math.radians(2.0)

    def observe(self) -> Observation:
        seen = super().observe()
        object.__setattr__(seen, "psi", seen.psi + float(self.noise.normal(0.0, math.radians(0.4))))
        return seen


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(("gain", "signs"), [(0.06, (1, 1)), (-0.06, (-1, -1)), (0.0, (0, 0))])
def test_noise_drift_and_an_initial_turn_are_not_taken_for_a_response(
    seed: int, gain: float, signs: tuple[int, int]
) -> None:
    # Like Charlie: a time constant of 3 s, 10 deg/s at full rudder.
    manoeuvre, _ = check(Noisy(seed, gain=gain, drag=0.3, bias=0.001))
    assert manoeuvre.answer is not None
    assert manoeuvre.answer.signs == signs


@pytest.mark.parametrize(("gain", "signs"), [(150.0, (1, 1)), (-150.0, (-1, -1))])
def test_a_craft_as_fast_as_the_link_delay_passes_the_check(gain: float, signs: tuple[int, int]) -> None:
    class Late(PondCraft):
        """Turns 75 deg/s a tick after a pulse of 0.15 begins; its outputs are seen a tick later still."""

        def send(self, command: Command) -> None:
            super().send(self.next)
            self.next = command

        next: Command = Actuate()

    manoeuvre, _ = check(Late(gain=gain, drag=20.0))
    assert manoeuvre.answer is not None
    assert manoeuvre.answer.signs == signs


def test_a_dead_actuator_is_reported_with_its_pulses() -> None:
    _, flown = check(PondCraft(gain=0.0))
    assert flown.ending == "aborted"
    assert flown.reason.startswith("+0.60 of full N output did not clearly move the craft in 8.0 s and -0.60"), flown
    assert "SERVO1 went to 1800 us and 1200 us. The actuator is dead" in flown.reason
    assert [m.detail["N"] for m in flown.marks] == [0.15, -0.15, 0.3, -0.3, 0.6, -0.6]


def test_a_drift_stronger_than_the_actuator_is_not_taken_for_a_response() -> None:
    class OneWay(PondCraft):
        def _advance(self, dt: float) -> None:
            held, self.gain = self.gain, 0.0 if self.command.N < 0.0 else self.gain  # type: ignore[union-attr]
            super()._advance(dt)
            self.gain = held

    _, flown = check(OneWay())
    assert flown.ending == "aborted"
    assert "in one direction only" in flown.reason


def test_heave_is_checked_downwards_first() -> None:
    assert check(PondCraft(bias=-0.02), "z", reach=0.15, least=0.02)[1].ending == "completed"
    _, flown = check(PondCraft(gain=-1.0, bias=-0.02), "z", reach=0.15, least=0.02)
    assert "m up in" in flown.reason


HEAVE = {"signal": "z", "reach": 0.15, "least": 0.0225, "longest": 6.0}


@pytest.mark.parametrize("buoyancy", [-10.0, -1.0, 0.6, 3.0, 6.3, 10.0])
def test_a_rising_or_sinking_craft_is_not_reported_as_reversed(buoyancy: float) -> None:
    for depth in (0.13, 0.8, 1.5, 5.0):
        for seed in range(3):
            _, flown = check(Buoyant(buoyancy, depth, seed), **HEAVE)
            assert flown.ending == "completed", (depth, seed, flown.reason)


@pytest.mark.parametrize("buoyancy", [-10.0, -1.0, 0.6, 3.0])
def test_a_reversed_actuator_on_a_rising_or_sinking_craft_is_rejected(buoyancy: float) -> None:
    for seed in range(3):
        _, flown = check(Buoyant(buoyancy, 5.0, seed, sign=-1.0), **HEAVE)
        assert "the wrong way. Turn it round" in flown.reason, seed


def test_a_craft_that_no_pulse_drives_down_is_reported_as_rising_not_reversed() -> None:
    _, flown = check(Buoyant(75.0, 5.0, 1), **HEAVE)
    assert flown.ending == "aborted"
    assert "the wrong way" not in flown.reason


def test_a_drift_is_reported_with_a_remedy() -> None:
    _, flown = check(Buoyant(75.0, 40.0, 1, sign=0.0), **HEAVE)
    assert "without command it rises at 1.0" in flown.reason


@pytest.mark.parametrize("wind", [0.03, -0.03, 0.1, -0.1])
@pytest.mark.parametrize(("gain", "ending"), [(1.0, "completed"), (-1.0, "aborted")])
def test_a_boat_that_wind_or_current_turns_is_judged_by_its_rudder(wind: float, gain: float, ending: str) -> None:
    _, flown = check(PondCraft(gain=gain, bias=wind))
    assert flown.ending == ending
    assert ("the wrong way" in flown.reason) == (gain < 0.0)


class Outputs(PondCraft):
    """Shows other outputs than were commanded."""

    def __init__(self, shown: Callable[[float], float]) -> None:
        super().__init__()
        self.shown = shown

    def observe(self) -> Observation:
        seen = super().observe()
        object.__setattr__(seen, "output", {**seen.output, "N": self.shown(seen.output["N"])})
        return seen


@pytest.mark.parametrize(
    ("shown", "why"),
    [
        (lambda N: 1.0, "N is at +1.00 of full output without any command: SERVO1 is saturated"),
        (lambda N: -1.0, "N is at -1.00 of full output without any command: SERVO1 is saturated"),
        (lambda N: 0.0, "did not change"),
        (lambda N: -N, "the opposite direction"),
        (lambda N: max(N, -0.05), "is limited on that side"),
    ],
    ids=["saturated", "saturated the other way", "unheeded", "turned round", "cut off"],
)
def test_outputs_that_do_not_follow_the_command_are_rejected(shown: Callable[[float], float], why: str) -> None:
    _, flown = check(Outputs(shown))
    assert flown.ending == "aborted"
    assert why in flown.reason


def test_a_rudder_without_headway_is_rejected_before_any_pulse() -> None:
    _, flown = check(PondCraft(), throttle=0.05, least_speed=0.25)
    assert "makes only 0.07 m/s (noise 0.01 m/s) at 5% throttle" in flown.reason
    assert "more --throttle" in flown.reason
    assert not flown.marks
    assert check(PondCraft(), throttle=0.5, least_speed=0.25)[1].ending == "completed"


class Backing(PondCraft):
    """Moves over the ground as a reversed propeller or a current moves it: *share* of its speed is ahead."""

    def __init__(self, share: float) -> None:
        super().__init__()
        self.share = share

    def observe(self) -> Observation:
        seen = super().observe()
        object.__setattr__(seen, "u", self.share * seen.speed)
        return seen


@pytest.mark.parametrize(("share", "ending"), [(-1.0, "aborted"), (-0.75, "aborted"), (-0.6, "completed")])
def test_sternway_under_ahead_throttle_is_rejected_and_leeway_is_accepted(share: float, ending: str) -> None:
    _, flown = check(Backing(share), throttle=0.5, least_speed=0.25, astern="Turn the propeller round")
    assert flown.ending == ending
    assert ("goes astern at" in flown.reason) == (ending == "aborted")
    assert flown.reason.endswith("Turn the propeller round") == (ending == "aborted")
    assert bool(flown.marks) == (ending == "completed")


@pytest.mark.parametrize("noise", [0.1, 0.4, 1.0])
def test_the_motion_threshold_is_five_times_the_noise_and_at_least_the_set_value(noise: float) -> None:
    craft = Noisy(1, gain=2.0, drag=0.8)
    craft.r, craft.observe = 0.0, lambda: noisy(craft, noise)  # type: ignore[method-assign]
    manoeuvre, _ = check(craft, reach=math.radians(20.0))
    assert manoeuvre.answer is not None
    assert math.degrees(manoeuvre.answer.threshold) == pytest.approx(max(1.5, 5.0 * noise), rel=0.35)
    assert math.degrees(manoeuvre.answer.threshold) >= 1.5


def noisy(craft: Noisy, degrees: float) -> Observation:
    seen = PondCraft.observe(craft)
    object.__setattr__(seen, "psi", seen.psi + float(craft.noise.normal(0.0, math.radians(degrees))))
    return seen


@pytest.mark.parametrize("output", [math.nan, -0.3, 0.0, 0.07])
def test_an_unknown_or_too_small_output_does_not_count_as_followed(output: float) -> None:
    followed = Pulse(-0.15, -0.1, 0.01, -0.1, -0.15, 1.0)
    odd = Pulse(0.15, 0.1, 0.01, 0.1, output, 1.0)
    assert PulseResponse(odd, followed, 0.02, 0.1, 0.01, 0.0).unheeded is odd
    assert PulseResponse(followed, followed, 0.02, 0.1, 0.01, 0.0).unheeded is None


@pytest.mark.parametrize(("compared", "reversed_"), [(-4.0, True), (-2.0, False), (4.0, False)])
def test_one_wrong_response_means_reversed_only_if_both_pulses_together_confirm_it(
    compared: float, reversed_: bool
) -> None:
    """The first pulse, a command of 0.15, moves it the wrong way; the other has no visible effect."""
    wrong, unseen = Pulse(0.15, -0.05, 0.005, -0.05, 0.15, 1.0), Pulse(-0.15, 0.0, 0.005, 0.0, -0.15, 1.0)
    response = PulseResponse(wrong, unseen, 0.02, 0.01 * compared, 0.01, 0.0)
    assert response.signs == (-1, 0)
    assert response.is_reversed is reversed_


def test_an_unknown_speed_counts_as_no_speed() -> None:
    craft = PondCraft()
    craft.speed = math.nan
    _, flown = check(craft, throttle=0.5, least_speed=0.25)
    assert "Wait for a GPS fix" in flown.reason


def test_the_record_contains_signs_and_motions() -> None:
    _, flown = check(PondCraft())
    assert flown.meta["manoeuvre"] == "sign-check"
    assert flown.meta["signs"] == [1, 1]
    assert flown.meta["moved"][0] > 0.0 > flown.meta["moved"][1]


class Circling(PondCraft):
    """Turns by itself, its speed going up and down with that."""

    def __init__(self, rate: float) -> None:
        super().__init__()
        self.rate = rate

    def observe(self) -> Observation:
        seen = super().observe()
        object.__setattr__(seen, "psi", self.rate * seen.t)
        object.__setattr__(seen, "speed", 0.6 + 0.3 * math.sin(2.0 * seen.t))
        return seen


@pytest.mark.parametrize(("rate", "side"), [(0.3, "starboard"), (-0.3, "port")])
def test_a_boat_that_turns_by_itself_is_not_reported_as_slow(rate: float, side: str) -> None:
    _, flown = check(Circling(rate), throttle=0.5, least_speed=0.25)
    assert flown.ending == "aborted"
    assert f"without steering the craft turns at 17 deg/s to {side} at 50% throttle" in flown.reason
    assert "makes only" not in flown.reason
    _, straight = check(Circling(0.0), throttle=0.5, least_speed=0.25)
    assert "makes only" in straight.reason


@pytest.mark.parametrize(
    ("phase", "side"), [(math.pi, -1.0), (0.0, 1.0)], ids=["to starboard by now", "to port by now"]
)
def test_the_first_pulse_turns_a_bow_moved_by_waves_back_to_its_start(phase: float, side: float) -> None:
    class Swinging(PondCraft):
        """By 30 deg to either side every 4 s, beyond what the pulses do."""

        def observe(self) -> Observation:
            seen = super().observe()
            swing = math.radians(30.0) * (math.sin(1.5 * seen.t + phase) - math.sin(phase))
            return replace(seen, psi=seen.psi + swing, r=seen.r + math.radians(45.0) * math.cos(1.5 * seen.t + phase))

    _, flown = check(Swinging())
    first = next(m for m in flown.marks if m.kind == "pulse")
    assert math.copysign(1.0, float(first.detail["N"])) == side


@pytest.mark.parametrize("seed", range(6))
def test_a_slow_boat_with_a_poor_compass_gets_enough_time_to_turn(seed: int) -> None:
    boat = Noisy(seed, gain=0.016, drag=0.125)
    boat.r = 0.0
    manoeuvre, flown = check(boat)
    assert flown.ending == "completed"
    assert manoeuvre.answer is not None and manoeuvre.answer.signs == (1, 1)
