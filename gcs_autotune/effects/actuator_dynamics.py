"""Dynamic actuator effects: delay, lag, rate limit, and a gain that drifts."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gcs_autotune.effects.actuator import Gradual, SharedActuatorEffect, horizon, largest, last_stamp, redrawn
from gcs_autotune.effects.effect import INPUT, Array, Drive, EffectCurve, EffectInstance, Quantity, columns_of
from gcs_autotune.effects.kernels import fading, following, limited
from gcs_autotune.effects.summary import DataSummary

__all__ = ["ActuatorLag", "GainDrift", "InputDelay", "RateLimit"]


LATEST = 1.0
"""Minimum upper bound of the delay [s], for a craft of any speed. Project choice.

Delays of the radio, the autopilot and a GPS do not depend on the craft's time constant.
"""


class InputDelay(SharedActuatorEffect):
    """Effect: each command acts after ``delay``. Until then the first command acts.

    The result is exact for held commands.
    """

    slug = "input-delay"
    is_structural = True
    meaning = "commands act later than they are sent, because of the radio, autopilot loops or the motor controller"
    plain = "Your craft responds late to {command}, but {simulation} responds at once."
    parameters = (Quantity("delay", "s", "time from command to action"),)
    grows_with = ("delay",)
    shown_by = "residual right after each change of command: the motion begins late, then keeps up"
    mistaken_for = (
        "actuator-lag",
        "measurement-delay",
        "time-offset",
        "rate-limit",
        "backlash",
    )
    separated_by = (
        "full steps from rest, with ten or more samples per time constant. With a delay the craft stays still, then "
        "starts abruptly. With a lag it starts at once but gradually. Step the inputs one at a time to exclude a "
        "clock offset"
    )

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return start values of ``delay``, from one sample to the craft's time constant."""
        return tuple({"delay": float(d)} for d in np.geomspace(*horizon(data), 5))

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return the bounds of ``delay``: from 0 to twice the craft's time constant.

        A dozen samples or :data:`LATEST` are used instead, at most a quarter of the run, if this is longer.
        """
        floor = min(max(12.0 * data.interval, LATEST), 0.25 * data.duration)
        return {"delay": (0.0, max(2.0 * horizon(data)[1], floor))}

    def drive(self, effect: EffectInstance, drive: Drive) -> Drive:
        """Return *drive* with the changes of the channel delayed. A single channel keeps no other stamps."""

        def later(u: Array) -> tuple[Array, Array]:
            changes = np.r_[True, np.diff(u) != 0.0]
            t = drive.t[changes] + effect["delay"]
            t[0] = drive.t[0]
            return t, u[changes]

        return redrawn(drive, effect.place, later)

    def curve(self, effect: EffectInstance, data: DataSummary) -> EffectCurve:
        """Return plot data: a step of the command and the delayed output."""
        t = np.linspace(-0.5, 2.5, 601) * max(effect["delay"], data.interval)
        acting, commanded = (t >= effect["delay"]).astype(float), (t >= 0.0).astype(float)
        return EffectCurve(
            t, acting, "time [s]", f"{effect.place}, as a fraction of the step [1]", "Input delay", plain=commanded
        )


class RateLimit(Gradual):
    """Effect: the actuator follows the command at no more than ``rate``. It starts at the first command."""

    slug = "rate-limit"
    meaning = (
        "the actuator follows its command at a limited rate, as with a slow servo or a ramp in the motor controller"
    )
    plain = "On your craft {command} changes at a limited rate, but in {simulation} it jumps."
    parameters = (Quantity("rate", f"{INPUT}/s", "largest rate of change of the actuator"),)
    shown_by = "residual after each change of command: the larger the change, the longer the residual lasts"
    mistaken_for = ("actuator-lag", "input-delay", "saturation", "backlash")
    separated_by = (
        "steps of a quarter of full command, and full reversals. A rate limit delays large steps much more than "
        "small ones. A lag or a delay affects all sizes equally"
    )

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return start values of ``rate``, at which full command is reached within 0.6 samples to twice the craft's
        time constant.
        """
        shortest, longest = horizon(data)
        full = largest(place, data)
        return tuple({"rate": float(full / s)} for s in np.geomspace(0.6 * shortest, 2.0 * longest, 5))

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return the bounds of ``rate``.

        At the bounds, full command is reached within a fiftieth of a sample and within ten times the craft's time
        constant.
        """
        shortest, longest = horizon(data)
        full = largest(place, data)
        return {"rate": (0.1 * full / longest, 50.0 * full / shortest)}

    def drive(self, effect: EffectInstance, drive: Drive) -> Drive:
        """Return *drive* with the rate limit applied to the commands at the place of *effect*."""
        return redrawn(drive, effect.place, lambda u: limited(drive.t, u, effect["rate"], self.resolution(effect, u)))

    def curve(self, effect: EffectInstance, data: DataSummary) -> EffectCurve:
        """Return plot data: a step from zero to full command and the limited output."""
        full = largest(effect.place, data)
        t = np.linspace(-0.5, 2.0, 501) * full / effect["rate"]
        commanded = np.where(t >= 0.0, full, 0.0)
        acting = np.clip(effect["rate"] * t, 0.0, full)
        return EffectCurve(
            t,
            acting,
            "time [s]",
            f"{effect.place} [{data.inputs[columns_of(effect.place)[0]]}]",
            "Rate limit",
            plain=commanded,
        )


INSTANT = 1e-6
"""Time constant [s] below which a lag is ignored. Project choice."""


class ActuatorLag(Gradual):
    """Effect: the output follows the command as a first-order lag with ``time_constant``.

    It starts at the first command.
    """

    slug = "actuator-lag"
    meaning = "thrust or rudder follows the command gradually, since propeller and water take time to speed up"
    plain = "On your craft {command} builds up gradually, but in {simulation} it acts at once."
    parameters = (Quantity("time_constant", "s", "time to reach 63 % of a step in command"),)
    grows_with = ("time_constant",)
    shown_by = "residual after each change of command: the motion starts gradually instead of abruptly"
    mistaken_for = (
        "input-delay",
        "rate-limit",
        "measurement-delay",
        "time-offset",
        "mass-change",
    )
    separated_by = (
        "full steps from rest, with ten or more samples per time constant, and the same at half command. A lag makes "
        "both sizes start at once but gradually. A delay holds the craft still at first. A rate limit delays the "
        "larger step more"
    )

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return start values of ``time_constant``, from one sample to the craft's own time constant."""
        return tuple({"time_constant": float(T)} for T in np.geomspace(*horizon(data), 4))

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return the bounds of ``time_constant``: from 0 to five times the craft's time constant."""
        return {"time_constant": (0.0, 5.0 * horizon(data)[1])}

    def drive(self, effect: EffectInstance, drive: Drive) -> Drive:
        """Return *drive* with the lag applied to the commands at the place of *effect*."""
        T = effect["time_constant"]
        if T < INSTANT:
            return drive
        return redrawn(drive, effect.place, lambda u: following(drive.t, u, T, self.resolution(effect, u)))

    def curve(self, effect: EffectInstance, data: DataSummary) -> EffectCurve:
        """Return plot data: a step of the command and the lagged output."""
        T = max(effect["time_constant"], INSTANT)
        t = np.linspace(-1.0, 5.0, 601) * T
        commanded = (t >= 0.0).astype(float)
        acting = -np.expm1(-np.maximum(t, 0.0) / T)
        return EffectCurve(
            t, acting, "time [s]", f"{effect.place}, as a fraction of the step [1]", "Actuator lag", plain=commanded
        )


LEAST_GAIN = 0.05
"""Lower limit of the drifting gain, relative to the gain at the start. Project choice."""


class GainDrift(Gradual):
    """Effect: commands are multiplied by ``1 - rate (t - t_0)``, but at least by a twentieth.

    ``t_0`` is the run's first stamp.
    """

    slug = "gain-drift"
    meaning = "thrust weakens or grows during a run, because the battery sags or a motor heats up"
    plain = "On your craft {command} gets weaker or stronger during a run, but not in {simulation}."
    parameters = (Quantity("rate", "1/s", "fraction of the initial gain lost per second"),)
    grows_with = ("rate",)
    shown_by = "residual against time: it follows the command at the beginning and opposes it at the end"
    mistaken_for = (
        "mass-change",
        "time-scale",
        "quadratic-drag",
        "speed-dependent-steering",
    )
    separated_by = (
        "the same full steps at the beginning and end of one long run, and again with a fresh battery. A weaker gain "
        "makes the steps start and end slower. A larger mass makes them start slower but reach the same speed"
    )

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return start values of ``rate``, for losses of 30 % and 80 % and an increase of 30 % within the longest
        run.
        """
        return tuple({"rate": share / data.duration} for share in (0.3, 0.8, -0.3))

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return the bounds of ``rate``.

        They range from a doubled gain at the end of the longest run to a zero gain after a third of it.
        """
        return {"rate": (-1.0 / data.duration, 3.0 / data.duration)}

    def drive(self, effect: EffectInstance, drive: Drive) -> Drive:
        """Return *drive* with the drifting gain applied to the commands at the place of *effect*."""
        end = last_stamp(drive)

        def faded(u: Array) -> tuple[Array, Array]:
            return fading(drive.t, u, drive.start, end, effect["rate"], LEAST_GAIN, self.resolution(effect, u))

        return redrawn(drive, effect.place, faded)

    def curve(self, effect: EffectInstance, data: DataSummary) -> EffectCurve:
        """Return plot data: gain over time."""
        t = np.linspace(0.0, data.duration, 201)
        gain = np.maximum(1.0 - effect["rate"] * t, LEAST_GAIN)
        return EffectCurve(
            t,
            gain,
            "time since the start of the run [s]",
            f"gain of {effect.place} [1]",
            "Gain drift",
            plain=np.ones_like(t),
        )
