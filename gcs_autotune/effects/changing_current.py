"""A current that changes with time and depth: tide, gyre, shear."""

from __future__ import annotations

from collections.abc import Mapping
from math import pi

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects.effect import Effect, EffectCurve, EffectInstance, Observed, Quantity
from gcs_autotune.effects.environment import OVER_GROUND, SteadyCurrent
from gcs_autotune.effects.summary import DataSummary

__all__ = ["ChangingCurrent"]

Array = NDArray[np.float64]

MOST_TURN = 2.0 * pi
"""Largest rotation of a current in one run [rad]. Project choice."""

MOST_GROWTH = 4.0
"""Largest growth of a current in one run, as a fraction of its first speed. Project choice."""

DEEP = 0.1
"""Least range of the depth [m] that can show a shear. Project choice."""


class ChangingCurrent(SteadyCurrent):
    """Effect: an irrotational current whose speed and direction change in a run, with shear over depth.

    It is ``(1 + growth t) (1 - shear z)`` times ``V_x``, ``V_y``, turned by ``turn t``; *t* is the time since the start
    of the run. The equations of motion hold for the velocity through the water (Fossen2011, 8.3), so the current only
    changes the speeds over ground and the positions. The momentum that a craft of no added mass would keep in a dive
    through shear is omitted.
    """

    slug = "changing-current"
    meaning = "the water moves over the ground, and its speed or direction changes with time or depth"
    plain = "A current that changes carries your craft, but {simulation} moves in still water."
    parameters = (
        Quantity("V_x", "m/s", "current towards north, at the surface and the start"),
        Quantity("V_y", "m/s", "current towards east, at the surface and the start"),
        Quantity("growth", "1/s", "growth of the speed, as a fraction of the first speed (tide)"),
        Quantity("turn", "rad/s", "rotation of the direction, clockwise positive (gyre)"),
        Quantity("shear", "1/m", "decrease of the speed with depth, as a fraction of the surface's"),
    )
    shown_by = "residual of position grows along a curve, or differently at each depth, whatever the heading"
    mistaken_for = ("steady-current", "compass-deviation", "time-scale", "tether-pull")
    separated_by = (
        "drift without command for a tenth of the tide's period (a gyre: for a quarter of a turn). For a shear, drift "
        "at three depths. Over a few minutes a tide looks like a steady current"
    )
    form_of = ("steady-current",)
    derivatives = Effect.derivatives  # only speeds over ground and positions change

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return start values of the current: without change as for a steady one, then reversing halfway.

        A current that reverses has a mean near zero, and then no start without change leads to it.
        """
        low, high = data.extent.get("z", (0.0, 0.0))
        shear = {"shear": 0.0} if "heave" in data.form.dofs and high - low > DEEP else {}
        steady = super().starts(place, data)
        changes = ({"growth": growth, "turn": 0.0, **shear} for growth in (0.0, -2.0 / data.duration))
        return tuple({**start, **change} for change in changes for start in steady)

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return the bounds of the current and of its changes in the longest run."""
        growth, turn = MOST_GROWTH / data.duration, MOST_TURN / data.duration
        deepest = max(data.extent.get("z", (0.0, 1.0))[1], DEEP)
        changes = {"growth": (-growth, growth), "turn": (-turn, turn), "shear": (-1.0 / deepest, 1.0 / deepest)}
        return {**super().bounds(place, data), **changes}

    def _velocity(self, effect: EffectInstance, since: Array, depth: Array | float) -> tuple[Array, Array]:
        share = (1.0 + effect["growth"] * since) * np.maximum(1.0 - effect.values.get("shear", 0.0) * depth, 0.0)
        V_x, V_y = effect.values.get("V_x", 0.0), effect.values.get("V_y", 0.0)
        c, s = np.cos(effect["turn"] * since), np.sin(effect["turn"] * since)
        return share * (c * V_x - s * V_y), share * (s * V_x + c * V_y)

    def observe(self, effect: EffectInstance, seen: Observed) -> Observed:
        """Return *seen* with the drift added to positions, and the current to speeds over ground."""
        had = seen.signals
        north, east = self._velocity(effect, seen.t - seen.start, had.get("z", 0.0))
        c, s = np.cos(had.get("psi", np.zeros(1))), np.sin(had.get("psi", np.zeros(1)))
        flow = {"u": c * north + s * east, "v": c * east - s * north} if effect.place == OVER_GROUND else {}
        flow |= {"x": _integral(seen.t, north), "y": _integral(seen.t, east)}
        for name, more in flow.items():
            if name in had:
                seen = seen.with_signal(name, had[name] + more)
        return seen

    def curve(self, effect: EffectInstance, data: DataSummary) -> EffectCurve:
        """Return plot data: the speed of the current at the surface over the longest run."""
        t = np.linspace(0.0, data.duration, 181)
        speed = np.hypot(*self._velocity(effect, t, 0.0))
        first = np.full_like(t, speed[0])
        return EffectCurve(t, speed, "time [s]", "current [m/s]", "Current over time", plain=first)


def _integral(t: Array, rate: Array) -> Array:
    """Return the integral (s,) of *rate* (s,) from the first of the stamps *t* (s,), by the trapezoidal rule."""
    return np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(t))])
