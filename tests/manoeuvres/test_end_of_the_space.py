"""A manoeuvre ends with its record when the space runs out, before the distance limit would abort it."""

from __future__ import annotations

import math
import re

import pytest

from gcs_autotune.errors import GuardTripped
from gcs_autotune.manoeuvres import (
    Area,
    Envelope,
    Manoeuvre,
    Relay,
    RelaySettings,
    Sequencer,
    Step,
    StepSettings,
    ThrottleSteps,
    ThrottleStepsSettings,
    Zone,
)
from gcs_autotune.manoeuvres.envelope import TO_COME_ABOUT, Watch
from gcs_autotune.manoeuvres.set_point_relay import LEAST_SWITCHINGS, SetPointRelay
from gcs_autotune.observer import SilentObserver
from gcs_autotune.trial import Trial

from .toy_craft import PondCraft, at_rest

CRUISE = 2.0
QUAY = Area((Zone(((-50.0, -50.0), (100.0, -50.0), (100.0, 50.0), (-50.0, 50.0))),), "harbour.geojson")
"""100 m ahead."""


class Loose(PondCraft):
    """A boat that moves north at 2 m/s, independent of its heading."""

    def __init__(self) -> None:
        super().__init__(firmware="ardurover")
        self.speed = CRUISE

    def _advance(self, dt: float) -> None:
        super()._advance(dt)
        self.speed = CRUISE
        self.x += CRUISE * dt


class Restless(Loose):
    """A boat whose loop never settles: its heading keeps oscillating."""

    def _advance(self, dt: float) -> None:
        super()._advance(dt)
        self.r += 0.6 * dt * math.sin(1.1 * self.clock.now())


def flown(manoeuvre: Manoeuvre, distance: float, craft: PondCraft | None = None, **limits: object) -> Trial:
    room = Envelope(heading_excursion=math.inf, distance=distance, cruise=CRUISE, **limits)  # type: ignore[arg-type]
    return Sequencer(craft or Restless(), room, SilentObserver(), lambda trial: None).fly(manoeuvre)


def step() -> Step:
    return Step(StepSettings("psi", 0.5, 30.0, speed=CRUISE, enough=5.0, settle=20.0))


def test_a_step_is_cut_short_to_leave_space_for_a_short_return_step() -> None:
    found = flown(step(), 100.0)
    assert found.ending == "stopped"
    there, back = found.meta["lasted"]
    targets = [m.t for m in found.marks if m.kind == "target"]
    assert len(targets) == 3
    assert CRUISE * (targets[0] + 20.0 + there) == pytest.approx(100.0 - TO_COME_ABOUT * CRUISE, abs=2.0 * CRUISE)
    assert 10.0 < there < 30.0 and back == pytest.approx(4.0, abs=0.25)
    assert re.search(r"out of space 1\d s into the step and 4 s into the step back: \d+ m", found.reason)
    assert "limit 100 m (--max-distance)" in found.reason


def test_a_return_step_that_has_begun_ends_with_its_record() -> None:
    found = flown(step(), 140.0)
    there, back = found.meta["lasted"]
    assert there == pytest.approx(30.0, abs=0.15) and 4.0 < back < 30.0


def test_a_step_that_has_not_begun_when_the_space_ends_trips_the_guard() -> None:
    with pytest.raises(GuardTripped, match="distance from start"):
        flown(step(), 30.0)


def test_throttle_steps_end_once_two_levels_are_flown() -> None:
    steps = ThrottleSteps(ThrottleStepsSettings(0.5, (0.4, 1.0, 0.7, 0.9)))
    found = flown(steps, 42.0, Loose())
    assert found.ending == "stopped"
    assert "out of space after 2 of 4 throttle levels" in found.reason
    with pytest.raises(GuardTripped, match="distance from start"):
        flown(ThrottleSteps(ThrottleStepsSettings(0.5)), 20.0, Loose())


def test_a_set_point_relay_ends_once_it_has_switched_often_enough() -> None:
    relays = ((0.4, 0.1), (0.2, 0.05))
    found = flown(SetPointRelay(relays, CRUISE), 10_000.0, Loose())
    began = [m.t for m in found.marks if m.kind == "relay"][1]
    switches = [m.t for m in found.marks if m.kind == "switch" and m.t > began]
    room = CRUISE * (switches[LEAST_SWITCHINGS + 1] + TO_COME_ABOUT)
    short = flown(SetPointRelay(relays, CRUISE), room, Loose())
    assert short.ending == "stopped" and "reversals of the last relay" in short.reason
    assert len([m for m in short.marks if m.kind == "relay"]) == 2
    first = flown(SetPointRelay(relays, CRUISE), CRUISE * began, Loose())
    assert first.ending == "stopped" and "reversals of relay 1: " in first.reason
    with pytest.raises(GuardTripped, match="distance from start"):
        flown(SetPointRelay(relays, CRUISE), 5.0 * CRUISE, Loose())


def test_the_edge_of_an_area_ends_the_space_like_the_distance_limit() -> None:
    relay = Relay(RelaySettings("psi", "N", output=0.3, hysteresis=math.radians(10.0), most_periods=1000, periods=900))
    found = flown(relay, 10_000.0, area=QUAY)
    assert found.ending == "stopped"
    assert f"reversals: {TO_COME_ABOUT * CRUISE:.0f} m before the edge of harbour.geojson" in found.reason


def test_a_craft_that_can_stop_has_space_up_to_the_edge() -> None:
    near = at_rest(x=99.0, psi=0.0)
    boat, rov = (Watch(Envelope(area=QUAY, cruise=cruise), at_rest()) for cruise in (CRUISE, 0.0))
    assert boat.room_ends(near) and not rov.room_ends(near)
    assert not boat.room_ends(at_rest(x=99.0, psi=math.pi)), "its bow already points back"
