"""Effects of the flow at an actuator.

Steering depends on the boat's speed or on the propeller's wash, and thrust decreases with speed.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from gcs_autotune.effects.actuator import ActuatorEffect, SharedActuatorEffect, largest, redrawn, steers, with_other
from gcs_autotune.effects.effect import Array, Drive, EffectCurve, EffectInstance, Quantity, columns_of
from gcs_autotune.effects.summary import DataSummary
from gcs_autotune.models import FORCES, STATES
from gcs_autotune.smoothing import best_width, local_polynomials
from gcs_autotune.sname import DOFS, SIGNALS, Dof
from gcs_autotune.trial import Channel

__all__ = ["AdvanceSpeedLoss", "PropellerWash", "SpeedDependentSteering"]


VARIES = 0.1
"""Least range of the speed, relative to its root mean square, from which an effect of the speed can be identified.

Project choice.
"""

GAIN_OF = "gain_"
"""Prefix of the constants ``gain_N`` and so on, which are the base model's forces per unit of input.

A simulated flow multiplies these forces.
"""

WIDTHS = (5, 9, 15, 25, 41, 67, 111)
"""Widths of the parabola that smooths the speed [samples]. One is selected for each run. Project choice."""


class SpeedDependentSteering(ActuatorEffect):
    """Effect: rudder force is proportional to the flow squared.

    Commands are multiplied by ``(1 - share) + share (U/U_ref)^2``.

    ``U`` is the surge speed through the water. If surge is simulated, the simulated speed is used, because noise in a
    measured speed would reduce the estimated effect. Otherwise the measured ``u`` (or speed over ground) is used,
    smoothed according to its noise. ``U_ref`` is the root mean square of the recorded speed over the runs. The source
    is Miskovic2010, (2.37): ``k_r1 U^2 delta`` from the boat's speed, and a constant contribution of the propeller's
    wash. If the input's gain is fitted and surge is simulated, ``share`` is relative to the base model's gain.
    """

    slug = "speed-dependent-steering"
    is_structural = True
    meaning = (
        "a share of the steering force grows with the square of the flow past the rudder. If the share is positive, "
        "the craft steers harder the faster it goes"
    )
    plain = "How hard your craft steers depends on its speed, but {simulation} steers the same at any speed."
    parameters = (
        Quantity(
            "share", "1", "fraction of the steering force that is proportional to speed squared (the rest is constant)"
        ),
    )
    grows_with = ("share",)
    shown_by = "yaw residual per command, against speed: the craft turns too little when slow, too much when fast"
    mistaken_for = ("gain-drift", "quadratic-actuator", "coriolis-coupling", "linear-drag")
    separated_by = (
        "the same zig-zag at slow, half and full speed. Start each at a steady speed. Fly them in mixed order, "
        "because a weakening battery looks the same"
    )

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Return the names of all inputs that turn the craft, if a speed is recorded and varies."""
        name = _speed(data.channels)
        if name is None or name in data.still or data.rms.get(name, 0.0) <= 0.0:
            return ()
        low, high = data.extent.get(name, (0.0, 0.0))
        if high - low < VARIES * data.rms[name]:
            return ()
        return tuple(n for n in super().places(data) if steers(n, data))

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return start values of ``share`` for a partial and a nearly full dependence on speed."""
        return ({"share": 0.4}, {"share": 0.9})

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return the bounds of ``share``: slightly wider than the physical range 0 to 1, so that a fit can end at
        either value.
        """
        return {"share": (-0.2, 1.2)}

    def constants(self, place: str, data: DataSummary) -> Mapping[str, float]:
        """Return the root mean square of the recorded speed (``U_ref``); if surge is simulated, also the forces per
        unit of input.
        """
        name = _speed(data.channels)
        if name is None:
            return {}
        return {"U_ref": data.rms[name], **_gains(place, data)}

    def derivatives(self, effect: EffectInstance) -> Mapping[str, float]:
        """Return the changed input gains ``N_N`` and ``N_|u||u|N`` and so on, if surge is simulated."""
        found = {}
        for key, gain in effect.constants.items():
            if key.startswith(GAIN_OF):
                force = key.removeprefix(GAIN_OF)
                found[f"{force}_{effect.place}"] = -effect["share"] * gain
                found[f"{force}_|u||u|{effect.place}"] = effect["share"] * gain / effect["U_ref"] ** 2
        return found

    def drive(self, effect: EffectInstance, drive: Drive) -> Drive:
        """Return *drive* with commands scaled by the measured flow, if surge is not simulated.

        Between two stamps, the mean of the flow is used.
        """
        name = _speed(drive.measured)
        if name is None or any(key.startswith(GAIN_OF) for key in effect.constants):
            return drive
        stamps, flow = _smooth(drive.measured[name])
        if not len(stamps):
            return drive
        t = np.union1d(drive.t, stamps[stamps > drive.t[0]])
        at = np.interp(t, stamps, flow) / effect["U_ref"]
        ahead = np.r_[at[1:], at[-1]]
        mean = (at * at + at * ahead + ahead * ahead) / 3.0
        u = drive.channels[effect.place][np.searchsorted(drive.t, t, side="right") - 1]
        gain = (1.0 - effect["share"]) + effect["share"] * mean
        return redrawn(drive, effect.place, lambda _: (t, u * gain))

    def curve(self, effect: EffectInstance, data: DataSummary) -> EffectCurve:
        """Return plot data: gain over speed."""
        name = _speed(data.channels) or "u"
        low, high = data.extent.get(name, (0.0, 2.0 * effect["U_ref"]))
        speed = np.linspace(min(low, 0.0), high, 201)
        gain = (1.0 - effect["share"]) + effect["share"] * (speed / effect["U_ref"]) ** 2
        return EffectCurve(
            speed,
            gain,
            f"{name} [m/s]",
            f"gain of {effect.place} [1]",
            "Steering over speed",
            plain=np.ones_like(speed),
        )


THRUST = "X"
"""Name of the propeller's command. The rudder is in the wash of this propeller."""

WASH = 0.05
"""Least range of the propeller's command, relative to its root mean square. Project choice.

It is smaller than :data:`VARIES`, because a command has no noise.
"""


class PropellerWash(ActuatorEffect):
    """Effect: a rudder in a propeller's wash.

    At ``"N+X"`` the command is multiplied by ``(1 - share) + share X|X|/X_ref^2``.

    ``X`` is the recorded command ahead, held until the next stamp. ``X_ref`` is its root mean square over the runs. The
    flow of the wash is proportional to the propeller speed, and thrust to its square (Miskovic2010, (2.37): ``k_r2 n^2
    delta``). A fit of yaw alone gives inertia and drag per rudder angle; both then decrease with ``n^2``.

    A ``share`` below 0 means that more thrust steers less. Example: between 36 and 49 V^2 inertia and drag increase by
    a tenth (Miskovic2010, table 7.12).
    """

    slug = "propeller-wash"
    is_structural = True
    meaning = "how hard the rudder turns the craft depends on the thrust of the propeller in front of it"
    plain = "How hard the rudder turns your craft depends on the thrust, unlike in {simulation}."
    parameters = (
        Quantity(
            "share",
            "1",
            "fraction of the steering force that is proportional to thrust squared (the rest is constant). "
            "Below 0, more thrust steers less",
        ),
    )
    grows_with = ("share",)
    shown_by = "yaw residual per command, against the thrust command: the craft turns too little at low thrust"
    mistaken_for = ("speed-dependent-steering", "gain-drift", "mass-change", "command-coupling")
    separated_by = (
        "the same zig-zag at a third, two thirds and all of the thrust. Fly the first half of each before the speed "
        "has changed. Propeller wash follows the thrust at once. Inflow from headway follows the speed"
    )

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Return the places ``input+X`` for all inputs that only turn the craft, if the thrust command is recorded
        and varies.
        """
        low, high = data.extent.get(THRUST, (0.0, 0.0))
        if THRUST not in data.channels or high - low <= WASH * data.rms.get(THRUST, 0.0):
            return ()
        own = [n for n in super().places(data) if n != THRUST and steers(n, data) and len(data.form.inputs[n]) == 1]
        return tuple(f"{n}+{THRUST}" for n in own)

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return start values of ``share``: a slight decrease with thrust, and a partial and a nearly full
        dependence.
        """
        return ({"share": -0.2}, {"share": 0.4}, {"share": 0.9})

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return the bounds of ``share``: slightly wider than the physical limit 1, and equally far below 0."""
        return {"share": (-1.2, 1.2)}

    def constants(self, place: str, data: DataSummary) -> Mapping[str, float]:
        """Return the root mean square of the thrust command (``X_ref``)."""
        return {"X_ref": data.rms[THRUST]}

    def drive(self, effect: EffectInstance, drive: Drive) -> Drive:
        """Return *drive* with the commands scaled by the thrust command.

        If the thrust command drives the craft, it includes the effects applied before.
        """
        name, other = columns_of(effect.place)
        both = with_other(drive, name, other)
        if both is None:
            return drive
        return redrawn(drive, name, lambda _: (both[0], both[1] * self._gain(effect, both[2])))

    def _gain(self, effect: EffectInstance, thrust: Array) -> Array:
        gain: Array = (1.0 - effect["share"]) + effect["share"] * thrust * np.abs(thrust) / effect["X_ref"] ** 2
        return gain

    def curve(self, effect: EffectInstance, data: DataSummary) -> EffectCurve:
        """Return plot data: gain over thrust."""
        name = columns_of(effect.place)[0]
        low, high = data.extent.get(THRUST, (0.0, 2.0 * effect["X_ref"]))
        thrust = np.linspace(min(low, 0.0), high, 201)
        gain = self._gain(effect, thrust)
        x_label, y_label = f"{THRUST} commanded [{data.command_unit(THRUST)}]", f"gain of {name} [1]"
        return EffectCurve(thrust, gain, x_label, y_label, "Steering over thrust", plain=np.ones_like(thrust))


def _speed(channels: Mapping[str, object] | frozenset[str]) -> str | None:
    """Return the channel that best represents the speed through the water."""
    return next((n for n in ("u", "U") if n in channels), None)


def _gains(place: str, data: DataSummary) -> dict[str, float]:
    """Return the gain of every force that the input drives; empty if surge is not simulated or a gain is unknown."""
    if "surge" not in data.form.dofs:
        return {}
    driven = {DOFS[d].force for d in data.form.dofs}
    found = {}
    for force, gain in data.form.inputs[place]:
        if force not in driven:
            continue
        if isinstance(gain, str):
            name = gain.removeprefix("-")
            if name not in data.base or gain == f"-{force}_{place}":
                return {}
            found[GAIN_OF + force] = -data.base[name] if gain.startswith("-") else data.base[name]
        else:
            found[GAIN_OF + force] = gain
    return found


@lru_cache(maxsize=64)
def _smooth(speed: Channel) -> tuple[Array, Array]:
    """Return the stamps of the valid samples and the smoothed speeds (n,).

    Without smoothing, noise would look like a varying speed.
    """
    good = np.isfinite(speed.values)
    t, values = speed.t[good], speed.values[good]
    widths = [w for w in WIDTHS if 3 * w <= len(values)]
    if not widths:
        return t, values
    width, _ = best_width(t, values, widths, degree=2)
    return t, local_polynomials(t, values, t, width, degree=2).derivative(0)


GAIN, AXIS = "gain", "axis"
"""Names of the constants of a thruster.

- ``GAIN``: magnitude of the base model's force per unit of input.
- ``AXIS``: index of the force (0 to 5: X Y Z K M N).
"""

RUDDER = "rad"
"""Unit of inputs that are angles and therefore not thrusters."""

PER_SPEED = "s/m or s/rad"


class AdvanceSpeedLoss(SharedActuatorEffect):
    """Effect: the force of a thruster is reduced by ``loss |force| nu`` (bilinear thruster).

    Sources: Miskovic2010, (2.4): ``T_|n|n |n| n - T_|n|u_a |n| u_a``; ZhaoUSV, eq. (4). ``nu`` is the velocity through
    the water along the thruster's axis. The thruster must drive one degree of freedom only. The effect is a term
    ``X_|X|u`` of the equations of motion. It depends on the actual output, after all other effects on the command. If
    the input's gain is fitted, ``force`` is calculated with the base model's gain.
    """

    slug = "advance-speed-loss"
    is_structural = True
    meaning = "a propeller loses thrust as the inflow speeds up: strong from rest, weak at speed"
    plain = "The thrust of your craft falls as it gains speed, but not in {simulation}."
    parameters = (
        Quantity(
            "loss", PER_SPEED, "fraction of the thrust lost per unit of speed ahead, or gained per unit of speed astern"
        ),
    )
    grows_with = ("loss",)
    shown_by = "residual against speed under power: it grows with speed. It is zero while drifting to a stop"
    mistaken_for = ("linear-drag", "quadratic-drag", "saturation")
    yields_to = ("quadratic-drag",)  # every hull has it; at few levels of one command both slow the craft alike
    separated_by = (
        "steady speed at half and at full command, then coasting to a stop without command after each. A loss of "
        "thrust acts only under power and is larger at full command. Drag acts all the time"
    )

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Return the names of all thrusters that act along a single simulated axis."""
        thrusters = [n for n in data.inputs if data.inputs[n] != RUDDER and _axis(n, data) is not None]
        return tuple(place for place in super().places(data) if set(columns_of(place)) <= set(thrusters))

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return start values of ``loss``: a fifth and two thirds of the thrust at the highest speed."""
        return tuple({"loss": share / _fastest(place, data)} for share in (0.2, 0.67))

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return the bounds of ``loss``.

        Thrust does not increase with speed, and the loss at the highest speed is at most four times the thrust.
        """
        return {"loss": (0.0, 4.0 / _fastest(place, data))}

    def constants(self, place: str, data: DataSummary) -> Mapping[str, float]:
        """Return the gain of the input and the index of the axis that it drives."""
        ((force, gain),) = data.form.inputs[columns_of(place)[0]]
        size = abs(data.base.get(gain.lstrip("-"), 1.0)) if isinstance(gain, str) else abs(gain)
        return {GAIN: size, AXIS: float(FORCES.index(force))}

    def derivatives(self, effect: EffectInstance) -> Mapping[str, float]:
        """Return the loss as ``X_|X|u`` and so on, for each thruster."""
        i = int(effect[AXIS])
        return {f"{FORCES[i]}_|{n}|{STATES[i]}": -effect["loss"] * effect[GAIN] for n in columns_of(effect.place)}

    def curve(self, effect: EffectInstance, data: DataSummary) -> EffectCurve:
        """Return plot data: force at full command over speed ahead."""
        force, velocity = FORCES[int(effect[AXIS])], STATES[int(effect[AXIS])]
        nu = np.linspace(0.0, _fastest(effect.place, data), 101)
        rest = np.full_like(nu, effect[GAIN] * largest(effect.place, data))
        unit = data.inputs[columns_of(effect.place)[0]] if effect[GAIN] == 1.0 else SIGNALS[force][0]
        x_label, y_label = f"{velocity} [{SIGNALS[velocity][0]}]", f"{force} at full {effect.place} [{unit}]"
        return EffectCurve(nu, rest * (1.0 - effect["loss"] * nu), x_label, y_label, "Thrust over speed", plain=rest)

    def unit_of(self, name: str, place: str, data: DataSummary) -> str:
        """Return the unit of ``loss``: seconds per metre, or seconds per radian for a rotation."""
        dof = _axis(place, data)
        return "s/rad" if dof is not None and dof.angular else "s/m"


def _axis(place: str, data: DataSummary) -> Dof | None:
    """Return the only degree of freedom that an input drives; None if it drives none or several."""
    pairs = data.form.inputs.get(columns_of(place)[0], ())
    driven = [DOFS[d] for d in data.form.dofs for force, _ in pairs if DOFS[d].force == force]
    return driven[0] if len(pairs) == 1 and len(driven) == 1 else None


def _fastest(place: str, data: DataSummary) -> float:
    """Return the highest speed along an input's axis: measured, or estimated from the spread of positions."""
    dof = _axis(place, data)
    if dof is None:
        return 1.0
    if dof.velocity in data.extent:
        found = max(abs(v) for v in data.extent[dof.velocity])
    else:
        spread = data.spread.get(dof.position, 1.0)
        found = spread / min(data.time_constant, data.duration)
    return max(found, 1e-9)
