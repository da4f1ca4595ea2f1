"""The circle about home is a parameter and HOME_POSITION; a fence that is off is none."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from gcs_autotune.link import FenceItem, read_fence
from gcs_autotune.link.vehicle.fence import _shapes


class HomeSession:
    """A session that answers a request with HOME_POSITION, or never."""

    def __init__(self, *, tells: bool = True) -> None:
        self.vehicle = SimpleNamespace(system=1, component=1)
        self.tells, self.asked = tells, 0
        self.listener: Any = None

    def listen(self, name: str, listener: Any) -> Any:
        self.listener = listener if name == "HOME_POSITION" else None
        return lambda: None

    def request_message(self, number: int) -> None:
        self.asked += 1
        if self.tells and self.asked > 1:  # the first one is lost
            self.listener(SimpleNamespace(latitude=445000000, longitude=89000000))

    def wait_for(self, condition: Any, timeout: float) -> Any:
        return condition()


CIRCLE = {"FENCE_ENABLE": 1.0, "FENCE_TYPE": 2.0, "FENCE_RADIUS": 150.0}


def test_the_home_position_of_the_circle_is_requested_again_when_lost() -> None:
    session: Any = HomeSession()
    assert read_fence(session, CIRCLE) == [FenceItem(((44.5, 8.9),), 150.0)]
    assert session.asked == 2


def test_a_missing_home_position_is_not_taken_for_no_fence() -> None:
    session: Any = HomeSession(tells=False)
    assert read_fence(session, CIRCLE) is None
    assert session.asked == 3


def test_a_disabled_fence_is_empty_and_nothing_is_requested() -> None:
    session: Any = HomeSession()
    assert read_fence(session, {**CIRCLE, "FENCE_ENABLE": 0.0}) == ()
    assert read_fence(session, {}) == ()
    assert session.asked == 0


def item(command: int, x: int, y: int, param1: float) -> SimpleNamespace:
    return SimpleNamespace(command=command, x=x, y=y, param1=param1)


def test_polygons_have_their_own_corners_and_circles_are_separate() -> None:
    triangle = [item(5001, 10_000_000 * k, -20_000_000 * k, 3.0) for k in (1, 2, 3)]
    square = [item(5002, 10_000_000 * k, 0, 4.0) for k in (4, 5, 6, 7)]
    circles = [item(5003, 80_000_000, 0, 25.5), item(5004, 90_000_000, 0, 7.0)]
    items: Any = [circles[0], *triangle, *square, circles[1]]
    found = _shapes(items)
    assert [len(f.corners) for f in found] == [1, 3, 4, 1]
    assert [f.radius for f in found] == [25.5, None, None, 7.0] or [f.radius for f in found] == [25.5, 0.0, 0.0, 7.0]
    assert [f.inside for f in found] == [True, True, False, False]
    assert found[1].corners == tuple((pytest.approx(1.0 * k), pytest.approx(-2.0 * k)) for k in (1, 2, 3))


def test_incomplete_polygons_are_omitted_and_items_without_a_corner_count_are_skipped() -> None:
    lone: Any = [item(5001, 1, 1, 0.0), item(5001, 1, 1, 2.0), item(5001, 2, 2, 2.0), item(5003, 10_000_000, 0, 5.0)]
    assert [f.radius for f in _shapes(lone)] == [5.0]
    return_point: Any = [item(5000, 1, 1, 3.0), item(5003, 10_000_000, 0, 5.0)]
    assert [f.radius for f in _shapes(return_point)] == [5.0]
