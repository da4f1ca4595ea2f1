from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from gcs_autotune.craft import Actuate, Command, Observation
from gcs_autotune.manoeuvres import Envelope, Flown, Outlet, Sequencer, SignCheck, SignCheckSettings
from gcs_autotune.watch import SilentWatcher

from .pond import PondCraft

STEERING = (Outlet(1, 1500.0, 500.0),)


def check(craft: PondCraft, signal: str = "psi", **changes: Any) -> tuple[SignCheck, Flown]:
    manoeuvre = SignCheck(
        SignCheckSettings(signal, "N" if signal == "psi" else "Z", outlets=STEERING, cure="Turn it round", **changes)
    )
    flown = Sequencer(craft, Envelope(), SilentWatcher(), lambda trial: None).fly(manoeuvre)
    return manoeuvre, flown


@pytest.mark.parametrize(("gain", "drag"), [(1.0, 0.8), (0.3, 0.1), (8.0, 10.0), (0.15, 0.0), (0.4, 0.4)])
def test_an_actuator_that_acts_rightly_passes_whatever_the_craft(gain: float, drag: float) -> None:
    craft = PondCraft(gain=gain, drag=drag)
    manoeuvre, flown = check(craft)
    assert flown.outcome.ending == "completed"
    assert manoeuvre.answer is not None
    assert manoeuvre.answer.signs == (1, 1)
    assert flown.trial.duration < 40.0
    assert abs(craft.psi) < math.radians(30.0)
    assert craft.command.N == 0.0  # type: ignore[union-attr]


@pytest.mark.parametrize("bias", [0.0, 0.05, -0.05])
def test_a_reversed_actuator_is_refused_with_its_cure_after_one_small_pulse(bias: float) -> None:
    craft = PondCraft(gain=-1.0, bias=bias)
    _, flown = check(craft)
    assert flown.outcome.ending == "aborted"
    assert "+0.15 of full N moved it" in flown.outcome.reason
    assert "to port" in flown.outcome.reason
    assert flown.outcome.reason.endswith("the wrong way. Turn it round")
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
def test_noise_drift_and_a_turn_under_way_are_not_taken_for_an_answer(
    seed: int, gain: float, signs: tuple[int, int]
) -> None:
    # Like Charlie: a time constant of 3 s, 10 deg/s at full rudder.
    manoeuvre, _ = check(Noisy(seed, gain=gain, drag=0.3, bias=0.001))
    assert manoeuvre.answer is not None
    assert manoeuvre.answer.signs == signs


@pytest.mark.parametrize(("gain", "signs"), [(150.0, (1, 1)), (-150.0, (-1, -1))])
def test_a_craft_as_quick_as_the_link_is_late_is_understood(gain: float, signs: tuple[int, int]) -> None:
    class Late(PondCraft):
        """Turns 75 deg/s a tick after a pulse of 0.15 begins; its outputs are seen a tick later still."""

        def send(self, command: Command) -> None:
            super().send(self.next)
            self.next = command

        next: Command = Actuate()

    manoeuvre, _ = check(Late(gain=gain, drag=20.0))
    assert manoeuvre.answer is not None
    assert manoeuvre.answer.signs == signs


def test_a_dead_actuator_is_named_with_the_pulses_it_was_given() -> None:
    _, flown = check(PondCraft(gain=0.0))
    assert flown.outcome.ending == "aborted"
    assert "SERVO1 went to 1800 us and 1200 us: it is dead" in flown.outcome.reason
    assert [m.detail["N"] for m in flown.trial.marks] == [0.15, -0.15, 0.3, -0.3, 0.6, -0.6]


def test_a_drift_stronger_than_the_actuator_is_not_taken_for_an_answer() -> None:
    class OneWay(PondCraft):
        def _advance(self, dt: float) -> None:
            held, self.gain = self.gain, 0.0 if self.command.N < 0.0 else self.gain  # type: ignore[union-attr]
            super()._advance(dt)
            self.gain = held

    _, flown = check(OneWay())
    assert flown.outcome.ending == "aborted"
    assert "one way only" in flown.outcome.reason


def test_heave_is_checked_downwards_first() -> None:
    assert check(PondCraft(bias=-0.02), "z", reach=0.15, least=0.02)[1].outcome.ending == "completed"
    _, flown = check(PondCraft(gain=-1.0, bias=-0.02), "z", reach=0.15, least=0.02)
    assert "m up in" in flown.outcome.reason


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
        (lambda N: 1.0, "SERVO1 is saturated"),
        (lambda N: 0.0, "did not move"),
        (lambda N: -N, "the other way round"),
        (lambda N: max(N, -0.05), "is cut off on that side"),
    ],
    ids=["saturated", "unheeded", "turned round", "cut off"],
)
def test_outputs_that_do_not_do_what_was_commanded_are_refused(shown: Callable[[float], float], why: str) -> None:
    _, flown = check(Outputs(shown))
    assert flown.outcome.ending == "aborted"
    assert why in flown.outcome.reason


def test_a_rudder_without_way_on_is_refused_before_any_pulse() -> None:
    _, flown = check(PondCraft(), throttle=0.05, least_speed=0.25)
    assert "makes only 0.07 m/s at 5% throttle" in flown.outcome.reason
    assert "give more --throttle" in flown.outcome.reason
    assert not flown.trial.marks
    assert check(PondCraft(), throttle=0.5, least_speed=0.25)[1].outcome.ending == "completed"


def test_a_speed_nobody_knows_is_no_speed() -> None:
    craft = PondCraft()
    craft.speed = math.nan
    _, flown = check(craft, throttle=0.5, least_speed=0.25)
    assert "wait for a GPS fix" in flown.outcome.reason


def test_the_record_says_what_was_seen() -> None:
    _, flown = check(PondCraft())
    assert flown.trial.meta["manoeuvre"] == "sign-check"
    assert flown.trial.meta["signs"] == [1, 1]
    assert flown.trial.meta["moved"][0] > 0.0 > flown.trial.meta["moved"][1]
