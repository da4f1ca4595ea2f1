"""The zig-zag: reversed at its angle, either side first, flown and previewed; aborted if the angle is not reached."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs_autotune.manoeuvres import (
    Envelope,
    NominalPlant,
    Sequencer,
    Steering,
    ZigZag,
    ZigZagSettings,
    preview,
)
from gcs_autotune.manoeuvres.zig_zag import KIND
from gcs_autotune.models import SingleDof
from gcs_autotune.observer import SilentObserver

from .toy_craft import PondCraft, answered, at_rest

FREE = Envelope(heading_excursion=math.inf)
PAPER = NominalPlant(SingleDof("yaw", "1", 1.25, 1.0), 1.0, "a test")
"""The pond's own yaw: gain 1, drag 0.8."""


def zigzag(heading: float = 20.0, side: int = 1, throttle: float = 0.0, **changes: float) -> ZigZag:
    settings = ZigZagSettings(math.radians(heading), **changes)  # type: ignore[arg-type]
    return ZigZag(settings, Steering(0.5, side, throttle))


def fly(manoeuvre: ZigZag, craft: PondCraft):
    return Sequencer(craft, FREE, SilentObserver(), lambda trial: None).fly(manoeuvre)


@pytest.mark.parametrize("side", [1, -1])
def test_the_rudder_reverses_at_the_angle_starting_on_either_side(side: int) -> None:
    flown = fly(zigzag(side=side), PondCraft())
    executes = [m for m in flown.marks if m.kind == "execute"]
    assert flown.ending == "completed"
    assert [np.sign(m.detail["N"]) for m in executes] == [side * (-1) ** k for k in range(5)]
    at = [side * (-1) ** k * math.degrees(m.detail["psi"]) for k, m in enumerate(executes[1:])]
    assert all(20.0 < angle < 25.0 for angle in at)
    assert abs(flown["psi"].values[-1] - flown["psi"].values[0]) < math.radians(5.0)


def test_an_unreached_angle_aborts_with_the_number_and_a_remedy() -> None:
    flown = fly(zigzag(60.0, patience=20.0), PondCraft(gain=0.02))
    assert flown.ending == "aborted"
    assert "60 deg required" in flown.reason
    assert "--heading" in flown.reason


def test_the_previewed_overshoot_matches_the_flown_one() -> None:
    flown = fly(zigzag(), PondCraft())
    foreseen = preview(zigzag(), PAPER, FREE)
    assert foreseen.trouble == ""
    peaks = [float(np.max(np.abs(t["psi"].values - t["psi"].values[0]))) for t in (flown, foreseen.trial)]
    assert peaks[0] == pytest.approx(peaks[1], abs=math.radians(2.0))
    assert foreseen.seconds == pytest.approx(flown.duration, rel=0.1)


def test_a_preview_reports_the_exceeded_limit_or_the_missing_turn() -> None:
    ahead = preview(zigzag(throttle=0.5), PAPER, Envelope(distance=5.0))
    assert "distance from start" in ahead.trouble
    slow = NominalPlant(SingleDof("yaw", "1", 100.0, 100.0), 1.0, "a test")
    assert "20 deg required" in preview(zigzag(), slow, FREE).trouble


@pytest.mark.parametrize("side", [1, -1])
def test_executes_are_relative_to_the_approach_heading_and_the_last_ends_on_return(side: int) -> None:
    zig = ZigZag(ZigZagSettings(0.25, executes=3, approach=2.0), Steering(0.5, side))
    track = {0.0: 0.0, 4.0: 0.25, 4.5: 0.5, 8.0: -0.25, 8.5: -0.5, 12.0: -0.25, 12.5: 0.0}

    def seen(t: float, command: object):
        last = max(k for k in track if k <= t)
        return at_rest(t=t, psi=1.0 + side * track[last])

    rows = answered(zig, seen)
    helms = {row.t: command.N for row, command in rows}
    assert [t for t in helms if helms[t] != helms.get(t - 0.5)] == [0.0, 2.0, 4.5, 8.5]
    assert [side * helms[t] for t in (0.0, 2.0, 4.5, 8.5)] == [0.0, 0.5, -0.5, 0.5]
    assert (rows[-1][0].t, zig.phase) == (12.5, "execute 3")
    assert zig.target == pytest.approx(1.0 + side * 0.25)
    assert zig.outcome is not None
    assert zig.outcome.reason == "3 executes"
    marks = zig.take_marks()
    assert [m.t for m in marks] == [2.0, 4.5, 8.5]
    assert [side * m.detail["psi"] for m in marks] == pytest.approx([0.0, 0.5, -0.5])


def test_the_duration_ends_the_zig_zag_and_the_timeout_counts_from_the_last_execute() -> None:
    timed = ZigZag(ZigZagSettings(0.25, approach=1.0, duration=9.0), Steering(0.5))
    assert answered(timed, lambda t, command: at_rest(t=t))[-1][0].t == 9.0
    assert timed.outcome is not None
    assert timed.outcome.reason == "1 executes in the available time"
    slow = ZigZag(ZigZagSettings(0.25, approach=1.0, patience=20.0), Steering(0.5))
    assert answered(slow, lambda t, command: at_rest(t=t, psi=0.01 * t))[-1][0].t == 21.5
    assert slow.outcome is not None
    assert "after execute 1 the heading changed by 11.7 deg in 20 s" in slow.outcome.reason


@pytest.mark.parametrize("still", [True, False])
def test_an_rov_holds_its_depth_only_on_request(still: bool) -> None:
    zig = ZigZag(ZigZagSettings(0.25, approach=1.0, duration=4.0), Steering(0.5, keep_still=still))
    rows = answered(zig, lambda t, command: at_rest(t=t, z=2.0 + 0.5 * (t > 0.0)))
    assert (rows[3][1].Z < -0.1) is still
    assert (rows[3][1].Z == 0.0) is not still


def test_the_throttle_stays_on_throughout() -> None:
    zig = zigzag(throttle=0.4, approach=1.0, duration=3.0)
    assert {c.X for _, c in answered(zig, lambda t, command: at_rest(t=t))} == {0.4}


@pytest.mark.parametrize(("title", "approach"), [("zig-zag 20/20 at 60 % throttle", 12.0), ("zig-zag 20/20", 2.0)])
def test_a_preset_zig_zag_spends_a_fraction_of_its_time_on_the_approach(title: str, approach: float) -> None:
    preset = next(p for p in KIND.presets if p.title == title)
    made = preset.make(100.0)
    assert isinstance(made, ZigZag)
    assert made._settings.approach == pytest.approx(approach)
    assert made._settings.heading == pytest.approx(math.radians(20.0))
    assert made._settings.patience == math.inf
    assert made._steering == Steering(1.0, throttle=0.6 if approach > 10.0 else 0.0)
