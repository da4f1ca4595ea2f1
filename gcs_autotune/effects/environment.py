"""Effects of the surroundings: a constant force, current, wind, a tether."""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, inf, pi, sin
from typing import ClassVar

import numpy as np

from gcs_autotune.effects.effect import INPUT, Effect, EffectCurve, EffectInstance, Quantity
from gcs_autotune.effects.summary import DataSummary, force_scale, force_unit, sense, stiffness_unit, top_speed
from gcs_autotune.sname import DOFS

__all__ = ["OVER_GROUND", "THROUGH_WATER", "InputBias", "SteadyCurrent", "TetherPull", "WindMoment"]


class InputBias(Effect):
    """Effect: a constant ``bias`` in one equation, caused by trim, a tether's steady pull or a list.

    For heave see ``net-buoyancy``.
    """

    slug = "input-bias"
    family = "environment"
    meaning = "a constant force or moment: trim, tether, list, an actuator off the centre line"
    plain = "A constant push acts on your craft in {motion}, but not on {simulation}."
    parameters = (Quantity("bias", INPUT, "constant force, in the unit of the input"),)
    grows_with = ("bias",)
    shown_by = "mean of the one-step residual. The free simulation drifts to one side"
    mistaken_for = ("asymmetric-thrust", "gyro-bias", "wind-moment", "steady-current")
    separated_by = "one minute without command, then the same manoeuvre on another heading"

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Return every degree of freedom except heave, unless the base model has a constant force in its equation."""
        there = set(data.form.parameters)
        return tuple(d for d in data.form.dofs if d != "heave" and f"{DOFS[d].force}_0" not in there)

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return a start value of ``bias``: a tenth of the largest command.

        The effect is linear, so the search scales it.
        """
        return ({"bias": 0.1 * force_scale(place, data)},)

    def derivatives(self, effect: EffectInstance) -> Mapping[str, float]:
        """Return the constant force as ``X_0``, ``N_0`` and so on."""
        return {f"{DOFS[effect.place].force}_0": effect["bias"]}

    def unit_of(self, name: str, place: str, data: DataSummary) -> str:
        """Return the unit of the force, or that of the input if forces are known only as fractions or angles."""
        return force_unit(place, data)


OVER_GROUND, THROUGH_WATER = "over ground", "through water"
"""Places of a current, which state the meaning of ``u`` and ``v`` in the file.

Speeds over ground come from a satellite receiver or a bottom-locked log. Speeds through water come from a paddle wheel.
"""

FASTEST = 5.0
"""Fastest current that is searched [m/s]. Project choice.

Strong tidal races are faster, but not suitable for a tune.
"""

_NAMES: Mapping[str, Mapping[str, str]] = {
    OVER_GROUND: {"V_x": "V_x", "V_y": "V_y"},
    THROUGH_WATER: {"V_x": "drift_x", "V_y": "drift_y"},
}


class SteadyCurrent(Effect):
    """Effect: a steady, irrotational current. The equations of motion apply to the velocity through the water.

    Source: Fossen2011, 8.3. Speeds over ground then include the current in the body frame. Speeds through the water do
    not, and only positions drift. For files with positions and heading but no speeds, both meanings of the speeds give
    the same result; the first is used.
    """

    slug = "steady-current"
    family = "environment"
    meaning = "the water moves over the ground, so the craft drifts in one direction on any heading"
    plain = "A current carries your craft, but {simulation} moves in still water."
    parameters: ClassVar[tuple[Quantity, ...]] = (
        Quantity("V_x", "m/s", "current towards north"),
        Quantity("V_y", "m/s", "current towards east"),
    )
    shown_by = (
        "residual of position grows evenly to one side. Residual of speed over ground against heading: one wave "
        "per turn"
    )
    mistaken_for = ("input-bias", "compass-deviation", "tether-pull", "asymmetric-thrust")
    separated_by = "steady straight legs on four headings at one throttle, or two minutes of drifting"
    grows_with = ("V_x", "V_y")

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Return the meanings of the speeds with which the file can distinguish a current from a constant force.

        Without a heading, only the drift of a position against a measured speed identifies a current.
        """
        form, seen = data.form, set(data.signals)
        if {"V_x", "V_y", "drift_x", "drift_y"} & set(form.parameters) or not {"surge", "sway"} & set(form.dofs):
            return ()
        speeds, positions = seen & {"u", "v"}, seen & {"x", "y"}
        turns = "yaw" in form.dofs and "psi" in seen
        if "yaw" in form.dofs and not turns:
            return ()
        over_ground = turns and (bool(speeds) or len(positions) == 2)
        return (OVER_GROUND,) * over_ground + (THROUGH_WATER,) * bool(speeds and positions)

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return start values of the current: along each axis and between the axes. Scaling gives the opposite sign.

        For a craft on a straight line, only north or only east is returned.
        """
        V = 0.2 * max(top_speed(d, data) for d in ("surge", "sway") if d in data.form.dofs)
        if "yaw" in data.form.dofs or {"surge", "sway"} <= set(data.form.dofs):
            return tuple({"V_x": a * V, "V_y": b * V} for a, b in ((1.0, 0.0), (0.0, 1.0), (0.7, 0.7), (0.7, -0.7)))
        return ({"V_x": V},) if "surge" in data.form.dofs else ({"V_y": V},)

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return the bounds of the current components ``V_x`` and ``V_y``: :data:`FASTEST` in both directions."""
        return {"V_x": (-FASTEST, FASTEST), "V_y": (-FASTEST, FASTEST)}

    def derivatives(self, effect: EffectInstance) -> Mapping[str, float]:
        """Return the current as parameters of the simulator.

        Their names depend on whether the speeds include the current.
        """
        names = _NAMES[effect.place]
        return {names[n]: v for n, v in effect.values.items()}

    def curve(self, effect: EffectInstance, data: DataSummary) -> EffectCurve:
        """Return plot data: the component of the current along each heading (polar)."""
        psi = np.linspace(0.0, 2.0 * np.pi, 181)
        along = effect.values.get("V_x", 0.0) * np.cos(psi) + effect.values.get("V_y", 0.0) * np.sin(psi)
        return EffectCurve(psi, along, "heading [rad]", "current from astern [m/s]", "Current", polar=True)


DIRECTIONS = 6
"""Number of start values of the wind direction, evenly spaced. Project choice."""


class WindMoment(Effect):
    """Effect: wind turns the bow towards ``direction`` by ``N += strength sin(direction - psi)``.

    Whether ``direction`` is upwind or downwind depends on the hull. A measured heading is needed. ``direction`` is
    measured from north towards east. A fit may return a value outside [0, 2 pi).
    """

    slug = "wind-moment"
    family = "environment"
    meaning = "wind on the hull turns the bow towards one direction, most strongly with the wind abeam"
    plain = "Wind turns the bow of your craft towards one direction, but {simulation} has no wind."
    parameters = (
        Quantity("strength", INPUT, "moment when the wind is abeam"),
        Quantity("direction", "rad", "heading towards which the wind turns the bow"),
    )
    shown_by = "yaw residual against heading: one wave per turn, in the gyro as well as in the compass"
    mistaken_for = ("input-bias", "compass-deviation", "tether-pull", "gyro-bias")
    separated_by = "two slow full turns, one each way, then half a minute without command on each of two headings"
    grows_with = ("strength",)

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Return the place ``yaw``, if the heading is measured and the base model has no such moment."""
        there = {"N_sinpsi", "N_cospsi"} & set(data.form.parameters)
        return ("yaw",) if "yaw" in data.form.dofs and "psi" in data.signals and not there else ()

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return start values: a strength of a fifth of the largest command, in evenly spaced directions."""
        strength = 0.2 * force_scale(place, data)
        turns = (2.0 * pi * k / DIRECTIONS for k in range(DIRECTIONS))
        return tuple({"strength": strength, "direction": d if d <= pi else d - 2.0 * pi} for d in turns)

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return the bounds of ``strength`` and ``direction``.

        The strength is positive, because the direction determines the sign.
        """
        return {"strength": (0.0, inf), "direction": (-3.0 * pi, 3.0 * pi)}

    def constants(self, place: str, data: DataSummary) -> Mapping[str, float]:
        """Return the constant ``sense``: the sign of a moment to starboard."""
        return sense(place, data)

    def derivatives(self, effect: EffectInstance) -> Mapping[str, float]:
        """Return ``N_cospsi`` and ``N_sinpsi``, which together are the sine of the angle between wind and heading."""
        strength = effect.sense * effect["strength"]
        return {"N_cospsi": strength * sin(effect["direction"]), "N_sinpsi": -strength * cos(effect["direction"])}

    def curve(self, effect: EffectInstance, data: DataSummary) -> EffectCurve:
        """Return plot data: moment over heading (polar)."""
        psi = np.linspace(0.0, 2.0 * np.pi, 181)
        moment = effect["strength"] * np.sin(effect["direction"] - psi)
        unit = force_unit(effect.place, data)
        return EffectCurve(psi, moment, "heading [rad]", f"moment to starboard [{unit}]", "Wind moment", polar=True)

    def unit_of(self, name: str, place: str, data: DataSummary) -> str:
        """Return the unit of the moment for ``strength``, or rad for ``direction``."""
        return force_unit(place, data) if name == "strength" else "rad"


PLANE = "surge+sway"

STRENGTH = 0.3
"""Start value of the pull across the range of positions, relative to the largest force. Project choice."""

AWAY = 5.0
"""Largest distance of an anchor from the middle of the positions, in ranges of position. Project choice.

The pull of an anchor farther away is practically a constant force.
"""


class TetherPull(Effect):
    """Effect: a tether pulls with ``- stiffness (position - anchor)`` in one degree of freedom, or towards a point in
    the plane.

    In the plane, the point is ``x``, ``y``. The pull is earth-fixed and rotated into the body frame. A craft without
    yaw is assumed to head north.
    """

    slug = "tether-pull"
    family = "environment"
    meaning = "a spring holds the craft: the pull is proportional to the distance from the slack position"
    plain = "Something holds your craft like a spring, but {simulation} moves freely."
    parameters = (
        Quantity("stiffness", "force/m or moment/rad", "pull per distance"),
        Quantity("anchor", "m or rad", "position without pull"),
        Quantity("x", "m", "position without pull, north (motion in the plane)"),
        Quantity("y", "m", "position without pull, east (motion in the plane)"),
    )
    shown_by = "residual against position: a slope towards one place, to which the craft returns when left alone"
    mistaken_for = ("input-bias", "net-buoyancy", "steady-current", "wind-moment")
    separated_by = (
        "release without command from three positions (or headings, or depths). A spring pulls the craft back each time"
    )
    grows_with = ("stiffness",)

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Return the degrees of freedom whose position is measured.

        These are yaw and heave, surge alone on a straight line, and surge and sway together in the plane.
        """
        form, seen = data.form, set(data.signals)
        found: list[str] = [d for d in ("yaw", "heave") if d in form.dofs and DOFS[d].position in seen]
        if "surge" in form.dofs and not {"sway", "yaw"} & set(form.dofs) and "x" in seen:
            found.append("surge")
        if {"surge", "sway"} <= set(form.dofs) and {"x", "y"} <= seen:
            found.append(PLANE)
        return tuple(d for d in found if d == PLANE or f"{DOFS[d].force}_{DOFS[d].position}" not in form.parameters)

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return start values with the anchor in the middle and at the ends of the recorded positions."""
        if place == PLANE:
            (west, east), (south, north) = data.extent["y"], data.extent["x"]
            span = max(east - west, north - south) or 1.0
            stiffness = STRENGTH * max(force_scale(d, data) for d in ("surge", "sway")) / span
            middle = (0.5 * (south + north), 0.5 * (west + east))
            ends = [(n, e) for n in (south, north) for e in (west, east)]
            return tuple({"stiffness": stiffness, "x": n, "y": e} for n, e in (middle, *ends))
        low, high = data.extent[DOFS[place].position]
        stiffness = STRENGTH * force_scale(place, data) / ((high - low) or 1.0)
        return tuple({"stiffness": stiffness, "anchor": a} for a in (0.5 * (low + high), low, high))

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return the bounds of the stiffness, which is positive, and of the anchor.

        The anchor is within :data:`AWAY` ranges of position from the middle.
        """
        names = {"x": "x", "y": "y"} if place == PLANE else {"anchor": DOFS[place].position}
        edges = {name: data.extent[signal] for name, signal in names.items()}
        span = max(high - low for low, high in edges.values()) or 1.0
        reach = {n: (0.5 * (a + b) - AWAY * span, 0.5 * (a + b) + AWAY * span) for n, (a, b) in edges.items()}
        return {"stiffness": (0.0, inf), **reach}

    def constants(self, place: str, data: DataSummary) -> Mapping[str, float]:
        """Return the constant ``sense``, which is the sign of a restoring force. In the plane there is none."""
        return sense(place, data) if place != PLANE else {}

    def derivatives(self, effect: EffectInstance) -> Mapping[str, float]:
        """Return ``N_psi`` and ``N_0``, or ``Z_z`` and ``Z_0`` for heave.

        In the plane, return the products of position with sine and cosine of the heading.
        """
        k = effect.sense * effect["stiffness"]
        if effect.place != PLANE:
            d = DOFS[effect.place]
            return {f"{d.force}_{d.position}": -k, f"{d.force}_0": k * effect["anchor"]}
        north, east = k * effect["x"], k * effect["y"]
        return {
            "X_xcospsi": -k, "X_ysinpsi": -k, "X_cospsi": north, "X_sinpsi": east,
            "Y_xsinpsi": k, "Y_ycospsi": -k, "Y_sinpsi": -north, "Y_cospsi": east,
        }  # fmt: skip

    def curve(self, effect: EffectInstance, data: DataSummary) -> EffectCurve:
        """Return plot data: pull over position, or in the plane pull over distance from the anchor."""
        if effect.place == PLANE:
            far = max(high - low for low, high in (data.extent["x"], data.extent["y"])) or 1.0
            distance = np.linspace(0.0, far, 61)
            unit = force_unit("surge", data)
            return EffectCurve(
                distance, effect["stiffness"] * distance, "distance [m]", f"pull [{unit}]", "Tether pull"
            )
        d = DOFS[effect.place]
        x = np.linspace(*data.extent[d.position], 61)
        pull = -effect["stiffness"] * (x - effect["anchor"])
        unit = force_unit(effect.place, data)
        return EffectCurve(x, pull, f"{d.position} [{d.position_unit}]", f"pull [{unit}]", "Tether pull")

    def unit_of(self, name: str, place: str, data: DataSummary) -> str:
        """Return the unit of force per distance for ``stiffness``, or that of the position for the anchor."""
        first = place.split("+")[0]
        return stiffness_unit(first, data) if name == "stiffness" else DOFS[first].position_unit
