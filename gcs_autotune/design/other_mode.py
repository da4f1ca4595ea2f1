"""The other mode that uses the same gains: holding a heading and following a turn rate use the same turn-rate loop.

GUIDED holds headings, while AUTO and ACRO steer by turn rate. The firmware has one set of gains for both. A heading
step is nearly the same along a line of gains (less feed-forward, more angle gain), but a turn-rate step is not.
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
"""Largest turn-rate step in each direction, relative to the turn rate at full output. Project choice."""
TURN_RATE, TURN_RATE_AT_REST = math.radians(30.0), math.radians(60.0)
"""Size of the turn-rate step [rad/s], for a craft with speed and for a craft at rest.

Project choice. It is smaller if the craft cannot reach it, or if it would turn too far for its heading limit: 51 deg/s
at rest for the usual limit of 120 deg.

The step goes from half its size to port to half to starboard. On a BlueROV2, 25 deg/s take 6 % of its output, which is
at the edge of its thrusters' dead zone. The end of such a step is random (ITAE +- 20 %); at 60 deg/s it is much less
random (+- 8 %).
"""
SETTLE_OF_TIME = 5.0
"""Duration of a turn-rate step, in time constants of the craft. Project choice."""
LEAST_UNDER_WAY, LEAST_AT_REST, MOST = 6.0, 3.5, 20.0
"""Bounds [s] of the duration of a turn-rate step: minimum with speed, minimum at rest, and maximum. Project choice."""
SWEEP, SWEEP_AT_REST = math.radians(75.0), math.radians(105.0)
"""Largest change of heading [rad] during one step, for a craft with speed and for a craft at rest.

Project choice: it limits the space needed and the twist of a tether. Longer steps at rest are no better: after 6 s in
each direction the last seconds are again in the dead zone.
"""
SHORTER = 0.85
"""Time for which a craft at rest is held in a turn before its step, relative to the duration of the step.

Project choice.
"""
HOLD_AT_REST = 3.0
"""Minimum time [s] for which a craft at rest is held before a heading step. Project choice."""


def turn_rate_step(
    model: SingleDof, *, at_rest: bool, duration: float | None = None, of_time: float = SETTLE_OF_TIME
) -> tuple[float, float]:
    """Return the size [rad/s] of the turn-rate step of *model*, and its duration [s] in each direction.

    The model's input is a fraction of full output.

    duration : duration [s] in each direction. None uses *of_time*.
    of_time : duration in each direction, in time constants of the craft.
    """
    most = SHARE_OF_TURN * abs(model.steady_velocity(1.0 - abs(model.delta)))
    rate, sweep, least = (
        (TURN_RATE_AT_REST, SWEEP_AT_REST, LEAST_AT_REST) if at_rest else (TURN_RATE, SWEEP, LEAST_UNDER_WAY)
    )
    time = model.alpha / max(model.beta + 2.0 * model.beta_quadratic * min(0.5 * rate, most), 1e-3)
    seconds = duration or min(max(of_time * time, least), MOST)
    return min(rate, 2.0 * most, 2.0 * sweep / seconds), seconds


def shortfall_of(itae: float, seconds: float) -> float:
    """Return the ITAE [s^2] of a step of *seconds*, relative to that of a craft that never moves."""
    return 2.0 * itae / seconds**2


@dataclass(frozen=True, slots=True, eq=False)
class OtherMode:
    """The loop of the other mode that uses the same gains, on the same craft.

    - ``problem``: design problem of the other mode.
    - ``duration`` [s]: duration of the other mode's step in each direction.
    """

    problem: DesignProblem
    duration: float

    def error(self, settings: Settings) -> StepError:
        """Return error and overshoot of the other mode's step with *settings*."""
        return predict_error(self.problem, settings, self.problem.step, self.duration)

    def shortfall(self, settings: Settings) -> float:
        """Return the ITAE of the other mode's step with *settings*, relative to that of a craft that never moves. 0
        is perfect.
        """
        return shortfall_of(self.error(settings).itae, self.duration)


def other_mode(problem: DesignProblem) -> OtherMode | None:
    """Return the other mode that the gains of *problem* serve.

    Return None if the gains serve one mode only, or if the craft cannot follow the other mode's step.
    """
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
