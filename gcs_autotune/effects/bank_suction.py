"""A vertical bank or wall beside the track: suction towards it, and a moment that turns the bow away."""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, hypot, inf, pi, sin

import numpy as np

from gcs_autotune.effects.effect import Drive, Effect, EffectCurve, EffectInstance, Quantity
from gcs_autotune.effects.summary import DataSummary, force_scale, force_unit, sense, top_speed
from gcs_autotune.effects.track import on_track

__all__ = ["BankSuction"]

DIRECTIONS = 8
"""Number of start values of the direction, evenly spaced. Project choice."""

CLOSE, SHARE = 0.1, 0.2
"""Start values. Project choice.

- ``CLOSE``: least distance to the wall, over the range of positions.
- ``SHARE``: suction and moment there at the highest speed, relative to the largest force.
"""

LEAST = 0.01
"""Least distance to the wall in a fit, over the range of positions. Project choice."""

BANK = "bank"
"""Input that carries the sine of the angle between the wall's direction and the heading, over the distance."""


class BankSuction(Effect):
    """Effect: a straight wall pulls the craft towards it with ``Y u^2 / gap`` and turns its bow away with ``N |u| u /
    gap``.

    The law is that of Norrbin1971. Both are multiplied by the sine of the angle between the wall's direction and the
    heading, so a craft that heads straight at the wall feels neither. The gap is calculated from recorded positions,
    which are those of the craft's origin.
    """

    slug = "bank-suction"
    family = "environment"
    meaning = "a wall beside the craft pulls it sideways and turns its bow away, the more the closer it is"
    plain = "A wall beside the track pulls your craft aside and turns its bow away, unlike in {simulation}."
    parameters = (
        Quantity("direction", "rad", "from the origin straight to the wall"),
        Quantity("distance", "m", "from the origin to the wall"),
        Quantity("Y", "force s^2/m", "suction per squared speed, times the distance"),
        Quantity("N", "moment s^2/m", "moment that turns the bow away per squared speed, times the distance"),
    )
    shown_by = "residual of yaw and sway close to one line, with the square of the speed. None at rest"
    mistaken_for = ("wind-load", "tether-pull", "input-bias", "steady-current")
    separated_by = (
        "straight runs along the wall at two distances and two speeds, both ways. Wind and a tether push a craft at "
        "rest as well"
    )
    grows_with = ("Y", "N")

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Return ``sway+yaw`` or ``yaw``, if surge is simulated, and positions and heading are measured."""
        there = [dof for dof in ("sway", "yaw") if dof in data.form.dofs]
        known = {"surge", "yaw"} <= set(data.form.dofs) and {"x", "y", "psi"} <= set(data.signals)
        return ("+".join(there),) if known else ()

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return start values with the wall close to the recorded positions, in evenly spaced directions."""
        span = _span(data)
        per = CLOSE * span * SHARE / top_speed("surge", data) ** 2
        sizes = {n: per * force_scale(dof, data) for n, dof in (("Y", "sway"), ("N", "yaw")) if dof in place}
        found = []
        for k in range(DIRECTIONS):
            towards = 2.0 * pi * k / DIRECTIONS
            towards -= 2.0 * pi * (towards > pi)
            reach = sum(max(a * e for e in data.extent[n]) for n, a in (("x", cos(towards)), ("y", sin(towards))))
            found.append({"direction": towards, "distance": reach + CLOSE * span, **sizes})
        return tuple(found)

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return the bounds: the wall is within two ranges of position, pulls, and turns the bow either way."""
        far = hypot(*(max(map(abs, data.extent[n])) for n in ("x", "y"))) + 2.0 * _span(data)
        suction = {"Y": (0.0, inf)} if "sway" in place else {}
        return {"direction": (-3.0 * pi, 3.0 * pi), "distance": (-far, far), **suction, "N": (-inf, inf)}

    def constants(self, place: str, data: DataSummary) -> Mapping[str, float]:
        """Return the least distance [m] to the wall, and ``sense``: the sign of a moment to starboard."""
        return {"least": LEAST * _span(data), **sense("yaw", data)}

    def inputs(self, effect: EffectInstance) -> tuple[str, ...]:
        """Return the name of the input that carries the nearness of the wall."""
        return (BANK,)

    def derivatives(self, effect: EffectInstance) -> Mapping[str, float]:
        """Return suction and moment as products with the input."""
        suction = {f"Y_|u||u|{BANK}": effect["Y"]} if "Y" in effect.values else {}
        return {**suction, f"N_|u|u{BANK}": -effect.sense * effect["N"]}

    def drive(self, effect: EffectInstance, drive: Drive) -> Drive:
        """Return *drive* with the nearness of the wall at the recorded positions added as an input."""
        drive, (x, y), _, psi = on_track(drive, ("x", "y"))
        towards = effect["direction"]
        gap = effect["distance"] - cos(towards) * x - sin(towards) * y
        assert psi is not None  # places() requires it
        return drive.with_channel(BANK, np.sin(towards - psi) / np.maximum(gap, effect["least"]))

    def curve(self, effect: EffectInstance, data: DataSummary) -> EffectCurve:
        """Return plot data: moment over distance at the highest speed."""
        gap = np.linspace(0.05, 1.0, 96) * _span(data)
        moment = effect["N"] * top_speed("surge", data) ** 2 / gap
        label = f"moment at the highest speed [{force_unit('yaw', data)}]"
        return EffectCurve(gap, moment, "distance from the wall [m]", label, "Bank suction")

    def unit_of(self, name: str, place: str, data: DataSummary) -> str:
        """Return the unit of suction or moment, or the usual one."""
        dof = {"Y": "sway", "N": "yaw"}.get(name)
        return f"{force_unit(dof, data)} s^2/m" if dof else super().unit_of(name, place, data)


def _span(data: DataSummary) -> float:
    """Return the larger range [m] of the recorded positions north and east, or 1."""
    return max(high - low for low, high in (data.extent["x"], data.extent["y"])) or 1.0
