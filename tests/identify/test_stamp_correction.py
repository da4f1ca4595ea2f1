"""Input changes dated between two loops of the autopilot: moved if the record shows which, otherwise left."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gcs_autotune.identify.axis.form import ExplicitForm
from gcs_autotune.identify.problems import stamp_correction
from gcs_autotune.identify.problems.likelihood import Limits
from gcs_autotune.identify.problems.problem import Problem
from gcs_autotune.identify.problems.solution import Solution, solve
from gcs_autotune.identify.problems.stamp_correction import MOST, Switches, _nearest, _posterior, corrected, switches_of
from gcs_autotune.identify.signals.preparation import WITHIN_LOOP
from gcs_autotune.identify.signals.segment import Segment, Signal
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


def test_the_derivative_by_the_time_of_a_change_is_that_of_the_motion() -> None:
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


def test_only_changes_with_doubtful_stamps_inside_the_run_are_tried() -> None:
    own, _ = segment(0.0)
    late = replace(own, signals={n: s.between(1.0, 10.0) for n, s in own.signals.items()})
    assert switches_of(FORM, late, TRUE, START).which.tolist() == [k for k in range(18) if 1.0 < 0.93 * k < 10.0]
    sooner, later = (switches_of(FORM, late, TRUE, START, shift).which.tolist() for shift in (-0.1, 0.1))
    assert (sooner, later) == (list(range(2, 11)), list(range(1, 11))), "where they act counts"
    few = replace(own, slack=np.where(np.arange(len(own.t_in)) == 5, 0.5 * LOOP, 0.0))
    assert switches_of(FORM, few, TRUE, START).which.tolist() == [5]
    delayed = switches_of(FORM, own, np.array([2.0, 0.8, 0.0, 0.1, 3.0]), START).which
    assert delayed.tolist() == [k for k in range(1, 18) if 0.93 * k + 3.0 < own.stamps[-1]]


def test_more_changes_than_the_limit_are_not_tried() -> None:
    own, _ = segment(0.0)
    t_in = np.linspace(0.0, 15.9, MOST + 3)
    many = replace(own, t_in=t_in, inputs=np.ones((len(t_in), 1)), slack=np.full(len(t_in), 0.01))
    found = switches_of(FORM, many, TRUE, START)
    assert len(found.which) == 0
    assert found.by["psi"].shape == (320, 0)


def test_a_diverging_run_has_no_finite_derivatives() -> None:
    own, _ = segment(0.0)
    assert not switches_of(FORM, own, np.array([2.0, 0.8, -1e6, 0.1, 0.0]), START).finite


def test_a_precise_record_moves_every_change_of_two_runs_to_its_own_loop() -> None:
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


def test_only_the_clear_changes_are_moved() -> None:
    own, off = segment(0.02)
    found = corrected([own], [own], fitted([own]))
    assert found is not None
    cleared = (own.slack > 0.0) & (found[0].slack == 0.0)
    assert 3 <= cleared.sum() < (own.slack > 0.0).sum()
    assert (found[0].t_in - own.t_in)[cleared] == pytest.approx(off[cleared], abs=1e-9)


def test_a_noisy_record_moves_nothing() -> None:
    own, _ = segment(0.3)
    assert corrected([own], [own], fitted([own])) is None


def test_exact_stamps_and_changes_before_the_run_are_not_moved() -> None:
    own, _ = segment(2e-4)
    solution = fitted([own])
    sure = replace(own, slack=np.zeros(len(own.t_in)))
    assert corrected([sure], [sure], solution) is None
    before = replace(own, slack=np.where(np.arange(len(own.t_in)) == 0, 0.01, 0.0))
    assert corrected([before], [before], solution) is None


def test_a_shift_is_assigned_to_a_loop_if_three_standard_errors_clearer_than_the_next() -> None:
    mean, std = np.array([0.009, 0.001, -0.011, 0.012]), np.array([0.001, 0.005, 0.001, 0.02])
    found = _nearest(mean, std, np.full(4, 0.01), np.full(4, 0.02))
    assert found == pytest.approx([0.01, np.nan, -0.01, np.nan], nan_ok=True)
    # three loops within the slack; the limit itself: one more standard error decides
    places = _nearest(np.array([0.0021, 0.0189]), np.array([0.003, 0.003]), np.full(2, 0.02), np.full(2, 0.02))
    assert places == pytest.approx([0.0, 0.02])
    only = _nearest(np.array([0.0]), np.array([1e-6]), np.array([0.004]), np.array([0.02]))
    assert np.isnan(only).all(), "a single place is no choice"
    # loops at -10 and 5 ms: half-way between them nothing is clear
    halfway = _nearest(np.array([-0.0025, 0.005]), np.full(2, 0.001), np.full(2, 0.01), np.full(2, 0.015))
    assert halfway == pytest.approx([np.nan, 0.005], nan_ok=True)
    just = _nearest(np.array([-1.5, -1.5]), np.array([1.0, 0.99]), np.full(2, 1.5), np.full(2, 3.0))
    assert just == pytest.approx([np.nan, -1.5], nan_ok=True), "three standard errors and a little"


@pytest.mark.parametrize("rows", [4, 60])
@pytest.mark.parametrize("shift_std", [0.0, 1e-3])
def test_the_shifts_are_estimated_jointly_with_the_parameters_and_the_prior_of_the_common_shift(
    shift_std: float, rows: int
) -> None:
    rng = np.random.default_rng(3)
    J, S, score = rng.normal(size=(rows, 3)), rng.normal(size=(rows, 2)), rng.normal(size=rows)
    wide = np.array([0.5, 2.0])
    prior = np.array([0.0, 0.0, shift_std**-2 if shift_std else 0.0])
    solution: Any = SimpleNamespace(prior=prior)
    mean, std = _posterior(J, S, score, wide, solution)
    table = np.hstack([J, S])
    information = table.T @ table + np.diag([*prior, *wide**-2.0])
    x = np.linalg.solve(information, table.T @ score)
    rest = score - table @ x
    expected = np.sqrt(rest @ rest / (rows - 3) * np.diag(np.linalg.inv(information)))
    assert mean == pytest.approx(x[3:])
    assert std == pytest.approx(expected[3:])


class Summing:
    """A simulator whose signals are the sum of all times of change, ten times that, and what it was asked for."""

    def __init__(self, lost: tuple[int, ...] = ()) -> None:
        self.lost, self.calls = lost, 0

    def __call__(self, form: Any, *rest: Any, dated: bool, **options: Any) -> Summing:
        assert not dated
        return self

    def predict(
        self, theta: Any, effects: Any, initial: Any, own: Segment, shift: float, *, sensitivities: bool
    ) -> Any:
        assert not sensitivities
        self.calls += 1
        if self.calls - 1 in self.lost:
            return None
        total = float(np.sum(own.t_in))
        return {n: (k * total * np.ones(len(s.t)), None) for k, (n, s) in enumerate(own.signals.items(), start=1)}


BARE: Any = SimpleNamespace(parameters=("a", "b"))


def stamped(*t_in: float, first: float = 1.0, last: float = 3.0) -> Segment:
    """A run from *first* to *last* s, of two signals, with changes at *t_in* that are all doubtful."""
    t = np.arange(first, last + 0.25, 0.5)
    signals = {n: Signal(n, t, np.zeros(len(t)), 0.0) for n in ("psi", "r")}
    times = np.array(t_in)
    return Segment(
        "run", "run", times, np.ones((len(times), 1)), ("N",), ("N m",), signals, slack=np.full(len(times), 0.01),
        loop=LOOP, dating=0.5,
    )  # fmt: skip


@pytest.mark.parametrize(("shift", "which"), [(0.0, [2, 3, 4]), (0.25, [1, 2, 3]), (-0.25, [3, 4, 5])])
def test_a_change_is_tried_when_it_acts_after_the_first_stamp_and_before_the_last(
    monkeypatch: pytest.MonkeyPatch, shift: float, which: list[int]
) -> None:
    monkeypatch.setattr(stamp_correction, "simulator_of", Summing())
    own = stamped(0.5, 1.0, 1.25, 2.0, 2.75, 3.0, 3.5)
    found = switches_of(BARE, own, np.zeros(2), np.zeros(2), shift)
    assert found.which.tolist() == which
    assert found.finite
    assert found.by["psi"] == pytest.approx(np.ones((5, 3)), abs=1e-9)
    assert found.by["r"] == pytest.approx(2.0 * np.ones((5, 3)), abs=1e-9)


def test_as_many_changes_as_the_limit_are_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    for count, tried in ((MOST, MOST), (MOST + 1, 0)):
        monkeypatch.setattr(stamp_correction, "simulator_of", Summing())
        own = stamped(*np.linspace(1.1, 2.9, count))
        assert len(switches_of(BARE, own, np.zeros(2), np.zeros(2)).which) == tried


@pytest.mark.parametrize(("lost", "asked", "columns"), [((0,), 2, 0), ((2,), 3, 1), ((1, 2), 2, 0)])
def test_no_simulation_is_tried_after_one_that_diverges(
    monkeypatch: pytest.MonkeyPatch, lost: tuple[int, ...], asked: int, columns: int
) -> None:
    simulator = Summing(lost)
    monkeypatch.setattr(stamp_correction, "simulator_of", simulator)
    found = switches_of(BARE, stamped(1.5, 2.0, 2.5), np.zeros(2), np.zeros(2))
    assert simulator.calls == asked
    assert np.isfinite(found.by["r"]).all(axis=0).tolist() == [k < columns for k in range(3)]
    assert not found.finite


def test_a_single_nan_in_any_signal_is_not_finite() -> None:
    good = np.ones((2, 2))
    for name in ("psi", "r"):
        spoilt = good.copy()
        spoilt[1, 0] = np.nan
        assert not Switches({"psi": good, "r": good, name: spoilt}, np.arange(2)).finite
    assert Switches({"psi": good, "r": good}, np.arange(2)).finite


@pytest.mark.parametrize(
    ("moves", "finite", "moved"),
    [
        ((0.01, np.nan, -0.01), (True, True), [[0.01, 0.0], [-0.01]]),
        ((np.nan, np.nan, np.nan), (True, True), None),
        ((0.01, 0.01, 0.01), (True, False), None),
        ((0.01, 0.01, 0.01), (False, True), None),
    ],
)
def test_each_run_has_its_own_moves_and_a_diverging_run_cancels_all(
    monkeypatch: pytest.MonkeyPatch,
    moves: tuple[float, ...],
    finite: tuple[bool, bool],
    moved: list[list[float]] | None,
) -> None:
    runs = [stamped(1.5, 2.0), stamped(2.5)]
    tables = [
        Switches({"psi": np.full((5, len(run.t_in)), 1.0 if good else np.nan)}, np.arange(len(run.t_in)))
        for run, good in zip(runs, finite, strict=True)
    ]
    waiting = iter(tables)
    monkeypatch.setattr(stamp_correction, "switches_of", lambda *given: next(waiting))
    monkeypatch.setattr(stamp_correction, "_moves", lambda *given: np.array(moves))
    solution: Any = SimpleNamespace(form=None, theta=None, shift=0.0, initial=[None, None])
    found = corrected(runs, runs, solution)
    if moved is None:
        assert found is None
        return
    assert found is not None
    for after, before, by in zip(found, runs, moved, strict=True):
        assert (after.t_in - before.t_in).tolist() == pytest.approx(by)
        assert (after.slack > 0.0).tolist() == [move == 0.0 for move in by]
        assert after.dating == (0.5 if 0.0 in by else WITHIN_LOOP * LOOP)


def test_one_run_with_doubtful_stamps_among_exact_ones_is_analysed(monkeypatch: pytest.MonkeyPatch) -> None:
    sure = replace(stamped(1.5), slack=np.zeros(1))
    solution: Any = SimpleNamespace(form=None, theta=None, shift=0.0, initial=[None, None])
    looked: list[Segment] = []

    def look(form: Any, own: Segment, *rest: Any) -> Switches:
        looked.append(own)
        return Switches({}, np.zeros(0, dtype=np.int64))

    monkeypatch.setattr(stamp_correction, "switches_of", look)
    for runs, count in (([sure, stamped(2.5)], 2), ([sure, sure], 0)):
        looked.clear()
        assert corrected(runs, runs, solution) is None
        assert len(looked) == count


def test_changes_that_are_clear_help_to_assign_the_rest_in_later_rounds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three changes in two runs; each round one is clear, and its effect is subtracted from the scores of the next."""
    runs = [stamped(1.5, 2.0), stamped(2.5)]
    runs[1] = replace(runs[1], slack=np.array([0.04]), loop=0.03)
    rng = np.random.default_rng(5)
    tables = [Switches({"psi": rng.normal(size=(5, n))}, np.arange(n)) for n in (2, 1)]
    known = np.array([True, True, False, True, True])
    residuals = [SimpleNamespace(segment=k, signal="psi", known=known) for k in (0, 1)]
    scores = [rng.normal(size=4), rng.normal(size=4)]
    solution: Any = SimpleNamespace(
        rests=residuals, rows=[np.ones((4, 1)), np.ones((4, 1))], scores=scores,
        noise_models={"psi": SimpleNamespace(std=2.0)},
    )  # fmt: skip
    S = np.zeros((8, 3))
    S[:4, :2], S[4:, 2:] = tables[0].by["psi"][known] / 2.0, tables[1].by["psi"][known] / 2.0
    asked: list[tuple[Any, ...]] = []
    rounds = iter([[np.nan, 0.01, np.nan], [np.nan, -0.04], [0.01]])

    def posterior(J: Any, own: Any, left: Any, wide: Any, _: Any) -> tuple[Any, Any]:
        asked.append((own, left, wide))
        return np.zeros(own.shape[1]), np.ones(own.shape[1])

    limits: list[tuple[list[float], list[float]]] = []

    def nearest(mean: Any, std: Any, slack: Any, loop: Any) -> Any:
        limits.append((slack.tolist(), loop.tolist()))
        return np.array(next(rounds))

    monkeypatch.setattr(stamp_correction, "_posterior", posterior)
    monkeypatch.setattr(stamp_correction, "_nearest", nearest)
    assert stamp_correction._moves(runs, solution, tables).tolist() == [0.01, 0.01, -0.04]
    score = np.concatenate(scores)
    for (own, left, wide), columns, gone in zip(
        asked, ([0, 1, 2], [0, 2], [0]), (0.0, 0.01 * S[:, 1], 0.01 * S[:, 1] - 0.04 * S[:, 2]), strict=True
    ):
        assert own == pytest.approx(S[:, columns])
        assert left == pytest.approx(score - gone)
        assert wide == pytest.approx(2.0 * np.array([0.01, 0.01, 0.04])[columns])
    assert limits[1] == ([0.01, 0.04], [LOOP, 0.03])
