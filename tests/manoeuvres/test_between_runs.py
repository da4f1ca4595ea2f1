"""A boat comes back to where it began, or says why not; rough water is not called calm."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs_autotune.craft import Actuate
from gcs_autotune.manoeuvres import CalmCheck, ComeBack, Envelope, PaperCraft, preview
from gcs_autotune.models import SingleDof

from .pond import at_rest

FREE = Envelope(heading_excursion=math.inf)


@pytest.mark.parametrize("bearing", [0.0, 1.5, 3.1, -2.0])
@pytest.mark.parametrize(("gain", "lag"), [(0.2, 3.3), (0.6, 0.6), (1.5, 2.0)])
def test_from_any_bearing_quick_and_slow_boats_come_back_without_weaving(
    gain: float, lag: float, bearing: float
) -> None:
    boat = PaperCraft(SingleDof("yaw", "1", lag / gain, 1.0 / gain), 1.0, "a test")
    seen = preview(ComeBack(50.0 * math.cos(bearing), 50.0 * math.sin(bearing), 0.5), boat, FREE)
    assert seen.outcome is not None
    assert seen.outcome.reason.startswith("back, 5 m from where it began")
    N = seen.trial["N"].values
    assert np.count_nonzero(np.diff(np.sign(N[np.abs(N) > 0.1]))) <= 2


def test_a_boat_without_a_position_and_one_that_makes_no_way_say_so() -> None:
    lost = ComeBack(10.0, 0.0, 0.5)
    next(lost.commands(at_rest(x=math.nan)))
    assert lost.outcome is not None
    assert "tells no position" in lost.outcome.reason
    still = preview(ComeBack(30.0, 0.0, 0.5), PaperCraft(SingleDof("yaw", "1", 1.0, 1.0), 0.0, "a test"), FREE)
    assert still.outcome is not None
    assert still.outcome.ending == "stopped"
    assert "still 30 m from where it began after 160 s" in still.outcome.reason


@pytest.mark.parametrize(("roll", "ending"), [(1.0, "completed"), (6.0, "aborted")])
def test_rolling_water_is_waited_for_and_then_refused(roll: float, ending: str) -> None:
    check = CalmCheck()
    commands = check.commands(at_rest(phi=0.0, theta=0.0))
    command = next(commands)
    for k in range(1, 700):
        if check.outcome is not None:
            break
        assert command == Actuate()
        command = commands.send(at_rest(t=0.1 * k, phi=math.radians(roll) * math.sin(0.2 * k), theta=0.0))
    assert check.outcome is not None
    assert check.outcome.ending == ending
    assert "deg" in check.outcome.reason
