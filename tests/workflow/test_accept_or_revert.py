"""When is a proposal not worth proving? By number, without a vehicle."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import pytest

from gcs_autotune.design import Proposal, StepMetrics
from gcs_autotune.workflow.accept_or_revert import _is_hopeless


def step(itae: float) -> StepMetrics:
    return StepMetrics(itae, overshoot=0.0, rise=1.0, settling=2.0, steady_error=0.0, travel=0.1)


@pytest.mark.parametrize(
    ("promised", "predicted_now", "flown_now", "is_hopeless"),
    [
        (0.5, 1.0, 1.0, False),
        (2.0, 1.0, 1.0, True),
        (1.0, 1.0, 1.0, True),
        (1.5, 1.0, 2.0, False),
        (1.5, 2.0, 1.0, False),
    ],
    ids=["better than both", "worse than both", "the same", "better than flown", "better than predicted"],
)
def test_gains_are_given_up_unproved_only_when_they_promise_less_than_both_what_was_predicted_and_what_was_flown(
    promised: float, predicted_now: float, flown_now: float, is_hopeless: bool
) -> None:
    proposal = SimpleNamespace(
        before=SimpleNamespace(metrics=step(predicted_now)), after=SimpleNamespace(metrics=step(promised))
    )
    assert _is_hopeless(cast(Proposal, proposal), step(flown_now)) is is_hopeless
