"""A tether that is slack up to its length and taut beyond it, with the drag of the line."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from math import inf

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects.effect import Drive, Effect, EffectCurve, EffectInstance, Quantity
from gcs_autotune.effects.environment import AWAY, STRENGTH
from gcs_autotune.effects.summary import DataSummary, force_scale, stiffness_unit, top_speed
from gcs_autotune.effects.track import on_track
from gcs_autotune.sname import DOFS

__all__ = ["TetherLine"]

Array = NDArray[np.float64]


DRAG = 0.1
"""Start value of the drag of the line at the highest speed, relative to the largest force. Project choice."""

_POSITIONS = {"surge": "x", "sway": "y", "heave": "z"}
_INPUTS = {"surge": "lineX", "sway": "lineY", "heave": "lineZ"}
"""Degree of freedom -> its position, and the name of the input that carries the line's force."""


class TetherLine(Effect):
    """Effect: a line to a fixed point pulls with ``stiffness`` per metre beyond its ``length``, and has drag.

    The line is one element of a lumped-mass line (Hall2015). The water resists its motion across itself with ``drag |U|
    U``. Its force is calculated from the recorded positions and enters the equations of motion as an input. At the
    place ``heave`` the line is vertical, so it has no drag. The water is assumed to be at rest.
    """

    slug = "tether-line"
    family = "environment"
    meaning = "a line is slack up to its length, pulls beyond it, and is dragged through the water"
    plain = "A tether holds your craft once it is taut, but {simulation} moves freely."
    parameters = (
        Quantity("stiffness", "N/m", "pull per metre beyond the length"),
        Quantity("length", "m", "length of the slack line"),
        Quantity("drag", "N s^2/m^2", "drag on the craft per squared speed across the line"),
        Quantity("x", "m", "other end of the line, north"),
        Quantity("y", "m", "other end of the line, east"),
        Quantity("z", "m", "other end of the line, depth"),
    )
    shown_by = "residual against distance from one point: none up to a distance, then a pull back that grows"
    mistaken_for = ("tether-pull", "quadratic-drag", "steady-current", "input-bias")
    separated_by = (
        "away from the tether's end with full command until the craft stops, then no command until it rests. Do so in "
        "two directions (or depths). A line pulls only beyond its length, a spring everywhere"
    )
    grows_with = ("stiffness", "drag")
    form_of = ("tether-pull",)

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Return the axes of surge, sway and heave in which the craft moves, if their positions are measured.

        Without sway, a craft that turns has no place.
        """
        form, seen = data.form, set(data.signals)
        axes = [dof for dof in _POSITIONS if dof in form.dofs]
        heading = "heave" in axes or "psi" in seen or "yaw" not in form.dofs
        if axes not in (["surge", "sway", "heave"], ["surge", "sway"], ["heave"]) or not heading:
            return ()
        return ("+".join(axes),) if {_POSITIONS[dof] for dof in axes} <= seen else ()

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return start values with the other end in the middle and at the ends of the recorded positions."""
        edges = {name: data.extent[name] for name in _names(place)}
        span = float(np.hypot.reduce([high - low for low, high in edges.values()])) or 1.0
        force = max(force_scale(dof, data) for dof in place.split("+"))
        sizes = {"stiffness": 2.0 * STRENGTH * force / span}
        if len(edges) > 1:
            sizes["drag"] = DRAG * force / top_speed("surge", data) ** 2
        middle = {name: 0.5 * (low + high) for name, (low, high) in edges.items()}
        ends = [dict(zip(edges, corner, strict=True)) for corner in itertools.product(*edges.values())]
        return tuple(
            {**sizes, "length": share * span, **end} for share, end in ((0.25, middle), *((0.5, end) for end in ends))
        )

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return the bounds: it pulls and drags, and its end is within :data:`AWAY` ranges of position."""
        edges = {name: data.extent[name] for name in _names(place)}
        span = max(high - low for low, high in edges.values()) or 1.0
        reach = {n: (0.5 * (a + b) - AWAY * span, 0.5 * (a + b) + AWAY * span) for n, (a, b) in edges.items()}
        drag = {"drag": (0.0, inf)} if len(edges) > 1 else {}
        return {"stiffness": (0.0, inf), "length": (0.0, 2.0 * AWAY * span), **drag, **reach}

    def inputs(self, effect: EffectInstance) -> tuple[str, ...]:
        """Return the names of the inputs that carry the line's force."""
        return tuple(_INPUTS[dof] for dof in effect.place.split("+"))

    def derivatives(self, effect: EffectInstance) -> Mapping[str, float]:
        """Return the line's force as forces by inputs."""
        return {f"{DOFS[dof].force}_{_INPUTS[dof]}": 1.0 for dof in effect.place.split("+")}

    def drive(self, effect: EffectInstance, drive: Drive) -> Drive:
        """Return *drive* with the line's force added as inputs. Between two stamps it is that half-way."""
        names = _names(effect.place)
        drive, places, speeds, heading = on_track(drive, names)
        away = np.array([[effect[name]] for name in names]) - places
        distance = np.maximum(np.linalg.norm(away, axis=0), 1e-9)
        along = away / distance
        across = speeds - along * np.sum(along * speeds, axis=0)
        lost = effect.values.get("drag", 0.0) * np.linalg.norm(across, axis=0)
        force = effect["stiffness"] * np.maximum(distance - effect["length"], 0.0) * along - lost * across
        if len(names) > 1 and heading is not None:
            c, s = np.cos(heading), np.sin(heading)
            force[:2] = c * force[0] + s * force[1], c * force[1] - s * force[0]
        for dof, values in zip(effect.place.split("+"), force, strict=True):
            drive = drive.with_channel(_INPUTS[dof], values)
        return drive

    def curve(self, effect: EffectInstance, data: DataSummary) -> EffectCurve:
        """Return plot data: pull over distance."""
        distance = np.linspace(0.0, 2.0 * effect["length"], 201)
        pull = effect["stiffness"] * np.maximum(distance - effect["length"], 0.0)
        return EffectCurve(distance, pull, "distance from its end [m]", "pull [N]", "Pull of the line")

    def unit_of(self, name: str, place: str, data: DataSummary) -> str:
        """Return the unit of the stiffness, of the drag, or m."""
        unit = stiffness_unit(place.partition("+")[0], data)
        return {"stiffness": unit, "drag": f"{unit.removesuffix('/m')} s^2/m^2"}.get(name, DOFS["surge"].position_unit)


def _names(place: str) -> tuple[str, ...]:
    return tuple(_POSITIONS[dof] for dof in place.split("+"))
