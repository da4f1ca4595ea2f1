"""How a design treats each effect, and what a parameter or a screwdriver can do about it.

MOT_THR_MIN, MOT_THST_EXPO and MOT_THST_ASYM: ArduRover's motor library (the last two for thrusters only); ArduSub's
thrusters take output to pulse in a straight line, whatever MOT_THST_EXPO says.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from gcs_autotune.design.actuator import PERFECT, Actuator
from gcs_autotune.effects import SUBTRACTED, EffectInstance
from gcs_autotune.sname import Dof

__all__ = ["Draft", "Remark", "take"]

IN_USE = 1800.0
"""Time [s] over which a drift of the gain is looked ahead: half an hour on the water."""

WEAKEST = 0.3
"""A battery is changed before the thrust falls to this share."""


@dataclass(frozen=True, slots=True)
class Remark:
    """What the design makes of one effect: ``treated`` how, ``advice`` what can be done besides (may be empty)."""

    slug: str
    place: str
    treated: str
    advice: str = ""

    @property
    def sentence(self) -> str:
        """Both, to be read."""
        return f"{self.slug} at {self.place}: {self.treated}" + (f"; {self.advice}" if self.advice else "")


@dataclass(slots=True)
class Draft:
    """A reduction while it is being made: ``numbers`` and ``gain`` (per unit of ``channel``) of the axis' force, SI."""

    dof: Dof
    channel: str
    gain: float
    law: str
    speed: float | None
    numbers: dict[str, float]
    actuator: Actuator = PERFECT
    heavier: float = 1.0
    quantum: float = 0.0
    remarks: list[Remark] = field(default_factory=list)


def take(draft: Draft, own: EffectInstance) -> None:
    """Let one effect alter the draft."""
    here = own.place in (draft.channel, draft.dof.name)
    if own.slug in _REDUCED and (here or own.slug in _ANYWHERE):
        treated, advice = _REDUCED[own.slug](draft, own)
    elif own.slug in _LEFT_OUT and _concerns(own, draft):
        treated, advice = _LEFT_OUT[own.slug]
    elif own.place in draft.channel.split("+"):
        treated, advice = (
            "it sits on one of several thrusters, so the design leaves it out",
            "prove the gains with care",
        )
    else:
        treated, advice = "it does not act in this loop, so the design leaves it out", ""
    draft.remarks.append(Remark(own.slug, own.place, treated, advice))


def _concerns(own: EffectInstance, draft: Draft) -> bool:
    mine = {draft.channel, draft.dof.name, draft.dof.position, draft.dof.velocity, *draft.channel.split("+")}
    return own.slug in _ANYWHERE or bool(mine & set(own.place.split("+"))) or " " in own.place


def _delay(draft: Draft, own: EffectInstance) -> tuple[str, str]:
    draft.numbers["delay"] += own["delay"]
    return f"the delay of {own['delay']:.2f} s is part of the loop, which is made slower for it", ""


def _late(draft: Draft, own: EffectInstance) -> tuple[str, str]:
    if not {draft.dof.position, draft.dof.velocity} & set(own.place.split("+")):
        return "it does not act in this loop, so the design leaves it out", ""
    treated, _ = _delay(draft, own)
    return treated, "if it lies in the telemetry and not in the sensor, give it as link delay: the loop may be faster"


def _lag(draft: Draft, own: EffectInstance) -> tuple[str, str]:
    draft.actuator = replace(draft.actuator, lag=draft.actuator.lag + own["time_constant"])
    return f"the lag of {own['time_constant']:.2f} s is part of the loop", ""


def _limit(draft: Draft, own: EffectInstance) -> tuple[str, str]:
    draft.actuator = replace(draft.actuator, limit=min(draft.actuator.limit, own["limit"]))
    return "the step is simulated with the output clipped there", "look at SERVOn_MIN and SERVOn_MAX"


def _rate(draft: Draft, own: EffectInstance) -> tuple[str, str]:
    draft.actuator = replace(draft.actuator, rate=min(draft.actuator.rate, own["rate"]))
    advice = "on thrusters look at MOT_SLEWRATE" if draft.law.startswith("rover") else ""
    return "the step is simulated with the output as slow as that", advice


def _play(draft: Draft, own: EffectInstance) -> tuple[str, str]:
    draft.actuator = replace(draft.actuator, play=own["width"])
    return (
        "the gains are chosen with the play in the loop, so that it hunts as little as it can",
        "no parameter takes play out: mend the linkage",
    )


def _dead(draft: Draft, own: EffectInstance) -> tuple[str, str]:
    subtracted = own.constants.get(SUBTRACTED, 1.0)
    draft.actuator = replace(draft.actuator, dead_zone=own["width"], subtracted=subtracted)
    return "the gains are chosen with the dead zone in the loop", _MEND_DEAD_ZONE.get(draft.law, "")


_MEND_DEAD_ZONE: Mapping[str, str] = {
    "rover-heading": "with thrusters let MOT_THR_MIN lift small outputs over it (percent of full, 20 at most), then "
    "diagnose and tune again; behind a rudder servo no parameter does: mend the linkage",
    "sub-heading": "ArduSub has no parameter that lifts small outputs: calibrate the ESCs",
    "sub-depth": "ArduSub has no parameter that lifts small outputs: calibrate the ESCs",
}


def _bent(draft: Draft, own: EffectInstance) -> tuple[str, str]:
    draft.actuator = replace(draft.actuator, square=own["share"], reference=own.constants.get("u_ref", 1.0))
    advice = "ArduSub has no parameter against it"
    if draft.law.startswith("rover"):
        expo = float(np.clip(own["share"], -1.0, 1.0))
        advice = f"with thrusters MOT_THST_EXPO about {expo:.2f} straightens it; then tune again"
    return (
        "margins hold from small outputs to half of full, whose gains differ; at full it is twice as strong at most",
        advice,
    )


def _stall(draft: Draft, own: EffectInstance) -> tuple[str, str]:
    draft.actuator = replace(draft.actuator, limit=min(draft.actuator.limit, own["angle"]))
    return (
        f"the step is simulated as if the rudder stopped at {math.degrees(own['angle']):.0f} deg",
        "beyond that it steers worse: narrow SERVOn_MIN and SERVOn_MAX to that angle, then tune again",
    )


def _lopsided(draft: Draft, own: EffectInstance) -> tuple[str, str]:
    ratio = own["ratio"]
    draft.actuator = replace(draft.actuator, astern=ratio)
    advice = "trim the weaker side with SERVOn_MIN or SERVOn_MAX"
    if draft.law.startswith("rover"):
        stronger = max(ratio, 1.0 / ratio)
        advice += f"; if each thruster pushes weaker astern, MOT_THST_ASYM about {stronger:.2f} evens that out"
    return "margins hold for both directions, and both steps are simulated", advice


def _drift(draft: Draft, own: EffectInstance) -> tuple[str, str]:
    left = float(np.clip(1.0 - own["rate"] * IN_USE, WEAKEST, 2.0))
    draft.actuator = replace(draft.actuator, weakest=left)
    return f"margins hold down to {left:.0%} of the thrust, half an hour ahead", ""


def _steering(draft: Draft, own: EffectInstance) -> tuple[str, str]:
    reference = own.constants.get("U_ref", math.nan)
    if draft.speed is None or not reference > 0.0:
        return "the gains hold at the speed of the runs only", ""
    factor = (1.0 - own["share"]) + own["share"] * (draft.speed / reference) ** 2
    draft.gain *= factor
    return f"designed for {draft.speed:.1f} m/s, where the rudder bites {factor:.2f} times as in the runs", ""


def _linear(draft: Draft, own: EffectInstance) -> tuple[str, str]:
    draft.numbers["beta"] += own["coefficient"]
    return "part of the drag the loop is designed for", ""


def _quadratic(draft: Draft, own: EffectInstance) -> tuple[str, str]:
    draft.numbers["beta_quadratic"] += own["coefficient"]
    return "part of the drag: margins hold at rest and under way", ""


def _constant(name: str) -> Callable[[Draft, EffectInstance], tuple[str, str]]:
    def treat(draft: Draft, own: EffectInstance) -> tuple[str, str]:
        draft.numbers["delta"] += own[name]
        return "the integral gain works it off", "trim it away if you can: it uses up output"

    return treat


def _payload(draft: Draft, own: EffectInstance) -> tuple[str, str]:
    draft.heavier = max(own["ratio"], 1.0 / own["ratio"])
    draft.numbers["alpha"] *= min(own["ratio"], 1.0)
    return f"margins hold for the inertia with and without it (times {own['ratio']:.2f})", ""


def _coarse(draft: Draft, own: EffectInstance) -> tuple[str, str]:
    if own.place == draft.dof.position:
        draft.quantum = max(draft.quantum, own["step"])
        return "errors within one step count as none", ""
    return "it is left out", ""


_REDUCED: Mapping[str, Callable[[Draft, EffectInstance], tuple[str, str]]] = {
    "input-delay": _delay,
    "measurement-delay": _late,
    "actuator-lag": _lag,
    "saturation": _limit,
    "rate-limit": _rate,
    "backlash": _play,
    "dead-zone": _dead,
    "quadratic-actuator": _bent,
    "rudder-stall": _stall,
    "asymmetric-thrust": _lopsided,
    "gain-drift": _drift,
    "speed-dependent-steering": _steering,
    "linear-drag": _linear,
    "quadratic-drag": _quadratic,
    "input-bias": _constant("bias"),
    "net-buoyancy": _constant("force"),
    "mass-change": _payload,
    "quantisation": _coarse,
}
"""Slug -> how it enters the design."""

_ANYWHERE = frozenset({"measurement-delay", "quantisation", "mass-change", "time-scale"})
"""Effects that are asked wherever they sit."""

_FILE = ("it is in the record, not in the craft: the design uses the numbers freed of it", "")

_LEFT_OUT: Mapping[str, tuple[str, str]] = {
    "time-scale": _FILE,
    "time-offset": _FILE,
    "unit-error": _FILE,
    "sign-error": (
        "the design uses the sign the physics has",
        "make sure it is the record that is wrong, not SERVOn_REVERSED: with the wrong one the craft spins",
    ),
    "channel-swap": (_FILE[0], "make sure it is the record that is wrong, not the wiring"),
    "command-coupling": ("left out: the other axis' command is a disturbance to this loop", ""),
    "advance-speed-loss": ("left out: it only damps, the margins are on the safe side", ""),
    "ground-effect": ("left out: near the bottom there is more drag, the margins are on the safe side", ""),
    "coriolis-coupling": ("left out: it is a disturbance to this loop", ""),
    "sway-yaw-coupling": ("left out: hold the speed of the runs when the gains are proved", ""),
    "sway-moment": ("left out: hold the speed of the runs when the gains are proved", ""),
    "speed-damping": (
        "left out: the damping of the loop is that of the plain model, at rest",
        "prove the gains at the speed they are for",
    ),
    "munk-moment": ("left out: hold the speed of the runs when the gains are proved", ""),
    "velocity-product": ("left out: hold the speed of the runs when the gains are proved", ""),
    "steady-current": ("left out: headings and depths do not feel it", ""),
    "wind-moment": ("left out: it is a disturbance to this loop, worked off by the integral gain", ""),
    "wave-disturbance": (
        "left out: the loop answers to waves as to any disturbance",
        "if the actuator works too hard in them, ask for a longer settling time",
    ),
    "tether-pull": ("left out: it pulls the craft back, which the integral gain works off", ""),
    "sensor-position": (
        "left out: heading and turn rate are the same everywhere aboard",
        "tell the autopilot where it sits",
    ),
    "compass-deviation": ("left out: the loop follows the compass, deviation and all", "calibrate the compass"),
    "gyro-bias": ("left out: the autopilot takes it out when it starts, at rest", "start the autopilot at rest"),
    "outliers": ("left out", "mend the sensor: the autopilot sees them too"),
}
"""Slug -> what is said of effects the design does not use."""
