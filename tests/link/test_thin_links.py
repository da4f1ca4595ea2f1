"""A link that is too thin is refused with the number before anything is armed; one just wide enough is fitted."""

from __future__ import annotations

import re
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from scripted_vehicle import ScriptedVehicle

from benchmarks.throttled_pty import ThrottledPty
from gcs_autotune.axes import AXES
from gcs_autotune.craft import Actuate
from gcs_autotune.errors import PreconditionFailed, TelemetryFault
from gcs_autotune.link import MavlinkCraft, MemoryLink, Session, open_craft
from gcs_autotune.link.vehicle.bandwidth import Demand, least
from gcs_autotune.link.vehicle.congestion import _judged, is_queueing
from gcs_autotune.link.vehicle.latency import Latency
from gcs_autotune.workflow.connection import telemetry_rates
from sitl import open_vehicle

WANTED = telemetry_rates(10.0)


@pytest.fixture
def wire(boat: ScriptedVehicle) -> Iterator[Any]:
    """Return what makes a craft over a serial line of so many baud."""
    links: list[ThrottledPty] = []

    def connect(baud: int, axis: str = "heading") -> MavlinkCraft:
        links.append(ThrottledPty(boat, baud))
        session = Session(links[-1])
        session.discover()
        return open_craft(session, wanted_rates=WANTED, first_rates=AXES[axis].rates or None, arm_patience=3.0)

    yield connect
    for link in links:
        link.close()


def test_at_19200_baud_the_required_rates_fit_and_no_queue_remains(wire: Any, boat: ScriptedVehicle) -> None:
    craft = wire(19200)
    assert any("the link carries" in note for note in craft.session.notes)
    craft.arm()
    for k in range(50):
        craft.observe()
        craft.send(Actuate(N=0.3 if k // 10 % 2 else -0.3))
    assert craft.latency.loop < 0.3
    link = craft.session.transport
    assert link.up.longest < 0.5 * link.up.rate
    assert boat.armed


@pytest.mark.parametrize(("baud", "axis"), [(4800, "heading"), (9600, "depth")])
def test_a_downlink_too_slow_is_rejected_on_connection_with_the_required_rate(
    wire: Any, boat: ScriptedVehicle, baud: int, axis: str
) -> None:
    with pytest.raises(TelemetryFault, match="the link is too slow: it carries") as caught:
        wire(baud, axis)
    match = re.search(r"carries (\d+) bytes/s, \w+ an experiment needs at least (?:about )?(\d+)", str(caught.value))
    assert match is not None, caught.value
    carried, needed = map(int, match.groups())
    assert 0.5 * baud / 10 < carried <= 1.05 * baud / 10
    assert carried < needed
    assert "faster link" in str(caught.value)
    assert not boat.armed


@pytest.mark.parametrize(
    ("vehicle", "axis", "baud", "period"),
    [("charlie", "heading", 4800, 3.0), ("charlie", "heading", 1200, 12.0), ("videoray", "depth", 4800, 4.1)],
)
def test_a_line_filled_by_unrequested_streams_is_reported_as_the_cause(
    vehicle: str, axis: str, baud: int, period: float
) -> None:
    """The answers drown: without a look at the line the boat had no rudder, and the ROV no frame."""
    server = open_vehicle(vehicle)
    link = ThrottledPty(server, baud)
    session = Session(link)
    try:
        session.discover()
        with pytest.raises(TelemetryFault, match="the link is too slow: it carries") as caught:
            open_craft(session, wanted_rates=WANTED, first_rates=AXES[axis].rates or None, arm_patience=3.0)
    finally:
        link.close()
    numbers = re.search(
        r"carries (\d+) bytes/s, .* at least about (\d+) \(.* shortest period is ([\d.]+) s", str(caught.value)
    )
    assert numbers is not None, caught.value
    carried, needed, slowest = map(float, numbers.groups())
    assert carried == pytest.approx(baud / 10, rel=0.1)
    assert needed > 800.0
    assert slowest == pytest.approx(period, rel=0.1)
    assert "Nothing was armed" in str(caught.value)


@pytest.mark.parametrize(("baud", "thinned"), [(9600, True), (57600, False)])
def test_sufficient_lines_are_accepted_and_only_the_thin_one_is_reported_full(baud: int, thinned: bool) -> None:
    link = ThrottledPty(open_vehicle("charlie"), baud)
    session = Session(link)
    try:
        session.discover()
        craft = open_craft(session, wanted_rates=WANTED, first_rates=None, arm_patience=3.0)
        assert any("bytes/s and is full" in note for note in session.notes) == thinned
        assert craft.rates.measured["ATTITUDE"] >= 0.9 * (5.0 if thinned else 10.0)
    finally:
        link.close()


def test_a_missing_parameter_is_reported_on_a_line_with_capacity(boat: ScriptedVehicle) -> None:
    for n in range(1, 9):
        boat.parameters[f"SERVO{n}_FUNCTION"] = 0
    with pytest.raises(PreconditionFailed, match="assigned to N"):
        open_craft(Session(MemoryLink(boat)), wanted_rates=WANTED, arm_patience=3.0)


def test_an_uplink_too_slow_is_refused_before_arming_with_its_capacity(boat: ScriptedVehicle, wire: Any) -> None:
    craft = wire(38400)
    craft.session.transport.up.rate = 700.0
    with pytest.raises(TelemetryFault, match="uplink is too slow: it carries") as caught:
        craft.arm()
    carried, needed = map(int, re.findall(r"it carries (\d+) bytes/s, .* needs (\d+)\.", str(caught.value))[0])
    assert carried == pytest.approx(700, rel=0.1)
    assert needed > 800
    assert not boat.armed


def test_an_uplink_with_capacity_for_ten_overrides_a_second_gets_ten(boat: ScriptedVehicle, wire: Any) -> None:
    craft = wire(57600)
    craft.session.transport.up.rate = 1400.0
    craft.arm()
    assert any("overrides are sent 10 times a second" in note for note in craft.session.notes)
    assert boat.armed


def test_a_link_with_a_longer_delay_is_not_reported_as_queueing(boat: ScriptedVehicle) -> None:
    link = MemoryLink(boat)
    craft = open_craft(Session(link), wanted_rates=WANTED, arm_patience=3.0)
    link._delay = 0.4
    craft.session.pause(2.0)
    craft.arm()
    assert boat.armed
    assert not any("bytes/s" in note for note in craft.session.notes)


def test_later_recovery_does_not_hide_a_queue_made_by_the_load() -> None:
    trips = ((0.0, 0.8), (0.2, 0.8), (1.2, 1.5), (1.8, 1.9), (5.0, 0.8))
    latency: Any = SimpleNamespace(trips=lambda since: tuple(trip for trip in trips if trip[0] >= since))
    load = _judged(latency, 0.8, 0.0, 1.0, 2.0, 900.0)
    assert load.grown == pytest.approx(0.7)
    assert not load.is_enough


def test_a_wide_link_keeps_its_full_override_rate(boat: ScriptedVehicle) -> None:
    craft = open_craft(Session(MemoryLink(boat)), wanted_rates=WANTED, arm_patience=3.0)
    craft.arm()
    assert not any("bytes/s" in note for note in craft.session.notes)


def test_an_unsupported_message_does_not_make_the_link_look_full(boat: ScriptedVehicle) -> None:
    craft = open_craft(Session(MemoryLink(boat)), wanted_rates={**WANTED, "SCALED_PRESSURE2": 5.0}, arm_patience=3.0)
    assert craft.rates.measured["SCALED_PRESSURE2"] == 0.0
    assert not any("bytes/s" in note for note in craft.session.notes)


def test_a_queue_is_detected_relative_to_the_fastest_round_trip(boat: ScriptedVehicle) -> None:
    session = Session(MemoryLink(boat))
    session.discover()
    latency = Latency(session)
    for _ in range(3):
        latency.ask()
        session.pause(0.5)
    assert not is_queueing(latency, 0.0)
    latency._trips.append((100.0, latency.quickest + 0.3, 1.0))
    assert is_queueing(latency, 99.0)
    assert not is_queueing(latency, 101.0), "nothing asked, nothing known"


def test_the_minimum_is_the_sum_of_the_floors() -> None:
    assert least([Demand("ATTITUDE", 10.0, 40.0), Demand("VFR_HUD", 5.0, 30.0, needed=2.0)]) == 5.0 * 40 + 2.0 * 30
