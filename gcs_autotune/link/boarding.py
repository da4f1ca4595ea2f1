"""From an open link to a craft that can be flown: find it, learn how it is wired, ask for telemetry."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from gcs_autotune.errors import AutotuneError, NoReply, ParameterMissing, PreconditionFailed, WrongVehicle
from gcs_autotune.firmware import FIRMWARE, Firmware, firmware_for, read_servo_map
from gcs_autotune.link.commands import Commands
from gcs_autotune.link.identity import VehicleIdentity, type_name
from gcs_autotune.link.mavlink_craft import MavlinkCraft
from gcs_autotune.link.overrides import read_override_map
from gcs_autotune.link.parameters import Parameters
from gcs_autotune.link.rate_stick import read_rate_stick
from gcs_autotune.link.rates import Rates
from gcs_autotune.link.session import Session
from gcs_autotune.link.stamps import gyro_lag
from gcs_autotune.link.unheard import see_that_answers_come
from gcs_autotune.link.wiring import Wiring

__all__ = ["NEEDED_RATES", "WANTED_RATES", "open_craft"]

WANTED_RATES: Mapping[str, float] = {
    "ATTITUDE": 10.0,
    "SERVO_OUTPUT_RAW": 25.0,
    "LOCAL_POSITION_NED": 10.0,
    "GLOBAL_POSITION_INT": 10.0,
    "RC_CHANNELS": 10.0,
    "VFR_HUD": 5.0,
    "SYS_STATUS": 1.0,
}
"""Message -> Hz asked for. ATTITUDE sets the control period."""

NEEDED_RATES: Mapping[str, float] = {"ATTITUDE": 5.0, "SERVO_OUTPUT_RAW": 5.0}
"""Message -> Hz without which no relay can be flown."""

_FINE_STEP = 0.01
"""Chosen: divides the period of every autopilot loop from 50 to 100 Hz, so a message's tick is met exactly."""

_LATE = 0.03
"""Chosen [s]: a gyro filter's lag that is worth a word."""
_FULL_SPEED, _LOOP_RATE, _GYRO_FILTER = "WP_SPEED", "SCHED_LOOP_RATE", "INS_GYRO_FILTER"


def open_craft(
    session: Session,
    *,
    system_id: int | None = None,
    timeout: float = 10.0,
    wanted_rates: Mapping[str, float] = WANTED_RATES,
    needed_rates: Mapping[str, float] = NEEDED_RATES,
    first_rates: Mapping[str, float] | None = None,
    arm_patience: float = 10.0,
) -> MavlinkCraft:
    """Discover the vehicle on *session* and return it, ready to be watched and commanded.

    Adopts the ground-station id that the vehicle obeys; reads its wiring; requests and measures telemetry.
    Nothing is written to the vehicle but message rates; ``craft.rates.restore()`` puts those back. *first_rates*: what
    is served first where a link has no room for all (message -> Hz).

    Raises
    ------
    NoVehicle, WrongVehicle
        Nobody there, or nobody we can tune.
    PreconditionFailed, ParameterMissing
        It is wired or configured in a way that we cannot work with.
    TelemetryFault
        Its telemetry is too slow, or the link so full already that its answers do not come through.
    """
    identity = session.vehicle or session.discover(timeout, system_id)
    firmware = _firmware(identity)
    parameters, commands = Parameters(session), Commands(session, firmware)
    try:
        wiring = _wiring(session, parameters, firmware)
    except (ParameterMissing, NoReply, PreconditionFailed) as error:
        see_that_answers_come(session, wanted_rates, first_rates or {}, error)
        raise
    rates = Rates(session, commands, first_rates)
    craft = MavlinkCraft(
        session,
        firmware,
        wiring,
        parameters=parameters,
        commands=commands,
        rates=rates,
        arm_patience=arm_patience,
    )
    try:
        rates.request(wanted_rates)
        rates.fit(needed_rates, wiring.loop_period, craft.latency)
        craft.keep_rates()
        _note_late_rates(session, wiring.rate_lag)
        if craft.company.radio:
            session.notes.append(f"telemetry radio: {craft.company.radio}")
        _follow_control_tick(craft, rates.granted["ATTITUDE"].granted if "ATTITUDE" in rates.granted else 0.0)
    except AutotuneError:
        rates.restore()
        raise
    return craft


def _wiring(session: Session, parameters: Parameters, firmware: Firmware) -> Wiring:
    """Ask the vehicle whom it obeys, what it is and how it is wired."""
    assert session.vehicle is not None
    misfit = firmware.misfit(parameters.read_existing(case.parameter for case in firmware.unsuited))
    if misfit:
        raise WrongVehicle(f"{misfit}. Nothing was written or armed")
    _adopt_gcs_id(session, parameters, firmware)
    session.vehicle = _with_frame(session, parameters, firmware)
    names = [_LOOP_RATE, _GYRO_FILTER, *([_FULL_SPEED] if firmware.kind == "boat" else [])]
    told = parameters.read_existing(names)
    return Wiring(
        read_override_map(parameters, firmware),
        read_servo_map(parameters, firmware),
        told.get(_FULL_SPEED, 0.0),
        1.0 / told[_LOOP_RATE] if told.get(_LOOP_RATE, 0.0) > 0.0 else 0.0,
        gyro_lag(told.get(_GYRO_FILTER, 0.0)),
        read_rate_stick(parameters, firmware),
    )


def _follow_control_tick(craft: MavlinkCraft, rate: float) -> None:
    """Let simulated time be granted from ATTITUDE to ATTITUDE; find its phase in small steps first."""
    if rate <= 0.0:
        return
    transport, seen = craft.session.transport, craft.telemetry.ticks
    transport.follow_tick(0.0, _FINE_STEP)
    craft.session.wait_for(lambda: True if craft.telemetry.ticks > seen else None, 2.0 / rate)
    transport.follow_tick(craft.clock.now(), 1.0 / rate)


def _note_late_rates(session: Session, lag: float) -> None:
    if lag >= _LATE:
        session.notes.append(
            f"the autopilot's gyro filter ({_GYRO_FILTER}) makes turn rates {1e3 * lag:.0f} ms late; they are dated "
            "back, and the heading, which is not late, is fitted first"
        )


def _firmware(identity: VehicleIdentity) -> Firmware:
    firmware = firmware_for(identity.autopilot, identity.vehicle_type)
    if firmware is None:
        known = ", ".join(f.name for f in FIRMWARE.values())
        raise WrongVehicle(
            f"{type_name(identity.vehicle_type)} with autopilot {identity.autopilot} (system {identity.system}) "
            f"is not a vehicle we can tune; we know {known} on ArduPilot"
        )
    return firmware


def _adopt_gcs_id(session: Session, parameters: Parameters, firmware: Firmware) -> None:
    """Send as the system that the vehicle takes overrides from; from any other it ignores them silently."""
    try:
        name, value = parameters.read_first(firmware.gcs_id_parameters)
    except ParameterMissing:
        session.notes.append("the vehicle does not tell which ground station it obeys; we stay system 255")
        return
    if int(value) != session.source_system:
        session.notes.append(f"{name} is {value:g}: from now on we are system {value:g}")
        session.source_system = int(value)


def _with_frame(session: Session, parameters: Parameters, firmware: Firmware) -> VehicleIdentity:
    assert session.vehicle is not None
    frame = None
    if firmware.frame_parameter:
        frame = int(parameters.read(firmware.frame_parameter))
    return replace(session.vehicle, firmware=firmware.name, frame=frame)
