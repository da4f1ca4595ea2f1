from __future__ import annotations

from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_autotune.errors import SigningMismatch
from gcs_autotune.link import MemoryLink, Parameters, Session
from gcs_autotune.mavlink import SigningKey
from sitl import open_vehicle
from sitl.__main__ import main
from sitl.mavlink import Server
from sitl.mavlink.signing import demand_signatures, read_key

SECRET = bytes(range(200, 232))
KEY = SigningKey(SECRET)


def demanding() -> Server:
    server = open_vehicle("charlie")
    demand_signatures(server.codec, SECRET)
    return server


def test_messages_signed_with_its_key_are_obeyed() -> None:
    session = Session(MemoryLink(demanding()), signing=KEY)
    session.discover()
    Parameters(session).write("ATC_STR_RAT_P", 0.4)
    assert Parameters(session).read("ATC_STR_RAT_P") == pytest.approx(0.4)


def test_unsigned_or_wrongly_signed_messages_are_rejected() -> None:
    with pytest.raises(SigningMismatch, match="--signing-key"):
        Session(MemoryLink(demanding())).discover()
    with pytest.raises(SigningMismatch, match="another key"):
        Session(MemoryLink(demanding()), signing=SigningKey(b"w" * 32)).discover(timeout=3.0)


def test_a_key_is_set_and_removed_by_message_but_not_while_armed() -> None:
    server = open_vehicle("charlie")
    session = Session(MemoryLink(server))
    session.discover()
    server.vehicle.autopilot.armed = True
    session.send(mavlink.MAVLink_setup_signing_message(1, 1, list(SECRET), 0))
    session.pause(0.5)
    assert server.codec.signing.secret_key is None
    assert [t.text for t in session.texts if "signing" in t.text]
    server.vehicle.autopilot.armed = False
    session.send(mavlink.MAVLink_setup_signing_message(1, 1, list(SECRET), 0))
    session.pause(0.5)
    owner = Session(MemoryLink(server), signing=KEY)
    owner.discover()
    owner.send(mavlink.MAVLink_setup_signing_message(1, 1, [0] * 32, 0))
    owner.pause(0.3)
    assert server.codec.signing.secret_key is None


@pytest.mark.parametrize("data", [SECRET, b"correct horse\n", b"x" * 32, b"x" * 31 + b"\n", "gr\u00fcn\r\n".encode()])
def test_vehicle_and_tuner_read_the_same_key_from_the_same_file(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "key").write_bytes(data)
    assert read_key(tmp_path / "key") == SigningKey.read(tmp_path / "key").secret


def test_a_missing_or_empty_key_file_is_a_usage_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["charlie", "--signing-key", str(tmp_path / "none")]) == 2
    (tmp_path / "empty").write_bytes(b"\n")
    assert main(["charlie", "--signing-key", str(tmp_path / "empty")]) == 2
    assert "is empty" in capsys.readouterr().err
