"""A comparison with NaN is false: no guard may rest on that."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from gcs_autotune.errors import GuardTripped
from gcs_autotune.manoeuvres import GUARDS, Area, Dive, DiveSettings, Envelope, Step, StepSettings, Zone
from gcs_autotune.manoeuvres.envelope import Watch

from .toy_craft import at_rest

SIGNALS = {
    "heading excursion": "psi",
    "depth excursion": "z",
    "greatest depth": "z",
    "least depth": "z",
    "speed": "speed",
    "turn rate": "r",
    "distance from start": "x",
    "outside the area": "x",
    "roll": "phi",
    "pitch": "theta",
    "battery voltage": "battery_voltage",
    "battery remaining": "battery_remaining",
    "time": "t",
}
"""Guard -> a signal it watches."""
CHARGED = {"battery_voltage": 12.0, "battery_remaining": 0.9}
WIDE = Envelope(
    *(math.inf, 0.0, math.inf, math.inf, math.inf, math.inf, math.inf, math.inf, 0.0, 0.0, math.inf),
)
FIELDS = {
    "heading excursion": {"heading_excursion": 3.0},
    "depth excursion": {"depth_excursion": 3.0},
    "greatest depth": {"depth_max": 30.0},
    "least depth": {"depth_min": 0.1},
    "speed": {"speed": 4.0},
    "turn rate": {"turn_rate": 1.0},
    "distance from start": {"distance": 300.0},
    "outside the area": {"area": Area((Zone(((0.0, 0.0),), 50.0),), "a test")},
    "roll": {"roll": 1.0},
    "pitch": {"pitch": 1.0},
    "battery voltage": {"battery_voltage": 10.0},
    "battery remaining": {"battery_remaining": 0.1},
    "time": {"time": 600.0},
}
"""Guard -> the envelope that has this limit alone."""


def only(name: str) -> Envelope:
    return replace(WIDE, **FIELDS[name])


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("guard", GUARDS, ids=lambda g: g.name)
def test_a_guarded_signal_that_becomes_nan_trips_its_guard(guard, value):
    watch = Watch(only(guard.name), at_rest(**CHARGED))
    watch.check(at_rest(**CHARGED))
    with pytest.raises(GuardTripped) as caught:
        watch.check(at_rest(**{**CHARGED, SIGNALS[guard.name]: value}))
    assert caught.value.guard == guard.name
    assert "can no longer be monitored" in str(caught.value)


@pytest.mark.parametrize("guard", GUARDS, ids=lambda g: g.name)
def test_nan_in_a_signal_without_a_limit_trips_no_guard(guard):
    watch = Watch(WIDE, at_rest(**CHARGED))
    name, share = watch.check(at_rest(**{**CHARGED, SIGNALS[guard.name]: math.nan}))
    assert (name, share) == ("", 0.0)


def test_a_signal_known_at_connection_is_guarded_in_every_manoeuvre():
    blind = at_rest(battery_remaining=math.nan)
    with pytest.raises(GuardTripped, match="battery remaining"):
        Watch(only("battery remaining"), blind, home=at_rest(battery_remaining=0.9)).check(blind)


def test_a_step_in_a_nan_signal_is_aborted_without_blaming_the_gains():
    step = Step(StepSettings("z", 1.0, 5.0))
    commands = step.commands(at_rest(z=1.0))
    next(commands)
    commands.send(at_rest(t=0.1, z=math.nan))
    assert step.outcome is not None
    assert step.outcome.ending == "aborted"
    assert "does not report" in step.outcome.reason


def test_a_nan_depth_does_not_reach_the_target():
    dive = Dive(DiveSettings(1.5))
    commands = dive.commands(at_rest(z=0.0))
    next(commands)
    for tick in range(700):
        commands.send(at_rest(t=0.1 * tick, z=math.nan))
        if dive.outcome is not None:
            break
    assert dive.outcome is not None
    assert dive.outcome.ending == "aborted"
