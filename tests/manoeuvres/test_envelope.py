from __future__ import annotations

import math

import pytest

from gcs_autotune.errors import GuardTripped
from gcs_autotune.manoeuvres import GUARDS, Envelope
from gcs_autotune.manoeuvres.envelope import Watch

from .pond import at_rest

TIGHT = Envelope(
    heading_excursion=math.radians(40.0),
    depth_excursion=1.5,
    depth_max=6.0,
    depth_min=0.5,
    speed=2.0,
    distance=30.0,
    roll=0.5,
    pitch=0.4,
    battery_voltage=11.0,
    battery_remaining=0.2,
    time=60.0,
)
BROKEN = {
    "heading excursion": {"psi": math.radians(-41.0)},
    "depth excursion": {"z": 2.6},
    "greatest depth": {"z": 6.1},
    "least depth": {"z": 0.4},
    "speed": {"speed": 2.1},
    "distance from start": {"x": 20.0, "y": 25.0},
    "roll": {"phi": -0.6},
    "pitch": {"theta": 0.41},
    "battery voltage": {"battery_voltage": 10.9},
    "battery remaining": {"battery_remaining": 0.19},
    "time": {"t": 60.1},
}


def anchor_for(name: str):
    return at_rest(z=5.5) if name == "greatest depth" else at_rest()


@pytest.mark.parametrize("guard", GUARDS, ids=lambda g: g.name)
def test_every_guard_trips_beyond_its_limit_and_says_which(guard):
    anchor = anchor_for(guard.name)
    with pytest.raises(GuardTripped) as caught:
        Watch(TIGHT, anchor).check(at_rest(**{"z": anchor.z, **BROKEN[guard.name]}))
    assert caught.value.guard == guard.name
    assert guard.name in str(caught.value)
    assert "neutral" in str(caught.value)


def test_every_guard_has_a_case_here():
    assert {g.name for g in GUARDS} == set(BROKEN)


def test_inside_the_envelope_the_nearest_guard_is_named_with_its_share():
    name, share = Watch(TIGHT, at_rest()).check(at_rest(t=33.0, psi=math.radians(10.0)))
    assert (name, share) == ("time", pytest.approx(0.55))


def test_signals_the_craft_does_not_have_trip_nothing():
    nan = math.nan
    blind = at_rest(x=nan, y=nan, z=nan, speed=nan, phi=nan, theta=nan, battery_remaining=nan)
    Watch(TIGHT, blind).check(blind)


def test_limits_set_to_infinity_are_off():
    wide = Envelope(*[math.inf] * 4, math.inf, math.inf, math.inf, math.inf, 0.0, 0.0, math.inf)
    Watch(wide, at_rest()).check(at_rest(t=1e6, psi=1e3, speed=1e3, x=1e6, phi=3.0, theta=3.0))
