from __future__ import annotations

import math

import pytest

from gcs_autotune.craft import DepthTarget, HeadingTarget
from gcs_autotune.manoeuvres import Step, StepSettings

from .pond import at_rest


def fly(step, path, dt=0.1):
    """Feed values of the watched signal; return the targets commanded."""
    targets = []
    for i, value in enumerate(path):
        seen = at_rest(t=i * dt, psi=value, z=value)
        if i == 0:
            commands = step.commands(seen)
        command = commands.send(None if i == 0 else seen)
        targets.append(command.z if isinstance(command, DepthTarget) else command.psi)
        if step.outcome is not None:
            break
    return targets


def test_it_holds_until_steady_then_steps_both_ways():
    step = Step(StepSettings("z", 1.0, 5.0))
    targets = fly(step, [2.0] * 400)
    assert targets[0] == 2.0
    assert max(targets) == pytest.approx(3.0)
    assert targets[-1] == pytest.approx(2.0)
    assert step.outcome is not None and step.outcome.ending == "completed"
    assert [m.detail["value"] for m in step.take_marks()] == [2.0, 3.0, 2.0]
    assert step.take_marks() == []


def test_an_unsteady_craft_is_waited_for_only_so_long():
    step = Step(StepSettings("psi", 0.5, 5.0, settle=4.0))
    targets = fly(step, [math.sin(i) for i in range(60)])
    assert targets[45] == pytest.approx(0.5)


def test_a_steady_craft_is_held_as_long_as_asked():
    step = Step(StepSettings("z", 1.0, 5.0, hold=12.0))
    fly(step, [2.0] * 400)
    first, second, third = (m.t for m in step.take_marks())
    assert second - first == pytest.approx(12.0, abs=0.11)
    assert third - second == pytest.approx(5.0, abs=0.11)
    assert step.asked["hold"] == 12.0


def test_an_unsteady_craft_is_not_stepped_before_its_hold_is_over_either():
    step = Step(StepSettings("psi", 0.5, 5.0, settle=4.0, hold=8.0))
    targets = fly(step, [math.sin(i) for i in range(90)])
    assert targets[75] == 0.0
    assert targets[85] == pytest.approx(0.5)


def test_speed_goes_into_the_heading_target():
    step = Step(StepSettings("psi", 0.5, 5.0, speed=1.2))
    assert next(step.commands(at_rest())) == HeadingTarget(0.0, 1.2)
