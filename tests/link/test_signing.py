from __future__ import annotations

import copy
import hashlib
import io
import pickle
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scripted_vehicle import ScriptedVehicle

from gcs_autotune.errors import BadFile, LinkLost, SigningMismatch, UsageError
from gcs_autotune.link import MemoryLink, Parameters, Session
from gcs_autotune.mavlink import LINK_ID, Framer, Packer, Refusal, Signer, SigningKey, StampStore, read_tlog
from gcs_autotune.mavlink.signing import EPOCH, UNITS_PER_SECOND

SECRET = bytes(range(100, 132))
NOW = 1_800_000_000.0
KEY = SigningKey(SECRET, "test")


def stamp(seconds: float = NOW) -> int:
    return round((seconds - EPOCH) * UNITS_PER_SECOND)


def heartbeat() -> Any:
    return mavlink.MAVLink_heartbeat_message(11, 3, 0, 0, 4, 3)


def signed(message: Any = None, *, at: int = 0, secret: bytes = SECRET, link: int = 0, system: int = 1) -> bytes:
    """What the reference implementation makes of it."""
    mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=1)
    mav.signing.secret_key, mav.signing.sign_outgoing = secret, True
    mav.signing.timestamp, mav.signing.link_id = at or stamp(), link
    return bytes((message or heartbeat()).pack(mav))


def verdicts(*raws: bytes, signer: Signer | None = None) -> list[bool]:
    judge = signer or Signer(KEY, lambda: NOW)
    return [judge.believes(frame) for raw in raws for frame in Framer().feed(raw)]


# --- what is believed ----------------------------------------------------------------------------------------


def test_signatures_agree_with_the_reference_implementation_both_ways() -> None:
    assert verdicts(signed()) == [True]
    packer = Packer(255, 190)
    packer.sign_with(SECRET, LINK_ID, Signer(KEY, lambda: NOW).next_stamp)
    theirs = mavlink.MAVLink(None)
    theirs.signing.secret_key = SECRET
    theirs.signing.timestamp = stamp()
    for _ in range(3):
        frame = packer.pack(heartbeat())
        assert theirs.decode(bytearray(frame)).get_signed()
        assert frame[-13] == LINK_ID
    assert theirs.signing.stream_timestamps == {(LINK_ID, 255, 190): stamp() + 2}


def test_unsigned_wrongly_signed_old_and_replayed_frames_are_refused_with_their_reason() -> None:
    signer = Signer(KEY, lambda: NOW)
    mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    plain, old_form = heartbeat().pack(mav), heartbeat().pack(mav, force_mavlink1=True)
    assert verdicts(plain, old_form, signer=signer) == [False, False]
    assert verdicts(signed(secret=b"x" * 32), signer=signer) == [False]
    assert verdicts(signed(at=stamp(NOW - 61))) == [False]
    assert verdicts(signed(at=stamp(NOW - 59)), signed(at=stamp(NOW - 59)), signer=signer) == [True, False]
    assert verdicts(signed(at=stamp(NOW - 59) - 1), signed(at=stamp(NOW - 59) + 1), signer=signer) == [False, True]
    assert signer.refused == {Refusal.UNSIGNED: 2, Refusal.WRONG: 1, Refusal.OLD: 2}


def test_a_forged_timestamp_does_not_lock_the_vehicle_out() -> None:
    forged = signed(at=2**48 - 1, secret=b"x" * 32)
    assert verdicts(forged, signed()) == [False, True]


def test_each_stream_has_its_own_timestamp() -> None:
    later, earlier = stamp(NOW + 5), stamp(NOW - 5)
    frames = [signed(at=later), signed(at=earlier, link=1), signed(at=earlier, system=2), signed(at=earlier)]
    assert verdicts(*frames) == [True, True, True, False]


def test_only_a_radio_status_needs_no_signature() -> None:
    mav = mavlink.MAVLink(None, srcSystem=51, srcComponent=68)
    radio = mavlink.MAVLink_radio_status_message(200, 190, 100, 10, 10, 0, 0).pack(mav)
    assert verdicts(radio) == [True]


@settings(max_examples=80, deadline=None)
@given(st.integers(0, len(signed()) - 1), st.integers(1, 255))
def test_no_changed_byte_is_accepted(at: int, change: int) -> None:
    frame = bytearray(signed())
    frame[at] ^= change
    framer, judge = Framer(), Signer(KEY, lambda: NOW)
    assert not any(judge.believes(f) for f in (*framer.feed(bytes(frame)), *framer.flush()))


# --- the time we sign with -----------------------------------------------------------------------------------


def test_our_timestamp_only_grows_even_if_the_clock_is_set_back(tmp_path: Path) -> None:
    clock = NOW
    signer = Signer(KEY, lambda: clock, StampStore(tmp_path))
    first = [signer.next_stamp() for _ in range(3)]
    assert first == [stamp(), stamp() + 1, stamp() + 2]
    clock = NOW - 1e6
    assert signer.next_stamp() == stamp() + 3
    again = Signer(KEY, lambda: clock, StampStore(tmp_path))  # killed without a word, a month earlier by the clock
    assert again.next_stamp() > stamp() + 3
    clock = NOW + 1e6
    assert again.next_stamp() == stamp(NOW + 1e6)


def test_a_later_timestamp_of_the_vehicle_is_adopted() -> None:
    signer = Signer(KEY, lambda: NOW)
    assert verdicts(signed(at=stamp(NOW + 7200)), signer=signer) == [True]
    assert signer.next_stamp() == stamp(NOW + 7200) + 1


def test_a_timestamp_that_cannot_be_stored_is_reported_and_is_not_fatal(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("a file where the folder should be")
    store = StampStore(tmp_path / "taken" / "folder")
    assert Signer(KEY, lambda: NOW, store).next_stamp() == stamp()
    assert "cannot be stored" in store.trouble
    (tmp_path / "signing-time").write_text("garbage")
    assert "cannot be stored" in StampStore(tmp_path).trouble


# --- the key -------------------------------------------------------------------------------------------------


def test_a_passphrase_gives_the_same_key_as_in_other_ground_stations(tmp_path: Path) -> None:
    """SHA-256 of the text; the value is that of `printf %s 'correct horse' | sha256sum`."""
    expected = bytes.fromhex("4104d36f8da2c254349f85836793ebe029e0c957063a34c91c2e9203187b5631")
    for text in ("correct horse", "correct horse\n", "correct horse\r\n"):
        (tmp_path / "key").write_bytes(text.encode())
        assert SigningKey.read(tmp_path / "key").secret == expected
    (tmp_path / "key").write_bytes(SECRET[:-1] + b"\xff")
    assert SigningKey.read(tmp_path / "key").secret == SECRET[:-1] + b"\xff"
    (tmp_path / "key").write_text("thirty-two characters of passwd!")
    assert SigningKey.read(tmp_path / "key").secret == hashlib.sha256(b"thirty-two characters of passwd!").digest()


@pytest.mark.parametrize("data", [b"", b"\n", b"two\nlines", b"\xff\xfe\x00"])
def test_a_file_without_a_key_is_refused(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "key").write_bytes(data)
    with pytest.raises(BadFile, match="32 bytes"):
        SigningKey.read(tmp_path / "key")
    with pytest.raises(BadFile, match="cannot be read"):
        SigningKey.read(tmp_path / "none")
    with pytest.raises(UsageError, match="empty"):
        SigningKey.from_passphrase("")


def test_a_key_is_never_shown_or_stored() -> None:
    key = SigningKey.from_passphrase("hunter2")
    for shown in (repr(key), str(key), f"{key}", repr([key]), key.origin):
        assert "hunter2" not in shown and key.secret.hex() not in shown and repr(key.secret) not in shown
    for store in (lambda: pickle.dump(key, io.BytesIO()), lambda: copy.deepcopy(key)):
        with pytest.raises(TypeError, match="must not be stored"):
            store()


# --- a conversation ------------------------------------------------------------------------------------------


def demanding(boat: ScriptedVehicle, secret: bytes = SECRET) -> ScriptedVehicle:
    """Make *boat* a vehicle that signs, and obeys only who signs; its clock is years behind, as without GPS."""
    boat.mav.signing.secret_key, boat.mav.signing.sign_outgoing = secret, True
    boat.mav.signing.timestamp = 1000
    return boat


def test_two_signing_ends_communicate_and_refuse_nothing_once_their_clocks_agree(tmp_path: Path) -> None:
    boat = demanding(ScriptedVehicle())
    with Session(MemoryLink(boat), signing=KEY, tlog=tmp_path / "a.tlog") as session:
        session.discover()
        Parameters(session).write("ATC_STR_RAT_P", 0.5)
        refused = session.port.refused
        session.pause(5.0)
    assert boat.parameters["ATC_STR_RAT_P"] == 0.5
    assert session.port.refused == refused < 20
    assert SECRET not in (tmp_path / "a.tlog").read_bytes()
    assert {r.frame.raw[2] for r in read_tlog(tmp_path / "a.tlog")} == {1}


def test_a_signing_vehicle_that_does_not_answer_is_explained() -> None:
    with pytest.raises(SigningMismatch, match=r"system 1 .* signs .*--signing-key"):
        Session(MemoryLink(demanding(ScriptedVehicle()))).discover()


def test_a_signing_vehicle_that_accepts_unsigned_messages_is_noted() -> None:
    boat = demanding(ScriptedVehicle())
    boat.mav.signing.allow_unsigned_callback = lambda *_: True
    session = Session(MemoryLink(boat))
    session.discover()
    assert any("accepts unsigned messages" in note for note in session.notes)


def test_another_key_and_no_key_aboard_are_distinguished() -> None:
    with pytest.raises(SigningMismatch, match=r"signed with another key.*differs from the vehicle's key"):
        Session(MemoryLink(demanding(ScriptedVehicle(), b"o" * 32)), signing=KEY).discover(timeout=3.0)
    with pytest.raises(SigningMismatch, match=r"not signed.*signing setup.*or omit --signing-key"):
        Session(MemoryLink(ScriptedVehicle()), signing=KEY).discover(timeout=3.0)


def test_forged_messages_with_the_vehicles_ids_change_nothing_and_are_counted() -> None:
    boat = demanding(ScriptedVehicle())
    session = Session(MemoryLink(boat), signing=KEY)
    session.discover()
    parameters = Parameters(session)
    before = session.port.refused
    for message in (
        mavlink.MAVLink_heartbeat_message(11, 3, 128, 4, 4, 3),
        mavlink.MAVLink_param_value_message(b"ATC_STR_RAT_P", 66.0, 9, 100, 3),
    ):
        boat.send_as(1, 1, message)
    session.pause(0.5)
    assert (session.armed, session.custom_mode) == (False, 0)
    assert session.port.refused == before + 2
    assert parameters.read("ATC_STR_RAT_P") != 66.0
    demanding(boat, b"n" * 32)
    with pytest.raises(LinkLost, match=r"Lost contact with .*\(5.*refused: \d+ messages signed with another key"):
        session.pause(30.0)


def test_a_key_sent_to_the_vehicle_is_never_logged(tmp_path: Path, boat: ScriptedVehicle) -> None:
    setup = mavlink.MAVLink_setup_signing_message(1, 1, list(SECRET), 0)
    with Session(MemoryLink(boat), tlog=tmp_path / "a.tlog") as session:
        session.discover()
        session.send(setup)
        boat.send_as(254, 190, setup)
        session.pause(1.0)
    assert SECRET not in (tmp_path / "a.tlog").read_bytes()
    assert boat.count("SETUP_SIGNING") == 1


def test_the_first_timestamp_is_one_and_each_is_later_than_the_last() -> None:
    signer = Signer(SigningKey(bytes(32)), lambda: EPOCH)
    assert [signer.next_stamp() for _ in range(3)] == [1, 2, 3]
