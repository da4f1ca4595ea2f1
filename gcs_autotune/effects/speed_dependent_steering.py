"""Speed-dependent steering: a rudder needs water flowing past it."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import ClassVar

import numpy as np

from gcs_autotune.effects.actuator import Actuator, Array, steers
from gcs_autotune.effects.effect import Applied, Curve, Drive, Quantity, Scene
from gcs_autotune.effects.held import redrawn
from gcs_autotune.slow_imports import scipy_signal
from gcs_autotune.sname import DOFS
from gcs_autotune.trial import Channel

__all__ = ["SpeedDependentSteering"]

VARIES = 0.1
"""Speeds must range over this share of their root mean square for their effect to be seen."""

GAIN = "gain_"
"""Constants ``gain_N`` and so on: what a simulated flow multiplies, the base model's forces per input."""

WINDOWS = (5, 9, 15, 25, 41, 67, 111)
"""Samples a parabola may be laid through to smooth the speed; which, every run says itself."""


class SpeedDependentSteering(Actuator):
    """Commands act times ``(1 - share) + share (U/U_ref)^2``: rudder force goes with the square of the flow.

    ``U`` is the surge speed through the water: the simulated one where surge is simulated, as noise in a measured one
    would come out as a weaker effect; else the measured ``u`` (or speed over ground), smoothed as its noise asks.
    ``U_ref`` is the root mean square of the recorded one over the runs. Miskovic2010, (2.37):
    ``k_r1 U^2 delta`` from the boat's way, and a rest, from the propeller's race, that does not depend on it. Where the
    input's gain is fitted and surge simulated, ``share`` is one of the base model's gain.
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
        """The root mean square of the recorded speed, and where surge is simulated what it multiplies."""
        name = _speed(scene.channels)
        if name is None:
            return {}
        return {"U_ref": scene.rms[name], **_gains(place, scene)}

    def derivatives(self, own: Applied) -> Mapping[str, float]:
        """``N_N`` and ``N_|u||u|N`` and so on, where surge is simulated."""
        found = {}
        for key, gain in own.constants.items():
            if key.startswith(GAIN):
                force = key.removeprefix(GAIN)
                found[f"{force}_{own.place}"] = -own["share"] * gain
                found[f"{force}_|u||u|{own.place}"] = own["share"] * gain / own["U_ref"] ** 2
        return found

    def drive(self, own: Applied, drive: Drive) -> Drive:
        """Scale the commands with the measured flow, held at its mean between stamps, where surge is not simulated."""
        name = _speed(drive.measured)
        if name is None or any(key.startswith(GAIN) for key in own.constants):
            return drive
        stamps, flow = _smooth(drive.measured[name])
        if not len(stamps):
            return drive
        t = np.union1d(drive.t, stamps[stamps > drive.t[0]])
        at = np.interp(t, stamps, flow) / own["U_ref"]
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


def _gains(place: str, scene: Scene) -> dict[str, float]:
    """Return the gain of every force the input drives, none when surge is not simulated or a gain is not known."""
    if "surge" not in scene.form.dofs:
        return {}
    driven = {DOFS[d].force for d in scene.form.dofs}
    found = {}
    for force, gain in scene.form.inputs[place]:
        if force not in driven:
            continue
        if isinstance(gain, str):
            name = gain.removeprefix("-")
            if name not in scene.base or gain == f"-{force}_{place}":
                return {}
            found[GAIN + force] = -scene.base[name] if gain.startswith("-") else scene.base[name]
        else:
            found[GAIN + force] = gain
    return found


@lru_cache(maxsize=64)
def _smooth(speed: Channel) -> tuple[Array, Array]:
    """Return stamps and smoothed speeds (n,) of the samples there are, by moving parabolas (Savitzky1964).

    The window is that which foretells samples left out of it best: the noise would come out as speed that varies.
    """
    good = np.isfinite(speed.values)
    t, values = speed.t[good], speed.values[good]
    best, least = values, np.inf
    for window in WINDOWS:
        if 3 * window > len(values):
            break
        smooth: Array = scipy_signal().savgol_filter(values, window, 2)
        own = float(scipy_signal().savgol_coeffs(window, 2)[window // 2])
        half = window // 2
        left_out = (values - smooth)[half : len(values) - half] / (1.0 - own)
        error = float(np.mean(left_out**2))
        if error < least:
            best, least = smooth, error
    return t, best
