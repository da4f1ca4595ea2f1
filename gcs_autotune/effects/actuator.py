"""What the effects of actuators share: where they sit, how fine they must be drawn, and static characteristics."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects.effect import Applied, Curve, Drive, Effect, Family, Scene
from gcs_autotune.models.coupled import CoupledModel
from gcs_autotune.sname import DOFS

__all__ = ["RESOLUTION", "Actuator", "Characteristic", "Gradual", "horizon", "last_stamp", "quickest", "steers"]

Array = NDArray[np.float64]

FAINT = 1e-3
"""What a craft may notice of held values standing for a continuous motion, in shares of the largest command."""

QUICK, SLOW = 0.1, 5.0
"""Craft that respond faster or more slowly than this [s] are drawn for as if they did so."""

CAUTION = 3.0
"""A plain model fitted past a slow actuator takes the craft for slower than it is, by so much at most."""

RESOLUTION = "resolution"
"""Constant [input unit s] of effects that move between stamps: slope times squared length of a piece held."""


class Actuator(Effect):
    """An effect on one input: its place is the input's channel, wherever something was commanded."""

    family: ClassVar[Family] = "actuator"

    def places(self, scene: Scene) -> tuple[str, ...]:
        """Every input that was used."""
        return tuple(n for n in scene.inputs if scene.swing[n] > 0.0)


class Characteristic(Actuator):
    """An actuator whose output is a function of the present command: a static curve."""

    title: ClassVar[str]

    def acting(self, own: Applied, u: Array) -> Array:
        """Return what acts (n,) at the commands *u* (n,), both in the input's unit."""
        raise NotImplementedError

    def drive(self, own: Applied, drive: Drive) -> Drive:
        """Pass every command through the curve."""
        return drive.with_channel(own.place, self.acting(own, drive.channels[own.place]))

    def curve(self, own: Applied, scene: Scene) -> Curve:
        """Acting over commanded."""
        u = np.linspace(-scene.swing[own.place], scene.swing[own.place], 201)
        unit = scene.inputs[own.place]
        x_label, y_label = f"{own.place} commanded [{unit}]", f"{own.place} acting [{unit}]"
        return Curve(u, self.acting(own, u), x_label, y_label, self.title, plain=u)


class Gradual(Actuator):
    """An actuator that moves between the stamps of its commands."""

    def constants(self, place: str, scene: Scene) -> Mapping[str, float]:
        """How finely the motion between stamps must be held so that this craft hardly notices."""
        return {RESOLUTION: 4.0 * FAINT * quickest(scene) * scene.swing[place]}

    def resolution(self, own: Applied, u: Array) -> float:
        """Return the constant, or one for the quickest craft when *own* was made without."""
        return own.constants.get(RESOLUTION, 4.0 * FAINT * QUICK * max(float(np.abs(u).max(initial=0.0)), 1e-12))


def quickest(scene: Scene) -> float:
    """Return the shortest time constant [s] the craft may have, going by the base model (its slowest if no values)."""
    found = scene.pace
    model = CoupledModel(scene.form, scene.base)
    if scene.base and np.linalg.matrix_rank(model.inertia) == len(scene.form.dofs):
        rates = np.abs(np.linalg.eigvals(np.linalg.solve(model.inertia, model.linear_damping)))
        found = 1.0 / max(float(rates.max(initial=0.0)), 1e-9)
    return float(np.clip(found / CAUTION, QUICK, SLOW))


def horizon(scene: Scene) -> tuple[float, float]:
    """Return shortest and longest time [s] worth looking for: a sample, and the craft's own pace within the run."""
    longest = min(scene.pace, 0.25 * scene.duration)
    return scene.interval, max(longest, 4.0 * scene.interval)


def last_stamp(drive: Drive) -> float:
    """Return the end of a run [s]: the last stamp of its commands or of anything measured."""
    ends = [float(c.t[-1]) for c in drive.measured.values() if len(c)]
    return max([float(drive.t[-1]), *ends])


def steers(place: str, scene: Scene) -> bool:
    """Whether an input turns the craft: it drives roll, pitch or yaw."""
    turning = {d.force for d in DOFS.values() if d.angular}
    return any(force in turning for force, _ in scene.form.inputs.get(place, ()))
