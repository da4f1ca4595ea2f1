"""Relays on the autopilot's own set-point: the heading commanded jumps to either side (Miskovic2010, 6.6.4).

The relay stands outside the closed heading loop, psi_ref = psi_0 +- C, and switches where the heading passes x_a to
either side. Two of different size tell the loop as it is flown, (6.49), without driving an actuator directly.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from gcs_autotune.craft import HeadingTarget, Observation
from gcs_autotune.errors import UsageError
from gcs_autotune.manoeuvres.approach import Approach, Part
from gcs_autotune.manoeuvres.kind import ManoeuvreKind
from gcs_autotune.manoeuvres.manoeuvre import Commands, Manoeuvre

if TYPE_CHECKING:
    from gcs_autotune.identify import LimitCycleMonitor

__all__ = ["KIND", "SetPointRelay"]

PERIODS, MOST_PERIODS = 5, 15
"""Consecutive periods that must agree (Miskovic2010, 6.7), and those after which a relay is taken as it is."""
LONGEST, LEAST_SWITCHINGS = 110.0, 6
"""Chosen [s]: a relay that has not settled by then, and has switched so often, is taken as it is: a boat runs on."""
PATIENCE = 60.0
"""Chosen [s]: a loop that does not bring the heading past x_a by then does not follow."""


class SetPointRelay(Manoeuvre):
    """Holds its course, then flies each of ``relays`` (C, x_a) [rad] until its oscillation has settled.

    ``speed`` [m/s] ahead meanwhile. Marks ``relay`` where one begins, and ``switch`` with the heading commanded.
    """

    kind, purpose, in_manual = "set-point-relay", "check", False

    def __init__(self, relays: tuple[tuple[float, float], ...], speed: float = 0.0, name: str = "") -> None:
        super().__init__(name)
        self._relays, self._speed = relays, speed
        self._approach = Approach("psi", needs_way=speed > 0.0)
        self._unsettled = 0
        for C, x_a in relays:
            if not 0.0 < x_a < C:
                raise UsageError(
                    f"a relay that commands {math.degrees(C):g} deg never sees the heading pass {math.degrees(x_a):g} "
                    "deg surely: give a --hysteresis below --set-point"
                )

    @property
    def asked(self) -> Mapping[str, Any]:
        """The relays, the speed, the noise of the heading."""
        return {
            "dof": "yaw",
            "signal": "psi",
            "set_points": [C for C, _ in self._relays],
            "hystereses": [x_a for _, x_a in self._relays],
            "speed": self._approach.speed,
            "noise_std": self._approach.noise_std,
        }

    def commands(self, now: Observation) -> Commands:
        """Yield the course, then the relays about it."""
        self.phase, course = "approach", now.psi
        self._approach.start(now)
        while not self._approach.done:
            self._approach.update(now.t, now.psi, now.speed)
            now = yield HeadingTarget(course, self._speed)
        for number, (C, x_a) in enumerate(self._relays, start=1):
            now = yield from self._swung(number, course, C, x_a, now)
            if self.outcome is not None:
                break
        else:
            rest = (
                f", of which {self._unsettled} did not settle: the loop hardly damps" if self._unsettled else " settled"
            )
            self._end("completed", f"{len(self._relays)} relays about the course{rest}")
        self.target = course
        yield HeadingTarget(course, self._speed)

    def _swung(self, number: int, course: float, C: float, x_a: float, now: Observation) -> Part:
        """Fly one relay until it has settled."""
        monitor, high, switched, began = _monitor(C, x_a), True, now.t, now.t
        self.phase = f"relay {number}"
        self._mark(now.t, "relay", {"C": C, "x_a": x_a})
        self._mark(now.t, "switch", {"psi_ref": course + C})
        while True:
            x = now.psi - course
            if x >= x_a if high else x <= -x_a:
                high, switched = not high, now.t
                self._mark(now.t, "switch", {"psi_ref": course + (C if high else -C)})
            state = monitor.update(now.t, x, high)
            self.target = course + (C if high else -C)
            late = now.t - began > LONGEST and state.switchings >= LEAST_SWITCHINGS
            if state.settled or late or state.switchings >= 2 * MOST_PERIODS:
                self._unsettled += not state.settled
                return now
            if now.t - switched > PATIENCE:
                self._end(
                    "aborted",
                    f"commanded {math.degrees(C):.0f} deg to one side, the heading does not pass "
                    f"{math.degrees(x_a):.0f} deg within {PATIENCE:.0f} s: the loop does not follow",
                )
                return now
            now = yield HeadingTarget(self.target, self._speed)


def _monitor(C: float, x_a: float) -> LimitCycleMonitor:
    from gcs_autotune.identify import LimitCycleMonitor  # a second to import, which the table need not take

    return LimitCycleMonitor(C, x_a, periods=PERIODS)


def _make(options: Mapping[str, float]) -> SetPointRelay:
    pairs = (("set-point", "hysteresis"), ("second-set-point", "second-hysteresis"))
    return SetPointRelay(tuple((options[C], options[x_a]) for C, x_a in pairs), options.get("speed", 0.0))


KIND = ManoeuvreKind(
    name="set-point-relay",
    help="the heading commanded jumps to either side of the course, under the autopilot's own loop; two sizes",
    excites=frozenset({"yaw"}),
    drives=frozenset(),
    make=_make,
    options=("set-point", "hysteresis", "second-set-point", "second-hysteresis"),
    room="a boat goes on at its cruise meanwhile",
    identifies=False,
)
