"""When a relay switches, grows, widens and gives up: tick by tick, on scripts instead of a craft."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest

from gcs_autotune.craft import Actuate, Observation
from gcs_autotune.errors import UsageError
from gcs_autotune.manoeuvres import Relay, RelaySettings
from gcs_autotune.manoeuvres.relay import WallRelay
from gcs_autotune.trial import Mark

from .toy_craft import answered, at_rest

H = 0.05
"""The hysteresis, where one is set."""
Script = Callable[[float, Relay], float]


def flown(script: Script, **settings: Any) -> tuple[Relay, list[tuple[Observation, Actuate]], list[Mark]]:
    """Fly a relay on the heading, which is *script* (time [s], relay) -> [rad]; its noise is known to be none."""
    relay = Relay(RelaySettings("psi", "N", **{"noise_std": 0.0, **settings}))
    rows = answered(relay, lambda t, command: at_rest(t=t, psi=script(t, relay)))
    return relay, rows, list(relay.take_marks())


def details(marks: list[Mark], kind: str, name: str) -> list[tuple[float, float]]:
    return [(m.t, m.detail[name]) for m in marks if m.kind == kind]  # type: ignore[misc]


def reason(relay: Relay) -> str:
    assert relay.outcome is not None
    return f"{relay.outcome.ending}: {relay.outcome.reason}"


def test_the_relay_switches_beyond_the_hysteresis_on_either_side_of_its_reference() -> None:
    away = [0.0, 0.049, 0.05, -0.049, -0.05, 0.0, 0.051, 0.0]
    relay, rows, marks = flown(lambda t, _: 1.0 + away[min(int(2.0 * t), 7)], output=0.4, hysteresis=H)
    assert [command.N for _, command in rows[:8]] == [0.4, 0.4, -0.4, -0.4, 0.4, 0.4, -0.4, -0.4]
    assert details(marks, "switch", "N")[:4] == [(0.0, 0.4), (1.0, -0.4), (2.0, 0.4), (3.0, -0.4)]
    assert [x for _, x in details(marks, "switch", "x")[:4]] == pytest.approx([0.0, 0.05, -0.05, 0.051])
    assert relay.meta_fields == {
        "dof": "yaw", "signal": "psi", "force": "N", "C": 0.4, "x_a": H, "reference": 1.0, "throttle": 0.0,
        "noise_std": 0.0, "speed": pytest.approx(0.0), "from_t": 0.0, "enough": False,
    }  # fmt: skip


@pytest.mark.parametrize(("noise", "degrees"), [(0.0, 10.0), (math.radians(1.9), 10.0), (math.radians(3.0), 15.0)])
def test_the_default_hysteresis_is_ten_degrees_or_five_times_the_noise(noise: float, degrees: float) -> None:
    relay = Relay(RelaySettings("psi", "N", noise_std=noise))
    next(relay.commands(at_rest()))
    assert math.degrees(relay.meta_fields["x_a"]) == pytest.approx(degrees)
    explicit = Relay(RelaySettings("psi", "N", noise_std=noise, hysteresis=0.01))
    next(explicit.commands(at_rest()))
    assert explicit.meta_fields["x_a"] == 0.01


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_without_oscillation_the_output_grows_by_half_up_to_90_percent(side: float) -> None:
    first = 0.0 if side > 0.0 else 0.5
    relay, rows, marks = flown(lambda t, _: 0.0 if side > 0.0 or t == 0.0 else H, hysteresis=H)
    grown = details(marks, "grow", "C")
    assert [t - first for t, _ in grown] == [30.5, 61.0, 91.5]
    assert [C for _, C in grown] == pytest.approx([0.45, 0.675, 0.9])
    assert [N for _, N in details(marks, "switch", "N")][-3:] == pytest.approx([side * C for C in (0.45, 0.675, 0.9)])
    assert rows[-1][0].t == first + 122.0
    assert reason(relay).startswith("aborted: no oscillation at relay output 0.90")
    explicit, rows, marks = flown(lambda t, _: 0.0, output=0.5)
    assert (rows[-1][0].t, details(marks, "grow", "C")) == (30.5, [])
    assert reason(explicit).startswith("aborted: no oscillation at relay output 0.50")
    started = flown(lambda t, _: 0.0, first_output=0.8, growth=1.01, most_output=0.805)[2]
    assert [C for _, C in details(started, "grow", "C")] == [0.805]


def test_the_output_grows_for_each_hysteresis_of_motion_in_the_wrong_direction() -> None:
    falls = {0.0: 0.0, 2.0: -2.0, 4.0: -2.01, 6.0: -3.0, 8.0: -3.01, 10.0: -4.01, 12.0: -5.01}
    relay, rows, marks = flown(lambda t, _: H * next(v for k, v in reversed(falls.items()) if t >= k), hysteresis=H)
    assert [t for t, _ in details(marks, "grow", "C")] == [4.0, 8.0, 10.0]
    assert rows[-1][0].t == 12.0
    assert "0.90 of full N output turned the craft the wrong way" in reason(relay)
    explicit, rows, _ = flown(lambda t, _: -2.01 * H * (t >= 2.0), hysteresis=H, output=0.3)
    assert (rows[-1][0].t, "the wrong way" in reason(explicit)) == (2.0, True)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("first", "seconds"), [(1.0, 5.0), (3.0, 9.0)])
def test_a_craft_drifting_against_the_relay_longer_than_momentum_explains_is_overwhelmed(
    side: float, first: float, seconds: float
) -> None:
    """The first half lasts *first*. If the craft drifts to port, the second half does not end."""
    turn = first if side > 0.0 else first + 1.0

    def script(t: float, relay: Relay) -> float:
        if t < first:
            return 0.0
        return side * (H + 0.01 * (t - turn)) if t >= turn else H

    relay, rows, _ = flown(script, hysteresis=H, output=0.3)
    assert rows[-1][0].t == turn + seconds + 0.5
    assert "disturbance seems stronger than 0.30 of full N output: psi keeps drifting" in reason(relay)


def test_a_craft_that_returns_late_is_not_overwhelmed() -> None:
    def script(t: float, relay: Relay) -> float:
        return 0.0 if t < 1.0 else max(3.0 * H - 0.001 * (t - 1.0), 0.06)

    relay, rows, _ = flown(script, hysteresis=H, output=0.3, patience=60.0)
    assert rows[-1][0].t == 61.5
    assert "no oscillation" in reason(relay)


def periods(ticks: int, peaks: tuple[float, ...], crossed: float = 1.02) -> Script:
    """Half periods of so many ticks, one of *peaks* [hystereses] in each, after a tick where it has just switched."""

    def script(t: float, relay: Relay) -> float:
        half, tick = divmod(round(2.0 * t) - 1, ticks)
        size = crossed if tick == 0 or len(peaks) == 0 else peaks[half % len(peaks)]
        return size * relay.meta_fields["x_a"] * (-1.0) ** half if t > 0.0 else 0.0

    return script


def switchings(marks: list[Mark]) -> list[float]:
    return [t for t, x in details([m for m in marks if "x" in m.detail], "switch", "x") if x != 0.0]


def test_five_periods_within_ten_percent_are_settled() -> None:
    relay, rows, marks = flown(periods(4, (1.5,)), hysteresis=H)
    assert reason(relay) == "completed: 5 periods within 10 %"
    assert len(switchings(marks)) == 11
    assert rows[-1][0].t == switchings(marks)[-1]
    fewer = flown(periods(4, (1.5,)), hysteresis=H, periods=3)[2]
    assert len(switchings(fewer)) == 7
    rough = flown(periods(4, (1.5, 1.5, 1.7, 1.7)), hysteresis=H)
    assert reason(rough[0]) == "completed: 5 periods within 10 %"
    assert reason(flown(periods(4, (1.5, 1.5, 1.7, 1.7)), hysteresis=H, tolerance=0.04)[0]).startswith("aborted")


ROUGH = (1.5, 1.5, 2.5, 2.5, 3.5, 3.5)


def test_an_unsettled_relay_is_widened_twice_then_aborted_and_a_user_hysteresis_is_kept() -> None:
    relay, _, marks = flown(periods(4, ROUGH), least_hysteresis=H)
    assert [x for _, x in details(marks, "widen", "x_a")] == pytest.approx([1.5 * H, 2.25 * H])
    at = [t for t, _ in details(marks, "widen", "x_a")]
    switched = switchings(marks)
    assert [sum(a < t <= b for t in switched) for a, b in ((0.0, at[0]), at, (at[1], math.inf))] == [20, 20, 60]
    assert reason(relay).startswith("aborted: the limit cycle did not settle in 30 periods: the last periods differ")
    explicit, _, marks = flown(periods(4, ROUGH), hysteresis=H)
    assert (details(marks, "widen", "x_a"), len(switchings(marks))) == ([], 60)
    assert reason(explicit).startswith("aborted: the limit cycle did not settle")


def test_two_improper_periods_raise_the_output_or_widen_the_hysteresis_near_the_tick_rate() -> None:
    slow, _, marks = flown(periods(6, ()), least_hysteresis=H)
    assert [C for _, C in details(marks, "grow", "C")] == pytest.approx([0.45, 0.675, 0.9])
    first = details(marks, "grow", "C")[0][0]
    assert sum(t <= first for t in switchings(marks)) == 6
    assert details(marks, "widen", "x_a") == []
    assert reason(slow).startswith("aborted: the oscillation did not fulfil")
    quick, _, marks = flown(periods(4, ()), least_hysteresis=H)
    assert [x for _, x in details(marks, "widen", "x_a")] == pytest.approx([1.5 * H, 2.25 * H])
    assert details(marks, "grow", "C") == []
    assert "within 5 control ticks of 0.50 s at relay output 0.30" in reason(quick)
    explicit, _, marks = flown(periods(4, ()), hysteresis=H)
    assert (details(marks, "widen", "x_a"), len(switchings(marks))) == ([], 6)
    assert "within 5 control ticks" in reason(explicit)


@pytest.mark.parametrize(("least", "factor"), [(4.4, 1.5), (8.0, 2.0), (40.0, 3.0)])
def test_a_relay_too_fast_for_the_link_is_widened_up_to_four_times(least: float, factor: float) -> None:
    relay, _, marks = flown(periods(4, (1.5,)), least_hysteresis=H, least_period=least)  # 4 s a period
    assert [x for _, x in details(marks, "widen", "x_a")] == pytest.approx([H * factor**k for k in (1, 2, 3, 4)])
    assert sum(t <= details(marks, "widen", "x_a")[0][0] for t in switchings(marks)) == 5
    assert f"it oscillates with a period of 4.00 s. Periods below {least:.2f} s" in reason(relay)
    explicit, _, marks = flown(periods(4, (1.5,)), hysteresis=H, least_period=least)
    assert details(marks, "widen", "x_a") == []
    assert "the link is too slow" in reason(explicit)
    assert reason(flown(periods(4, (1.5,)), hysteresis=H, least_period=4.0)[0]).startswith("completed")


class Rule:
    """A stop rule that has enough after so many reversals; it counts how often it began."""

    counted_to = math.nan

    def __init__(self, enough: float) -> None:
        self.enough, self.begun, self.updates = enough, 0, 0

    def begin(self) -> None:
        self.begun += 1

    def update(self, relay: Relay, reversals: int) -> str:
        self.updates += 1
        return "that will do" if reversals >= self.enough else ""


def test_a_stop_rule_is_evaluated_at_every_proper_tick_and_restarts_with_each_size() -> None:
    def by(rule: Rule, script: Script) -> tuple[Relay, list[tuple[Observation, Actuate]]]:
        relay = Relay(RelaySettings("psi", "N", noise_std=0.0, least_hysteresis=H), criterion=rule)
        return relay, answered(relay, lambda t, command: at_rest(t=t, psi=script(t, relay)))

    rule = Rule(4.0)
    relay, rows = by(rule, periods(4, (1.5,)))
    assert reason(relay) == "completed: that will do"
    assert (rule.begun, rule.updates) == (1, len(rows))
    never = Rule(math.inf)
    relay, rows = by(never, periods(6, ()))
    assert never.begun == 4  # the first and three that are larger
    assert never.updates < len(rows)


@pytest.mark.parametrize(("signal", "speed", "force"), [("x", "u", "X"), ("y", "v", "Y")])
def test_along_an_axis_excess_speed_is_integrated_and_unknown_speeds_are_skipped(
    signal: str, speed: str, force: str
) -> None:
    relay = Relay(RelaySettings(signal, force, hysteresis=0.5, noise_std=0.0, reference_speed=0.8))
    speeds = [9.0, 1.2, 1.2, math.nan, 1.3, 0.2, 0.2, 0.2]  # the first is before it began
    rows = answered(relay, lambda t, c: at_rest(t=t, **{speed: speeds[int(2.0 * t)]}), most=3.5)
    # beyond 0.8 m/s, times 0.5 s: 0.2, 0.4, 0.4, 0.65, 0.35, 0.05, -0.25
    assert [getattr(command, force) > 0.0 for _, command in rows] == [True, True, True, True, *[False] * 4]
    seen = relay.progress(at_rest(**{speed: 0.7}))
    assert (seen.value, seen.target) == (0.7, 0.8)


def test_progress_shows_periods_and_scatter() -> None:
    relay = Relay(RelaySettings("psi", "N", hysteresis=H, noise_std=0.0, periods=4))
    commands = relay.commands(at_rest(psi=1.0))
    assert relay.progress(at_rest()).manoeuvre == "approach"
    next(commands)
    script = periods(4, (1.5,))
    for k in range(1, 22):
        commands.send(at_rest(t=0.5 * k, psi=1.0 + script(0.5 * k, relay)))
    seen = relay.progress(at_rest(psi=0.7))
    assert (seen.manoeuvre, seen.value, seen.target) == ("relay", 0.7, 1.0)
    assert (seen.periods, seen.periods_needed) == (2, 4)
    assert seen.amplitude == pytest.approx(1.5 * H)
    assert seen.scatter == pytest.approx(0.0, abs=1e-9)


def test_a_wall_relay_starts_ahead_and_ends_when_too_near_or_blind() -> None:
    def before(distances: list[float]) -> tuple[WallRelay, list[tuple[Observation, Actuate]]]:
        relay = WallRelay(RelaySettings("d", "X", output=0.3, hysteresis=0.5, noise_std=0.0, least_distance=1.0))
        most = 0.5 * (len(distances) - 1)
        return relay, answered(relay, lambda t, c: at_rest(t=t, d=distances[int(2.0 * t)]), most=most)

    relay, rows = before([3.0, 2.6, 2.5, 2.9, 3.5, 1.0])
    assert [command.X for _, command in rows] == [0.3, 0.3, -0.3, -0.3, 0.3, -0.3]
    assert relay.outcome is None
    near, rows = before([3.0, 0.99, 3.0])
    assert (rows[-1][0].t, rows[-1][1]) == (0.5, Actuate())
    assert "the wall ahead is 0.99 m away, nearer than 1 m" in reason(near)
    assert "stopped reporting the distance" in reason(before([3.0, math.nan, 3.0])[0])


@pytest.mark.parametrize("known", [True, False])
def test_a_boat_goes_straight_ahead_until_the_noise_is_known(known: bool) -> None:
    relay = Relay(RelaySettings("psi", "N", throttle=0.4, noise_std=0.01 if known else None))
    commands = relay.commands(at_rest(speed=1.0))
    sent = [next(commands), *(commands.send(at_rest(t=0.5 * k, speed=1.0)) for k in range(1, 12))]
    assert {command.X for command in sent} == {0.4}  # type: ignore[union-attr]
    swings = [command.N != 0.0 for command in sent]  # type: ignore[union-attr]
    assert swings[0] is known
    assert swings.index(True) == (0 if known else 7)
    assert relay.meta_fields["from_t"] == (0.0 if known else 3.5)


def test_other_axes_of_an_rov_are_held_and_its_depth_until_a_depth_relay_begins() -> None:
    yaw = Relay(RelaySettings("psi", "N", keep_still=True, noise_std=0.0))
    commands = yaw.commands(at_rest(z=2.0))
    next(commands)
    assert commands.send(at_rest(t=0.5, z=2.5)).Z < -0.1  # type: ignore[union-attr]
    depth = Relay(RelaySettings("z", "Z", keep_still=True, least_hysteresis=1.0))
    commands = depth.commands(at_rest(z=2.0, psi=1.0))
    next(commands)
    held = commands.send(at_rest(t=0.5, z=2.5, psi=1.3))
    assert held.Z < -0.1 and held.N < -0.1  # type: ignore[union-attr]
    free = Relay(RelaySettings("z", "Z", least_hysteresis=1.0))
    commands = free.commands(at_rest(z=2.0, psi=1.0))
    next(commands)
    assert commands.send(at_rest(t=0.5, z=2.5, psi=1.3)) == Actuate()


@pytest.mark.parametrize("name", ["output", "first_output", "most_output"])
@pytest.mark.parametrize(("value", "good"), [(1.0, True), (0.01, True), (0.0, False), (1.01, False), (math.nan, False)])
def test_an_output_must_be_a_positive_fraction_of_full(name: str, value: float, good: bool) -> None:
    if good:
        assert getattr(RelaySettings("psi", "N", **{name: value}), name) == value
        return
    with pytest.raises(UsageError, match=f"relay: {name} is") as beside:
        RelaySettings("psi", "N", throttle=0.5, **{name: value})
    assert "with a throttle of 0.5" in str(beside.value)
    with pytest.raises(UsageError) as alone:
        RelaySettings("psi", "N", **{name: value})
    assert "beside" not in str(alone.value)


@pytest.mark.parametrize("name", ["hysteresis", "least_hysteresis"])
@pytest.mark.parametrize("value", [0.0, -0.1, math.inf, math.nan])
def test_switching_values_must_be_positive_and_finite(name: str, value: float) -> None:
    with pytest.raises(UsageError, match=f"relay: {name} is"):
        RelaySettings("psi", "N", **{name: value})


@pytest.mark.parametrize(
    ("numbers", "good"),
    [
        ({"throttle": 1.0}, True),
        ({"throttle": -1.0}, True),
        ({"throttle": 1.01}, False),
        ({"throttle": -1.01}, False),
        ({"throttle": math.nan}, False),
        ({"reference_speed": -3.0}, True),
        ({"reference_speed": math.inf}, False),
        ({"reference_speed": math.nan, "throttle": 0.5}, False),
    ],
)
def test_throttle_and_speed_must_be_within_their_ranges(numbers: dict[str, float], good: bool) -> None:
    if good:
        RelaySettings("psi", "N", **numbers)  # type: ignore[arg-type]
        return
    with pytest.raises(UsageError, match="is out of range"):
        RelaySettings("psi", "N", **numbers)  # type: ignore[arg-type]
