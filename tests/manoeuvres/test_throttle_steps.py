"""Throttle steps: every level is flown until the speed is steady, the course is kept, the speed must be told."""

from __future__ import annotations

import itertools
import math

from pytest import approx

from gcs_autotune.craft import Actuate, Observation
from gcs_autotune.manoeuvres import ThrottleSteps, ThrottleStepsSettings
from gcs_autotune.manoeuvres.hold_controller import HeadingHold


class Boat:
    """One boat on ten lines: speed with a time constant, rudder that turns in proportion to speed."""

    def __init__(self, time: float = 1.5, top: float = 2.0, bias: float = 0.02, bite: float = 0.5) -> None:
        self.time, self.top, self.bias, self.bite = time, top, bias, bite
        self.t = self.u = self.psi = 0.0

    def go(self, command: Actuate) -> Observation:
        for _ in range(10):
            self.u += 0.01 * (self.top * command.X - self.u) / self.time
            self.psi += 0.01 * (self.bite * self.u * command.N + self.bias)
        self.t += 0.1
        return Observation(t=self.t, psi=self.psi, u=self.u, speed=abs(self.u), output={"X": command.X, "N": command.N})


def fly(boat: Boat, manoeuvre: ThrottleSteps, blind: bool = False) -> list[Observation]:
    seen = [boat.go(Actuate())]
    commands = manoeuvre.commands(seen[0])
    command = next(commands)
    while manoeuvre.outcome is None and boat.t < 300.0:
        assert isinstance(command, Actuate)
        now = boat.go(command)
        seen.append(Observation(t=now.t, psi=now.psi, output=now.output) if blind else now)
        command = commands.send(seen[-1])
    return seen


def test_the_levels_are_flown_in_order_each_until_the_speed_is_steady() -> None:
    boat = Boat()
    manoeuvre = ThrottleSteps(ThrottleStepsSettings(0.6, (0.5, 1.5, 0.0, 1.0)))
    fly(boat, manoeuvre)
    assert manoeuvre.outcome is not None
    assert manoeuvre.outcome.ending == "completed"
    marks = list(manoeuvre.take_marks())
    assert [round(m.detail["X"], 3) for m in marks if m.kind == "level"] == [0.3, 0.9, 0.0, 0.6]
    for mark in (m for m in marks if m.kind == "steady"):
        assert abs(mark.detail["u"] - 2.0 * mark.detail["X"]) < 0.1
    times = [m.t for m in marks if m.kind == "level"]
    low, burst, coast = (b - a for a, b in itertools.pairwise(times))
    assert 4.0 <= low <= 12.2
    assert 4.0 <= burst <= 12.2
    assert coast < 4.0


def test_a_boat_that_coasts_is_not_steered_for_thrusters_that_steer_push() -> None:
    seen = fly(Boat(time=4.0), ThrottleSteps(ThrottleStepsSettings(0.6, (1.5, 0.0, 1.0))))
    coasting = [o for o in seen if o.t > 1.0 and o.output["X"] == 0.0]
    driven = [o for o in seen if o.t > 1.0 and o.output["X"] > 0.0]
    assert len(coasting) > 20
    assert {o.output["N"] for o in coasting} == {0.0}
    assert max(abs(o.output["N"]) for o in driven) > 0.01


def test_coasting_ends_before_the_boat_has_stopped_and_throttle_never_exceeds_full() -> None:
    boat = Boat(time=4.0)
    seen = fly(boat, ThrottleSteps(ThrottleStepsSettings(0.8, (1.5, 0.0, 1.0))))
    assert max(o.output["X"] for o in seen) == 1.0
    coasting = [o for o in seen if o.output["X"] == 0.0 and o.t > 10.0]
    assert min(o.u for o in coasting) > 0.2 * 0.8 * 2.0


def test_the_course_is_kept_against_a_bias_and_the_hand_calms_down_where_it_swings() -> None:
    boat = Boat()
    seen = fly(boat, ThrottleSteps(ThrottleStepsSettings(0.6)))
    assert max(abs(o.psi) for o in seen) < math.radians(25.0)
    hand, wild = HeadingHold(), Boat(top=2.0, bias=0.0, bite=60.0)
    start = wild.go(Actuate(X=0.5))
    hand.start(start)
    wild.psi = math.radians(20.0)
    swings = []
    now = wild.go(Actuate(X=0.5))
    for _ in range(400):
        now = wild.go(Actuate(X=0.5, N=hand.steer(now)))
        swings.append(abs(now.psi))
    assert max(swings[-50:]) < max(swings[:50])


def test_a_boat_that_does_not_tell_its_speed_or_hardly_moves_is_given_up_with_the_cure() -> None:
    silent = ThrottleSteps(ThrottleStepsSettings(0.6))
    fly(Boat(), silent, blind=True)
    assert silent.outcome is not None
    assert silent.outcome.ending == "aborted"
    assert "position fix" in silent.outcome.reason
    weak = ThrottleSteps(ThrottleStepsSettings(0.1))
    fly(Boat(top=0.5), weak)
    assert weak.outcome is not None
    assert weak.outcome.ending == "aborted"
    assert "--throttle" in weak.outcome.reason


def test_where_the_steady_approach_tells_enough_no_level_is_flown() -> None:
    told: list[tuple[float, float]] = []

    def enough(heading: float, speed: float) -> str:
        told.append((heading, speed))
        return "as quick as on the way out"

    short, whole = (ThrottleSteps(ThrottleStepsSettings(0.6), "throttle-2", say) for say in (enough, lambda *_: ""))
    boat = Boat()
    fly(boat, short)
    assert short.outcome is not None
    assert (short.outcome.ending, short.outcome.reason) == ("completed", "as quick as on the way out")
    marks = list(short.take_marks())
    assert [m.kind for m in marks] == ["steady"]
    assert marks[0].detail["level"] == 0.6
    assert told == [(boat.psi, marks[0].detail["u"])]
    assert marks[0].detail["u"] == approx(1.2, abs=0.05)
    fly(Boat(), whole)
    assert [m.kind for m in whole.take_marks()].count("level") == 4
