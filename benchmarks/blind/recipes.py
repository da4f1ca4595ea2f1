"""Random places and parameters of each effect of the catalogue, over the range that real craft have."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from benchmarks.blind.craft import FORCE, POSITION, SPEED, Craft, log_uniform
from benchmarks.blind.hidden import Hidden, Recipe

__all__ = ["ENVIRONMENT", "NOT_DRAWN", "RECIPES"]

Rng = np.random.Generator

_ACTUATED = ("yaw", "yaw", "surge", "heave", "boat")
_PLANAR = ("boat", "raft")
_UNIT_FACTORS = (180.0 / np.pi, np.pi / 180.0)
_SPEED_UNIT_FACTORS = (1.0 / 0.514444, 0.514444, 3.6, 1.0 / 3.6, 3.28084, 0.3048, 100.0, 0.01, 1000.0, 0.001)


def _sign(rng: Rng) -> float:
    return 1.0 if rng.random() < 0.5 else -1.0


def _late(rng: Rng, craft: Craft) -> float:
    """Return a delay of one sample to one time constant."""
    return log_uniform(rng, craft.interval, max(craft.pace, 4.0 * craft.interval))


# -- records


def _time_scale(rng: Rng, craft: Craft) -> Hidden:
    return Hidden("time-scale", "t", {"factor": float(np.exp(_sign(rng) * log_uniform(rng, 0.01, 0.4)))}, craft)


def _time_offset(rng: Rng, craft: Craft) -> Hidden:
    return Hidden("time-offset", "t", {"offset": _sign(rng) * _late(rng, craft)}, craft)


def _unit_error(rng: Rng, craft: Craft) -> Hidden:
    place = str(rng.choice([s for s in craft.signals if s != "v" or craft.kind != "boat"]))  # a boat does not sway
    factors = _UNIT_FACTORS if place in ("r", "psi") else _SPEED_UNIT_FACTORS
    return Hidden("unit-error", place, {"factor": float(rng.choice(factors))}, craft)


def _sign_error(rng: Rng, craft: Craft) -> Hidden:
    forces = [channel for channel in craft.drives if channel != "delta"]
    place = str(rng.choice([*craft.signals, *forces]))
    once = (int(rng.integers(0, 2)),) if place in forces and rng.random() < 0.5 else None
    return Hidden("sign-error", place, {}, craft, in_runs=once)


def _channel_swap(rng: Rng, craft: Craft) -> Hidden:
    pairs = ["u+v", "x+y", "X+N"] if craft.kind == "boat" else ["u+v", "x+y", "X+N", "X+Y", "Y+N"]
    return Hidden("channel-swap", str(rng.choice(pairs)), {}, craft)


# -- actuator


def _on_input(rng: Rng, craft: Craft) -> tuple[str, float]:
    return craft.input, craft.full[craft.input]


def _input_delay(rng: Rng, craft: Craft) -> Hidden:
    return Hidden("input-delay", craft.input, {"delay": _late(rng, craft)}, craft)


def _saturation(rng: Rng, craft: Craft) -> Hidden:
    place, full = _on_input(rng, craft)
    return Hidden("saturation", place, {"limit": full * rng.uniform(0.25, 0.85)}, craft)


def _rate_limit(rng: Rng, craft: Craft) -> Hidden:
    place, full = _on_input(rng, craft)
    return Hidden("rate-limit", place, {"rate": full / (craft.pace * log_uniform(rng, 0.2, 3.0))}, craft)


def _actuator_lag(rng: Rng, craft: Craft) -> Hidden:
    lag = max(craft.pace * log_uniform(rng, 0.05, 1.2), 0.5 * craft.interval)
    return Hidden("actuator-lag", craft.input, {"time_constant": lag}, craft)


def _backlash(rng: Rng, craft: Craft) -> Hidden:
    place, full = _on_input(rng, craft)
    return Hidden("backlash", place, {"width": full * log_uniform(rng, 0.05, 0.7)}, craft)


def _dead_zone(rng: Rng, craft: Craft) -> Hidden:
    place, full = _on_input(rng, craft)
    return Hidden("dead-zone", place, {"width": full * log_uniform(rng, 0.03, 0.4)}, craft)


def _quadratic_actuator(rng: Rng, craft: Craft) -> Hidden:
    return Hidden("quadratic-actuator", craft.input, {"share": rng.uniform(0.15, 1.0)}, craft)


def _rudder_stall(rng: Rng, craft: Craft) -> Hidden:
    place, full = _on_input(rng, craft)
    values = {"angle": full * rng.uniform(0.3, 0.75), "drop": log_uniform(rng, 0.25, 2.5)}
    return Hidden("rudder-stall", place, values, craft)


def _asymmetric_thrust(rng: Rng, craft: Craft) -> Hidden:
    ratio = float(np.exp(_sign(rng) * log_uniform(rng, 0.05, 1.0)))
    return Hidden("asymmetric-thrust", craft.input, {"ratio": ratio}, craft)


def _gain_drift(rng: Rng, craft: Craft) -> Hidden:
    return Hidden("gain-drift", craft.input, {"rate": log_uniform(rng, 0.08, 0.8) / craft.duration}, craft)


def _speed_steering(rng: Rng, craft: Craft) -> Hidden:
    values = {"share": rng.uniform(0.2, 1.0), "U_ref": 0.6 * craft.top["surge"]}
    return Hidden("speed-dependent-steering", "N", values, craft)


def _advance_loss(rng: Rng, craft: Craft) -> Hidden:
    loss = log_uniform(rng, 0.1, 0.9) / craft.top[craft.main]
    return Hidden("advance-speed-loss", craft.input, {"loss": loss}, craft)


# -- hydrodynamics


def _linear_drag(rng: Rng, craft: Craft) -> Hidden:
    """Return the whole drag; the base model has none."""
    return Hidden("linear-drag", craft.main, {"coefficient": craft.linear[craft.main]}, craft, plain="none")


def _quadratic_drag(rng: Rng, craft: Craft) -> Hidden:
    dof = craft.main
    coefficient = craft.linear[dof] / craft.top[dof] * log_uniform(rng, 0.1, 5.0)
    return Hidden("quadratic-drag", dof, {"coefficient": coefficient}, craft)


def _coriolis(rng: Rng, craft: Craft) -> Hidden:
    """Return the terms of rigid body and added mass, all scaled by the same random factor."""
    share = log_uniform(rng, 0.1, 1.2)
    m_u, m_v = craft.inertia["surge"], craft.inertia["sway"]
    values = {"X_vr": share * m_v, "Y_ur": -share * m_u, "N_uv": -share * (m_v - m_u)}
    return Hidden("coriolis-coupling", "surge+sway+yaw", values, craft)


def _sway_yaw(rng: Rng, craft: Craft) -> Hidden:
    mass = np.sqrt(craft.inertia["sway"] * craft.inertia["yaw"])
    drag = np.sqrt(craft.linear["sway"] * craft.linear["yaw"])
    values = {
        "Y_r": _sign(rng) * drag * log_uniform(rng, 0.05, 0.5),
        "N_v": _sign(rng) * drag * log_uniform(rng, 0.05, 0.5),
        "Y_rdot": _sign(rng) * mass * rng.uniform(0.0, 0.5),
    }
    return Hidden("sway-yaw-coupling", "sway+yaw", values, craft)


def _mass_change(rng: Rng, craft: Craft) -> Hidden:
    ratio = float(np.exp(_sign(rng) * log_uniform(rng, 0.1, 0.8)))
    values = {"ratio": ratio, "time": craft.duration * rng.uniform(0.25, 0.7)}
    return Hidden("mass-change", craft.main if len(craft.dofs) == 1 else "all", values, craft)


def _net_buoyancy(rng: Rng, craft: Craft) -> Hidden:
    return Hidden("net-buoyancy", "heave", {"force": _sign(rng) * craft.full["Z"] * log_uniform(rng, 0.02, 0.4)}, craft)


def _ground_effect(rng: Rng, craft: Craft) -> Hidden:
    length = craft.top["heave"] * craft.pace * rng.uniform(0.3, 1.5)
    values = {"strength": log_uniform(rng, 0.3, 4.0), "length": max(length, 2e-3)}
    return Hidden("ground-effect", "heave", values, craft, near_bottom=True)


# -- environment


def _input_bias(rng: Rng, craft: Craft) -> Hidden:
    full = craft.full[craft.input]
    return Hidden("input-bias", craft.main, {"bias": _sign(rng) * full * log_uniform(rng, 0.02, 0.4)}, craft)


def _steady_current(rng: Rng, craft: Craft) -> Hidden:
    speed, towards = craft.top["surge"] * log_uniform(rng, 0.02, 0.6), rng.uniform(-np.pi, np.pi)
    values = {"V_x": float(speed * np.cos(towards)), "V_y": float(speed * np.sin(towards))}
    place = "over ground" if rng.random() < 0.6 else "through water"
    return Hidden("steady-current", place, values, craft, turns=rng.random() < 0.5)


def _changing_current(rng: Rng, craft: Craft) -> Hidden:
    """Return a current that turns (gyre) or grows (tide) within the run; for a diver, one with shear too."""
    speed, towards = craft.top["surge"] * log_uniform(rng, 0.1, 0.8), rng.uniform(-np.pi, np.pi)
    turns = rng.random() < 0.5
    values = {
        "V_x": float(speed * np.cos(towards)),
        "V_y": float(speed * np.sin(towards)),
        "growth": 0.0 if turns else _sign(rng) * log_uniform(rng, 0.3, 2.0) / craft.duration,
        "turn": _sign(rng) * log_uniform(rng, 0.5, 4.0) / craft.duration if turns else 0.0,
    }
    place = "over ground" if rng.random() < 0.6 else "through water"
    if craft.kind == "diver":  # its model does not sway, so its track is not compared
        values["shear"] = rng.uniform(0.2, 1.0) / (4.0 * craft.top["heave"] * craft.time_constant("heave"))
        place = "over ground"
    return Hidden("changing-current", place, values, craft, turns=rng.random() < 0.5)


def _wind_moment(rng: Rng, craft: Craft) -> Hidden:
    values = {
        "strength": craft.full[craft.input] * log_uniform(rng, 0.03, 0.4),
        "direction": rng.uniform(-np.pi, np.pi),
    }
    return Hidden("wind-moment", "yaw", values, craft, turns=True)


def _wind_load(rng: Rng, craft: Craft) -> Hidden:
    """Return a wind of 5 to 15 m/s with gusts of up to the whole NORSOK spectrum."""
    full = {dof: craft.linear[dof] * craft.top[dof] for dof in craft.dofs}
    values = {
        "speed": rng.uniform(5.0, 15.0),
        "direction": rng.uniform(-np.pi, np.pi),
        "X": full["surge"] * log_uniform(rng, 0.05, 0.4),
        **({"Y": full["sway"] * log_uniform(rng, 0.05, 0.4)} if "sway" in full else {}),
        "N": _sign(rng) * full["yaw"] * log_uniform(rng, 0.03, 0.3),
        "gust": log_uniform(rng, 0.05, 1.0),
    }
    return Hidden(
        "wind-load", "+".join(d for d in ("surge", "sway", "yaw") if d in craft.dofs), values, craft, turns=True
    )


def _wave(rng: Rng, craft: Craft) -> Hidden:
    highest = min(8.0 / craft.pace, 0.8 / craft.interval)
    bandwidth = 0.0 if rng.random() < 0.2 else log_uniform(rng, 0.02, 0.2)
    values = {
        "amplitude": craft.full[craft.input] * log_uniform(rng, 0.03, 0.5),
        "frequency": log_uniform(rng, min(1.0 / craft.pace, 0.5 * highest), highest),
        "bandwidth": bandwidth,
    }
    return Hidden("wave-disturbance", craft.main, values, craft)


def _sea(rng: Rng, craft: Craft) -> Hidden:
    """Return waves with the JONSWAP spectrum; for surge also their drift force."""
    shaped = _wave(rng, craft)
    full = craft.full[craft.input]
    values = {
        "amplitude": shaped.values["amplitude"],
        "frequency": shaped.values["frequency"],
        "gamma": rng.uniform(1.0, 5.0),
        "direction": float(rng.choice((0.0, np.pi))) if craft.main == "surge" else rng.uniform(-np.pi, np.pi),
        "drift": full * log_uniform(rng, 0.01, 0.1) if craft.main == "surge" else 0.0,
    }
    return Hidden("wave-disturbance", craft.main, values, craft)


def _tether(rng: Rng, craft: Craft) -> Hidden:
    if craft.kind in _PLANAR:
        reach = craft.top["surge"] * craft.time_constant("surge") * 4.0
        x, y = (float(rng.normal(0.0, 0.5 * reach)) for _ in range(2))
        values = {"stiffness": craft.full["X"] / reach * log_uniform(rng, 0.03, 0.5), "x": x, "y": y}
        return Hidden("tether-pull", "surge+sway", values, craft, start={"x": (x, 0.3 * reach), "y": (y, 0.3 * reach)})
    dof = craft.main
    reach = craft.top[dof] * craft.pace * 3.0
    name, anchor = POSITION[dof], float(rng.normal(0.0, reach))
    values = {"stiffness": craft.full[craft.input] / reach * log_uniform(rng, 0.03, 0.5), "anchor": anchor}
    return Hidden("tether-pull", dof, values, craft, start={name: (anchor, 0.3 * reach)})


def _tether_line(rng: Rng, craft: Craft) -> Hidden:
    """Return a line that becomes taut within the space that the craft moves in."""
    place = "surge+sway" if craft.kind in _PLANAR else "heave"
    dof, names = place.partition("+")[0], ("x", "y") if craft.kind in _PLANAR else ("z",)
    full, top = craft.full[FORCE[dof]], craft.top[dof]
    reach = top * craft.time_constant(dof) * 3.0
    values = {
        "stiffness": full / reach * log_uniform(rng, 0.3, 5.0),
        "length": reach * rng.uniform(0.2, 0.8),
        **({"drag": full / top**2 * log_uniform(rng, 0.02, 0.3)} if len(names) > 1 else {}),
        **{name: float(rng.normal(0.0, reach)) for name in names},
    }
    start = {name: (values[name], 0.2 * reach) for name in names}
    return Hidden("tether-line", place, values, craft, start=start)


def _shallow_water(rng: Rng, craft: Craft) -> Hidden:
    """Return a sloping bottom: the clearance under the keel changes by 30 to 90 % along the track."""
    reach, towards = 0.2 * craft.top["surge"] * craft.duration, rng.uniform(-np.pi, np.pi)
    draught, zeta = 0.5, log_uniform(rng, 0.3, 3.0)
    clear = draught / zeta
    slope = clear / reach * rng.uniform(0.3, 0.9)
    values = {
        "draught": draught,
        "depth": draught + clear,
        "north": float(slope * np.cos(towards)),
        "east": float(slope * np.sin(towards)),
        "drag": craft.full["X"] / craft.top["surge"] ** 2 * log_uniform(rng, 0.1, 1.0) / zeta,
        "sway": log_uniform(rng, 0.1, 1.0) / zeta,
        "yaw": log_uniform(rng, 0.05, 0.5) / zeta,
    }
    return Hidden("shallow-water", "surge+sway+yaw", values, craft)


def _bank(rng: Rng, craft: Craft) -> Hidden:
    """Return a wall that the runs come close to."""
    clear = craft.top["surge"] * craft.time_constant("surge") * log_uniform(rng, 0.1, 1.0)
    per = clear / craft.top["surge"] ** 2
    values = {
        "direction": rng.uniform(-np.pi, np.pi),
        "distance": clear,
        "Y": craft.linear["sway"] * craft.top["sway"] * per * log_uniform(rng, 0.1, 1.0),
        "N": craft.full["N"] * per * log_uniform(rng, 0.1, 1.0),
    }
    return Hidden("bank-suction", "sway+yaw", values, craft, near_wall=True)


# -- sensors


def _compass(rng: Rng, craft: Craft) -> Hidden:
    size, where = log_uniform(rng, 0.01, 0.4), rng.uniform(-np.pi, np.pi)
    values = {"B": float(size * np.cos(where)), "C": float(size * np.sin(where))}
    return Hidden("compass-deviation", "psi", values, craft, turns=True)


def _sensor_position(rng: Rng, craft: Craft) -> Hidden:
    """Return an offset of the speed sensor, the position sensor or both; 40 % of the craft measure no speed."""
    if rng.random() < 0.4:
        craft = craft.on_track
    place = "x+y" if "u" not in craft.signals else str(rng.choice(("u+v", "x+y", "u+v+x+y")))
    size = log_uniform(rng, 0.03, 0.6) * craft.top["surge"] / craft.top["yaw"]
    towards = rng.uniform(-np.pi, np.pi)
    values = {"x_P": float(size * np.cos(towards)), "y_P": float(size * np.sin(towards))}
    return Hidden("sensor-position", place, values, craft)


def _gyro_bias(rng: Rng, craft: Craft) -> Hidden:
    return Hidden("gyro-bias", "r", {"bias": _sign(rng) * craft.top["yaw"] * log_uniform(rng, 0.01, 0.3)}, craft)


def _measurement_delay(rng: Rng, craft: Craft) -> Hidden:
    """Return a delay of one signal of two; in 15 % of cases of all, which resembles a delay of the input."""
    own = (SPEED[craft.main], POSITION[craft.main])
    place = "all" if rng.random() < 0.15 else str(rng.choice(own))
    return Hidden("measurement-delay", place, {"delay": _late(rng, craft)}, craft)


def _quantisation(rng: Rng, craft: Craft) -> Hidden:
    place = str(rng.choice((SPEED[craft.main], POSITION[craft.main])))
    return Hidden("quantisation", place, {"step": craft.scale[place] * log_uniform(rng, 0.02, 0.5)}, craft)


def _outliers(rng: Rng, craft: Craft) -> Hidden:
    place = str(rng.choice((SPEED[craft.main], POSITION[craft.main])))
    values = {"share": log_uniform(rng, 0.01, 0.1), "size": craft.scale[place] * log_uniform(rng, 0.1, 2.0)}
    return Hidden("outliers", place, values, craft)


RECIPES: Mapping[str, Recipe] = {
    "time-scale": Recipe(("yaw", "surge", "heave", "boat"), _time_scale),
    "time-offset": Recipe(("yaw", "surge", "heave"), _time_offset),
    "unit-error": Recipe(("yaw", "surge", "heave", "boat"), _unit_error, coarse=True),
    "sign-error": Recipe(("yaw", "surge", "heave", "boat"), _sign_error, coarse=True),
    "channel-swap": Recipe(_PLANAR, _channel_swap, coarse=True),
    "input-delay": Recipe(_ACTUATED, _input_delay),
    "saturation": Recipe(_ACTUATED, _saturation),
    "rate-limit": Recipe(_ACTUATED, _rate_limit),
    "actuator-lag": Recipe(_ACTUATED, _actuator_lag),
    "backlash": Recipe(_ACTUATED, _backlash),
    "dead-zone": Recipe(_ACTUATED, _dead_zone),
    "quadratic-actuator": Recipe(_ACTUATED, _quadratic_actuator),
    "rudder-stall": Recipe(("yaw", "boat"), _rudder_stall),
    "asymmetric-thrust": Recipe(_ACTUATED, _asymmetric_thrust),
    "gain-drift": Recipe(_ACTUATED, _gain_drift),
    "speed-dependent-steering": Recipe(("steered", "boat"), _speed_steering),
    "advance-speed-loss": Recipe(("yaw", "surge", "heave"), _advance_loss),
    "linear-drag": Recipe(("yaw", "surge", "heave"), _linear_drag, coarse=True),
    "quadratic-drag": Recipe(_ACTUATED, _quadratic_drag),
    "coriolis-coupling": Recipe(_PLANAR, _coriolis),
    "sway-yaw-coupling": Recipe(_PLANAR, _sway_yaw),
    "mass-change": Recipe(("yaw", "surge", "heave", "boat"), _mass_change),
    "net-buoyancy": Recipe(("heave",), _net_buoyancy),
    "ground-effect": Recipe(("heave",), _ground_effect),
    "input-bias": Recipe(("yaw", "yaw", "surge", "boat"), _input_bias),
    "steady-current": Recipe(_PLANAR, _steady_current),
    "wind-moment": Recipe(("yaw", "yaw", "boat"), _wind_moment),
    "wave-disturbance": Recipe(("yaw", "yaw", "surge", "heave", "boat"), _wave),
    "tether-pull": Recipe(("yaw", "surge", "heave", "raft"), _tether),
    "sensor-position": Recipe(_PLANAR, _sensor_position),
    "compass-deviation": Recipe(("yaw", "yaw", "boat"), _compass),
    "gyro-bias": Recipe(("yaw", "yaw", "boat"), _gyro_bias),
    "measurement-delay": Recipe(("yaw", "surge", "heave"), _measurement_delay),
    "quantisation": Recipe(("yaw", "surge", "heave"), _quantisation),
    "outliers": Recipe(("yaw", "surge", "heave"), _outliers),
}
"""Slug -> recipe, in the order of the catalogue."""

ENVIRONMENT: Mapping[str, Recipe] = {
    "changing-current": Recipe(("boat", "raft", "diver"), _changing_current),
    "wind-load": Recipe(("boat", "raft", "steered"), _wind_load),
    "sea": Recipe(("yaw", "surge", "heave", "boat"), _sea),
    "tether-line": Recipe(("raft", "raft", "heave"), _tether_line),
    "shallow-water": Recipe(_PLANAR, _shallow_water),
    "bank-suction": Recipe(_PLANAR, _bank),
}
"""Slug (``sea``: another law of ``wave-disturbance``) -> recipe, hidden by the kind ``environment`` only.

In :data:`RECIPES` they would change the cases of all recorded seeds.
"""

NOT_DRAWN: Mapping[str, str] = dict.fromkeys(
    ("sway-moment", "speed-damping", "munk-moment", "velocity-product"),
    "the diagnosis tries it only if yaw is simulated with measured u and v; every craft here simulates its measured "
    "signals",
) | dict.fromkeys(("command-coupling", "propeller-wash"), "another recipe would change the cases of all recorded seeds")
"""Effects of the catalogue that no case hides -> reason."""
