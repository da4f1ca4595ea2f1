"""Free decay: the rest before it, the push that starts it, and when it ends."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from gcs_autotune.craft import Actuate, Observation
from gcs_autotune.errors import UsageError
from gcs_autotune.manoeuvres import MANOEUVRES, Envelope, Sequencer
from gcs_autotune.manoeuvres.free_decay import KIND, FreeDecay
from gcs_autotune.observer import SilentObserver

from .toy_craft import PondCraft, answered, at_rest

LIST = 0.08
"""It lies with a list, which is the mean of the samples of its first three seconds."""
WAYS = [("K", "phi", "roll"), ("M", "theta", "pitch")]


def tilted(force: str, swing: Callable[[float], float], duration: float = 60.0) -> tuple[FreeDecay, list]:
    """Fly a craft that rolls by ``swing(t)`` [rad] about its list."""
    signal = {"K": "phi", "M": "theta"}[force]

    def seen(t: float, command: object) -> Observation:
        noise = 0.0 if t >= 3.0 else 0.02 * (-1.0) ** round(2.0 * t)
        return at_rest(t=100.0 + t, **{signal: LIST + noise + swing(t)})

    manoeuvre = FreeDecay(force, duration)
    return manoeuvre, answered(manoeuvre, seen)


@pytest.mark.parametrize(("force", "signal", "dof"), WAYS)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_decay_is_measured_from_the_rest_angle_and_ends_when_it_has_died_away(
    force: str, signal: str, dof: str, side: float
) -> None:
    sizes = {10.0: 0.2, 11.0: 0.3, 12.0: 0.032, 14.5: 0.028}
    manoeuvre, rows = tilted(force, lambda t: side * next((v for k, v in reversed(sizes.items()) if t >= k), 0.0))
    assert rows[-1][0].t == 114.0 + 3.0
    assert manoeuvre.outcome is not None
    assert (manoeuvre.outcome.ending, manoeuvre.outcome.reason) == ("completed", "decay from 17 deg recorded for 7 s")
    assert {command for _, command in rows} == {Actuate()}
    (mark,) = manoeuvre.take_marks()
    assert (mark.t, mark.kind, mark.detail) == (110.0, "push", {signal: pytest.approx(side * 0.2)})
    assert manoeuvre.meta_fields == {
        "dof": dof, "force": force, "signal": signal, "rest": pytest.approx(LIST), "duration": 60.0,
    }  # fmt: skip
    assert manoeuvre.target == pytest.approx(LIST)
    assert manoeuvre.phase == "swinging"


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("degrees", "ending"), [(4.9, "aborted"), (5.1, "completed")])
def test_only_a_push_above_the_threshold_counts_and_the_wait_for_it_is_limited(
    side: float, degrees: float, ending: str
) -> None:
    manoeuvre, rows = tilted("K", lambda t: side * math.radians(degrees) * (t >= 10.0), duration=8.0)
    assert manoeuvre.outcome is not None
    assert manoeuvre.outcome.ending == ending
    assert rows[-1][0].t == (223.5 if ending == "aborted" else 118.0)
    assert len(manoeuvre.take_marks()) == (ending == "completed")
    assert ("no push within 120 s: phi stayed at rest" in manoeuvre.outcome.reason) is (degrees < 5.0)


def test_thresholds_of_push_and_decay_are_exclusive() -> None:
    manoeuvre = FreeDecay("K", 20.0)
    sizes = {5.0: math.radians(5.0), 10.0: 0.5, 11.0: 0.1 * 0.5}
    rows = answered(
        manoeuvre, lambda t, command: at_rest(t=t, phi=next((v for k, v in reversed(sizes.items()) if t >= k), 0.0))
    )
    assert [m.t for m in manoeuvre.take_marks()] == [10.0]
    assert rows[-1][0].t == 10.5 + 3.0


def test_each_phase_shows_its_instruction_to_the_operator() -> None:
    manoeuvre, phases = FreeDecay("K", 8.0), {}

    def seen(t: float, command: object) -> Observation:
        phases[t - 0.5] = manoeuvre.phase
        return at_rest(t=t, phi=0.3 * (t >= 10.0))

    answered(manoeuvre, seen)
    assert (phases[0.0], phases[3.0], phases[10.0]) == (
        *("at rest: do not touch the craft", "push the craft down and release it", "swinging"),
    )


def test_an_unknown_angle_is_not_a_push() -> None:
    manoeuvre = FreeDecay("K", 8.0)
    answered(manoeuvre, lambda t, command: at_rest(t=t, phi=0.0 if t < 5.0 else math.nan))
    assert manoeuvre.outcome is not None
    assert manoeuvre.outcome.ending == "aborted"


@pytest.mark.parametrize(("force", "signal", "dof"), WAYS)
def test_its_table_row_excites_roll_or_pitch_and_drives_no_force(force: str, signal: str, dof: str) -> None:
    row = KIND.of(force)
    assert (row.excites, row.drives, row.options) == ({dof}, frozenset(), ("duration",))
    assert row.turns and not row.identifies
    assert row.make is not None
    made = row.make({"duration": 20.0})
    assert (made.force, made.meta_fields["duration"], made.by_hand, made.purpose) == (force, 20.0, True, "check")
    assert row.of("").drives == row.drives
    for other in "XYZN":
        with pytest.raises(UsageError, match=f"{other} fly free-decay"):
            row.of(other)


def test_free_decay_is_in_roll_by_default() -> None:
    assert KIND.excites == {"roll"}
    assert KIND.of("") is KIND


@pytest.mark.parametrize(("force", "signal"), [("K", "phi"), ("M", "theta")])
def test_the_record_of_a_release_begins_when_the_output_is_nearly_constant(force: str, signal: str) -> None:
    kind = MANOEUVRES["free-decay"].of(force)
    assert kind.make is not None
    release = kind.make({"side": 1.0, "tilt": math.radians(10.0), "duration": 10.0})
    kept = Sequencer(PondCraft(), Envelope(), SilentObserver(), lambda trial: None).fly(release)
    (released,) = (mark.t for mark in kept.marks)
    assert kept.start == pytest.approx(released - 1.0, abs=0.11)
    assert np.ptp(kept[signal].between(kept.start, released).values) < 0.2 * math.radians(10.0)
