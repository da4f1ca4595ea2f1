"""What every manoeuvre shares: orders of which less comes out than was asked for."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_autotune.manoeuvres import limited_orders
from gcs_autotune.trial import Channel, Mark, Trial


def flown(came: float, asked: float = 0.5) -> Trial:
    """An order for 10 s of which the share *came* comes out after a while; then neutral."""
    t = 0.1 * np.arange(200)
    N = asked * np.where(t < 1.0, 0.0, np.where(t < 10.0, came, 0.0))
    marks = (Mark(0.0, "execute", {"N": asked}), Mark(10.0, "execute", {"N": 0.0}))
    return Trial("run", {"N": Channel("N", "1", t, N)}, marks)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("came", "limited"), [(0.85, True), (0.5, True), (0.95, False), (1.0, False)])
def test_an_order_is_limited_when_a_tenth_of_it_does_not_come_out(side: float, came: float, limited: bool) -> None:
    found = limited_orders(flown(came, side * 0.5))
    assert set(found) == ({"N"} if limited else set())
    if limited:
        assert found["N"] == pytest.approx((0.5, 0.5 * came))


def test_an_order_too_small_to_matter_is_not_looked_at() -> None:
    assert limited_orders(flown(0.5, 0.09)) == {}
    assert set(limited_orders(flown(0.5, 0.11))) == {"N"}


@pytest.mark.parametrize(("seconds", "is_limited"), [(0.9, False), (1.0, True)])
def test_an_order_counts_when_it_lasts_a_second(seconds: float, is_limited: bool) -> None:
    marks = (Mark(0.0, "execute", {"N": 0.5}), Mark(seconds, "execute", {"N": 0.0}))
    nothing = Channel("N", "1", 0.1 * np.arange(50), np.zeros(50))
    assert bool(limited_orders(Trial("run", {"N": nothing}, marks))) is is_limited


def test_an_order_that_is_over_before_a_slow_link_shows_what_came_of_it_is_not_looked_at() -> None:
    t = 0.1 * np.arange(200)
    asked = np.sign(np.sin(2.0 * np.pi * 0.7 * t)) * 0.5
    late = np.concatenate([np.zeros(4), asked[:-4]])
    turns = [0, *(np.flatnonzero(np.diff(asked)) + 1)]
    marks = tuple(Mark(float(t[k]), "level", {"N": float(asked[k])}) for k in turns)
    assert limited_orders(Trial("run", {"N": Channel("N", "1", t, late)}, marks[:-1])) == {}
