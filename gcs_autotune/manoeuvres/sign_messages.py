"""What a sign check found, in words that name the cure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from gcs_autotune.manoeuvres.pulse_response import Pulse, PulseResponse

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
"""Share of the command below which an output did not move at all."""


@dataclass(frozen=True, slots=True)
class Outlet:
    """A servo output (1-based) that drives a force: pulse [us] at rest, and how much more full output makes it."""

    channel: int
    trim: float
    per_full: float

    def __str__(self) -> str:
        return f"SERVO{self.channel}"


def named(outlets: Sequence[Outlet]) -> str:
    """Name them."""
    return " and ".join(map(str, outlets)) or "the output"


def _pulses(seen: PulseResponse, outlets: Sequence[Outlet]) -> str:
    ends = (seen.forward.output, seen.back.output)
    went = [f"{o} went to " + " and ".join(f"{o.trim + o.per_full * end:.0f} us" for end in ends) for o in outlets]
    return ", ".join(went) or "the outputs moved"


def moved(stretch: Pulse, signal: str, force: str) -> str:
    """Say what one pulse did."""
    angular = signal == "psi"
    size = f"{abs(math.degrees(stretch.moved)):.1f} deg" if angular else f"{abs(stretch.moved):.2f} m"
    way = ("to starboard", "to port") if angular else ("down", "up")
    return (
        f"{stretch.command:+.2f} of full {force} moved it {size} {way[0 if stretch.moved > 0.0 else 1]} in "
        f"{stretch.seconds:.1f} s"
    )


def acts_rightly(stretch: Pulse, signal: str, force: str) -> str:
    """All is well."""
    return f"{moved(stretch, signal, force)}: {force} acts the right way"


def turned_round(seen: PulseResponse, signal: str, force: str, cure: str) -> str:
    """It moves the wrong way."""
    shown = seen.forward if seen.signs[0] else seen.back
    return f"{moved(shown, signal, force)}: the wrong way. {cure}"


def unclear(seen: PulseResponse, signal: str, force: str, outlets: Sequence[Outlet]) -> str:
    """It does not move, or does not move both ways."""
    both = f"{moved(seen.forward, signal, force)}, and {moved(seen.back, signal, force)}{_drifting(seen, signal)}"
    if seen.is_silent:
        return (
            f"{both}, though {_pulses(seen, outlets)}: it is dead, or has too little authority for a relay. Check "
            "linkage, propellers and their supply, and the trim; a rudder may want more --throttle"
        )
    cure = (
        "ballast it until it hangs in the water" if signal == "z" else "trim the craft, wait for less wind or current"
    )
    return (
        f"{both}: it acts one way only, or a disturbance is stronger than it. Check that the actuator works both ways; "
        f"{cure}"
    )


def _drifting(seen: PulseResponse, signal: str) -> str:
    """Say how the craft moves by itself, where that is as much as a pulse must move it."""
    if not abs(seen.drift) * seen.forward.seconds >= seen.threshold:
        return ""
    if signal == "psi":
        return f", while by itself it turns at {math.degrees(seen.drift):+.1f} deg/s"
    return f", while by itself it {'sinks' if seen.drift > 0.0 else 'rises'} at {abs(seen.drift):.2f} m/s"


def not_followed(stretch: Pulse, force: str, outlets: Sequence[Outlet]) -> str:
    """The outputs did not do what was commanded."""
    who = named(outlets)
    asked = f"{stretch.command:+.2f} of full {force} was commanded, but the outputs show {stretch.output:+.2f}"
    if stretch.obeyed <= -_NOTHING:
        return f"{asked}, the other way round. Check RCn_REVERSED and what drives {who}"
    if stretch.obeyed < _NOTHING:
        return f"{asked}: {who} did not move. Another transmitter may be in command, or SERVOn_FUNCTION is wrong"
    cap = ", and MOT_THR_MAX" if force == "X" else ""
    return f"{asked}: {who} is cut off on that side. Check SERVOn_MIN, TRIM and MAX and RCn_MIN, TRIM and MAX{cap}"


def at_its_stop(idle: float, force: str, outlets: Sequence[Outlet]) -> str:
    """An output is saturated before anything is commanded."""
    return (
        f"{force} stands at {idle:+.2f} of full output without any command: {named(outlets)} is saturated. Check "
        "SERVOn_MIN, TRIM and MAX, and that nobody else is steering"
    )


def too_slow(speed: float, noise: float, least: float, throttle: float) -> str:
    """There is no way on to steer by, or nobody knows."""
    if not math.isfinite(speed):
        return "the vehicle does not tell its speed, by which it scales its steering: wait for a GPS fix"
    return (
        f"it makes only {speed:.2f} m/s at {throttle:.0%} throttle (measured to {noise:.2f} m/s): a rudder has little "
        f"to bite on, and the autopilot scales the steering by this speed. At least {least:.2f} m/s is needed; give "
        "more --throttle"
    )


def turns_by_itself(rate: float, speed: float, noise: float, throttle: float) -> str:
    """It is under way, but turns (*rate* [rad/s]) with nothing steered, and its speed goes up and down with that."""
    return (
        f"with nothing steered it turns by itself at {abs(math.degrees(rate)):.0f} deg/s to "
        f"{'starboard' if rate > 0.0 else 'port'} at {throttle:.0%} throttle, and its speed does not stay "
        f"({speed:.2f} m/s, give or take {noise:.2f}). Trim the rudder, see that all thrusters push alike; where "
        "the craft is not stable on its course, less --throttle may help"
    )


def gained(seen: Pulse) -> str:
    """Say what a pulse of thrust did; ``moved`` is speed gained [m/s]."""
    way = "ahead" if seen.moved > 0.0 else "astern"
    return f"{seen.command:+.2f} of full X gave it {abs(seen.moved):.2f} m/s {way} in {seen.seconds:.1f} s"


def does_not_drive(seen: Pulse, outlets: Sequence[Outlet]) -> str:
    """Thrust does not move it."""
    went = ", ".join(f"{o} went to {o.trim + o.per_full * seen.output:.0f} us" for o in outlets) or "the output moved"
    return (
        f"{gained(seen)}, though {went}: it is dead, or too weak to tell anything from. Check propeller and supply, "
        "the ESC's own arming and its range against SERVOn_MIN, TRIM and MAX, and that nothing holds the craft; or "
        "give more --throttle"
    )


def turns_on_thrust(turn: float, seconds: float, command: float, crooked: str) -> str:
    """Thrust alone turns it; *turn* [rad]."""
    side = "starboard" if turn > 0.0 else "port"
    return (
        f"{command:+.2f} of full X, without any steering, turned it {abs(math.degrees(turn)):.0f} deg to {side} in "
        f"{seconds:.1f} s instead of driving it ahead: {crooked}"
    )


def goes_astern(u: float, throttle: float, cure: str) -> str:
    """There is way on, but the wrong one."""
    return f"it goes astern, at {-u:.2f} m/s, with the throttle {throttle:.0%} ahead. {cure}"
