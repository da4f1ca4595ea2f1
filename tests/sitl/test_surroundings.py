"""Effects of the surroundings in the simulator, against laws worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sitl import open_vehicle
from sitl.catalogue import load_vehicle
from sitl.craft import Craft
from sitl.effects import BadEffect, make_effect, parse_effect
from sitl.effects.effect import Setting
from sitl.open_loop import Hull, open_loop
from sitl.plants import State, Water, Wrench

PLANE = Hull(
    ("surge", "sway", "yaw"), {"surge": 10.0, "sway": 15.0, "yaw": 2.0}, {"surge": 5.0, "sway": 10.0, "yaw": 2.0}
)
DIVER = Hull(
    ("surge", "heave", "yaw"), {"surge": 10.0, "heave": 12.0, "yaw": 2.0}, {"surge": 5.0, "heave": 6.0, "yaw": 2.0}
)


def drift(hull, text, measured, **more):
    """Fly a hull without commands for 20 s with the effect that *text* describes."""
    still = {"X": np.zeros(200)}
    return open_loop(
        hull, still, duration=20.0, interval=0.1, measured=measured, effects=[parse_effect(text)], **more
    )  # fmt: skip


def test_a_gyre_carries_a_drifting_hull_along_an_arc():
    run = drift(PLANE, "changing-current.V_x=0.4,turn=0.1", ("x", "y", "u", "v"))
    t = run["t"]
    assert run["x"] == pytest.approx(4.0 * np.sin(0.1 * t), abs=1e-4)
    assert run["y"] == pytest.approx(4.0 * (1.0 - np.cos(0.1 * t)), abs=1e-4)
    assert run["u"] == pytest.approx(0.4 * np.cos(0.1 * t), abs=1e-9)


def test_a_tide_grows_and_reverses():
    run = drift(PLANE, "changing-current.V_y=0.4,growth=-0.1", ("y",))
    assert run["y"] == pytest.approx(0.4 * (run["t"] - 0.05 * run["t"] ** 2), abs=1e-4)


def test_shear_slows_the_current_with_depth_and_stops_it():
    at = {
        depth: drift(DIVER, "changing-current.V_x=0.4,shear=0.2", ("u",), initial={"z": depth})["u"]
        for depth in (0.0, 2.0, 6.0)
    }
    assert [speeds[-1] for speeds in at.values()] == pytest.approx([0.4, 0.24, 0.0])


def test_a_dive_through_shear_keeps_the_momentum_of_the_mass():
    state, water = State(w=0.5, psi=0.5 * math.pi), Water()
    setting = Setting(state, water, {}, ("surge", "heave", "yaw"), {}, {}, {}, (), mass=8.0)
    effect = make_effect("changing-current", "", {"V_x": 0.4, "shear": 0.2})
    effect.begin(setting)
    wrench = Wrench()
    effect.alter_force(0.0, wrench)
    assert (wrench.X, wrench.Y) == pytest.approx((0.0, -8.0 * 0.2 * 0.5 * 0.4))  # mass x gradient x descent


def test_currents_add_up():
    craft = Craft(
        load_vehicle("charlie"),
        effects=[parse_effect("changing-current.V_x=0.3"), parse_effect("steady-current.V_x=0.2")],
    )
    craft.begin("1")
    craft.move(0.02, 0.02, [1500] * 16)
    assert craft.plant.water.V_x == pytest.approx(0.5)


def test_a_current_faster_than_the_craft_is_refused_with_both_speeds():
    with pytest.raises(
        BadEffect, match=r"changing-current: the current of 9 m/s is faster than the craft .*Use a slower"
    ):
        open_vehicle("charlie", effects=[parse_effect("changing-current.V_x=9")])
