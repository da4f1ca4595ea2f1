"""Manoeuvres that come to no good end while this computer paused."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from gcs_autotune.errors import PreconditionFailed
from gcs_autotune.manoeuvres import Envelope
from gcs_autotune.trial import Trial
from gcs_autotune.workflow.runner import ManoeuvreRunner

MANOEUVRE: Any = SimpleNamespace(name="sign-check", purpose="check", in_manual=True)
SLOW = Trial("run", {}, ending="aborted", reason="it makes only 0.57 m/s")
FINE = Trial("run", {}, ending="completed", reason="it answers")


def runner_of(pauses: list[float], flown: list[Trial], announced: list[str]) -> ManoeuvreRunner:
    """A runner whose manoeuvres end so in turn, this computer having paused so long [s] in each."""
    clock = SimpleNamespace(now=lambda: 0.0)
    craft: Any = SimpleNamespace(clock=clock, armed=True, longest_pause=lambda since: pauses.pop(0))
    runner = ManoeuvreRunner(craft, Envelope(), SimpleNamespace(say=announced.append), lambda trial: None)  # type: ignore[arg-type]
    sequencer: Any = runner._sequencer
    sequencer.fly = lambda manoeuvre, stage, envelope: flown.pop(0)
    return runner


def test_a_manoeuvre_that_fails_during_our_pause_is_flown_again() -> None:
    announced: list[str] = []
    flown = runner_of([0.9], [SLOW, FINE], announced).attempt(MANOEUVRE, "sign check")
    assert flown is FINE
    assert announced[0].startswith("it makes only 0.57 m/s. ")
    assert "this computer paused for 0.9 s without sending commands" in announced[0]
    assert announced[1] == "continuing: sign check is flown again from its start"


def test_repeated_pauses_are_reported_as_the_cause() -> None:
    with pytest.raises(PreconditionFailed, match=r"0\.57 m/s\. .*this computer paused for 0\.7 s .* faster computer"):
        runner_of([0.7] * 3, [SLOW] * 3, []).attempt(MANOEUVRE, "sign check")


def test_a_failure_without_a_pause_is_returned_unchanged() -> None:
    announced: list[str] = []
    assert runner_of([0.1], [SLOW], announced).attempt(MANOEUVRE, "sign check") is SLOW
    assert not announced
