"""Our hulls under the real firmware: the autopilot's estimates agree with the hull's motion."""

from __future__ import annotations

import math
import os
import socket
import subprocess
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl import load_vehicle
from sitl.ardupilot_json import HOME, JsonServer, Physics, parameter_text

pytestmark = [pytest.mark.ardupilot, pytest.mark.timeout(120)]

CASES = (("charlie", "ARDUPILOT_ROVER", 200), ("bluerov2", "ARDUPILOT_SUB", 400))


@pytest.mark.parametrize(("name", "binary", "rate"), CASES)
def test_the_autopilot_estimates_the_hulls_heading_and_depth(name: str, binary: str, rate: int, tmp_path: Path) -> None:
    if not os.environ.get(binary):
        pytest.skip(f"{binary} names no ArduPilot binary")
    data = load_vehicle(name)
    (tmp_path / "needed.parm").write_text(parameter_text(data))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ear:
        ear.bind(("127.0.0.1", 0))
        ear.setblocking(False)
        physics = Physics(data)
        server = JsonServer(physics, port=0, patience=20.0)
        firmware = subprocess.Popen(
            [
                os.environ[binary],
                *("--model", "JSON:127.0.0.1", "--sim-port-out", str(server.port), "-I", "39"),
                *("--rate", str(rate), "--speedup", "100", "--home", HOME, "-w"),
                *("--defaults", str(tmp_path / "needed.parm")),
                *("--serial0", f"udpclient:127.0.0.1:{ear.getsockname()[1]}"),
            ],
            cwd=tmp_path,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            yaw, altitude = _listen(server, physics, ear)
        finally:
            firmware.kill()
            firmware.wait()
            server.close()
    assert math.remainder(yaw - physics.craft.plant.state.psi, math.tau) == pytest.approx(0.0, abs=math.radians(5.0))
    assert altitude == pytest.approx(-physics.craft.plant.state.z, abs=0.3)


def _listen(server: JsonServer, physics: Physics, ear: socket.socket) -> tuple[float, float]:
    """Run a minute and return the last heading [rad] and altitude [m] received."""
    parser = mavlink.MAVLink(None, srcSystem=255)
    parser.robust_parsing = True
    heard: dict[str, object] = {}
    requested = False
    while physics.seconds < 60.0:
        server.serve_one()
        try:
            datagram, peer = ear.recvfrom(4096)
        except BlockingIOError:
            continue
        for message in parser.parse_buffer(datagram) or ():
            heard[message.get_type()] = message
        if "HEARTBEAT" in heard and not requested and physics.seconds > 20.0:
            requested = True
            for number in (mavlink.MAVLINK_MSG_ID_ATTITUDE, mavlink.MAVLINK_MSG_ID_VFR_HUD):
                request = mavlink.MAVLink_command_long_message(
                    1, 1, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 0, number, 100000.0, 0, 0, 0, 0, 0
                )
                ear.sendto(request.pack(parser), peer)
    return heard["ATTITUDE"].yaw, heard["VFR_HUD"].alt
