"""Effects of the water that flows to an actuator: steering by way or by a propeller's wash, thrust lost with speed."""

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
"""Speeds must range over this share of their root mean square for their effect to be seen."""

GAIN_OF = "gain_"
"""Constants ``gain_N`` and so on: what a simulated flow multiplies, the base model's forces per input."""

WIDTHS = (5, 9, 15, 25, 41, 67, 111)
"""Numbers of samples of a smoothing parabola for the speed; each run selects one."""


class SpeedDependentSteering(ActuatorEffect):
    """Commands act times ``(1 - share) + share (U/U_ref)^2``: rudder force goes with the square of the flow.

    ``U`` is the surge speed through the water: the simulated one where surge is simulated, as noise in a measured one
    would come out as a weaker effect; else the measured ``u`` (or speed over ground), smoothed as its noise asks.
    ``U_ref`` is the root mean square of the recorded one over the runs. Miskovic2010, (2.37):
    ``k_r1 U^2 delta`` from the boat's way, and a rest, from the propeller's race, that does not depend on it. Where the
    input's gain is fitted and surge simulated, ``share`` is one of the base model's gain.
    """

    slug = "speed-dependent-steering"
    is_structural = True
    meaning = "the faster water flows past the rudder, the harder it turns the craft"
    plain = "Your {craft} steers harder the faster it goes; {simulation} steers the same at any speed."
    parameters = (
        Quantity("share", "1", "fraction of the steering proportional to speed squared; the rest is constant"),
    )
    grows_with = ("share",)
    shown_by = "yaw residual over command, against speed: too weak a turn when slow, too strong when fast"
    mistaken_for = ("gain-drift", "quadratic-actuator", "coriolis-coupling", "linear-drag")
    separated_by = (
        "the same zig-zag at slow, half and full speed, each speed steady before it begins; in mixed order, because "
        "a weakening battery looks the same"
    )

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Every input that turns the craft, when a speed is recorded and varies."""
        name = _speed(data.channels)
        if name is None or name in data.still or data.rms.get(name, 0.0) <= 0.0:
            return ()
        low, high = data.extent.get(name, (0.0, 0.0))
        if high - low < VARIES * data.rms[name]:
            return ()
        return tuple(n for n in super().places(data) if steers(n, data))

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Partly, and wholly."""
        return ({"share": 0.4}, {"share": 0.9})

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """A little beyond the physical 0 to 1, so that a fit can end at either."""
        return {"share": (-0.2, 1.2)}

    def constants(self, place: str, data: DataSummary) -> Mapping[str, float]:
        """The root mean square of the recorded speed, and where surge is simulated what it multiplies."""
        name = _speed(data.channels)
        if name is None:
            return {}
        return {"U_ref": data.rms[name], **_gains(place, data)}

    def derivatives(self, effect: EffectInstance) -> Mapping[str, float]:
        """``N_N`` and ``N_|u||u|N`` and so on, where surge is simulated."""
        found = {}
        for key, gain in effect.constants.items():
            if key.startswith(GAIN_OF):
                force = key.removeprefix(GAIN_OF)
                found[f"{force}_{effect.place}"] = -effect["share"] * gain
                found[f"{force}_|u||u|{effect.place}"] = effect["share"] * gain / effect["U_ref"] ** 2
        return found

    def drive(self, effect: EffectInstance, drive: Drive) -> Drive:
        """Scale the commands with the measured flow, held at its mean between stamps, where surge is not simulated."""
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
        """Gain over speed."""
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
"""The command of the propeller whose wash a rudder lies in."""

WASH = 0.05
"""Chosen: least range of that command over its root mean square: a command has no noise."""


class PropellerWash(ActuatorEffect):
    """At ``"N+X"`` the command acts times ``(1 - share) + share X|X|/X_ref^2``: a rudder in a propeller's race.

    ``X`` is the recorded command ahead, held from stamp to stamp; ``X_ref`` its root mean square over the runs. The
    race flows with the propeller speed, and thrust with its square (Miskovic2010, (2.37): ``k_r2 n^2 delta``). Inertia
    and drag per rudder angle, as a fit of yaw alone has them, then fall with ``n^2`` together. A ``share`` below 0
    means that more thrust steers less: between 36 and 49 V^2 they rise by a tenth (Miskovic2010, table 7.12).
    """

    slug = "propeller-wash"
    is_structural = True
    meaning = "the more water the propeller pushes over the rudder, the harder it turns the craft"
    plain = "The rudder of your {craft} turns it more when the propeller pushes harder; in {simulation} it does not."
    parameters = (
        Quantity("share", "1", "fraction of the steering proportional to thrust squared; the rest is constant"),
    )
    grows_with = ("share",)
    shown_by = "yaw residual over command, against the thrust commanded: too weak a turn at low thrust"
    mistaken_for = ("speed-dependent-steering", "gain-drift", "mass-change", "command-coupling")
    separated_by = (
        "the same zig-zag at a third, two thirds and all of the thrust, the first half of each before the speed has "
        "changed: wash follows the thrust at once, the flow of the boat's way follows the speed"
    )

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Every input that turns the craft and nothing else, where the thrust commanded is recorded and varies."""
        low, high = data.extent.get(THRUST, (0.0, 0.0))
        if THRUST not in data.channels or high - low <= WASH * data.rms.get(THRUST, 0.0):
            return ()
        own = [n for n in super().places(data) if n != THRUST and steers(n, data) and len(data.form.inputs[n]) == 1]
        return tuple(f"{n}+{THRUST}" for n in own)

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """A little less, partly, and wholly."""
        return ({"share": -0.2}, {"share": 0.4}, {"share": 0.9})

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """A little beyond the physical 1, and as far below 0."""
        return {"share": (-1.2, 1.2)}

    def constants(self, place: str, data: DataSummary) -> Mapping[str, float]:
        """The root mean square of the thrust commanded."""
        return {"X_ref": data.rms[THRUST]}

    def drive(self, effect: EffectInstance, drive: Drive) -> Drive:
        """Scale the commands with the thrust commanded, or with what other effects have made of it."""
        name, other = columns_of(effect.place)
        both = with_other(drive, name, other)
        if both is None:
            return drive
        return redrawn(drive, name, lambda _: (both[0], both[1] * self._gain(effect, both[2])))

    def _gain(self, effect: EffectInstance, thrust: Array) -> Array:
        gain: Array = (1.0 - effect["share"]) + effect["share"] * thrust * np.abs(thrust) / effect["X_ref"] ** 2
        return gain

    def curve(self, effect: EffectInstance, data: DataSummary) -> EffectCurve:
        """Gain over thrust."""
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
    """Return the gain of every force the input drives, none when surge is not simulated or a gain is not known."""
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
    """Return stamps and smoothed speeds (n,) of the samples there are: noise would come out as speed that varies."""
    good = np.isfinite(speed.values)
    t, values = speed.t[good], speed.values[good]
    widths = [w for w in WIDTHS if 3 * w <= len(values)]
    if not widths:
        return t, values
    width, _ = best_width(t, values, widths, degree=2)
    return t, local_polynomials(t, values, t, width, degree=2).derivative(0)


GAIN, AXIS = "gain", "axis"
"""Constants: magnitude of the base model's force per input, and which force (0 to 5: X Y Z K M N)."""

RUDDER = "rad"
"""Inputs of this unit are angles, not thrusters."""

PER_SPEED = "s/m or s/rad"


class AdvanceSpeedLoss(SharedActuatorEffect):
    """The force of a thruster is lowered by ``loss |force| nu``: the bilinear thruster.

    Miskovic2010, (2.4): ``T_|n|n |n| n - T_|n|u_a |n| u_a``; ZhaoUSV, eq. (4). ``nu`` is the velocity
    through the water along the thruster's axis, which must drive one degree of freedom only. It is a term ``X_|X|u`` of
    the equations of motion and sees what acts, whatever other effects made of the command. Where the input's gain is
    fitted, the force meant is that of the base model's gain.
    """

    slug = "advance-speed-loss"
    is_structural = True
    meaning = "a propeller loses thrust with the speed of the inflow: strong from rest, weak at speed"
    plain = "The thrust of your {craft} falls as it gathers speed; in {simulation} it does not."
    parameters = (Quantity("loss", PER_SPEED, "fraction of the thrust lost per speed ahead, gained per speed astern"),)
    grows_with = ("loss",)
    shown_by = "residual against speed, under power: grows with the speed; none while drifting to a stop"
    mistaken_for = ("linear-drag", "quadratic-drag", "saturation")
    separated_by = (
        "steady speed at half and at full command, each followed by drifting to a stop with no command: the loss acts "
        "under power only and brakes more at full command, drag acts all the time"
    )

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Every thruster along one simulated axis."""
        thrusters = [n for n in data.inputs if data.inputs[n] != RUDDER and _axis(n, data) is not None]
        return tuple(place for place in super().places(data) if set(columns_of(place)) <= set(thrusters))

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """A fifth and two thirds of the thrust at the highest speed."""
        return tuple({"loss": share / _fastest(place, data)} for share in (0.2, 0.67))

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """No gain with speed; at the highest speed at most a few times what it gives from rest."""
        return {"loss": (0.0, 4.0 / _fastest(place, data))}

    def constants(self, place: str, data: DataSummary) -> Mapping[str, float]:
        """The gain of the input, and which axis it drives."""
        ((force, gain),) = data.form.inputs[columns_of(place)[0]]
        size = abs(data.base.get(gain.lstrip("-"), 1.0)) if isinstance(gain, str) else abs(gain)
        return {GAIN: size, AXIS: float(FORCES.index(force))}

    def derivatives(self, effect: EffectInstance) -> Mapping[str, float]:
        """``X_|X|u`` and so on, of each thruster."""
        i = int(effect[AXIS])
        return {f"{FORCES[i]}_|{n}|{STATES[i]}": -effect["loss"] * effect[GAIN] for n in columns_of(effect.place)}

    def curve(self, effect: EffectInstance, data: DataSummary) -> EffectCurve:
        """Force at full command over speed ahead."""
        force, velocity = FORCES[int(effect[AXIS])], STATES[int(effect[AXIS])]
        nu = np.linspace(0.0, _fastest(effect.place, data), 101)
        rest = np.full_like(nu, effect[GAIN] * largest(effect.place, data))
        unit = data.inputs[columns_of(effect.place)[0]] if effect[GAIN] == 1.0 else SIGNALS[force][0]
        x_label, y_label = f"{velocity} [{SIGNALS[velocity][0]}]", f"{force} at full {effect.place} [{unit}]"
        return EffectCurve(nu, rest * (1.0 - effect["loss"] * nu), x_label, y_label, "Thrust over speed", plain=rest)

    def unit_of(self, name: str, place: str, data: DataSummary) -> str:
        """Seconds per metre, or per radian."""
        dof = _axis(place, data)
        return "s/rad" if dof is not None and dof.angular else "s/m"


def _axis(place: str, data: DataSummary) -> Dof | None:
    """Return the only degree of freedom an input drives, None when it drives none or several."""
    pairs = data.form.inputs.get(columns_of(place)[0], ())
    driven = [DOFS[d] for d in data.form.dofs for force, _ in pairs if DOFS[d].force == force]
    return driven[0] if len(pairs) == 1 and len(driven) == 1 else None


def _fastest(place: str, data: DataSummary) -> float:
    """Return the highest speed along an input's axis: measured, or guessed from how far the position goes."""
    dof = _axis(place, data)
    if dof is None:
        return 1.0
    if dof.velocity in data.extent:
        found = max(abs(v) for v in data.extent[dof.velocity])
    else:
        spread = data.spread.get(dof.position, 1.0)
        found = spread / min(data.time_constant, data.duration)
    return max(found, 1e-9)
