"""Signing and MAVSDK against an unmodified ArduRover. Port 1 obeys every sender, port 2 only signed messages."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import nullcontext

import pytest
from firmware_process import KINDS, ArduPilot, binary_of
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_autotune.errors import CommandDenied, SigningMismatch
from gcs_autotune.link import Parameters, Session, open_craft, open_link
from gcs_autotune.mavlink import SigningKey
from gcs_autotune.mavlink.signing import EPOCH, UNITS_PER_SECOND

pytestmark = [pytest.mark.ardupilot, pytest.mark.timeout(300)]
SECRET = bytes(range(32))
KEY = SigningKey(SECRET)
BACKENDS = ["pymavlink", "mavsdk"]


@pytest.fixture(scope="module")
def boat() -> Iterator[ArduPilot]:
    binary = binary_of(KINDS["rover"])
    if binary is None:
        pytest.skip(f"{KINDS['rover'].variable} is not set")
    with ArduPilot(KINDS["rover"], binary, speedup=1.0) as firmware:
        firmware.witness().close()  # it is up once its second port answers
        yield firmware


def second_port(boat: ArduPilot) -> str:
    return f"tcpout://127.0.0.1:{5762 + 10 * boat.instance}"


def set_key(boat: ArduPilot, secret: bytes) -> None:
    with Session(open_link(boat.uri)) as session:
        session.discover(20.0)
        stamp = round((time.time() - EPOCH) * UNITS_PER_SECOND) if any(secret) else 0
        for _ in range(3):
            session.send(mavlink.MAVLink_setup_signing_message(1, 1, list(secret), stamp))
            session.pause(0.2)


@pytest.fixture(scope="module")
def signing_boat(boat: ArduPilot) -> Iterator[ArduPilot]:
    set_key(boat, SECRET)
    yield boat
    set_key(boat, bytes(32))


@pytest.mark.parametrize("backend", BACKENDS)
def test_full_list_round_trip_and_denied_rate_work_over_both_backends(boat: ArduPilot, backend: str) -> None:
    with Session(open_link(boat.uri, backend=backend)) as session:
        session.discover(20.0)
        parameters = Parameters(session)
        assert len(parameters.read_full()) > 1000
        old = parameters.read("ATC_STR_RAT_P")
        parameters.write("ATC_STR_RAT_P", 0.33)
        assert parameters.read("ATC_STR_RAT_P") == pytest.approx(0.33, rel=1e-6)
        parameters.write("ATC_STR_RAT_P", old)
        craft = open_craft(session)
        takes_any = str(craft.session.vehicle.version).startswith("4.5")  # and sends as fast as its loop goes
        with nullcontext() if takes_any else pytest.raises(CommandDenied):
            craft.commands.command_long(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_ATTITUDE, 1000.0)
        craft.rates.restore()


@pytest.mark.parametrize("backend", BACKENDS)
def test_with_the_key_the_second_port_obeys(signing_boat: ArduPilot, backend: str) -> None:
    with Session(open_link(second_port(signing_boat), backend=backend), signing=KEY) as session:
        session.discover(20.0)
        parameters = Parameters(session)
        before = session.port.refused
        parameters.write("ATC_STR_RAT_I", 0.21)
        assert parameters.read("ATC_STR_RAT_I") == pytest.approx(0.21)
        assert session.port.refused == before


@pytest.mark.parametrize("backend", BACKENDS)
def test_without_the_key_the_error_reports_a_signing_mismatch(signing_boat: ArduPilot, backend: str) -> None:
    with (
        Session(open_link(second_port(signing_boat), backend=backend)) as session,
        pytest.raises(SigningMismatch, match="signs its messages and does not answer"),
    ):
        session.discover(20.0)


def test_with_another_key_no_message_is_accepted(signing_boat: ArduPilot) -> None:
    with (
        Session(open_link(second_port(signing_boat)), signing=SigningKey(b"w" * 32)) as session,
        pytest.raises(SigningMismatch, match="another key"),
    ):
        session.discover(5.0)
