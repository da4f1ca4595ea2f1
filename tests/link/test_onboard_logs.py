"""Logs on the vehicle's card, fetched over the link: whole, whatever is lost on the way, or not at all."""

from __future__ import annotations

import gzip
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scripted_vehicle import ScriptedVehicle

from gcs_autotune.cli import main
from gcs_autotune.errors import NoReply, OperatorStopped, UsageError
from gcs_autotune.link import MemoryLink, Session, fetch_log, list_logs
from gcs_autotune.observer import SilentObserver
from gcs_autotune.workflow import Connection, Unattended, fetch_onboard_log

FLOWN = Path(__file__).parents[1] / "logs" / "flown" / "charlie.bin.gz"
LOGS = {3: b"an older one", 7: gzip.decompress(FLOWN.read_bytes())[:40_000]}


def with_a_card(boat: ScriptedVehicle, logs: dict[int, bytes]) -> ScriptedVehicle:
    def tell(message) -> None:
        for number, data in logs.items():
            boat.send(mavlink.MAVLink_log_entry_message(number, len(logs), max(logs), 1_790_000_000, len(data)))
        if not logs:
            boat.send(mavlink.MAVLink_log_entry_message(0, 0, 0, 0, 0))

    def send(message) -> None:
        data = logs[message.id]
        for offset in range(message.ofs, min(message.ofs + message.count, len(data)), 90):
            piece = data[offset : min(offset + 90, message.ofs + message.count)]
            boat.send(mavlink.MAVLink_log_data_message(message.id, offset, len(piece), list(piece.ljust(90, b"\0"))))

    boat.on["LOG_REQUEST_LIST"], boat.on["LOG_REQUEST_DATA"] = tell, send
    return boat


def session_with(boat: ScriptedVehicle, **link) -> Session:
    session = Session(MemoryLink(boat, **link))
    session.discover()
    return session


@pytest.mark.parametrize("loss", [0.0, 0.1])
def test_a_log_is_complete_even_when_frames_are_lost(boat: ScriptedVehicle, loss: float) -> None:
    session = session_with(with_a_card(boat, LOGS), loss=loss, seed=3)
    logs = list_logs(session)
    assert [(log.number, log.size) for log in logs] == [(n, len(data)) for n, data in LOGS.items()]
    reported: list[int] = []
    assert fetch_log(session, logs[-1], lambda done, whole: reported.append(done)) == LOGS[7]
    assert reported == sorted(reported)
    session.pause(0.2)
    assert loss or boat.count("LOG_REQUEST_END") == 1


def test_an_empty_card_has_no_logs(boat: ScriptedVehicle) -> None:
    assert list_logs(session_with(with_a_card(boat, {}))) == ()


def test_a_vehicle_that_does_not_list_or_stops_sending_logs_is_reported(boat: ScriptedVehicle) -> None:
    with pytest.raises(NoReply, match=r"did not list its logs.* only when disarmed"):
        list_logs(session_with(boat))
    session = session_with(with_a_card(boat, LOGS))
    (*_, log) = list_logs(session)
    boat.on["LOG_REQUEST_DATA"] = lambda _: None
    with pytest.raises(NoReply, match="stopped sending log 7"):
        fetch_log(session, log)
    session.pause(0.2)
    assert boat.count("LOG_REQUEST_END") == 1


def connection_to(boat: ScriptedVehicle) -> Connection:
    return Connection("memory", opened=MemoryLink(boat))


def test_the_newest_log_is_fetched_unless_another_is_requested(boat: ScriptedVehicle) -> None:
    with_a_card(boat, LOGS)
    for number, expected in ((None, 7), (3, 3), (0, None)):
        logs, log, data = fetch_onboard_log(connection_to(boat), number, Unattended(), SilentObserver())
        assert len(logs) == 2
        assert (None if log is None else log.number) == expected
        assert data == (b"" if expected is None else LOGS[expected])
    with pytest.raises(UsageError, match="Available: 3, 7"):
        fetch_onboard_log(connection_to(boat), 9, Unattended(), SilentObserver())


def test_the_operator_can_stop_a_log_download(boat: ScriptedVehicle) -> None:
    class Hasty(Unattended):
        def stop_requested(self) -> bool:
            return boat.count("LOG_REQUEST_DATA") > 1

    with_a_card(boat, LOGS)
    with pytest.raises(OperatorStopped):
        fetch_onboard_log(connection_to(boat), None, Hasty(), SilentObserver())


def test_logs_fetch_reports_that_a_simulated_vehicle_keeps_no_logs(capsys, tmp_path) -> None:
    out = tmp_path / "log.bin"
    assert main(["logs", "fetch", "--connect", "sitl:charlie", "--out", str(out)]) == 3
    assert "did not list its logs" in capsys.readouterr().err
    assert not out.exists()
