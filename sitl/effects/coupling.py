"""Couplings between degrees of freedom: Fossen2011, chapters 3 and 6. They require a hull with sway."""

from __future__ import annotations

import re

from sitl.effects.effect import FORCE_OF, BadEffect, EffectParameter, HiddenEffect, Setting
from sitl.plants import Parameters, State, Wrench

__all__ = [
    "CoriolisCoupling",
    "MunkMoment",
    "SpeedDamping",
    "SwayMoment",
    "SwayYawCoupling",
    "VelocityProduct",
]

_HORIZONTAL = ("surge", "sway", "yaw")


class CoriolisCoupling(HiddenEffect):
    """Centripetal forces: ``X += X_vr v r``, ``Y += Y_ur u r``, ``N += N_uv u v``."""

    on_vehicles = "not available: these vehicles have no sway (unless a --model has)"
    slug = "coriolis-coupling"
    places = ("surge+sway+yaw",)
    meaning = "Coriolis force: turning under way pushes the craft sideways (rigid body and added mass)"
    parameters = (
        EffectParameter("X_vr", "kg", default=0.0),
        EffectParameter("Y_ur", "kg", default=0.0),
        EffectParameter("N_uv", "kg", default=0.0),
    )

    def begin(self, setting: Setting) -> None:
        """Verify that the hull has sway, and surge or yaw."""
        there = [dof for dof in _HORIZONTAL if dof in setting.dofs]
        if "sway" not in there or len(there) < 2:
            raise BadEffect("coriolis-coupling needs a hull with sway, and surge or yaw. This hull lacks one of them")
        self._state = setting.state

    def alter_force(self, t: float, wrench: Wrench) -> None:
        """Add the centripetal forces at the present velocities to *wrench*."""
        at = self._state
        wrench.X += self["X_vr"] * at.v * at.r
        wrench.Y += self["Y_ur"] * at.u * at.r
        wrench.N += self["N_uv"] * at.u * at.v


class SwayYawCoupling(HiddenEffect):
    """``Y += Y_r r``, ``N += N_v v``, and ``-Y_rdot`` on both off-diagonal elements of the mass matrix."""

    on_vehicles = "not available: these vehicles have no sway (unless a --model has)"
    slug = "sway-yaw-coupling"
    places = ("sway+yaw",)
    meaning = "sway and yaw are coupled (off-diagonal mass and damping, off-centre mass)"
    parameters = (
        EffectParameter("Y_r", "N s/rad", default=0.0),
        EffectParameter("N_v", "N s", default=0.0),
        EffectParameter("Y_rdot", "kg m", default=0.0),
    )

    def begin(self, setting: Setting) -> None:
        """Verify that the hull sways and yaws, and that its mass matrix stays positive definite."""
        if not {"sway", "yaw"} <= set(setting.dofs):
            raise BadEffect("sway-yaw-coupling needs a hull with sway and yaw. This hull lacks one of them")
        if self["Y_rdot"] ** 2 >= setting.parameters["sway.alpha"] * setting.parameters["yaw.alpha"]:
            raise BadEffect(
                f"sway-yaw-coupling.Y_rdot={self['Y_rdot']:g} would make the mass matrix not positive definite. "
                "Use a smaller value"
            )
        self._state = setting.state

    def alter_force(self, t: float, wrench: Wrench) -> None:
        """Add the forces proportional to the yaw rate and the sway velocity to *wrench*."""
        wrench.Y += self["Y_r"] * self._state.r
        wrench.N += self["N_v"] * self._state.v

    def alter_parameters(self, t: float, parameters: Parameters) -> None:
        """Add the off-diagonal inertia of sway and yaw to the parameters."""
        parameters["Y_rdot"] = self["Y_rdot"]


class MomentOfFlow(HiddenEffect):
    """A yaw moment that depends on speeds of the hull, without a reaction force."""

    needs: frozenset[str]
    places = ("yaw",)

    def begin(self, setting: Setting) -> None:
        """Verify that the hull has the degrees of freedom on which the moment depends."""
        if not self.needs <= set(setting.dofs):
            wanted = " and ".join(dof for dof in ("sway", "surge", "yaw") if dof in self.needs)
            raise BadEffect(f"{self.slug} needs a hull with {wanted}. This hull lacks one of them")
        self._state = setting.state

    def alter_force(self, t: float, wrench: Wrench) -> None:
        """Add the moment to *wrench*."""
        wrench.N += self.moment(self._state)

    def moment(self, at: State) -> float:
        """Return the yaw moment [N m] at the present velocities."""
        raise NotImplementedError


class SwayMoment(MomentOfFlow):
    """A yaw moment proportional to the sway velocity: ``N += N_v v``."""

    on_vehicles = "not available: these vehicles have no sway (unless a --model has)"
    slug = "sway-moment"
    meaning = "Munk moment: drifting sideways turns the hull"
    parameters = (EffectParameter("N_v", "N s", default=0.0),)
    needs = frozenset({"sway", "yaw"})

    def moment(self, at: State) -> float:
        """Return the yaw moment ``N_v v`` [N m]."""
        return self["N_v"] * at.v


class SpeedDamping(MomentOfFlow):
    """A yaw moment proportional to surge speed and yaw rate: ``N += N_|u|r |u| r``."""

    on_vehicles = "yaw"
    slug = "speed-damping"
    meaning = "yaw damping per unit of speed, ahead or astern (negative: turning is harder with speed)"
    parameters = (EffectParameter("N_|u|r", "kg m", default=0.0),)
    needs = frozenset({"surge", "yaw"})

    def moment(self, at: State) -> float:
        """Return the yaw moment ``N_|u|r |u| r`` [N m]."""
        return self["N_|u|r"] * abs(at.u) * at.r


class MunkMoment(MomentOfFlow):
    """The Munk moment, proportional to surge and sway velocity: ``N += N_uv u v``."""

    on_vehicles = "not available: these vehicles have no sway (unless a --model has)"
    slug = "munk-moment"
    meaning = "moment per drift angle"
    parameters = (EffectParameter("N_uv", "kg", default=0.0),)
    needs = frozenset({"surge", "sway", "yaw"})

    def moment(self, at: State) -> float:
        """Return the yaw moment ``N_uv u v`` [N m]."""
        return self["N_uv"] * at.u * at.v


_PRODUCT = re.compile(r"([XYZN])_((?:\|[uvwr]\||[uvwr]){1,3})")
_AXIS_OF = {"u": "surge", "v": "sway", "w": "heave", "r": "yaw"}


class VelocityProduct(HiddenEffect):
    """A force or moment proportional to a product of velocities. The effect's place is the SNAME derivative:
    ``N_|v|r``, ``X_vr``.

    Bars mean the absolute value. Two equal letters mean a velocity times its absolute value (``X_uu`` is ``X_|u|u``).
    """

    on_vehicles = "a derivative: N_ur (default), N_u, ..."
    slug = "velocity-product"
    meaning = "a force proportional to a product of velocities"
    parameters = (EffectParameter("coefficient", "SI per product"),)

    def begin(self, setting: Setting) -> None:
        """Parse the SNAME derivative in the place, and verify that the hull has the degrees of freedom in it."""
        name = self.place or "N_ur"
        read = _PRODUCT.fullmatch(name)
        if read is None:
            raise BadEffect(
                f"velocity-product@{name} is not a derivative by u, v, w, r. Write N_|v|r, X_vr or the like"
            )
        self._force, rest = read[1], read[2]
        self._factors = [(word.strip("|"), word.startswith("|")) for word in re.findall(r"\|\w\||\w", rest)]
        if len(self._factors) == 2 and self._factors[0] == self._factors[1] and not self._factors[0][1]:
            self._factors[0] = (self._factors[0][0], True)
        needed = {_AXIS_OF[letter] for letter, _ in self._factors}
        needed |= {dof for dof, force in FORCE_OF.items() if force == self._force}
        missing = needed - set(setting.dofs)
        if missing:
            raise BadEffect(f"velocity-product@{name} needs {', '.join(sorted(missing))}, which this hull lacks")
        self._state = setting.state

    def alter_force(self, t: float, wrench: Wrench) -> None:
        """Add the force or moment to *wrench*."""
        push = self["coefficient"]
        for letter, by_size in self._factors:
            velocity = float(getattr(self._state, letter))
            push *= abs(velocity) if by_size else velocity
        setattr(wrench, self._force, getattr(wrench, self._force) + push)
