"""Heading and yaw set the same parameters: a kept tune says which of them goes last."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest

from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.workflow.accept_or_revert import _on_the_other_axis


def said(firmware: str, axis: str) -> list[str]:
    own = FIRMWARE[firmware]
    context = SimpleNamespace(craft=SimpleNamespace(firmware=own), axis=own.axes[axis])
    return list(_on_the_other_axis(cast(Any, context)))


@pytest.mark.parametrize("firmware", ["ardurover", "ardusub"])
def test_heading_is_said_to_go_last_after_either_of_the_two(firmware: str) -> None:
    for axis in ("heading", "yaw"):
        (sentence,) = said(firmware, axis)
        assert "`tune heading` and `tune yaw` both set" in sentence
        assert "`tune heading` goes last, because" in sentence
        assert ("run `tune heading` now" in sentence) is (axis == "yaw")


def test_the_shared_parameters_are_named() -> None:
    (sentence,) = said("ardusub", "yaw")
    assert "ATC_RAT_YAW_P, ATC_RAT_YAW_I" in sentence and "ATC_ANG_YAW_P" in sentence
    assert "ATC_STR_ANG_P" not in said("ardurover", "yaw")[0]


@pytest.mark.parametrize(("firmware", "axis"), [("ardusub", "depth"), ("ardurover", "speed")])
def test_an_axis_that_shares_nothing_says_nothing(firmware: str, axis: str) -> None:
    assert said(firmware, axis) == []
