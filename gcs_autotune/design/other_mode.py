"""The other mode that the same gains serve: held headings and followed turn rates share one turn-rate loop.

GUIDED holds headings, AUTO and ACRO steer by turn rate, and the firmware has one set of gains for both. A heading step
is nearly the same along a line of gains (less feed-forward, more angle gain), and turn rates are not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from gcs_autotune.axes import axis_kind
from gcs_autotune.design.laws import LAWS, OTHER_MODE, Settings
from gcs_autotune.design.matching import DesignProblem
from gcs_autotune.design.prediction import predict_error
from gcs_autotune.design.step_metrics import StepError
from gcs_autotune.models import SingleDof

__all__ = ["SHORTER", "OtherMode", "other_mode", "shortfall_of", "turn_rate_step"]

SHARE_OF_TURN = 0.6
"""Of the turn rate at full output that the step may reach, either way."""
TURN_RATE, TURN_RATE_AT_REST = math.radians(30.0), math.radians(60.0)
"""The turn-rate step, with speed and at rest, from half of it to port to half to starboard; less if the craft cannot
reach it. Chosen: 25 deg/s take a BlueROV2 6 % of its output, the edge of its thrusters' dead zone, where the end
of a step is random (ITAE +- 20 %); at 60 deg/s it is not (+- 8 %)."""
SETTLE_OF_TIME = 5.0
"""Duration of a turn-rate step in time constants of the craft."""
LEAST_UNDER_WAY, LEAST_AT_REST, MOST = 6.0, 3.5, 20.0
"""...within these bounds [s]."""
SWEEP, SWEEP_AT_REST = math.radians(75.0), math.radians(105.0)
"""What the bow may turn through during one step, so that the craft stays where there is room, or its tether whole.
Longer steps at rest were tried: of 6 s each way the last seconds are the dead band's again."""
SHORTER = 0.85
"""Time that a craft at rest is held turning, relative to its step. Chosen."""
HOLD_AT_REST = 3.0
"""Seconds that a craft at rest is held at least before a heading step."""


def turn_rate_step(
    model: SingleDof, *, at_rest: bool, duration: float | None = None, of_time: float = SETTLE_OF_TIME
) -> tuple[float, float]:
    """Return size [rad/s] and seconds each way of the turn-rate step of *model* (input a fraction of full output).

    duration : seconds each way where they are given. of_time : else so many time constants.
    """
    most = SHARE_OF_TURN * abs(model.steady_velocity(1.0 - abs(model.delta)))
    wish, sweep, least = (
        (TURN_RATE_AT_REST, SWEEP_AT_REST, LEAST_AT_REST) if at_rest else (TURN_RATE, SWEEP, LEAST_UNDER_WAY)
    )
    time = model.alpha / max(model.beta + 2.0 * model.beta_quadratic * min(0.5 * wish, most), 1e-3)
    seconds = duration or min(max(of_time * time, least), MOST)
    return min(wish, 2.0 * most, 2.0 * sweep / seconds), seconds


def shortfall_of(itae: float, seconds: float) -> float:
    """Return an ITAE [s^2] of a step of *seconds* relative to that of a craft that never moves."""
    return 2.0 * itae / seconds**2


@dataclass(frozen=True, slots=True, eq=False)
class OtherMode:
    """The loop of the other mode on the same craft: its ``problem``, and how long [s] its step lasts each way."""

    problem: DesignProblem
    duration: float

    def error(self, settings: Settings) -> StepError:
        """Return error and overshoot of its step with *settings*."""
        return predict_error(self.problem, settings, self.problem.step, self.duration)

    def shortfall(self, settings: Settings) -> float:
        """Return the ITAE relative to that of a craft that never follows: 0 is perfect."""
        return shortfall_of(self.error(settings).itae, self.duration)


def other_mode(problem: DesignProblem) -> OtherMode | None:
    """Return the other mode that the gains of *problem* serve; None where they serve one only, or the craft cannot."""
    name = OTHER_MODE.get(problem.law.name)
    if name is None:
        return None
    law, model, at_rest = LAWS[name], problem.model, problem.spec.speed is None
    if not all(math.isfinite(problem.settings.get(gain, math.nan)) for gain in law.tuned):
        return None
    if law.controls_velocity:
        step, seconds = turn_rate_step(model, at_rest=at_rest)
        hold = SHORTER * seconds if at_rest else 0.0
    else:
        step, seconds, hold = law.usual_step, axis_kind("heading").step_duration, HOLD_AT_REST if at_rest else 0.0
    if not (step > 0.0 and math.isfinite(step)):
        return None
    spec = replace(
        problem.spec,
        step=step,
        step_duration=seconds,
        hold=hold,
        windows=(),
        settled_band=math.inf,
        settled_time=math.inf,
        settled_least=math.inf,
        noise_std=0.0,
        jitter_std=None,
        quantum=0.0,
    )
    return OtherMode(replace(problem, law=law, gains=(), late=(), spec=spec, step=step), seconds)
