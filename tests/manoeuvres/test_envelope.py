from __future__ import annotations

import argparse
import math
from dataclasses import replace

import pytest

from gcs_autotune.cli.command import GUARDING, add_envelope, envelope_from
from gcs_autotune.errors import GuardTripped
from gcs_autotune.limits import limit_of
from gcs_autotune.manoeuvres import GUARDS, Area, Envelope, Zone
from gcs_autotune.manoeuvres.envelope import Watch

from .toy_craft import at_rest

TIGHT = Envelope(
    heading_excursion=math.radians(40.0),
    depth_excursion=1.5,
    depth_max=6.0,
    depth_min=0.5,
    speed=2.0,
    turn_rate=math.radians(30.0),
    distance=30.0,
    roll=0.5,
    pitch=0.4,
    battery_voltage=11.0,
    battery_remaining=0.2,
    time=60.0,
)
POND = Area((Zone(((0.0, 0.0),), 25.0),), "the area")
BROKEN = {
    "heading excursion": {"psi": math.radians(-41.0)},
    "depth excursion": {"z": 2.6},
    "greatest depth": {"z": 6.1},
    "least depth": {"z": 0.4},
    "speed": {"speed": 2.1},
    "distance from start": {"x": 0.0, "y": 31.0},
    "outside the area": {"x": 20.0, "y": 16.0},
    "turn rate": {"r": math.radians(-31.0)},
    "roll": {"phi": -0.6},
    "pitch": {"theta": 0.41},
    "battery voltage": {"battery_voltage": 10.9},
    "battery remaining": {"battery_remaining": 0.19},
    "time": {"t": 60.1},
}


def anchor_for(name: str):
    return at_rest(z=5.5) if name == "greatest depth" else at_rest()


@pytest.mark.parametrize("guard", GUARDS, ids=lambda g: g.name)
def test_every_guard_trips_beyond_its_limit_and_is_identified(guard):
    anchor = anchor_for(guard.name)
    with pytest.raises(GuardTripped) as caught:
        Watch(replace(TIGHT, area=POND), anchor).check(at_rest(**{"z": anchor.z, **BROKEN[guard.name]}))
    assert caught.value.guard == guard.name
    assert guard.name in str(caught.value)
    assert "neutral" in str(caught.value)


def test_every_guard_has_a_test_case():
    assert {g.name for g in GUARDS} == set(BROKEN)


def test_inside_the_envelope_the_nearest_guard_is_reported_with_its_used_fraction():
    name, share = Watch(TIGHT, at_rest()).check(at_rest(t=33.0, psi=math.radians(10.0)))
    assert (name, share) == ("time", pytest.approx(0.55))


def test_missing_signals_trip_no_guard():
    nan = math.nan
    blind = at_rest(x=nan, y=nan, z=nan, speed=nan, phi=nan, theta=nan, battery_remaining=nan)
    assert Watch(TIGHT, blind).check(blind) == ("", 0.0)


def test_infinite_limits_are_disabled():
    inf = math.inf
    wide = Envelope(inf, 0.0, inf, inf, inf, inf, inf, inf, 0.0, 0.0, inf)
    far = at_rest(t=1e6, psi=1e3, z=1e4, speed=1e3, x=1e6, phi=3.0, theta=3.0, battery_remaining=0.5)
    assert Watch(wide, at_rest()).check(far) == ("", 0.0)


TWO_SIDED = {
    "heading excursion": ("psi", math.radians(40.0)),
    "depth excursion": ("z", 1.5),
    "roll": ("phi", 0.5),
    "pitch": ("theta", 0.4),
}


@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["positive", "negative"])
@pytest.mark.parametrize("name", TWO_SIDED)
def test_a_guard_of_a_signed_signal_trips_on_both_sides_of_its_start_value(name, sign):
    signal, limit = TWO_SIDED[name]
    start = {"psi": 0.7, "z": 4.0, "phi": 0.0, "theta": 0.0}
    watch = Watch(TIGHT, at_rest(**start))
    inside, outside = ({**start, signal: start[signal] + share * sign * limit} for share in (0.99, 1.01))
    assert watch.check(at_rest(**inside)) == (name, pytest.approx(0.99))
    with pytest.raises(GuardTripped) as caught:
        watch.check(at_rest(**outside))
    assert caught.value.guard == name
    assert caught.value.value == pytest.approx(1.01 * limit)
    assert caught.value.limit == limit


@pytest.mark.parametrize(("north", "east"), [(25.0, 20.0), (-25.0, 20.0), (-25.0, -20.0), (25.0, -20.0)])
def test_distance_is_monitored_in_every_direction_and_measured_from_home(north, east):
    home = at_rest(x=100.0, y=-50.0)
    started_elsewhere = at_rest(x=110.0, y=-40.0, psi=1.0)
    watch = Watch(TIGHT, started_elsewhere, home)
    name, share = watch.check(at_rest(x=100.0 + 0.5 * north, y=-50.0 + 0.5 * east, psi=1.0))
    assert (name, share) == ("distance from start", pytest.approx(0.5 * math.hypot(25.0, 20.0) / 30.0))
    with pytest.raises(GuardTripped, match="distance from start"):
        watch.check(at_rest(x=100.0 + north, y=-50.0 + east, psi=1.0))


def test_all_limits_except_position_are_relative_to_the_start_of_the_manoeuvre():
    home = at_rest(t=-500.0, psi=-3.0, z=0.6)
    assert Watch(TIGHT, at_rest(), home).check(at_rest()) == ("least depth", pytest.approx(0.5))


@pytest.mark.parametrize(
    ("cruise", "speed", "distance"), [(0.0, 4.0, 300.0), (2.0, 4.0, 300.0), (4.0, 6.0, 400.0), (10.0, 15.0, 1000.0)]
)
def test_default_speed_and_distance_limits_grow_with_cruise_speed(cruise, speed, distance):
    default = Envelope(cruise=cruise)
    assert (default.speed_limit, default.distance_limit) == (speed, distance)
    explicit = Envelope(cruise=cruise, speed=1.5, distance=20.0)
    assert (explicit.speed_limit, explicit.distance_limit) == (1.5, 20.0)


@pytest.mark.parametrize(
    ("name", "signal", "limit"), [("battery voltage", "battery_voltage", 11.0), ("least depth", "z", 0.5)]
)
def test_a_lower_limit_trips_below_its_value(name, signal, limit):
    guard = next(g for g in GUARDS if g.name == name)
    for value, share in ((4.0 * limit, 0.25), (limit, 1.0), (0.999 * limit, math.inf), (0.0, math.inf)):
        assert guard.share(TIGHT, at_rest(), at_rest(**{signal: value})) == share


def test_a_limit_of_zero_trips_at_any_larger_value():
    with pytest.raises(GuardTripped, match="speed"):
        Watch(Envelope(speed=0.0), at_rest()).check(at_rest(speed=0.01))
    assert Watch(Envelope(speed=0.0), at_rest()).check(at_rest()) == ("", 0.0)


def test_a_tripped_guard_is_reported_in_everyday_units():
    with pytest.raises(GuardTripped, match=r"'roll' tripped: 34\.4 deg, limit 28\.6 deg"):
        Watch(TIGHT, at_rest()).check(at_rest(phi=-0.6))
    with pytest.raises(GuardTripped, match=r"'battery remaining' tripped: 19 %, limit 20 %"):
        Watch(TIGHT, at_rest()).check(at_rest(battery_remaining=0.19))
    with pytest.raises(GuardTripped, match=r"'turn rate' tripped: 31\.0 deg/s, limit 30\.0 deg/s"):
        Watch(TIGHT, at_rest()).check(at_rest(r=math.radians(31.0)))
    with pytest.raises(GuardTripped, match=r"'speed' tripped: 2\.10 m/s, limit 2\.00 m/s"):
        Watch(TIGHT, at_rest()).check(at_rest(speed=2.1))


def test_late_depth_and_position_are_measured_from_their_first_values():
    nan = math.nan
    watch = Watch(TIGHT, at_rest(x=nan, y=nan, z=nan))
    assert watch.check(at_rest(x=nan, y=nan, z=nan)) == ("", 0.0)
    assert watch.check(at_rest(x=100.0, y=50.0, z=4.0))[0] == "greatest depth"
    for sign in (1.0, -1.0):
        assert watch.check(at_rest(x=100.0, y=50.0, z=4.0 + 1.4 * sign)) == (
            "depth excursion",
            pytest.approx(1.4 / 1.5),
        )
        with pytest.raises(GuardTripped, match="depth excursion"):
            watch.check(at_rest(x=100.0, y=50.0, z=4.0 + 1.6 * sign))
    with pytest.raises(GuardTripped, match="distance from start"):
        watch.check(at_rest(x=100.0, y=81.0, z=4.0))


@pytest.mark.parametrize("guard", [g for g in GUARDS if g.name != "outside the area"], ids=lambda g: g.name)
def test_a_tripped_guard_names_its_command_line_option(guard):
    anchor = anchor_for(guard.name)
    with pytest.raises(GuardTripped) as tripped:
        Watch(TIGHT, anchor).check(replace(anchor, **BROKEN[guard.name]))
    assert f"(--{guard.option})" in str(tripped.value)
    assert guard.option in GUARDING
    parser = argparse.ArgumentParser()
    add_envelope(parser)
    row = limit_of(guard.option)
    other = row.greatest if row.default != row.greatest else row.least
    assert envelope_from(parser.parse_args([f"--{guard.option}", f"{other:g}"])) != envelope_from(parser.parse_args([]))
