"""Backlash: play between what moves and what is moved."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from numba import njit

from gcs_autotune.effects.actuator import Actuator, Array
from gcs_autotune.effects.effect import INPUT, Applied, Curve, Drive, Quantity, Scene

__all__ = ["Backlash"]


@njit(cache=True)
def _play(u: Array, half: float) -> Array:
    """Return what acts (n,) behind a play of *half* either way, starting at the first command."""
    acting = np.empty(len(u))
    y = u[0]
    for i in range(len(u)):
        y = min(max(y, u[i] - half), u[i] + half)
        acting[i] = y
    return acting


class Backlash(Actuator):
    """Play: what acts stays where it is until the command has gone ``width / 2`` past it, then is dragged along.

    It starts at the first command. Exact for held commands.
    """

    slug: ClassVar[str] = "backlash"
    meaning: ClassVar[str] = (
        "play in the linkage: after every reversal the command moves a while before anything follows"
    )
    parameters: ClassVar[tuple[Quantity, ...]] = (Quantity("width", INPUT, "play from one flank to the other"),)
    grows_with: ClassVar[tuple[str, ...]] = ("width",)
    shown_by: ClassVar[str] = (
        "residual against command makes a loop: above the line while the command falls, below it while it rises"
    )
    mistaken_for: ClassVar[tuple[str, ...]] = ("dead-zone", "input-delay", "actuator-lag", "rate-limit", "input-bias")
    separated_by: ClassVar[str] = (
        "a staircase up to full command, down to full reverse and up again, five steps each way, each held until the "
        "speed is steady: with play the same command gives another speed on the way down than on the way up; with a "
        "dead zone or a lag it does not"
    )

    def starts(self, place: str, scene: Scene) -> tuple[Mapping[str, float], ...]:
        """Shares of the largest command; twice that is the whole way."""
        return tuple({"width": share * scene.swing[place]} for share in (0.1, 0.3, 0.7, 1.2))

    def bounds(self, place: str, scene: Scene) -> Mapping[str, tuple[float, float]]:
        """Something must still come through when the command goes from end to end."""
        return {"width": (0.0, 1.8 * scene.swing[place])}

    def drive(self, own: Applied, drive: Drive) -> Drive:
        """Drag what acts along."""
        return drive.with_channel(own.place, _play(drive.channels[own.place], 0.5 * own["width"]))

    def curve(self, own: Applied, scene: Scene) -> Curve:
        """The loop: from full reverse to full ahead and back."""
        way = np.linspace(-scene.swing[own.place], scene.swing[own.place], 101)
        u = np.concatenate([way, way[::-1], way])
        y = _play(u, 0.5 * own["width"])
        unit = scene.inputs[own.place]
        x_label, y_label = f"{own.place} commanded [{unit}]", f"{own.place} acting [{unit}]"
        return Curve(u[101:], y[101:], x_label, y_label, "Backlash", plain=u[101:])
