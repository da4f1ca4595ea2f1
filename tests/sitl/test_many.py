"""Many craft in one call of the kernel fly like one craft by itself."""

from __future__ import annotations

import math
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest

from gcs_autotune.study import check_plan, open_study
from sitl import load_vehicle
from sitl.craft import Craft
from sitl.many import RUN_UP, STEP, TICK, TURN, circles, zig_zags
from sitl.plants import RigidBody
from tests.study.toys import ran


def flown_alone(like: str) -> tuple[float, float]:
    """Return the steady diameter [m] and rate [rad/s] of the vehicle itself, step by step."""
    craft = Craft(load_vehicle(like))
    at, t = craft.plant.state, 0.0
    for steering, duration in ((0.0, RUN_UP), (0.3, TURN)):
        shares = defaultdict(float, X=0.5, N=steering)
        for _ in range(round(duration / STEP)):
            t += STEP
            craft.actuators.apply(shares, craft.plant.parameters, craft._wrench)
            craft.plant.step(craft._wrench, STEP)
    return 2.0 * math.hypot(at.u, at.v) / abs(at.r), abs(at.r)


@pytest.mark.parametrize("like", ["blueboat", "charlie-rudders"])
def test_one_craft_without_spread_is_the_vehicle_itself(like: str) -> None:
    found = circles(1, like, craft=1, spread=1.0)
    diameter, rate = flown_alone(like)
    assert found["steady_diameter.q50"] == pytest.approx(diameter, rel=1e-6)
    assert found["rate.q50"] == pytest.approx(rate, rel=1e-6)
    assert found["turned"] == 1.0
    assert found["advance.q50"] > 0.0


@pytest.mark.parametrize("like", ["blueboat", "charlie-rudders"])
def test_the_zig_zag_of_one_craft_is_that_of_the_vehicle(like: str) -> None:
    found = zig_zags(1, like, craft=1, spread=1.0)
    first, second, period = zig_zag_alone(like, math.radians(20.0))
    assert found["executed"] == 1.0
    assert found["overshoot_1.q50"] == pytest.approx(first, rel=1e-6)
    assert found["overshoot_2.q50"] == pytest.approx(second, rel=1e-6)
    assert found["period.q50"] == pytest.approx(period, abs=1e-6)


def zig_zag_alone(like: str, heading: float) -> tuple[float, float, float]:
    """Return both overshoots [rad] and the period [s] of the vehicle itself, step by step."""
    craft = Craft(load_vehicle(like))
    executes: list[float] = []
    swung: list[float] = []
    t = side = began = last = turned = 0.0
    while len(executes) < 4:
        psi = craft.plant.state.psi
        turned += math.remainder(psi - last, 2.0 * math.pi)
        last = psi
        if t > RUN_UP - 0.5 * TICK and not executes:
            began, side = turned, 1.0
            executes.append(t)
        elif executes:
            swung[-1:] = [max(swung[-1], -side * (turned - began))] if len(executes) > 1 else []
            if side * (turned - began) >= heading:
                side = -side
                executes.append(t)
                swung.append(heading)
        shares = defaultdict(float, X=0.5, N=0.3 * side)
        for _ in range(round(TICK / STEP)):
            craft.actuators.apply(shares, craft.plant.parameters, craft._wrench)
            craft.plant.step(craft._wrench, STEP)
        t += TICK
    return swung[0] - heading, swung[1] - heading, executes[3] - executes[1]


def test_a_spread_of_numbers_gives_a_spread_of_zig_zags() -> None:
    found = zig_zags(1, "blueboat", craft=40, heading=math.radians(10.0))
    assert found == zig_zags(1, "blueboat", craft=40, heading=math.radians(10.0))
    assert found["overshoot_1.q05"] < 0.8 * found["overshoot_1.q95"]
    assert zig_zags(1, "blueboat", craft=2, steering=0.001)["executed"] == 0.0


def test_a_craft_with_quick_motors_turns() -> None:
    found = circles(1, "ies-rov", craft=2, spread=1.0)
    assert found["turned"] == 1.0
    assert found["steady_diameter.q50"] == pytest.approx(1.202, rel=1e-3)  # so do steps of 1 ms


def test_time_steps_too_long_for_the_motors_are_rejected() -> None:
    plant = Craft(load_vehicle("ies-rov")).plant
    assert isinstance(plant, RigidBody)
    with pytest.raises(ValueError, match=r"diverges with time steps of 0\.05 s\. Use shorter steps"):
        plant.fly_copies(plant.body[None], np.full((20, 4), 0.5), np.zeros((20, 6)), dt=STEP, steps=20)


def test_a_spread_of_numbers_gives_a_spread_of_circles_set_by_the_seed() -> None:
    found = circles(1, "blueboat", craft=60, spread=1.5)
    assert found == circles(1, "blueboat", craft=60, spread=1.5)
    assert found != circles(2, "blueboat", craft=60, spread=1.5)
    assert found["diameter.q05"] < 0.8 * found["diameter.q50"] < found["diameter.q95"]


def test_a_study_can_run_the_function(tmp_path: Path) -> None:
    (tmp_path / "study.toml").write_text(
        'title = "circles"\ndo = "sitl.many:circles"\nfixed.argument.like = "blueboat"\nfixed.argument.craft = 5\n'
        "vary.argument.steering = [0.2, 0.4]\n"
    )
    check_plan(ran(tmp_path / "study.toml", tmp_path / "out"))
    small, large = open_study(tmp_path / "out")["diameter.q50"]
    assert small > 1.2 * large


def test_zero_craft_are_rejected() -> None:
    with pytest.raises(ValueError, match="at least 1"):
        circles(1, "blueboat", craft=0)
