"""Where a flight may go: the area set by the user, and the vehicle's own fence."""

from __future__ import annotations

import math

from gcs_autotune.errors import PreconditionFailed
from gcs_autotune.link import FENCE_PARAMETERS, MavlinkCraft, read_fence
from gcs_autotune.manoeuvres import Area, Zone, how_far
from gcs_autotune.observer import Observer

__all__ = ["area_of_flight"]

_FAR = 10e3
"""Distance [m] from the area above which swapped coordinates are suspected. Project choice."""


def area_of_flight(craft: MavlinkCraft, given: Area | None, observer: Observer) -> Area | None:
    """Return the permitted area in metres around *craft*: the user's area *given* within its own fence. None: no
    limit.

    Raises
    ------
    PreconditionFailed
        There is an area, and the vehicle is outside it or reports no position.
    """
    values = craft.parameters.read_existing(list(FENCE_PARAMETERS))
    items = read_fence(craft.session, values)
    if items is None:
        observer.say("FENCE_ENABLE is on, but the vehicle does not report its fence, so this tool cannot monitor it")
    if not items and given is None:
        return None
    now, fix = craft.observe(), craft.telemetry.fix
    if fix is None or not math.isfinite(now.x + now.y):
        if given is not None:
            raise PreconditionFailed(
                f"the vehicle reports no position, so it cannot be kept in {given.source}. Check GPS. Nothing was armed"
            )
        observer.say("the vehicle reports no position, so its fence cannot be monitored")
        return None
    fence = Area(tuple(Zone(i.corners, i.radius, i.inside) for i in items), "its own fence") if items else None
    both = (given.and_(fence) if given is not None else fence) if fence is not None else given
    assert both is not None
    area = both.around(*fix, now.x, now.y)
    beyond = area.beyond(now.x, now.y)
    if beyond > 0.0:
        swapped = ". Check the order of its latitudes and longitudes" * (beyond >= _FAR)
        where = f"{fix[0]:.5f} {fix[1]:.5f}"
        raise PreconditionFailed(
            f"the vehicle, at {where}, is {how_far(beyond)} outside {area.source}. Nothing was armed{swapped}"
        )
    observer.say(
        f"keeping inside {area.source}: {how_far(-max(z.beyond(now.x, now.y) for z in area.zones))} to its edge"
    )
    return area
