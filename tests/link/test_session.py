from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scripted_vehicle import ROV, ScriptedVehicle

from gcs_autotune.errors import BadFile, CannotOpenLink, LinkLost, NoVehicle, OperatorStopped, UsageError
from gcs_autotune.link import MemoryLink, Parameters, Session
from gcs_autotune.mavlink import AT_WORK, Framer, TextLog, TlogWriter, read_tlog


class Babbler:
    """A peer that sends the supplied bytes and records what it receives."""

    def __init__(self, *chunks: bytes) -> None:
        self._chunks = list(chunks)
        self.heard: list[Any] = []
        self._mav = mavlink.MAVLink(None)
        self._mav.robust_parsing = True

    def receive(self, data: bytes) -> None:
        self.heard += self._mav.parse_buffer(data) or []

    def advance_to(self, t: float) -> bytes:
        return self._chunks.pop(0) if self._chunks else b""


# --- discovery --------------------------------------------------------------------------------


def test_a_discovered_vehicle_is_identified(session: Session) -> None:
    assert session.vehicle is not None
    assert str(session.vehicle) == "ArduRover 4.7.0-dev (system 1, component 1)"
    assert session.vehicle.to_dict()["vehicle_type"] == 11


def test_a_missing_vehicle_is_an_error_after_the_timeout() -> None:
    session = Session(MemoryLink(Babbler()))
    with pytest.raises(NoVehicle, match="nothing was received"):
        session.discover(timeout=3.0)
    assert session.clock.now() == pytest.approx(3.0, abs=0.01)


def test_noise_without_mavlink_suggests_checking_the_address() -> None:
    with pytest.raises(NoVehicle, match="Check the address"):
        Session(MemoryLink(Babbler(b"\x55" * 400))).discover(timeout=1.0)


def test_another_ground_station_is_no_vehicle_but_is_reported() -> None:
    mission_planner = ScriptedVehicle(system=254)
    mission_planner.heartbeat = lambda: mission_planner.send(  # type: ignore[method-assign]
        mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    )
    with pytest.raises(NoVehicle, match="system ids 254"):
        Session(MemoryLink(mission_planner)).discover(timeout=3.0)


class Two:
    """Two vehicles on one link."""

    def __init__(self) -> None:
        self.vehicles = (ScriptedVehicle(system=1), ScriptedVehicle(ROV, system=7))

    def receive(self, data: bytes) -> None:
        for vehicle in self.vehicles:
            vehicle.receive(data)

    def advance_to(self, t: float) -> bytes:
        return b"".join(vehicle.advance_to(t) for vehicle in self.vehicles)


def test_two_autopilots_need_a_choice_and_both_are_listed() -> None:
    with pytest.raises(UsageError, match=r"system 1 \(ArduRover\) and system 7 \(ArduSub\)"):
        Session(MemoryLink(Two())).discover()


def test_with_a_choice_only_the_chosen_vehicle_is_heard() -> None:
    session = Session(MemoryLink(Two()))
    vehicle = session.discover(system_id=7)
    assert (vehicle.system, vehicle.vehicle_type) == (7, 12)
    session.pause(3.0)
    assert session.custom_mode == 19
    assert session.routing.foreign[1, 1] >= 3


def test_a_missing_system_id_is_reported_with_those_present() -> None:
    with pytest.raises(NoVehicle, match=r"system id 9 .* system 1 \(ArduRover\)"):
        Session(MemoryLink(ScriptedVehicle())).discover(timeout=2.0, system_id=9)


def test_a_vehicle_without_a_version_is_still_discovered(boat: ScriptedVehicle) -> None:
    boat.mute.add("AUTOPILOT_VERSION")
    session = Session(MemoryLink(boat))
    assert session.discover().version == ""
    assert any("version" in note for note in session.notes)


# --- heartbeat, liveness, the operator ------------------------------------------------------------------------


def test_our_heartbeat_is_sent_every_second(session: Session, boat: ScriptedVehicle) -> None:
    before = boat.count("HEARTBEAT")
    session.pause(10.0)
    assert boat.count("HEARTBEAT") - before == 10
    beat = boat.last("HEARTBEAT")
    assert (beat.type, beat.autopilot, beat.get_srcSystem(), beat.get_srcComponent()) == (6, 8, 255, 190)


def test_a_run_is_announced_from_a_component_id_of_its_own(session: Session, boat: ScriptedVehicle) -> None:
    session.at_work = True
    session.pause(3.0)
    heard = [(m.get_srcComponent(), int(m.custom_mode)) for m in boat.heard if m.get_type() == "HEARTBEAT"][-4:]
    assert sorted(set(heard)) == [(session.beacon, AT_WORK), (190, 0)], "a router masks ids that it knows on a link"
    real = [Session(Nowhere(Babbler())).beacon for _ in range(20)]
    assert len(set(real)) > 1
    assert all(mavlink.MAV_COMP_ID_USER1 <= beacon <= mavlink.MAV_COMP_ID_USER75 for beacon in real)


class Nowhere(MemoryLink):
    """A link to a vehicle that other computers may reach as well."""

    is_simulated = False


def test_a_silent_vehicle_is_reported_with_the_seconds(session: Session, boat: ScriptedVehicle) -> None:
    boat.alive = False
    begun = session.clock.now()
    with pytest.raises(LinkLost, match=r"Lost contact with .* \(5\.\d s\)"):
        session.pause(60.0)
    assert session.clock.now() - begun < 7.0


def test_traffic_of_others_does_not_hide_the_silence(session: Session, boat: ScriptedVehicle) -> None:
    boat.mute.add("HEARTBEAT")
    with pytest.raises(LinkLost):
        for _ in range(100):
            boat.send_as(9, 1, mavlink.MAVLink_heartbeat_message(11, 3, 0, 0, 4, 3))
            session.pump()


def test_the_vehicles_return_can_be_awaited_after_a_lost_link(session: Session, boat: ScriptedVehicle) -> None:
    boat.alive = False
    with pytest.raises(LinkLost):
        session.pause(60.0)
    assert not session.await_return(2.0)
    boat.alive = True
    assert session.await_return(3.0)
    session.pause(2.0)


def test_the_operators_stop_is_raised_by_the_next_pump(boat: ScriptedVehicle) -> None:
    stop = False
    session = Session(MemoryLink(boat), interrupt=lambda: stop)
    session.discover()
    stop = True
    with pytest.raises(OperatorStopped):
        session.pump()


class RealLink(MemoryLink):
    """A memory link that claims to run in real time and records every wait."""

    is_simulated = False

    def __init__(self, boat: ScriptedVehicle) -> None:
        super().__init__(boat)
        self.waits: list[float] = []

    def read(self, timeout: float) -> bytes:
        self.waits.append(timeout)
        return super().read(timeout)


def test_in_real_time_a_stop_is_raised_without_delay(boat: ScriptedVehicle) -> None:
    link = RealLink(boat)
    requested: list[int] = []
    with Session(link, interrupt=lambda: bool(requested)) as session:
        session.discover()
        session.pause(0.5)
        assert max(link.waits) <= 0.02
        requested.append(1)
        begun = session.clock.now()
        with pytest.raises(OperatorStopped):
            session.pause(10.0)
        assert session.clock.now() - begun <= 0.02


def test_a_shield_delays_the_stop_until_it_ends(boat: ScriptedVehicle) -> None:
    pressed = False
    session = Session(MemoryLink(boat), interrupt=lambda: pressed)
    session.discover()
    with session.operator.shielded():
        pressed = True
        session.pump()
        pressed = False
        with session.operator.shielded():
            session.pump()
        session.pump()
    assert session.operator.requested
    with pytest.raises(OperatorStopped):
        session.pump()


def test_a_shield_can_raise_on_leaving(boat: ScriptedVehicle) -> None:
    session = Session(MemoryLink(boat), interrupt=lambda: True)
    with pytest.raises(OperatorStopped), session.operator.shielded(raise_after=True):
        session.pump()


def test_an_error_inside_a_shield_is_not_replaced(boat: ScriptedVehicle) -> None:
    session = Session(MemoryLink(boat), interrupt=lambda: True)
    with pytest.raises(CannotOpenLink), session.operator.shielded(raise_after=True):
        raise CannotOpenLink("first")


# --- texts --------------------------------------------------------------------------------


def test_a_text_in_chunks_is_joined() -> None:
    log = TextLog()
    long = "PreArm: " + "all the many things that are wrong " * 3
    pieces = [long[i : i + 50] for i in range(0, len(long), 50)]
    done = [
        log.take(mavlink.MAVLink_statustext_message(4, piece.encode(), 5, number), 1.0)
        for number, piece in enumerate(pieces)
    ]
    assert [text.text for text in log] == [long]
    assert done[:-1] == [None] * (len(pieces) - 1)


def test_texts_have_their_severity_and_time(session: Session, boat: ScriptedVehicle) -> None:
    boat.say("Leak detected", severity=2)
    session.pump()
    (text,) = session.texts
    assert (text.severity, text.text) == (2, "Leak detected")


# --- robustness --------------------------------------------------------------------------------


@settings(max_examples=60, deadline=None)
@given(st.lists(st.binary(max_size=300), max_size=8))
def test_arbitrary_bytes_never_raise_and_never_make_us_write_parameters(chunks: list[bytes]) -> None:
    peer = Babbler(*chunks)
    session = Session(MemoryLink(peer))
    Parameters(session)
    session.pause(1.0)
    assert {m.get_type() for m in peer.heard} <= {"HEARTBEAT"}


_FRAME = mavlink.MAVLink_heartbeat_message(11, 3, 0, 0, 4, 3).pack(mavlink.MAVLink(None, 1, 1))


@settings(max_examples=60, deadline=None)
@given(st.binary(max_size=60).filter(lambda b: 0xFD not in b and 0xFE not in b), st.integers(1, 20))
def test_a_frame_in_noise_is_found_whatever_the_chunk_size(noise: bytes, cut: int) -> None:
    framer = Framer()
    data = noise + _FRAME + noise + _FRAME
    frames = [f for i in range(0, len(data), cut) for f in framer.feed(data[i : i + cut])]
    assert [f.name for f in frames] == ["HEARTBEAT", "HEARTBEAT"]
    assert framer.bad_bytes == 2 * len(noise)


def test_a_false_start_does_not_swallow_the_frames_after_it(boat: ScriptedVehicle) -> None:
    session = Session(MemoryLink(Babbler(b"\xfd\xff\x00" + _FRAME)))
    assert session.discover(timeout=4.0).system == 1
    assert session.port.bad_data == 1


@pytest.mark.parametrize("spoil", range(1, len(_FRAME)))
def test_a_frame_with_a_flipped_byte_is_counted_and_dropped(spoil: int) -> None:
    damaged = bytearray(_FRAME)
    damaged[spoil] ^= 0x55
    framer = Framer()
    frames = framer.feed(bytes(damaged)) + framer.flush()
    assert not [f for f in frames if not f.name.startswith("UNKNOWN")]


# --- the log --------------------------------------------------------------------------------


def flown(path: Path, make: Callable[[], ScriptedVehicle]) -> list[Any]:
    with Session(MemoryLink(make()), tlog=path) as session:
        session.discover()
        Parameters(session).read_full()
        session.pause(2.0)
    return list(read_tlog(path))


def test_the_log_contains_both_directions_from_the_first_byte(tmp_path: Path) -> None:
    records = flown(tmp_path / "a.tlog", ScriptedVehicle)
    assert records[0].frame.system == 255
    assert {r.frame.system for r in records} == {1, 255}
    assert {"HEARTBEAT", "COMMAND_LONG", "AUTOPILOT_VERSION", "PARAM_VALUE"} <= {r.frame.name for r in records}
    assert [r.time for r in records] == sorted(r.time for r in records)


def test_simulated_runs_write_bit_identical_logs(tmp_path: Path) -> None:
    for name in ("a.tlog", "b.tlog"):
        flown(tmp_path / name, ScriptedVehicle)
    assert (tmp_path / "a.tlog").read_bytes() == (tmp_path / "b.tlog").read_bytes()


def test_the_vehicle_is_discovered_on_lossy_links() -> None:
    seeds = random.Random(1).sample(range(1000), 5)
    assert len(seeds) == 5
    for seed in seeds:
        session = Session(MemoryLink(ScriptedVehicle(), loss=0.3, seed=seed))
        assert session.discover().system == 1


def test_a_full_disk_ends_the_log_but_not_the_session(
    boat: ScriptedVehicle, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise BadFile("the telemetry log cannot be written: No space left on device")

    session = Session(MemoryLink(boat), tlog=tmp_path / "a.tlog")
    session.discover()
    monkeypatch.setattr(TlogWriter, "write", full)
    session.pause(3.0)
    assert [n for n in session.notes if "The telemetry log ends here" in n] == [
        "the telemetry log cannot be written: No space left on device. The telemetry log ends here"
    ]
    session.close()


def test_a_second_station_with_our_id_is_reported_once(session: Session, boat: ScriptedVehicle) -> None:
    for _ in range(3):
        boat.send_as(255, 190, mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
        session.pause(1.0)
    assert len([n for n in session.notes if "another station" in n]) == 1


class Suspended:
    """A machine that is suspended for a while between two pumps."""

    def __init__(self):
        self.ahead = 0.0

    def now(self):
        return self.ahead


def test_a_suspended_machine_does_not_count_its_own_absence_as_silence(boat):
    link = MemoryLink(boat)
    with Session(link) as session:
        session.discover()
        clock = Suspended()
        clock.ahead = link.clock.now()
        session.clock = clock
        session.pump()
        boat.mute.add("HEARTBEAT")
        clock.ahead += 30.0
        session.pump()
        assert session.liveness.silence < 1.0
        with pytest.raises(LinkLost, match="Lost contact with"):
            for _ in range(20):
                clock.ahead += 0.4
                session.pump()


class Backlog:
    """A vehicle whose unread messages queue up: each read returns one of them."""

    def __init__(self, boat: ScriptedVehicle) -> None:
        self.boat = boat
        self.waiting: list[bytes] = []

    def receive(self, data: bytes) -> None:
        self.boat.receive(data)

    def advance_to(self, t: float) -> bytes:
        live = self.boat.advance_to(t)
        return self.waiting.pop(0) if self.waiting else live


def texts(*words: str) -> list[bytes]:
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    return [mavlink.MAVLink_statustext_message(6, word.encode()).pack(sender) for word in words]


def busy_session(boat: ScriptedVehicle) -> tuple[Session, Backlog, Suspended]:
    """A session whose machine can be busy: the third has seconds to be added to its clock."""
    peer, clock = Backlog(boat), Suspended()
    session = Session(MemoryLink(peer))
    session.discover()
    session.clock = clock
    clock.ahead = session.transport.clock.now()
    session.pump()
    return session, peer, clock


def test_messages_queued_while_the_machine_was_busy_are_all_read_at_once(boat: ScriptedVehicle) -> None:
    session, peer, clock = busy_session(boat)
    heard: list[str] = []
    session.listen("STATUSTEXT", lambda m: heard.append(m.text))
    peer.waiting += texts("oldest", "older", "newest")
    session.pump()
    assert heard == ["oldest"], "a machine that is not busy reads as it comes"
    clock.ahead += 1.0
    session.pump()
    assert heard == ["oldest", "older", "newest"]


def test_an_unread_answer_is_not_late_however_long_the_machine_was_busy(boat: ScriptedVehicle) -> None:
    session, peer, clock = busy_session(boat)
    heard: list[str] = []
    session.listen("STATUSTEXT", lambda m: heard.append(m.text))
    looks = 0

    def answered() -> bool | None:
        nonlocal looks
        looks += 1
        if looks == 1:  # the machine is busy for ten seconds now, and the answer comes meanwhile
            clock.ahead += 10.0
        if looks == 2:
            peer.waiting += texts("the answer")
        return True if "the answer" in heard else None

    assert session.wait_for(answered, 2.0)


def test_a_wait_without_an_answer_ends_after_the_time_spent_listening(boat: ScriptedVehicle) -> None:
    session, _, clock = busy_session(boat)
    begun = session.liveness.listened

    def never() -> None:
        clock.ahead += 0.1

    assert session.wait_for(never, 2.0) is None
    assert session.liveness.listened - begun == pytest.approx(2.0, abs=0.11)


def test_a_wait_shorter_than_the_resolution_of_simulated_time_ends() -> None:
    session = Session(MemoryLink(Babbler()))
    session.pause(160.1)
    session.liveness.listened = 0.0  # the session began late in the life of the link
    session.pause(1e-14)
    assert session.clock.now() < 160.2
