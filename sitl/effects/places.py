"""Functions that find the input, degree of freedom or signals selected by an effect's place."""

from __future__ import annotations

from sitl.effects.effect import BadEffect, HiddenEffect, Setting

__all__ = ["find_dof", "find_input", "find_signals"]

_HORIZONTAL = ("surge", "sway", "yaw")


def find_input(effect: HiddenEffect, setting: Setting) -> str:
    """Return the input (channel) that the place of *effect* selects; by default the steering."""
    place = effect.place or setting.steering
    place = setting.axis_names.get(place, place)
    if place not in setting.inputs:
        known = ", ".join([*setting.inputs, *setting.axis_names]) or "none"
        raise BadEffect(f"{effect.slug}: this craft has no input '{effect.place}'. Its inputs are {known}")
    return place


def find_dof(effect: HiddenEffect, setting: Setting, *, among: tuple[str, ...] = (*_HORIZONTAL, "heave")) -> str:
    """Return the degree of freedom that the place of *effect* selects; by default yaw, or else the first."""
    there = [dof for dof in ("yaw", "surge", "sway", "heave") if dof in setting.dofs and dof in among]
    if not there:
        raise BadEffect(f"{effect.slug} acts on {' or '.join(among)}, which this craft does not have")
    place = effect.place or there[0]
    if place not in there:
        raise BadEffect(f"{effect.slug} cannot act on '{place}' here. Use {' or '.join(there)}")
    return place


def find_signals(effect: HiddenEffect, setting: Setting, default: str) -> tuple[str, ...]:
    """Return the signals that the place of *effect* selects. In the place, several are joined by ``+``."""
    names = tuple((effect.place or default).split("+"))
    for name in names:
        if name not in setting.signals:
            raise BadEffect(f"{effect.slug}: '{name}' is not measured here. Measured: {', '.join(setting.signals)}")
    return names
