"""A command that also acts on another axis: thrust ahead that turns the craft, or pushes it down."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf

import numpy as np

from gcs_autotune.effects.actuator import ActuatorEffect, redrawn, with_other
from gcs_autotune.effects.effect import INPUT, Drive, EffectCurve, EffectInstance, Quantity, columns_of
from gcs_autotune.effects.summary import DataSummary
from gcs_autotune.models import FORCES

__all__ = ["CommandCoupling"]

VARIES = 0.2
"""Least range of the other command during 80 % of the time, relative to its largest value. Project choice.

A command that is nearly constant acts like a constant force. On a boat whose throttle was applied once (range 0.03), a
bias was reported as a coupling.
"""


NONE = 1e-6
"""Size of a command, relative to the largest command, below which it counts as zero. Project choice.

Rounding in a mixer leaves such values instead of zero.
"""


class CommandCoupling(ActuatorEffect):
    """Effect: a command also acts on another axis. At ``"N+X"`` the command ``N`` acts as ``N + gain X``.

    The cause is off-centre thrust, or unequal thrusters. ``X`` is the recorded command, held until the next stamp,
    whether or not it drives a simulated degree of freedom. In newtons and newton metres, ``gain`` is the lever arm of
    the thrust, positive to port of the centre (Fossen2011, 12.3).
    """

    slug = "command-coupling"
    meaning = "the command of another axis acts on this one: thrust off the centre line, or unequal thrusters"
    plain = "On your craft another command also acts on {motion}, but not in {simulation}."
    parameters = (Quantity("gain", f"{INPUT} per unit of the other", "contribution of the other command to this one"),)
    grows_with = ("gain",)
    shown_by = "residual against the other axis' command: proportional to it and immediate"
    mistaken_for = ("input-bias", "tether-pull", "gain-drift", "channel-swap")
    yields_to = ("input-bias", "net-buoyancy")  # a command that hardly changes acts like a constant
    separated_by = (
        "steps from rest on the other axis alone, ahead and astern, at two sizes. Leave this axis at zero command"
    )

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Return the places ``input+other``: every input of one degree of freedom, with every other commanded force
        that changes.
        """
        own = [n for n in super().places(data) if n in (*FORCES, "delta")]
        others = [n for n in FORCES if n in data.channels and _varies(n, data)]
        return tuple(f"{n}+{other}" for n in own for other in others if other != n)

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return start values of ``gain``, of both signs, that produce a fifth of the largest command."""
        name, other = columns_of(place)
        size = 0.2 * data.amplitude[name] / max(map(abs, data.extent[other]))
        return ({"gain": size}, {"gain": -size})

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return infinite bounds of ``gain``, which may have either sign."""
        return {"gain": (-inf, inf)}

    def drive(self, effect: EffectInstance, drive: Drive) -> Drive:
        """Return *drive* with the other command, times ``gain``, added to the command.

        If the other command drives the craft, it includes the effects applied before.
        """
        name, other = columns_of(effect.place)
        both = with_other(drive, name, other)
        if both is None:
            return drive
        return redrawn(drive, name, lambda _: (both[0], both[1] + effect["gain"] * both[2]))

    def curve(self, effect: EffectInstance, data: DataSummary) -> EffectCurve:
        """Return plot data: the command added on this axis over the other command."""
        name, other = columns_of(effect.place)
        low, high = data.extent[other]
        command = np.linspace(min(low, 0.0), max(high, 0.0), 101)
        x_label, y_label = f"{other} commanded [{data.command_unit(other)}]", f"{name} acting [{data.inputs[name]}]"
        return EffectCurve(command, effect["gain"] * command, x_label, y_label, "Effect of another axis' command")


def _varies(name: str, data: DataSummary) -> bool:
    extent = data.extent.get(name, (0.0, 0.0))
    if max(map(abs, extent)) < NONE * max(data.amplitude.values(), default=0.0):
        return False
    low, high = data.usual.get(name, extent)
    return high - low > VARIES * max(map(abs, extent))
