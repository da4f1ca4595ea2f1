"""Messages from another sender with the vehicle's ids are reported and never used."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scripted_vehicle import ScriptedVehicle

from gcs_autotune.errors import LinkLost, NoReply, NotAsFound
from gcs_autotune.link import MavlinkCraft, MemoryLink, Session, open_craft
from gcs_autotune.link.liveness import HeldSender
from gcs_autotune.link.transports import udp
from gcs_autotune.link.transports.address import HostPort
from gcs_autotune.link.transports.udp import UdpIn
from gcs_autotune.manoeuvres import restore_on_exit
from gcs_autotune.mavlink import Framer
from gcs_autotune.observer import SilentObserver

ARM = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
HOME, ELSEWHERE = "10.0.0.1:14550", "10.0.0.66:14550"
DISARMED = mavlink.MAVLink_heartbeat_message(11, 3, 1, 0, 4, 3)
OBEYED = mavlink.MAVLink_command_ack_message(ARM, 0, 0, 0, 255, 0)


class Forged(MemoryLink):
    """A link with a second sender: every 0.3 s the messages of ``forged``, from ``forger``'s address."""

    def __init__(self, boat: ScriptedVehicle) -> None:
        super().__init__(boat)
        self.forger, self.forged, self.home = ELSEWHERE, list[Any](), HOME
        self._mouth = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self._next = 0.0

    def _read_available(self, timeout: float) -> bytes:
        if self.forged and self.clock.now() >= self._next:
            self._next, self.origin = self.clock.now() + 0.3, self.forger
            return b"".join(m.pack(self._mouth) for m in self.forged)
        data = super()._read_available(timeout)
        self.origin = self.home
        return data


@pytest.fixture
def link(boat: ScriptedVehicle) -> Forged:
    return Forged(boat)


@pytest.fixture
def craft(link: Forged) -> Iterator[MavlinkCraft]:
    with Session(link) as session:
        yield open_craft(session, arm_patience=3.0)


def leave_armed_and_lie(craft: MavlinkCraft, boat: ScriptedVehicle, link: Forged) -> list[str]:
    """Connect and arm; on leaving the boat does not disarm, and a forger acknowledges the disarm."""
    settled: list[str] = []
    with (
        pytest.raises(NotAsFound) as caught,
        restore_on_exit(craft, SilentObserver(), lambda: settled.append("settled")),
    ):
        craft.arm()
        boat.on["COMMAND_LONG"] = lambda m: None if m.command == ARM else boat._on_command_long(m)
        link.forged = [OBEYED, DISARMED]
    return [*settled, str(caught.value)]


def test_a_heartbeat_forged_from_another_address_does_not_settle_the_clean_up(
    craft: MavlinkCraft, boat: ScriptedVehicle, link: Forged
) -> None:
    errors = leave_armed_and_lie(craft, boat, link)
    assert boat.armed and len(errors) == 1 and "armed state" in errors[0]
    reported = [note for note in craft.session.notes if ELSEWHERE in note]
    assert len(reported) == 1 and f"the vehicle is at {HOME}. The other sender is ignored" in reported[0]


def test_a_heartbeat_forged_from_the_vehicles_address_does_not_settle_the_clean_up(
    craft: MavlinkCraft, boat: ScriptedVehicle, link: Forged
) -> None:
    link.forger = HOME
    errors = leave_armed_and_lie(craft, boat, link)
    assert boat.armed and len(errors) == 1 and "contradict each other" in errors[0]
    assert any("their sequence numbers interleave" in note for note in craft.session.notes)


def test_a_forger_who_sends_first_is_reported_as_a_second_sender_not_old_firmware(
    boat: ScriptedVehicle, link: Forged
) -> None:
    link.forged = [DISARMED]
    with Session(link) as session, pytest.raises(NoReply) as caught:
        open_craft(session, arm_patience=3.0)
    errors = str(caught.value)
    assert "messages with the ids of " in errors
    assert f"come from 2 addresses: {ELSEWHERE} and {HOME}. Only messages from {ELSEWHERE} are used" in errors
    assert "answers no parameter requests" in errors and "firmware" not in errors
    assert not boat.armed


def test_messages_from_another_address_have_no_effect(craft: MavlinkCraft, boat: ScriptedVehicle, link: Forged) -> None:
    link.forged = [
        mavlink.MAVLink_heartbeat_message(11, 3, 128, 15, 4, 3),
        mavlink.MAVLink_param_value_message(b"WP_SPEED", 99.0, 9, 10, 1),
    ]
    for _ in range(40):
        craft.observe()
    assert not craft.armed and craft.mode == "MANUAL"
    assert craft.parameters.read("WP_SPEED") == 2.0


def test_a_vehicle_returning_from_another_port_is_recognised(
    craft: MavlinkCraft, boat: ScriptedVehicle, link: Forged
) -> None:
    link.home = "10.0.0.1:50123"
    craft.session.pause(6.0)
    assert craft.session.liveness.silence < 1.0
    assert [n for n in craft.session.notes if "50123" in n] == [
        f"the vehicle now sends from 10.0.0.1:50123, not {HOME} (restarted?): its board reports no id, "
        "but its firmware is the same"
    ]


def test_another_vehicle_in_its_place_is_not_accepted(craft: MavlinkCraft, boat: ScriptedVehicle, link: Forged) -> None:
    other = mavlink.MAVLink_autopilot_version_message(0, 4 << 24, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, 77)
    boat.alive = False
    link.forged = [DISARMED, other]
    with pytest.raises(LinkLost):
        craft.session.pause(60.0)
    assert not craft.session.await_return(10.0)


def numbered(numbers: list[int]) -> list[str]:
    """Return the notes about frames of these sequence numbers from one address."""
    notes: list[str] = []
    peer, mouth, framer = HeldSender(notes), mavlink.MAVLink(None, srcSystem=1, srcComponent=1), Framer()
    for number in numbers:
        mouth.seq = number % 256
        for frame in framer.feed(DISARMED.pack(mouth)):
            peer.hear(frame)
    return notes


@pytest.mark.parametrize(
    ("numbers", "reported"),
    [
        ([n for k in range(20) for n in (k, 100 + k)], 1),
        ([n for k in range(20) for n in (2 * k, 2 * k + 1, 100 + k)], 1),
        (list(range(600)), 0),
        ([k for k in range(600) if k % 7 not in (2, 3)], 0),
        ([k for k in range(300) for _ in range(2)], 0),
        ([*range(100, 150), *range(50)], 0),
        ([n for k in range(0, 100, 2) for n in (k + 1, k)], 0),
    ],
    ids=["two", "two, one slower", "one", "losses", "doubled", "restarted", "out of order"],
)
def test_two_senders_are_detected_by_their_sequences_and_a_bad_link_is_not(numbers: list[int], reported: int) -> None:
    assert len(numbered(numbers)) == reported


# --- UDP -------------------------------------------------------------------------------------------------------


def speaker() -> socket.socket:
    one = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    one.bind(("127.0.0.1", 0))
    one.settimeout(2.0)
    return one


def heard(link: UdpIn, count: int) -> list[tuple[str, bytes]]:
    return [(data, link.origin)[::-1] for data in (link.read(2.0) for _ in range(count))]  # type: ignore[misc]


def test_udp_distinguishes_senders_and_answers_the_held_one(monkeypatch: pytest.MonkeyPatch) -> None:
    with UdpIn(HostPort("127.0.0.1", 0)) as link, speaker() as one, speaker() as other:
        names = [f"127.0.0.1:{s.getsockname()[1]}" for s in (one, other)]
        to = ("127.0.0.1", link.port)
        for sender, word in ((one, b"a"), (one, b"b"), (other, b"c"), (one, b"d")):
            sender.sendto(word, to)
        assert heard(link, 3) == [(names[0], b"ab"), (names[1], b"c"), (names[0], b"d")]
        link.hold(names[0])
        link.write(b"for one")
        assert one.recv(100) == b"for one"
        monkeypatch.setattr(udp, "_GONE", -1.0)
        link.write(b"for all")
        assert one.recv(100) == other.recv(100) == b"for all"


def test_a_partial_frame_of_one_sender_is_not_continued_by_another(link: Forged, boat: ScriptedVehicle) -> None:
    with Session(link) as session:
        session.discover()
        read: Callable[[float], bytes] = link._read_available
        spoilt = iter([b"\xfd\x40\x00"] * 50)

        def interrupted(timeout: float) -> bytes:
            if link.clock.now() > link._next:
                link._next, link.origin = link.clock.now() + 0.2, ELSEWHERE
                return next(spoilt, b"")
            return read(timeout)

        link._read_available = interrupted  # type: ignore[method-assign]
        before = session.heartbeats
        session.pause(10.0)
        assert session.heartbeats - before >= 9
