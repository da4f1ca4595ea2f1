"""Free decay after a push by hand: the operator tilts and releases the craft, and its oscillation decays.

It is used for roll and pitch, which no actuator drives (ITTC 7.5-02-07-04.5).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from gcs_autotune.craft import Actuate, Observation
from gcs_autotune.errors import UsageError
from gcs_autotune.manoeuvres.kind import ManoeuvreKind
from gcs_autotune.manoeuvres.manoeuvre import Commands, Manoeuvre

__all__ = ["KIND", "FreeDecay"]

REST = 3.0
"""Time [s] over which the angle at rest is averaged. Project choice."""
PUSHED = math.radians(5.0)
"""Tilt [rad] that counts as a push. It is larger than that due to waves and handling. Project choice."""
PATIENCE = 120.0
"""Longest time to wait for the push [s]. Project choice."""
DECAYED, QUIET = 0.1, 3.0
"""Fraction of the largest angle that counts as zero, and how long it must last [s]. Project choice."""


class FreeDecay(Manoeuvre):
    """Waits with every output neutral for a push on ``force`` (``K`` or ``M``), then records the decay.

    It ends at most ``duration`` [s] after the push. It marks ``push`` when the angle leaves its rest value.
    """

    kind, purpose, by_hand = "hand-release", "check", True

    def __init__(self, force: str, duration: float) -> None:
        super().__init__(force=force, signal={"K": "phi", "M": "theta"}[force])
        self._duration, self._rest = duration, math.nan

    @property
    def asked(self) -> Mapping[str, Any]:
        """Settings and result: force, its degree of freedom and the angle at rest."""
        return {"dof": {"K": "roll", "M": "pitch"}[self.force], "force": self.force, "signal": self.signal,
                "rest": self._rest, "duration": self._duration}  # fmt: skip

    def commands(self, now: Observation) -> Commands:
        """Yield neutral outputs."""
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
