"""What a whole run takes, on paper: the sign check, the approach, the way back and the coasting belong to it."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.manoeuvres import Envelope, NominalPlant, OpenLoopProgramme, PlantState, Preview, preview
from gcs_autotune.models import SingleDof
from gcs_autotune.workflow import CommonSettings, Connection, FlySettings
from gcs_autotune.workflow.announcement import exactly, whole_of
from gcs_autotune.workflow.excursion import (
    NO_LIMITS,
    Ahead,
    Excursion,
    VisitPreview,
    least_distance,
    overhead,
    worst_of,
)
from gcs_autotune.workflow.nominal_plant import AssumedCraft, assumed_crafts, assumed_plant, nominal_plant

BOAT = NominalPlant(
    SingleDof("yaw", "1", 5.0, 3.0), 1.0, "a test", others={"X": SingleDof("surge", "1", 6.0, 0.0, 1.0)}
)


def visit(craft: NominalPlant = BOAT, envelope: Envelope = NO_LIMITS) -> VisitPreview:
    return VisitPreview(craft, envelope, PlantState(), under_way=True)


def test_each_stage_starts_where_the_last_one_ended_and_coasting_counts():
    flown = visit()
    flown.fly(Ahead(1.0, 30.0), "first")
    flown.fly(Ahead(1.0, 30.0), "second")
    whole = flown.excursion()
    alone = preview(Ahead(1.0, 30.0), BOAT, NO_LIMITS).away
    assert whole.distance > 2.0 * alone + 5.0
    assert whole.seconds == pytest.approx(60.0 + overhead(2), abs=0.5)
    assert [name for name, _ in whole.stages] == ["first", "second"]
    assert whole.speed == pytest.approx(1.0, abs=0.05)


def test_a_preview_continues_from_the_state_another_left():
    def ahead(t: float) -> dict[str, float]:
        return {"X": 1.0}

    first = preview(OpenLoopProgramme("one", ahead, 20.0, force="X"), BOAT, NO_LIMITS)
    second = preview(OpenLoopProgramme("two", ahead, 20.0, force="X"), BOAT, NO_LIMITS, begins=first.ends)
    assert second.trial["x"].values[0] == pytest.approx(first.ends.x)
    assert second.trial["u"].values[0] == pytest.approx(first.ends.u)
    assert second.away > first.away + 15.0


def test_a_boat_that_would_leave_its_space_turns_around_in_the_preview():
    flown = visit(envelope=replace(NO_LIMITS, distance=60.0, cruise=1.0))
    flown.fly(Ahead(1.0, 40.0), "first")
    flown.turn_around(0.5, 30.0)
    flown.fly(Ahead(1.0, 30.0), "second")
    whole = flown.excursion()
    assert [name for name, _ in whole.stages] == ["first", "turning around", "second"]
    assert whole.distance < 60.0
    stays = visit(envelope=replace(NO_LIMITS, distance=300.0, cruise=1.0))
    stays.fly(Ahead(1.0, 40.0), "first")
    stays.turn_around(0.5, 30.0)
    assert len(stays.excursion().stages) == 1


def test_the_worst_of_several_assumed_crafts_counts():
    craft = [assumed_plant(FIRMWARE["ardurover"], {}, 0.5, 1.2, like) for like in assumed_crafts("rudder")]
    radii = [1.2 / one.yaw.steady_velocity(1.0) for one in craft]
    assert max(radii) == pytest.approx(6.7) and min(radii) == pytest.approx(3.0)
    worst = worst_of([Excursion(50.0, 20.0, turn_rate=0.2), Excursion(40.0, 35.0, turn_rate=0.5)])
    assert (worst.seconds, worst.distance, worst.turn_rate) == (50.0, 35.0, 0.5)
    assert worst.least["turn_rate"] == 0.2


def test_a_limit_below_the_requirement_is_refused_with_a_feasible_one():
    whole = worst_of([Excursion(80.0, 50.0, time=40.0, speed=1.0, turn_rate=r) for r in (0.2, 0.4)])
    assert whole.needs == 60.0
    assert not whole.beyond(Envelope(), "zig-zag")
    assert not whole.beyond(Envelope(distance=60.0), "zig-zag")
    refused = whole.beyond(Envelope(distance=59.0), "zig-zag")
    assert refused.startswith(
        "not started: zig-zag needs 60 m, but the limit --max-distance is 59 m. Nothing was armed."
    )
    assert "--max-time 48" in whole.beyond(Envelope(time=30.0), "zig-zag")
    assert "--max-speed 1.2" in whole.beyond(Envelope(speed=0.5), "zig-zag")
    assert not whole.beyond(Envelope(turn_rate=0.3), "zig-zag"), "a craft that turns slowly keeps it"
    assert "--max-turn-rate 14" in whole.beyond(Envelope(turn_rate=0.1), "zig-zag")


def test_the_smallest_feasible_distance_is_found_by_search():
    assert least_distance(lambda metres: metres < 83.0, 300.0) == pytest.approx(85.0, abs=5.0)
    assert math.isnan(least_distance(lambda metres: True, 300.0))


def test_the_announcement_contains_distance_time_and_stages():
    whole = Excursion(130.0, 75.0, (("sign check", 40.0), ("zig-zag", 54.0)))
    reported = whole_of(whole, Envelope(), "a test").text
    assert reported == (
        "need up to 90 m from the start, and up to 2 min 20 s: sign check 40 s, zig-zag 55 s; predicted from a test"
    )
    assert (
        "up to 80 m from the start (--max-distance ends the run there)" in whole_of(whole, Envelope(distance=80.0)).text
    )
    loop = replace(whole, usual=Excursion(60.0, 30.0))
    assert whole_of(loop, Envelope(), "a test").text == (
        "need up to 90 m from the start, and usually about 1 min 10 s, of a poorly damped loop up to 2 min 20 s "
        "(predicted from a test)"
    )
    assert [exactly(t) for t in (9.0, 60.0, 61.0, 119.0)] == ["10 s", "1 min", "1 min 10 s", "2 min"]
    assert [exactly(t) for t in (3.0, 31.0, 36.0, 56.0)] == ["5 s", "35 s", "40 s", "1 min"]


def test_a_short_distance_is_announced_in_whole_metres():
    assert [Excursion(60.0, d).needs for d in (3.0, 20.5, 27.0)] == [5.0, 25.0, 35.0]
    assert [Excursion(60.0, d, submerged=True).needs for d in (3.0, 20.5)] == [4.0, 23.0]


def pull_out(like: AssumedCraft) -> Preview:
    settings = FlySettings("pull-out", CommonSettings(Connection("memory"), Path("unused")))
    paper = nominal_plant(settings, FIRMWARE["ardusub"], {}, 0.0, 0.0, like)
    return preview(settings.make(0.0, keep_still=True), paper, NO_LIMITS, floats=False)


def test_an_rov_with_quadratic_drag_takes_long_to_stop_turning():
    usual, slow, quick = (pull_out(like).seconds for like in assumed_crafts("rov")[:3])
    assert quick < usual < slow
    assert slow > 1.3 * quick  # with drag by the speed alone 1.06


def test_a_fast_and_heavy_rov_coasts_furthest():
    far = []
    for like in assumed_crafts("rov")[:4]:
        craft = assumed_plant(FIRMWARE["ardusub"], {}, 0.0, 0.0, like)
        ahead = OpenLoopProgramme("ahead", lambda t: {"X": 1.0 if t < 8.0 else 0.0}, 30.0, force="X")
        far.append(preview(ahead, craft, NO_LIMITS, floats=False).away)
    assert far.index(max(far)) == 3
