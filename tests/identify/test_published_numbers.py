"""Numbers printed in Miskovic2010, recomputed or simulated again."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from itertools import combinations
from typing import Any

import numpy as np
import pytest
from axis_plants import DEG, Relay

from gcs_autotune.identify import IsoEstimate, LimitCycle
from gcs_autotune.identify.relay.iso import MARGINS, decide, estimate
from gcs_autotune.identify.relay.limit_cycle import find_cycles
from gcs_autotune.identify.relay.linear_process import identify_process
from gcs_autotune.trial import Trial

Record = Callable[..., Trial]


def reading(C: float, x_a_star: float, X_m: float, omega: float, x_0: float = 0.0, x_a: float = 0.0) -> LimitCycle:
    half = np.pi / omega
    return LimitCycle(C, x_a or x_a_star, x_a_star, X_m, x_0, omega, half, half, 5, 0.0, True)


def videoray(published: dict[str, Any]) -> list[tuple[float, IsoEstimate, tuple[float, ...]]]:
    table = published["videoray_iso_table_7_9"]
    return [
        (N, estimate(reading(N * 1e-2, xa, X, w, x0), table["total_delay_s"]), (al * 1e-4, be * 1e-4, bq * 1e-6))
        for N, xa, X, w, x0, al, be, bq in table["rows"]
    ]


def automarine(published: dict[str, Any]) -> list[tuple[float, IsoEstimate, tuple[float, ...]]]:
    return [
        (N, estimate(reading(N * 1e-2, xs, X, w, 0.0, xa)), (al * 1e-4, be * 1e-4, bq * 1e-6))
        for N, X, w, xs, xa, al, be, bq in published["automarine_iso_table_7_11"]["rows"]
    ]


@pytest.mark.parametrize("table", [videoray, automarine])
def test_every_entry_of_tables_7_9_and_7_11_follows_within_0_8_percent(
    table: Callable[..., Any], published: dict[str, Any]
) -> None:
    rows = table(published)
    assert len(rows) in (15, 32)
    for _, got, printed in rows:
        assert (got.alpha, got.beta, got.beta_quadratic) == pytest.approx(printed, rel=0.008)


def as_printed(rows: list[tuple[float, IsoEstimate, tuple[float, ...]]]) -> list[tuple[float, IsoEstimate]]:
    """The decision was made on the printed, rounded parameters."""
    return [(N, IsoEstimate(e.cycle, *p, 0.0, 0.0)) for N, e, p in rows]


def counts(rows: list[tuple[float, IsoEstimate]], margin: str) -> tuple[int, int, int]:
    verdicts = Counter(decide(a, b, margin).verdict for (N, a), (M, b) in combinations(rows, 2) if N != M)
    return verdicts["nonlinear"], verdicts["linear"], verdicts["undecided"]


def test_the_decision_counts_of_videoray_are_those_of_figure_7_3(published: dict[str, Any]) -> None:
    rows = as_printed(videoray(published))
    assert [counts(rows, m) for m in MARGINS] == [(74, 9, 0), (63, 4, 16), (49, 0, 34), (30, 0, 53)]


def test_about_63_percent_of_the_automarine_pairs_decide_correctly_without_margin(published: dict[str, Any]) -> None:
    right, wrong, open_ = counts(as_printed(automarine(published)), "none")
    assert right + wrong + open_ == 347
    assert open_ == 0
    assert right / 347 == pytest.approx(0.63, abs=0.02)


GAIN, LAG = 50.0, 0.3
PROCESS = (LAG / GAIN, 1.0 / GAIN, 0.0, 0.0)


def gain_and_lag(cycle: LimitCycle, delay: float = 0.0) -> tuple[float, float]:
    """K and T found by the matrix algorithm."""
    found = identify_process([cycle], n=1, m=0, integrators=1, delay=delay)
    return found.numerator[0], found.denominator[1]


def test_example_6_2_delay_correction_reduces_the_time_constant_error_from_101_to_15_percent(
    record: Record,
) -> None:
    run = record(PROCESS, Relay(1.0, 10.0), 40.0, dt=0.002, h=0.002, delay=0.1, dof="heave")
    (cycle,) = find_cycles(run, "heave")
    # The text repeats Example 6.3's X_m and period here; the printed rotation matrix shows the real frequency.
    # Of Table 6.1 the values are right, but K = 76.98 is +54 % and not the printed +156.6 %.
    rotation = (np.cos(0.1 * cycle.omega), np.sin(0.1 * cycle.omega))
    assert rotation == pytest.approx((0.964, 0.266), abs=0.002)
    assert gain_and_lag(cycle) == pytest.approx((76.98, 0.6037), rel=0.01)
    assert gain_and_lag(cycle, 0.1) == pytest.approx((55.14, 0.346), rel=0.01)


def test_example_6_3_switching_correction_reduces_the_errors_from_35_and_75_to_6_and_4_percent(
    record: Record,
) -> None:
    run = record(PROCESS, Relay(1.0, 16.0), 40.0, dt=0.1, h=0.01, dof="heave", meta={"x_a": 16.0})
    (cycle,) = find_cycles(run, "heave")
    assert cycle.x_a == 16.0
    assert cycle.x_a_star == pytest.approx(20.28, rel=0.02)
    uncorrected = LimitCycle(cycle.C, 16.0, 16.0, cycle.X_m, cycle.x_0, cycle.omega, cycle.T_H, cycle.T_L, 5, 0.0, True)
    assert gain_and_lag(uncorrected) == pytest.approx((67.43, 0.526), rel=0.02)
    assert gain_and_lag(cycle) == pytest.approx((53.2, 0.311), rel=0.03)


def cycles_of_table(record: Record, plant: tuple[float, ...], rows: list[list[float]], dof: str) -> list[LimitCycle]:
    scale = DEG if dof == "yaw" else 1.0
    found = []
    for x_a, C, *_ in rows:
        run = record(plant, Relay(C, x_a * scale), 30.0, dt=0.002, h=0.002, dof=dof)
        found.extend(find_cycles(run, dof))
    return found


@pytest.mark.parametrize(
    ("plant", "key", "dof", "verdict"),
    [
        ((80.0, 300.0, 10.0, 0.0), "yaw_iso", "yaw", "linear"),
        ((130.0, 200.0, 20.0, 10.0), "heave_iso", "heave", "linear"),
        ((1.018, 0.0, 1.257, 0.0), "iso", "yaw", "nonlinear"),
    ],
    ids=["example 7.1", "example 7.2", "example 7.3"],
)
def test_examples_7_1_to_7_3_are_simulated_identified_and_decided(
    plant: tuple[float, ...], key: str, dof: str, verdict: str, record: Record, published: dict[str, Any]
) -> None:
    rows = (published["falcon_seed_002"] | published["nonlinear_yaw_tables_7_5_7_6"])[key]
    cycles = cycles_of_table(record, plant, rows, dof)
    assert len(cycles) == 2
    scale = DEG if dof == "yaw" else 1.0
    for cycle, (_, _, X_m, omega, alpha, beta, quadratic) in zip(cycles, rows, strict=True):
        got = estimate(cycle)
        assert cycle.X_m / scale == pytest.approx(X_m, rel=0.03)
        assert cycle.omega == pytest.approx(omega, rel=0.03)
        assert (got.alpha, got.beta, got.beta_quadratic) == pytest.approx((alpha, beta, quadratic), rel=0.06)
    for margin in MARGINS:
        decision = decide(estimate(cycles[0]), estimate(cycles[1]), margin)
        assert decision.verdict == verdict or (margin in ("sigma+5", "sigma+10") and decision.verdict == "undecided")
