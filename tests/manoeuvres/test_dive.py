from __future__ import annotations

import math

from gcs_autotune.craft import Command, DepthTarget
from gcs_autotune.manoeuvres import Dive, DiveSettings, Envelope, Flown, Sequencer
from gcs_autotune.watch import SilentWatcher

from .pond import PondCraft


class Loop(PondCraft):
    """A depth loop that holds *offset* [m] beside what it is told, and swings *swing* [m] about it every 8 s."""

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


def dive(offset: float = 0.0, swing: float = 0.0) -> Flown:
    envelope = Envelope(depth_excursion=20.0)
    return Sequencer(Loop(offset, swing), envelope, SilentWatcher(), lambda trial: None).fly(Dive(DiveSettings(1.5)))


def test_a_craft_that_follows_is_there_at_once() -> None:
    flown = dive()
    assert flown.outcome.ending == "completed"
    assert flown.outcome.reason == "1.5 m deep"
    assert flown.trial.duration < 15.0


def test_one_whose_loop_swings_or_holds_another_depth_is_deep_enough_when_it_stays_off_the_surface() -> None:
    for offset, swing in ((0.0, 0.45), (0.4, 0.0), (-0.3, 0.0)):
        flown = dive(offset, swing)
        assert flown.outcome.ending == "completed", (offset, swing)
        assert flown.outcome.reason.endswith("deep enough, though it does not settle")


def test_one_that_stays_up_is_said_to_with_what_its_thrusters_do() -> None:
    flown = dive(offset=-1.2)
    assert flown.outcome.ending == "aborted"
    assert (
        "is 0.3 m deep and does not come to 1.5 m within 60 s, with +0.30 of full thrust down" in flown.outcome.reason
    )
    assert "too buoyant" in flown.outcome.reason


def test_one_that_sinks_beyond_is_not_said_to_be_buoyant() -> None:
    flown = dive(offset=4.0)
    assert flown.outcome.ending == "aborted"
    assert "does it sink by itself" in flown.outcome.reason
    assert "buoyant" not in flown.outcome.reason


def test_one_that_swings_up_to_the_surface_is_refused() -> None:
    assert dive(swing=1.6).outcome.ending == "aborted"
