"""Shared by all manoeuvres: commands that the outputs do not reach."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_autotune.manoeuvres import limited_orders
from gcs_autotune.trial import Channel, Mark, Trial


def flown(came: float, commanded: float = 0.5) -> Trial:
    """A command of 10 s of which the output later reaches the fraction *came*; then neutral."""
    t = 0.1 * np.arange(200)
    N = commanded * np.where(t < 1.0, 0.0, np.where(t < 10.0, came, 0.0))
    marks = (Mark(0.0, "execute", {"N": commanded}), Mark(10.0, "execute", {"N": 0.0}))
    return Trial("run", {"N": Channel("N", "1", t, N)}, marks)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("came", "limited"), [(0.85, True), (0.5, True), (0.95, False), (1.0, False)])
def test_a_command_is_limited_when_the_output_falls_short_by_a_tenth(side: float, came: float, limited: bool) -> None:
    found = limited_orders(flown(came, side * 0.5))
    assert set(found) == ({"N"} if limited else set())
    if limited:
        assert found["N"] == pytest.approx((0.5, 0.5 * came))


def test_small_commands_are_not_checked_for_limits() -> None:
    assert limited_orders(flown(0.5, 0.09)) == {}
    assert set(limited_orders(flown(0.5, 0.11))) == {"N"}


@pytest.mark.parametrize(("seconds", "is_limited"), [(0.9, False), (1.0, True)])
def test_a_command_is_checked_when_it_lasts_a_second(seconds: float, is_limited: bool) -> None:
    marks = (Mark(0.0, "execute", {"N": 0.5}), Mark(seconds, "execute", {"N": 0.0}))
    nothing = Channel("N", "1", 0.1 * np.arange(50), np.zeros(50))
    assert bool(limited_orders(Trial("run", {"N": nothing}, marks))) is is_limited


def test_a_command_shorter_than_the_link_delay_is_not_checked() -> None:
    t = 0.1 * np.arange(200)
    commanded = np.sign(np.sin(2.0 * np.pi * 0.7 * t)) * 0.5
    late = np.concatenate([np.zeros(4), commanded[:-4]])
    turns = [0, *(np.flatnonzero(np.diff(commanded)) + 1)]
    marks = tuple(Mark(float(t[k]), "level", {"N": float(commanded[k])}) for k in turns)
    assert limited_orders(Trial("run", {"N": Channel("N", "1", t, late)}, marks[:-1])) == {}
