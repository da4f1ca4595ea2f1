"""Connecting, on stand-ins: whom the vehicle obeys, how it is wired, and what a failure leaves behind."""

from __future__ import annotations

from collections.abc import Iterable
from types import SimpleNamespace
from typing import Any

import pytest

from gcs_autotune.clock import ManualClock
from gcs_autotune.errors import NoReply, ParameterMissing, TelemetryFault, WrongVehicle
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.link import open_craft
from gcs_autotune.link.vehicle import handshake
from gcs_autotune.link.vehicle.handshake import (
    _firmware,
    _follow_control_tick,
    _note_late_rates,
    _read_config,
    _with_frame,
)
from gcs_autotune.link.vehicle.watchdog import gyro_lag
from gcs_autotune.mavlink import VehicleIdentity

BOAT = VehicleIdentity(system=1, component=1, autopilot=3, vehicle_type=11)
ROVER, SUB = FIRMWARE["ardurover"], FIRMWARE["ardusub"]


class Held:
    """Parameters of a vehicle that has *values*."""

    def __init__(self, values: dict[str, float]) -> None:
        self.values = values
        self.asked: list[str] = []

    def read(self, name: str) -> float:
        return self.values[name]

    def read_first(self, names: Iterable[str]) -> tuple[str, float]:
        for name in names:
            if name in self.values:
                return name, self.values[name]
        raise ParameterMissing("none of them", name="X")

    def read_existing(self, names: Iterable[str], *, as_is: bool = False) -> dict[str, float]:
        expected = list(names)
        self.asked += expected
        return {n: self.values[n] for n in expected if n in self.values}


def session(**changes: Any) -> Any:
    base = {"notes": [], "port": SimpleNamespace(system=255), "vehicle": BOAT, "lossy": str}
    return SimpleNamespace(**{**base, **changes})


def test_a_vehicle_gets_its_firmware_name_and_its_frame() -> None:
    parameters: Any = Held({"FRAME_CONFIG": 2.0})
    sub = _with_frame(session(), parameters, SUB)
    assert (sub.firmware, sub.frame, sub.system) == (SUB.name, 2 if SUB.frame_parameter == "FRAME_CONFIG" else None, 1)
    boat = _with_frame(session(), parameters, ROVER)
    assert (boat.firmware, boat.frame) == (ROVER.name, None if not ROVER.frame_parameter else 2)


def test_an_unsupported_autopilot_or_vehicle_type_is_refused() -> None:
    assert _firmware(BOAT) is ROVER
    strangers = (VehicleIdentity(7, 1, 12, 11), "PX4"), (VehicleIdentity(7, 1, 3, 2), "ARDUPILOTMEGA")
    for stranger, autopilot in strangers:
        with pytest.raises(WrongVehicle, match=rf"autopilot {autopilot} \(system 7\) is not supported"):
            _firmware(stranger)


@pytest.mark.parametrize(("lag", "is_noted"), [(0.029, False), (0.03, True), (0.045, True)])
def test_a_late_gyro_is_noted_from_thirty_milliseconds_on(lag: float, is_noted: bool) -> None:
    here = session()
    _note_late_rates(here, lag)
    assert bool(here.notes) is is_noted
    assert not is_noted or f"{1e3 * lag:.0f} ms" in here.notes[0]


@pytest.fixture
def wired(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(handshake, "read_override_map", lambda parameters, firmware: "overrides")
    monkeypatch.setattr(handshake, "read_servo_map", lambda parameters, firmware: "servos")
    monkeypatch.setattr(handshake, "read_rate_stick", lambda parameters, firmware: "stick")


GCS = {"SYSID_MYGCS": 252.0}


@pytest.mark.parametrize(
    ("values", "full", "period", "cutoff"),
    [
        ({"WP_SPEED": 2.5, "SCHED_LOOP_RATE": 50.0, "INS_GYRO_FILTER": 4.0}, 2.5, 0.02, 4.0),
        ({"SCHED_LOOP_RATE": 0.5}, 0.0, 2.0, 0.0),
        ({"SCHED_LOOP_RATE": 0.0}, 0.0, 0.0, 0.0),
        ({}, 0.0, 0.0, 0.0),
    ],
)
def test_wiring_speed_and_loop_period_of_a_boat_are_read(
    wired: None, values: dict[str, float], full: float, period: float, cutoff: float
) -> None:
    here = session()
    parameters: Any = Held({**GCS, **values})
    config = _read_config(here, parameters, ROVER)
    assert (config.overrides, config.servos, config.rate_stick) == ("overrides", "servos", "stick")
    assert (config.full_speed, config.loop_period) == (full, period)
    assert config.rate_lag == gyro_lag(cutoff)
    assert here.port.system == 252
    assert here.vehicle.firmware == ROVER.name


def test_the_speed_of_a_boat_is_not_read_from_an_rov(wired: None) -> None:
    parameters: Any = Held({**GCS, "WP_SPEED": 2.5, SUB.frame_parameter: 1.0})
    assert _read_config(session(), parameters, SUB).full_speed == 0.0
    assert "WP_SPEED" not in parameters.asked


def test_an_unsupported_vehicle_is_refused_before_its_id_is_adopted(wired: None) -> None:
    case = next(iter(ROVER.unsuited))
    here = session()
    for value in range(1, 9):
        parameters: Any = Held({**GCS, case.parameter: float(value)})
        if ROVER.misfit({case.parameter: float(value)}):
            with pytest.raises(WrongVehicle, match="Nothing was written or armed"):
                _read_config(here, parameters, ROVER)
            assert here.port.system == 255
            return
    pytest.fail("no value of it is unsuited")


class Steps:
    """What is done with a craft, in order."""

    def __init__(self, *, fails: str = "", granted: float = 10.0, radio: str = "", ticks: bool = True) -> None:
        self.done: list[Any] = []
        self.fails, self.radio = fails, radio
        self.granted = {"ATTITUDE": SimpleNamespace(granted=granted)} if granted else {}
        self.telemetry = SimpleNamespace(ticks=3)
        self.clock = ManualClock(20.0)
        self.ticks = ticks
        self.transport = SimpleNamespace(follow_tick=lambda at, period: self.done.append(("follow", at, period)))
        self.session = session(wait_for=self.wait_for, discover=self.discover, transport=self.transport)

    def discover(self, timeout: float, system_id: int | None) -> VehicleIdentity:
        self.done.append(("discover", timeout, system_id))
        return BOAT

    def wait_for(self, condition: Any, timeout: float) -> Any:
        assert condition() is None, "the tick that was there does not count"
        self.done.append(("wait", timeout))
        self.clock.advance(0.07)
        self.telemetry.ticks += self.ticks
        return condition()

    def connect(self, monkeypatch: pytest.MonkeyPatch, **options: Any) -> Any:
        steps = self

        class Rates:
            granted = steps.granted

            def __init__(self, *given: Any) -> None:
                steps.done.append(("rates", given[2]))

            def __getattr__(self, name: str) -> Any:
                def act(*given: Any) -> None:
                    steps.done.append((name, *given))
                    if name == steps.fails:
                        raise TelemetryFault("too slow")

                return act

        craft = SimpleNamespace(
            latency="latency", keep_rates=lambda: steps.done.append(("keep",)), learn_failsafes=lambda: None,
            session=self.session,
            telemetry=self.telemetry, clock=self.clock, other_stations=SimpleNamespace(radio=self.radio),
        )  # fmt: skip
        config = SimpleNamespace(loop_period=0.02, rate_lag=0.05)
        monkeypatch.setattr(handshake, "Rates", Rates)
        monkeypatch.setattr(handshake, "Parameters", lambda session: "parameters")
        monkeypatch.setattr(handshake, "Commands", lambda session, firmware: "commands")
        monkeypatch.setattr(handshake, "MavlinkCraft", lambda *given, **rest: craft)
        monkeypatch.setattr(handshake, "_read_config", lambda *given: config)
        return open_craft(self.session, **options)


WANTED, NEEDED = {"ATTITUDE": 10.0}, {"ATTITUDE": 5.0}


def test_rates_are_requested_fitted_raised_and_kept_before_the_tick_is_followed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    steps = Steps(radio="SiK")
    steps.connect(
        monkeypatch, wanted_rates=WANTED, needed_rates=NEEDED, spare_rates={"ATTITUDE": 25.0}, first_rates=WANTED
    )
    assert steps.done == [
        ("rates", WANTED),
        ("request", WANTED),
        ("fit", NEEDED, 0.02, "latency"),
        ("quicken", {"ATTITUDE": 25.0}, 0.02, "latency"),
        ("keep",),
        ("follow", 0.0, 0.01),
        ("wait", 0.2),
        ("follow", pytest.approx(20.07), 0.1),
    ]
    late, radio = steps.session.notes
    assert "by 50 ms" in late
    assert radio == "telemetry radio: SiK"
    bare = Steps()
    bare.connect(monkeypatch)
    assert ("quicken", {}, 0.02, "latency") in bare.done
    assert len(bare.session.notes) == 1


def test_a_vehicle_already_discovered_is_not_discovered_again(monkeypatch: pytest.MonkeyPatch) -> None:
    known = Steps()
    known.connect(monkeypatch, timeout=4.0, system_id=9)
    assert known.done[0][0] == "rates"
    new = Steps()
    new.session.vehicle = None
    new.connect(monkeypatch, timeout=4.0, system_id=9)
    assert new.done[0] == ("discover", 4.0, 9)


@pytest.mark.parametrize("fails", ["request", "fit", "quicken"])
def test_rates_are_restored_when_connecting_fails(monkeypatch: pytest.MonkeyPatch, fails: str) -> None:
    steps = Steps(fails=fails)
    with pytest.raises(TelemetryFault):
        steps.connect(monkeypatch)
    assert steps.done[-1] == ("restore",)
    assert ("keep",) not in steps.done


def test_without_an_attitude_rate_no_tick_is_followed() -> None:
    steps: Any = Steps()
    _follow_control_tick(steps, 0.0)
    assert steps.done == []
    _follow_control_tick(steps, 0.5)
    assert steps.done[-1] == ("follow", pytest.approx(20.07), 2.0)


@pytest.mark.parametrize("error", [ParameterMissing("none", name="P"), NoReply("nothing")], ids=repr)
def test_a_vehicle_that_does_not_answer_causes_a_check_for_a_full_link(
    monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    looked: list[Any] = []
    steps = Steps()

    def refuse(*_: Any) -> None:
        raise error

    def connect() -> None:
        monkeypatch.setattr(handshake, "_read_config", refuse)
        monkeypatch.setattr(handshake, "check_answers_come", lambda *given: looked.append(given))
        monkeypatch.setattr(handshake, "Parameters", lambda session: "parameters")
        monkeypatch.setattr(handshake, "Commands", lambda session, firmware: "commands")
        open_craft(steps.session, wanted_rates=WANTED, first_rates=NEEDED)

    with pytest.raises(type(error)):
        connect()
    assert looked == [(steps.session, WANTED, NEEDED, error)]
