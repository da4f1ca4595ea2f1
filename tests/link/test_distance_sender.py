"""Distances from a companion computer arrive in the telemetry of its vehicle."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scripted_vehicle import ROV, ScriptedVehicle

from gcs_autotune.firmware import FIRMWARE, read_servo_map
from gcs_autotune.link import DistanceSender, MemoryLink, Parameters, Session
from gcs_autotune.link.vehicle.telemetry import Recorder, Telemetry


class Wire:
    """What a sender writes, kept."""

    def __init__(self) -> None:
        self.data = bytearray()

    def receive(self, data: bytes) -> None:
        self.data += data

    def advance_to(self, t: float) -> bytes:
        return b""


class Pair:
    """A vehicle, and what its companion computer puts on the same link."""

    def __init__(self, vehicle: ScriptedVehicle) -> None:
        self.vehicle, self.wire = vehicle, Wire()
        self.link = MemoryLink(self.wire)
        self.sender = DistanceSender(self.link, 1)

    def receive(self, data: bytes) -> None:
        self.vehicle.receive(data)

    def advance_to(self, t: float) -> bytes:
        arrived = self.vehicle.advance_to(t) + bytes(self.wire.data)
        self.wire.data.clear()
        return arrived

    def send(self, *distances: float) -> None:
        self.sender.wait(self.link.clock.now() + 1.0)
        self.sender.send(distances, 0.1, 1.0)
        self.link.read(0.1)


@pytest.fixture
def pair() -> Pair:
    return Pair(ScriptedVehicle(ROV))


def test_two_distances_of_a_companion_replace_the_autopilots(pair: Pair) -> None:
    session = Session(MemoryLink(pair))
    session.discover()
    telemetry = Telemetry(session, read_servo_map(Parameters(session), FIRMWARE["ardusub"]), Recorder())
    session.pause(1.0)
    reported = mavlink.MAVLink_distance_sensor_message(0, 10, 100, 77, 0, 0, 0, 255)
    pair.vehicle.send(reported)
    session.pause(0.5)
    assert telemetry.value("d") == pytest.approx(0.77)
    pair.send(0.4, 0.456)
    session.pause(0.5)
    pair.vehicle.send(reported)
    session.pause(0.5)
    assert telemetry.value("d") == pytest.approx(0.4)
    assert telemetry.value("d_starboard") == pytest.approx(0.46)
    assert telemetry.distance_t == pytest.approx(telemetry.boot_time, abs=2.0)
    pair.send(math.nan, 1.4)
    session.pause(0.5)
    assert math.isnan(telemetry.value("d"))
    assert math.isnan(telemetry.value("d_starboard"))


def test_a_companion_is_not_mistaken_for_the_vehicle(pair: Pair) -> None:
    pair.send(0.4, 0.4)
    session = Session(MemoryLink(pair))
    assert session.discover().component == 1
