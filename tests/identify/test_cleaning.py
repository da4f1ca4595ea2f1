"""Cleaning one channel by number: stamps that repeat, run back or come late; angles over holes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs_autotune.errors import BadFile
from gcs_autotune.identify import Doubt
from gcs_autotune.identify.signals import clean, cleaning
from gcs_autotune.identify.signals.cleaning import _breaks_off, _levels_off, clipped, unwrap
from gcs_autotune.trial import Channel


def cleaned(t: list[float], values: list[float] | None = None) -> tuple[Channel, list[str]]:
    notes: list[Doubt] = []
    numbers = np.array(values if values is not None else t)
    return clean(Channel("z", "m", np.array(t), numbers), "own", notes), [f"{n.slug}: {n.cause}" for n in notes]


@pytest.mark.parametrize(
    ("stamps", "jumps"),
    [
        ([0, 1, 2, 3, 4, 5], []),
        ([5, 6, 7, 1, 2, 3, 4], [3]),
        ([5, 6, 7, 1, 2], []),
        ([5, 6, 7, 1, 2, 8, 9], []),
        ([5, 6, 7, 1, 3, 2, 4], []),
        ([5, 6, 7, 1, 1, 1, 9], [3]),
        ([5, 6, 7, 5, 6, 7, 8], []),
        ([5, 6, 7, 1, 2, 3, 0, 1, 2], [3, 6]),
        ([5, math.nan, 6, 7, math.nan, 1, 2, 3], [5]),
        ([], []),
    ],
)
def test_a_clock_jumps_back_if_three_samples_in_a_row_are_older(stamps: list[float], jumps: list[int]) -> None:
    assert cleaning.jumps_back(np.array(stamps, dtype=np.float64)).tolist() == jumps


def test_a_channel_without_faults_is_unchanged() -> None:
    found, notes = cleaned([0.0, 1.0, 2.5], [3.0, 1.0, 2.0])
    assert (found.t.tolist(), found.values.tolist(), notes) == ([0.0, 1.0, 2.5], [3.0, 1.0, 2.0], [])
    assert len(cleaned([])[0]) == 0


def test_samples_that_are_not_numbers_are_left_out_and_counted() -> None:
    found, notes = cleaned([0.0, math.nan, 2.0, 3.0, 4.0], [0.0, 1.0, math.inf, 3.0, 4.0])
    assert (found.t.tolist(), found.values.tolist()) == ([0.0, 3.0, 4.0], [0.0, 3.0, 4.0])
    assert notes == ["missing-samples: 2 samples of z in run 'own' are not numbers"]


@pytest.mark.parametrize(("repeats", "is_told"), [(2, False), (3, True)])
def test_the_first_sample_of_a_repeated_stamp_is_kept_and_many_are_reported(repeats: int, is_told: bool) -> None:
    t = sorted([*map(float, range(100 - repeats)), *map(float, range(repeats))])
    values = [1.0 if i and t[i] == t[i - 1] else 0.0 for i in range(100)]
    found, notes = cleaned(t, values)
    assert found.t.tolist() == list(range(100 - repeats)) and not found.values.any()
    assert [n[:15] for n in notes] == ["repeated-stamps"] * is_told
    assert not notes or f": {repeats} stamps" in notes[0]


def test_columns_that_share_repeated_stamps_are_reported_together() -> None:
    t = np.repeat(np.arange(20.0), 3)
    notes: list[Doubt] = []
    for name, stamps in (("psi", t), ("r", t), ("r", t), ("delta", t[:30])):
        cleaning.clean(Channel(name, "rad", stamps, np.zeros(len(stamps))), "own", notes)
    assert [n.cause.partition(" stamps of ")[2] for n in notes] == [
        "psi, r in run 'own' are repeated",
        "delta in run 'own' are repeated",
    ]


def test_late_samples_are_sorted_and_those_far_too_late_left_out() -> None:
    t = [float(k) for k in range(60)]
    t[30], t[31], t[50] = 31.0, 30.0, 44.0
    found, notes = cleaned(t, [float(k) for k in range(60)])
    assert found.t.tolist() == [k for k in range(60) if k != 50]
    assert found.values[29:33].tolist() == [29.0, 31.0, 30.0, 32.0]
    assert 50.0 not in found.values
    assert notes == ["late-samples: 2 samples of z in run 'own' with an earlier time stamp than the sample before"]
    t[50] = 45.0
    assert len(cleaned(t)[0]) == 59, "five steps late is believed, and is then a repeated stamp"


@pytest.mark.parametrize(("late", "is_refused"), [(1, False), (5, False), (6, True)])
def test_more_than_one_in_twenty_late_samples_is_rejected(late: int, is_refused: bool) -> None:
    t = np.arange(100.0)
    for k in range(late):
        t[10 * k + 5] -= 1.5
    if is_refused:
        with pytest.raises(BadFile, match=r"the clock of run 'own' jumps back after t = 4.000 s \(channel z\)"):
            cleaned(t.tolist())
    else:
        assert len(cleaned(t.tolist())[0]) == 100
    assert len(cleaned([0.0, 1.0, 3.0, 2.0])[0]) == 4, "one is never too many"


def test_a_clock_that_jumps_back_is_rejected_with_the_time() -> None:
    with pytest.raises(BadFile, match=r"jumps back after t = 7.000 s"):
        cleaned([5.0, 6.0, 7.0, 1.0, 2.0, 3.0])


RATE = Channel("r", "rad/s", np.array([0.0, 10.0]), np.array([2.0, 2.0]))


def test_an_angle_is_continued_over_gaps_at_the_measured_or_last_rate() -> None:
    t = np.array([0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 6.5, 6.6, 6.7])
    angle = 2.0 * t
    wrapped = np.angle(np.exp(1j * angle))
    assert unwrap(t, wrapped, RATE) - wrapped[0] == pytest.approx(angle)
    assert unwrap(t, wrapped, None) - wrapped[0] == pytest.approx(angle)
    still = Channel("r", "rad/s", np.array([0.0, 10.0]), np.zeros(2))
    assert abs(unwrap(t, wrapped, still)[6] - unwrap(t, wrapped, still)[5]) < math.pi
    single = Channel("r", "rad/s", np.array([0.0]), np.array([0.9]))
    assert unwrap(t, wrapped, single) - wrapped[0] == pytest.approx(angle), "one sample tells no rate"


def test_a_gap_after_the_first_sample_is_taken_as_no_turn() -> None:
    t = np.array([0.0, 9.0, 9.1, 9.2, 9.3])
    assert unwrap(t, np.array([3.0, -3.0, -2.9, -2.8, -2.7]), None) == pytest.approx(
        [3.0, 2.0 * math.pi - 3.0, 2.0 * math.pi - 2.9, 2.0 * math.pi - 2.8, 2.0 * math.pi - 2.7]
    )
    assert unwrap(np.array([1.0]), np.array([3.0]), None).tolist() == [3.0]


def test_the_quantum_of_a_coarse_scale_is_detected() -> None:
    ramp = np.repeat(np.arange(20) * 0.25, 5)
    assert cleaning.quantum(ramp) == pytest.approx(0.25)
    assert cleaning.quantum(np.delete(ramp, slice(20, 60))) == pytest.approx(0.25)
    assert cleaning.quantum(np.random.default_rng(1).normal(size=100)) == 0.0
    assert cleaning.quantum(np.repeat([0.0, 1.0], 50)) == 0.0, "two levels tell no scale"
    assert cleaning.quantum(np.repeat([0.0, 1.0, 2.4, 3.4], 9)) == 0.0
    assert cleaning.quantum(np.array([])) == 0.0
    for about in (-2.375, -9.0):  # both signs, and none but negative ones
        assert cleaning.quantum(ramp + about) == pytest.approx(0.25)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("before", "after", "breaks_off"),
    [((0.0, 0.5), (0.5, 0.0), True), ((0.0, 0.05), (0.5, 0.0), False), ((0.0, 0.5), (0.55, 0.5), False)],
)
def test_a_plateau_entered_and_left_at_speed_is_clipped(
    sign: float, before: tuple[float, float], after: tuple[float, float], breaks_off: bool
) -> None:
    x = sign * np.array([*before, 1.0, 1.0, 1.0, *after])
    assert _breaks_off(x, 2, 3, 0.1) is breaks_off


def test_a_plateau_at_the_end_of_a_run_is_not_clipped() -> None:
    x = np.array([0.0, 0.5, 1.0, 1.0, 1.0, 0.5, 0.0])
    assert not _breaks_off(x[1:], 1, 3, 0.1)
    assert not _breaks_off(x[:-1], 2, 3, 0.1)


def test_as_many_samples_near_the_extreme_as_at_it_are_a_steady_craft() -> None:
    level = np.array([0.0, 0.5, 0.95, 0.9, 1.0, 1.0])
    assert _levels_off(level, 1.0, 0.1)
    assert _levels_off(-level, -1.0, 0.1)
    assert not _levels_off(np.append(level, 1.0), 1.0, 0.1)
    assert not _levels_off(level, 1.0, 0.09)


def test_thirty_samples_are_enough_to_detect_clipping() -> None:
    t = 0.1 * np.arange(31)
    x = np.minimum(np.sin(2.0 * t), 0.7)
    for n, seen in ((29, False), (30, True)):
        assert bool(clipped(Channel("r", "rad/s", t[:n], x[:n])).any()) is seen
