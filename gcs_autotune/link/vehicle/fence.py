"""Read the vehicle's own fence over MAVLink: the polygons and circles that its autopilot stays inside or outside of.

Polygons and circles are read by the mission protocol with MAV_MISSION_TYPE_FENCE. The circle about home is read from
the parameter FENCE_RADIUS and from HOME_POSITION. A fence that is not enabled (FENCE_ENABLE) is ignored.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from gcs_autotune.link.session import Session
from gcs_autotune.link.vehicle.mission_transfer import ask_mission, download
from gcs_autotune.mavlink import Message

__all__ = ["FENCE_PARAMETERS", "FenceItem", "read_fence"]

FENCE_PARAMETERS = ("FENCE_ENABLE", "FENCE_TYPE", "FENCE_RADIUS")
_CIRCLE, _POLYGONS = 2, 4
"""Bits of FENCE_TYPE: the circle about home; inclusion and exclusion polygons and circles."""
_FENCE = 1
"""Value of MAV_MISSION_TYPE_FENCE."""
_INCLUDED = frozenset({5001, 5003})
"""Values of MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION and MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION."""
_VERTICES, _CIRCLES = frozenset({5001, 5002}), frozenset({5003, 5004})
_HOME = 242
"""Message number of HOME_POSITION."""


@dataclass(frozen=True, slots=True)
class FenceItem:
    """A polygon (corners: latitude, longitude [deg]) or a circle (one corner, ``radius`` [m]).

    ``inside``: stay inside.
    """

    corners: tuple[tuple[float, float], ...]
    radius: float = 0.0
    inside: bool = True


def read_fence(session: Session, values: Mapping[str, float]) -> Sequence[FenceItem] | None:
    """Return the items of the fence of a vehicle with the parameter *values* (:data:`FENCE_PARAMETERS`). Empty without
    a fence; None if the vehicle does not answer.

    Raises
    ------
    LinkLost, OperatorStopped
        Raised by the session.
    """
    if not values.get("FENCE_ENABLE", 0.0):
        return ()
    kinds, shapes = int(values.get("FENCE_TYPE", 0.0)), []
    if kinds & _POLYGONS:
        items = download(session, _FENCE)
        if items is None:
            return None
        shapes += _shapes(items)
    radius = values.get("FENCE_RADIUS", 0.0)
    if kinds & _CIRCLE and radius > 0.0:
        home = ask_mission(session, lambda: session.request_message(_HOME), "HOME_POSITION")
        if home is None:
            return None
        shapes.append(FenceItem(((home.latitude * 1e-7, home.longitude * 1e-7),), radius))
    return shapes


def _shapes(items: Sequence[Message]) -> list[FenceItem]:
    shapes: list[FenceItem] = []
    k = 0
    while k < len(items):
        item = items[k]
        count = max(int(item.param1), 1) if item.command in _VERTICES else 1
        corners = tuple((i.x * 1e-7, i.y * 1e-7) for i in items[k : k + count])
        inside = item.command in _INCLUDED
        if item.command in _VERTICES and len(corners) >= 3:
            shapes.append(FenceItem(corners, inside=inside))
        elif item.command in _CIRCLES:
            shapes.append(FenceItem(corners, float(item.param1), inside))
        k += count
    return shapes
