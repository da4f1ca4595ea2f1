"""Wind on the superstructure: surge, sway and yaw together."""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, inf, pi, sin

import numpy as np

from gcs_autotune.effects.effect import Effect, EffectCurve, EffectInstance, Quantity
from gcs_autotune.effects.summary import DataSummary, force_scale, force_unit, sense

__all__ = ["WindLoad"]

DIRECTIONS = 8
"""Number of start values of the wind direction, evenly spaced. Project choice."""

FORCES = {"surge": "X", "sway": "Y", "yaw": "N"}


class WindLoad(Effect):
    """Effect: wind on the superstructure, with one direction for all axes.

    ``X_wind cos(a)``, ``Y_wind sin(a)``, ``-N_wind sin(2 a)`` with ``a`` the direction towards which the wind blows
    minus the heading (Fossen2011, section 8.1, a superstructure that is symmetric fore and aft). The wind is much
    faster than the craft. What it adds to the drag is part of the plain model, and gusts are part of the residual.
    """

    slug = "wind-load"
    family = "environment"
    meaning = "wind on the superstructure pushes the craft ahead and aside, and turns it"
    plain = "Wind pushes your craft and turns it, but {simulation} has no wind."
    parameters = (
        Quantity("X", "N", "force ahead with the wind from astern"),
        Quantity("Y", "N", "force to starboard with the wind from port"),
        Quantity("N", "N m", "moment to starboard with the wind 45 degrees on the port bow"),
        Quantity("direction", "rad", "direction towards which the wind blows"),
    )
    grows_with = ("X", "Y", "N")
    shown_by = "residual of speed against heading: one wave per turn. Residual of yaw: two waves per turn"
    mistaken_for = ("steady-current", "wind-moment", "input-bias", "tether-pull")
    separated_by = (
        "half a minute without command on each of four headings, after each the same with full command. A current "
        "carries the craft as fast without command as with it and does not turn it. Wind does turn it"
    )

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Return ``surge+yaw`` or ``surge+sway+yaw``, if heading and speed ahead are measured, or a track."""
        form, seen = data.form, set(data.signals)
        there = [dof for dof in FORCES if dof in form.dofs]
        known = {f"{FORCES[dof]}_{angle}" for dof in there for angle in ("sinpsi", "cospsi")} & set(form.parameters)
        if known or not {"surge", "yaw"} <= set(there) or "psi" not in seen:
            return ()
        return ("+".join(there),) if "u" in seen or {"x", "y"} <= seen else ()

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return start values: a tenth of the largest command each, in evenly spaced directions."""
        sizes = {FORCES[dof]: 0.1 * force_scale(dof, data) for dof in place.split("+")}
        turns = (2.0 * pi * k / DIRECTIONS for k in range(DIRECTIONS))
        return tuple({**sizes, "N": 0.0, "direction": d if d <= pi else d - 2.0 * pi} for d in turns)

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return the bounds: the wind pushes downwind, and turns the bow either way."""
        edges = {"X": (0.0, inf), "Y": (0.0, inf), "N": (-inf, inf), "direction": (-3.0 * pi, 3.0 * pi)}
        return {n: edge for n, edge in edges.items() if n == "direction" or n in [FORCES[d] for d in place.split("+")]}

    def constants(self, place: str, data: DataSummary) -> Mapping[str, float]:
        """Return the constant ``sense``: the sign of a moment to starboard."""
        return sense("yaw", data)

    def derivatives(self, effect: EffectInstance) -> Mapping[str, float]:
        """Return the forces as products of sine and cosine of the heading."""
        X, Y, N = (effect.values.get(name, 0.0) for name in "XYN")
        c, s = cos(effect["direction"]), sin(effect["direction"])
        twice, N = 2.0 * s * c, effect.sense * N
        found = {"X_cospsi": X * c, "X_sinpsi": X * s, "N_0": -N * twice, "N_sinpsisinpsi": 2.0 * N * twice}
        found["N_sinpsicospsi"] = 2.0 * N * (c * c - s * s)
        return found | ({"Y_cospsi": Y * s, "Y_sinpsi": -Y * c} if "Y" in effect.values else {})

    def curve(self, effect: EffectInstance, data: DataSummary) -> EffectCurve:
        """Return plot data: force ahead over heading (polar)."""
        psi = np.linspace(0.0, 2.0 * np.pi, 181)
        ahead = effect["X"] * np.cos(effect["direction"] - psi)
        unit = force_unit("surge", data)
        return EffectCurve(psi, ahead, "heading [rad]", f"force ahead [{unit}]", "Wind", polar=True)

    def unit_of(self, name: str, place: str, data: DataSummary) -> str:
        """Return the unit of a force or moment, or rad for ``direction``."""
        dof = next((dof for dof, force in FORCES.items() if force == name), None)
        return "rad" if dof is None else force_unit(dof, data)
