"""Turn an open link into a craft: find the vehicle, read its configuration and request telemetry. Recognise it
later.

A vehicle is recognised by the unique id of its board, else by parameters that are very unlikely to be the same on two
vehicles: calibration results and detected sensors. No tuning changes these.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from gcs_autotune.errors import (
    AutotuneError,
    NoReply,
    OutputsUnassigned,
    ParameterMissing,
    PreconditionFailed,
    TelemetryFault,
    WrongVehicle,
)
from gcs_autotune.firmware import FIRMWARE, Firmware, ServoMap, firmware_for, read_servo_map
from gcs_autotune.link.parameters.client import Parameters, same_float32
from gcs_autotune.link.session import Session
from gcs_autotune.link.vehicle.commands import Commands
from gcs_autotune.link.vehicle.congestion import check_answers_come
from gcs_autotune.link.vehicle.mavlink_craft import MavlinkCraft
from gcs_autotune.link.vehicle.rates import Rates
from gcs_autotune.link.vehicle.vehicle_config import VehicleConfig, read_override_map, read_rate_stick
from gcs_autotune.link.vehicle.watchdog import gyro_lag
from gcs_autotune.mavlink import VehicleIdentity, enum_name, type_name

__all__ = ["FINGERPRINT", "NEEDED_RATES", "WANTED_RATES", "difference", "fingerprint_of", "open_craft"]

FINGERPRINT = (
    "INS_ACCOFFS_X",
    "INS_ACCOFFS_Y",
    "INS_ACC_ID",
    "COMPASS_DEV_ID",
    "BARO1_DEVID",
    "FRAME_CLASS",
    "FRAME_CONFIG",
    "CRUISE_SPEED",
    "RC1_TRIM",
    "RC3_TRIM",
    "SERVO1_TRIM",
    "SERVO1_FUNCTION",
    "SERVO3_FUNCTION",
    "BATT_CAPACITY",
)
"""Names of the parameters by which a vehicle is recognised: accelerometer calibration and device ids of the board, then
settings made once by its owner. Project choice.
"""

_SAME_KIND = ("system", "autopilot", "vehicle_type")


def fingerprint_of(parameters: Parameters) -> dict[str, float]:
    """Return name -> value of the parameters by which the vehicle is recognised. Empty if its board reports a
    unique id.
    """
    vehicle = parameters.session.vehicle
    return {} if vehicle is not None and vehicle.uid else parameters.read_existing(FINGERPRINT, as_is=True)


def difference(
    known: Mapping[str, Any], fingerprint: Mapping[str, float], identity: VehicleIdentity, parameters: Parameters
) -> str:
    """Return a sentence on why the vehicle on this link is not the *known* one; empty if no difference was detected.

    known : identity as in a journal. fingerprint : parameters of the known vehicle, as from :func:`fingerprint_of`.
    """
    here = identity.to_dict()
    kinds = [
        f"{key} {known[key]} there, {here[key]} here" for key in _SAME_KIND if known.get(key) not in (None, here[key])
    ]
    if kinds:
        return "; ".join(kinds)
    if known.get("uid"):
        same = known["uid"] == identity.uid
        return "" if same else f"its board is {known['uid']} there, {identity.uid or 'unknown'} here"
    held = parameters.read_existing(fingerprint, as_is=True)
    strange = [
        f"{n} {v:g} there, {held[n]:g} here"
        for n, v in fingerprint.items()
        if n in held and not same_float32(held[n], v)
    ]
    gone = [n for n in fingerprint if n not in held]
    return "; ".join(strange + [f"{n} does not exist here" for n in gone])


WANTED_RATES: Mapping[str, float] = {
    "ATTITUDE": 10.0,
    "SERVO_OUTPUT_RAW": 25.0,
    "LOCAL_POSITION_NED": 10.0,
    "GLOBAL_POSITION_INT": 10.0,
    "RC_CHANNELS": 10.0,
    "VFR_HUD": 5.0,
    "SYS_STATUS": 1.0,
}
"""Message -> rate [Hz] requested for a run. ATTITUDE sets the control period."""

NEEDED_RATES: Mapping[str, float] = {"ATTITUDE": 5.0, "SERVO_OUTPUT_RAW": 5.0}
"""Message -> lowest rate [Hz] at which a relay can be flown."""

_FINE_STEP = 0.01
"""Time step [s] that divides the loop period of every autopilot loop from 50 to 100 Hz, so that message ticks are met
exactly. Project choice."""

_LATE = 0.03
"""Lag of a gyro filter [s] above which it is reported. Project choice."""
_FULL_SPEED, _LOOP_RATE, _GYRO_FILTER = "WP_SPEED", "SCHED_LOOP_RATE", "INS_GYRO_FILTER"


def open_craft(
    session: Session,
    *,
    system_id: int | None = None,
    timeout: float = 10.0,
    wanted_rates: Mapping[str, float] = WANTED_RATES,
    needed_rates: Mapping[str, float] = NEEDED_RATES,
    first_rates: Mapping[str, float] | None = None,
    spare_rates: Mapping[str, float] | None = None,
    arm_patience: float = 10.0,
) -> MavlinkCraft:
    """Discover the vehicle on *session* and return it, ready to be observed and commanded.

    It adopts the ground-station id that the vehicle obeys, reads its wiring, and requests and measures telemetry. Only
    message rates are changed on the vehicle; ``craft.rates.restore()`` restores them. *first_rates*: messages with
    priority if the link cannot carry all (message -> Hz). *spare_rates*: higher rates that are requested if the link
    has spare capacity.

    Raises
    ------
    NoVehicle, WrongVehicle
        There is no vehicle on the link, or it cannot be tuned.
    PreconditionFailed, ParameterMissing
        Its wiring or configuration is not supported.
    TelemetryFault
        Its telemetry is too slow, or the link is so full that its answers do not arrive.
    """
    identity = session.vehicle or session.discover(timeout, system_id)
    firmware = _firmware(identity)
    parameters, commands = Parameters(session), Commands(session, firmware)
    try:
        config = _read_config(session, parameters, firmware)
    except (ParameterMissing, NoReply, PreconditionFailed) as error:
        check_answers_come(session, wanted_rates, first_rates or {}, error)
        if lossy := session.lossy():
            raise TelemetryFault(f"{lossy}. Nothing was armed") from error
        raise
    rates = Rates(session, commands, first_rates)
    craft = MavlinkCraft(
        session,
        firmware,
        config,
        parameters=parameters,
        commands=commands,
        rates=rates,
        arm_patience=arm_patience,
    )
    try:
        rates.request(wanted_rates)
        rates.fit(needed_rates, config.loop_period, craft.latency)
        rates.quicken(spare_rates or {}, config.loop_period, craft.latency)
        craft.keep_rates()
        craft.learn_failsafes()  # not before the rates fit the link: until then it may be full
        _note_late_rates(session, config.rate_lag)
        if craft.other_stations.radio:
            session.notes.append(f"telemetry radio: {craft.other_stations.radio}")
        _follow_control_tick(craft, rates.granted["ATTITUDE"].granted if "ATTITUDE" in rates.granted else 0.0)
    except AutotuneError:
        rates.restore()
        raise
    return craft


def _read_config(session: Session, parameters: Parameters, firmware: Firmware) -> VehicleConfig:
    """Read which ground station the vehicle obeys, its type and its wiring."""
    assert session.vehicle is not None
    misfit = firmware.misfit(parameters.read_existing(case.parameter for case in firmware.unsuited))
    if misfit:
        raise WrongVehicle(f"{misfit}. Nothing was written or armed")
    _adopt_gcs_id(session, parameters, firmware)
    session.vehicle = _with_frame(session, parameters, firmware)
    names = [_LOOP_RATE, _GYRO_FILTER, *([_FULL_SPEED] if firmware.needs_way else [])]
    values = parameters.read_existing(names)
    return VehicleConfig(
        read_override_map(parameters, firmware),
        _servo_map(parameters, firmware),
        values.get(_FULL_SPEED, 0.0),
        1.0 / values[_LOOP_RATE] if values.get(_LOOP_RATE, 0.0) > 0.0 else 0.0,
        gyro_lag(values.get(_GYRO_FILTER, 0.0)),
        read_rate_stick(parameters, firmware),
    )


def _servo_map(parameters: Parameters, firmware: Firmware) -> ServoMap:
    try:
        return read_servo_map(parameters, firmware)
    except OutputsUnassigned as error:
        if error.received == error.of:
            raise
        raise PreconditionFailed(
            f"{error} Only {error.received} of {error.of} requests were answered. The link may be too slow"
        ) from error


def _follow_control_tick(craft: MavlinkCraft, rate: float) -> None:
    """Advance simulated time from ATTITUDE to ATTITUDE, after determining its phase in small steps."""
    if rate <= 0.0:
        return
    transport, ticks = craft.session.transport, craft.telemetry.ticks
    transport.follow_tick(0.0, _FINE_STEP)
    craft.session.wait_for(lambda: True if craft.telemetry.ticks > ticks else None, 2.0 / rate)
    transport.follow_tick(craft.clock.now(), 1.0 / rate)


def _note_late_rates(session: Session, lag: float) -> None:
    if lag >= _LATE:
        session.notes.append(
            f"the autopilot's gyro filter ({_GYRO_FILTER}) delays turn rates by {1e3 * lag:.0f} ms. Their timestamps "
            "are corrected"
        )


def _firmware(identity: VehicleIdentity) -> Firmware:
    firmware = firmware_for(identity.autopilot, identity.vehicle_type)
    if firmware is None:
        known = ", ".join(f.name for f in FIRMWARE.values())
        autopilot = enum_name("MAV_AUTOPILOT", identity.autopilot).removeprefix("MAV_AUTOPILOT_")
        raise WrongVehicle(
            f"{type_name(identity.vehicle_type)} with autopilot {autopilot} (system {identity.system}) is "
            f"not supported. Supported: {known} on ArduPilot"
        )
    return firmware


def _adopt_gcs_id(session: Session, parameters: Parameters, firmware: Firmware) -> None:
    """Use the system id whose overrides the vehicle accepts, because it ignores others without notice."""
    try:
        name, value = parameters.read_first(firmware.gcs_id_parameters)
    except ParameterMissing:
        session.notes.append("the vehicle does not report which ground station it obeys. Using system id 255")
        return
    if int(value) != session.port.system:
        session.notes.append(f"{name} is {value:g}: using system id {value:g}")
        session.port.system = int(value)


def _with_frame(session: Session, parameters: Parameters, firmware: Firmware) -> VehicleIdentity:
    assert session.vehicle is not None
    frame = None
    if firmware.frame_parameter:
        frame = int(parameters.read(firmware.frame_parameter))
    return replace(session.vehicle, firmware=firmware.name, frame=frame)
