"""The relay aboard: the Lua script that flies relays and a step at the autopilot's own rate, and what it may report.

The script is ``aboard.lua`` beside this module, behind a table of settings. It overrides servo outputs for a fraction
of a second at a time (``SRV_Channels:set_output_pwm_chan_timeout``), so a script that stops leaves the autopilot's own
neutral outputs. Relay and stop rule are those of :class:`.Relay`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Any, NamedTuple

from gcs_autotune.firmware import ServoMap
from gcs_autotune.manoeuvres.envelope import NEARLY, Envelope
from gcs_autotune.manoeuvres.hold_controller import HELD_BEFORE, HELD_DURING, HoldGains
from gcs_autotune.manoeuvres.relay_settings import RelaySettings

__all__ = ["ABOARD_ENDINGS", "PLAN", "AboardEnding", "AboardScript", "headroom"]

PLAN = ("relay", "relay", "step")
"""The parts that the script flies, in order, each after an approach."""
HOLD = 500
"""Time [ms] for which the script holds an output, as long as a radio failsafe takes at least. Project choice."""
STICK = 60
"""Movement of a stick [us] that ends the script: twice the usual dead zone. Project choice."""
MOST_CORNERS = 100
"""Largest number of corners of the permitted area, because each tick of a script may take 10,000 instructions.
Project choice."""


class AboardEnding(NamedTuple):
    """What one ending reported by the script means: ``ending`` of the trial, sentence, and what to do."""

    ending: str
    why: str
    advice: str = ""


def _limit(option: str) -> str:
    return f"Fly a smaller or shorter experiment, or, if there is space, set another limit (--{option})"


ABOARD_ENDINGS: Mapping[str, AboardEnding] = {
    "done": AboardEnding("completed", "all parts were flown"),
    "stopped": AboardEnding("aborted", "stopped by this tool"),
    "expired": AboardEnding("aborted", "the script waited in vain for its start", "Start again"),
    "disarmed": AboardEnding("aborted", "the vehicle was disarmed"),
    "mode changed": AboardEnding("aborted", "the flight mode was changed"),
    "radio failsafe": AboardEnding("aborted", "the autopilot lost its RC input", "Check transmitter and receiver"),
    "silence": AboardEnding(
        "aborted", "the autopilot lost contact with the ground station", "Move closer, or set --silence"
    ),
    "stick": AboardEnding("aborted", "a stick was moved"),
    "late": AboardEnding(
        "aborted",
        "the autopilot ran the script too rarely, so that its outputs lapsed",
        "Remove other scripts, or raise SCR_THD_PRIORITY",
    ),
    "position lost": AboardEnding("aborted", "the autopilot lost its position", "Check GPS"),
    "fence": AboardEnding("aborted", "the vehicle crossed its own fence", "Start further inside"),
    "outside the area": AboardEnding("aborted", "the craft left the permitted area", "Start further inside"),
    "heading excursion": AboardEnding("aborted", "the heading left its limit", _limit("max-heading-excursion")),
    "depth excursion": AboardEnding("aborted", "the depth left its limit", _limit("max-depth-excursion")),
    "greatest depth": AboardEnding("aborted", "the craft was too deep", _limit("max-depth")),
    "least depth": AboardEnding("aborted", "the craft was not deep enough", _limit("min-depth")),
    "speed": AboardEnding("aborted", "the craft was too fast", _limit("max-speed")),
    "distance from start": AboardEnding("aborted", "the craft was too far from its start", _limit("max-distance")),
    "turn rate": AboardEnding("aborted", "the craft turned too fast", _limit("max-turn-rate")),
    "roll": AboardEnding("aborted", "the roll left its limit", _limit("max-roll")),
    "pitch": AboardEnding("aborted", "the pitch left its limit", _limit("max-pitch")),
    "time": AboardEnding("aborted", "the time was over", _limit("max-time")),
    "battery voltage": AboardEnding("aborted", "the battery voltage was too low", "Charge the battery"),
    "battery remaining": AboardEnding("aborted", "the battery charge was too low", "Charge the battery"),
    "no oscillation": AboardEnding("aborted", "the craft did not oscillate", "Use a larger --relay-output"),
    "too weak": AboardEnding("aborted", "the oscillation was too weak", "Use a larger --relay-output"),
    "overwhelmed": AboardEnding("aborted", "the craft drifted against the relay", "Use a larger --relay-output"),
    "unsettled": AboardEnding("aborted", "the oscillation did not become steady", "Use a larger --relay-hysteresis"),
    "wrong way": AboardEnding(
        "aborted", "the craft moved against the relay from the start", "Check SERVOn_REVERSED and the motor directions"
    ),
}
"""Word in the script's last message -> what it means."""


def headroom(servos: ServoMap, force: str, throttle: float) -> float:
    """Return the largest output of *force* [fraction of full] that saturates no output at a constant *throttle*."""
    ahead = {output.channel: factor for output, factor in servos.driving("X")}
    room = [
        (1.0 - abs(throttle * ahead.get(output.channel, 0.0))) / abs(factor) for output, factor in servos.driving(force)
    ]
    return min(room, default=0.0)


@dataclass(frozen=True, slots=True)
class AboardScript:
    """Everything that one script is made of; SI units and radians.

    Attributes
    ----------
    relay : the relays; of these the script reads the fields of :class:`RelaySettings` as a relay of this tool does.
    servos : the vehicle's outputs. envelope : the limits.
    mode : number of the flight mode in which it flies. token : number that starts it, in the parameter ``go``.
    path : the script's own file on the vehicle.
    sticks : channels that end it when they move.
    rows, ends : name, labels and format letters of the two messages that it logs.
    step : size of the step [rad or m]. step_time : its longest duration each way [s].
    silence : longest time without a heartbeat of the ground station [s]; 0: any.
    whole : longest duration of everything [s]. wait : longest time from loading to the start [s].
    period : control period [s].
    """

    relay: RelaySettings
    servos: ServoMap
    envelope: Envelope
    mode: int
    token: int
    go: str
    path: str
    sticks: tuple[int, ...]
    rows: tuple[str, str, str]
    ends: tuple[str, str, str]
    step: float
    step_time: float = 20.0
    silence: float = 10.0
    whole: float = 900.0
    wait: float = 300.0
    period: float = 0.02

    @property
    def text(self) -> str:
        """The Lua source."""
        body = files("gcs_autotune.manoeuvres").joinpath("aboard.lua").read_text(encoding="utf-8")
        return f"local S = {_lua(self._table())}\n{body}"

    def _table(self) -> dict[str, Any]:
        r = self.relay
        held = HELD_DURING[r.signal] if r.keep_still else ()
        before = HELD_BEFORE.get(r.signal) if r.keep_still else None
        driven = dict.fromkeys([r.force, *(["X"] if r.throttle else []), *(g.force for g in held)])
        return {
            "id": self.token,
            "go": self.go,
            "path": self.path,
            "mode": self.mode,
            "period": round(1e3 * self.period),
            "hold": HOLD,
            "wait": round(1e3 * self.wait),
            "silence": round(1e3 * self.silence) or None,
            "stick": STICK,
            "sticks": list(self.sticks),
            "signal": r.signal,
            "force": r.force,
            "throttle": r.throttle,
            "needs_way": r.throttle != 0.0,
            "outputs": _outputs(self.servos, list(driven)),
            "output": r.output,
            "first_output": r.first_output,
            "most_output": r.most_output,
            "growth": r.growth,
            "hysteresis": r.hysteresis,
            "least_hysteresis": r.least_hysteresis,
            "periods": r.periods,
            "most_periods": r.most_periods,
            "unsettled_periods": r.unsettled_periods,
            "tolerance": r.tolerance,
            "patience": round(1e3 * r.patience),
            "plan": list(PLAN),
            "step": self.step,
            "step_time": round(1e3 * self.step_time),
            "holds": [_gains(g) for g in held],
            "before": None if before is None else _gains(before),
            "limits": self._limits(),
            "zones": self._zones(),
            "log": {"rows": list(self.rows), "ends": list(self.ends)},
        }

    def _limits(self) -> dict[str, float | None]:
        e, far = self.envelope, self.envelope.distance_limit
        return {
            "heading": e.heading_excursion,
            "depth_excursion": e.depth_excursion,
            "depth_max": e.depth_max,
            "depth_min": e.depth_min or None,
            "speed": e.speed_limit,
            "distance": far,
            "room": min(NEARLY * far, far - min(e.turning * e.cruise, 0.5 * far)),
            "turn_rate": e.turn_rate,
            "roll": e.roll,
            "pitch": e.pitch,
            "time": e.time,
            "whole": self.whole,
            "volts": e.battery_voltage or None,
            "charge": 100.0 * e.battery_remaining or None,
        }

    def _zones(self) -> list[dict[str, Any]]:
        zones = () if self.envelope.area is None else self.envelope.area.zones
        return [
            {"corners": [v for corner in zone.corners for v in corner], "radius": zone.radius, "inside": zone.inside}
            for zone in zones
        ]


def _outputs(servos: ServoMap, forces: Sequence[str]) -> list[dict[str, Any]]:
    """Return, per output that one of *forces* drives, its pulses and its factor of each force."""
    rows: dict[int, dict[str, Any]] = {}
    for force in forces:
        for output, factor in servos.driving(force):
            up, down = output.high - output.trim, output.trim - output.low
            if output.sign < 0.0:
                up, down = -down, -up
            row = {"chan": output.channel - 1, "trim": output.trim, "up": up, "down": down, "of": {}}
            rows.setdefault(output.channel, row)["of"][force] = factor
    return list(rows.values())


def _gains(gains: HoldGains) -> dict[str, Any]:
    return {"signal": gains.signal, "rate": gains.rate, "force": gains.force} | {
        "P": gains.P,
        "I": gains.I,
        "D": gains.D,
        "most": gains.most,
    }


def _lua(value: Any) -> str:
    """Return *value* as a Lua literal. Unknown and infinite numbers are left out of tables."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return f"{value:.9g}"
    if isinstance(value, str):
        return "'" + value.replace("\\", "\\\\").replace("'", "\\'") + "'"
    if isinstance(value, Mapping):
        known = {key: v for key, v in value.items() if v is not None and not (isinstance(v, float) and math.isinf(v))}
        return "{" + ", ".join(f"{key} = {_lua(v)}" for key, v in known.items()) + "}"
    return "{" + ", ".join(map(_lua, value)) + "}"
