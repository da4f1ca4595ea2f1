"""A command that acts on another axis too: by hand, from the other command's own stamps or from what drives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from gcs_autotune.effects import EFFECTS, DataSummary, Drive, EffectInstance
from gcs_autotune.models import Form
from gcs_autotune.trial import Channel

ENTRY = EFFECTS["command-coupling"]
LEAKS = EffectInstance("command-coupling", "N+X", {"gain": -0.5})
YAW = Form("plain", "yaw", ("yaw",), ("N_rdot", "N_r"), {}, {"N": (("N", 1.0),)}, coriolis=False)


def data_summary(**extent: tuple[float, float]) -> DataSummary:
    seen = {"N": (-1.0, 1.0), **extent}
    return DataSummary(
        form=YAW,
        inputs={"N": "1"},
        signals={"psi": "rad"},
        amplitude={"N": 1.0},
        spread={"psi": 0.5},
        level={"psi": 0.01},
        channels=frozenset(seen),
        interval=0.1,
        time_constant=1.0,
        duration=60.0,
        extent=seen,
    )


def at(drive: Drive, times: NDArray[np.float64]) -> NDArray[np.float64]:
    found: NDArray[np.float64] = drive.channels["N"][np.maximum(np.searchsorted(drive.t, times, "right") - 1, 0)]
    return found


def test_a_command_that_is_not_an_input_is_added_at_its_own_stamps() -> None:
    other = Channel("X", "1", np.array([0.5, 1.0, 1.6, 2.0]), np.array([1.0, -2.0, np.nan, 4.0]))
    drive = Drive(np.array([0.0, 1.2]), {"N": np.array([0.3, 0.7])}, 0.0, {"X": other})
    times = np.array([0.1, 0.6, 1.1, 1.3, 1.7, 2.5])
    by_hand = np.array([0.3 - 0.5, 0.3 - 0.5, 0.3 + 1.0, 0.7 + 1.0, 0.7 + 1.0, 0.7 - 2.0])
    assert at(ENTRY.drive(LEAKS, drive), times) == pytest.approx(by_hand)


def test_an_input_command_is_added_as_it_acts_and_its_own_axis_is_unchanged() -> None:
    t, turn, push = np.array([0.0, 1.0]), np.array([0.3, 0.7]), np.array([2.0, -2.0])
    measured = Channel("X", "N", t, 9.0 * push)
    acting = ENTRY.drive(LEAKS, Drive(t, {"N": turn, "X": push}, 0.0, {"X": measured}))
    assert acting.channels["N"] == pytest.approx(turn - 0.5 * push)
    assert acting.channels["X"] == pytest.approx(push)


def test_the_coupling_applies_to_recorded_commands_that_change() -> None:
    assert ENTRY.places(data_summary()) == ()
    assert ENTRY.places(data_summary(X=(-0.5, 1.0), u=(0.0, 1.0), Z=(0.0, 0.3))) == ("N+X", "N+Z")
    assert ENTRY.places(data_summary(X=(-5e-17, 1e-16))) == (), "what a mixer's arithmetic leaves of zero"
    assert ENTRY.places(data_summary(X=(0.9, 1.0))) == (), "thrust that hardly changes acts like a constant"
    idle = replace(data_summary(X=(-0.5, 1.0)), amplitude={"N": 0.0})
    assert ENTRY.places(idle) == ()


def test_the_search_starts_at_both_signs_of_a_fraction_of_the_largest_command() -> None:
    starts = ENTRY.starts("N+X", data_summary(X=(-4.0, 2.0)))
    assert [s["gain"] * 4.0 for s in starts] == pytest.approx([0.2, -0.2])


def test_the_coupling_is_plotted_over_the_range_of_the_other_command() -> None:
    drawn = ENTRY.curve(LEAKS, data_summary(X=(0.5, 2.0)))
    assert drawn is not None
    assert (drawn.x[0], drawn.x[-1], drawn.y[-1]) == (0.0, 2.0, -1.0)
    assert drawn.x_label == "X commanded [1]", "a share, as the input that drives"


def test_a_throttle_that_is_set_once_is_not_a_candidate() -> None:
    """A boat's bias was reported as a coupling to its throttle, which was up for all but the first seconds."""
    data = data_summary(X=(0.0, 0.8))
    assert ENTRY.places(replace(data, usual={"X": (0.78, 0.8)})) == ()
    assert ENTRY.places(replace(data, usual={"X": (0.5, 0.8)})) == ("N+X",)
