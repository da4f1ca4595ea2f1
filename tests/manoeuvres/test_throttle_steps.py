"""Throttle steps: every level is flown until the speed is steady, the course is kept, a speed is required."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import pytest
from pytest import approx

from gcs_autotune.craft import Actuate, Observation
from gcs_autotune.manoeuvres import ThrottleSteps, ThrottleStepsSettings
from gcs_autotune.manoeuvres.hold_controller import HeadingHold
from gcs_autotune.trial import Mark

from .toy_craft import answered, at_rest


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


def test_a_coasting_boat_is_not_steered_because_steering_thrusters_push() -> None:
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


def test_the_course_is_kept_against_a_bias_and_the_gain_falls_on_oscillation() -> None:
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


def test_a_missing_or_too_low_speed_aborts_with_a_remedy() -> None:
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


@pytest.mark.parametrize("time", [0.5, 1.5, 2.5])
def test_a_short_level_lasts_about_three_time_constants_on_any_boat(time: float) -> None:
    boat = Boat(time=time)
    manoeuvre = ThrottleSteps(ThrottleStepsSettings(0.6, (0.5, 1.5, 1.0), until_answered=True, most_time=30.0))
    fly(boat, manoeuvre)
    assert manoeuvre.outcome is not None
    assert manoeuvre.outcome.ending == "completed"
    times = [m.t for m in manoeuvre.take_marks() if m.kind == "level"]
    for low, high in itertools.pairwise([*times, boat.t]):
        assert max(4.0, 2.7 * time) - 0.1 <= high - low <= max(4.0, 3.3 * time) + 0.2


def scripted(u: Callable[[float, float], float], **changes: object) -> tuple[ThrottleSteps, list, list[Mark]]:
    """Fly levels of a boat whose speed is ``u(time [s], throttle)``; the record begins at 100 s."""
    manoeuvre = ThrottleSteps(ThrottleStepsSettings(**{"throttle": 0.5, "levels": (0.4, 3.0, 0.0, 1.0), **changes}))  # type: ignore[arg-type]

    def seen(t: float, command: Actuate) -> Observation:
        speed = u(t, command.X)
        return at_rest(t=100.0 + t, u=speed, speed=abs(speed), psi=0.3, output={"X": command.X})

    return manoeuvre, answered(manoeuvre, seen), list(manoeuvre.take_marks())


def test_a_steady_speed_is_marked_before_each_step_after_four_seconds() -> None:
    manoeuvre, rows, marks = scripted(lambda t, X: 1.0)
    assert [(m.t - 100.0, m.kind) for m in marks] == [
        (3.0 + 4.0 * k, kind) for k in range(5) for kind in ("steady", "level")
    ][:-1]
    assert [m.detail["X"] for m in marks if m.kind == "level"] == [0.2, 1.0, 0.0, 0.5]
    steady = [m.detail for m in marks if m.kind == "steady"]
    assert [d["level"] for d in steady] == [0.5, 0.2, 1.0, 0.0, 0.5]
    assert [d["X"] for d in steady[1:]] == [0.2, 1.0, 0.0, 0.5]
    assert {d["u"] for d in steady} == {1.0}
    assert rows[-1][0].t == 119.0
    assert manoeuvre.outcome is not None
    assert manoeuvre.outcome.reason == "4 throttle levels flown"
    fields = manoeuvre.meta_fields
    assert (fields["from_t"], fields["levels"], fields["throttle"]) == (101.0, [0.2, 1.0, 0.0, 0.5], 0.5)
    assert (fields["speed"], fields["reference"], fields["noise_std"]) == (1.0, 1.0, 0.0)
    assert manoeuvre.phase == "throttle 50 %"
    assert scripted(lambda t, X: 1.0, most=0.8)[0].meta_fields["levels"] == [0.2, 0.8, 0.0, 0.5]


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("slope", "seconds"), [(0.0113, 4.0), (0.0116, 12.0)])
def test_a_level_lasts_until_the_speed_changes_by_two_percent_of_the_working_speed_only(
    side: float, slope: float, seconds: float
) -> None:
    """Over the window the mean of its later half is 1.75 s times the slope away from that of the earlier."""
    _, _, marks = scripted(lambda t, X: 1.0 + side * slope * max(t - 3.0, 0.0))
    first, second = [m.t for m in marks if m.kind == "level"][:2]
    assert second - first == seconds
    noted = [m for m in marks if m.kind == "steady"][1:2]
    assert bool(noted and noted[0].t == second) is (seconds == 4.0)
    if seconds == 4.0:  # the mean over the later half of the window
        assert noted[0].detail["u"] == approx(1.0 + side * slope * (4.0 - 0.75))


@pytest.mark.parametrize(("slope", "seconds"), [(0.021, 4.0), (0.022, 12.0)])
def test_a_change_within_the_speed_noise_is_ignored(slope: float, seconds: float) -> None:
    """The approach alternates by 0.02 m/s: noise 0.0327 m/s, or 0.0377 m/s with three samples per half."""
    _, _, marks = scripted(lambda t, X: 1.0 + (0.02 * (-1.0) ** round(2.0 * t) if t <= 3.0 else slope * (t - 3.0)))
    first, second = [m.t for m in marks if m.kind == "level"][:2]
    assert second - first == seconds


@pytest.mark.parametrize(("share", "seconds"), [(0.351, 4.0), (0.35, 0.5)])
def test_coasting_ends_at_a_third_of_the_working_speed_and_is_not_a_steady_speed(share: float, seconds: float) -> None:
    _, _, marks = scripted(lambda t, X: 2.0 * (share if X == 0.0 else 1.0), levels=(0.0, 1.0))
    first, second = [m.t for m in marks if m.kind == "level"]
    assert second - first == seconds
    assert sum(m.kind == "steady" for m in marks) == (3 if seconds == 4.0 else 2)
    slow = scripted(lambda t, X: 2.0 if X == 0.5 else 0.1, levels=(0.4, 1.0))[2]
    assert [m.t for m in slow if m.kind == "level"] == [103.5, 107.5], "only what coasts has coasted"


@pytest.mark.parametrize(("speed", "ending"), [(0.201, "completed"), (0.199, "aborted"), (-1.0, "aborted")])
def test_a_boat_with_too_little_headway_is_aborted(speed: float, ending: str) -> None:
    manoeuvre, rows, marks = scripted(lambda t, X: speed)
    assert manoeuvre.outcome is not None
    assert manoeuvre.outcome.ending == ending
    assert bool(marks) is (ending == "completed")
    if ending == "aborted":
        assert rows[-1][0].t == (103.0 if speed > 0.0 else 130.0)


def test_the_wait_for_a_missing_speed_is_twelve_seconds() -> None:
    manoeuvre, rows, _ = scripted(lambda t, X: math.nan)
    assert manoeuvre.outcome is not None
    assert "reports no speed" in manoeuvre.outcome.reason
    assert rows[-1][0].t == 112.5
    late, _, marks = scripted(lambda t, X: math.nan if t < 11.0 else 1.0)
    assert late.outcome is not None
    assert late.outcome.ending == "completed"
    assert marks[0].t == 114.0


def test_a_briefly_missing_speed_is_ignored() -> None:
    _, rows, marks = scripted(lambda t, X: math.nan if 5.0 <= t < 6.0 else 1.0)
    assert [m.t for m in marks if m.kind == "level"][:2] == [103.0, 107.0]
    assert all(command.N == 0.0 for _, command in rows)


def test_levels_astern_brake_the_boat_and_are_not_steered() -> None:
    boat = Boat()
    manoeuvre = ThrottleSteps(ThrottleStepsSettings(0.6, (-0.8, 1.0, -0.4), most_speed=1.1))
    seen = fly(boat, manoeuvre)
    assert manoeuvre.outcome is not None
    assert manoeuvre.outcome.ending == "completed"
    orders = [(m.t, m.detail["X"]) for m in manoeuvre.take_marks() if m.kind == "level"]
    assert [round(float(x), 2) for _, x in orders] == [-0.48, 0.6, -0.24]
    assert all(now.output["N"] == 0.0 for now in seen if now.output["X"] < 0.0)
    assert min(now.u for now in seen) > -0.7, "a level astern ends when the boat goes astern"
    (begin, _), (end, _) = orders[1:]
    assert max(now.u for now in seen if begin <= now.t <= end) < 1.2, "a level ahead ends at the largest speed"
