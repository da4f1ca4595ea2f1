"""Treatment of each effect in a design, with advice on parameters or repairs.

MOT_THR_MIN, MOT_THST_EXPO and MOT_THST_ASYM belong to ArduRover's motor library (the last two for thrusters only).
ArduSub's thrusters map output linearly to pulse, independent of MOT_THST_EXPO.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from gcs_autotune.design.actuator import PERFECT, Actuator
from gcs_autotune.effects import SUBTRACTED, EffectInstance, effect_words
from gcs_autotune.notebook import Displayed
from gcs_autotune.sname import Dof

__all__ = ["Draft", "Remark", "take"]

IN_USE = 1800.0
"""Time [s] for which a drift of the gain is extrapolated: half an hour on the water. Project choice."""

WEAKEST = 0.3
"""Smallest thrust considered, as a fraction of that with a fresh battery.

Project choice: a battery is changed before thrust falls below it.
"""


@dataclass(frozen=True, slots=True)
class Remark(Displayed):
    """Remark about one effect of a model.

    - ``slug``, ``place``: the effect and where it acts.
    - ``treated``: treatment of the effect in the design.
    - ``advice``: further action, if any.
    """

    slug: str
    place: str
    treated: str
    advice: str = ""

    @property
    def sentence(self) -> str:
        """Treatment and advice as text."""
        advice = f". {self.advice[0].upper()}{self.advice[1:]}" if self.advice else ""
        return f"{effect_words(self.slug)} ({self.place}): {self.treated}{advice}"


@dataclass(slots=True)
class Draft:
    """A reduction in progress: ``numbers`` of the axis, and ``gain`` of its force per unit of ``channel``, SI."""

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
    """Apply the effect *own* to *draft*, and add a remark about it."""
    here = own.place in (draft.channel, draft.dof.name)
    if own.slug in _REDUCED and (here or own.slug in _ANYWHERE):
        treated, advice = _REDUCED[own.slug](draft, own)
    elif own.slug in _LEFT_OUT and _concerns(own, draft):
        treated, advice = _LEFT_OUT[own.slug]
    elif own.place in draft.channel.split("+"):
        treated, advice = (
            "it acts on one of several thrusters, so the design omits it",
            "check the gains carefully on the water",
        )
    else:
        treated, advice = "it does not act in this loop, so the design omits it", ""
    draft.remarks.append(Remark(own.slug, own.place, treated, advice))


def _concerns(own: EffectInstance, draft: Draft) -> bool:
    mine = {draft.channel, draft.dof.name, draft.dof.position, draft.dof.velocity, *draft.channel.split("+")}
    return own.slug in _ANYWHERE or bool(mine & set(own.place.split("+"))) or " " in own.place


def _delay(draft: Draft, own: EffectInstance) -> tuple[str, str]:
    draft.numbers["delay"] += own["delay"]
    return f"the loop includes the delay of {own['delay']:.2f} s, which slows it", ""


def _late(draft: Draft, own: EffectInstance) -> tuple[str, str]:
    if not {draft.dof.position, draft.dof.velocity} & set(own.place.split("+")):
        return "it does not act in this loop, so the design omits it", ""
    treated, _ = _delay(draft, own)
    return treated, "if the delay is in the telemetry and not in the sensor, set it as link delay for a faster loop"


def _lag(draft: Draft, own: EffectInstance) -> tuple[str, str]:
    draft.actuator = replace(draft.actuator, lag=draft.actuator.lag + own["time_constant"])
    return f"the loop includes the lag of {own['time_constant']:.2f} s", ""


def _limit(draft: Draft, own: EffectInstance) -> tuple[str, str]:
    draft.actuator = replace(draft.actuator, limit=min(draft.actuator.limit, own["limit"]))
    return (
        "the simulated step clips the output at this limit",
        "thrust that flattens gradually gives such a limit too. Otherwise check SERVOn_MIN and SERVOn_MAX",
    )


def _rate(draft: Draft, own: EffectInstance) -> tuple[str, str]:
    draft.actuator = replace(draft.actuator, rate=min(draft.actuator.rate, own["rate"]))
    advice = "for thrusters check MOT_SLEWRATE" if draft.law.startswith("rover") else ""
    return "the simulated step includes this slew rate", advice


def _backlash(draft: Draft, own: EffectInstance) -> tuple[str, str]:
    draft.actuator = replace(draft.actuator, backlash=own["width"])
    return (
        "the gains give the smallest limit cycle with the backlash in the loop",
        "repair the linkage, since no parameter removes backlash",
    )


def _dead(draft: Draft, own: EffectInstance) -> tuple[str, str]:
    subtracted = own.constants.get(SUBTRACTED, 1.0)
    draft.actuator = replace(draft.actuator, dead_zone=own["width"], subtracted=subtracted)
    return "the gains are chosen with the dead zone in the loop", _MEND_DEAD_ZONE.get(draft.law, "")


_MEND_DEAD_ZONE: Mapping[str, str] = {
    "rover-heading": "for thrusters, raise small outputs with MOT_THR_MIN (percent of full, at most 20). Then "
    "diagnose and tune again. For a rudder servo, repair the linkage, since no parameter helps",
    "sub-heading": "calibrate the ESCs. ArduSub has no parameter that raises small outputs",
    "sub-depth": "calibrate the ESCs. ArduSub has no parameter that raises small outputs",
}


def _bent(draft: Draft, own: EffectInstance) -> tuple[str, str]:
    draft.actuator = replace(draft.actuator, square=own["share"], reference=own.constants.get("u_ref", 1.0))
    advice = "ArduSub has no parameter that linearises the thrust"
    if draft.law.startswith("rover"):
        expo = float(np.clip(own["share"], -1.0, 1.0))
        advice = f"for thrusters, set MOT_THST_EXPO to about {expo:.2f} to linearise the thrust, then tune again"
    return (
        "margins cover small outputs up to half of full output. At full output the actuator is at most twice as strong",
        advice,
    )


def _stall(draft: Draft, own: EffectInstance) -> tuple[str, str]:
    draft.actuator = replace(draft.actuator, limit=min(draft.actuator.limit, own["angle"]))
    return (
        f"the simulated step limits the rudder to {math.degrees(own['angle']):.0f} deg",
        "narrow SERVOn_MIN and SERVOn_MAX to that angle, since more rudder steers less. Then tune again",
    )


def _asymmetric(draft: Draft, own: EffectInstance) -> tuple[str, str]:
    ratio = own["ratio"]
    draft.actuator = replace(draft.actuator, astern=ratio)
    advice = "ArduSub has no parameter for each direction of a thruster"
    if draft.law.startswith("rover"):
        advice = "trim the weaker side with SERVOn_MIN or SERVOn_MAX"
        stronger = max(ratio, 1.0 / ratio)
        advice += f". If each thruster is weaker astern, set MOT_THST_ASYM to about {stronger:.2f}"
    return "margins cover both directions, and both are simulated", advice


def _drift(draft: Draft, own: EffectInstance) -> tuple[str, str]:
    left = float(np.clip(1.0 - own["rate"] * IN_USE, WEAKEST, 2.0))
    draft.actuator = replace(draft.actuator, weakest=left)
    return f"margins cover a thrust down to {left:.0%}, the value after half an hour", ""


def _steering(draft: Draft, own: EffectInstance) -> tuple[str, str]:
    reference = own.constants.get("U_ref", math.nan)
    if draft.speed is None or not reference > 0.0:
        return "the gains are valid only at the speed of the identification runs", ""
    factor = (1.0 - own["share"]) + own["share"] * (draft.speed / reference) ** 2
    draft.gain *= factor
    return (
        f"the design is for {draft.speed:.1f} m/s, where the rudder effect is {factor:.2f} times that of the "
        "identification runs"
    ), ""


def _linear(draft: Draft, own: EffectInstance) -> tuple[str, str]:
    draft.numbers["beta"] += own["coefficient"]
    return "the design includes this drag", ""


def _quadratic(draft: Draft, own: EffectInstance) -> tuple[str, str]:
    draft.numbers["beta_quadratic"] += own["coefficient"]
    return "the design includes this drag. Margins cover the craft at rest and under way", ""


def _constant(name: str) -> Callable[[Draft, EffectInstance], tuple[str, str]]:
    def treat(draft: Draft, own: EffectInstance) -> tuple[str, str]:
        draft.numbers["delta"] += own[name]
        return "the integral gain removes its error", "trim the craft if possible, since the force uses up output"

    return treat


def _payload(draft: Draft, own: EffectInstance) -> tuple[str, str]:
    draft.heavier = max(own["ratio"], 1.0 / own["ratio"])
    draft.numbers["alpha"] *= min(own["ratio"], 1.0)
    return f"margins cover the inertia before and after the change (ratio {own['ratio']:.2f})", ""


def _coarse(draft: Draft, own: EffectInstance) -> tuple[str, str]:
    if own.place == draft.dof.position:
        draft.quantum = max(draft.quantum, own["step"])
        return "errors smaller than one step of the sensor count as zero", ""
    return "it is omitted", ""


_REDUCED: Mapping[str, Callable[[Draft, EffectInstance], tuple[str, str]]] = {
    "input-delay": _delay,
    "measurement-delay": _late,
    "actuator-lag": _lag,
    "saturation": _limit,
    "rate-limit": _rate,
    "backlash": _backlash,
    "dead-zone": _dead,
    "quadratic-actuator": _bent,
    "rudder-stall": _stall,
    "asymmetric-thrust": _asymmetric,
    "gain-drift": _drift,
    "speed-dependent-steering": _steering,
    "linear-drag": _linear,
    "quadratic-drag": _quadratic,
    "input-bias": _constant("bias"),
    "net-buoyancy": _constant("force"),
    "mass-change": _payload,
    "quantisation": _coarse,
}
"""Slug -> function that applies the effect to a draft."""

_ANYWHERE = frozenset({"measurement-delay", "quantisation", "mass-change", "time-scale"})
"""Effects that act on every axis, whatever their place."""

_FILE = ("the fault is in the record and not in the craft, so the design uses corrected numbers", "")

_LEFT_OUT: Mapping[str, tuple[str, str]] = {
    "time-scale": _FILE,
    "time-offset": _FILE,
    "unit-error": _FILE,
    "sign-error": (
        "the design uses the physical sign",
        "check that the record is wrong and not SERVOn_REVERSED. With a wrong SERVOn_REVERSED the craft spins",
    ),
    "channel-swap": (_FILE[0], "check that the record is wrong and not the wiring"),
    "propeller-wash": ("the gains are valid only at the thrust of the identification runs", ""),
    "command-coupling": ("omitted, since the other axis' command is only a disturbance of this loop", ""),
    "advance-speed-loss": ("omitted, since it only adds damping. The margins are therefore conservative", ""),
    "ground-effect": ("omitted, since drag is only higher near the bottom. The margins are therefore conservative", ""),
    "coriolis-coupling": ("omitted, since it is only a disturbance of this loop", ""),
    "sway-yaw-coupling": ("omitted. Fly the test steps at the speed of the identification runs", ""),
    "sway-moment": ("omitted. Fly the test steps at the speed of the identification runs", ""),
    "speed-damping": (
        "omitted. The loop is designed with the damping of the plain model at rest",
        "check the gains at the speed where they will be used",
    ),
    "munk-moment": ("omitted. Fly the test steps at the speed of the identification runs", ""),
    "velocity-product": ("omitted. Fly the test steps at the speed of the identification runs", ""),
    "steady-current": ("omitted, since it does not affect heading or depth", ""),
    "changing-current": ("omitted, since it does not affect heading or depth", ""),
    "wind-moment": ("omitted, since the integral gain removes its error", ""),
    "wind-load": ("omitted, since the integral gain removes its error", ""),
    "wave-disturbance": (
        "omitted, since waves are only a disturbance of this loop",
        "for less actuator use in waves, set a longer settling time",
    ),
    "tether-pull": ("omitted, since the integral gain removes its error", ""),
    "tether-line": ("omitted, since it acts only beyond the tether's length", ""),
    "shallow-water": (
        "omitted. The gains are valid at the depth of the identification runs",
        "check them at the depth where they will be used",
    ),
    "bank-suction": ("omitted, since it is only a disturbance of this loop", "keep clear of the wall"),
    "sensor-position": (
        "omitted, since it does not affect heading or turn rate",
        "set the sensor's position in the autopilot",
    ),
    "compass-deviation": ("omitted, since the loop follows the compass with its deviation", "calibrate the compass"),
    "gyro-bias": (
        "omitted, since the autopilot removes it at start-up if the craft is at rest",
        "start the autopilot with the craft at rest",
    ),
    "outliers": ("left out", "repair the sensor, since the autopilot uses it too"),
}
"""Slug -> (treatment, advice) of effects that the design omits."""
