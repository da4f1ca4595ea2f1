"""Shallow water along the track: resistance and added mass change with the water under the keel."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects.effect import Drive, Effect, EffectCurve, EffectInstance, Quantity
from gcs_autotune.effects.summary import DataSummary, force_scale, force_unit, top_speed
from gcs_autotune.effects.track import on_track
from gcs_autotune.models import PAYLOADS
from gcs_autotune.sname import DOFS

__all__ = ["ShallowWater"]

Array = NDArray[np.float64]

AGROUND = 0.05
"""Least water under the keel, as a fraction of that in the middle of the track. Project choice."""

STEEP = 1.0
"""Start value of the change of the water under the keel over the whole track, relative to its middle. Project choice.

The bounds are twice as large: the shallowest corner of the track is then just aground.
"""

GROWTH = 0.3
"""Start values of the growth of drag and inertia in the middle of the track. Project choice."""

SHOAL = "shoal"
"""Input that carries the growth relative to that in the middle of the track."""

HEAVIER = {dof: PAYLOADS["XYZKMN".index(DOFS[dof].force)] for dof in ("sway", "yaw")}
"""Degree of freedom -> input that multiplies its inertia."""


class ShallowWater(Effect):
    """Effect: over a plane bottom that slopes, resistance and inertia are larger where the water is shallower.

    ``zeta = T / (h - T)`` is the draught over the water under the keel (Norrbin1971). In the middle of the track it
    adds ``-drag |u| u`` in surge, and multiplies the inertia of sway and yaw by ``1 + sway`` and ``1 + yaw``. Elsewhere
    these grow with ``zeta``: as ``1 / (1 + north x + east y)``, with recorded positions from the middle. The draught
    and the depth are not identified, only the growth and the slope relative to the water under the keel.
    """

    slug = "shallow-water"
    family = "environment"
    meaning = "where the water is shallow, the craft is slower ahead, and heavier in sway and yaw"
    plain = "Shallow water slows your craft and makes it heavier to turn, but {simulation} is in deep water."
    parameters = (
        Quantity("drag", "force s^2/m^2", "drag ahead per squared speed in the middle of the track"),
        Quantity("sway", "1", "relative growth of the inertia of sway in the middle of the track"),
        Quantity("yaw", "1", "relative growth of the inertia of yaw in the middle of the track"),
        Quantity("north", "1/m", "relative growth of the water under the keel towards north"),
        Quantity("east", "1/m", "relative growth of the water under the keel towards east"),
    )
    shown_by = "residual of surge and yaw against position: the simulation is too fast on one side of the track"
    mistaken_for = ("quadratic-drag", "mass-change", "ground-effect", "steady-current")
    separated_by = (
        "the same steps ahead and the same zig-zag at two depths, one of them above ten draughts. At one depth shallow "
        "water looks like quadratic drag and a heavier craft, and is not identified"
    )
    grows_with = ("drag", "sway", "yaw")

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Return surge, sway and yaw, as far as the craft moves there, if its positions are recorded.

        A base model with Coriolis forces has none, because they follow from the inertia.
        """
        there = [dof for dof in ("surge", "sway", "yaw") if dof in data.form.dofs]
        known = {"x", "y"} <= set(data.signals) and not data.form.coriolis
        return ("+".join(there),) if known and {"surge", "yaw"} <= set(there) else ()

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return start values with the water shallower towards each of the four sides of the track."""
        sizes = {dof: GROWTH for dof in HEAVIER if dof in place.split("+")}
        drag = GROWTH * force_scale("surge", data) / top_speed("surge", data) ** 2
        slope = STEEP / _span(data)
        sides = ((slope, 0.0), (-slope, 0.0), (0.0, slope), (0.0, -slope))
        return tuple({"drag": drag, **sizes, "north": north, "east": east} for north, east in sides)

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return the bounds: everything grows, and the bottom is nowhere far above the keel."""
        steepest = 2.0 * STEEP / _span(data)
        sizes = {dof: (0.0, 10.0) for dof in HEAVIER if dof in place.split("+")}
        return {"drag": (0.0, inf), **sizes, **dict.fromkeys(("north", "east"), (-steepest, steepest))}

    def constants(self, place: str, data: DataSummary) -> Mapping[str, float]:
        """Return the middle of the recorded positions."""
        return {f"{name}_0": 0.5 * sum(data.extent[name]) for name in ("x", "y")}

    def inputs(self, effect: EffectInstance) -> tuple[str, ...]:
        """Return the names of the inputs that carry the growth of drag and of inertia."""
        return (SHOAL, *(name for dof, name in HEAVIER.items() if dof in effect.values))

    def derivatives(self, effect: EffectInstance) -> Mapping[str, float]:
        """Return the drag as a product with the input."""
        return {f"X_|u|u{SHOAL}": -effect["drag"]}

    def drive(self, effect: EffectInstance, drive: Drive) -> Drive:
        """Return *drive* with the growth at the recorded positions added as inputs."""
        drive, (x, y), _, _ = on_track(drive, ("x", "y"))
        clear = 1.0 + effect["north"] * (x - effect["x_0"]) + effect["east"] * (y - effect["y_0"])
        shoal = 1.0 / np.maximum(clear, AGROUND)
        before = drive.channels.get("payload", 1.0)
        for dof, name in HEAVIER.items():
            if dof in effect.values:
                drive = drive.with_channel(name, before * (1.0 + effect[dof] * shoal))
        return drive.with_channel(SHOAL, shoal)

    def curve(self, effect: EffectInstance, data: DataSummary) -> EffectCurve:
        """Return plot data: the growth along the steepest slope over the track."""
        half = 0.5 * _span(data)
        along = np.linspace(-half, half, 121)
        slope = float(np.hypot(effect["north"], effect["east"]))
        growth = 1.0 / np.maximum(1.0 + slope * along, AGROUND)
        label = "way down the slope from the middle [m]"
        return EffectCurve(along, growth, label, "growth over that in the middle [1]", "Shallow water")

    def unit_of(self, name: str, place: str, data: DataSummary) -> str:
        """Return the unit of the drag, or the usual one."""
        return f"{force_unit('surge', data)} s^2/m^2" if name == "drag" else super().unit_of(name, place, data)


def _span(data: DataSummary) -> float:
    """Return the larger range [m] of the recorded positions north and east, or 1."""
    return max(high - low for low, high in (data.extent["x"], data.extent["y"])) or 1.0
