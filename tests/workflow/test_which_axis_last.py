"""Heading and yaw set the same parameters: a kept tune reports what its gains mean for the other mode."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest

from gcs_autotune.design import StepMetrics
from gcs_autotune.design.result import Beside
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.workflow.autopilot_loop import on_the_other_axis

RATES = StepMetrics(itae=1.0, overshoot=0.0, rise=1.0, settling=3.0, steady_error=0.5, travel=0.1)
LAWS = {("ardurover", "heading"): "rover-yaw", ("ardurover", "yaw"): "rover-heading"}
LAWS |= {("ardusub", "heading"): "sub-yaw", ("ardusub", "yaw"): "sub-heading"}


def sentences(firmware: str, axis: str, before: float, after: float, measured: Any = None) -> list[str]:
    own = FIRMWARE[firmware]
    proposal = SimpleNamespace(beside=Beside(LAWS[firmware, axis], before, after, 0.0))
    return list(on_the_other_axis(own.axes[axis], own, cast(Any, proposal), measured))


@pytest.mark.parametrize("firmware", ["ardurover", "ardusub"])
def test_a_heading_tune_reports_how_well_turn_rates_were_followed(firmware: str) -> None:
    (good,) = sentences(firmware, "heading", 0.4, 0.01, (RATES, replace(RATES, steady_error=0.02)))
    assert "`tune heading` and `tune yaw` both set" in good
    assert "turn rates reach 98% of the commanded rate" in good and "would improve" not in good
    (poor,) = sentences(firmware, "heading", 0.4, 0.3, (RATES, replace(RATES, steady_error=0.4)))
    assert "turn rates reach 60% of the commanded rate. `tune yaw` may improve turn rates" in poor


@pytest.mark.parametrize("firmware", ["ardurover", "ardusub"])
def test_a_yaw_tune_recommends_tune_heading_only_where_headings_are_predicted_to_degrade(firmware: str) -> None:
    (sentence,) = sentences(firmware, "yaw", 0.02, 0.05)
    assert "Run `tune heading` to design for both loops" in sentence
    assert "5.0% (before: 2.0%)" in sentence
    assert sentences(firmware, "yaw", 0.05, 0.03) == []


def test_the_shared_parameters_are_listed() -> None:
    assert "ATC_RAT_YAW_P, ATC_RAT_YAW_I" in sentences("ardusub", "yaw", 0.02, 0.05)[0]
    assert "ATC_STR_ANG_P" not in sentences("ardurover", "yaw", 0.02, 0.05)[0]


@pytest.mark.parametrize(("firmware", "axis"), [("ardusub", "depth"), ("ardurover", "speed")])
def test_an_axis_without_shared_parameters_reports_nothing(firmware: str, axis: str) -> None:
    own = FIRMWARE[firmware]
    assert list(on_the_other_axis(own.axes[axis], own, cast(Any, SimpleNamespace(beside=None)), None)) == []
