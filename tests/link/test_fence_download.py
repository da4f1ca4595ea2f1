"""The fence is requested item by item: lost items are requested again, other answers are ignored."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_autotune.link import FenceItem, read_fence

FENCE, MISSION = mavlink.MAV_MISSION_TYPE_FENCE, mavlink.MAV_MISSION_TYPE_MISSION
POLYGON, CIRCLE = 4.0, 2.0
ITEMS = [SimpleNamespace(command=5001, x=10_000_000 * k, y=-5_000_000 * k, param1=3.0) for k in (1, 2, 3)]
TRIANGLE = FenceItem(((1.0, -0.5), (2.0, -1.0), (3.0, -1.5)))


class Fenced:
    """A session with a vehicle that holds *items*; ``lost`` of its answers do not arrive, by their number."""

    def __init__(self, items: list[Any], lost: tuple[int, ...] = ()) -> None:
        self.vehicle = SimpleNamespace(system=7, component=2)
        self.items, self.lost = items, lost
        self.sent: list[Any] = []
        self.asked: list[int] = []
        self.answers, self.patience = 0, set[float]()
        self.listeners: dict[str, Any] = {}

    def listen(self, name: str, listener: Any) -> Any:
        self.listeners[name] = listener
        return lambda: self.listeners.pop(name)

    def send(self, message: Any) -> None:
        self.sent.append(message)
        assert (message.target_system, message.target_component, message.mission_type) == (7, 2, FENCE)
        if message.get_type() == "MISSION_REQUEST_LIST":
            self.tell("MISSION_COUNT", SimpleNamespace(count=9, mission_type=MISSION))
            self.answer("MISSION_COUNT", SimpleNamespace(count=len(self.items), mission_type=FENCE))
        elif message.get_type() == "MISSION_REQUEST_INT":
            item = self.items[message.seq]
            late = SimpleNamespace(**{**vars(item), "x": 0}, seq=message.seq - 1, mission_type=FENCE)
            self.tell("MISSION_ITEM_INT", late)
            self.answer("MISSION_ITEM_INT", SimpleNamespace(**vars(item), seq=message.seq, mission_type=FENCE))

    def request_message(self, number: int) -> None:
        self.asked.append(number)
        self.answer("HOME_POSITION", SimpleNamespace(latitude=445000000, longitude=-89000000))

    def answer(self, name: str, message: Any) -> None:
        self.answers += 1
        if self.answers - 1 not in self.lost:
            self.tell(name, message)

    def tell(self, name: str, message: Any) -> None:
        if name in self.listeners:
            self.listeners[name](message)

    def wait_for(self, condition: Any, timeout: float) -> Any:
        self.patience.add(timeout)
        return condition()


def read(session: Fenced, **values: float) -> Any:
    return read_fence(session, {"FENCE_ENABLE": 1.0, **values})  # type: ignore[arg-type]


def kinds(session: Fenced) -> list[str]:
    return [m.get_type().removeprefix("MISSION_") for m in session.sent]


@pytest.mark.parametrize("lost", [(), (0,), (1,), (1, 2), (3,)])
def test_every_fence_item_is_requested_until_it_arrives_and_then_acknowledged(lost: tuple[int, ...]) -> None:
    session = Fenced(ITEMS, lost)
    (found,) = read(session, FENCE_TYPE=POLYGON)
    assert [lat for lat, _ in found.corners] == pytest.approx([1.0, 2.0, 3.0])
    assert [lon for _, lon in found.corners] == pytest.approx([-0.5, -1.0, -1.5])
    requests = kinds(session)
    assert requests.count("REQUEST_LIST") == 1 + (0 in lost)
    assert requests.count("REQUEST_INT") == 3 + len(set(lost) - {0})
    assert requests[-1] == "ACK" and requests.count("ACK") == 1
    assert session.sent[-1].type == mavlink.MAV_MISSION_ACCEPTED
    assert session.listeners == {}
    assert session.asked == []
    assert all(0.0 < seconds < 10.0 for seconds in session.patience)


@pytest.mark.parametrize("lost", [(0, 1, 2), (1, 2, 3), (3, 4, 5)])
def test_a_vehicle_that_does_not_answer_is_not_taken_for_one_without_a_fence(lost: tuple[int, ...]) -> None:
    session = Fenced(ITEMS, lost)
    assert read(session, FENCE_TYPE=POLYGON) is None
    assert "ACK" not in kinds(session)
    assert session.listeners == {}


def test_a_fence_without_items_is_empty_and_acknowledged() -> None:
    session = Fenced([])
    assert read(session, FENCE_TYPE=POLYGON) == []
    assert kinds(session) == ["REQUEST_LIST", "ACK"]


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ({"FENCE_TYPE": POLYGON + CIRCLE, "FENCE_RADIUS": 0.5}, [TRIANGLE, FenceItem(((44.5, -8.9),), 0.5)]),
        ({"FENCE_TYPE": CIRCLE, "FENCE_RADIUS": 0.5}, [FenceItem(((44.5, -8.9),), 0.5)]),
        ({"FENCE_TYPE": CIRCLE, "FENCE_RADIUS": 0.0}, []),
        ({"FENCE_TYPE": CIRCLE}, []),
        ({"FENCE_TYPE": 1.0, "FENCE_RADIUS": 50.0}, []),
        ({"FENCE_TYPE": 1.0 + 8.0}, []),
        ({}, []),
    ],
)
def test_only_enabled_fence_types_are_requested(values: dict[str, float], expected: list[FenceItem]) -> None:
    session = Fenced(ITEMS)
    found = read(session, **values)
    assert [(f.radius, f.inside) for f in found] == [(f.radius, f.inside) for f in expected]
    for one, other in zip(found, expected, strict=True):
        assert [x for corner in one.corners for x in corner] == pytest.approx([x for c in other.corners for x in c])
    assert bool(session.sent) is any(f.radius == 0.0 for f in expected)
    assert session.asked == [242] * any(f.radius for f in expected)
