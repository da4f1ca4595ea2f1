"""Messages with the result of a sign check and its remedy."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from gcs_autotune.manoeuvres.pulse_response import Pulse, PulseResponse
from gcs_autotune.sname import DOFS, SIDES, SIGNALS

__all__ = [
    "Outlet",
    "acts_rightly",
    "at_its_stop",
    "does_not_drive",
    "gained",
    "goes_astern",
    "not_followed",
    "too_slow",
    "turned_round",
    "turns_by_itself",
    "turns_on_thrust",
    "unclear",
]

_NOTHING = 0.1
"""Fraction of the command below which an output counts as unmoved. Project choice."""


@dataclass(frozen=True, slots=True)
class Outlet:
    """A servo output (1-based) that drives a force: pulse [us] at rest, and the change [us] for full output."""

    channel: int
    trim: float
    per_full: float

    def __str__(self) -> str:
        return f"SERVO{self.channel}"


def named(outlets: Sequence[Outlet]) -> str:
    """Return the names of the servo outputs *outlets* as text."""
    return " and ".join(map(str, outlets)) or "the output"


def _named_are(outlets: Sequence[Outlet]) -> str:
    return f"{named(outlets)} {'are' if len(outlets) > 1 else 'is'}"


def _pulses(seen: PulseResponse, outlets: Sequence[Outlet]) -> str:
    ends = (seen.forward.output, seen.back.output)
    went = [f"{o} went to " + " and ".join(f"{o.trim + o.per_full * end:.0f} us" for end in ends) for o in outlets]
    return ", ".join(went) or "the outputs changed"


_WAYS = {dof.force: SIDES[name] for name, dof in DOFS.items()}
"""Force -> direction of the motion along it, and against it."""


def moved(stretch: Pulse, signal: str, force: str) -> str:
    """Return a clause on the motion caused by one pulse, for a motion that is significant."""
    angular = SIGNALS[signal].angular
    does, size = (
        ({"K": "rolled", "M": "pitched"}.get(force, "turned"), f"{abs(math.degrees(stretch.moved)):.1f} deg")
        if angular
        else ("moved", f"{abs(stretch.moved):.2f} m")
    )
    way = _WAYS[force][0 if stretch.moved > 0.0 else 1]
    return f"{stretch.command:+.2f} of full {force} output {does} the craft {size} {way} in {stretch.seconds:.1f} s"


def acts_rightly(stretch: Pulse, signal: str, force: str) -> str:
    """Return the message that the craft responded in the right direction."""
    return f"{moved(stretch, signal, force)}: {force} acts in the right direction"


def turned_round(seen: PulseResponse, signal: str, force: str, cure: str) -> str:
    """Return the message that the craft responded in the wrong direction."""
    shown = seen.forward if seen.signs[0] else seen.back
    return f"{moved(shown, signal, force)}, the wrong way. {cure}"


def unclear(seen: PulseResponse, signal: str, force: str, outlets: Sequence[Outlet], *, under_way: bool = False) -> str:
    """Return the message that the craft did not respond, or only in one direction. *under_way*: with thrust ahead."""
    both = " and ".join(
        moved(stretch, signal, force)
        if sign
        else f"{stretch.command:+.2f} of full {force} output did not clearly move the craft in {stretch.seconds:.1f} s"
        for stretch, sign in zip((seen.forward, seen.back), seen.signs, strict=True)
    )
    drifting = _drifting(seen, signal)
    if seen.is_silent:
        rudder = ". A rudder may need more --throttle" if under_way else ""
        return (
            f"{both}, although {_pulses(seen, outlets)}{drifting}. The actuator is dead or too weak for a relay. Check "
            f"linkage, propellers, their power supply and the trim{rudder}"
        )
    down = SIGNALS[signal].down
    cure = "ballast the craft to neutral buoyancy" if down else "trim the craft, or wait for less wind or current"
    return (
        f"{both}{drifting}. The actuator acts in one direction only, or a disturbance is stronger. Check that it works "
        f"in both directions, {cure}"
    )


def _drifting(seen: PulseResponse, signal: str) -> str:
    """Return a sentence on the drift without command, if it is as large as the required response."""
    if not abs(seen.drift) * seen.forward.seconds >= seen.threshold:
        return ""
    if SIGNALS[signal].angular:
        return f"; without command it turns at {math.degrees(seen.drift):+.1f} deg/s"
    way = ("sinks", "rises") if SIGNALS[signal].down else ("drifts", "drifts")
    return f"; without command it {way[seen.drift <= 0.0]} at {abs(seen.drift):.2f} m/s"


def not_followed(stretch: Pulse, force: str, outlets: Sequence[Outlet]) -> str:
    """Return the message that the outputs do not follow the command."""
    who = named(outlets)
    if not math.isfinite(stretch.output):
        return (
            f"the vehicle does not report its {force} output, so the response of {who} is unknown. Check that "
            "SERVO_OUTPUT_RAW is sent, and that a SERVOn_FUNCTION drives this axis"
        )
    mismatch = f"commanded {stretch.command:+.2f} of full {force} output, but the outputs show {stretch.output:+.2f}"
    if stretch.obeyed <= -_NOTHING:
        return f"{mismatch}, the opposite direction. Check RCn_REVERSED and the function of {who}"
    if stretch.obeyed < _NOTHING:
        return f"{mismatch}: {who} did not change. Check SERVOn_FUNCTION, and that no other transmitter is in command"
    cap = ", and MOT_THR_MAX" if force == "X" else ""
    limited = f"{mismatch}: {_named_are(outlets)} limited on that side"
    return f"{limited}. Check SERVOn_MIN, TRIM and MAX and RCn_MIN, TRIM and MAX{cap}"


def at_its_stop(idle: float, force: str, outlets: Sequence[Outlet]) -> str:
    """Return the message that an output is at its stop without command."""
    return (
        f"{force} is at {idle:+.2f} of full output without any command: {_named_are(outlets)} saturated. Check "
        "SERVOn_MIN, TRIM and MAX, and that no other station is steering"
    )


def too_slow(speed: float, noise: float, least: float, throttle: float) -> str:
    """Return the message that the speed is too low for steering, or unknown."""
    if not math.isfinite(speed):
        return "the vehicle reports no speed, which it needs to scale its steering. Wait for a GPS fix"
    return (
        f"the craft makes only {speed:.2f} m/s (noise {noise:.2f} m/s) at {throttle:.0%} throttle. Steering needs at "
        f"least {least:.2f} m/s: below this a rudder has little effect, and the autopilot scales its output by "
        "speed. Use more --throttle"
    )


def turns_by_itself(rate: float, speed: float, noise: float, throttle: float) -> str:
    """Return the message that the craft turns without steering at *rate* [rad/s], while its speed varies."""
    return (
        f"without steering the craft turns at {abs(math.degrees(rate)):.0f} deg/s to "
        f"{'starboard' if rate > 0.0 else 'port'} at {throttle:.0%} throttle, and its speed is not "
        f"steady ({speed:.2f} +- {noise:.2f} m/s). Trim the rudder and check that all thrusters push equally. If the "
        "craft does not hold a straight course, use less --throttle"
    )


def gained(seen: Pulse) -> str:
    """Return a clause on the effect of a thrust pulse; ``moved`` is the speed gained [m/s]."""
    way = "ahead" if seen.moved > 0.0 else "astern"
    return (
        f"{seen.command:+.2f} of full X output gave the craft {abs(seen.moved):.2f} m/s {way} in {seen.seconds:.1f} s"
    )


def does_not_drive(seen: Pulse, outlets: Sequence[Outlet]) -> str:
    """Return the message that thrust has no effect."""
    went = ", ".join(f"{o} went to {o.trim + o.per_full * seen.output:.0f} us" for o in outlets) or "the output changed"
    return (
        f"{gained(seen)}, although {went}. The thruster is dead or too weak. Check propeller and power supply, the "
        "ESC's arming, and its range against SERVOn_MIN, TRIM and MAX. Check that nothing holds the craft, or use "
        "more --throttle"
    )


def turns_on_thrust(turn: float, seconds: float, command: float, crooked: str) -> str:
    """Return the message that the craft turns by *turn* [rad] under thrust alone."""
    side = "starboard" if turn > 0.0 else "port"
    return (
        f"{command:+.2f} of full X output without steering turned the craft {abs(math.degrees(turn)):.0f} deg to "
        f"{side} in "
        f"{seconds:.1f} s instead of driving it straight ahead: {crooked}"
    )


def goes_astern(u: float, throttle: float, cure: str) -> str:
    """Return the message that the craft goes astern under thrust ahead."""
    return f"the craft goes astern at {-u:.2f} m/s with {throttle:.0%} throttle ahead. {cure}"
