"""Vehicles for testing firmware behaviour: ArduPilot's own simulator (marked ``ardupilot``) and ours."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from bare_station import BareStation
from firmware_process import KINDS, ArduPilot, Kind, Witness, binary_of

from gcs_autotune.link import MemoryLink, Session, open_link
from sitl import open_vehicle

OURS = {"rover": "charlie", "sub": "falcon"}
NAMES = ("4.6", "4.7-dev")
WARM_UP = 40.0
"""Times real time, until the estimator has a position."""

_MARKS = [pytest.mark.ardupilot, pytest.mark.timeout(600)]


def started(kind: Kind, **options: object) -> ArduPilot:
    """Return a firmware just started, or skip when there is none."""
    binary = binary_of(kind)
    if binary is None:
        pytest.skip(f"{kind.variable} is not set: set it to ArduPilot's binary (see docs/ardupilot.md)")
    return ArduPilot(kind, binary, **options)  # type: ignore[arg-type]


def warm(firmware: ArduPilot, seconds: float = 60.0) -> None:
    """Let it find its position at high speed, then slow down to where a loop can be closed over the link."""
    witness = firmware.witness()
    try:
        witness.set_parameter("SIM_SPEEDUP", WARM_UP)
        witness.ask_for("EKF_STATUS_REPORT", 5.0)
        witness.wait("EKF_STATUS_REPORT", lambda m: bool(m.flags & 1 << 4), seconds)
        witness.set_parameter("SIM_SPEEDUP", firmware.speedup)
    finally:
        witness.close()


@pytest.fixture(scope="module")
def rover() -> Iterator[ArduPilot]:
    """An unmodified ArduRover with its stock motorboat, its position found."""
    with started(KINDS["rover"]) as firmware:
        warm(firmware)
        yield firmware


@pytest.fixture(scope="module")
def sub() -> Iterator[ArduPilot]:
    """An unmodified ArduSub with its stock vectored ROV, its position found."""
    with started(KINDS["sub"]) as firmware:
        warm(firmware)
        yield firmware


@pytest.fixture
def witness(request: pytest.FixtureRequest) -> Iterator[Witness]:
    """A second ground station on the firmware of this module (``rover`` or ``sub``, whichever the test asks for)."""
    name = "rover" if "rover" in request.fixturenames else "sub"
    witness: Witness = request.getfixturevalue(name).witness()
    yield witness
    witness.close()


def _both(kind: str) -> list[object]:
    """Return our vehicle of that kind, as two generations know it, and ArduPilot's, as fixture parameters."""
    return [
        *(pytest.param((kind, names), id=f"our-{kind}-{names}") for names in NAMES),
        pytest.param((kind, "ardupilot"), id=f"ardupilot-{kind}", marks=_MARKS),
    ]


@pytest.fixture(params=_both("rover"))
def boat(request: pytest.FixtureRequest) -> Iterator[BareStation]:
    """A boat, ours or ArduPilot's, with its sticks in our hands and outputs at 40 Hz."""
    yield from _station_of(request)


@pytest.fixture(params=_both("sub"))
def rov(request: pytest.FixtureRequest) -> Iterator[BareStation]:
    """An ROV, ours or ArduPilot's."""
    yield from _station_of(request)


@pytest.fixture(params=_both("rover") + _both("sub"))
def craft(request: pytest.FixtureRequest) -> Iterator[BareStation]:
    """A boat or an ROV, ours or ArduPilot's."""
    yield from _station_of(request)


def _station_of(request: pytest.FixtureRequest) -> Iterator[BareStation]:
    kind, whose = request.param
    options = getattr(request.node.get_closest_marker("boot"), "kwargs", {})
    if whose in NAMES:
        ours = open_vehicle(OURS[kind], seed=1, names=whose, parameters={"SIM_RC_FAIL": 0, **options})
        with Session(MemoryLink(ours, quantum=0.02)) as session:
            yield from _on_session(session)
    elif options:
        with started(KINDS[kind], extra=options) as firmware:
            warm(firmware)
            yield from _aboard(firmware)
    else:
        yield from _aboard(request.getfixturevalue(kind))


def _aboard(firmware: ArduPilot) -> Iterator[BareStation]:
    with Session(open_link(firmware.uri)) as session:
        yield from _on_session(session)


def _on_session(session: Session) -> Iterator[BareStation]:
    station = BareStation(session)
    station.rates.request({"SERVO_OUTPUT_RAW": 40.0, "ATTITUDE": 40.0})
    station.run(4.0 if session.transport.is_simulated or isinstance(session.transport, MemoryLink) else 0.5)
    yield station
    station.leave()
