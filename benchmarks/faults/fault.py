"""Faults: kind, time, duration and size."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any, Self

__all__ = ["KINDS", "LASTING", "STATION_KINDS", "Fault"]

KINDS = {
    "loss": "frames are lost with probability size",
    "delay": "frames are size seconds late, in order",
    "reorder": "a third of the frames are up to size seconds late, out of order",
    "duplicate": "a third of the frames are repeated up to size seconds later",
    "corrupt": "bytes of a frame are changed, removed or inserted with probability size",
    "silence": "no frame passes",
    "stuck": "only heartbeats pass; size 1: other messages repeat their last contents",
    "wrong-system": "the vehicle's messages have another system id",
    "forged-foreign": "wrong PARAM_VALUEs of another system precede the right ones",
    "forged-own": "wrong PARAM_VALUEs with the vehicle's id precede some of the right ones",
    "unplugged": "every call of the link fails, as with a removed serial adapter",
    "killed": "the tool ends at once, as by kill -9 or a power cut",
    "reboot": "the autopilot restarts and is silent for size seconds; it keeps its parameters",
    "disk-full": "no file can grow",
    "operator": "the operator presses Ctrl-C",
}
"""Kind -> description. The first ten last for a time; the others are events."""

STATION_KINDS = {
    "station-mode": "another station, on its own link, orders a mode",
    "station-disarm": "it disarms the vehicle",
    "station-sticks": "it sends overrides with the tool's system id for duration seconds",
    "station-write": "it writes a gain",
    "stall": "the tool's computer pauses for size seconds",
}
"""Kind -> description, for faults of another station or the tool's computer. ``draw_station_case`` draws them."""

LASTING = tuple(KINDS)[:10]


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault.

    It starts ``after`` seconds after the tool sent its ``count``-th message ``sent`` (empty: after the start), and
    lasts ``duration`` seconds. ``way``: ``up`` (from the tool), ``down``, ``both``.
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
            raise ValueError(f"unknown fault {self.kind}; known are {', '.join(KINDS)}")

    def concerns(self, way: str) -> bool:
        """Return whether it affects frames in this direction."""
        return self.way in (way, "both")

    def to_dict(self) -> dict[str, Any]:
        """Return plain data; an endless duration is None."""
        return {**asdict(self), "duration": None if math.isinf(self.duration) else self.duration}

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Self:
        """Read :meth:`to_dict`."""
        return cls(**{**data, "duration": math.inf if data["duration"] is None else data["duration"]})

    def __str__(self) -> str:
        where = f"{self.count}. {self.sent}" if self.sent else "start"
        lasting = " forever" if math.isinf(self.duration) else f" for {self.duration:.3g} s"
        shown = lasting if self.kind in LASTING else ""
        return f"{self.kind} {self.size:.3g} {self.way} from {where} + {self.after:.4g} s{shown}"
