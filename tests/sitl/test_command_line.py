from __future__ import annotations

import signal
import socket

import pytest

from sitl import VEHICLES
from sitl.__main__ import main
from sitl.eeprom import keep_parameters, read_parameters
from tests.sitl.ground import Ground, refusal_of


def test_signal_handlers_are_restored_at_the_end(capsys):
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    assert main(["--list"]) == 0
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == before


def test_the_vehicles_are_listed(capsys):
    assert main(["--list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(VEHICLES)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["chrlie"], "unknown vehicle 'chrlie'; did you mean charlie or charlie-sway or charlie-sensors?"),
        ([], "no vehicle selected. Use one of charlie"),
        (["charlie", "--speedup", "0"], "Use 0.01 to 1000 simulated seconds per second"),
        (["charlie", "--speedup", "nan"], "Use 0.01 to 1000 simulated seconds per second"),
        (["charlie", "--param", "WP_SPEED"], "not NAME=VALUE with a finite number"),
        (["charlie", "--param", "WP_SPEED=fast"], "not NAME=VALUE with a finite number"),
        (["charlie", "--param", "NO_SUCH=1"], "the firmware of charlie has no parameter 'NO_SUCH'"),
        (
            ["charlie", "--listen", "usb:1"],
            "is not a valid address. Start it with one of udp:, udpout:, udpin:, tcp:, tcpin:, serial:",
        ),
    ],
)
def test_a_wrong_command_line_is_explained_in_one_line(arguments, said, capsys):
    assert said in refusal_of(arguments, capsys)


@pytest.mark.parametrize("kind", [socket.SOCK_DGRAM, socket.SOCK_STREAM])
def test_a_port_in_use_is_explained_in_one_line(kind, capsys):
    scheme = "udp" if kind == socket.SOCK_DGRAM else "tcp"
    with socket.socket(socket.AF_INET, kind) as other:
        other.bind(("127.0.0.1", 0))
        if kind == socket.SOCK_STREAM:
            other.listen()
        port = other.getsockname()[1]
        assert main(["charlie", "--listen", f"{scheme}:127.0.0.1:{port}"]) == 3
    error = capsys.readouterr().err
    assert f"cannot listen on 127.0.0.1:{port}: the port is in use" in error
    assert error.count("\n") == 1


def test_an_unknown_option_is_a_usage_error():
    with pytest.raises(SystemExit, match="2"):
        main(["charlie", "--no-such-option"])


def test_written_parameters_persist_after_the_process(tmp_path):
    path = tmp_path / "eeprom.csv"
    first = Ground("charlie")
    keep_parameters(first.vehicle.dialect, path)
    first.set("ATC_STR_ANG_P", 3.5)
    first.set("WP_SPEED", 0.9)
    first.run(0.1)
    second = Ground("charlie", parameters=read_parameters(path))
    assert second.vehicle.parameters["ATC_STR_ANG_P"] == 3.5
    assert second.vehicle.parameters["WP_SPEED"] == first.vehicle.parameters["WP_SPEED"]
    keep_parameters(second.vehicle.dialect, path)
    second.set("ATC_STR_ANG_P", 4.0)
    second.run(0.1)
    assert dict(read_parameters(path)).keys() == {"ATC_STR_ANG_P", "WP_SPEED"}
    assert [p.name for p in tmp_path.iterdir()] == ["eeprom.csv"]


def test_a_damaged_parameter_file_is_a_usage_error_that_names_the_line(tmp_path, capsys):
    path = tmp_path / "eeprom.csv"
    path.write_text("WP_SPEED,1.0\nrubbish\n")
    assert main(["charlie", "--eeprom", str(path)]) == 2
    assert "line 2: 'rubbish' is not NAME,VALUE" in capsys.readouterr().err
