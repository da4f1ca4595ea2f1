"""What goes wrong, when, for how long and how badly."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any, Self

__all__ = ["KINDS", "LASTING", "STATION_KINDS", "Fault"]

KINDS = {
    "loss": "frames are lost with probability size",
    "delay": "frames come size seconds late, in order",
    "reorder": "a third of the frames come up to size seconds late and are overtaken",
    "duplicate": "a third of the frames come twice, the second time up to size seconds later",
    "corrupt": "bytes of frames are changed, cut off or put in with probability size per frame",
    "silence": "nothing passes at all",
    "stuck": "only heartbeats pass; size 1: the other messages go on with their last contents",
    "wrong-system": "the vehicle's messages come under another system id",
    "forged-foreign": "wrong PARAM_VALUEs from another system come before the right ones",
    "forged-own": "wrong PARAM_VALUEs under the vehicle's own id come before (some of) the right ones",
    "unplugged": "every call of the link fails, as when a serial adapter is pulled out",
    "killed": "the tool ends at once and nothing of it runs any more, as by kill -9 or a power cut",
    "reboot": "the autopilot restarts, silent for size seconds; parameters are kept",
    "disk-full": "every file that would grow fails to",
    "operator": "somebody presses Ctrl-C",
}
"""Kind -> what it does. The last four happen; the others last."""

STATION_KINDS = {
    "station-mode": "another station, on its own wire, orders a mode",
    "station-disarm": "it disarms the vehicle",
    "station-sticks": "under the tool's own system id it sends overrides for duration seconds",
    "station-write": "it writes a gain",
    "stall": "the tool's computer stands still for size seconds",
}
"""Kind -> what another station, or the tool's own computer, does. These are drawn with ``draw_station_case`` only."""

LASTING = tuple(KINDS)[:10]


@dataclass(frozen=True, slots=True)
class Fault:
    """One thing that goes wrong.

    Begins ``after`` seconds of link time from the moment that the ``count``-th ``sent`` message left us (``sent``
    empty: from the start), lasts ``duration`` seconds. ``way``: ``up`` (from us), ``down``, ``both``.
    """

    kind: str
    after: float = 0.0
    duration: float = math.inf
    size: float = 0.0
    way: str = "both"
    sent: str = ""
    count: int = 1

    def __post_init__(self) -> None:
        if self.kind not in {*KINDS, *STATION_KINDS}:
            raise ValueError(f"no fault called {self.kind}: {', '.join(KINDS)}")

    def concerns(self, way: str) -> bool:
        """Whether frames going that way are hit."""
        return self.way in (way, "both")

    def to_dict(self) -> dict[str, Any]:
        """Plain data; an endless duration is None."""
        return {**asdict(self), "duration": None if math.isinf(self.duration) else self.duration}

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Self:
        """The inverse of :meth:`to_dict`."""
        return cls(**{**data, "duration": math.inf if data["duration"] is None else data["duration"]})

    def __str__(self) -> str:
        where = f"{self.count}. {self.sent}" if self.sent else "start"
        lasting = " forever" if math.isinf(self.duration) else f" for {self.duration:.3g} s"
        shown = lasting if self.kind in LASTING else ""
        return f"{self.kind} {self.size:.3g} {self.way} from {where} + {self.after:.4g} s{shown}"
