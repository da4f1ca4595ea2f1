"""Input changes dated between two loops of the autopilot: moved where the record tells which, left where it cannot."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gcs_autotune.identify.likelihood import Limits
from gcs_autotune.identify.preparation import WITHIN_LOOP
from gcs_autotune.identify.problem import Problem
from gcs_autotune.identify.segment import Segment, Signal
from gcs_autotune.identify.simulators import ExplicitForm
from gcs_autotune.identify.solution import Solution, solve
from gcs_autotune.identify.stamp_correction import MOST, _nearest, _posterior, corrected, switches_of
from gcs_autotune.models import simulate_explicit
from gcs_autotune.sname import DOFS

FORM = ExplicitForm.of(DOFS["yaw"])
TRUE = np.array([2.0, 0.8, 0.0, 0.1, 0.0])
START = np.array([0.1, -0.2])
LOOP = 0.02


def segment(noise: float, seed: int = 1, name: str = "run") -> tuple[Segment, np.ndarray]:
    """A run whose inputs changed half a loop before or after their stamps, and by how much they did."""
    rng = np.random.default_rng(seed)
    t_in = np.arange(0.0, 16.0, 0.93)
    off = 0.5 * LOOP * rng.choice([-1.0, 1.0], len(t_in))
    off[0] = 0.0
    N = 0.5 * (-1.0) ** np.arange(len(t_in))
    t = 0.05 * np.arange(320)
    motion = simulate_explicit((*TRUE, *START), t_in + off, N, t)
    signals = {
        "psi": Signal("psi", t, motion.eta + rng.normal(0.0, noise, len(t)), 0.0),
        "r": Signal("r", t, motion.nu + rng.normal(0.0, noise, len(t)), 0.0),
    }
    slack = np.full(len(t_in), 0.5 * LOOP)
    slack[0] = 0.0
    own = Segment(name, name, t_in, N[:, None], ("N",), ("N m",), signals, dating=0.5 * LOOP, slack=slack, loop=LOOP)
    return own, off


def fitted(segments: list[Segment]) -> Solution:
    problem = Problem(FORM, segments, None, Limits({"b": 0.0, "a": 0.0}, {}), ("b", "a", "d"))
    start = np.array([1.9, 0.9, 0.0, 0.05, 0.0])
    found = solve(problem, start, [START] * len(segments), levels={"psi": 0.01, "r": 0.01})
    assert found is not None
    return found


def test_the_derivative_by_a_later_change_is_that_of_the_motion() -> None:
    own, _ = segment(0.0)
    table = switches_of(FORM, own, TRUE, START, shift=0.003)
    assert table.finite
    assert table.which.tolist() == list(range(1, len(own.t_in)))
    for column, j in enumerate(table.which):
        ways = []
        for h in (1e-5, -1e-5):
            t_in = own.t_in + 0.003
            t_in[j] += h
            ways.append(simulate_explicit((*TRUE, *START), t_in, own.tau, own.stamps))
        by = {"psi": (ways[0].eta - ways[1].eta) / 2e-5, "r": (ways[0].nu - ways[1].nu) / 2e-5}
        for name, expected in by.items():
            assert table.by[name][:, column] == pytest.approx(expected, abs=2e-3 * np.abs(expected).max())


def test_only_changes_that_are_doubtful_and_in_the_middle_of_the_run_are_tried() -> None:
    own, _ = segment(0.0)
    late = replace(own, signals={n: s.between(1.0, 10.0) for n, s in own.signals.items()})
    assert switches_of(FORM, late, TRUE, START).which.tolist() == [k for k in range(18) if 1.0 < 0.93 * k < 10.0]
    sooner, later = (switches_of(FORM, late, TRUE, START, shift).which.tolist() for shift in (-0.1, 0.1))
    assert (sooner, later) == (list(range(2, 11)), list(range(1, 11))), "where they act counts"
    few = replace(own, slack=np.where(np.arange(len(own.t_in)) == 5, 0.5 * LOOP, 0.0))
    assert switches_of(FORM, few, TRUE, START).which.tolist() == [5]
    delayed = switches_of(FORM, own, np.array([2.0, 0.8, 0.0, 0.1, 3.0]), START).which
    assert delayed.tolist() == [k for k in range(1, 18) if 0.93 * k + 3.0 < own.stamps[-1]]


def test_more_changes_than_any_relay_makes_are_not_tried() -> None:
    own, _ = segment(0.0)
    t_in = np.linspace(0.0, 15.9, MOST + 3)
    many = replace(own, t_in=t_in, inputs=np.ones((len(t_in), 1)), slack=np.full(len(t_in), 0.01))
    found = switches_of(FORM, many, TRUE, START)
    assert len(found.which) == 0
    assert found.by["psi"].shape == (320, 0)


def test_a_run_that_runs_away_tells_nothing() -> None:
    own, _ = segment(0.0)
    assert not switches_of(FORM, own, np.array([2.0, 0.8, -1e6, 0.1, 0.0]), START).finite


def test_a_precise_record_moves_every_change_to_its_own_loop_in_two_runs_at_once() -> None:
    runs = [segment(2e-4, 1, "one"), segment(2e-4, 2, "two")]
    segments = [s for s, _ in runs]
    solution = fitted(segments)
    found = corrected(segments, segments, solution)
    assert found is not None
    for after, (before, off) in zip(found, runs, strict=True):
        moved = after.t_in - before.t_in
        cleared = (before.slack > 0.0) & (after.slack == 0.0)
        assert cleared.sum() >= 15
        assert moved[cleared] == pytest.approx(off[cleared], abs=1e-9)
        assert not moved[~cleared].any()
        assert after.dating == pytest.approx(before.dating if after.slack.any() else WITHIN_LOOP * LOOP)
    assert segments[0].slack.sum() > 0.0, "the segments themselves stay"


def test_the_changes_that_are_clear_are_moved_where_others_are_not() -> None:
    own, off = segment(0.02)
    found = corrected([own], [own], fitted([own]))
    assert found is not None
    cleared = (own.slack > 0.0) & (found[0].slack == 0.0)
    assert 3 <= cleared.sum() < (own.slack > 0.0).sum()
    assert (found[0].t_in - own.t_in)[cleared] == pytest.approx(off[cleared], abs=1e-9)


def test_a_noisy_record_moves_nothing() -> None:
    own, _ = segment(0.3)
    assert corrected([own], [own], fitted([own])) is None


def test_stamps_without_doubt_and_changes_before_the_run_are_left_alone() -> None:
    own, _ = segment(2e-4)
    solution = fitted([own])
    sure = replace(own, slack=np.zeros(len(own.t_in)))
    assert corrected([sure], [sure], solution) is None
    before = replace(own, slack=np.where(np.arange(len(own.t_in)) == 0, 0.01, 0.0))
    assert corrected([before], [before], solution) is None


def test_a_shift_points_to_a_loop_when_it_is_three_standard_errors_likelier_than_the_next() -> None:
    mean, std = np.array([0.009, 0.001, -0.011, 0.012]), np.array([0.001, 0.005, 0.001, 0.02])
    found = _nearest(mean, std, np.full(4, 0.01), np.full(4, 0.02))
    assert found == pytest.approx([0.01, np.nan, -0.01, np.nan], nan_ok=True)
    # three loops within the slack; the limit itself: one more standard error decides
    places = _nearest(np.array([0.0021, 0.0189]), np.array([0.003, 0.003]), np.full(2, 0.02), np.full(2, 0.02))
    assert places == pytest.approx([0.0, 0.02])
    only = _nearest(np.array([0.0]), np.array([1e-6]), np.array([0.004]), np.array([0.02]))
    assert np.isnan(only).all(), "a single place is no choice"


@pytest.mark.parametrize("shift_std", [0.0, 1e-3])
def test_the_shifts_are_found_with_everything_fitted_left_free_and_the_common_shift_as_well_known_as_it_is(
    shift_std: float,
) -> None:
    rng = np.random.default_rng(3)
    J, S, score = rng.normal(size=(60, 3)), rng.normal(size=(60, 2)), rng.normal(size=60)
    wide = np.array([0.5, 2.0])
    solution: Any = SimpleNamespace(shift_std=shift_std)
    mean, std = _posterior(J, S, score, wide, solution)
    table = np.hstack([J, S])
    information = table.T @ table + np.diag([0.0, 0.0, shift_std**-2 if shift_std else 0.0, *wide**-2.0])
    x = np.linalg.solve(information, table.T @ score)
    rest = score - table @ x
    expected = np.sqrt(rest @ rest / 57.0 * np.diag(np.linalg.inv(information)))
    assert mean == pytest.approx(x[3:])
    assert std == pytest.approx(expected[3:])
