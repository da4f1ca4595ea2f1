"""Hydrodynamic effects: drag, coupling of degrees of freedom, mass, buoyancy, the bottom."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf, sqrt
from typing import ClassVar

import numpy as np

from gcs_autotune.effects.effect import Drive, Effect, EffectCurve, EffectInstance, Quantity
from gcs_autotune.effects.summary import (
    DataSummary,
    force_scale,
    force_unit,
    inertia_scale,
    known_of,
    sense,
    top_speed,
)
from gcs_autotune.models import DEPTH, FORCES, PAYLOAD
from gcs_autotune.sname import DOFS

__all__ = [
    "CoriolisCoupling",
    "GroundEffect",
    "LinearDrag",
    "MassChange",
    "NetBuoyancy",
    "QuadraticDrag",
    "SwayYawCoupling",
]


def drag_names(dof: str) -> tuple[str, str]:
    """Return the names of the linear and the quadratic drag of *dof*, such as ``("N_r", "N_rr")`` for yaw."""
    d = DOFS[dof]
    return f"{d.force}_{d.velocity}", f"{d.force}_{d.velocity}{d.velocity}"


def drag_polar(effect: EffectInstance, data: DataSummary, title: str) -> EffectCurve:
    """Return plot data: drag over speed, for the base model with the effect and for the base model alone."""
    d = DOFS[effect.place]
    linear, quadratic = drag_names(effect.place)
    known, sign = known_of(data), effect.sense
    nu = np.linspace(-1.0, 1.0, 121) * top_speed(effect.place, data)
    plain = -sign * (known.get(linear, 0.0) + known.get(quadratic, 0.0) * np.abs(nu)) * nu
    more = effect["coefficient"] * (nu if effect.slug == "linear-drag" else np.abs(nu) * nu)
    velocity = f"{d.velocity} [{d.position_unit}/s]"
    return EffectCurve(nu, plain + more, velocity, f"drag [{force_unit(effect.place, data)}]", title, plain=plain)


class Drag(Effect):
    """Effect: drag proportional to a power of speed, ``coefficient`` times speed to the ``power``.

    ``polar``: title of the plot of drag over speed.
    """

    power: ClassVar[int]
    polar: ClassVar[str]
    family = "hydrodynamics"
    is_structural = True
    grows_with = ("coefficient",)

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Return the degrees of freedom whose base model has no drag of this power."""
        return tuple(d for d in data.form.dofs if not self._spellings(d) & set(data.form.parameters))

    def _spellings(self, dof: str) -> set[str]:
        """Return the names that a base model may use for this drag."""
        d, own = DOFS[dof], drag_names(dof)[self.power - 1]
        return {own} if self.power == 1 else {own, f"{d.force}_|{d.velocity}|{d.velocity}"}

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return start values of ``coefficient``, relative to the largest force at the largest speed.

        Some are small, because a heading integrates the effect, so that only a small effect acts linearly.
        """
        full = force_scale(place, data) / top_speed(place, data) ** self.power
        return tuple({"coefficient": share * full} for share in (0.02, 0.1, 0.5))

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return the bounds of ``coefficient``. It is positive, because drag takes energy out of the motion."""
        return {"coefficient": (0.0, inf)}

    def constants(self, place: str, data: DataSummary) -> Mapping[str, float]:
        """Return the constant ``sense``, which is the sign of a damping force."""
        return sense(place, data)

    def derivatives(self, effect: EffectInstance) -> Mapping[str, float]:
        """Return the drag as ``X_u``, ``N_r`` and so on, or as ``X_uu``, ``N_rr`` and so on for the second power."""
        return {drag_names(effect.place)[self.power - 1]: -effect.sense * effect["coefficient"]}

    def curve(self, effect: EffectInstance, data: DataSummary) -> EffectCurve:
        """Return plot data: drag over speed."""
        return drag_polar(effect, data, self.polar)

    def unit_of(self, name: str, place: str, data: DataSummary) -> str:
        """Return the unit of ``coefficient``: force per power of speed."""
        return DOFS[place].parameter_units(force_unit(place, data))[self.power]


class LinearDrag(Drag):
    """Effect: drag ``- coefficient nu`` by skin friction and wave making at low speed.

    It applies if the base model has no linear drag.
    """

    slug = "linear-drag"
    power = 1
    polar = "Linear drag"
    meaning = "drag proportional to speed: slow motion decays exponentially"
    plain = "The resistance of your craft to {motion} grows in proportion to its speed, unlike that of {simulation}."
    parameters = (Quantity("coefficient", "force s/m or s/rad", "drag per unit of speed, positive when it damps"),)
    shown_by = "residual against speed: a straight line through zero, clearest at low speed"
    mistaken_for = ("quadratic-drag", "dead-zone", "actuator-lag")
    separated_by = (
        "full speed, then no command until the craft stops. The end of the coasting shows which law of drag holds"
    )


class QuadraticDrag(Drag):
    """Effect: drag ``- coefficient |nu| nu``, the pressure drag of separated flow at higher speed.

    Source: Miskovic2010 (6.33), ``beta_nn``.
    """

    slug = "quadratic-drag"
    power = 2
    polar = "Drag polar"
    meaning = "drag proportional to the square of speed: twice the force gives less than twice the speed"
    plain = "The resistance of your craft to {motion} grows with the square of its speed, unlike that of {simulation}."
    parameters = (
        Quantity(
            "coefficient",
            "force s^2/m^2 or s^2/rad^2",
            "drag per unit of squared speed, positive when it damps",
        ),
    )
    shown_by = "residual against speed: S-shaped. The simulation is too slow at low speed and too fast at high speed"
    mistaken_for = ("saturation", "quadratic-actuator", "linear-drag", "rudder-stall")
    separated_by = (
        "steps of three sizes each way. Hold each until the speed settles, then let the craft coast to a stop"
    )


TERMS: Mapping[str, tuple[str, str, str]] = {
    "X_vr": ("surge", "sway", "yaw"),
    "Y_ur": ("sway", "surge", "yaw"),
    "N_uv": ("yaw", "surge", "sway"),
}
"""Coefficient -> degree of freedom of its equation, and the two whose velocities it multiplies."""

SHARE = 0.2
"""Start value of a coefficient: its force at the largest speeds, relative to the largest force. Project choice."""


class CoriolisCoupling(Effect):
    """Effect: the forces ``X_vr v r``, ``Y_ur u r`` and ``N_uv u v`` of rigid body and added mass.

    Source: Miskovic, Vukic and Barisic, (4). With the masses ``m_u`` and ``m_v``, they are ``X_vr = m_v``, ``Y_ur =
    -m_u`` and ``N_uv = m_u - m_v`` (the Munk moment).
    """

    slug = "coriolis-coupling"
    words = "Coriolis coupling"
    is_structural = True
    family = "hydrodynamics"
    meaning = "momentum carried through a turn: the craft slides outwards, loses speed and yaws"
    plain = "Your craft slides outwards and loses speed in a turn, but {simulation} does not."
    parameters = (
        Quantity(
            "X_vr",
            "force s^2/(m rad)",
            "surge force per product of sway velocity and yaw rate (equal to the mass in sway)",
        ),
        Quantity(
            "Y_ur",
            "force s^2/(m rad)",
            "sway force per product of surge velocity and yaw rate (minus the mass in surge)",
        ),
        Quantity("N_uv", "moment s^2/m^2", "yaw moment per product of surge and sway velocity (Munk)"),
    )
    shown_by = "sway residual against u times r. Surge residual only in turns"
    mistaken_for = ("sway-yaw-coupling", "speed-dependent-steering", "steady-current")
    separated_by = "turning circles both ways at two speeds ahead, and one turn on the spot"
    grows_with = ("X_vr", "Y_ur", "N_uv")

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Return the place ``surge+sway+yaw``, if the base model has all three degrees of freedom but none of these
        terms.
        """
        form = data.form
        missing = {"surge", "sway", "yaw"} - set(form.dofs)
        return () if missing or form.coriolis or set(TERMS) & set(form.parameters) else ("surge+sway+yaw",)

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return start values: those that follow from the base model's masses, and moderate values together and one by
        one.

        A base model without these forces has often included them in its masses. The masses alone would therefore
        mislead.
        """
        m_u, m_v = inertia_scale("surge", data), inertia_scale("sway", data)
        signs = {"X_vr": 1.0, "Y_ur": -1.0, "N_uv": 1.0 if m_u > m_v else -1.0}
        fair = {n: SHARE * sign * _per_speeds(n, data) for n, sign in signs.items()}
        alone = tuple({n: (v if n == name else 0.0) for n, v in fair.items()} for name in TERMS)
        return ({"X_vr": m_v, "Y_ur": -m_u, "N_uv": m_u - m_v}, fair, *alone)

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return the bounds of the three coefficients. Masses are positive, and the moment may have either sign."""
        return {"X_vr": (0.0, inf), "Y_ur": (-inf, 0.0), "N_uv": (-inf, inf)}

    def derivatives(self, effect: EffectInstance) -> Mapping[str, float]:
        """Return the three coefficients, which are SNAME derivatives."""
        return {name: effect[name] for name in TERMS}

    def unit_of(self, name: str, place: str, data: DataSummary) -> str:
        """Return the unit of the coefficient *name*: force or moment per product of two speeds."""
        return f"{force_unit(TERMS[name][0], data)} s^2/{'m^2' if name == 'N_uv' else '(m rad)'}"


def _per_speeds(name: str, data: DataSummary) -> float:
    dof, first, second = TERMS[name]
    return force_scale(dof, data) / (top_speed(first, data) * top_speed(second, data))


LARGEST = 0.95
"""Largest ``Y_rdot``, relative to the geometric mean of the inertias of sway and yaw. Project choice.

At 1 the mass matrix is singular.
"""


class SwayYawCoupling(Effect):
    """Effect: ``Y_r r`` in sway, ``N_v v`` in yaw, and ``-Y_rdot`` in both off-diagonal elements of the mass matrix.

    With the centre of gravity ``x_G`` ahead, ``-Y_rdot`` is ``m x_G`` (Miskovic, Vukic and Barisic, (4)).
    """

    slug = "sway-yaw-coupling"
    is_structural = True
    family = "hydrodynamics"
    meaning = (
        "turning pushes the craft sideways and sliding turns it, because the centre of gravity or drag is off midships"
    )
    plain = (
        "On your craft sliding sideways causes turning, and turning pushes it sideways. Neither happens in "
        "{simulation}."
    )
    parameters = (
        Quantity("Y_r", "force s/rad", "sway force per yaw rate"),
        Quantity("N_v", "moment s/m", "yaw moment per sway velocity"),
        Quantity("Y_rdot", "force s^2/rad", "sway force per yaw acceleration (minus the entry of the mass matrix)"),
    )
    shown_by = "sway residual against yaw rate, and yaw residual against sway, also without speed ahead"
    mistaken_for = ("coriolis-coupling", "channel-swap", "steady-current")
    separated_by = "a turn on the spot without headway, then a push sideways without turning"
    grows_with = ("Y_r", "N_v", "Y_rdot")

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Return the place ``sway+yaw``, if the base model has both degrees of freedom and no coupling of the two."""
        form = data.form
        there = {"Y_r", "N_v", "Y_rdot", "N_vdot", "x_G"} & set(form.parameters)
        return ("sway+yaw",) if {"sway", "yaw"} <= set(form.dofs) and not there else ()

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return start values: each of the three coefficients alone, at a third of the largest force or mean
        inertia.
        """
        v, r = top_speed("sway", data), top_speed("yaw", data)
        size = {
            "Y_r": -0.3 * force_scale("sway", data) / r,
            "N_v": -0.3 * force_scale("yaw", data) / v,
            "Y_rdot": -0.3 * _mean_inertia(data),
        }
        return tuple({n: (v if n == name else 0.0) for n, v in size.items()} for name in size)

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return the bounds of the three coefficients, which keep the mass matrix positive definite."""
        most = LARGEST * _mean_inertia(data) if data.base else inf
        return {"Y_r": (-inf, inf), "N_v": (-inf, inf), "Y_rdot": (-most, most)}

    def derivatives(self, effect: EffectInstance) -> Mapping[str, float]:
        """Return the three coefficients, which are SNAME derivatives.

        The model adds the mirrored element of ``Y_rdot``.
        """
        return {name: effect[name] for name in ("Y_r", "N_v", "Y_rdot")}

    def unit_of(self, name: str, place: str, data: DataSummary) -> str:
        """Return the unit of the coefficient *name*: force or moment per speed or acceleration."""
        per = {"Y_r": "s/rad", "N_v": "s/m", "Y_rdot": "s^2/rad"}
        return f"{force_unit('yaw' if name == 'N_v' else 'sway', data)} {per[name]}"


def _mean_inertia(data: DataSummary) -> float:
    return sqrt(inertia_scale("sway", data) * inertia_scale("yaw", data))


FOLLOWED = 0.02
"""Least range of a command, relative to its largest value, for which the inertia may depend on it. Project choice.

A smaller range is practically a constant command.
"""

RATIOS, MOMENTS = (1.5, 0.67), 16
"""Start values of a change of inertia: ratios, and number of evenly spaced times. Project choice.

The data do not show the time of a change that is between two changes of command. The times tried must therefore be
about as close as the commands.
"""


FOLLOWS, SIZE = "follows", "size"
"""Names of the constants of an inertia that depends on a command.

- ``FOLLOWS``: index of the command in ``FORCES``.
- ``SIZE``: largest magnitude of the command over the runs.
"""


class MassChange(Effect):
    """Effect: the whole inertia changes by the factor ``ratio`` at ``time`` after the run's start.

    The velocity does not jump. With the constants ``FOLLOWS`` and ``SIZE`` there is no time of change. The inertia then
    depends linearly on the size of a recorded command, up to the factor ``ratio`` at its largest value. This is the
    alternative to a change in time (:meth:`followers`).
    """

    slug = "mass-change"
    family = "hydrodynamics"
    meaning = "inertia changes during the run: a payload is taken aboard or dropped, or the hull takes in water"
    plain = "Your craft gets heavier or lighter during a run, but {simulation} does not."
    parameters = (
        Quantity("ratio", "1", "ratio of inertia after the change to inertia before it"),
        Quantity("time", "s", "time of the change, from the start of the run"),
    )
    happens_at = ("time",)
    grows_with = ("ratio",)
    neutral: ClassVar[Mapping[str, float]] = {"ratio": 1.0}
    shown_by = "residual against time: zero up to one moment, then every acceleration is wrong by the same factor"
    mistaken_for = ("gain-drift", "actuator-lag", "quadratic-drag")
    separated_by = "the same pair of steps at the beginning, in the middle and at the end of the run"

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Return one place with all degrees of freedom joined, because a payload acts on all."""
        return ("+".join(data.form.dofs),)

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return start values for a heavier and a lighter craft, with changes at evenly spaced times of the run."""
        moments = np.linspace(0.0, data.duration, MOMENTS + 2)[1:-1].tolist()
        return tuple({"ratio": ratio, "time": t} for ratio in RATIOS for t in moments)

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return the bounds of ``ratio``, a fifth to five, and of ``time``, within the longest run."""
        return {"ratio": (0.2, 5.0), "time": (0.02 * data.duration, 0.98 * data.duration)}

    def inputs(self, effect: EffectInstance) -> tuple[str, ...]:
        """Return the name of the input that multiplies the inertia."""
        return (PAYLOAD,)

    def drive(self, effect: EffectInstance, drive: Drive) -> Drive:
        """Return *drive* with the inertia factor added as an input, and a stamp where the factor changes."""
        if FOLLOWS in effect.constants:
            return self._following(effect, drive)
        change = drive.start + effect["time"]
        finer = drive.on(np.union1d(drive.t, [drive.start, change]))
        return finer.with_channel(PAYLOAD, np.where(finer.t >= change, effect["ratio"], 1.0))

    def followers(self, effect: EffectInstance, data: DataSummary) -> tuple[EffectInstance, ...]:
        """Return alternatives that depend on each recorded command that changes.

        They are a change of the inertia, and a change of the gain of each other input. A change of inertia and a change
        of gain differ only in the drag.
        """
        found = []
        for k, name in enumerate(FORCES):
            low, high = data.extent.get(name, (0.0, 0.0))
            size = max(abs(low), abs(high))
            if name not in data.channels or high - low <= FOLLOWED * size:
                continue
            found.append(EffectInstance(self.slug, effect.place, {"ratio": 1.0}, {FOLLOWS: float(k), SIZE: size}))
            others = [n for n in data.form.inputs if n != name and len(data.form.inputs[n]) == 1]
            reference = {"X_ref": data.rms[name]}
            found += [EffectInstance("propeller-wash", f"{n}+{name}", {"share": 0.0}, reference) for n in others]
        return tuple(found)

    def _following(self, effect: EffectInstance, drive: Drive) -> Drive:
        name = FORCES[int(effect.constants[FOLLOWS])]
        if name in drive.channels:
            size = np.abs(drive.channels[name])
        else:
            own = drive.measured[name]
            known = np.isfinite(own.values)
            drive = drive.on(np.union1d(drive.t, own.t[known & (own.t > drive.t[0])]))
            row = np.maximum(np.searchsorted(own.t[known], drive.t, side="right") - 1, 0)
            size = np.abs(own.values[known][row])
        share = size / effect.constants[SIZE]
        return drive.with_channel(PAYLOAD, 1.0 + (effect["ratio"] - 1.0) * share)

    def curve(self, effect: EffectInstance, data: DataSummary) -> EffectCurve:
        """Return plot data: inertia over time."""
        t = np.array([0.0, effect["time"], effect["time"], max(data.duration, effect["time"])])
        ones = np.ones(4)
        inertia = np.array([1.0, 1.0, effect["ratio"], effect["ratio"]])
        return EffectCurve(
            t,
            inertia,
            "time since the start of the run [s]",
            "inertia, relative to that at the start [1]",
            "Mass change",
            plain=ones,
        )


class NetBuoyancy(Effect):
    """Effect: a constant ``force`` in heave, positive down, which is weight less buoyancy."""

    slug = "net-buoyancy"
    family = "hydrodynamics"
    meaning = "weight and buoyancy do not cancel: without command the craft sinks (positive) or rises"
    plain = "Without command your craft sinks or rises, but {simulation} does not."
    parameters = (Quantity("force", "force", "weight minus buoyancy, positive down"),)
    shown_by = "mean of the heave residual. Without command the craft keeps sinking or rising"
    mistaken_for = ("asymmetric-thrust", "tether-pull", "gyro-bias", "dead-zone")
    separated_by = "one minute without heave command, then equal pushes up and down at two depths"
    grows_with = ("force",)

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Return the place ``heave``, unless the base model has a constant force in heave."""
        return ("heave",) if "heave" in data.form.dofs and "Z_0" not in data.form.parameters else ()

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return a start value of ``force``: a tenth of the largest command.

        The effect is linear, so the search scales it.
        """
        return ({"force": 0.1 * force_scale(place, data)},)

    def derivatives(self, effect: EffectInstance) -> Mapping[str, float]:
        """Return the force as the SNAME derivative ``Z_0``."""
        return {"Z_0": effect["force"]}

    def unit_of(self, name: str, place: str, data: DataSummary) -> str:
        """Return the unit of the force."""
        return force_unit(place, data)


LENGTHS = (0.1, 0.3, 0.8)
"""Start values of ``length``, relative to the range of depths. Project choice."""


class GroundEffect(Effect):
    """Effect: all drag in one equation is multiplied by ``1 + strength exp(-(bottom - z)/length)``.

    The drag therefore increases near the bottom. ``bottom`` is the deepest recorded ``z``. If the true bottom is deeper
    by h, ``strength`` becomes ``exp(-h/length)`` times its value at the bottom, and the motion is the same. If heave is
    simulated, the simulated depth is used, otherwise the recorded one.
    """

    slug = "ground-effect"
    family = "hydrodynamics"
    meaning = "drag grows close to the bottom or a wall, where the water must escape through a narrow gap"
    plain = "Water resists your craft more close to the bottom or a wall, unlike in {simulation}."
    parameters = (
        Quantity("strength", "1", "relative increase of drag at the deepest point, compared with far above it"),
        Quantity("length", "m", "height above the deepest point at which 37 % of the increase remains"),
    )
    shown_by = "residual against depth: zero high up, but near the bottom the simulation is too fast"
    mistaken_for = ("quadratic-drag", "net-buoyancy", "tether-pull", "gain-drift")
    separated_by = (
        "the same vertical commands up and down, first just above the bottom, then one hull length above it, "
        "then far up"
    )
    grows_with = ("strength",)

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Return the degrees of freedom with drag, if depth is recorded and changes by more than its noise."""
        low, high = data.extent.get("z", (0.0, 0.0))
        if not high - low > 8.0 * data.level.get("z", 0.0):
            return ()
        known = set(data.form.parameters)
        return tuple(d for d in ("heave", "yaw", "surge", "sway") if d in data.form.dofs and known & {*drag_names(d)})

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return start values: drag doubled at the bottom, with the three lengths in :data:`LENGTHS`."""
        low, high = data.extent["z"]
        return tuple({"strength": 1.0, "length": share * (high - low)} for share in LENGTHS)

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return the bounds of ``strength``, which is positive, and of ``length``, at most twice the range of
        depths.
        """
        low, high = data.extent["z"]
        return {"strength": (0.0, 50.0), "length": (0.02 * (high - low), 2.0 * (high - low))}

    def constants(self, place: str, data: DataSummary) -> Mapping[str, float]:
        """Return the deepest recorded depth (``bottom``), and whether heave is simulated (``dives``)."""
        return {"bottom": data.extent["z"][1], "dives": float("heave" in data.form.dofs)}

    def inputs(self, effect: EffectInstance) -> tuple[str, ...]:
        """Return the name of the recorded depth as an input if heave is not simulated, else nothing."""
        return () if effect["dives"] else (DEPTH,)

    def drive(self, effect: EffectInstance, drive: Drive) -> Drive:
        """Return *drive* with the recorded depth added as an input. Between two stamps it is the mean of both."""
        if effect["dives"]:
            return drive
        z = drive.measured["z"]
        known = np.isfinite(z.values)
        finer = drive.on(np.union1d(drive.t, z.t[known]))
        middle = 0.5 * (finer.t + np.append(finer.t[1:], finer.t[-1]))
        return finer.with_channel(DEPTH, np.interp(middle, z.t[known], z.values[known]))

    def derivatives(self, effect: EffectInstance) -> Mapping[str, float]:
        """Return ``wall_Z`` (or that of the other force), with its ``reach`` and ``bottom``."""
        return {
            f"wall_{DOFS[effect.place].force}": effect["strength"],
            "reach": effect["length"],
            "bottom": effect["bottom"],
        }

    def curve(self, effect: EffectInstance, data: DataSummary) -> EffectCurve:
        """Return plot data: drag over height above the bottom."""
        low, high = data.extent["z"]
        height = np.linspace(0.0, high - low, 121)
        drag = 1.0 + effect["strength"] * np.exp(-height / effect["length"])
        name, far = "height above the deepest point [m]", "drag relative to that far from the bottom"
        return EffectCurve(height, drag, name, far, "Ground effect", plain=np.ones(len(height)))
