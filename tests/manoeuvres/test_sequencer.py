from __future__ import annotations

import math

import pytest

from gcs_autotune.craft import Actuate, Intervention
from gcs_autotune.errors import (
    CommandDenied,
    GuardTripped,
    LinkLost,
    NotAsFound,
    OperatorStopped,
    PreconditionFailed,
    TelemetryFault,
)
from gcs_autotune.manoeuvres import Envelope, Sequencer, Step, StepSettings, restore_on_exit
from gcs_autotune.observer import SilentObserver

from .toy_craft import PondCraft

STEP = StepSettings("psi", math.radians(30.0), 15.0)


class Ear(SilentObserver):
    def __init__(self):
        self.heard = []

    def say(self, text):
        self.heard.append(text)


def flight(craft, kept, manoeuvre=None, envelope=None):
    sequencer = Sequencer(craft, envelope or Envelope(), SilentObserver(), kept.append)
    return sequencer, lambda: sequencer.fly(manoeuvre or Step(STEP), "a test")


def test_a_step_is_flown_to_its_end_with_neutral_actuators_and_its_record():
    craft, kept = PondCraft(), []
    _, fly = flight(craft, kept)
    flown = fly()
    assert flown.ending == "completed"
    assert craft.command == Actuate()
    assert craft.log == ["mode ALT_HOLD", "neutral"]
    assert [m.detail["phase"] for m in flown.marks] == ["hold", "step", "back"]
    assert kept[0].meta["size"] == pytest.approx(STEP.size)
    psi = flown["psi"]
    assert psi.values.max() == pytest.approx(STEP.size, rel=0.2)
    assert psi.values[-1] == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize("tick", range(1, 60, 7))
@pytest.mark.parametrize(
    "error", [LinkLost("gone"), OperatorStopped("enough"), TelemetryFault("NaN"), CommandDenied("no")], ids=repr
)
def test_any_interruption_sets_the_actuators_neutral_and_keeps_the_record(tick, error):
    craft, kept = PondCraft(), []
    craft.fail_at[tick] = error
    _, fly = flight(craft, kept)
    with pytest.raises(type(error)):
        fly()
    assert craft.log[-1] == "neutral"
    assert [(t.ending, t.reason) for t in kept] == [("aborted", str(error))]


def test_a_bug_in_a_manoeuvre_ends_it_neutral_with_its_record():
    class Broken(Step):
        def _tick(self, observation):
            raise ZeroDivisionError("a bug")

    craft, kept = PondCraft(), []
    _, fly = flight(craft, kept, Broken(STEP))
    with pytest.raises(ZeroDivisionError):
        fly()
    assert craft.log[-1] == "neutral"
    assert kept[0].ending == "aborted"


def test_leaving_the_envelope_ends_the_manoeuvre():
    craft, kept = PondCraft(), []
    _, fly = flight(craft, kept, envelope=Envelope(heading_excursion=math.radians(20.0)))
    with pytest.raises(GuardTripped, match="heading excursion"):
        fly()
    assert craft.log[-1] == "neutral"
    assert kept[0].ending == "aborted"


SINKING = Envelope(heading_excursion=10.0, depth_excursion=1.0)


@pytest.mark.parametrize(("firmware", "is_watched"), [("ardusub", True), ("ardurover", False)])
@pytest.mark.parametrize("rate", [0.3, -0.3], ids=["down", "up"])
def test_a_depth_excursion_ends_the_manoeuvre_of_an_rov_but_not_of_a_boat(firmware, is_watched, rate):
    class Drifting(PondCraft):
        def _advance(self, dt):
            super()._advance(dt)
            self.z += rate * dt

    craft, kept = Drifting(firmware=firmware), []
    _, fly = flight(craft, kept, envelope=SINKING)
    if not is_watched:
        assert fly().ending == "completed"
        return
    with pytest.raises(GuardTripped) as caught:
        fly()
    assert (caught.value.guard, caught.value.limit) == ("depth excursion", 1.0)
    assert str(caught.value).count(kept[-1].name) == 1, "the manoeuvre is named once"
    assert craft.log[-1] == "neutral"


def test_distance_is_measured_from_the_start_of_the_session_for_all_manoeuvres():
    craft, kept = PondCraft(), []
    sequencer, fly = flight(craft, kept, envelope=Envelope(distance=10.0))
    fly()
    craft.x = 6.0
    fly()
    craft.x = 12.0
    with pytest.raises(GuardTripped, match=r"distance from start' tripped: 12\.00 m"):
        sequencer.fly(Step(STEP))


def test_home_is_the_first_known_position():
    craft, kept = PondCraft(), []
    craft.x = math.nan
    sequencer, fly = flight(craft, kept, envelope=Envelope(distance=10.0))
    fly()
    craft.x = 100.0
    fly()
    craft.x = 111.0
    with pytest.raises(GuardTripped, match=r"distance from start' tripped: 11\.00 m"):
        sequencer.fly(Step(STEP))


def test_the_envelope_of_a_manoeuvre_replaces_that_of_the_session():
    craft, kept = PondCraft(), []
    sequencer, _ = flight(craft, kept)
    with pytest.raises(GuardTripped, match="heading excursion"):
        sequencer.fly(Step(STEP), envelope=Envelope(heading_excursion=math.radians(20.0)))


def test_nothing_is_flown_after_an_abort():
    craft, kept = PondCraft(), []
    craft.fail_at[5] = LinkLost("gone")
    sequencer, fly = flight(craft, kept)
    with pytest.raises(LinkLost):
        fly()
    with pytest.raises(PreconditionFailed, match="gone"):
        sequencer.fly(Step(STEP))
    assert len(kept) == 1


def test_an_error_keeps_its_type_when_neutral_cannot_be_confirmed():
    craft, kept, ear = PondCraft(), [], Ear()
    craft.fail_at[9] = TelemetryFault("frozen")
    craft.fail_neutral = LinkLost("gone")
    with pytest.raises(TelemetryFault):
        Sequencer(craft, Envelope(), ear, kept.append).fly(Step(STEP))
    assert any("could not be confirmed" in text for text in ear.heard)
    assert kept[0].ending == "aborted"


def test_mode_and_armed_state_are_restored_on_exit():
    craft = PondCraft()
    with restore_on_exit(craft, SilentObserver()):
        craft.arm()
        craft.set_mode("MANUAL")
    assert (craft.mode, craft.armed) == ("STABILIZE", False)
    assert craft.log[-4:] == ["neutral", "disarm", "mode STABILIZE", "release"]


def test_a_craft_armed_at_the_start_stays_armed():
    craft = PondCraft()
    craft.armed = True
    with restore_on_exit(craft, SilentObserver()):
        craft.set_mode("MANUAL")
    assert craft.armed


def test_a_craft_that_disarmed_itself_is_not_rearmed_and_this_is_reported():
    craft, ear = PondCraft(), Ear()
    craft.armed = True
    with restore_on_exit(craft, ear):
        craft.armed = False
    assert not craft.armed
    assert any("disarmed it" in text for text in ear.heard)
    assert not any("armed state restored" in text for text in ear.heard)


@pytest.mark.parametrize(
    ("failsafe", "reported", "stated"),
    [
        ("", False, ": changed. This tool does not change"),
        ("radio failsafe", False, ". Another station or the autopilot's radio failsafe made this change. "),
        ("radio failsafe", True, ". The autopilot's radio failsafe made this change. "),
    ],
)
def test_a_mode_that_stays_is_stated_with_who_set_it(failsafe, reported, stated):
    craft, ear = PondCraft(), Ear()
    change = Intervention("changed", mode_stands=True, armed_stands=False, failsafe=failsafe, has_reported=reported)
    with restore_on_exit(craft, ear):
        craft.mode = "HOLD"
        craft.interventions.append(change)
    left = next(text for text in ear.heard if text.startswith("left in mode HOLD"))
    assert stated in left and left.endswith("This tool does not change mode or armed state again")


def test_an_operator_stop_does_not_interrupt_the_restoration():
    craft = PondCraft()
    with pytest.raises(OperatorStopped), restore_on_exit(craft, SilentObserver()):
        craft.arm()
        craft.stop_wanted = True
        craft.observe()
    assert not craft.armed


def test_values_that_could_not_be_restored_are_reported():
    craft = PondCraft()

    def refuse():
        raise CommandDenied("still moving")

    with (
        pytest.raises(NotAsFound, match="armed state: still moving") as caught,
        restore_on_exit(craft, SilentObserver()),
    ):
        craft.arm()
        craft.disarm = refuse
    assert caught.value.differences == {"armed state": "still moving"}
    assert craft.mode == "STABILIZE"


@pytest.mark.parametrize(
    "error",
    [OperatorStopped("enough"), LinkLost("gone"), GuardTripped("too far"), ZeroDivisionError("a bug")],
    ids=repr,
)
def test_a_failed_restoration_after_an_abort_leaves_the_journal_open(error):
    """Two failures at once: `restore` reads the journal, so the entry must stay open."""
    craft, settled = PondCraft(), []
    mode = craft.set_mode

    def deny_restoring(requested):
        if requested == "STABILIZE":
            raise CommandDenied("mode refused")
        mode(requested)

    with (
        pytest.raises(NotAsFound, match=r"Afterwards the vehicle could not be restored: mode: mode refused") as caught,
        restore_on_exit(craft, SilentObserver(), lambda: settled.append(True)),
    ):
        craft.arm()
        craft.set_mode("ALT_HOLD")
        craft.set_mode = deny_restoring
        raise error
    assert settled == []
    assert caught.value.__cause__ is error
    assert str(error) in str(caught.value)
    assert caught.value.differences == {"mode": "mode refused"}
    assert not craft.armed


def test_a_restored_abort_closes_the_journal_and_keeps_the_error():
    craft, settled = PondCraft(), []
    with (
        pytest.raises(GuardTripped, match="too far"),
        restore_on_exit(craft, SilentObserver(), lambda: settled.append(True)),
    ):
        craft.arm()
        raise GuardTripped("too far")
    assert settled == [True]
    assert (craft.mode, craft.armed) == ("STABILIZE", False)


def test_a_link_lost_during_restoration_is_one_difference_and_ends_the_attempts():
    craft, settled = PondCraft(), []
    with (
        pytest.raises(NotAsFound) as caught,
        restore_on_exit(craft, SilentObserver(), lambda: settled.append(True)),
    ):
        craft.arm()
        craft.fail_neutral = LinkLost("gone")
    assert caught.value.differences == {"actuators": "gone"}
    assert settled == []
    assert craft.log == ["arm"]


@pytest.mark.parametrize("times", [1, 9])
def test_a_mode_undone_by_a_late_duplicate_command_is_restored_again(times):
    class Twice(PondCraft):
        left = times

        def await_heartbeat(self):
            self.mode = "MANUAL" if self.left > 0 else self.mode
            self.left -= 1

    craft, settled = Twice(), []
    if times == 1:
        with restore_on_exit(craft, SilentObserver(), lambda: settled.append(craft.mode)):
            craft.set_mode("ALT_HOLD")
        assert settled == ["STABILIZE"]
        return
    with (
        pytest.raises(NotAsFound, match="still MANUAL and disarmed"),
        restore_on_exit(craft, SilentObserver(), lambda: settled.append(craft.mode)),
    ):
        craft.set_mode("ALT_HOLD")
    assert settled == []


def test_a_diverging_loop_stops_the_step():
    class Wild(PondCraft):
        def _demand(self):
            return (1.0, 0.0, 0.0)

    craft, kept = Wild(), []
    _, fly = flight(craft, kept, envelope=Envelope(heading_excursion=10.0))
    flown = fly()
    assert flown.ending == "stopped"
    assert "departs from its target" in flown.reason
