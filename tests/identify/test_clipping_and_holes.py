"""The end of a range, the step of a scale, holes in an input, headings over south: on signals made by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from gcs_autotune.identify import Doubt
from gcs_autotune.identify.signals.cleaning import (
    _breaks_off,
    _in_order,
    _turn_expected,
    clipped,
    holes_of,
    noted,
    outside,
    unstuck,
    unwrap,
    within_range,
)
from gcs_autotune.identify.signals.preparation import prepare
from gcs_autotune.sensor import quantum, stuck
from gcs_autotune.trial import Channel, Trial

Array = NDArray[np.float64]


def channel(values: Array, name: str = "r", dt: float = 0.1) -> Channel:
    return Channel(name, "rad/s", dt * np.arange(len(values)), np.asarray(values, dtype=np.float64))


def triangle(most: float, count: int = 200, step: float = 0.37) -> Array:
    """A wave of straight flanks, *step* a sample, that goes no further than *most*."""
    return np.clip(np.abs((step * np.arange(count)) % 8.0 - 4.0) - 2.0, -most, most)


@pytest.mark.parametrize("name", ["r", "psi"])
def test_clipped_samples_are_left_out_and_reported_except_of_a_heading(name: str) -> None:
    x, notes = triangle(1.0), list[Doubt]()
    whole = channel(x, name)
    found = within_range(whole, "run 7", notes)
    if name == "psi":
        assert found is whole and notes == []
        return
    at_end = np.abs(x) == 1.0
    assert found.values.tolist() == x[~at_end].tolist()
    assert found.t.tolist() == whole.t[~at_end].tolist()
    (note,) = notes
    assert (note.slug, note.cause) == (
        "clipped", f"{at_end.sum()} samples of r in run 'run 7' are at the limit of the sensor's range (-1, 1 rad/s)",
    )  # fmt: skip
    free = channel(triangle(9.0))
    assert within_range(free, "run", notes) is free
    assert len(notes) == 1


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_range_may_end_on_one_side_only(side: float) -> None:
    x = side * np.minimum(triangle(9.0), 1.0)
    assert clipped(channel(x)).tolist() == (side * x == 1.0).tolist()


def test_a_sensor_slower_than_the_log_is_not_clipped() -> None:
    assert clipped(channel(triangle(1.0))).any()
    assert not clipped(channel(np.repeat(triangle(1.0), 2))).any()


@pytest.mark.parametrize("seed", [5, 61])
def test_a_speed_that_levels_off_in_a_short_record_is_not_clipped(seed: int) -> None:
    t, noise = 0.1 * np.arange(12), np.random.default_rng(seed).normal(0.0, 0.004, 48)
    relay = np.concatenate([top * (0.31 - 0.56 * np.exp(-t / 0.3)) for top in (1.0, -0.9, 0.95, -1.05)])
    assert not clipped(channel(np.round(relay + noise, 2))).any(), "two levels of the scale look fast"


def test_one_step_of_a_coarse_scale_is_not_a_speed() -> None:
    slow, quick = (np.round(triangle(1.0, step=s) / 0.125) * 0.125 for s in (0.13, 0.6))
    assert quantum(slow) == 0.125
    assert not clipped(channel(slow)).any(), "it comes and goes by one step of the scale"
    assert clipped(channel(quick)).any()


@pytest.mark.parametrize(
    ("x", "broken"),
    [
        ([0.0, 2.0, 3.0, 3.0, 3.0, 2.0, 0.0], True),
        ([0.0, 1.0, 3.0, 3.0, 3.0, 2.0, 0.0], False),
        ([0.0, 2.0, 3.0, 3.0, 3.0, 2.0, 1.0], False),
        ([3.0, 3.0, 3.0, 2.0, 0.0], False),
    ],
)
def test_a_plateau_is_clipped_if_both_flanks_are_steep_enough(x: list[float], broken: bool) -> None:
    assert _breaks_off(np.array(x), x.index(3.0), 3, 1.0) is broken


@pytest.mark.parametrize(
    ("values", "step"),
    [
        ([0.0, 0.1, 0.2] * 2, 0.1),
        ([0.0, 0.1, 0.2, 0.2, 0.1], 0.0),
        ([0.0, 0.1] * 9, 0.0),
        ([5.0] * 9, 0.0),
        ([], 0.0),
        ([0.0, 0.2, 0.3, 0.7] * 3, 0.1),
        ([0.0, 1.0, 2.015] * 3, 1.0),
        ([0.0, 1.0, 2.03] * 3, 0.0),
        ([0.0, 1.0, 2.0, 2.0 + 1.5e-6] * 3, 1.0),
        ([0.0, 1.0, 2.0, 2.0 + 3e-6] * 3, 0.0),
        ([0.01 * k for k in range(11)], 0.01),  # few repeat, but eleven levels on a grid are not due to chance
        ([0.01 * k for k in range(10)], 0.0),
    ],
)
def test_the_quantum_is_the_smallest_step_that_divides_all_others(values: list[float], step: float) -> None:
    assert quantum(np.array(values)) == pytest.approx(step)


@pytest.mark.parametrize(
    ("usual", "gap", "is_hole"), [(0.02, 0.24, False), (0.02, 0.26, True), (0.2, 1.9, False), (0.2, 2.1, True)]
)
def test_a_gap_lasts_a_quarter_second_and_ten_usual_steps(usual: float, gap: float, is_hole: bool) -> None:
    t = np.concatenate([usual * np.arange(20), usual * 19 + gap + usual * np.arange(20)])
    notes: list[Doubt] = []
    drive = Channel("N", "1", t, np.ones(40))
    found = holes_of(drive, "run 7", notes)
    begin, end = usual * 20, usual * 19 + gap
    assert found == ([(pytest.approx(begin), pytest.approx(end))] if is_hole else [])
    assert len(notes) == is_hole
    if is_hole:
        assert f"N of run 'run 7' is not recorded for {end - begin:.1f} s" in notes[0].cause
        left = outside(drive, found)
        assert len(left) == 40, "its own samples are at the edges of its holes"


def test_an_input_recorded_only_when_it_changes_has_no_gaps() -> None:
    t = np.cumsum(np.random.default_rng(1).uniform(0.05, 3.0, 60))
    assert holes_of(Channel("N", "1", t, np.ones(60)), "run", []) == []
    few = np.concatenate([0.1 * np.arange(10), 9.0 + 0.1 * np.arange(10)])
    assert holes_of(Channel("N", "1", few, np.ones(20)), "run", []) == [], "nineteen steps tell no usual one"


def test_samples_inside_a_gap_are_left_out_and_its_edges_kept() -> None:
    whole = channel(np.arange(10.0), dt=1.0)
    assert outside(whole, []) is whole
    left = outside(whole, [(2.0, 4.0), (6.5, 8.5)])
    assert left.t.tolist() == [0.0, 1.0, 2.0, 4.0, 5.0, 6.0, 9.0]
    assert left.values.tolist() == left.t.tolist()


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_heading_is_unwrapped_over_several_turns(side: float) -> None:
    t = 0.1 * np.arange(100)
    true = side * 2.5 * t
    wrapped = np.array([math.remainder(x, math.tau) for x in true])
    assert unwrap(t, wrapped, None) == pytest.approx(true)


def test_a_heading_is_continued_over_a_gap_by_its_measured_rate() -> None:
    t = np.concatenate([0.1 * np.arange(20), 5.0 + 0.1 * np.arange(20)])
    true = np.where(t < 2.0, 0.0, 7.0 + 0.1 * t)
    rate = Channel("r", "rad/s", np.array([1.9, 2.0, 4.9, 5.0]), np.array([0.0, 2.4, 2.4, 0.1]))
    wrapped = np.array([math.remainder(x, math.tau) for x in true])
    assert unwrap(t, wrapped, rate) == pytest.approx(true)
    assert _turn_expected(t, wrapped, rate, 19) == pytest.approx(7.2, abs=0.2)
    one = Channel("r", "rad/s", np.array([1.0]), np.array([9.0]))
    assert _turn_expected(t, 0.5 * t, one, 19) == pytest.approx(0.5 * 3.1), "the last rate goes on"


def test_a_sample_late_by_at_most_five_steps_is_sorted_in() -> None:
    t = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 0.5, 6.0, 0.75, 7.0])
    late = np.concatenate([[False], t[1:] < np.maximum.accumulate(t)[:-1]])
    found, values = _in_order(t, 10.0 * t, late)
    assert found.tolist() == [0.0, 0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]
    assert values.tolist() == (10.0 * found).tolist()


def test_notes_of_the_reader_of_a_run_become_doubts() -> None:
    run = Trial("run", {}, meta={"notes": [["slug", "cause", 3], ["short", "one"]]})
    assert noted(run) == [Doubt("slug", "cause", "3")]
    assert noted(Trial("run", {})) == []


def test_a_fine_sensor_that_repeats_one_value_is_stuck_and_a_coarse_one_is_not() -> None:
    t, x = 0.1 * np.arange(300), np.random.default_rng(3).normal(0.0, 0.03, 300).cumsum()
    held = np.where((t > 9.95) & (t < 14.95), x[100], x)
    assert stuck(t, held) == [(100, 149)]
    assert stuck(t, np.column_stack([x, held])) == []
    assert stuck(t, np.round(held, 1)) == []
    assert stuck(0.01 * t, held) == [], "shorter than a sensor may hold a value"


@pytest.mark.parametrize(("name", "end"), [("r", 14.9), ("psi", 14.9), ("u", 29.9)])
def test_samples_of_a_stuck_sensor_are_left_out_and_reported(name: str, end: float) -> None:
    t = 0.1 * np.arange(300)
    x = np.sin(0.7 * t) + np.random.default_rng(3).normal(0.0, 0.01, 300)
    notes = list[Doubt]()
    found = unstuck(channel(np.where((t > 9.95) & (t < end + 0.05), x[100], x), name), "run 7", notes)
    assert found.t.tolist() == [*t[:101].tolist(), *t[t > end + 0.05].tolist()]
    assert [note.slug for note in notes] == ["stuck-sensor"]
    assert f"{name} of run 'run 7' did not change from 10.0 to {end} s" in notes[0].cause


def test_a_craft_at_rest_in_a_record_without_noise_is_not_stuck() -> None:
    t = 0.1 * np.arange(300)
    x = np.where(t < 10.0, 0.0, np.where(t < 20.0, np.sin(0.314 * (t - 10.0)) ** 2, 0.0))
    whole, notes = channel(np.round(x, 6)), list[Doubt]()
    assert stuck(whole.t, whole.values)
    assert unstuck(whole, "run", notes) is whole and notes == []


def test_a_gap_of_a_stuck_sensor_is_not_blamed_on_the_radio() -> None:
    t = 0.1 * np.arange(400)
    psi = np.sin(0.7 * t) + np.random.default_rng(3).normal(0.0, 0.01, 400)
    run = Trial(
        "run 7",
        {
            "psi": Channel("psi", "rad", t, np.where((t > 9.95) & (t < 15.95), psi[100], psi)),
            "N": Channel("N", "1", t, np.sign(np.sin(0.9 * t))),
        },
    )
    notes = {note.slug: note for note in prepare(run, "yaw")[0].notes}
    assert "stuck-sensor" in notes
    assert "or a stuck sensor" in notes["gaps"].cause and "radio" not in notes["gaps"].cure
