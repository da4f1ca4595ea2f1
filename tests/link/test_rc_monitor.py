"""RC_CHANNELS against what was sent, message by message: no link, no vehicle."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_autotune.link import Session
from gcs_autotune.link.vehicle.rc_monitor import RcMonitor

DRIVEN = {1: 1500, 3: 1700}


class Listening:
    """The part of a session that ``RcMonitor`` needs: the time listened, and the RC_CHANNELS listener."""

    def __init__(self) -> None:
        self.liveness = SimpleNamespace(listened=100.0)
        self._deliver: Any = None

    def listen(self, name: str, deliver: Any) -> None:
        assert name == "RC_CHANNELS"
        self._deliver = deliver

    def show(self, *, receiver: bool | int = True, **channels: int) -> None:
        """Deliver RC_CHANNELS with all channels at 1500 us, but for ``c1=1700``; *receiver*: or how many it has."""
        shown = [channels.get(f"c{n}", 1500) for n in range(1, 19)]
        self._deliver(mavlink.MAVLink_rc_channels_message(0, 16 if receiver is True else int(receiver), *shown, 255))


@pytest.fixture
def listening() -> Listening:
    return Listening()


@pytest.fixture
def rc_monitor(listening: Listening) -> RcMonitor:
    return RcMonitor(cast(Session, listening))


@pytest.mark.parametrize("to", [1850, 1150], ids=["up", "down"])
def test_a_stick_moved_in_either_direction_and_held_is_detected(
    listening: Listening, rc_monitor: RcMonitor, to: int
) -> None:
    rc_monitor.sent(DRIVEN)
    for shown in (1500, to):
        listening.show(c3=1700, c6=shown)
        assert rc_monitor.moved_by_hand is None
    listening.show(c3=1700, c6=to)
    assert rc_monitor.moved_by_hand == (6, 1500, to)


@pytest.mark.parametrize("channel", [1, 8])
def test_the_first_and_last_transmitter_channels_are_monitored(
    listening: Listening, rc_monitor: RcMonitor, channel: int
) -> None:
    rc_monitor.sent({3: 1700})
    for shown in (1500, 1150, 1150):
        listening.show(c3=1700, **{f"c{channel}": shown})
    assert rc_monitor.moved_by_hand == (channel, 1500, 1150)


@pytest.mark.parametrize("by", [100, -100])
def test_up_to_100_us_is_stick_jitter_and_more_is_movement(
    listening: Listening, rc_monitor: RcMonitor, by: int
) -> None:
    rc_monitor.sent(DRIVEN)
    for off in (0, by, by, by):
        listening.show(c3=1700, c6=1500 + off)
    assert rc_monitor.moved_by_hand is None
    beyond = 1500 + by + (1 if by > 0 else -1)
    for _ in range(2):
        listening.show(c3=1700, c6=beyond)
    assert rc_monitor.moved_by_hand == (6, 1500, beyond)


def test_two_separate_excursions_are_not_a_movement(listening: Listening, rc_monitor: RcMonitor) -> None:
    rc_monitor.sent(DRIVEN)
    for shown in (1500, 1150, 1500, 1150, 1500):
        listening.show(c3=1700, c6=shown)
    assert rc_monitor.moved_by_hand is None


@pytest.mark.parametrize(
    ("channel", "shown", "receiver"),
    [(3, 1100, True), (9, 1900, True), (6, 799, True)],
    ids=["driven by us", "no stick", "no pulse"],
)
def test_driven_channels_non_sticks_and_missing_pulses_are_not_a_movement(
    listening: Listening, rc_monitor: RcMonitor, channel: int, shown: int, receiver: bool
) -> None:
    rc_monitor.sent(DRIVEN)
    listening.show(receiver=receiver)
    for _ in range(3):
        listening.show(receiver=receiver, **{f"c{channel}": shown})
    assert rc_monitor.moved_by_hand is None
    assert rc_monitor.has_receiver is receiver


def test_overrides_never_obeyed_are_reported_after_four_seconds(listening: Listening, rc_monitor: RcMonitor) -> None:
    """Three seconds of patience and one of memory: until then the first may still be under way."""
    verdicts = []
    for _ in range(60):
        rc_monitor.sent(DRIVEN)
        listening.show()
        verdicts.append((listening.liveness.listened - 100.0, rc_monitor.departed))
        listening.liveness.listened += 0.1
    assert {verdict for after, verdict in verdicts if after <= 3.95} == {None}
    assert {verdict for after, verdict in verdicts if after >= 4.15} == {(3, 1700, 1500)}


def test_overrides_no_longer_obeyed_are_reported_at_the_third_message(
    listening: Listening, rc_monitor: RcMonitor
) -> None:
    rc_monitor.sent(DRIVEN)
    listening.show(c3=1700)
    assert rc_monitor.obeyed
    for expected in (None, None, (3, 1700, 1500)):
        listening.show()
        assert rc_monitor.departed == expected


def test_values_sent_recently_count_and_values_sent_long_ago_do_not(
    listening: Listening, rc_monitor: RcMonitor
) -> None:
    rc_monitor.sent({1: 1500})
    listening.show()
    listening.liveness.listened += 0.5
    for _ in range(5):
        rc_monitor.sent({1: 1800})
        listening.show()
    assert rc_monitor.departed is None
    listening.liveness.listened += 2.0
    for _ in range(3):
        rc_monitor.sent({1: 1800})
        listening.show()
        listening.liveness.listened += 2.0
        rc_monitor.sent({1: 1801})
    assert rc_monitor.departed == (1, 1801, 1500)


def test_a_slow_link_gets_its_slack_added(listening: Listening, rc_monitor: RcMonitor) -> None:
    for pwm in (1500, 1600, 1700, 1800):
        rc_monitor.sent({1: pwm}, slack=5.0)
        listening.liveness.listened += 1.0
    for _ in range(5):
        listening.show()
    assert rc_monitor.departed is None
    assert rc_monitor.obeyed


@pytest.mark.parametrize(("off", "is_same"), [(2, True), (-2, True), (3, False), (-3, False)])
def test_two_microseconds_are_rounding(listening: Listening, rc_monitor: RcMonitor, off: int, is_same: bool) -> None:
    rc_monitor.sent({1: 1500})
    listening.show(c1=1500 + off)
    assert rc_monitor.obeyed is is_same
    assert rc_monitor.show({1: 1500}) is is_same


def test_nothing_is_shown_before_the_first_message(rc_monitor: RcMonitor) -> None:
    assert not rc_monitor.show({1: 1500})
    assert rc_monitor.has_receiver is None


@pytest.mark.parametrize("channels", [0, 1, 16])
def test_one_channel_makes_a_receiver(listening: Listening, rc_monitor: RcMonitor, channels: int) -> None:
    listening.show(receiver=channels)
    assert rc_monitor.has_receiver is (channels > 0)


def test_after_forgetting_no_conflict_is_reported(listening: Listening, rc_monitor: RcMonitor) -> None:
    rc_monitor.sent(DRIVEN)
    listening.show(c3=1700)
    for _ in range(3):
        listening.show(c6=1900)
    assert rc_monitor.departed is not None
    assert rc_monitor.moved_by_hand is not None
    rc_monitor.forget()
    assert (rc_monitor.departed, rc_monitor.moved_by_hand, rc_monitor.obeyed) == (None, None, False)
    listening.show(c6=1200)
    assert (rc_monitor.departed, rc_monitor.moved_by_hand) == (None, None)


def test_all_sixteen_channels_are_stored_as_received(listening: Listening, rc_monitor: RcMonitor) -> None:
    listening.show(c1=1101, c16=1116)
    assert set(rc_monitor.shown) == set(range(1, 17))
    assert (rc_monitor.shown[1], rc_monitor.shown[16], rc_monitor.shown[8]) == (1101, 1116, 1500)
    assert rc_monitor.count == 1
