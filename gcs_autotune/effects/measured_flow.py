"""Moments of a flow that was measured and is not simulated: sliding and way ahead in the yaw equation alone.

A degree of freedom that was recorded need not be simulated to be blamed. Where only yaw is, the measured ``u`` and
``v`` enter its equation as inputs; where surge and sway are simulated as well, the same derivatives belong to
:class:`.SwayYawCoupling` and :class:`.CoriolisCoupling`.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import inf
from typing import ClassVar

import numpy as np

from gcs_autotune.effects.effect import Drive, Effect, EffectInstance, Quantity
from gcs_autotune.effects.summary import DataSummary, force_scale, force_unit, top_speed
from gcs_autotune.models import SURGE_SEEN, SWAY_SEEN

__all__ = ["MunkMoment", "SpeedDamping", "SwayMoment"]

SEEN: Mapping[str, str] = {"u": SURGE_SEEN, "v": SWAY_SEEN}
"""Measured channel -> the input that stands for it."""

VARIES = 0.02
"""Least spread of a measured velocity, in shares of what it is: what hardly changes acts like a constant."""

SHARE = 0.2
"""Share of the largest moment to begin from."""


class MeasuredFlow(Effect):
    """A yaw moment per product of ``needs``, measured velocities, and of the turn rate where ``turning``."""

    family = "hydrodynamics"
    is_structural = True
    needs: ClassVar[tuple[str, ...]]
    turning: ClassVar[bool] = False

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Yaw, where nothing else of the plane is simulated and the velocities were recorded and change."""
        if "yaw" not in data.form.dofs or {"surge", "sway"} & set(data.form.dofs):
            return ()
        for name in self.needs:
            low, high = data.extent.get(name, (0.0, 0.0))
            if not high - low > VARIES * max(abs(low), abs(high)):
                return ()
        return ("yaw",)

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """A fair share of the largest moment, at the largest speeds, either way."""
        speeds = [max(map(abs, data.extent[n])) for n in self.needs]
        size = SHARE * force_scale(place, data) / float(np.prod(speeds))
        if self.turning:
            size /= top_speed(place, data)
        return tuple({q.name: sign * size} for q in self.parameters for sign in (-1.0, 1.0))

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Either sign."""
        return {q.name: (-inf, inf) for q in self.parameters}

    def inputs(self, effect: EffectInstance) -> tuple[str, ...]:
        """The measured velocities."""
        return tuple(SEEN[n] for n in self.needs)

    def drive(self, effect: EffectInstance, drive: Drive) -> Drive:
        """Add the measured velocities, between their stamps the mean of both."""
        for name in self.needs:
            if SEEN[name] in drive.channels:
                continue
            own = drive.measured[name]
            known = np.isfinite(own.values)
            drive = drive.on(np.union1d(drive.t, own.t[known]))
            middle = 0.5 * (drive.t + np.append(drive.t[1:], drive.t[-1]))
            drive = drive.with_channel(SEEN[name], np.interp(middle, own.t[known], own.values[known]))
        return drive

    def derivatives(self, effect: EffectInstance) -> Mapping[str, float]:
        """``N_sway``, ``N_surger``, ``N_surgesway``: the measured velocities as inputs."""
        name = "N_" + "".join(SEEN[n] for n in self.needs) + ("r" if self.turning else "")
        return {name: next(iter(effect.values.values()))}

    def unit_of(self, name: str, place: str, data: DataSummary) -> str:
        """Moment per product of speeds."""
        lower = "m" if len(self.needs) == 1 else "m^2"
        if self.turning:
            lower = f"({lower} rad)"
        power = len(self.needs) + self.turning
        return f"{force_unit(place, data)} s{'' if power == 1 else f'^{power}'}/{lower}"


class SwayMoment(MeasuredFlow):
    """``N_v v`` with the measured sway: a hull that slides turns (SNAME; positive ``N_v`` turns the bow with it)."""

    slug = "sway-moment"
    needs = ("v",)
    grows_with = ("N_v",)
    meaning = "sliding sideways turns the craft: its lateral resistance lies away from midships"
    plain = "Sliding sideways turns your {craft}; it does not turn {simulation}."
    parameters = (Quantity("N_v", "moment s/m", "yaw moment per sway velocity"),)
    shown_by = "yaw residual against the measured sway, longest after a turn has ended"
    mistaken_for = ("quadratic-drag", "speed-damping", "munk-moment", "actuator-lag")
    separated_by = "pull-outs: a hard turn, then the rudder amidships until it runs straight, at two speeds"


class SpeedDamping(MeasuredFlow):
    """``N_ur u r`` with the measured surge: what turns is swept along by the flow, so turning is harder with way on."""

    slug = "speed-damping"
    needs = ("u",)
    turning = True
    grows_with = ("N_ur",)
    meaning = "turning gets harder (negative) or easier with speed ahead: yaw damping grows with the flow"
    plain = "The resistance of your {craft} to turning changes with its speed; that of {simulation} does not."
    parameters = (Quantity("N_ur", "moment s^2/(m rad)", "yaw moment per surge velocity and turn rate"),)
    shown_by = "yaw residual against u times r: turns fade sooner with way on than at rest"
    mistaken_for = ("quadratic-drag", "speed-dependent-steering", "sway-moment", "munk-moment")
    separated_by = "the same turn on the spot, at half and at full speed, each speed steady before it begins"


class MunkMoment(MeasuredFlow):
    """``N_uv u v`` with the measured velocities: a hull at an angle to its way turns further (Munk; Fossen2011)."""

    slug = "munk-moment"
    form_of = ("sway-moment",)
    needs = ("u", "v")
    grows_with = ("N_uv",)
    meaning = "at an angle to its way the craft turns further by itself, the more the faster"
    plain = "Moving at an angle to its bow turns your {craft} further; it does not turn {simulation}."
    parameters = (Quantity("N_uv", "moment s^2/m^2", "yaw moment per surge and sway velocity"),)
    shown_by = "yaw residual against u times v"
    mistaken_for = ("sway-moment", "speed-damping", "coriolis-coupling")
    separated_by = "pull-outs at two speeds: a moment of sway alone does not care for the speed ahead"
