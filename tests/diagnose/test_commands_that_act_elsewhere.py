"""Another axis' command that turns the craft: found in yaw alone from the record of it, and not where there is none."""

from __future__ import annotations

import pytest
from open_loop_runs import sailed

from gcs_autotune.diagnose import diagnose

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(("seed", "gain"), [(1, -0.15), (2, 0.1), (3, 0.05)])
def test_thrust_ahead_that_turns_the_craft_is_identified_with_its_gain(seed: int, gain: float) -> None:
    result = diagnose(sailed(("command-coupling", "N+X", {"gain": gain}), seed=seed), dof="yaw")
    assert [(c.effect.slug, c.effect.place) for c in result.causes] == [("command-coupling", "N+X")]
    found = result.causes[0].parameters["gain"]
    assert abs(found.value - gain) < 4.0 * found.std < 0.2 * abs(gain)


def test_thrust_ahead_that_does_not_turn_the_craft_is_not_reported() -> None:
    assert diagnose(sailed(seed=4), dof="yaw").causes == ()
