"""The conformance suite of links, first half: every transport and backend, byte by byte over the real medium."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from link_ends import BREAK, ENDS, HELLO, PATIENCE, RETURN, Ends, opened
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_autotune.clock import Deadline, WallClock
from gcs_autotune.errors import LinkLost
from gcs_autotune.link import MemoryLink
from gcs_autotune.link.transports import mavsdk as mavsdk_link
from gcs_autotune.link.transports import transport as returning
from gcs_autotune.link.transports.sitl_process import SitlProcess
from gcs_autotune.mavlink import Framer


@pytest.fixture
def ends(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Ends]:
    monkeypatch.setattr(returning, "_RETRY", 0.01)
    monkeypatch.setattr(mavsdk_link, "_CONNECT_PATIENCE", 0.02)
    yield from opened(request.param, tmp_path)


every = pytest.mark.parametrize("ends", ENDS, indirect=True)


class Foreign(mavlink.MAVLink_heartbeat_message):  # type: ignore[misc]
    """A message that is in no dialect."""

    id = 54321
    crc_extra = 77


def frame(number: int, system: int = 1) -> bytes:
    mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=1)
    mav.seq = number % 256
    name = f"P{number}".encode()
    return bytes(mavlink.MAVLink_param_value_message(name, number / 7, 9, 1000, number).pack(mav))


def read_until(ends: Ends, expected: bytes) -> bytes:
    data, deadline = b"", Deadline.after(ends.ours.clock, PATIENCE)
    while expected not in data and not deadline.expired:
        data += ends.ours.read(deadline.remaining)
    return data


def receive_until(ends: Ends, expected: bytes) -> bytes:
    data, deadline = b"", Deadline.after(WallClock(), PATIENCE)
    while expected not in data:
        assert not deadline.expired, "the bytes have not arrived"
        data += ends.receive()
    return data


@every
def test_written_bytes_arrive_unchanged_at_the_other_end(ends: Ends) -> None:
    ends.send(HELLO)
    read_until(ends, HELLO)
    ends.ours.write(frame(1, 255))
    assert frame(1, 255) in receive_until(ends, frame(1, 255))


@every
def test_received_bytes_are_read_unchanged(ends: Ends) -> None:
    signed = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    signed.signing.secret_key, signed.signing.sign_outgoing = bytes(range(32)), True
    first = bytes(mavlink.MAVLink_attitude_message(1, float("nan"), -0.0, 1e-40, 0, 0, 0).pack(signed))
    mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    old = bytes(mavlink.MAVLink_heartbeat_message(11, 3, 0, 0, 4, 3).pack(mav, force_mavlink1=True))
    foreign = bytes(Foreign(11, 3, 0, 0, 4, 3).pack(mav))
    for sent in (first, old, foreign):
        ends.send(sent)
        assert read_until(ends, sent) == sent


@every
def test_a_burst_of_a_thousand_messages_arrives_complete_and_in_order_both_ways(ends: Ends) -> None:
    frames = [frame(n) for n in range(1000)]
    came: list[str] = []
    framer = Framer()
    for at in range(0, 1000, 50):
        ends.send(b"".join(frames[at : at + 50]))
        while framer.bad_bytes == 0 and len(came) < at + 50:
            came += [f.message.param_id for f in framer.feed(ends.ours.read(PATIENCE))]
    assert came == [f"P{n}" for n in range(1000)]
    if not isinstance(ends.ours, MemoryLink | SitlProcess):
        for at in range(0, 1000, 50):
            for one in frames[at : at + 50]:
                ends.ours.write(one)
            receive_until(ends, frames[at + 49])


@every
def test_a_read_without_data_ends_at_its_deadline(ends: Ends) -> None:
    begun = ends.ours.clock.now()
    assert ends.ours.read(0.02) == b""
    assert 0.02 <= ends.ours.clock.now() - begun < 5.0
    assert ends.ours.read(0.0) == b""
    assert ends.ours.read(-1.0) == b""


@every
def test_using_a_closed_link_raises_link_lost_and_closing_twice_is_harmless(ends: Ends) -> None:
    ends.ours.close()
    ends.ours.close()
    with pytest.raises(LinkLost, match="closed"):
        ends.ours.read(0.0)
    with pytest.raises(LinkLost, match="closed"):
        ends.ours.write(b"x")


@every
def test_a_link_describes_itself_and_whether_its_time_is_simulated(ends: Ends, request: pytest.FixtureRequest) -> None:
    assert ends.ours.description
    assert ends.ours.is_simulated == isinstance(ends.ours, MemoryLink | SitlProcess)
    assert ends.ours.carrier.startswith("MAVSDK 4") == ("mavsdk" in request.node.name)
    assert ends.ours.trouble == ""


@pytest.mark.parametrize("ends", BREAK, indirect=True)
def test_a_vanished_peer_raises_link_lost_where_it_can_be_detected(ends: Ends) -> None:
    assert ends.hang_up is not None
    ends.hang_up()
    with pytest.raises(LinkLost, match="lost"):
        for _ in range(50):
            ends.ours.write(frame(1, 255))
            ends.ours.read(0.1)


@pytest.mark.parametrize("ends", sorted(set(ENDS) - {*BREAK, "memory"}), indirect=True)
def test_a_vanished_peer_is_silent_where_it_cannot_be_detected(ends: Ends) -> None:
    assert ends.hang_up is not None
    ends.hang_up()
    for _ in range(3):
        ends.ours.write(frame(1, 255))
        assert ends.ours.read(0.01) == b""


@pytest.mark.parametrize("ends", RETURN, indirect=True)
def test_a_returning_peer_is_reconnected(ends: Ends) -> None:
    assert ends.hang_up is not None and ends.come_back is not None
    ends.send(frame(1))
    read_until(ends, frame(1))
    ends.hang_up()
    for _ in range(20):
        try:
            ends.ours.write(frame(1, 255))
            ends.ours.read(0.005)
        except LinkLost:
            break
    for _ in range(3):  # said once; from here on it is waited for
        ends.ours.write(frame(2, 255))
        assert ends.ours.read(0.001) == b""
    ends.come_back()
    ends.ours.write(HELLO)
    ends.send(frame(3))
    assert frame(3) in read_until(ends, frame(3))
    ends.ours.write(frame(4, 255))
    assert frame(4, 255) in receive_until(ends, frame(4, 255))


def count_of_tasks() -> int:
    """Return how many threads the process has, native ones too."""
    return sum(1 for _ in Path("/proc/self/task").iterdir())


@pytest.mark.parametrize("name", ENDS)
def test_a_closed_link_leaves_no_thread_or_file_behind(name: str, tmp_path: Path) -> None:
    """No thread, no open file, no changed setting: the second link leaves the process as the first did."""

    def state() -> tuple[int, int, float]:
        return threading.active_count(), sum(1 for _ in Path("/proc/self/fd").iterdir()), sys.getswitchinterval()

    for _ in opened(name, tmp_path):
        pass
    before, tasks = state(), count_of_tasks()
    for ends in opened(name, tmp_path):
        ends.ours.write(HELLO)
    assert state() == before
    waiting = Deadline.after(WallClock(), PATIENCE)
    while count_of_tasks() > tasks and not waiting.expired:
        pass  # a native thread that has been joined is listed until the kernel has taken it down
    assert count_of_tasks() <= tasks
