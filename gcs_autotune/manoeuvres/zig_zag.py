"""The zig-zag (Kempf): rudder to one side until the heading has changed by an angle, then to the other side.

From it follow overshoot angles, times and Nomoto's K and T (ITTC 7.5-04-02-01, IMO MSC.137(76); Miskovic2010, alg.
4.1). Any pair of angles and either first side are possible, with a rudder, two thrusters or an ROV's yaw moment.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gcs_autotune.craft import Observation
from gcs_autotune.manoeuvres.approach import Steering, UnderWay
from gcs_autotune.manoeuvres.kind import ManoeuvreKind, Preset
from gcs_autotune.manoeuvres.manoeuvre import Commands

__all__ = ["KIND", "ZigZag", "ZigZagSettings"]


@dataclass(frozen=True, slots=True)
class ZigZagSettings:
    """Settings of a zig-zag: angles rad, times s.

    Attributes
    ----------
    heading : deviation from the approach's heading at which the rudder is reversed.
    executes : number of rudder reversals; the manoeuvre ends when the heading has returned after the last.
    approach : seconds straight ahead before the first execute; None: until the speed is steady.
    duration : longest duration. patience : the longest time between two executes.
    """

    heading: float
    executes: int = 5
    approach: float | None = None
    duration: float = math.inf
    patience: float = 60.0


class ZigZag(UnderWay):
    """Zig-zag: approach, then the rudder reversals. The manoeuvre marks ``execute`` with the heading [rad] and the new
    rudder.
    """

    kind = "zig-zag"

    def __init__(self, settings: ZigZagSettings, steering: Steering, name: str = "") -> None:
        super().__init__(steering, name)
        self._settings = settings

    @property
    def meta_fields(self) -> Mapping[str, Any]:
        """Angles [rad] and sizes as flown by name, for the trial's ``meta``."""
        return {**super().meta_fields, "heading": self._settings.heading, "executes": self._settings.executes}

    def commands(self, now: Observation) -> Commands:
        """Yield the commands of the approach, then the rudder to one side and the other in turn."""
        s, start = self._settings, now.t
        if s.approach is None:
            now = yield from self._approached(now)
        while s.approach is not None and now.t - start < s.approach:
            now = yield self._command(0.0, now)
        base = self._course if math.isfinite(self._course) else now.psi
        side, executed, since, farthest = self._steering.side, 0, -math.inf, 0.0
        while True:
            deviation = now.psi - base
            if not executed or (executed < s.executes and side * deviation > s.heading):
                side = side if not executed else -side
                executed, since, farthest = executed + 1, now.t, 0.0
                self.phase, self.target = f"execute {executed}", base + side * s.heading
                self._mark(now.t, "execute", {"psi": deviation, "N": side * self._steering.share})
            farthest = max(farthest, side * deviation)
            if executed >= s.executes and executed > 1 and side * deviation >= 0.0:
                self._end("completed", f"{executed} executes")
            elif now.t - start >= s.duration:
                self._end("completed", f"{executed} executes in the available time")
            elif now.t - since > s.patience:
                self._end("aborted", self._too_far(executed, farthest))
            now = yield self._command(side * self._steering.share, now)

    def _too_far(self, executed: int, farthest: float) -> str:
        s = self._settings
        return (
            f"after execute {executed} the heading changed by {math.degrees(farthest):.1f} deg in "
            f"{s.patience:.0f} s, of {math.degrees(s.heading):g} deg required. Use a smaller --heading, more helm "
            "(--rudder or --steering; less if it stalls) or more speed (--throttle)"
        )


def _make(options: Mapping[str, float]) -> ZigZag:
    return ZigZag(ZigZagSettings(options["heading"], int(options["executes"])), Steering.of(options))


def _preset(angle: float, throttle: float) -> Preset:
    def make(seconds: float) -> ZigZag:
        approach = (0.12 if throttle else 0.02) * seconds
        settings = ZigZagSettings(math.radians(angle), executes=10**6, approach=approach, patience=math.inf)
        return ZigZag(settings, Steering(1.0, throttle=throttle))

    title = f"zig-zag {angle:g}/{angle:g}" + (f" at {100.0 * throttle:.0f} % throttle" if throttle else "")
    return Preset(title, "X N" if throttle else "N", make, closed=True)


KIND = ManoeuvreKind(
    name="zig-zag",
    help="steering to one side until the heading has changed by an angle, then to the other side, repeated",
    excites=frozenset({"yaw"}),
    drives=frozenset({"N"}),
    make=_make,
    options=("heading", "rudder", "full-rudder", "steering", "executes"),
    room="about ten seconds of travel ahead, and a third of this to either side",
    presets=(
        *(_preset(angle, throttle) for angle in (10.0, 20.0, 35.0) for throttle in (0.3, 0.6, 1.0)),
        _preset(20.0, 0.0),
        _preset(45.0, 0.0),
    ),
)
