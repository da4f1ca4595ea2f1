"""The zig-zag (Kempf): rudder hard to one side until the heading has followed by an angle, then to the other.

Overshoot angles, times and Nomoto's K and T are read off it (ITTC 7.5-04-02-01, IMO MSC.137(76); Miskovic2010, alg.
4.1). Any pair of angles, either side first; by a rudder, two thrusters or an ROV's yaw moment.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gcs_autotune.craft import Actuate, Command, Observation
from gcs_autotune.manoeuvres.approach import Approach
from gcs_autotune.manoeuvres.hold_controller import HELD_MEANWHILE, HeadingHold, HoldController, hold
from gcs_autotune.manoeuvres.kind import ManoeuvreKind, Preset
from gcs_autotune.manoeuvres.manoeuvre import Commands, Manoeuvre

__all__ = ["KIND", "ZigZag", "ZigZagSettings"]


@dataclass(frozen=True, slots=True)
class ZigZagSettings:
    """What to fly: angles rad, outputs fractions of full, times s.

    Attributes
    ----------
    heading : deviation from the approach's heading at which the rudder is reversed.
    steering : rudder, or yaw moment, held to either side.
    side : 1 begins to starboard, -1 to port.
    executes : times the rudder is put over; it ends when the heading is back after the last.
    throttle : constant thrust ahead. approach : seconds ahead before the first execute; None until the speed is steady.
    duration : it ends then at the latest. patience : the longest time between two executes.
    full_rudder : rudder angle at full steering output; None when there is no rudder, or nobody knows.
    keep_still : hold an ROV's depth meanwhile.
    """

    heading: float
    steering: float
    side: int = 1
    executes: int = 5
    throttle: float = 0.0
    approach: float | None = None
    duration: float = math.inf
    patience: float = 60.0
    full_rudder: float | None = None
    keep_still: bool = False


class ZigZag(Manoeuvre):
    """Approach, then the executes. Marks ``execute`` with the heading [rad] and the rudder put over to."""

    kind = "zig-zag"

    def __init__(self, settings: ZigZagSettings, name: str = "") -> None:
        super().__init__(name)
        self._settings = settings
        self._approach = Approach("psi", needs_way=settings.throttle != 0.0)
        self._heading_hold = HeadingHold()
        self._holds = [HoldController(gains) for gains in HELD_MEANWHILE["psi"]] if settings.keep_still else []
        self._began = math.nan

    @property
    def asked(self) -> Mapping[str, Any]:
        """Angles and sizes as flown; ``from_t`` is where the approach was over but for its last seconds."""
        s = self._settings
        return {
            "dof": "yaw",
            "signal": "psi",
            "force": "N",
            "heading": s.heading,
            "steering": s.side * s.steering,
            **({} if s.full_rudder is None else {"full_rudder": s.full_rudder}),
            "executes": s.executes,
            "throttle": s.throttle,
            "noise_std": self._approach.noise_std,
            "speed": self._approach.speed,
        }

    def commands(self, now: Observation) -> Commands:
        """Yield the approach, then the rudder to one side and the other."""
        s, start = self._settings, now.t
        self._approach.start(now)
        self._heading_hold.start(now)
        self.phase = "approach"
        while not self._is_approached(now, now.t - start):
            steering = self._heading_hold.steer(now) if s.throttle and s.approach is None else 0.0
            now = yield self._command(steering, now)
        base, side, executed, since, farthest = now.psi, s.side, 0, -math.inf, 0.0
        while True:
            deviation = now.psi - base
            if not executed or (executed < s.executes and side * deviation > s.heading):
                side = side if not executed else -side
                executed, since, farthest = executed + 1, now.t, 0.0
                self.phase, self.target = f"execute {executed}", base + side * s.heading
                self._mark(now.t, "execute", {"psi": deviation, "N": side * s.steering})
            farthest = max(farthest, side * deviation)
            if executed >= s.executes and executed > 1 and side * deviation >= 0.0:
                self._end("completed", f"{executed} executes flown")
            elif now.t - start >= s.duration:
                self._end("completed", f"{executed} executes flown in the time given")
            elif now.t - since > s.patience:
                self._end("aborted", self._too_far(executed, farthest))
            now = yield self._command(side * s.steering, now)

    def _is_approached(self, now: Observation, elapsed: float) -> bool:
        if self._settings.approach is not None:
            return elapsed >= self._settings.approach
        self._approach.update(now.t, now.psi, now.speed)
        return self._approach.done

    def _command(self, steering: float, now: Observation) -> Command:
        return hold(Actuate(X=self._settings.throttle, N=steering), self._holds, now)

    def _too_far(self, executed: int, farthest: float) -> str:
        s = self._settings
        return (
            f"after execute {executed} the heading came to {math.degrees(farthest):.1f} deg in {s.patience:.0f} s, and "
            f"{math.degrees(s.heading):g} deg are wanted: give a smaller --heading, more rudder (--rudder or "
            "--steering) or more way (--throttle)"
        )


def _make(options: Mapping[str, float]) -> ZigZag:
    return ZigZag(
        ZigZagSettings(
            heading=options["heading"],
            steering=options["steering"],
            side=int(options["side"]),
            executes=int(options["executes"]),
            throttle=options["throttle"],
            full_rudder=options.get("full-rudder"),
            keep_still=bool(options["keep-still"]),
        )
    )


def _preset(angle: float, throttle: float) -> Preset:
    def make(seconds: float) -> ZigZag:
        approach = (0.12 if throttle else 0.02) * seconds
        return ZigZag(
            ZigZagSettings(
                math.radians(angle), 1.0, executes=10**6, throttle=throttle, approach=approach, patience=math.inf
            )
        )

    title = f"zig-zag {angle:g}/{angle:g}" + (f" at {100.0 * throttle:.0f} % throttle" if throttle else "")
    return Preset(title, "X N" if throttle else "N", make, closed=True)


KIND = ManoeuvreKind(
    name="zig-zag",
    help="rudder to one side until the heading has followed by an angle, then to the other",
    excites=frozenset({"yaw"}),
    drives=frozenset({"N"}),
    make=_make,
    options=("heading", "rudder", "full-rudder", "steering", "executes"),
    room="some ten times the speed per second ahead, and a third of it to either side",
    presets=(
        *(_preset(angle, throttle) for angle in (10.0, 20.0, 35.0) for throttle in (0.3, 0.6, 1.0)),
        _preset(20.0, 0.0),
        _preset(45.0, 0.0),
    ),
)
