"""Errors during a flight: one sentence, everything restored, the record kept."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from gcs_autotune.errors import AutotuneError, NotAchieved, PreconditionFailed
from gcs_autotune.logs import load_runs
from gcs_autotune.manoeuvres import Envelope
from sitl import make_effect

from .sitl_harness import SLOW_LOOP, SitlHarness
from .test_fly import PAIR, flown


def ended(harness: SitlHarness, error: type[AutotuneError], words: str, name: str, *args: Any, **more: Any) -> None:
    """Fly *name*; it ends by *error* with *words*, the vehicle is restored, the record exists and is marked aborted."""
    with pytest.raises(error, match=words) as caught:
        flown(harness, *args, name=name, **more)
    assert "\n" not in str(caught.value)
    harness.assert_restored()
    (last,) = [run for run in load_runs(harness.directory) if run.name == name]
    assert last.ending == "aborted"


def test_a_spiral_without_enough_space_is_refused_before_arming_with_a_feasible_limit(tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path, "blueboat")
    with pytest.raises(PreconditionFailed, match=r"spiral needs (\d+) m, .* is 20 m.* --max-distance \1,"):
        flown(harness, {"steering": 0.3}, name="spiral", envelope=Envelope(distance=20.0))
    assert not any(text.startswith(("will ", "State before the run: mode")) for text in harness.said)
    assert not harness.vehicle.autopilot.armed


@pytest.mark.slow
def test_a_stalling_rudder_ends_the_zig_zag_with_the_advice_to_use_less(tmp_path: Path) -> None:
    stalls = make_effect("rudder-stall", "yaw", {"angle": 0.25, "drop": 1.0})
    harness = SitlHarness(tmp_path, effects=[stalls])
    ended(harness, NotAchieved, r"20 deg required.*\(.*less if it stalls\)", "zig-zag", {**PAIR, "rudder": 0.5})


def test_a_rangefinder_lost_in_flight_ends_the_wall_relay(tmp_path: Path) -> None:
    def blind(t: float, message: Any) -> list[Any]:
        return [] if message.get_type() == "DISTANCE_SENSOR" and t > 40.0 else [message]

    harness = SitlHarness(tmp_path, "videoray-wall", meddling=blind, **SLOW_LOOP)
    ended(harness, NotAchieved, "stopped reporting the distance ahead", "wall-relay", {"wall-hysteresis": 0.1})
