"""A silence of some seconds pauses a tune, which then continues; a longer one ends it, everything restored."""

from __future__ import annotations

import json
from typing import Any

import pytest

from gcs_autotune.errors import AutotuneError, LinkLost, OperatorStopped
from gcs_autotune.observer import SilentObserver
from gcs_autotune.trial import Trial
from gcs_autotune.workflow.tune_log import TuneLog

from .sitl_harness import SitlHarness

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("plainly")]


class Hushed(SitlHarness):
    """A vehicle that neither sends nor receives for ``silence`` [s], from ``after`` [s] into *stage* on."""

    def __init__(self, tmp_path: Any, stage: str, after: float, silence: float, **options: Any) -> None:
        self.stage, self.after, self.silence, self.begun = stage, after, silence, float("inf")
        super().__init__(tmp_path, meddling=self.hush, **options)

    def hush(self, t: float, message: Any) -> list[Any]:
        if self.begun > t and self.stage in self.said:
            self.begun = min(self.begun, t)
        quiet = self.begun + self.after <= t < self.begun + self.after + self.silence
        self.peer.deaf = quiet
        return [] if quiet else [message]


class Enough:
    """An operator who has seen enough as soon as *words* have been announced."""

    def __init__(self, harness: SitlHarness, words: str, declined: str = "nothing") -> None:
        self.harness, self.words, self.declined = harness, words, declined
        self.asked: list[str] = []

    def stop_requested(self) -> bool:
        return any(text.startswith(self.words) for text in self.harness.said)

    def ask(self, question: str, while_waiting: Any) -> bool:
        self.asked.append(question)
        return self.declined not in question


def test_a_silence_during_a_relay_pauses_the_tune_and_the_relay_is_flown_again(tmp_path: Any) -> None:
    harness = Hushed(tmp_path, "first self-oscillation", 25.0, 9.0)
    operator = Enough(harness, "relay-1: completed")
    with pytest.raises(OperatorStopped):
        harness.tune(operator)
    assert [q for q in operator.asked if "Leave HOLD again and continue?" in q]
    again = [text for text in harness.said if text.startswith("continuing:")]
    assert again == ["continuing: first self-oscillation is flown again from its start"]
    kept = sorted(path.name for path in (harness.directory / "trials").glob("*-relay-1.json"))
    endings = [json.loads((harness.directory / "trials" / name).read_text())["ending"] for name in kept]
    assert endings == ["aborted", "completed"]  # the interrupted one is on disk too
    harness.assert_as_found()


def test_an_rov_that_disarmed_in_a_silence_is_armed_again_after_asking(tmp_path: Any) -> None:
    harness = Hushed(tmp_path, "step with present gains", 10.0, 12.0, name="videoray")
    operator = Enough(harness, "step-before: completed")
    with pytest.raises(OperatorStopped):
        harness.tune(operator, axis="depth", simulated=False)
    announced = "\n".join(harness.said)
    assert "continuing: step with present gains is flown again" in announced
    assert "arm the vehicle again if it was disarmed, after asking" in announced
    assert [q for q in operator.asked if "Arm the vehicle again" in q]
    assert "arming the vehicle again, as announced" in announced
    harness.assert_as_found()


def test_a_vehicle_disarmed_in_a_silence_stays_disarmed_when_the_operator_declines(tmp_path: Any) -> None:
    harness = Hushed(tmp_path, "step with present gains", 10.0, 12.0, name="videoray")
    operator = Enough(harness, "step-before: completed", declined="Arm the vehicle again")
    with pytest.raises(AutotuneError):
        harness.tune(operator, axis="depth", simulated=False)
    assert [q for q in operator.asked if "Arm the vehicle again" in q]
    assert not any("arming the vehicle again" in text for text in harness.said)
    harness.assert_as_found()


def test_the_page_shows_the_repeated_trial_not_the_interrupted_one(tmp_path: Any) -> None:
    log = TuneLog(SitlHarness(tmp_path).settings(), "now", SilentObserver())
    for ending in ("aborted", "completed"):
        log.flown(Trial("step-before", {}, ending=ending))
    shown = log.story().step_before
    assert shown is not None and shown.ending == "completed"


def test_a_failsafe_during_a_silence_is_not_undone_without_an_operator_to_ask(tmp_path: Any) -> None:
    """``--yes`` is given beforehand, and in a silence another station may have ordered the same."""
    harness = Hushed(tmp_path, "first self-oscillation", 25.0, 9.0)
    with pytest.raises(LinkLost):
        harness.tune()
    assert any("no (--yes: no operator to ask)" in text for text in harness.said)
    assert not any(text.startswith("continuing:") for text in harness.said)
    assert harness.mode == "HOLD"
    harness.assert_as_found()


class HeldInSilence(Hushed):
    """Three seconds into the silence another station orders a mode; the vehicle answers that station alone."""

    mode_ordered = 1

    def hush(self, t: float, message: Any) -> list[Any]:
        passed = super().hush(t, message)
        if self.begun + self.after + 3.0 <= t < self.begun + self.after + 4.0:
            self.vehicle.autopilot.set_mode(self.mode_ordered)
        return passed


def test_an_order_given_during_a_silence_stays_in_force(tmp_path: Any) -> None:
    harness = HeldInSilence(tmp_path, "first self-oscillation", 25.0, 9.0)
    with pytest.raises(AutotuneError):
        harness.tune(Enough(harness, "relay-1: completed"))
    assert harness.mode == "ACRO"
    assert any(
        "from MANUAL to ACRO, not by this tool" in text
        and "This tool does not change mode or armed state again" in text
        for text in harness.said
    )


@pytest.mark.parametrize(("patience", "silence"), [(0.0, 9.0), (12.0, 20.0)])
def test_a_silence_longer_than_permitted_ends_the_tune_and_everything_is_restored(
    tmp_path: Any, patience: float, silence: float
) -> None:
    harness = Hushed(tmp_path, "step with present gains", 10.0, silence)
    with pytest.raises(LinkLost):
        harness.tune(dry_run=True, patience=patience)
    assert not any(text.startswith("continuing:") for text in harness.said)
    harness.assert_as_found()
