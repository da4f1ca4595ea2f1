"""Announced before "Go ahead?": time, space and battery; during the run: the step and the time left."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest

from gcs_autotune.craft import Observation
from gcs_autotune.manoeuvres import Envelope
from gcs_autotune.observer import Progress
from gcs_autotune.report.toolkit.live import describe_progress
from gcs_autotune.workflow import Connection, TuneSettings
from gcs_autotune.workflow.announcement import battery, how_long, in_modes, room
from gcs_autotune.workflow.excursion import Excursion
from gcs_autotune.workflow.itinerary import Itinerary, legs_of_experiment, legs_of_tune, pace_of

RUDDER, THRUSTERS = (pace_of("rudder"), pace_of("thrusters"))
ROV = pace_of("rov")
TURN = RUDDER.turn


def settings(axis: str = "heading", **given: object) -> TuneSettings:
    return TuneSettings(Connection("sitl:charlie"), Path("runs/none"), axis=axis, **given)


def heading(**given: object) -> Itinerary:
    given = {"stop_rule": "settled", **given}
    legs = legs_of_tune(settings(**given), "yaw", RUDDER, moving=False, given=False, dives=False)
    return Itinerary(legs, TURN)


def at(itinerary: Itinerary, t: float, stage: str) -> Progress:
    return itinerary.at(Progress(stage, stage, t))


@pytest.mark.parametrize(
    ("modes", "brief", "text"),
    [
        (["MANUAL"], "mode MANUAL, as now", "stay in mode MANUAL"),
        (["ALT_HOLD"], "mode ALT_HOLD; at the end MANUAL", "use mode ALT_HOLD, and return to MANUAL at the end"),
        (
            ["ALT_HOLD", "MANUAL"],
            "modes ALT_HOLD and MANUAL; at the end MANUAL",
            "use modes ALT_HOLD and MANUAL, and return to MANUAL at the end",
        ),
    ],
)
def test_the_modes_are_announced_with_the_final_one(modes, brief, text):
    intention = in_modes(modes, "MANUAL", "at the end")
    assert (intention.brief, intention.text) == (brief, text)


def test_the_stages_of_a_tune_are_announced_with_their_times():
    itinerary = heading(step_duration=10.0)
    assert [leg.stage for leg in itinerary.legs] == [
        "sign check",
        "step with present gains",
        "first self-oscillation",
        "second self-oscillation",
        "step with new gains",
    ]
    assert itinerary.legs[1].seconds == pytest.approx(30.0)
    assert sum(leg.before for leg in itinerary.legs) == 3 * TURN
    reported = how_long(itinerary).text
    assert reported.startswith(
        "take about 7 min 20 s of the vehicle's time: sign check 40 s, step with present gains 30 s"
    )
    assert "turning around 3 times 32 s" in reported


def test_the_longest_time_of_a_restless_craft_is_announced_with_the_usual_time():
    """ArduSub's stock ROV hunts in its thrusters' dead band: announced 2 min, took 5 min 30 s."""
    usual, patient = (
        Itinerary(legs_of_tune(settings("depth", **how), "heave", p, moving=False, given=False, dives=True))
        for how, p in (({}, ROV), ({"stop_rule": "settled"}, pace_of("rov", restless=True)))
    )
    assert how_long(usual, patient).text.startswith("take about 1 min 50 s of the vehicle's time, up to 7 min if ")
    assert "up to" not in how_long(patient, patient).text


@pytest.mark.parametrize(("axis", "dof"), [("speed", "surge"), ("heading", "yaw")])
def test_the_announced_times_add_up_and_every_possible_stage_is_listed(axis: str, dof: str) -> None:
    usual, patient = (
        Itinerary(legs_of_tune(settings(axis, **how), dof, RUDDER, moving=axis == "speed", given=False, dives=False))
        for how in ({}, {"stop_rule": "settled"})
    )
    text = how_long(usual, patient).text
    total, listed = text.partition(" of the vehicle's time")[0], text.partition(": ")[2].partition(". If")[0]
    minutes, seconds = (int(n) for n in re.findall(r"\d+", total))
    stages = [int(n) for n in re.findall(r"(\d+) s\b", listed)]
    assert 0 <= 60 * minutes + seconds - sum(stages) < 10
    second = next(leg.stage for leg in patient.legs if leg.stage.startswith("second"))
    assert f"If these do not suffice, it also flies {second} " in text


def test_a_dry_run_a_supplied_model_a_dive_and_an_rov_change_the_stages():
    legs = legs_of_tune(settings("depth", dry_run=True), "heave", ROV, moving=False, given=True, dives=True)
    assert [leg.stage for leg in legs] == ["sign check", "diving", "step with present gains"]
    assert all(leg.before == 0.0 for leg in legs)


def test_a_velocity_step_follows_its_experiments():
    legs = legs_of_tune(settings("speed"), "surge", THRUSTERS, moving=True, given=False, dives=False)
    assert [leg.stage for leg in legs] == [
        "sign check",
        "first throttle steps",
        "step with present gains",
        "step with new gains",
    ]


def test_self_ending_steps_and_oscillations_take_less_time():
    boat, rov = (
        Itinerary(legs_of_tune(settings(), "yaw", pace, moving=False, given=False, dives=False), TURN)
        for boat, pace in ((True, RUDDER), (False, ROV))
    )
    assert [leg.stage for leg in boat.legs if "oscillation" in leg.stage] == ["first self-oscillation"]
    assert len([leg for leg in rov.legs if "oscillation" in leg.stage]) == 2
    assert all(leg.before == 0.0 for leg in boat.legs)
    assert max(boat.seconds, rov.seconds) < 0.5 * heading().seconds
    at(boat, 0.0, "sign check")
    at(boat, 25.0, "step with present gains")
    seen = at(boat, 65.0, "turning around")
    assert seen.left == pytest.approx(TURN + boat.legs[2].seconds + boat.legs[3].seconds)


def test_a_turn_rate_step_accompanies_each_heading_step():
    legs = legs_of_tune(settings(), "yaw", RUDDER, moving=False, given=False, dives=False, beside=True)
    assert [leg.stage for leg in legs][-3:] == [
        "turn rate with present gains",
        "step with new gains",
        "turn rate with new gains",
    ]
    dry = legs_of_tune(settings(dry_run=True), "yaw", RUDDER, moving=False, given=False, dives=False, beside=True)
    assert not [leg for leg in dry if leg.stage.startswith("turn rate")]


def test_time_counts_from_the_start_and_not_from_the_autopilots_boot():
    itinerary = heading()
    assert at(itinerary, 3130.0, "sign check").elapsed == 0.0
    seen = at(itinerary, 3140.0, "sign check")
    assert (seen.step, seen.steps, seen.elapsed) == (1, 5, 10.0)
    assert seen.left == pytest.approx(itinerary.seconds - 10.0)
    assert "3140" not in describe_progress(seen)
    assert "52 min" not in describe_progress(seen)


def test_turning_around_belongs_to_the_following_step():
    itinerary = heading()
    at(itinerary, 0.0, "sign check")
    at(itinerary, 25.0, "step with present gains")
    assert at(itinerary, 95.0, "turning around").step == 3
    assert at(itinerary, 110.0, "turning around").step == 3
    assert at(itinerary, 127.0, "first self-oscillation").step == 3
    assert at(itinerary, 240.0, "turning around").step == 4


def test_the_duration_of_the_first_oscillation_predicts_the_second():
    itinerary = heading()
    at(itinerary, 0.0, "sign check")
    at(itinerary, 25.0, "step with present gains")
    at(itinerary, 95.0, "turning around")
    at(itinerary, 127.0, "first self-oscillation")
    seen = at(itinerary, 527.0, "turning around")
    assert itinerary.legs[3].seconds == pytest.approx(400.0)
    assert seen.left == pytest.approx(400.0 + TURN + itinerary.legs[4].total)


def test_an_unplanned_third_oscillation_adds_a_step():
    itinerary = heading()
    for t, stage in ((0.0, "sign check"), (30.0, "step with present gains"), (100.0, "first self-oscillation")):
        at(itinerary, t, stage)
    at(itinerary, 200.0, "second self-oscillation")
    at(itinerary, 300.0, "turning around")
    seen = at(itinerary, 330.0, "third self-oscillation")
    assert (seen.step, seen.steps) == (5, 6)
    at(itinerary, 430.0, "turning around")
    seen = at(itinerary, 460.0, "step with new gains")
    assert (seen.step, seen.steps) == (6, 6)
    assert 0.0 < seen.left <= itinerary.legs[5].total


def test_the_time_left_is_never_negative():
    itinerary = Itinerary(legs_of_experiment("yaw", ROV, dives=False))
    at(itinerary, 0.0, "sign check")
    at(itinerary, 20.0, "first self-oscillation")
    at(itinerary, 120.0, "second self-oscillation")
    assert at(itinerary, 9999.0, "second self-oscillation").left == 0.0


def test_the_progress_line_contains_step_bar_times_and_signal_in_80_columns():
    line = describe_progress(
        Progress(
            "first self-oscillation",
            "relay",
            3130.0,
            signal="psi",
            value=math.radians(260.1),
            target=math.radians(260.1),
            output=0.3,
            step=3,
            steps=5,
            elapsed=130.0,
            left=280.0,
        ),
        79,
    )
    assert line == "step 3 of 5 #....  relay 2 min 10 s, 5 min left  heading 260.1° (target 260.1°)"
    assert len(line) <= 79


def test_the_announced_space_depends_on_the_craft():
    here = Observation(0.0, 0.0, z=0.2)
    whole, deep = Excursion(200.0, 182.0), Observation(0.0, 0.0, z=10.0)
    assert room("yaw", 1.2, settings(stop_rule="settled"), here, whole).text.startswith(
        "need up to 220 m from the start. It turns around before each stage. A smaller"
    )
    assert room("yaw", 1.2, settings(), here, whole).text.startswith(
        "need up to 228 m from the start (usually about 220 m). Between stages it turns around if it is more"
    )
    small = settings(envelope=Envelope(distance=150.0))
    assert room("yaw", 1.2, small, here, whole).text.startswith("need up to 150 m from the start. Between stages")
    near = room("surge", 1.5, settings("speed"), here, Excursion(100.0, 90.0, usual=Excursion(80.0, 37.0))).text
    assert near == "need up to 110 m from the start (usually about 45 m). A smaller --max-distance reduces this"
    assert room("yaw", 0.0, settings(), here, whole).text == "need about 2 m of free water around the vehicle"
    assert (
        room("heave", 0.0, settings("depth"), here, whole).text
        == "need about 2 m of free water around the vehicle, and 4 m of depth"
    )
    assert room("heave", 0.0, settings("depth", step=-3.0), deep, whole).text.endswith("and 14 m of depth")
    assert room("heave", 0.0, settings("depth"), Observation(0.0, 0.0), whole).text.endswith("and 4 m of depth")


def test_the_battery_is_announced_as_far_as_known_with_the_assumptions():
    known = battery(Observation(0.0, 0.0, battery_remaining=0.87, battery_voltage=15.9), Envelope(), 540.0).text
    assert "87 % now, limit 10 %" in known and "15.9 V now" in known
    assert "about 15 % of a battery that lasts an hour" in known and "assumed" in known
    unknown = battery(Observation(0.0, 0.0), Envelope(), 540.0).text
    assert "not monitored" in unknown


def test_the_announced_battery_covers_the_longest_run():
    reported = battery(Observation(0.0, 0.0, battery_remaining=0.87), Envelope(), 120.0, 540.0)
    assert reported.text.startswith("use about 5 %, up to 15 % of a battery") and "((" not in reported.text
    assert reported.text.count("(") == 0
    assert reported.brief == "5 to 15 % of a one-hour battery (87 % now, limit 10 %)"
