"""Which slips of scale these runs could show at all: what a free inertia absorbs is no finding."""

from __future__ import annotations

from gcs_autotune.effects.effect import Scene
from gcs_autotune.models.coupled import Form
from gcs_autotune.sname import DOFS

__all__ = ["input_scale_shows", "rates_checked", "sign_is_free", "signal_scale_shows"]

_PLANAR = ({"x", "y"}, {"u", "v"})


def signal_scale_shows(signal: str, scene: Scene) -> bool:
    """Return whether a wrong scale of *signal* would show.

    Forces are known up to the inertia's scale, so it shows against another measured signal of the same kinematics
    only (``psi`` against ``r``, ``x`` and ``y`` against ``u`` and ``psi``), or when the inertia is known.
    """
    have = set(scene.signals)
    for dof in DOFS.values():
        pair = (dof.position, dof.velocity)
        if signal in pair:
            other = pair[1 - pair.index(signal)]
            if other in have or (dof.name in scene.form.dofs and _inertia_known(dof.name, scene.form)):
                return True
    if signal in ("u", "v"):
        return bool(have & _PLANAR[0])
    if signal in ("x", "y"):
        return bool(have & _PLANAR[1]) or have >= {"x", "y", "psi"}
    return signal == "psi" and have >= {"x", "y"}


def rates_checked(scene: Scene) -> bool:
    """Return whether some position is measured beside its velocity: what a wrong clock betrays itself by."""
    have = set(scene.signals)
    pairs = any(d.position in have and d.velocity in have for d in DOFS.values())
    return pairs or all(have & group for group in _PLANAR)


def input_scale_shows(channel: str, scene: Scene) -> bool:
    """Return whether a wrong scale of an input would show: its gain is given, and inertia or a second input is too."""
    form = scene.form
    for force in _given(channel, form):
        dof = next(d.name for d in DOFS.values() if d.force == force)
        others = [c for c in scene.inputs if c != channel and force in _given(c, form)]
        if others or _inertia_known(dof, form):
            return True
    return False


def sign_is_free(channel: str, form: Form) -> bool:
    """Return whether the model fits the sign of an input anyway: a rudder's, or any whose every gain is free."""
    return channel == "delta" or not _given(channel, form)


def _given(channel: str, form: Form) -> tuple[str, ...]:
    """Return the forces that *channel* drives with a known gain."""
    pairs = form.inputs.get(channel, ())
    return tuple(f for f, g in pairs if not (isinstance(g, str) and g.lstrip("-") in form.free))


def _inertia_known(dof: str, form: Form) -> bool:
    d = DOFS[dof]
    body = {"yaw": "I_z", "roll": "I_x", "pitch": "I_y"}.get(dof, "m")
    names = {body, f"{d.force}_{d.velocity}dot"}
    return not names & set(form.free) and bool(names & set(form.known))
