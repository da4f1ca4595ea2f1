"""Speed-dependent steering: a rudder needs water flowing past it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from gcs_autotune.effects.actuator import Actuator, Array, steers
from gcs_autotune.effects.effect import Applied, Curve, Drive, Quantity, Scene
from gcs_autotune.effects.held import redrawn
from gcs_autotune.trial import Channel

__all__ = ["SpeedDependentSteering"]

VARIES = 0.1
"""Speeds must range over this share of their root mean square for their effect to be seen."""

_SMOOTHER = np.array([-2.0, 3.0, 6.0, 7.0, 6.0, 3.0, -2.0]) / 21.0
"""Centre of the parabola through seven samples (Savitzky and Golay 1964): keeps a third of the noise's variance."""


class SpeedDependentSteering(Actuator):
    """Commands act times ``(1 - share) + share (U/U_ref)^2``: rudder force goes with the square of the flow.

    ``U`` is the measured surge speed ``u`` (the speed over ground where that is all there is), lightly smoothed;
    ``U_ref`` its root mean square over the runs. The thesis (Miskovic 2010), (2.37): ``k_r1 U^2 delta`` from the boat's
    way, and a rest, from the propeller's race, that does not depend on it.
    """

    slug: ClassVar[str] = "speed-dependent-steering"
    meaning: ClassVar[str] = "the rudder turns the craft the harder, the faster water flows past it"
    parameters: ClassVar[tuple[Quantity, ...]] = (
        Quantity("share", "1", "share of the steering that goes with the speed squared; the rest is always there"),
    )
    grows_with: ClassVar[tuple[str, ...]] = ("share",)
    shown_by: ClassVar[str] = (
        "yaw residual over command, against speed: too weak a turn when slow, too strong when fast"
    )
    mistaken_for: ClassVar[tuple[str, ...]] = ("gain-drift", "quadratic-actuator", "coriolis-coupling", "linear-drag")
    separated_by: ClassVar[str] = (
        "the same zig-zag at slow, half and full speed, each speed steady before it begins, in mixed order so that a "
        "weakening battery cannot pass for speed"
    )

    def places(self, scene: Scene) -> tuple[str, ...]:
        """Every input that turns the craft, when a speed is recorded and varies."""
        name = _speed(scene.channels)
        if name is None or scene.rms.get(name, 0.0) <= 0.0:
            return ()
        low, high = scene.extent.get(name, (0.0, 0.0))
        if high - low < VARIES * scene.rms[name]:
            return ()
        return tuple(n for n in super().places(scene) if steers(n, scene))

    def starts(self, place: str, scene: Scene) -> tuple[Mapping[str, float], ...]:
        """Partly, and wholly."""
        return ({"share": 0.4}, {"share": 0.9})

    def bounds(self, place: str, scene: Scene) -> Mapping[str, tuple[float, float]]:
        """A little beyond the physical 0 to 1, so that a fit can end at either."""
        return {"share": (-0.2, 1.2)}

    def constants(self, place: str, scene: Scene) -> Mapping[str, float]:
        """The root mean square of the speed."""
        name = _speed(scene.channels)
        return {} if name is None else {"U_ref": scene.rms[name]}

    def drive(self, own: Applied, drive: Drive) -> Drive:
        """Scale the commands with the flow, held at its mean between stamps; without a speed recorded as they are."""
        name = _speed(drive.measured)
        if name is None:
            return drive
        stamps, flow = _flow(drive.measured[name], own["U_ref"])
        if not len(stamps):
            return drive
        t = np.union1d(drive.t, stamps[stamps > drive.t[0]])
        at = np.interp(t, stamps, flow)
        ahead = np.r_[at[1:], at[-1]]
        mean = (at * at + at * ahead + ahead * ahead) / 3.0
        u = drive.channels[own.place][np.searchsorted(drive.t, t, side="right") - 1]
        return redrawn(drive, own.place, t, u * ((1.0 - own["share"]) + own["share"] * mean))

    def curve(self, own: Applied, scene: Scene) -> Curve:
        """Gain over speed."""
        name = _speed(scene.channels) or "u"
        low, high = scene.extent.get(name, (0.0, 2.0 * own["U_ref"]))
        speed = np.linspace(min(low, 0.0), high, 201)
        gain = (1.0 - own["share"]) + own["share"] * (speed / own["U_ref"]) ** 2
        return Curve(
            speed, gain, f"{name} [m/s]", f"gain of {own.place} [1]", "Steering over speed", plain=np.ones_like(speed)
        )


def _speed(channels: Mapping[str, object] | frozenset[str]) -> str | None:
    """Return the channel that tells the speed through the water best."""
    return next((n for n in ("u", "U") if n in channels), None)


def _flow(speed: Channel, reference: float) -> tuple[Array, Array]:
    """Return stamps and smoothed speeds in shares of the reference (n,), without missing samples."""
    good = np.isfinite(speed.values)
    t, values = speed.t[good], speed.values[good] / reference
    half = len(_SMOOTHER) // 2
    if len(values) > 2 * len(_SMOOTHER):
        values = values.copy()
        values[half:-half] = np.convolve(values, _SMOOTHER, mode="valid")
    return t, values
