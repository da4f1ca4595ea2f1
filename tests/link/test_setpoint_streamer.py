"""What is sent, how often and when no more: the streamer on a session that only writes down."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, cast

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_autotune.clock import ManualClock
from gcs_autotune.craft import Actuate, DepthTarget, HeadingTarget, TurnRateTarget
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.link import Session
from gcs_autotune.link.vehicle.setpoint_streamer import SendRate, SetpointStreamer, depth_target, turn_rate_target
from gcs_autotune.link.vehicle.vehicle_config import OverrideMap, RateStick, RcChannel, VehicleConfig

STICK = RcChannel(1000, 1500, 2000)
BOAT = OverrideMap({"N": (1, STICK), "X": (3, STICK)}, {5: 1400})
SUB = OverrideMap({"Z": (3, RcChannel(1100, 1500, 1900, sign=-1.0)), "N": (4, STICK)})


class Written:
    """As much of a session, of telemetry, of delays and of the shown channels as the streamer needs."""

    def __init__(self) -> None:
        self.clock = ManualClock(10.0)
        self.vehicle = SimpleNamespace(system=7, component=1)
        self.transport = SimpleNamespace(repeat_period=0.04)
        self.messages: list[Any] = []
        self.task = SimpleNamespace(period=0.04, postponed=0)
        self.task.postpone = lambda: setattr(self.task, "postponed", self.task.postponed + 1)
        self.tasks: list[tuple[float, Any]] = []
        self.listeners: dict[str, Any] = {}
        self.t, self.outputs, self.output_since, self.depth_offset, self.gain = 100.0, {"N": 0.1}, 99.0, 0.25, math.nan
        self.commands: list[Any] = []
        self.round_trip, self.forgotten = math.nan, 0
        self.sticks: list[tuple[dict[int, int], float]] = []
        self.shows: set[tuple[tuple[int, int], ...]] = set()
        self.shown: dict[int, int] = {}
        self.has_receiver = True
        self.never: list[float] = []

    def every(self, period: float, act: Any) -> Any:
        self.tasks.append((period, act))
        return self.task

    def listen(self, name: str, deliver: Any) -> None:
        self.listeners[name] = deliver

    def send(self, message: Any) -> None:
        self.messages.append(message)

    def wait_for(self, condition: Any, patience: float) -> Any:
        self.never.append(patience)
        return condition() or condition() or condition()

    def value(self, name: str) -> float:
        assert name == "pilot_gain"
        return self.gain

    def commanded(self, forces: Any, outputs: Any, seen: float) -> None:
        self.commands.append((dict(forces), dict(outputs), seen))

    def moved(self, t: float, outputs: Any) -> None:
        self.commands.append(("moved", t, dict(outputs)))

    def ask(self) -> None:
        pass

    def forget(self) -> None:
        self.forgotten += 1

    def sent(self, values: Any, slack: float) -> None:
        self.sticks.append((dict(values), slack))

    def show(self, values: Any) -> bool:
        return tuple(sorted(values.items())) in self.shows

    def kinds(self) -> list[str]:
        kinds = [m.get_type() for m in self.messages]
        self.messages.clear()
        return kinds


def streamer(
    written: Written, overrides: OverrideMap = BOAT, firmware: str = "ardurover", rate_stick: RateStick | None = None
) -> Any:
    session, own = cast(Session, written), cast(Any, written)
    config = VehicleConfig(overrides, cast(Any, None), 4.0, rate_stick=rate_stick)
    return SetpointStreamer(session, FIRMWARE[firmware], config, own, own, own)


OVERRIDE, ATTITUDE, POSITION = (
    "RC_CHANNELS_OVERRIDE",
    "SET_ATTITUDE_TARGET",
    "SET_POSITION_TARGET_GLOBAL_INT",
)


@pytest.fixture
def written() -> Written:
    return Written()


def test_a_command_is_sent_at_once_timed_and_kept_in_force(written: Written) -> None:
    own = streamer(written)
    own.command(Actuate(N=0.5, X=-0.2))
    assert written.commands == [({"N": 0.5, "X": -0.2}, {"N": 0.1}, 100.0)]
    (message,) = written.messages
    assert (message.chan1_raw, message.chan3_raw, message.chan5_raw, message.chan2_raw) == (1750, 1400, 1400, 65535)
    assert (message.target_system, message.target_component) == (7, 1)
    assert written.sticks == [({1: 1750, 3: 1400, 5: 1400}, 0.0)]
    assert written.task.postponed == 1
    (period, refresh), (sync, _) = written.tasks
    assert (period, sync) == (0.04, 1.0)
    refresh()
    assert written.kinds() == [OVERRIDE, OVERRIDE]
    assert len(written.commands) == 1, "only a new command is timed"


def test_a_slow_link_gets_twice_its_round_trip_as_slack(written: Written) -> None:
    written.round_trip = 0.3
    streamer(written).command(Actuate())
    assert written.sticks[0][1] == pytest.approx(0.6)


@pytest.mark.parametrize(("after", "sent"), [(0.15, 1), (0.16, 2)])
def test_a_faster_vehicle_gets_overrides_in_its_own_time(written: Written, after: float, sent: int) -> None:
    own = streamer(written)
    own.command(Actuate())
    written.t = 100.0 + after - 1e-9
    written.listeners["ATTITUDE"](None)
    assert len(written.messages) == sent
    written.listeners["SERVO_OUTPUT_RAW"](None)
    assert written.commands[-1] == ("moved", 99.0, {"N": 0.1})


def test_without_a_command_nothing_is_repeated(written: Written) -> None:
    streamer(written)
    written.tasks[0][1]()
    written.listeners["ATTITUDE"](None)
    assert written.messages == []


@pytest.mark.parametrize(("after", "sent"), [(0.049, 1), (0.051, 2)])
def test_a_thin_link_gets_no_repeated_command_within_half_a_period(written: Written, after: float, sent: int) -> None:
    own = streamer(written)
    own.spare_the_link()
    assert written.task.period == 0.1
    own.command(Actuate(N=0.5))
    written.clock.advance(after)
    own.command(Actuate(N=0.5))
    assert len(written.messages) == sent
    own.command(Actuate(N=0.6))
    assert len(written.messages) == sent + 1, "a new one goes at once"


def test_a_wide_link_gets_every_command_and_a_crowded_one_three_copies(written: Written) -> None:
    own = streamer(written)
    for _ in range(2):
        own.command(Actuate(N=0.5))
    assert len(written.messages) == 2
    own.crowd()
    own.command(Actuate())
    assert written.kinds() == [OVERRIDE] * 5
    own.thin_out()
    own.command(Actuate())
    assert written.kinds() == [OVERRIDE]


def test_rest_sends_neutral_and_letting_go_releases_each_five_times(written: Written) -> None:
    own = streamer(written)
    own.command(Actuate(N=0.9))
    own.rest()
    assert [m.chan1_raw for m in written.messages] == [1750 + 200, *[1500] * 5]
    assert own.active == Actuate()
    written.messages.clear()
    own.let_go()
    assert [(m.chan1_raw, m.chan3_raw, m.chan2_raw) for m in written.messages] == [(0, 0, 65535)] * 5
    assert own.active is None
    assert written.forgotten == 3, "what the delays and the channels show from now on is not ours"
    written.messages.clear()
    written.tasks[0][1]()
    assert written.messages == []


@pytest.mark.parametrize(("kind", "mask", "thrust"), [("ardurover", 7, 0.5), ("ardusub", 7 | 64, 0.5)])
def test_a_heading_target_is_sent_with_neutral_overrides_and_the_firmwares_mask(
    written: Written, kind: str, mask: int, thrust: float
) -> None:
    own = streamer(written, firmware=kind)
    own.command(HeadingTarget(math.radians(450.0), 2.0))
    override, target = written.messages
    assert (override.chan1_raw, override.chan3_raw) == (1500, 1500)
    assert target.q == pytest.approx([math.cos(math.pi / 4.0), 0.0, 0.0, math.sin(math.pi / 4.0)])
    assert (target.type_mask, target.target_system) == (mask, 7)
    assert target.thrust == pytest.approx(thrust)


@pytest.mark.parametrize(
    ("speed", "full", "thrust"), [(2.0, 4.0, 0.5), (-9.0, 4.0, -1.0), (9.0, 4.0, 1.0), (2.0, 0.0, 0.0)]
)
def test_a_turn_rate_target_has_the_speed_as_a_fraction_of_full_speed(speed: float, full: float, thrust: float) -> None:
    target: Any = turn_rate_target((7, 1), TurnRateTarget(-0.3, speed), full)
    assert target.body_yaw_rate == pytest.approx(-0.3)
    assert target.thrust == pytest.approx(thrust)
    assert target.type_mask & mavlink.ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE
    assert not target.type_mask & mavlink.ATTITUDE_TARGET_TYPEMASK_BODY_YAW_RATE_IGNORE


@pytest.mark.parametrize(("gain", "stick"), [(math.nan, 0.05 + 0.5 * 0.95), (1.0, 0.1 + 0.5 * 0.9)])
def test_a_turn_rate_sent_by_the_stick_needs_no_target(written: Written, gain: float, stick: float) -> None:
    written.gain = gain
    own = streamer(written, SUB, "ardusub", rate_stick=RateStick(2.0, 0.1, 0.5))
    own.command(TurnRateTarget(-1.0, 0.0))
    (message,) = written.messages
    assert message.chan4_raw == round(1500 - 500 * stick)
    own = streamer(written)
    own.command(TurnRateTarget(-1.0, 1.0))
    assert written.kinds()[1:] == [OVERRIDE, ATTITUDE]


def test_a_depth_target_is_relative_to_the_estimators_origin(written: Written) -> None:
    own = streamer(written, SUB, "ardusub")
    own.command(DepthTarget(3.0))
    override, target = written.messages
    assert override.get_type() == OVERRIDE
    assert target.get_type() == POSITION
    assert target.alt == pytest.approx(-3.25)
    plain: Any = depth_target((7, 1), DepthTarget(3.0))
    assert (plain.alt, plain.target_system, plain.vx) == (-3.0, 7, 0.0)


def test_a_probe_is_streamed_until_it_is_shown(written: Written) -> None:
    own = streamer(written)
    assert not own.probe_override()
    written.shows.add(tuple(sorted(BOAT.probe.items())))
    assert own.probe_override()
    assert written.sticks[-1][0] == dict(BOAT.probe)
    assert written.never == [3.0, 3.0]
    own.command(Actuate())
    assert written.sticks[-1][0] == {1: 1500, 3: 1500, 5: 1400}, "afterwards neutral is neutral"
    assert not own.is_obeyed
    written.shows.add(((1, 1500), (3, 1500), (5, 1400)))
    assert own.is_obeyed
    written.shown = dict.fromkeys(BOAT.probe, 1500)
    assert own.differing.startswith("channel ")


@pytest.mark.parametrize(
    ("receiver", "taken", "held", "released"),
    [(True, True, False, True), (True, True, True, False), (True, False, False, True), (False, False, True, True)],
)
def test_a_release_is_verified_where_a_receiver_can_show_it(
    written: Written, receiver: bool, taken: bool, held: bool, released: bool
) -> None:
    own, probe = streamer(written), tuple(sorted(BOAT.probe.items()))
    written.has_receiver = receiver
    if taken:
        written.shows.add(probe)
    known = own.let_go

    def let_go() -> None:
        known()
        if not held:
            written.shows.discard(probe)

    own.let_go = let_go
    assert own.let_go_visibly() is released
    releases = [m for m in written.messages if m.chan1_raw == 0]
    assert len(releases) == (5 if released else 8), "lost releases are repeated"


def test_pauses_count_only_while_commands_are_sent() -> None:
    clock = ManualClock(0.0)
    rate = SendRate(clock)
    assert math.isnan(rate.rate) and math.isnan(rate.longest)
    for pause in (0.04, 0.3, 0.02, 0.05):
        rate.count()
        clock.advance(pause)
    rate.count()
    assert rate.longest == pytest.approx(0.3)
    assert rate.rate == pytest.approx(4 / 0.41)
    assert rate.pause_since(0.0) == pytest.approx(0.3)
    assert rate.pause_since(0.35) == pytest.approx(0.05)
    assert rate.pause_since(0.42) == 0.0
    rate.suspend()
    clock.advance(9.0)
    rate.count()
    assert rate.longest == pytest.approx(0.3)
    assert rate.rate == pytest.approx(4 / 0.41)


def test_the_pace_of_vehicle_time_is_known_after_a_second_and_restarts_when_its_clock_runs_back() -> None:
    clock = ManualClock(5.0)
    rate = SendRate(clock)
    for seconds, stamp, pace in (
        (0.0, math.nan, 1.0),
        (0.5, 100.0, 1.0),
        (1.0, 110.0, 1.0),
        (0.1, 111.0, 10.0),
        (1.0, 50.0, 10.0),
        (2.0, 54.0, 2.0),
    ):
        clock.advance(seconds)
        rate.count(stamp)
        assert rate.pace == pytest.approx(pace), stamp
