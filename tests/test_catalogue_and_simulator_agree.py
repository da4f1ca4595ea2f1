"""The effects of the catalogue and of the simulator share no code and agree for the same numbers."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_autotune.effects import EFFECTS, EffectInstance, ExtendedModel, passage_of
from gcs_autotune.models import CoupledModel, Form
from gcs_autotune.trial import Channel
from sitl.effects import EFFECTS as SIMULATED
from sitl.effects import make_effect
from sitl.open_loop import Hull, open_loop

INERTIA = {"surge": 10.0, "sway": 15.0, "heave": 12.0, "yaw": 2.0}
DRAG = {"surge": 5.0, "sway": 10.0, "heave": 6.0, "yaw": 2.0}
NAMES = {"surge": ("X", "u"), "sway": ("Y", "v"), "heave": ("Z", "w"), "yaw": ("N", "r")}
SIGNALS = ("x", "y", "z", "psi", "u", "v", "w", "r")
START = {"z": 3.0}
INTERVAL, COUNT = 0.1, 400

CASES = {
    "time-scale": ("t", {"factor": 1.1}),
    "time-offset": ("t", {"offset": 0.23}),
    "unit-error": ("r", {"factor": 57.2958}),
    "sign-error": ("N", {}),
    "channel-swap": ("u+v", {}),
    "input-delay": ("N", {"delay": 0.37}),
    "saturation": ("N", {"limit": 0.7}),
    "rate-limit": ("N", {"rate": 0.9}),
    "actuator-lag": ("N", {"time_constant": 0.6}),
    "backlash": ("N", {"width": 0.4}),
    "dead-zone": ("N", {"width": 0.3}),
    "quadratic-actuator": ("N", {"share": 0.6, "u_ref": 2.0}),
    "rudder-stall": ("N", {"angle": 0.6, "drop": 0.8}),
    "asymmetric-thrust": ("N", {"ratio": 0.6}),
    "command-coupling": ("N+X", {"gain": -0.15}),
    "gain-drift": ("N", {"rate": 0.01}),
    "speed-dependent-steering": ("N", {"share": 0.5, "U_ref": 0.7}),
    "propeller-wash": ("N+X", {"share": 0.5, "X_ref": 3.5}),
    "advance-speed-loss": ("N", {"loss": 0.4}),
    "linear-drag": ("yaw", {"coefficient": 0.7}),
    "quadratic-drag": ("yaw", {"coefficient": 0.7}),
    "coriolis-coupling": ("surge+sway+yaw", {"X_vr": 3.0, "Y_ur": -4.0, "N_uv": -1.0}),
    "sway-yaw-coupling": ("sway+yaw", {"Y_r": 0.7, "N_v": -0.6, "Y_rdot": 0.8}),
    "sway-moment": ("yaw", {"N_v": -0.6}),
    "speed-damping": ("yaw", {"N_|u|r": -0.5}),
    "munk-moment": ("yaw", {"N_uv": -0.7}),
    "velocity-product": ("N_|v|r", {"coefficient": -0.9}),
    "mass-change": ("all", {"ratio": 1.7, "time": 13.3}),
    "net-buoyancy": ("heave", {"force": 0.5}),
    "ground-effect": ("heave", {"strength": 2.0, "length": 2.0, "bottom": 6.0}),
    "input-bias": ("yaw", {"bias": 0.2}),
    "steady-current": ("over ground", {"V_x": 0.3, "V_y": -0.2}),
    "changing-current": (
        "over ground",
        {"V_x": 0.3, "V_y": -0.2, "growth": 0.02, "turn": -0.03, "shear": 0.05},
    ),
    "wind-moment": ("yaw", {"strength": 0.5, "direction": 1.0}),
    "wind-load": ("surge+sway+yaw", {"X": 0.5, "Y": 0.8, "N": 0.4, "direction": 1.0, "speed": 1e5}),
    "tether-pull": ("surge+sway", {"stiffness": 0.5, "x": 2.0, "y": 1.0, "anchor": 0.0}),
    "tether-line": ("surge+sway+heave", {"stiffness": 2.0, "length": 6.0, "drag": 4.0, "x": 2.0, "y": 1.0, "z": 3.0}),
    "shallow-water": (
        "surge+sway+yaw",
        {"draught": 1.0, "depth": 2.0, "north": 0.01, "east": -0.02, "drag": 4.0, "sway": 0.6, "yaw": 0.4},
    ),
    "bank-suction": ("sway+yaw", {"direction": 0.4, "distance": 30.0, "Y": 20.0, "N": 5.0}),
    "sensor-position": ("u+v+x+y", {"x_P": 0.7, "y_P": -0.4}),
    "compass-deviation": ("psi", {"A": 0.02, "B": 0.1, "C": 0.05}),
    "gyro-bias": ("r", {"bias": 0.05}),
    "measurement-delay": ("psi+r", {"delay": 0.23}),
}
"""Slug -> place and numbers, constants of the runs among them."""
ALSO = {"asymmetric-thrust": ("N+X", {"ratio": 0.6})}
"""The same at another place, where it does something else."""
UNFORESEEN = {"wave-disturbance", "quantisation", "outliers"}
"""What no simulation foretells; the tests of both sides look at their statistics."""
BOOK_ONLY = {
    "advance-speed-loss": {"gain": 1.0, "axis": 5.0},
    "ground-effect": {"dives": 1.0},
    "shallow-water": {"x_0": 0.0, "y_0": 0.0},
    "bank-suction": {"least": 0.1},
}
"""What the book reads off the form of the base model."""
CONSTANTS = {
    "u_ref",
    "U_ref",
    "X_ref",
    "bottom",
    "speed",
    "gust",
    "A_F",
    "A_L",
    "L",
    "c_x",
    "c_y",
    "c_n",
    "gamma",
    "drift",
    "draught",
    "depth",
    "beam",
}


def plain_model():
    values = {}
    for dof, (force, speed) in NAMES.items():
        values[f"{force}_{speed}dot"], values[f"{force}_{speed}"] = -INERTIA[dof], -DRAG[dof]
    inputs = {force: ((force, 1.0),) for force, _ in NAMES.values()}
    return CoupledModel(Form("plain", "plain", tuple(NAMES), tuple(values), {}, inputs, coriolis=False), values)


def commands():
    rng = np.random.default_rng(0)
    sizes = {"X": 3.0, "Y": 2.0, "Z": 2.0, "N": 1.0}
    found = {name: size * np.repeat(rng.normal(size=COUNT // 10), 10) for name, size in sizes.items()}
    for values in found.values():
        values[:10] = 0.0  # at rest, so that it does not matter for how long it has been afloat
    found["X"][10:] += 3.0
    return found


def test_the_simulator_has_every_effect_of_the_book_under_the_same_names():
    assert set(EFFECTS) <= set(SIMULATED)
    assert set(EFFECTS) <= set(CASES) | UNFORESEEN
    for slug, entry in EFFECTS.items():
        constants = CONSTANTS | ({"direction"} if slug == "wave-disturbance" else set())
        names = [quantity.name for quantity in entry.parameters]
        known = [parameter.name for parameter in SIMULATED[slug].parameters]
        assert sorted(known) == sorted({*names, *(constants & set(known))}), slug


@pytest.fixture(scope="module")
def unaltered():
    usual = {"duration": COUNT * INTERVAL, "interval": INTERVAL, "measured": SIGNALS, "initial": START}
    return open_loop(Hull(tuple(NAMES), INERTIA, DRAG), commands(), **usual)


PLACES = [(slug, *case) for table in (CASES, ALSO) for slug, case in table.items() if slug in EFFECTS]


@pytest.mark.parametrize(("slug", "place", "numbers"), PLACES, ids=[f"{slug}@{place}" for slug, place, _ in PLACES])
def test_book_and_simulator_agree_on(slug, place, numbers, unaltered):
    usual = {"duration": COUNT * INTERVAL, "interval": INTERVAL, "measured": SIGNALS, "initial": START}
    run = open_loop(Hull(tuple(NAMES), INERTIA, DRAG), commands(), effects=[make_effect(slug, place, numbers)], **usual)
    values = {name: value for name, value in numbers.items() if name not in CONSTANTS}
    constants = {name: value for name, value in numbers.items() if name in CONSTANTS}
    applied = EffectInstance(slug, place, values, {**constants, **BOOK_ONLY.get(slug, {})})
    model = ExtendedModel(plain_model(), (applied,))
    t = run["t"]
    measured = {name: Channel(name, "1", t, values) for name, values in run.items() if name != "t"}
    passage = passage_of("run", t, {name: run[name] for name in "XYZN"}, dict.fromkeys(SIGNALS, t), measured)
    predicted = model.predict(passage, START)
    assert predicted is not None
    moved = [name for name in run if not np.allclose(run[name], unaltered[name], atol=1e-9)]
    assert moved
    for name in SIGNALS:
        changed = float(np.sqrt(np.mean((run[name] - unaltered[name]) ** 2)))
        apart = float(np.sqrt(np.mean((run[name] - predicted[name]) ** 2)))
        assert apart < 1e-3 + 0.01 * changed, name
