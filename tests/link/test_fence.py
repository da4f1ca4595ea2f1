"""The circle about home is a parameter and HOME_POSITION; a fence that is off is none."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from gcs_autotune.link import FenceItem, read_fence


class Told:
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


def test_the_circle_about_home_is_asked_for_again_when_it_is_lost() -> None:
    session: Any = Told()
    assert read_fence(session, CIRCLE) == [FenceItem(((44.5, 8.9),), 150.0)]
    assert session.asked == 2


def test_a_home_that_is_never_told_is_not_taken_for_no_fence() -> None:
    session: Any = Told(tells=False)
    assert read_fence(session, CIRCLE) is None
    assert session.asked == 3


def test_a_fence_that_is_off_is_none_and_nothing_is_asked() -> None:
    session: Any = Told()
    assert read_fence(session, {**CIRCLE, "FENCE_ENABLE": 0.0}) == ()
    assert read_fence(session, {}) == ()
    assert session.asked == 0
