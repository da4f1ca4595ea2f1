"""A mission flown by the autopilot ends early when its waypoints are not reached, or the position jumps."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from gcs_autotune.craft import Observation
from gcs_autotune.manoeuvres import FlyMission
from gcs_autotune.manoeuvres.manoeuvre import Outcome

ROUTE = ((0.0, 0.0), (100.0, 0.0), (100.0, 50.0))


def flown(x: Callable[[float], float], output: float) -> tuple[float, Outcome]:
    """Fly north along the first leg at x(t) [m] until the manoeuvre ends; return the time and the outcome."""
    manoeuvre = FlyMission(ROUTE, 0.5)

    def seen(t: float) -> Observation:
        return Observation(t, 0.0, x=x(t), y=0.0, speed=1.0, waypoint=2.0 if t > 1.0 else 1.0, output={"X": output})

    commands = manoeuvre.commands(seen(0.0))
    next(commands)
    for k in range(1, 4000):
        try:
            commands.send(seen(0.1 * k))
        except StopIteration:
            break
        if manoeuvre.outcome is not None:
            break
    assert manoeuvre.outcome is not None
    return 0.1 * k, manoeuvre.outcome


@pytest.mark.parametrize(
    ("output", "cause"),
    [(0.97, "The current or the wind may be stronger than the boat"), (0.4, "Tune speed and heading first")],
)
def test_a_missed_waypoint_ends_the_mission_and_reports_speed_and_thrust(output: float, cause: str) -> None:
    ended, outcome = flown(lambda t: 0.1 * t, output)
    assert outcome.ending == "aborted"
    assert 200.0 < ended < 250.0  # 30 s and 100 m at 0.5 m/s
    assert f"the boat made 0.10 m/s towards it with {100.0 * output:.0f} % of full output" in outcome.reason
    assert cause in outcome.reason


def test_a_position_jump_ends_the_mission_at_once_and_reports_the_distance() -> None:
    ended, outcome = flown(lambda t: t + (9.0 if t > 20.0 else 0.0), 0.5)
    assert ended == pytest.approx(20.0, abs=0.2)
    assert "jumped by 9.1 m" in outcome.reason
