"""Free decay of roll and pitch (ITTC 7.5-02-07-04.5): the craft is released at an angle, and its oscillation decays.

The thrusters hold it at the angle first, or a person pushes it down if no thruster can.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from gcs_autotune.craft import Actuate, Observation
from gcs_autotune.errors import UsageError
from gcs_autotune.manoeuvres.hold_controller import HELD_DURING, HoldController, HoldGains, hold
from gcs_autotune.manoeuvres.kind import ManoeuvreKind
from gcs_autotune.manoeuvres.manoeuvre import Commands, Manoeuvre

__all__ = ["KIND", "FreeDecay", "Release", "released"]

REST = 3.0
"""Time [s] over which the angle at rest is averaged. Project choice."""
PUSHED = math.radians(5.0)
"""Tilt [rad] that counts as a push. It is larger than that due to waves and handling. Project choice."""
PATIENCE = 120.0
"""Longest time to wait for the push [s]. Project choice."""
DECAYED, QUIET = 0.1, 3.0
"""Fraction of the largest angle below which the angle counts as zero, and the time [s] for which it must stay below.
Project choice.
"""


class FreeDecay(Manoeuvre):
    """Waits with every output neutral for a push on ``force`` (``K`` or ``M``), then records the decay.

    It ends at most ``duration`` [s] after the push. It marks ``push`` when the angle leaves its rest value.
    """

    kind, purpose, by_hand = "hand-release", "check", True

    def __init__(self, force: str, duration: float) -> None:
        super().__init__(force=force, signal={"K": "phi", "M": "theta"}[force])
        self._duration, self._rest = duration, math.nan

    @property
    def meta_fields(self) -> Mapping[str, Any]:
        """Force, its degree of freedom and the angle at rest [rad] by name, for the trial's ``meta``."""
        return {"dof": _DOF[self.force], "force": self.force, "signal": self.signal,
                "rest": self._rest, "duration": self._duration}  # fmt: skip

    def commands(self, now: Observation) -> Commands:
        """Yield neutral outputs until the oscillation has decayed."""
        start, seen = now.t, []
        self.phase = "at rest: do not touch the craft"
        while now.t - start < REST:
            seen.append(now.value(self.signal))
            now = yield Actuate()
        self._rest = self.target = sum(seen) / len(seen)
        self.phase, start = "push the craft down and release it", now.t
        while not abs(now.value(self.signal) - self._rest) > PUSHED:
            if not now.t - start <= PATIENCE:
                self._end(
                    "aborted",
                    f"no push within {PATIENCE:.0f} s: {self.signal} stayed at rest. Push the craft down and release "
                    "it",
                )
                yield Actuate()
                return
            now = yield Actuate()
        self._mark(now.t, "push", {self.signal: now.value(self.signal) - self._rest})
        self.phase, start, largest, last = "swinging", now.t, 0.0, now.t
        while now.t - start < self._duration and now.t - last < QUIET:
            angle = abs(now.value(self.signal) - self._rest)
            largest = max(largest, angle)
            last = now.t if angle > DECAYED * largest else last
            now = yield Actuate()
        self._end("completed", f"decay from {math.degrees(largest):.0f} deg recorded for {now.t - start:.0f} s")
        yield Actuate()


HELD = 6.0
"""Time [s] for which the thrusters hold the craft at the angle before it is released. Project choice."""
KEPT = 1.0
"""Time [s] before the release with which the record begins. The output is nearly constant by then.

While the craft is tilted the output changes, and thrusters are not linear at small outputs: a dead zone would bias the
fit. On a simulated BlueROV2 the restoring moment of roll was 3 % too small.
"""
LEAST_OF_TILT = 0.5
"""Smallest angle at the release, as a fraction of the requested one. Project choice."""
_HOLDS: Mapping[str, HoldGains] = {
    "K": HoldGains("phi", "p", "K", P=0.15, I=0.1, D=0.06, most=0.4),
    "M": HoldGains("theta", "q", "M", P=0.15, I=0.1, D=0.06, most=0.4),
}
"""Gains that hold the angle. They are damped on craft that full output accelerates at 5 to 60 rad/s^2, at a delay of
0.1 s. Project choice."""


class Release(Manoeuvre):
    """Holds the craft at *tilt* [rad] from rest by the thrusters, releases it, and records the decay.

    It ends at most ``duration`` [s] after the release. It marks ``release``. Heading and depth are held throughout.
    """

    kind = "free-decay"

    def __init__(self, force: str, tilt: float, duration: float) -> None:
        super().__init__(force=force, signal=_HOLDS[force].signal)
        self._tilt, self._duration, self._rest = tilt, duration, math.nan
        self._kept_from = math.nan
        self._holds = [HoldController(gains) for gains in HELD_DURING[self.signal]]

    @property
    def meta_fields(self) -> Mapping[str, Any]:
        """Force, degree of freedom, tilt and angle at rest [rad] by name, for the trial's ``meta``. ``from_t``: time
        [s] at which the record begins, :data:`KEPT` before the release.
        """
        return {"dof": _DOF[self.force], "force": self.force, "signal": self.signal, "tilt": self._tilt,
                "rest": self._rest, "duration": self._duration, "from_t": self._kept_from}  # fmt: skip

    def commands(self, now: Observation) -> Commands:
        """Yield the outputs that hold the angle, then neutral ones until the oscillation has decayed."""
        start, seen = now.t, []
        self.phase = "at rest"
        while now.t - start < REST:
            seen.append(now.value(self.signal))
            now = yield hold(Actuate(), self._holds, now)
        self._rest = sum(seen) / len(seen)
        self.phase, self.target, start = "held at the angle", self._rest + self._tilt, now.t
        keeper = HoldController(_HOLDS[self.force], self.target)
        while now.t - start < HELD:
            now = yield hold(Actuate(), [*self._holds, keeper], now)
        angle = now.value(self.signal) - self._rest
        if not angle / self._tilt >= LEAST_OF_TILT:
            self._end(
                "aborted",
                f"the thrusters tilted the craft by {math.degrees(angle):.0f} deg in {HELD:.0f} s instead of "
                f"{math.degrees(self._tilt):.0f} deg. Check them, or use a smaller --tilt",
            )
        self._mark(now.t, "release", {self.signal: angle})
        self._kept_from = now.t - KEPT
        self.phase, self.target, start, last = "decay", self._rest, now.t, now.t
        while self.outcome is None:
            last = now.t if abs(now.value(self.signal) - self._rest) > DECAYED * abs(angle) else last
            if now.t - start >= self._duration or now.t - last >= QUIET:
                self._end("completed", f"decay from {math.degrees(angle):.0f} deg recorded for {now.t - start:.0f} s")
            now = yield hold(Actuate(), self._holds, now)
        yield Actuate()


def released(force: str, row: Callable[[str], ManoeuvreKind]) -> ManoeuvreKind:
    """Return the row of ``free-decay`` for roll (``K``) or pitch (``M``). *row* returns that of another force."""
    return ManoeuvreKind(
        name="free-decay",
        help=f"the thrusters hold an angle in {_DOF[force]} and let go, to record the decay of the motion",
        excites=frozenset({_DOF[force]}),
        drives=frozenset({force}),
        make=lambda options: Release(force, options["side"] * options["tilt"], options["duration"]),
        options=("tilt", "duration"),
        stays=True,
        for_force=row,
        shrinks={"tilt": 1.0},
    )


_DOF: Mapping[str, str] = {"K": "roll", "M": "pitch"}


def _of(force: str) -> ManoeuvreKind:
    """Return the table row for roll (``K``) or pitch (``M``)."""
    if force not in ("K", "M"):
        raise UsageError(
            f"hand-release works for roll (--force K) or pitch (--force M). For --force {force} fly free-decay"
        )
    return ManoeuvreKind(
        name="hand-release",
        help="decay of roll (--force K) or pitch (--force M) after a push by hand, with neutral outputs",
        excites=frozenset({"roll" if force == "K" else "pitch"}),
        drives=frozenset(),
        make=lambda options: FreeDecay(force, options["duration"]),
        options=("duration",),
        identifies=False,
        turns=True,
        for_force=_of,
    )


KIND = _of("K")
