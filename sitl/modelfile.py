"""A model file read from outside: hull dynamics as SNAME derivatives, and effects on top, made ready to fly.

The file's inputs are in its own units; full output of an axis is the largest command the file knows of (``swing``), or
1. Inertia is ``-N_rdot`` (and rigid body), drag ``-N_r`` and ``-N_rr``; ``N_0`` a constant force.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sitl.effects import EFFECTS, BadEffect, HiddenEffect, make_effect
from sitl.hull import Coupling, coupling_of

__all__ = ["BadModel", "FlownModel", "read_model"]

_FORCES = {"surge": "X", "sway": "Y", "heave": "Z", "yaw": "N"}
_SPEEDS = {"surge": "u", "sway": "v", "heave": "w", "yaw": "r"}
_RIGID = {"surge": "m", "sway": "m", "heave": "m", "yaw": "I_z"}
_SPECIAL = {
    "delay",
    "lag",
    "V_x",
    "V_y",
    "A_psi",
    "B_psi",
    "C_psi",
    "x_P",
    "y_P",
    "m",
    "I_x",
    "I_y",
    "I_z",
    "I_xz",
    "reach",
}


class BadModel(ValueError):
    """The file is no model, or one that cannot be flown; the message says why."""


@dataclass(frozen=True, slots=True)
class FlownModel:
    """``axes``: degree of freedom -> inertia, linear and quadratic drag; ``forces``: constant force by letter;

    ``gains``: channel -> force letter -> force at full output; ``coupling``: None when it does not sway.
    """

    axes: Mapping[str, tuple[float, float, float]]
    forces: Mapping[str, float]
    gains: Mapping[str, Mapping[str, float]]
    effects: tuple[HiddenEffect, ...] = ()
    coupling: Coupling | None = None
    swing: Mapping[str, float] = field(default_factory=dict)


def read_model(path: Path) -> FlownModel:
    """Read a model file (``single-dof``, plain ``coupled``, or ``extended`` with effects).

    Raises
    ------
    BadModel
        It cannot be read or flown.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise BadModel(f"{path}: not a model file ({error})") from error
    try:
        return _model_from(data)
    except (KeyError, TypeError, AttributeError, IndexError) as error:
        raise BadModel(f"{path}: not a model file as 'gcs-autotune diagnose' writes it ({error!r})") from error
    except (BadModel, BadEffect) as error:
        raise BadModel(f"{path}: {error}") from error


def _model_from(data: Mapping[str, Any]) -> FlownModel:
    if data.get("model") == "single-dof":
        data = _of_one_axis(data)
    if data.get("model") not in ("extended", "coupled"):
        raise BadModel(
            f"a model of kind '{data.get('model')}' cannot be flown; 'single-dof', 'coupled' and 'extended' ones can"
        )
    base = data["base"] if data["model"] == "extended" else data
    form = base["form"]
    values = {str(name): float(value) for name, value in base["values"].items()}
    dofs = tuple(form["dofs"])
    strange = [dof for dof in dofs if dof not in _FORCES]
    if strange:
        raise BadModel(f"the simulator does not model {', '.join(strange)}")
    swing = {channel: _swing(data, channel) for channel in form["inputs"]}
    gains = {
        channel: {force: swing[channel] * _gain(gain, values) for force, gain in pairs.items()}
        for channel, pairs in form["inputs"].items()
    }
    used = {str(g).lstrip("-") for pairs in form["inputs"].values() for g in pairs.values()}
    axes = {dof: _axis(dof, values) for dof in dofs}
    left = {n: v for n, v in values.items() if v and n not in used and n not in _SPECIAL and not _is_plain(n, dofs)}
    coupling = _coupling(left, values, bool(form.get("coriolis", True))) if "sway" in dofs else None
    if coupling is None and left:
        raise BadModel(f"the simulator cannot fly {', '.join(left)} without sway")
    effects = [*_built_in(values, swing), *(_effect_from(e, swing) for e in data.get("effects", ()))]
    forces = {_FORCES[dof]: values.get(f"{_FORCES[dof]}_0", 0.0) for dof in dofs}
    return FlownModel(axes, forces, gains, tuple(effects), coupling, swing)


def _of_one_axis(data: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return ``alpha nu_dot + (beta + beta_quadratic |nu|) nu = tau + delta`` as derivatives, its delay an effect."""
    dof = str(data["dof"])
    if dof not in _FORCES:
        raise BadModel(f"the simulator does not model {dof}")
    force, speed = _FORCES[dof], _SPEEDS[dof]
    channel = "delta" if data.get("input_unit") == "rad" else force
    names = (f"{force}_{speed}dot", f"{force}_{speed}", f"{force}_{speed}{speed}")
    numbers = (data["alpha"], data["beta"], data["beta_quadratic"])
    values = {n: -float(v) for n, v in zip(names, numbers, strict=True)} | {f"{force}_0": float(data["delta"])}
    base = {"form": {"dofs": [dof], "inputs": {channel: {force: 1.0}}, "coriolis": False}, "values": values}
    delay = float(data.get("delay", 0.0))
    late = [{"slug": "input-delay", "place": channel, "values": {"delay": delay}}] if delay > 0.0 else []
    return {"model": "extended", "base": base, "effects": late}


def _swing(data: Mapping[str, Any], channel: str) -> float:
    """Return the largest command of *channel* the file knows of, or 1."""
    known = [data, data.get("constants", {}), *(e.get("constants", {}) for e in data.get("effects", ()))]
    for place in known:
        swing = place.get("swing")
        if isinstance(swing, Mapping):
            swing = swing.get(channel)
        if swing:
            return abs(float(swing))
    return 1.0


def _gain(gain: float | str, values: Mapping[str, float]) -> float:
    if not isinstance(gain, str):
        return float(gain)
    return -values[gain[1:]] if gain.startswith("-") else values[gain]


def _axis(dof: str, values: Mapping[str, float]) -> tuple[float, float, float]:
    force, speed = _FORCES[dof], _SPEEDS[dof]
    get = values.get
    inertia = get(_RIGID[dof], 0.0) - get(f"{force}_{speed}dot", 0.0)
    if not inertia > 0.0:
        raise BadModel(f"its inertia in {dof} is {inertia:g}; it must be above 0")
    quadratic = get(f"{force}_{speed}{speed}", 0.0) + get(f"{force}_|{speed}|{speed}", 0.0)
    return inertia, -get(f"{force}_{speed}", 0.0), -quadratic


def _is_plain(name: str, dofs: tuple[str, ...]) -> bool:
    return any(
        name in (f"{f}_0", f"{f}_{s}", f"{f}_{s}{s}", f"{f}_{s}dot", f"{f}_|{s}|{s}")
        for f, s in ((_FORCES[dof], _SPEEDS[dof]) for dof in dofs)
    )


def _coupling(left: dict[str, float], values: Mapping[str, float], coriolis: bool) -> Coupling:
    shared = values.get("m", 0.0) * left.pop("x_G", 0.0)
    try:
        return coupling_of(left, coriolis=coriolis, shared=shared)
    except ValueError as error:
        raise BadModel(str(error)) from error


def _built_in(values: Mapping[str, float], swing: Mapping[str, float]) -> list[HiddenEffect]:
    """Return what the base model itself says of delays, lags, current, sensor and compass, as effects."""
    found = []
    for channel in (name for name in swing if name != "Y"):
        if values.get("delay", 0.0) > 0.0:
            found.append(make_effect("input-delay", channel, {"delay": values["delay"]}))
        if values.get("lag", 0.0) > 0.0:
            found.append(make_effect("actuator-lag", channel, {"time_constant": values["lag"]}))
    current = {name: values[name] for name in ("V_x", "V_y") if values.get(name)}
    if current:
        found.append(make_effect("steady-current", "", current))
    arm = {name: values[name] for name in ("x_P", "y_P") if values.get(name)}
    if arm:
        found.append(make_effect("sensor-position", "", arm))
    card = {name: values[f"{name}_psi"] for name in "ABC" if values.get(f"{name}_psi")}
    if card:
        found.append(make_effect("compass-deviation", "psi", card))
    return found


def _effect_from(entry: Mapping[str, Any], swing: Mapping[str, float]) -> HiddenEffect:
    """Return one effect of the file, numbers in units of the input made shares of full."""
    slug, place = str(entry["slug"]), str(entry.get("place", ""))
    values = {str(name): float(value) for name, value in entry["values"].items()}
    if slug in EFFECTS:
        known = {p.name: p.unit for p in EFFECTS[slug].parameters}
        constants = entry.get("constants", {})
        values.update({str(name): float(value) for name, value in constants.items() if name in known})
        unit = _unit_of(place, swing)
        values = {n: v / unit if "input unit" in known.get(n, "") else v for n, v in values.items()}
    return make_effect(slug, place, values)


def _unit_of(place: str, swing: Mapping[str, float]) -> float:
    """Return full output of the input at *place*, a channel or the degree of freedom it drives."""
    if place in swing:
        return swing[place]
    for channel, full in swing.items():
        if {"delta": "N"}.get(channel, channel) == _FORCES.get(place):
            return full
    return next(iter(swing.values()), 1.0)
