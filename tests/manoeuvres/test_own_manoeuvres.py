"""Manoeuvres under our own controllers: a lost signal ends them without a NaN output."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from gcs_autotune.control import STRUCTURES, FeedbackLaw, IntegralLineOfSight, PidPosition, design_direct
from gcs_autotune.craft import Actuate, HeadingTarget, Observation
from gcs_autotune.manoeuvres import FollowLine, KeepPosition
from gcs_autotune.models import SingleDof

HERE = Observation(t=0.0, psi=0.2, r=0.0, x=1.0, y=2.0, u=0.5, v=0.0, speed=0.5)


@pytest.mark.parametrize("lost", ["x", "u", "r"])
def test_a_held_position_ends_neutral(lost: str) -> None:
    laws = [FeedbackLaw(STRUCTURES["PI-D"], K_P=1.0, K_I=0.1, K_D=1.0)] * 4
    manoeuvre = KeepPosition(lambda: PidPosition(laws), 0.3, 0.3, 30.0, 5.0, (float, float, float))
    commands = manoeuvre.commands(HERE)
    next(commands)
    last = commands.send(replace(HERE, t=0.1, **{lost: math.nan}))
    assert manoeuvre.outcome is not None and manoeuvre.outcome.ending == "aborted"
    assert last == Actuate()


@pytest.mark.parametrize("direct", [True, False], ids=["rudder", "heading"])
def test_a_followed_line_ends_straight_ahead(direct: bool) -> None:
    yaw = SingleDof("yaw", "1", 8.2, 2.465)
    law = design_direct(yaw, 0.9, "bessel", 0.3) if direct else IntegralLineOfSight(6.0, 0.05)
    manoeuvre = FollowLine(law, 5.0, 50.0, 0.9, 0.6)
    commands = manoeuvre.commands(HERE)
    next(commands)
    last = commands.send(replace(HERE, t=0.1, x=math.nan))
    assert manoeuvre.outcome is not None and manoeuvre.outcome.ending == "aborted"
    assert last == (Actuate(X=0.6) if direct else HeadingTarget(0.2, 0.9))
