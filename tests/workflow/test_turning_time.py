"""A boat that turns slowly ends its stages early enough to turn around inside its distance limit."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gcs_autotune.craft import Observation
from gcs_autotune.errors import GuardTripped
from gcs_autotune.manoeuvres import Envelope, Relay, RelaySettings, Sequencer, TurnAround, TurnAroundSettings
from gcs_autotune.observer import SilentObserver
from gcs_autotune.trial import Channel, Trial
from gcs_autotune.workflow.runner import ManoeuvreRunner
from gcs_autotune.workflow.wrong_way import turning_time

from ..manoeuvres.toy_craft import PondCraft

CRUISE, LIMIT = 2.0, 180.0
ROOM = Envelope(heading_excursion=math.inf, distance=LIMIT, cruise=CRUISE)


class Boat(PondCraft):
    """Goes ahead at 2 m/s all the while; turns with time constant *T* [s] and *K* [rad/s] at full rudder."""

    servos = None

    def __init__(self, K: float, T: float) -> None:
        super().__init__(firmware="ardurover", gain=K / T, drag=1.0 / T)
        self.north = self.east = self.furthest = 0.0

    def longest_pause(self, begun: float) -> float:
        return 0.0

    def _advance(self, dt: float) -> None:
        super()._advance(dt)
        self.north += dt * CRUISE * math.cos(self.psi)
        self.east += dt * CRUISE * math.sin(self.psi)
        self.furthest = max(self.furthest, math.hypot(self.north, self.east))

    def observe(self) -> Observation:
        seen = super().observe()
        object.__setattr__(seen, "x", self.north)
        object.__setattr__(seen, "y", self.east)
        return seen


def relay(seconds: int = 900) -> Relay:
    return Relay(
        RelaySettings("psi", "N", output=0.4, hysteresis=math.radians(4.0), most_periods=1000, periods=seconds)
    )


@pytest.mark.parametrize(("K", "T"), [(0.16, 8.0), (0.2, 3.0), (0.1, 1.0)])
def test_the_turning_time_is_estimated_from_a_record(K: float, T: float) -> None:
    kept: list[Any] = []
    Sequencer(Boat(K, T), ROOM, SilentObserver(), kept.append).fly(relay())
    assert turning_time(kept[0], 0.5) == pytest.approx(T + 1.0 / (0.5 * K), rel=0.15)


@pytest.mark.parametrize(("K", "T"), [(0.14, 10.0), (0.12, 5.7), (0.2, 3.3)])
def test_short_pulses_to_both_sides_already_give_the_turning_time(K: float, T: float) -> None:
    t = np.arange(0.0, 16.0, 0.1)
    N = np.select([(t > 4.0) & (t <= 8.0), (t > 12.0)], [0.15, -0.15], 0.0)
    r = np.zeros(len(t))
    for i in range(1, len(t)):
        r[i] = r[i - 1] + 0.1 * (K * N[i - 1] - r[i - 1]) / T
    psi = 0.1 * np.cumsum(r) + np.random.default_rng(3).normal(0.0, 0.002, len(t))
    pulses = Trial("sign-check", {n: Channel(n, "1", t, v) for n, v in (("N", N), ("psi", psi))})
    assert 0.8 < turning_time(pulses, 0.5) / (T + 1.0 / (0.5 * K)) < 1.7


def test_a_record_with_steering_to_one_side_only_gives_no_turning_time() -> None:
    kept: list[Any] = []
    Sequencer(Boat(0.2, 3.0), ROOM, SilentObserver(), kept.append).fly(TurnAround(TurnAroundSettings(0.0)))
    assert math.isnan(turning_time(kept[0], 0.5))


def test_a_slow_boat_turns_around_inside_the_limit_once_its_turning_time_is_known() -> None:
    slow = (0.14, 10.0)
    boat = Boat(*slow)
    sequencer = Sequencer(boat, ROOM, SilentObserver(), lambda trial: None)
    sequencer.fly(relay())
    with pytest.raises(GuardTripped, match="distance from start"):
        sequencer.fly(TurnAround(TurnAroundSettings(0.0)))

    boat = Boat(*slow)
    log = SimpleNamespace(say=print, note=print, update=lambda progress: None)
    runner: Any = ManoeuvreRunner(boat, ROOM, log, lambda trial: None)  # type: ignore[arg-type]
    first = Relay(RelaySettings("psi", "N", output=0.4, hysteresis=math.radians(4.0)))
    runner.fly(first, "first", replace(ROOM, distance=math.inf))
    boat.north = boat.east = boat.psi = boat.r = boat.furthest = 0.0
    assert runner.fly(relay(), "second").ending == "stopped"
    assert runner.turn_around(0.0)
    assert 0.7 * LIMIT < boat.furthest < LIMIT
