"""Read a model file from outside and prepare it for flight: hull dynamics as SNAME derivatives, with effects.

The file's inputs are in its own units. Full output of an axis is the largest command stated in the file (``swing``), or
1. Inertia is ``-N_rdot`` (and rigid body), drag is ``-N_r`` and ``-N_rr``, and ``N_0`` is a constant force.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from gcs_autotune_files import Refused, read
from gcs_autotune_files.model import (
    CoupledData,
    EffectData,
    ExtendedData,
    FormData,
    ModelData,
    SingleDofData,
    model_data,
)
from sitl.effects import EFFECTS, BadEffect, HiddenEffect, make_effect
from sitl.plants import Coupling, coupling_of

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
    """Raised for a file that does not contain a model, or whose model cannot be flown; the message states why."""


@dataclass(frozen=True, slots=True)
class FlownModel:
    """A model prepared for flight.

    ``axes``: degree of freedom -> inertia, linear and quadratic drag.
    ``forces``: force letter -> constant force [N, N m].
    ``gains``: channel -> force letter -> force at full output.
    ``coupling``: None if the model does not sway.
    """

    axes: Mapping[str, tuple[float, float, float]]
    forces: Mapping[str, float]
    gains: Mapping[str, Mapping[str, float]]
    effects: tuple[HiddenEffect, ...] = ()
    coupling: Coupling | None = None
    amplitude: Mapping[str, float] = field(default_factory=dict)


def read_model(path: Path) -> FlownModel:
    """Return the model in the file *path* (``single-dof``, plain ``coupled``, or ``extended`` with effects).

    If *path* is a run directory, its ``model.json`` is read.

    Raises
    ------
    BadModel
        The file cannot be read, or its model cannot be flown.
    """
    try:
        return _model_from(model_data(read(path / "model.json" if path.is_dir() else path)))
    except Refused as error:
        raise BadModel(f"{path} is not a model file: {error}") from error
    except (BadModel, BadEffect) as error:
        raise BadModel(f"{path}: {error}") from error


def _model_from(data: ModelData) -> FlownModel:
    if isinstance(data, SingleDofData):
        data = _of_one_axis(data)
    if isinstance(data, CoupledData):
        data = ExtendedData(data)
    form, values = data.base.form, data.base.values
    strange = [dof for dof in form.dofs if dof not in _FORCES]
    if strange:
        raise BadModel(f"the simulator does not model {', '.join(strange)}")
    lacking = [name for name in (*form.free, *form.known) if name not in values]
    if lacking:
        raise BadModel(f"values lack {', '.join(lacking[:5])}")
    amplitude = {channel: _largest_command(data, channel) for channel in form.inputs}
    gains = {
        channel: {force: amplitude[channel] * _gain(gain, values) for force, gain in pairs.items()}
        for channel, pairs in form.inputs.items()
    }
    used = {str(g).lstrip("-") for pairs in form.inputs.values() for g in pairs.values()}
    dofs: tuple[str, ...] = tuple(form.dofs)
    axes = {dof: _axis(dof, values) for dof in dofs}
    unused = {n: v for n, v in values.items() if v and n not in used and n not in _SPECIAL and not _is_plain(n, dofs)}
    coupling = _coupling(unused, values, form.coriolis) if "sway" in dofs else None
    if coupling is None and unused:
        raise BadModel(f"the simulator cannot simulate {', '.join(unused)} without sway")
    effects = [*_built_in(values, amplitude), *(_effect_from(e, amplitude) for e in data.effects)]
    forces = {_FORCES[dof]: values.get(f"{_FORCES[dof]}_0", 0.0) for dof in dofs}
    return FlownModel(axes, forces, gains, tuple(effects), coupling, amplitude)


def _of_one_axis(data: SingleDofData) -> ExtendedData:
    """Return ``alpha nu_dot + (beta + beta_quadratic |nu|) nu = tau + delta`` as derivatives, with its delay as an
    effect."""
    if data.dof not in _FORCES:
        raise BadModel(f"the simulator does not model {data.dof}")
    force, speed = _FORCES[data.dof], _SPEEDS[data.dof]
    channel = "delta" if data.input_unit == "rad" else force
    names = (f"{force}_{speed}dot", f"{force}_{speed}", f"{force}_{speed}{speed}")
    numbers = (data.alpha, data.beta, data.beta_quadratic)
    values = {n: -v for n, v in zip(names, numbers, strict=True)} | {f"{force}_0": data.delta}
    form = FormData("one axis", [data.dof], list(values), inputs={channel: {force: 1.0}}, coriolis=False)
    late = [EffectData("input-delay", {"delay": data.delay}, channel)] if data.delay > 0.0 else []
    return ExtendedData(CoupledData(form, values), late)


def _largest_command(data: ExtendedData, channel: str) -> float:
    """Return the largest command of *channel* stated in the file, or 1."""
    known = [data.constants.swing.get(channel, 0.0), *(e.constants.get("swing", 0.0) for e in data.effects)]
    return abs(next((amplitude for amplitude in known if amplitude), 1.0))


def _gain(gain: float | str, values: Mapping[str, float]) -> float:
    if not isinstance(gain, str):
        return float(gain)
    name = gain.removeprefix("-")
    if name not in values:
        raise BadModel(f"values lack {name}, the gain of an input")
    return -values[name] if gain.startswith("-") else values[name]


def _axis(dof: str, values: Mapping[str, float]) -> tuple[float, float, float]:
    force, speed = _FORCES[dof], _SPEEDS[dof]
    get = values.get
    inertia = get(_RIGID[dof], 0.0) - get(f"{force}_{speed}dot", 0.0)
    if not inertia > 0.0:
        raise BadModel(f"its inertia in {dof} is {inertia:g}, but it must be above 0")
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


def _built_in(values: Mapping[str, float], amplitude: Mapping[str, float]) -> list[HiddenEffect]:
    """Return the delays, lags, current, sensor and compass data of the base model as effects."""
    effects = []
    for channel in (name for name in amplitude if name != "Y"):
        if values.get("delay", 0.0) > 0.0:
            effects.append(make_effect("input-delay", channel, {"delay": values["delay"]}))
        if values.get("lag", 0.0) > 0.0:
            effects.append(make_effect("actuator-lag", channel, {"time_constant": values["lag"]}))
    current = {name: values[name] for name in ("V_x", "V_y") if values.get(name)}
    if current:
        effects.append(make_effect("steady-current", "", current))
    arm = {name: values[name] for name in ("x_P", "y_P") if values.get(name)}
    if arm:
        effects.append(make_effect("sensor-position", "", arm))
    card = {name: values[f"{name}_psi"] for name in "ABC" if values.get(f"{name}_psi")}
    if card:
        effects.append(make_effect("compass-deviation", "psi", card))
    return effects


def _effect_from(entry: EffectData, amplitude: Mapping[str, float]) -> HiddenEffect:
    """Return one effect of the file, with numbers in units of the input converted to fractions of full output."""
    values = dict(entry.values)
    if entry.slug in EFFECTS:
        known = {p.name: p.unit for p in EFFECTS[entry.slug].parameters}
        values.update({name: value for name, value in entry.constants.items() if name in known})
        unit = _unit_of(entry.place, amplitude)
        values = {n: v / unit if "input unit" in known.get(n, "") else v for n, v in values.items()}
    return make_effect(entry.slug, entry.place, values)


def _unit_of(place: str, amplitude: Mapping[str, float]) -> float:
    """Return full output of the input at *place*, a channel or the degree of freedom that it drives."""
    if place in amplitude:
        return amplitude[place]
    for channel, full in amplitude.items():
        if {"delta": "N"}.get(channel, channel) == _FORCES.get(place):
            return full
    return next(iter(amplitude.values()), 1.0)
