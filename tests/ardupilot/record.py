"""Records what ``replayed.py`` plays back: ``PYTHONPATH=tests/ardupilot python -m record rover`` (or ``sub``).

A recording of an older version gets a name of its own: ``python -m record sub sub-4.6``.

One short session with an unmodified ArduPilot at its own pace: its whole parameter list, every type of request and
answer, and two relay experiments. Needs the environment of the tests marked ``ardupilot``.
"""

from __future__ import annotations

import contextlib
import gzip
import json
import math
import sys
import tempfile
from pathlib import Path

from bare_station import BareStation
from conftest import warm
from firmware_process import KINDS, ArduPilot, binary_of
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_autotune.errors import AutotuneError, ParameterMissing
from gcs_autotune.link import Session, open_craft, open_link
from gcs_autotune.manoeuvres import Envelope, Relay, RelaySettings, Sequencer, restore_on_exit
from gcs_autotune.observer import SilentObserver
from gcs_autotune.trial import Trial

HERE = Path(__file__).parent / "recorded"
RATES = {"ATTITUDE": 25.0, "SERVO_OUTPUT_RAW": 40.0, "LOCAL_POSITION_NED": 5.0, "GLOBAL_POSITION_INT": 5.0}
LADDER = (400.0, 200.0, 100.0, 50.0, 40.0, 25.0, 20.0, 10.0, 5.0, 4.0, 2.0, 1.0)
GAIN = {"rover": "ATC_STR_RAT_P", "sub": "ATC_RAT_YAW_P"}
MESSAGES = (*RATES, "VFR_HUD", "SYS_STATUS", "EKF_STATUS_REPORT", "RC_CHANNELS", "SCALED_PRESSURE2", "WHEEL_DISTANCE")
RELAYS = {"rover": (0.2, 0.3, 0.3), "sub": (0.25, 0.5, 0.0)}
"""Vehicle -> relay outputs of the two experiments, throttle."""


def questions(station: BareStation, kind: str) -> None:
    """Send every request once: parameters, rates up and down the ladder, an unknown mode, arming too early."""
    parameters, name = station.parameters, GAIN[kind]
    parameters.read_full()
    old = parameters.read(name)
    for value in (0.33, 99.0, old):
        parameters.write(name, value)
    with contextlib.suppress(ParameterMissing):
        parameters.read("NO_SUCH_GAIN")
    for message in MESSAGES:
        number = getattr(mavlink, f"MAVLINK_MSG_ID_{message}")
        station.command(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, number)
        for hz in LADDER:
            station.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, float(round(1e6 / hz)))
        station.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, 0.0)
    station.command(mavlink.MAV_CMD_DO_SET_MODE, 1.0, 99.0)
    for mode in (station.firmware.hold_mode, station.firmware.rest_mode, station.firmware.manual_mode):
        station.commands.set_mode(mode)


def relays(session: Session, kind: str) -> list[dict[str, float]]:
    """Fly two relays on heading; return when each began and ended, and with what."""
    craft = open_craft(session, wanted_rates=RATES)
    kept: list[Trial] = []
    *outputs, throttle = RELAYS[kind]
    with restore_on_exit(craft, SilentObserver()):
        craft.arm()
        sequencer = Sequencer(craft, Envelope(heading_excursion=math.inf, cruise=10.0), SilentObserver(), kept.append)
        for output in outputs:
            sequencer.fly(
                Relay(RelaySettings("psi", "N", output=output, throttle=throttle, keep_still=kind == "sub"), "relay")
            )
    craft.rates.restore()
    return [{"from_t": t.meta["from_t"], "to_t": float(t["psi"].t[-1]), "C": t.meta["C"]} for t in kept]


def main(kind: str, name: str = "") -> None:
    """Record one vehicle, as *name* if it is not simply called after its kind."""
    name = name or kind
    binary = binary_of(KINDS[kind])
    assert binary is not None, f"{KINDS[kind].variable} is not set"
    with tempfile.TemporaryDirectory() as folder, ArduPilot(KINDS[kind], binary, speedup=1.0) as firmware:
        warm(firmware)
        log = Path(folder) / "session.tlog"
        with Session(open_link(firmware.uri), tlog=log) as session:
            questions(BareStation(session), kind)
            try:
                flown = relays(session, kind)
            except AutotuneError as error:
                raise SystemExit(f"{kind}: {error}") from error
            version = session.vehicle.version if session.vehicle else ""
        HERE.mkdir(exist_ok=True)
        with gzip.GzipFile(HERE / f"{name}.tlog.gz", "wb", compresslevel=9, mtime=0) as packed:
            packed.write(log.read_bytes())
        (HERE / f"{name}.json").write_text(json.dumps({"version": version, "relays": flown}, indent=1) + "\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
