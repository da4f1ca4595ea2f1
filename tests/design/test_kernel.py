"""The simulated loop stage by stage, uncompiled, on a craft too heavy to move: outputs follow by hand."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from gcs_autotune.design.actuator import ActuatorStep
from gcs_autotune.design.laws import kernel
from gcs_autotune.design.laws.kernel import AT_REST, Cascade, GyroFilter, LoopPlant, StartingVelocity, gyro_coefficients

DT = 0.5
HEAVY = LoopPlant(1e12, 0.0, 0.0, 0.0, DT, 1.0, 0.0, 1.0, 0.0, 1e12, 0.0, 0.0, 1e12)
CLEAR = GyroFilter(1.0, 0.0, 0.0, 0.0, 0.0)
PERFECT = ActuatorStep(1.0, 1e9, 1e9, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0)


@pytest.fixture(autouse=True)
def uncompiled(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("clip", "mixed", "wrap", "sqrt_control", "smoothing", "advance", "bent", "actuate", "delayed"):
        monkeypatch.setattr(kernel, name, getattr(kernel, f"_{name}"))
    monkeypatch.setattr(kernel, "shape", kernel.shaped_throttle)


def flown(
    n: int = 5, *, start: StartingVelocity = AT_REST, plant: dict[str, float] | None = None, gyro: GyroFilter = CLEAR,
    **stages: float,
) -> tuple[list[float], list[float], list[float]]:  # fmt: skip
    """Return position, output and all that went out."""
    position, output = np.zeros(n), np.zeros(n)
    sent = np.zeros(n + int(start.before))
    stages = {"velocity_max": 1e9, "most": 1e9, "lead_max": 1e9, **stages}
    kernel._fly(
        Cascade(**stages), gyro, HEAVY._replace(**(plant or {})), PERFECT, start, position, output, sent, np.zeros(4)
    )
    return position.tolist(), output.tolist(), sent.tolist()


def out(n: int = 5, **options: Any) -> list[float]:
    return flown(n, **options)[1]


BACK = {"back_at": 2.0}
"""The step is taken back at the third loop."""
TURNED = {"step": -1.0}


def low_pass(cutoff: float) -> float:
    return DT / (DT + 1.0 / (2.0 * math.pi * cutoff))


F = low_pass(0.3)
FADES = [1.0 - (1.0 - F) ** (k + 1) for k in range(5)]


@pytest.mark.parametrize(
    ("stages", "expected"),
    [
        ({"p": 0.4}, [0.4] * 5),
        ({"ff": 0.4}, [0.4] * 5),
        ({"cruise": 0.4}, [0.4] * 5),
        ({"p": 0.4, "scale": 0.5}, [0.2] * 5),
        ({"p": 0.4, "hover": 0.3}, [0.1] * 5),
        ({"p": 0.4, "most": 0.25}, [0.25] * 5),
        ({"i": 0.4, "imax": 0.5}, [0.2, 0.4, 0.5, 0.5, 0.5]),
        ({"i": 0.4, "imax": 9.0}, [0.2, 0.4, 0.6, 0.8, 1.0]),
        ({"i": 0.4, "imax": 9.0, "grows": 0.0}, [0.0] * 5),
        ({"d": 0.4}, [0.8, 0.0, 0.0, 0.0, 0.0]),
        ({"d": 1.0}, [2.0, 0.0, 0.0, 0.0, 0.0]),
        ({"d": 0.4, "slope_cutoff": 0.3}, [0.8 * F * (1.0 - F) ** k for k in range(5)]),
        ({"p": 1.0, "error_cutoff": 0.3}, FADES),
        ({"ff": 1.0, "target_cutoff": 0.3}, FADES),
        ({"cruise": 1.0, "target_cutoff": 0.3, "error_cutoff": 0.3}, [1.0] * 5),
        ({"p": 1.0, "output_cutoff": 0.3}, FADES),
        ({"p": 1.0, "slew_output": 0.3}, [0.3, 0.6, 0.9, 1.0, 1.0]),
        ({"p": 1.0, "acceleration": 0.6}, [0.3, 0.6, 0.9, 1.0, 1.0]),
        ({"p": 1.0, "acceleration": 0.6, "deceleration": 0.2}, [0.3, 0.6, 0.9, 1.0, 1.0]),
        ({"p": 1.0, "velocity_max": 0.7}, [0.7] * 5),
        ({"p": 0.8, "throttle": 0.7}, [0.8 / 1.5] * 5),
        ({"p": 0.2, "throttle": 0.7}, [0.2] * 5),
        ({"p": 0.4, "least": 0.5}, [0.7] * 5),
        ({"p": 0.4, "expo": 1.0}, [math.sqrt(0.4)] * 5),
    ],
    ids=str,
)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_each_stage_of_a_velocity_loop_gives_the_expected_output(
    side: float, stages: dict[str, float], expected: list[float]
) -> None:
    if "hover" in stages:
        stages = {**stages, "hover": side * stages["hover"]}
    assert out(plant={"step": side}, **stages) == pytest.approx([side * u for u in expected], abs=1e-9)


@pytest.mark.parametrize(
    ("stages", "expected"),
    [
        ({"p": 1.0, "acceleration": 0.6}, [0.3, 0.6, 0.3, 0.0, 0.0]),
        ({"p": 1.0, "acceleration": 0.6, "deceleration": 0.2}, [0.3, 0.6, 0.5, 0.4, 0.3]),
        ({"p": 1.0, "slew_output": 0.4}, [0.4, 0.8, 0.4, 0.0, 0.0]),
        ({"i": 0.4, "imax": 9.0}, [0.2, 0.4, 0.4, 0.4, 0.4]),
    ],
    ids=str,
)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_step_back_is_followed(side: float, stages: dict[str, float], expected: list[float]) -> None:
    assert out(plant={"step": side, **BACK}, **stages) == pytest.approx([side * u for u in expected])


def test_a_step_begins_at_its_loop_cycle() -> None:
    assert out(plant={"step_at": 2.0, "back_at": 4.0}, p=1.0) == pytest.approx([0.0, 0.0, 1.0, 1.0, 0.0], abs=1e-9)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_an_integral_at_the_output_limit_stops_growing_and_unwinds(side: float) -> None:
    limited = out(8, plant={"step": side, "back_at": 4.0}, p=1.0, i=0.4, imax=9.0, most=1.3)
    # 1.2, 1.3 (of 1.4: at its limit from here on), so the integral stands at 0.4
    assert limited == pytest.approx([side * u for u in (1.2, 1.3, 1.3, 1.3, 0.4, 0.4, 0.4, 0.4)])
    slewed = out(8, plant={"step": side, "back_at": 4.0}, p=1.0, i=0.4, imax=9.0, slew_output=0.5)
    assert slewed == pytest.approx([side * u for u in (0.5, 1.0, 1.2, 1.4, 0.9, 0.4, 0.4, 0.4)])


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("step", "grows"), [(0.97, 3), (0.98, 2), (1.01, 1)])
def test_a_low_passed_output_counts_as_limited_just_below_full(side: float, step: float, grows: int) -> None:
    """It grows by a hundredth of the step a loop until the one after 0.999 is reached; the fourth shows by how much."""
    found = out(4, plant={"step": side * step, "back_at": 3.0}, p=1.0, i=0.02, imax=9.0, output_cutoff=1e6, most=1.0)
    assert found[3] == pytest.approx(side * step * 0.01 * grows, rel=2e-3)


def test_an_integral_at_the_output_limit_unwinds_beyond_the_target() -> None:
    """The position loop: beyond the target the integral shrinks although the output is limited."""
    held = flown(6, plant={"step": 1.0, "back_at": 3.0, "settled": 0.0}, on_position=1.0, position_p=1.0, p=1.0, i=0.4,
                 imax=9.0, most=0.5)[1]  # fmt: skip
    assert held == pytest.approx([0.5, 0.5, 0.5, 0.2, 0.2, 0.2])


@pytest.mark.parametrize(("brakes", "expected"), [(1.0, [0.4, 0.4, -0.6, -0.6]), (0.0, [0.4, 0.4, 0.0, 0.0])])
def test_an_output_reverses_against_the_target_velocity_only_if_braking_is_allowed(
    brakes: float, expected: list[float]
) -> None:
    """The craft does not move; a hover of 0.6 is what turns the output when 1 m/s becomes none."""
    steps = out(4, plant={"step": 1.0, **BACK}, p=1.0, hover=0.6, brakes=brakes)
    assert steps == pytest.approx(expected)
    ahead = out(2, plant={"step": 1.0}, p=1.0, hover=1.5, brakes=brakes)
    assert ahead == pytest.approx([-0.5, -0.5] if brakes else [0.0, 0.0])


@pytest.mark.parametrize(
    ("stages", "step", "expected"),
    [
        ({"position_p": 0.5}, 0.8, [0.4] * 4),
        ({"position_p": 0.5}, 4.0, [2.0] * 4),
        ({"position_p": 0.5, "angle": 1.0}, 4.0, [0.5 * (4.0 - 2.0 * math.pi)] * 4),
        ({"position_p": 0.5, "angle": 1.0}, -4.0, [0.5 * (2.0 * math.pi - 4.0)] * 4),
        ({"position_p": 2.0, "sqrt_acceleration": 1.0}, 2.0, [math.sqrt(2.0 * (2.0 - 0.125))] * 4),
        ({"position_p": 2.0, "sqrt_acceleration": 1.0}, 0.2, [0.4] * 4),
        ({"position_p": 2.0, "stop_acceleration": 0.5}, 2.0, [math.sqrt(2.0)] * 4),
        ({"position_p": 2.0, "stop_acceleration": 0.5}, -2.0, [-math.sqrt(2.0)] * 4),
        ({"position_p": 2.0, "velocity_max": 0.3}, 2.0, [0.3] * 4),
        ({"position_p": 2.0, "lead_max": 0.4}, 2.0, [0.8] * 4),
        ({"position_p": 2.0, "lead_max": 0.4}, -2.0, [-0.8] * 4),
        ({"position_p": 1.0, "leads": 1.0, "slew": 0.6}, 1.0, [0.3, 0.6, 0.9, 1.0]),
        ({"position_p": 1.0, "leads": 1.0, "slew": 0.6}, -1.0, [-0.3, -0.6, -0.9, -1.0]),
        ({"position_p": 1.0, "leads": 1.0, "slew": 0.6, "lead_max": 0.5}, 1.0, [0.3, 0.5, 0.5, 0.5]),
    ],
    ids=str,
)
def test_each_stage_of_a_position_loop_gives_the_expected_output(
    stages: dict[str, float], step: float, expected: list[float]
) -> None:
    found = out(4, plant={"step": step}, on_position=1.0, p=1.0, **stages)
    assert found == pytest.approx(expected)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_shaped_target_keeps_its_acceleration_and_slew_limits_and_is_fed_forward(side: float) -> None:
    acceleration, slew, time = 0.8, 0.7, 2.0
    lead, rate, expected = 0.0, 0.0, []
    for _ in range(8):
        ahead = 3.0 - lead
        linear = acceleration * time**2
        target = ahead / time if ahead <= linear else math.sqrt(2.0 * acceleration * (ahead - 0.5 * linear))
        rate = min(max(min(target, slew), rate - acceleration * DT), rate + acceleration * DT)
        lead += rate * DT
        expected.append(0.25 * lead + rate)
    assert expected[0] == pytest.approx(0.25 * 0.2 + 0.4)
    assert expected[1] == pytest.approx(0.25 * 0.55 + 0.7), "at its slew"
    found = out(8, plant={"step": side * 3.0}, on_position=1.0, p=1.0, position_p=0.25, leads=1.0, shaped=1.0,
                shape_acceleration=acceleration, slew=slew, shape_time=time)  # fmt: skip
    assert found == pytest.approx([side * u for u in expected])


def test_a_velocity_target_may_also_lead_a_position() -> None:
    """A turn rate of 1 rad/s asked for: the heading aimed at goes ahead, within its acceleration."""
    shaped = out(4, on_position=0.0, p=1.0, position_p=0.5, leads=1.0, shaped=1.0, shape_acceleration=0.8)
    rates, leads = [0.4, 0.8, 1.0, 1.0], [0.2, 0.6, 1.1, 1.6]
    assert shaped == pytest.approx([0.5 * lead + rate for lead, rate in zip(leads, rates, strict=True)])
    plain = out(4, on_position=0.0, p=1.0, position_p=0.5, leads=1.0)
    assert plain == pytest.approx([0.5 * 0.5 * k for k in range(1, 5)])


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_nested_loop_controls_acceleration_from_the_velocity_error(side: float) -> None:
    nested = {"nested": 1.0, "p": 1.0}
    step = {"step": side}
    assert out(3, plant=step, **nested, velocity_p=0.4) == pytest.approx([side * 0.4] * 3)
    wound = out(4, plant=step, **nested, velocity_p=0.4, velocity_i=0.2, velocity_imax=0.25)
    assert wound == pytest.approx([side * u for u in (0.5, 0.6, 0.65, 0.65)])
    slow = out(4, plant=step, **nested, velocity_p=1.0, velocity_cutoff=0.3)
    assert slow == pytest.approx([side * u for u in FADES[:4]])
    steep = out(2, plant={"step": side * 2.0}, **nested, velocity_p=0.0, velocity_i=0.2, velocity_imax=9.0)
    assert steep == pytest.approx([side * 0.2, side * 0.4])
    stuck = {**nested, "velocity_p": 0.4, "velocity_i": 0.2, "velocity_imax": 9.0, "most": 0.55}
    # 0.5, then 0.6 of which 0.55 goes out: from there on the integral stands at 0.2, and is left when the step is
    assert out(6, plant={"step": side, "back_at": 4.0}, **stuck) == pytest.approx(
        [side * u for u in (0.5, 0.55, 0.55, 0.55, 0.2, 0.2)]
    )
    moving = out(3, plant={"step": side, "alpha": 2.0}, **nested, velocity_p=0.4)
    v, a, expected = 0.0, 0.0, []
    for _ in range(3):
        expected.append(0.4 * (1.0 - v) - a)
        a = expected[-1] / 2.0
        v += DT * a
    assert moving == pytest.approx([side * u for u in expected])
    # a craft of inertia 2 that is pushed with p (1 - acceleration): what it does is measured a loop later
    light = out(3, plant={"step": side, "alpha": 2.0}, **nested, velocity_p=0.0, ff=0.0, hover=-side * 0.5)
    a1 = 0.25
    assert light == pytest.approx([side * 0.5, side * (0.5 - a1), side * (0.5 - (0.5 - a1) / 2.0)])


def test_a_craft_moves_by_its_output_and_a_push_and_is_measured_by_its_gyro() -> None:
    light = {"alpha": 0.5, "step": 0.0, "push": 0.1, "push_at": 2.0}
    position, output, _ = flown(5, plant=light, p=1.0)
    v, x, seen = 0.0, 0.0, []
    for k in range(5):
        u = -v
        seen.append(u)
        force = u + (0.1 if k >= 2 else 0.0)
        x, v = x + DT * (v + 0.5 * DT * force / 0.5), v + DT * force / 0.5
    assert output == pytest.approx(seen)
    assert position == pytest.approx([0.0, 0.0, 0.0, *np.cumsum([0.1, 0.0])])
    turning, _, _ = flown(3, plant={"alpha": 0.5, "step": 0.0, "push": 0.1, "push_at": 0.0}, on_position=1.0)
    assert turning == pytest.approx([0.0, 0.025, 0.1])


def test_a_gyro_filter_delays_a_growing_velocity_sample_by_sample() -> None:
    slow = gyro_coefficients(0.2, 1.0 / DT)
    x1 = x2 = y1 = y2 = 0.0
    expected = []
    for v in (0.5 * k for k in range(5)):
        y = slow.b0 * v + slow.b1 * x1 + slow.b2 * x2 - slow.a1 * y1 - slow.a2 * y2
        x2, x1, y2, y1 = x1, v, y1, y
        expected.append(-1e-9 * y)
    pushed = {"alpha": 1.0, "step": 0.0, "push": 1.0, "push_at": 0.0}
    assert out(plant=pushed, gyro=slow, p=1e-9) == pytest.approx(expected, rel=1e-6)


def test_a_velocity_loop_starts_with_the_output_that_holds_the_velocity() -> None:
    start = StartingVelocity(2.0, 0.6, 2.0)
    position, output, sent = flown(
        3, start=start, plant={"step": 0.5, "step_at": 1.0, "alpha": 1e9}, p=1.0, i=1e-9, imax=9.0, cruise=0.1, ff=0.05
    )
    # 0.6 = integral + (cruise + ff) 2
    assert sent == pytest.approx([0.6, 0.6, 0.6, 0.6 + 0.5 * 1.15, 0.6 + 0.5 * 1.15])
    assert output == pytest.approx(sent[2:])
    assert position == pytest.approx([0.0, 0.0, 0.0], abs=1e-6), "by how much it has changed"
    scaled = flown(1, start=start, plant={"step": 0.0}, p=1.0, i=1e-9, imax=9.0, scale=2.0)[2]
    assert scaled == pytest.approx([0.6] * 3)
    for without in ({"i": 0.0}, {"i": 1.0, "grows": 0.0}):
        bare = flown(1, start=start, plant={"step": 0.0}, p=1.0, imax=9.0, ff=0.1, **without)[2]
        assert bare == pytest.approx([0.2] * 3)
    short = flown(1, start=start, plant={"step": 0.0}, p=0.0, i=1e-9, imax=0.25)[2]
    assert short == pytest.approx([0.25] * 3)


def test_a_position_loop_starts_at_rest_against_a_constant_force() -> None:
    still = {"step": 0.0, "settled": 0.3}
    held = out(3, plant=still, on_position=1.0, position_p=1.0, p=1.0, i=0.5, imax=9.0)
    assert held == pytest.approx([-0.3] * 3), "the integral holds it"
    partly = flown(3, plant=still, on_position=1.0, position_p=0.5, p=1.0, i=0.5, imax=0.2)
    assert partly[1] == pytest.approx([-0.3] * 3)
    assert partly[0] == pytest.approx([0.2] * 3), "the rest is held by an error of 0.1 / (1 x 0.5)"
    scaled = flown(3, plant=still, on_position=1.0, position_p=0.5, p=1.0, i=0.5, imax=0.05, scale=2.0)
    assert scaled[1] == pytest.approx([-0.3] * 3)
    assert scaled[0] == pytest.approx([0.2] * 3), "half of it, less what the integral holds, is 0.1"
    without = flown(3, plant=still, on_position=1.0, position_p=1.0, p=1.0, imax=9.0)
    assert without[0] == pytest.approx([0.3] * 3), "no integral, none held"
    nested = flown(2, plant=still, on_position=1.0, position_p=0.5, p=1.0, i=0.5, imax=0.2, nested=1.0, velocity_p=0.4)
    assert nested[0] == pytest.approx([0.1 / 0.4 / 0.5] * 2), "a velocity stands between the two"
    weak = flown(2, plant={"step": 0.0, "settled": 0.5}, on_position=1.0, position_p=2.0, p=1.0, most=0.2)
    assert weak[1] == pytest.approx([-0.2] * 2)
    far = flown(3, plant={"step": 0.0, "settled": 0.9}, on_position=1.0, position_p=1.0, p=1.0)
    assert far[0] == pytest.approx([0.5] * 3), "half a metre at most"
    assert far[1] == pytest.approx([-0.5] * 3)
    for side in (1.0, -1.0):
        limited = {"step": 0.0, "settled": side * 0.3}
        slow = flown(1, plant=limited, on_position=1.0, position_p=0.5, p=1.0, velocity_max=0.2)
        assert (slow[0], slow[1]) == (pytest.approx([side * 0.4]), pytest.approx([-side * 0.2])), (
            "no faster than it may"
        )
    for scale in (1.0, 0.5):
        at_rest = {"on_position": 1.0, "position_p": 1.0, "p": 1.0, "i": 0.5, "imax": 9.0, "scale": scale}
        assert out(3, plant={"step": 0.0}, **at_rest, hover=0.4) == pytest.approx([0.0] * 3)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(
    "stages", [{"slew_output": 0.01}, {"output_cutoff": 0.3}, {"i": 0.4, "imax": 0.1}, {"hover": 0.4}], ids=str
)
def test_a_craft_at_rest_against_a_constant_force_stays_with_late_and_slow_outputs(
    side: float, stages: dict[str, float]
) -> None:
    """What it sent before, and what slow outputs begin at, holds it as well."""
    if "hover" in stages:
        stages = {**stages, "hover": side * stages["hover"]}
    pushed = {"step": 0.0, "settled": side * 0.3, "delta": side * 0.3, "alpha": 0.5, "late": 1.5}
    position, output, _ = flown(6, plant=pushed, on_position=1.0, position_p=0.5, p=1.6, ff=0.4, **stages)
    held = -side * 0.3 + stages.get("hover", 0.0)
    held -= min(max(held, -0.1), 0.1) if "i" in stages else 0.0
    assert output == pytest.approx([-side * 0.3] * 6, abs=1e-12)
    assert position == pytest.approx([max(min(-held / 2.0 / 0.5, 0.5), -0.5)] * 6, abs=1e-12)


def test_stages_that_a_law_does_not_set_have_no_effect() -> None:
    assert {name: value for name, value in Cascade()._asdict().items() if value != 0.0} == {
        "lead_max": math.inf, "shape_time": 1.0, "velocity_max": math.inf, "scale": 1.0, "grows": 1.0, "most": 1.0,
        "brakes": 1.0,
    }  # fmt: skip


def test_an_output_is_delayed_by_whole_and_partial_loop_cycles() -> None:
    found = flown(5, plant={"alpha": 0.5, "step": 1.0, "late": 1.5}, cruise=1.0)[0]
    # acts: nothing, half of the first, all of it from there on
    forces = [0.0, 0.5, 1.0, 1.0]
    assert found == pytest.approx([0.0, *np.cumsum(forces)])
