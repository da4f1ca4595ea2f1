"""Open the link, find the vehicle, read its configuration, request telemetry and disconnect."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress

from gcs_autotune.axes import axis_kind
from gcs_autotune.errors import AutotuneError, WrongVehicle
from gcs_autotune.firmware import Axis, Firmware
from gcs_autotune.link import NEEDED_RATES, TWITCH, WANTED_RATES, MavlinkCraft, Session, open_craft
from gcs_autotune.mavlink import Message
from gcs_autotune.observer import Intention, Observer, Vitals, Words
from gcs_autotune.workflow.open_runs import refuse_open_runs
from gcs_autotune.workflow.operator import Operator
from gcs_autotune.workflow.record import RunDirectory
from gcs_autotune.workflow.settings import CommonSettings, Connection

__all__ = ["arming", "axis_of", "connect", "connect_craft", "say_link_times", "telemetry_rates"]

SERVO_RATE = 40.0
"""Requested rate [Hz] of SERVO_OUTPUT_RAW, which contains the moments at which a relay switched. It is the highest rate
that an ArduRover with a 50 Hz loop sends.
"""
SPARE: Mapping[str, float] = {"SERVO_OUTPUT_RAW": 100.0}
"""Message rate [Hz] for a vehicle with a faster loop, if the link has spare capacity.

It reduces the standard error of a Falcon's damping by a factor of six.
"""


CONTROL_RATE, SIMULATED_CONTROL_RATE = 25.0, 10.0
"""Default rate [Hz] of ATTITUDE and so of the relay, on a real link and in lock-stepped simulation.

The craft of ArduPilot's own simulator turn in half a second. On a real link each decision is up to one period late. In
lock-stepped time there is no delay.
"""


WATCHING: Mapping[str, float] = {
    "ATTITUDE": 2.0,
    "SERVO_OUTPUT_RAW": 2.0,
    "LOCAL_POSITION_NED": 1.0,
    "GLOBAL_POSITION_INT": 1.0,
    "RC_CHANNELS": 2.0,
    "SYS_STATUS": 0.5,
}
"""Message -> rate [Hz] for a craft that this program only watches while the autopilot flies the experiment: about 300
bytes/s. Project choice.
"""
LEAST_WATCHING: Mapping[str, float] = {"ATTITUDE": 1.0, "SERVO_OUTPUT_RAW": 1.0}
"""Message -> lowest rate [Hz] at which a craft can be watched."""


def arming(craft: MavlinkCraft, modes: str = "") -> Intention:
    """Return a warning of what happens at arming: steering thrusters produce thrust during their check.

    modes : the modes of the run, for the same row of the announcement; empty: arming alone.
    """
    armed = "leave the vehicle armed" if craft.armed else "arm the vehicle, and disarm it at the end"
    if modes:
        brief = f"armed already; {modes}" if craft.armed else f"yes; {modes}, disarmed"
    else:
        brief = "no, the vehicle is armed already" if craft.armed else "yes, and disarms at the end"
    steers_by_thrust = craft.skid or not craft.firmware.needs_way
    twitched = "turning thrusters" if steers_by_thrust else "steering"
    without = "" if steers_by_thrust else ", without thrust,"
    moved = f"; move the {twitched} by {100.0 * TWITCH:.0f} %{without} to check the response and its delay"
    return Intention(f"{armed}{moved}", "Arms", brief)


def telemetry_rates(control_rate: float) -> dict[str, float]:
    """Return message name -> rate [Hz] required for a relay that runs at *control_rate* [Hz]."""
    return {**WANTED_RATES, "ATTITUDE": control_rate, "SERVO_OUTPUT_RAW": max(SERVO_RATE, control_rate)}


@contextmanager
def connect(
    connection: Connection, operator: Operator, observer: Observer, record: RunDirectory | None = None
) -> Iterator[Session]:
    """Open the link, create the *record* and find the vehicle. Close the link on every exit.

    For a vehicle of the wrong type no record is created.
    """
    with _without_record_of_the_wrong_vehicle(record), connection.open() as transport:
        if record is not None:
            record.make()
        observer.say(f"link: {transport.description}{' over ' if transport.carrier else ''}{transport.carrier}")
        if connection.signing is not None:
            observer.say(f"messages are signed with the {connection.signing.origin}; unsigned messages are rejected")
        with Session(
            transport,
            source_system=connection.source_system or 255,
            tlog=record.tlog if record is not None else None,
            interrupt=operator.stop_requested,
            signing=connection.signing,
        ) as session:
            _pass_words_on(session, observer)
            session.discover(system_id=connection.system_id)
            observer.say(f"vehicle: {session.vehicle}")
            with _reporting_refusals(session, observer):
                yield session


@contextmanager
def _reporting_refusals(session: Session, observer: Observer) -> Iterator[None]:
    try:
        yield
    finally:
        if session.port.refusals:
            observer.say(session.port.refusals)


@contextmanager
def _without_record_of_the_wrong_vehicle(record: RunDirectory | None) -> Iterator[None]:
    try:
        yield
    except WrongVehicle:
        if record is not None:
            record.discard()
        raise


@contextmanager
def connect_craft(
    common: CommonSettings,
    operator: Operator,
    observer: Observer,
    record: RunDirectory,
    axis: str,
    *,
    only_watches: bool = False,
) -> Iterator[MavlinkCraft]:
    """Connect and yield a craft that can be monitored and commanded, with telemetry at the requested rates.

    If the link is too slow for all rates, the messages for *axis* have priority. *only_watches*: request the few
    messages of :data:`WATCHING`.
    """
    with connect(common.connection, operator, observer, record) as session:
        usual = SIMULATED_CONTROL_RATE if session.transport.is_simulated else CONTROL_RATE
        control_rate = common.control_rate or usual
        session.patience = common.patience
        craft = open_craft(
            session,
            wanted_rates=WATCHING if only_watches else telemetry_rates(control_rate),
            needed_rates=LEAST_WATCHING if only_watches else NEEDED_RATES,
            first_rates=None if only_watches else axis_kind(axis).rates or None,
            spare_rates=None if only_watches else SPARE,
        )
        if only_watches:
            craft.only_watch()
        told = len(session.notes)
        session.listen("HEARTBEAT", lambda heartbeat: observer.note(_vitals(craft)))
        try:
            for note in session.notes[:told]:
                observer.say(note)
            refuse_open_runs(craft)
            yield craft
        except BaseException:
            with suppress(AutotuneError), craft.shielded():  # the error under way states what is left to be done
                _leave(craft)
            raise
        else:
            with craft.shielded():
                _leave(craft)
        finally:
            for note in session.notes[told:]:
                observer.say(note)


def _pass_words_on(session: Session, observer: Observer) -> None:
    """Forward the vehicle's STATUSTEXT messages to *observer* from this call on."""
    told = session.texts.count

    def hear(message: Message) -> None:
        nonlocal told  # the session has taken it in already, and put texts in pieces together
        for text in session.texts.since(told):
            observer.note(Words(text.severity, text.text))
        told = session.texts.count

    session.listen("STATUSTEXT", hear)


def _vitals(craft: MavlinkCraft) -> Vitals:
    value = craft.telemetry.value
    rate = craft.rates.measured.get("ATTITUDE", math.nan)
    battery = value("battery"), value("battery_remaining")
    return Vitals(craft.mode, craft.armed, *battery, craft.latency.round_trip, rate)


def say_link_times(craft: MavlinkCraft, observer: Observer) -> None:
    """Report the link delays of a craft that was just armed, and the shortest oscillation period that they allow."""
    observer.say(
        f"link: {craft.link_times}; shortest period of an oscillation that can be flown: {craft.least_period:.1f} s"
    )


def _leave(craft: MavlinkCraft) -> None:
    """Release overrides that an interrupted run may have left, and restore the message rates."""
    try:
        craft.release()
    finally:
        craft.rates.restore()


def axis_of(firmware: Firmware, name: str) -> Axis:
    """Return the axis (control loop) called *name* of the vehicle's firmware.

    Raises
    ------
    WrongVehicle
        When this kind of vehicle has none, e.g. depth on a boat.
    """
    try:
        return firmware.axes[name]
    except KeyError:
        have = ", ".join(firmware.axes)
        raise WrongVehicle(
            f"this vehicle ({firmware.name}, a {firmware.kind}) has no {name} loop to tune. It has: {have}"
        ) from None
