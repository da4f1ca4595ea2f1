from __future__ import annotations

import math

import pytest

from gcs_autotune.craft import Actuate
from gcs_autotune.errors import GuardTripped
from gcs_autotune.manoeuvres import Envelope, Sequencer, TurnAround, TurnAroundSettings
from gcs_autotune.observer import SilentObserver

from .toy_craft import PondCraft, answered, at_rest

FREE = Envelope(heading_excursion=math.inf)


def test_the_craft_turns_around_without_a_control_loop():
    craft = PondCraft(firmware="ardurover")
    flown = Sequencer(craft, FREE, SilentObserver(), lambda trial: None).fly(TurnAround(TurnAroundSettings(0.5)))
    assert flown.ending == "completed"
    assert abs(craft.psi) >= math.radians(165.0)
    assert craft.command == Actuate()


def test_a_boat_that_cannot_turn_is_aborted_in_time():
    craft = PondCraft(gain=0.0, firmware="ardurover")
    turn = TurnAround(TurnAroundSettings(0.5, patience=20.0))
    flown = Sequencer(craft, FREE, SilentObserver(), lambda trial: None).fly(turn)
    assert flown.ending == "stopped"
    assert "turned only 0 deg" in flown.reason


def test_distance_is_measured_from_the_start_of_the_session():
    class Drifting(PondCraft):
        def observe(self):
            seen = super().observe()
            object.__setattr__(seen, "x", 5.0 * seen.t)
            return seen

    craft = Drifting(gain=5.0, firmware="ardurover")
    sequencer = Sequencer(craft, Envelope(heading_excursion=math.inf, distance=40.0), SilentObserver(), lambda t: None)
    sequencer.fly(TurnAround(TurnAroundSettings(0.0)))
    with pytest.raises(GuardTripped, match="distance from start"):
        for _ in range(20):
            sequencer.fly(TurnAround(TurnAroundSettings(0.0)))


def test_progress_and_settings_describe_the_manoeuvre():
    turn = TurnAround(TurnAroundSettings(0.4))
    next(turn.commands(at_rest()))
    assert turn.progress(at_rest()).manoeuvre == "turn-around"
    assert turn.settings["throttle"] == 0.4
    assert list(turn.take_marks()) == []


@pytest.mark.parametrize("rate", [0.25, -0.25])
def test_the_rudder_is_held_until_the_heading_has_changed_by_the_angle(rate):
    turn = TurnAround(TurnAroundSettings(0.4, output=0.3, angle=2.0))
    rows = answered(turn, lambda t, command: at_rest(t=t, psi=1.0 + rate * t))
    assert rows[-1][0].t == 8.0
    assert {command for _, command in rows} == {Actuate(X=0.4, N=0.3)}
    assert turn.outcome.ending == "completed"


def test_the_timeout_ends_the_turn_after_the_set_time():
    turn = TurnAround(TurnAroundSettings(0.4, patience=20.0))
    assert answered(turn, lambda t, command: at_rest(t=t))[-1][0].t == 20.5
