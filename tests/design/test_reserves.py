"""The margins a design keeps, number by number: worst margins, delay margin, and gains in force that have none."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from gcs_autotune.design import Margins, Prediction, Spec, StepMetrics, Verdict, design
from gcs_autotune.design import proposal as door
from gcs_autotune.design.margins import worst
from gcs_autotune.design.matching import DesignProblem
from gcs_autotune.design.selection import GainCandidate, is_tolerable, judge, objections

from .crafts import SUB_HEADING, present, uncertain, yaw

FALCON = yaw(0.2, 0.75, 0.025)
FINE = Margins(gain=5.0, phase=1.2, delay=10.0, stable=True)


def promise(overshoot: float = 0.0, itae: float = 1.0) -> Prediction:
    nothing = np.zeros(2)
    metrics = StepMetrics(itae, overshoot, rise=1.0, settling=2.0, steady_error=0.0, travel=0.1)
    return Prediction(nothing, nothing, nothing, nothing, nothing, metrics)


def test_the_worst_case_has_the_smallest_of_each_margin() -> None:
    loops = [Margins(5.0, 0.9, 0.30, True), Margins(2.0, 1.1, 0.20, True), Margins(7.0, 0.5, 0.25, True)]
    for turn in range(3):
        assert worst(loops[turn:] + loops[:turn]) == Margins(2.0, 0.5, 0.20, True)
    unstable = Margins(0.0, 0.0, 0.0, stable=False)
    assert not worst([loops[0], unstable]).stable
    assert not worst([unstable, loops[0]]).stable


def problem(
    delay: float = 0.0, period: float = 0.02, present_overshoot: float = 0.0, free: float = 0.0
) -> DesignProblem:
    law = SimpleNamespace(loop_period=lambda settings: period, free_overshoot=free)
    return cast(
        DesignProblem,
        SimpleNamespace(spec=Spec(), law=law, model=SimpleNamespace(delay=delay), present_overshoot=present_overshoot),
    )


@pytest.mark.parametrize(("delay", "period"), [(0.0, 0.02), (0.15, 0.02), (0.15, 0.0025)])
def test_the_delay_margin_covers_two_loop_periods_and_the_crafts_delay(delay: float, period: float) -> None:
    needed = 2.0 * period + delay
    for share, printed in (
        (1.01, []),
        (0.99, [f"delay margin {0.99 * needed:.2f} s is less than the required {needed:.2f} s"]),
    ):
        low = replace(FINE, delay=share * needed)
        found = list(objections(problem(delay, period), {}, low, promise()))
        assert [text[: len(s)] for text, s in zip(found, printed, strict=True)] == printed


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"gain": 2.49}, "gain margin 2.49 is less than 2.50"),
        ({"phase": math.radians(44.0)}, "phase margin 44 deg is less than 45 deg"),
        ({"stable": False}, "the loop is unstable for part of the 95 % region"),
    ],
)
def test_each_margin_that_is_not_met_is_an_objection(change: dict[str, Any], words: str) -> None:
    (printed,) = objections(problem(), {}, replace(FINE, **change), promise())
    assert printed.startswith(words)


@pytest.mark.parametrize(
    ("before", "free", "most"), [(0.0, 0.0, 0.12), (0.2, 0.0, 0.2), (0.6, 0.0, 0.25), (0.2, 0.1, 0.3)]
)
def test_a_step_may_overshoot_as_the_present_one_up_to_a_quarter(before: float, free: float, most: float) -> None:
    given = problem(present_overshoot=before, free=free)
    assert list(objections(given, {}, FINE, promise(most - 0.001))) == []
    (printed,) = objections(given, {}, FINE, promise(most + 0.001))
    assert "predicted overshoot" in printed and f"more than {most:.0%}" in printed


@pytest.mark.parametrize(
    ("change", "overshoot", "is_safe"),
    [
        ({}, 0.0, True),
        ({"gain": 2.0, "phase": math.radians(30.0)}, 0.4, True),
        ({"gain": 1.99}, 0.0, False),
        ({"phase": math.radians(29.9)}, 0.0, False),
        ({"stable": False}, 0.0, False),
        ({}, 0.41, False),
    ],
)
def test_gains_that_are_safe_to_fly_meet_the_minimum_margins(
    change: dict[str, Any], overshoot: float, is_safe: bool
) -> None:
    candidate = GainCandidate(
        cast(Any, None), {}, FINE, replace(FINE, **change), promise(overshoot), objections=("misses the specification",)
    )
    assert is_tolerable(candidate) is is_safe


WILD = {"ATC_RAT_YAW_P": 50.0, "ATC_ANG_YAW_P": 60.0}


@pytest.mark.parametrize("unsafe", [True, False], ids=["unsafe gains", "safe gains"])
def test_present_gains_without_a_better_proposal_are_kept_only_if_safe(
    unsafe: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The search is left out: it proposes one set of gains, and the verdict is that they promise no better step."""
    proposed = {**present(SUB_HEADING), "ATC_RAT_YAW_P": 0.25}

    def choose(given: DesignProblem) -> GainCandidate:
        return judge(given, door.reference_model("bessel", 2.0), proposed, 6.0)

    monkeypatch.setattr(door, "choose", choose)
    monkeypatch.setattr(door, "refine", lambda given, chosen, span: chosen)
    monkeypatch.setattr(door, "any_better", lambda given, before, span: None)
    monkeypatch.setattr(door, "passes", lambda *steps: False)
    monkeypatch.setattr(door, "is_better", lambda *steps, **_: Verdict(((False, "not better"),)))
    mine = {**present(SUB_HEADING), **(WILD if unsafe else {})}
    found = design(FALCON, uncertain(FALCON), SUB_HEADING, mine)
    assert {c.parameter for c in found.changes} == (set(WILD) if unsafe else set())
    assert (found.after is found.before) is not unsafe
