"""Static actuator effects, backlash, and base classes of all actuator effects."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects.effect import INPUT, Drive, Effect, EffectCurve, EffectInstance, Quantity, columns_of
from gcs_autotune.effects.kernels import backlash
from gcs_autotune.effects.summary import DataSummary
from gcs_autotune.models import CoupledModel
from gcs_autotune.sname import DOFS

__all__ = [
    "RESOLUTION",
    "SUBTRACTED",
    "ActuatorEffect",
    "AsymmetricThrust",
    "Backlash",
    "Characteristic",
    "DeadZone",
    "Gradual",
    "QuadraticActuator",
    "RudderStall",
    "Saturation",
    "SharedActuatorEffect",
    "horizon",
    "largest",
    "last_stamp",
    "quickest",
    "redrawn",
    "steers",
    "with_other",
]

Array = NDArray[np.float64]


FAINT = 1e-3
"""Largest acceptable error of the craft's response, relative to the largest command. Project choice.

The error arises because a continuous motion of the actuator is approximated by held values.
"""

QUICK, SLOW = 0.1, 5.0
"""Limits of the craft's time constant [s], for the choice of the time steps between stamps. Project choice."""

CAUTION = 3.0
"""Factor by which a plain model may overestimate the craft's time constant if the actuator is slow. Project choice."""

RESOLUTION = "resolution"
"""Name of a constant [input unit s] that sets the time steps of effects that move between stamps.

It limits the slope of the motion times the squared length of a piece with a held value.
"""


class ActuatorEffect(Effect):
    """Base class of effects on one input. The place of such an effect is the channel of the input."""

    family = "actuator"

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Return the names of all inputs that were used."""
        return tuple(n for n in data.inputs if data.amplitude[n] > 0.0)


class SharedActuatorEffect(ActuatorEffect):
    """Base class of effects that may apply to two thrusters of one kind.

    The place is then both channels, joined by ``+``.
    """

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Return the names of all inputs that were used, and all pairs of thrusters of one kind, joined by ``+``.

        Of two thrusters with nearly equal commands, only the pair is returned.
        """
        used = super().places(data)
        alike = {n for pair in data.commanded_alike for n in pair}
        both = ["+".join(pair) for pair in data.twins if set(pair) <= set(used)]
        return (*(n for n in used if n not in alike), *both)


class Characteristic(SharedActuatorEffect):
    """Base class of effects in which the output depends only on the present command, by a static curve."""

    title: ClassVar[str]

    def acting(self, effect: EffectInstance, u: Array) -> Array:
        """Return the actuator's output (n,) for the commands *u* (n,), both in the input's unit."""
        raise NotImplementedError

    def drive(self, effect: EffectInstance, drive: Drive) -> Drive:
        """Return *drive* with the curve applied to every command at the place of *effect*."""
        for name in columns_of(effect.place):
            drive = drive.with_channel(name, self.acting(effect, drive.channels[name]))
        return drive

    def curve(self, effect: EffectInstance, data: DataSummary) -> EffectCurve:
        """Return plot data: output over command."""
        u = np.linspace(-largest(effect.place, data), largest(effect.place, data), 201)
        unit = data.inputs[columns_of(effect.place)[0]]
        x_label, y_label = f"{effect.place} commanded [{unit}]", f"{effect.place} acting [{unit}]"
        return EffectCurve(u, self.acting(effect, u), x_label, y_label, self.title, plain=u)


class Gradual(SharedActuatorEffect):
    """Base class of effects in which the actuator moves between the stamps of its commands."""

    def constants(self, place: str, data: DataSummary) -> Mapping[str, float]:
        """Return the constant :data:`RESOLUTION`, fine enough for this craft's time constant."""
        return {RESOLUTION: 4.0 * FAINT * quickest(data) * largest(place, data)}

    def resolution(self, effect: EffectInstance, u: Array) -> float:
        """Return the constant :data:`RESOLUTION` of *effect*, or else its value for the fastest craft and the
        commands *u*.
        """
        return effect.constants.get(RESOLUTION, 4.0 * FAINT * QUICK * max(float(np.abs(u).max(initial=0.0)), 1e-12))


def quickest(data: DataSummary) -> float:
    """Return the shortest time constant [s] that the craft may have, from the base model.

    If the base model has no values, its slowest time constant is used.
    """
    found = data.time_constant
    model = CoupledModel(data.form, data.base)
    if data.base and np.linalg.matrix_rank(model.inertia) == len(data.form.dofs):
        rates = np.abs(np.linalg.eigvals(np.linalg.solve(model.inertia, model.linear_damping)))
        found = 1.0 / max(float(rates.max(initial=0.0)), 1e-9)
    return float(np.clip(found / CAUTION, QUICK, SLOW))


def horizon(data: DataSummary) -> tuple[float, float]:
    """Return the shortest and the longest time [s] to search: one sample and the craft's time constant.

    The longest time is at most a quarter of the run and at least four samples.
    """
    longest = min(data.time_constant, 0.25 * data.duration)
    return data.interval, max(longest, 4.0 * data.interval)


def last_stamp(drive: Drive) -> float:
    """Return the end of a run [s], which is the last stamp of its commands or measurements."""
    ends = [float(c.t[-1]) for c in drive.measured.values() if len(c)]
    return max([float(drive.t[-1]), *ends])


def largest(place: str, data: DataSummary) -> float:
    """Return the largest command of the input *place*, or of several inputs joined by ``+``."""
    return max(data.amplitude[n] for n in columns_of(place))


def steers(place: str, data: DataSummary) -> bool:
    """Return whether the input *place* turns the craft, that is, drives roll, pitch or yaw."""
    turning = {d.force for d in DOFS.values() if d.angular}
    return any(force in turning for n in columns_of(place) for force, _ in data.form.inputs.get(n, ()))


def redrawn(drive: Drive, place: str, moved: Callable[[Array], tuple[Array, Array]]) -> Drive:
    """Return *drive* with every channel of *place* replaced by the result of *moved*.

    moved : function of the commands (j,) at the stamps of *drive*. It returns stamps (k,) and the values (k,) held from
    these stamps on.

    A single channel has the new stamps only. With several channels, the stamps of all are merged.
    """
    names = columns_of(place)
    parts = {n: moved(drive.channels[n]) for n in names}
    if len(drive.channels) == 1:
        t, values = parts[names[0]]
        return replace(drive, t=t, channels={names[0]: values})
    together = np.unique(np.concatenate([drive.t, *(t for t, _ in parts.values())]))
    drawn = drive.on(together)
    for name, (t, values) in parts.items():
        drawn = drawn.with_channel(name, values[np.maximum(np.searchsorted(t, together, side="right") - 1, 0)])
    return drawn


def with_other(drive: Drive, name: str, other: str) -> tuple[Array, Array, Array] | None:
    """Return stamps (k,), and at these stamps the commands *name* (k,) and *other* (k,), each held until the next
    stamp.

    If *other* drives the craft, its commands include the effects applied before. Otherwise they are the recorded
    commands. Return None if either channel is missing.
    """
    if name not in drive.channels:
        return None
    if other in drive.channels:
        return drive.t, drive.channels[name], drive.channels[other]
    if other not in drive.measured:
        return None
    own = drive.measured[other]
    known = np.isfinite(own.values)
    if not known.any():
        return None
    t = np.union1d(drive.t, own.t[known & (own.t > drive.t[0])])
    beside = own.values[known][np.maximum(np.searchsorted(own.t[known], t, side="right") - 1, 0)]
    return t, drive.channels[name][np.searchsorted(drive.t, t, side="right") - 1], beside


LEAST_LIMIT = 0.05
"""Lower bound of a saturation limit, relative to the largest command. Project choice."""


class Saturation(Characteristic):
    """Effect: the output is the command, limited to ``-limit .. limit``."""

    slug = "saturation"
    title = "Saturation"
    meaning = "commands beyond a limit act like the limit itself: end stops, output limits, a weak battery"
    plain = "Beyond a limit, more {command} does nothing on your craft, unlike in {simulation}."
    parameters = (Quantity("limit", INPUT, "largest command that takes effect"),)
    shown_by = "residual against command: zero up to the limit, then opposed to the command and growing with it"
    mistaken_for = ("quadratic-drag", "rudder-stall", "quadratic-actuator", "rate-limit")
    yields_to = ("asymmetric-thrust",)  # of two thrusters, where the largest turns take the inner one astern
    separated_by = (
        "steps from rest to a quarter, half, three quarters and all of full command, both ways. Hold each until the "
        "speed is steady. With a limit, the largest steps start equally hard. With drag, they start harder but reach "
        "less extra speed"
    )

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return start values of ``limit``, from 20 % to 93 % of the largest command."""
        return tuple({"limit": share * largest(place, data)} for share in (0.2, 0.4, 0.6, 0.8, 0.93))

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return the bounds of ``limit``: from a twentieth of the largest command to the largest command."""
        return {"limit": (LEAST_LIMIT * largest(place, data), largest(place, data))}

    def acting(self, effect: EffectInstance, u: Array) -> Array:
        """Return the commands *u* (n,), limited to ``-limit .. limit``."""
        return np.clip(u, -effect["limit"], effect["limit"])


SUBTRACTED = "subtracted"
"""Name of a constant of a dead zone: the fraction of ``width`` that is subtracted from commands outside the dead zone.

If the constant is missing, the fraction is 1.
"""


class DeadZone(Characteristic):
    """Effect: the output is the excess of the command over ``width``, ``sign(u) max(|u| - width, 0)``.

    If the constant ``SUBTRACTED`` is 0, the effect is the neutral band of a speed controller. The output is then zero
    inside the band and the whole command outside, so that the force starts with a jump.
    """

    slug = "dead-zone"
    title = "Dead zone"
    meaning = "commands below a threshold do nothing, and larger commands are reduced by the threshold"
    plain = "A little {command} does nothing on your craft, unlike in {simulation}."
    parameters = (Quantity("width", INPUT, "half-width of the dead zone"),)
    grows_with = ("width",)
    shown_by = "residual against command: a kink on each side of zero"
    mistaken_for = ("backlash", "quadratic-actuator", "linear-drag")
    separated_by = (
        "steps from rest of several sizes, both ways. Start with one too small to move the craft and end with full "
        "command. Hold each until the speed is steady. Begin each from zero command, which excludes backlash"
    )

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return start values of ``width``, from 3 % to 50 % of the largest command."""
        return tuple({"width": share * largest(place, data)} for share in (0.03, 0.1, 0.25, 0.5))

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return the bounds of ``width``: from 0 to 95 % of the largest command."""
        return {"width": (0.0, 0.95 * largest(place, data))}

    def acting(self, effect: EffectInstance, u: Array) -> Array:
        """Return the commands *u* (n,) reduced by the dead zone, or zero inside it."""
        size, lost = np.abs(u), effect.constants.get(SUBTRACTED, 1.0) * effect["width"]
        return np.sign(u) * np.where(size > effect["width"], size - lost, 0.0)


class QuadraticActuator(Characteristic):
    """Effect: the output is ``(1 - share) u + share u|u|/u_ref``.

    It is proportional to the command at share 0, and to ``n|n|`` at share 1. ``u_ref`` is the largest command of the
    runs. The curve is the affine thruster ``a |n| n + b n`` of Miskovic2010, (2.7), with a gain of 1 at
    that command.
    """

    slug = "quadratic-actuator"
    words = "quadratic thrust curve"
    is_structural = True
    title = "Thrust curve"
    meaning = (
        "a share of the thrust grows with the square of the command (n|n|). If the share is positive, half command "
        "gives less than half thrust"
    )
    plain = "Half the {command} does not give your craft half the force, unlike {simulation}."
    parameters = (Quantity("share", "1", "quadratic fraction of the thrust at the largest command"),)
    grows_with = ("share",)
    shown_by = "residual against command: curved, with too little thrust at small commands and too much at large ones"
    mistaken_for = ("dead-zone", "quadratic-drag", "saturation", "speed-dependent-steering")
    yields_to = ("asymmetric-thrust",)  # as a saturation does
    separated_by = (
        "steps from rest to a quarter, half, three quarters and all of full command. The initial acceleration of "
        "each step follows the thrust curve, because there is no drag yet. Drag affects only the final speed"
    )

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return start values of ``share`` for a partly and a nearly fully quadratic thrust curve."""
        return ({"share": 0.4}, {"share": 0.9})

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return the bounds of ``share``: slightly wider than the physical range 0 to 1, so that a fit can end at
        either value.
        """
        return {"share": (-0.2, 1.2)}

    def constants(self, place: str, data: DataSummary) -> Mapping[str, float]:
        """Return the constant ``u_ref``, which is the largest command."""
        return {"u_ref": largest(place, data)}

    def acting(self, effect: EffectInstance, u: Array) -> Array:
        """Return the output (n,) of the thrust curve for the commands *u* (n,)."""
        return u * ((1.0 - effect["share"]) + effect["share"] * np.abs(u) / effect["u_ref"])


class RudderStall(Characteristic):
    """Effect: the output is ``u`` up to ``angle``; beyond this angle the rudder stalls and the output decreases.

    Beyond the angle the output is ``sign(u) max(angle - drop (|u| - angle), 0)``. Miskovic2010, (2.9), has the same
    shape with sines. Near the stall angle the two shapes differ little.
    """

    slug = "rudder-stall"
    title = "Rudder force"
    meaning = "beyond an angle the flow separates from the rudder, and more rudder turns the craft less"
    plain = "Beyond an angle the rudder of your craft stalls, unlike in {simulation}."
    parameters = (
        Quantity("angle", INPUT, "command at which the rudder stalls"),
        Quantity("drop", "1", "loss of force beyond the stall, per unit of command in excess"),
    )
    shown_by = "residual against command: zero up to an angle, beyond it steep and opposed to the command"
    mistaken_for = ("saturation", "quadratic-drag", "asymmetric-thrust", "backlash")
    separated_by = (
        "turns at one speed, both ways, with the rudder at a third, half, two thirds, five sixths and all of its "
        "range. With a stall, the turn rate falls beyond some angle. With a limit it stays the same. With drag it "
        "still grows"
    )

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Return the names of all inputs that turn the craft, except thrusters of a pair, because these are not
        rudders.
        """
        thrusters = {n for pair in data.twins for n in pair}
        return tuple(n for n in super().places(data) if steers(n, data) and not thrusters & set(columns_of(n)))

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return start values of ``angle``, relative to the largest command, with gentle and sudden stalls
        (``drop``).
        """
        shares = ((0.35, 0.5), (0.6, 0.5), (0.6, 1.5), (0.8, 0.7), (0.8, 2.0))
        return tuple({"angle": share * largest(place, data), "drop": drop} for share, drop in shares)

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return the bounds of ``angle`` and ``drop``.

        The angle is between a tenth of the largest command and the largest command. ``drop`` is at least 0.1, because 0
        would be a saturation.
        """
        return {"angle": (0.1 * largest(place, data), largest(place, data)), "drop": (0.1, 4.0)}

    def acting(self, effect: EffectInstance, u: Array) -> Array:
        """Return the commands *u* (n,), reduced beyond the stall angle."""
        size = np.abs(u)
        beyond = np.maximum(effect["angle"] - effect["drop"] * (size - effect["angle"]), 0.0)
        return np.where(size <= effect["angle"], u, np.sign(u) * beyond)


SHARED = "N+X"
"""Place of an effect on two thrusters that are driven by steering and throttle.

Steering is half the difference of the thrusters' commands, and throttle is half the sum.
"""

BOTH = 0.02
"""Least ratio of the smaller to the larger side of a command, for the command to count as used in both directions.

Project choice.
"""


class AsymmetricThrust(Characteristic):
    """Effect: negative commands are multiplied by ``ratio`` (Miskovic2010, (2.8), with ``a_b / a_f = b_b / b_f``).

    At ``"N+X"`` two thrusters side by side have the commands ``X + N`` and ``X - N``, and each thruster is weaker
    astern. In a turn with more steering than throttle the inner thruster runs astern. Both commands are normalised
    outputs.
    """

    slug = "asymmetric-thrust"
    title = "Thrust ahead and astern"
    meaning = (
        "the same command gives more force one way than the other, since most propellers are designed to push ahead"
    )
    plain = "On your craft {command} is stronger one way than the other, unlike in {simulation}."
    parameters = (Quantity("ratio", "1", "ratio of the gain of negative commands to that of positive commands"),)
    grows_with = ("ratio",)
    neutral: ClassVar[Mapping[str, float]] = {"ratio": 1.0}
    shown_by = "residual against command: a kink at zero, and straight on each side"
    mistaken_for = ("input-bias", "backlash", "gyro-bias", "wind-moment")
    separated_by = (
        "equal steps both ways at half and at full command, then equally long without command. A constant force "
        "shifts both sizes equally and moves the craft without command. An asymmetry grows with the command and "
        "moves nothing without it"
    )

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Return the names of all inputs that were used in both directions, and the two thrusters of steering and
        throttle.
        """
        alone = tuple(
            place
            for place in super().places(data)
            if all(_both_ways(data.extent.get(n, (-1.0, 1.0))) for n in columns_of(place))
        )
        return (*alone, *(place for place in (SHARED,) if self._is_shared(data)))

    def _is_shared(self, data: DataSummary) -> bool:
        """Return whether some steering commands were larger than the throttle and others were not.

        With only one of the two, the effect is indistinguishable from a gain.
        """
        steering, throttle = columns_of(SHARED)
        slow, fast = data.usual.get(throttle, (0.0, 0.0))
        used = data.inputs.get(steering) == "1" and data.inputs.get(throttle, "1") == "1"
        return used and max(abs(slow), abs(fast)) > 0.0 and data.amplitude[steering] > min(abs(slow), abs(fast))

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return start values of ``ratio`` for a weaker and a stronger thrust astern."""
        return ({"ratio": 0.6}, {"ratio": 1.5})

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return the bounds of ``ratio``: from a twentieth to twenty."""
        return {"ratio": (0.05, 20.0)}

    def acting(self, effect: EffectInstance, u: Array) -> Array:
        """Return the commands *u* (n,), with negative ones multiplied by ``ratio``."""
        return np.where(u < 0.0, effect["ratio"] * u, u)

    def drive(self, effect: EffectInstance, drive: Drive) -> Drive:
        """Return *drive* with negative commands multiplied by ``ratio``, or at ``"N+X"`` the negative thrust of
        each thruster.
        """
        if effect.place != SHARED:
            return super().drive(effect, drive)
        steering, throttle = columns_of(SHARED)
        both = with_other(drive, steering, throttle)
        if both is None:
            return drive
        t, N, X = both
        left, right = self.acting(effect, X + N), self.acting(effect, X - N)
        if throttle in drive.channels:
            drive = drive.with_channel(throttle, 0.5 * (left + right))
        return redrawn(drive, steering, lambda _: (t, 0.5 * (left - right)))

    def curve(self, effect: EffectInstance, data: DataSummary) -> EffectCurve:
        """Return plot data: output over command, or at ``"N+X"`` the output of one thruster over its command."""
        if effect.place != SHARED:
            return super().curve(effect, data)
        u = np.linspace(-1.0, 1.0, 201)
        labels = ("command to each thruster [1]", "effective command of each thruster [1]")
        return EffectCurve(u, self.acting(effect, u), *labels, self.title, plain=u)


def _both_ways(extent: tuple[float, float]) -> bool:
    low, high = extent
    return min(-low, high) > BOTH * max(-low, high)


class Backlash(SharedActuatorEffect):
    """Effect: the output stays constant until the command has moved ``width / 2`` past it, and then follows the
    command.

    The output starts at the first command. The result is exact for held commands.
    """

    slug = "backlash"
    meaning = "backlash in the linkage: after each reversal the command moves before the actuator follows"
    plain = "On your craft {command} does nothing at first after a reversal, but acts at once in {simulation}."
    parameters = (Quantity("width", INPUT, "full width of the backlash, from one side to the other"),)
    grows_with = ("width",)
    shown_by = "residual against command: a loop, above the line while the command falls and below it while it rises"
    mistaken_for = ("dead-zone", "input-delay", "actuator-lag", "rate-limit", "input-bias")
    yields_to = ("dead-zone",)  # to a relay, which always goes from end to end, both are the same
    separated_by = (
        "a staircase from zero to full command, down to full reverse and back, five steps each way. Hold each step "
        "until the speed is steady. With backlash the same command gives different speeds on the way up and down. "
        "With a dead zone or a lag it does not"
    )

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return start values of ``width``, from 10 % to 120 % of the largest command.

        A width of twice the largest command is the whole range of the command.
        """
        return tuple({"width": share * largest(place, data)} for share in (0.1, 0.3, 0.7, 1.2))

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return the bounds of ``width``: from 0 to 1.8 times the largest command, so that a full reversal still
        moves the output.
        """
        return {"width": (0.0, 1.8 * largest(place, data))}

    def drive(self, effect: EffectInstance, drive: Drive) -> Drive:
        """Return *drive* with the backlash applied to the commands at the place of *effect*."""
        for name in columns_of(effect.place):
            drive = drive.with_channel(name, backlash(drive.channels[name], 0.5 * effect["width"]))
        return drive

    def curve(self, effect: EffectInstance, data: DataSummary) -> EffectCurve:
        """Return plot data: the hysteresis loop from full reverse to full ahead and back."""
        full = largest(effect.place, data)
        way = np.linspace(-full, full, 101)
        u = np.concatenate([way, way[::-1], way])
        y = backlash(u, 0.5 * effect["width"])
        unit = data.inputs[columns_of(effect.place)[0]]
        x_label, y_label = f"{effect.place} commanded [{unit}]", f"{effect.place} acting [{unit}]"
        return EffectCurve(u[101:], y[101:], x_label, y_label, "Backlash", plain=u[101:])
