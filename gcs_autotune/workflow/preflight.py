"""Checks before any oscillation: the vehicle is ready and under way, and the actuator acts in the right direction.

A freshly booted ArduRover passes its checks after half a minute. It accepts GUIDED (while armed) only when its
estimator has a position, most of a minute after boot. On ArduPilot's own simulator these times were 23 s and 42 s.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

from gcs_autotune.axes import axis_kind, excitation_of
from gcs_autotune.clock import Deadline
from gcs_autotune.craft import Actuate
from gcs_autotune.errors import PreconditionFailed, UsageError, WrongVehicle
from gcs_autotune.firmware import Axis, Firmware, Output, ServoMap, read_named
from gcs_autotune.link import MavlinkCraft
from gcs_autotune.manoeuvres import (
    DOF_OF,
    HELD_DURING,
    MANOEUVRES,
    Manoeuvre,
    ManoeuvreKind,
    Outlet,
    SignCheck,
    SignCheckSettings,
    ThrustCheck,
    ThrustCheckSettings,
)
from gcs_autotune.mavlink import message_number
from gcs_autotune.observer import Observer
from gcs_autotune.sname import SIGNALS
from gcs_autotune.trial import Trial
from gcs_autotune.untrusted_text import quoted
from gcs_autotune.workflow.flight_plan import FlySettings

__all__ = [
    "CHECKED",
    "STAGE",
    "await_position",
    "check_depth_is_reported",
    "check_loop_has_motors",
    "check_signals",
    "check_signs",
    "check_throttle_is_free",
    "check_vehicle_suits",
    "checked_dof",
    "checked_dofs",
    "crooked",
    "cure_of",
    "make_ready",
    "most_speed_of",
    "remarks_on",
    "sign_check_for",
    "steered_meanwhile",
]

CHECKED = {"N": "yaw", "X": "surge", "Y": "sway", "Z": "heave", "K": "roll", "M": "pitch"}
"""Force -> degree of freedom whose actuator is checked before the force is applied."""
STAGE = "sign check"
LEAST_SPEED = 0.25
"""Speed [m/s] about equal to the error of a GPS speed.

Below it the autopilot's scaling by speed is unreliable. Project choice.
"""
PULSES = (0.15, 0.3, 0.6)
"""Pulse amplitudes of the check [fraction of full output].

The first is beyond a transmitter's dead zone (0.06); the last is half the amplitude of a relay. Project choice.
"""
LEAST = 0.15
"""Smallest motion that counts as a response, relative to the smallest hysteresis of a relay on the signal. Project
choice."""
TURNED, TURNED_BY_ONE = math.radians(60.0), math.radians(20.0)
"""Heading change under thrust alone above which the thrust check fails, for one thruster and for several.

A boat whose rudder is off centre turns less than the first. A craft with one dead thruster of several turns by more
than the second. Project choice.
"""
_MANUAL_SCALES = 1
_CAP = "MOT_THR_MAX"
_ROUNDING = 0.005
"""Excess of a throttle over the cap that is ignored as rounding [fraction of full output]."""


def checked_dofs(kind: ManoeuvreKind, craft: MavlinkCraft) -> list[str]:
    """Return the degrees of freedom whose actuators are checked before a manoeuvre of this *kind*.

    For a layered manoeuvre these are all that its loops drive, except thrust towards a wall: its relay is its check.
    """
    if not kind.layered:
        return [dof] if (dof := checked_dof(kind)) else []
    forces = sorted(kind.drives - ({"X"} if kind.needs or craft.firmware.needs_way else set()))
    forces += ["Y"] if "X" in kind.drives and "Y" not in forces and "Y" in craft.forces else []
    return [CHECKED[force] for force in forces]


def checked_dof(kind: ManoeuvreKind) -> str:
    """Return the degree of freedom whose actuator is checked before a manoeuvre of this *kind*; empty if there is
    none.

    It is also empty for a craft that is tied up or in front of a wall, because its relay itself detects a reversed
    actuator.
    """
    unchecked = kind.tied or kind.needs
    return "" if unchecked else next((CHECKED[force] for force in sorted(kind.drives) if force in CHECKED), "")


def sign_check_for(
    dof: str,
    craft: MavlinkCraft,
    throttle: float,
    needs_speed: bool | None = None,
    output: float | None = None,
    *,
    wanted_speed: float = math.nan,
    most_speed: float = math.inf,
) -> SignCheck | ThrustCheck:
    """Return the check of the actuator of *dof* (``yaw``, ``heave``, ``surge``, ``sway``).

    needs_speed : whether the actuator needs speed to act; None: derived from the type of craft.
    output : the relay amplitude, if supplied.
    most_speed : speed [m/s] above which the throttle is reduced, until the throttle for *wanted_speed* [m/s] is known.

    A craft that can steer at rest is checked at rest, whatever *throttle* is used later.
    The reason is that many ROVs are unstable on course and turn under way without steering.
    """
    firmware, servos, d = craft.firmware, craft.servos, excitation_of(dof)
    needs_speed = firmware.needs_way if needs_speed is None else needs_speed
    if d.by_throttle:
        return _thrust_check(firmware, servos, throttle, output)
    force = d.names.force
    driving, ahead = servos.driving(force), servos.driving("X")
    return SignCheck(
        SignCheckSettings(
            signal=d.signal,
            force=force,
            outputs=PULSES if output is None else tuple(sorted({min(p, output) for p in PULSES})),
            reach=d.check_reach * d.least_hysteresis,
            least=LEAST * d.least_hysteresis,
            longest=d.check_time,
            throttle=throttle if firmware.needs_way else 0.0,
            least_speed=LEAST_SPEED if needs_speed else 0.0,
            most_speed=most_speed,
            wanted_speed=wanted_speed,
            keep_still=not firmware.needs_way,
            cure=cure_of(firmware, [o for o, _ in driving]),
            astern=_astern(firmware, [o for o, _ in ahead]),
            outlets=_outlets(driving),
        )
    )


def _thrust_check(firmware: Firmware, servos: ServoMap, throttle: float, output: float | None) -> ThrustCheck:
    """Return the check of forward thrust: half the working throttle first, then all of it."""
    driving = servos.driving("X")
    most = throttle or (PULSES[-1] if output is None else output)
    return ThrustCheck(
        ThrustCheckSettings(
            outputs=(0.5 * most, most),
            turned=TURNED if len(driving) == 1 else TURNED_BY_ONE,
            keep_still=not firmware.needs_way,
            cure=_astern(firmware, [o for o, _ in driving]),
            crooked=crooked(firmware, [o for o, _ in driving]),
            outlets=_outlets(driving),
        )
    )


def _outlets(driving: Sequence[tuple[Output, float]]) -> tuple[Outlet, ...]:
    """Return the servo outputs *driving* a force, each with the PWM [us] that full force adds to its trim."""
    return tuple(
        Outlet(o.channel, o.trim, o.sign * factor * (o.high - o.trim if o.sign * factor > 0.0 else o.trim - o.low))
        for o, factor in driving
    )


def _astern(firmware: Firmware, outputs: Sequence[Output]) -> str:
    """Return what to change on a craft that moves astern when commanded ahead."""
    if firmware.frame_parameter:
        return cure_of(firmware, list(outputs))
    now = [(f"SERVO{o.channel}_REVERSED", int(o.sign < 0.0)) for o in outputs]
    settings = " and ".join(f"{name} to {1 - value} (it is {value})" for name, value in now)
    return f"Set {settings}, or reverse the propeller. If the craft did go ahead, correct AHRS_ORIENTATION"


def crooked(firmware: Firmware, outputs: Sequence[Output]) -> str:
    """Return a sentence on what to check on a craft that turns under straight thrust alone."""
    channels = " and ".join(f"SERVO{o.channel}" for o in outputs)
    if firmware.frame_parameter or len(outputs) > 1:
        return (
            f"one of the thrusters on {channels} is probably dead or reversed. Identify it, then set its "
            f"{'MOT_n_DIRECTION' if firmware.frame_parameter else 'SERVOn_REVERSED'} or repair it"
        )
    return f"trim the rudder (its SERVOn_TRIM) and check the direction of the propeller on {channels}"


def cure_of(firmware: Firmware, outputs: Sequence[Output]) -> str:
    """Return a sentence on what to change on a craft that turns in the wrong direction."""
    channels = [f"SERVO{o.channel}" for o in outputs]
    if firmware.frame_parameter:
        return (
            f"Motors on {', '.join(channels)} are reversed or swapped: check MOT_n_DIRECTION, the "
            f"wiring against {firmware.frame_parameter}, and AHRS_ORIENTATION"
        )
    if len(outputs) == 1:
        now = int(outputs[0].sign < 0.0)
        return (
            f"Set {channels[0]}_REVERSED to {1 - now} (it is {now}), or reverse the linkage. If the craft did "
            "turn the right way, correct AHRS_ORIENTATION"
        )
    return f"Left and right are swapped: swap {' and '.join(f'{c}_FUNCTION' for c in channels)}"


def check_signs(check: SignCheck | ThrustCheck, fly: Callable[[Manoeuvre, str], Trial]) -> None:
    """Fly the sign check and return it.

    Raises
    ------
    PreconditionFailed
        The actuator is dead, reversed, saturated or too weak, or the boat has no headway; the message states the
            remedy.
    """
    flown = fly(check, STAGE)
    if flown.ending == "aborted":
        raise PreconditionFailed(f"{STAGE}: {flown.reason}")


def steered_meanwhile(dof: str, firmware: Firmware, servos: ServoMap) -> bool:
    """Return whether the run of *dof* also steers or holds the heading. The steering is then checked as well."""
    excitation = excitation_of(dof)
    if excitation.turns or not servos.driving("N"):
        return False
    held = HELD_DURING.get(excitation.signal, ())
    return firmware.needs_way or any(SIGNALS[gains.signal].wraps for gains in held)


def most_speed_of(throttle: float | None, speed: float, limit: float) -> float:
    """Return the speed [m/s] above which the throttle of a boat sent to *speed* is reduced. It is infinite if the user
    set *throttle*.

    limit : the safety limit for the speed.
    """
    if throttle is not None or not speed > 0.0:
        return math.inf
    return min(max(TOO_FAST * speed, speed + 0.7), 0.8 * limit)


TOO_FAST = 1.6
"""Ratio of the speed at cruise throttle to the cruise speed above which the two parameters count as inconsistent.
Project choice."""


def check_throttle_is_free(craft: MavlinkCraft, dof: str, throttle: float) -> None:
    """Check that the autopilot does not cap the *throttle* [fraction of full] at which a boat's speed is tuned.

    With a lower cap the output is saturated during most of each manoeuvre, and nothing can be identified.

    Raises
    ------
    PreconditionFailed
        The autopilot caps it; the message states the numbers and the remedy.
    """
    if not excitation_of(dof).by_throttle or not craft.firmware.needs_way:
        return
    cap = craft.parameters.read_existing([_CAP]).get(_CAP, 100.0) / 100.0
    if 0.0 < cap < throttle - _ROUNDING:
        raise PreconditionFailed(
            f"{_CAP} is {100.0 * cap:.0f} %, so the autopilot would limit the throttle steps of up to "
            f"{throttle:.0%}. Use --throttle {cap:.2f}, or set {_CAP} to 100. "
            "Nothing was armed"
        )


_PRESSURE_PATIENCE = 2.0
"""Time [s] to wait for a requested pressure. After it the sensor counts as missing. Project choice."""


def check_depth_is_reported(craft: MavlinkCraft, dof: str) -> None:
    """Check that the water-pressure sensor reports a depth. Request the message if the vehicle does not send it.

    Raises
    ------
    PreconditionFailed
        Its pressure is negative: the autopilot then resets its zero at every reading, and every depth is 0.
    """
    if not excitation_of(dof).below_surface:
        return
    told = craft.telemetry.latest
    if "pressure" not in told:
        craft.session.request_message(message_number("SCALED_PRESSURE2"))
        craft.session.wait_for(lambda: True if "pressure" in told else None, _PRESSURE_PATIENCE)
    pressure = told.get("pressure", math.nan)
    if pressure <= 0.0:
        raise PreconditionFailed(
            f"the water-pressure sensor reports a negative pressure, {pressure / 100.0:.0f} hPa (SCALED_PRESSURE2), so "
            "the autopilot has no depth. ArduPilot's simulator does this if its --home is more than 10 m "
            "above sea level: start it with an altitude of 0. Nothing was armed"
        )


def remarks_on(craft: MavlinkCraft) -> list[str]:
    """Return remarks on unusual settings of the vehicle: arming checks switched off, scaled manual steering."""
    wanted = ["ARMING_CHECK", *(["MANUAL_OPTIONS"] if craft.firmware.needs_way else [])]
    names, own = read_named(craft.parameters, wanted)
    values, found = names.to_canonical(own), []
    if values.get("ARMING_CHECK") == 0.0:
        name = names.own("ARMING_CHECK")
        found.append(f"{name} is {own[name]:g}: this vehicle arms without the autopilot's own checks")
    if int(values.get("MANUAL_OPTIONS", 0.0)) & _MANUAL_SCALES:
        found.append(
            "MANUAL_OPTIONS scales the steering by speed in MANUAL, so relays may be smaller than commanded. "
            "Identification uses the measured servo output"
        )
    return found


_CHECKS_PATIENCE = 30.0
_SILENT = 2.5
"""Longest time to wait for the estimator's status [s], requested at 2 Hz.

A vehicle that has not sent it by then counts as not reporting it. Project choice.
"""
_REPORT = "EKF_STATUS_REPORT"
_POS_HORIZ_ABS = 1 << 4
"""Bits of ``flags`` for an absolute horizontal position: ESTIMATOR_POS_HORIZ_ABS, and the predicted one."""
_PRED_POS_HORIZ_ABS = 1 << 9
_POS_HORIZ_REL = 1 << 3
"""Bit of ``flags`` for a position relative to the start, which is enough for an ROV with a DVL."""


class _Estimator:
    """The last status report of the vehicle's estimator."""

    def __init__(self, craft: MavlinkCraft) -> None:
        self.flags: int | None = None
        self._quiet_until = craft.clock.now() + _SILENT
        self._clock, self._needs_way = craft.clock, craft.firmware.needs_way
        self._stop = craft.session.listen(_REPORT, self._take)
        craft.rates.request({_REPORT: 2.0})

    def _take(self, message: object) -> None:
        self.flags = int(message.flags)  # type: ignore[attr-defined]

    @property
    def has_position(self) -> bool:
        """Whether the estimator has a position. True if the vehicle does not report a status."""
        if self.flags is None:
            return self._clock.now() >= self._quiet_until
        relative = 0 if self._needs_way else _POS_HORIZ_REL
        return bool(self.flags & (_POS_HORIZ_ABS | _PRED_POS_HORIZ_ABS | relative))

    def close(self) -> None:
        self._stop()


def make_ready(craft: MavlinkCraft, observer: Observer) -> None:
    """Send neutral overrides until a disarmed vehicle passes its checks and a boat has a position.

    After half a minute arming is tried anyway, because it reports why the checks fail.

    Raises
    ------
    PreconditionFailed
        A boat without a position estimate after a minute and a half.
    """
    craft.send(Actuate())
    _await_checks(craft, observer)
    if craft.firmware.needs_position:
        await_position(craft, observer, craft.firmware.hold_mode)


def _await_checks(craft: MavlinkCraft, observer: Observer) -> None:
    deadline, said = Deadline.after(craft.clock, _CHECKS_PATIENCE), False
    while not craft.armed and craft.telemetry.latest.get("prearm_ok", math.nan) == 0.0 and not deadline.expired:
        if not said:
            observer.say(f"waiting for the autopilot's arming checks{_reasons(craft)}")
            said = True
        craft.observe()


def await_position(craft: MavlinkCraft, observer: Observer, mode: str, patience: float = 90.0) -> None:
    """Wait until the vehicle's estimator has the horizontal position that *mode* needs.

    Raises
    ------
    PreconditionFailed
        It has none after *patience* [s].
    """
    estimator, said = _Estimator(craft), False
    source = "Check GPS (sky view, fix type)" if craft.firmware.floats else "Check the DVL or other position source"
    deadline = Deadline.after(craft.clock, patience)
    try:
        while not estimator.has_position:
            if estimator.flags is not None and not said:
                observer.say(f"waiting for the vehicle's position estimate, which {mode} needs")
                said = True
            if deadline.expired:
                raise PreconditionFailed(
                    f"the vehicle has had no position estimate for {patience:g} s, which {mode} needs. "
                    f"{source} and compass, then try again"
                )
            craft.observe()
    finally:
        estimator.close()


def _reasons(craft: MavlinkCraft) -> str:
    said = dict.fromkeys(t.text for t in craft.session.texts if t.text.startswith("PreArm:"))
    return f" (its message: {quoted(list(said)[-3:])})" if said else ""


_AXES_OF: Mapping[str, str] = {"Y": "sideways", "Z": "up and down", "t": "in both directions"}
"""First letter of what a manoeuvre needs -> in words."""


def check_loop_has_motors(axis: Axis, craft: MavlinkCraft) -> None:
    """Check that an output of the vehicle drives the motion of *axis*.

    Raises
    ------
    WrongVehicle
        None does: the autopilot has the loop, but the frame has no motor for it.
    """
    force = axis.kind.names.force
    if not craft.servos.driving(force):
        frame = f" on this {craft.firmware.frame_parameter}" if craft.firmware.frame_parameter else ""
        raise WrongVehicle(
            f"none of this vehicle's outputs drives {force}{frame}, so it has no {axis.name} loop to tune"
        )


def _suits(kind: ManoeuvreKind, force: str, firmware: Firmware) -> bool:
    """Return whether the vehicle can fly *kind* with *force*."""
    if kind.for_force is None:
        return False
    try:
        return kind.of(force).suits(firmware)
    except UsageError:  # this manoeuvre cannot drive it
        return False


def check_vehicle_suits(settings: FlySettings, craft: MavlinkCraft) -> None:
    """Check that the vehicle has the actuators that a manoeuvre needs, and a rudder if a rudder angle is set.

    Raises
    ------
    WrongVehicle
        An actuator is missing. UsageError: a rudder angle is set, and there is no rudder.
    """
    kind, firmware = settings.kind, craft.firmware
    if kind.axis and kind.axis not in firmware.axes:
        loops = ", ".join(firmware.axes)
        raise WrongVehicle(f"this vehicle ({firmware.name}) has no {kind.axis} loop to test. It has: {loops}")
    if not kind.suits(firmware):
        other = "thrust in both directions" if kind.stays else "headway to steer"
        wanted = ", ".join(sorted(kind.drives - set(firmware.channels))) or other
        fits = ", ".join(
            k.name
            for k in MANOEUVRES.values()
            if k.make is not None and k.suits(firmware) and k.layered == kind.layered
        )
        forces = [f for f in DOF_OF if kind.name in MANOEUVRES and _suits(MANOEUVRES[kind.name], f, firmware)]
        if forces:  # only the chosen force is missing
            raise WrongVehicle(
                f"{kind.name} with this --force needs {wanted}, which this vehicle ({firmware.name}) does not have. "
                f"Use --force {' or '.join(forces)}"
            )
        if kind.layered:
            raise WrongVehicle(
                f"{kind.name} needs thrust {_AXES_OF[wanted[:1]]}, which this vehicle ({firmware.name}) lacks"
                f"{'' if craft.servos.skid else f': it steers only above {LEAST_SPEED:g} m/s'}. It can fly: {fits}"
            )
        raise WrongVehicle(
            f"this vehicle ({firmware.name}) cannot fly {kind.name}, which needs {wanted}. It can fly: {fits}"
        )
    idle = [force for force in sorted(kind.drives) if not craft.servos.driving(force)]
    if idle:
        can = [k.name for k in MANOEUVRES.values() if k.layered and all(map(craft.servos.driving, k.drives))]
        fits = f". It can fly: {', '.join(can)}" if kind.layered else ""
        frame = f" on this {firmware.frame_parameter}" if firmware.frame_parameter else ""
        raise WrongVehicle(
            f"none of this vehicle's outputs drives {' or '.join(idle)}{frame}, which {kind.name} needs{fits}"
        )
    if "rudder" in settings.options and (craft.servos.skid or not firmware.needs_way):
        raise UsageError("this vehicle steers by its thrusters and has no rudder. Use --steering (normalised output)")


_MESSAGE_OF: Mapping[str, tuple[str, float]] = {"d": ("DISTANCE_SENSOR", 10.0)}
"""For each signal that not every vehicle reports: its message and the requested rate [Hz]."""
_WAITING = 5.0
"""Time [s] to wait for the first of these messages. Project choice."""


def check_signals(kind: ManoeuvreKind, craft: MavlinkCraft) -> None:
    """Request the messages for evaluating *kind*, and check that each required signal arrives.

    Raises
    ------
    PreconditionFailed
        A required signal does not arrive.
    """
    if kind.axis:
        craft.rates.request(axis_kind(kind.axis).rates)
    if not kind.needs:
        return
    message, rate = _MESSAGE_OF[kind.needs]
    craft.rates.request({message: rate})
    now = craft.observe()
    until = now.t + _WAITING
    while not math.isfinite(now.value(kind.needs)):
        if now.t > until:
            raise PreconditionFailed(
                f"{kind.name} needs a forward rangefinder, but the vehicle reports no distance within its range "
                f"({message}, orientation 0, or 1 and 7). Check the rangefinder. Nothing was armed"
            )
        now = craft.observe()
