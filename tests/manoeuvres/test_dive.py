from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from gcs_autotune.craft import Command, DepthTarget
from gcs_autotune.manoeuvres import Dive, DiveSettings, Envelope, Sequencer
from gcs_autotune.manoeuvres.dive import RAMP
from gcs_autotune.observer import SilentObserver
from gcs_autotune.trial import Trial

from .toy_craft import PondCraft, answered, at_rest


class Loop(PondCraft):
    """A depth loop with an offset of *offset* [m] and an oscillation of *swing* [m], period 8 s."""

    def __init__(self, offset: float, swing: float) -> None:
        super().__init__()
        self.offset, self.swing = offset, swing

    def _advance(self, dt: float) -> None:
        target = self.command.z if isinstance(self.command, DepthTarget) else 0.0
        aim = max(target + self.offset + self.swing * math.sin(2.0 * math.pi * self.clock.now() / 8.0), 0.0)
        self.z += dt * (aim - self.z)

    def _demand(self) -> tuple[float, float, float]:
        return 0.0, 0.3, 0.0

    def send(self, command: Command) -> None:
        self.command = command


def dive(offset: float = 0.0, swing: float = 0.0) -> Trial:
    envelope = Envelope(depth_excursion=20.0)
    return Sequencer(Loop(offset, swing), envelope, SilentObserver(), lambda trial: None).fly(Dive(DiveSettings(1.5)))


def test_a_craft_that_follows_its_depth_command_completes_the_dive_quickly() -> None:
    flown = dive()
    assert flown.ending == "completed"
    assert flown.reason == "1.5 m deep"
    assert flown.duration < 15.0


def test_an_oscillating_or_offset_depth_is_accepted_if_the_craft_stays_submerged() -> None:
    for offset, swing in ((0.0, 0.45), (0.4, 0.0), (-0.3, 0.0)):
        flown = dive(offset, swing)
        assert flown.ending == "completed", (offset, swing)
        assert flown.reason.endswith("deep enough, but the depth has not settled")


def test_a_failed_dive_reports_depth_and_thrust() -> None:
    flown = dive(offset=-1.2)
    assert flown.ending == "aborted"
    assert "is 0.3 m deep and did not reach 1.5 m within 60 s, with +0.30 of full thrust down" in flown.reason
    assert "Check buoyancy" in flown.reason


def test_a_craft_that_sinks_too_deep_is_not_reported_as_buoyant() -> None:
    flown = dive(offset=4.0)
    assert flown.ending == "aborted"
    assert "Check its buoyancy" in flown.reason
    assert "buoyant" not in flown.reason


def test_a_craft_that_oscillates_up_to_the_surface_is_rejected() -> None:
    assert dive(swing=1.6).ending == "aborted"


def dive_at(depth: Callable[[float], float], **changes: float) -> tuple[Dive, list]:
    manoeuvre = Dive(DiveSettings(4.0, **changes))
    return manoeuvre, answered(manoeuvre, lambda t, command: at_rest(t=t, z=depth(t)))


def test_the_commanded_depth_ramps_from_the_present_depth_to_the_target() -> None:
    manoeuvre, rows = dive_at(lambda t: 1.0, patience=30.0)
    assert [c.z for _, c in rows] == pytest.approx([min(4.0, 1.0 + RAMP * row.t) for row, _ in rows])
    assert rows[-1][1].z == 4.0
    assert manoeuvre.target == 4.0


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_settling_time_restarts_when_the_depth_leaves_the_band(side: float) -> None:
    manoeuvre, rows = dive_at(lambda t: 4.0 + side * (0.25 if t == 1.5 else 0.19))
    assert rows[-1][0].t == 3.5
    assert manoeuvre.outcome is not None
    assert manoeuvre.outcome.ending == "completed"


@pytest.mark.parametrize(
    ("depth", "until", "ending"),
    [
        (lambda t: 2.0, 60.5, "completed"),
        (lambda t: 0.9, 60.5, "aborted"),
        (lambda t: 5.1, 60.5, "aborted"),
        (lambda t: 2.0 if t > 45.0 else 0.5, 60.5, "completed"),
        (lambda t: 2.0 if t > 46.0 else 0.5, 60.5, "aborted"),
    ],
    ids=["long", "shallow", "deep", "just long", "too short"],
)
def test_after_the_timeout_an_unsettled_dive_completes_if_it_stayed_deep(depth, until: float, ending: str) -> None:
    manoeuvre, rows = dive_at(depth)
    assert rows[-1][0].t == until
    assert manoeuvre.outcome is not None
    assert manoeuvre.outcome.ending == ending
    assert ("not settled" in manoeuvre.outcome.reason) is (ending == "completed")
