"""Stop from a steady speed ahead: the thrust is removed or reversed until the craft stops.

Stopping distance and time are computed from the record (IMO MSC.137(76), 4.2.5, with the astern thrust of 5.3.4; ITTC
7.5-04-02-01).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gcs_autotune.craft import Observation
from gcs_autotune.manoeuvres.approach import Steadiness, Steering, UnderWay
from gcs_autotune.manoeuvres.kind import ManoeuvreKind, Preset
from gcs_autotune.manoeuvres.manoeuvre import Commands
from gcs_autotune.manoeuvres.open_loop import WITHOUT_THROTTLE, coasting

__all__ = ["KIND", "STOPPED", "Stopping"]

STOPPED = 0.1
"""Fraction of the approach speed below which a craft counts as stopped, because quadratic drag alone never stops it.
Project choice."""
LEAST_SPEED = 0.1
"""Speed [m/s] below which the manoeuvre is not flown. Project choice."""
COASTING_WINDOW = 3.0
"""Time [s] over which the speed of a coasting craft is averaged. It falls so slowly that single readings are below the
limit much too early. Thrust astern moves the craft astern within this time, so that single readings count there.
Project choice."""
PATIENCE = 180.0


class Stopping(UnderWay):
    """Stopping test: approach at a throttle, then zero or ``astern`` (normalised) until the craft has stopped.

    The rudder stays amidships. Marks ``execute`` with the commanded thrust.
    """

    kind = "stopping"

    def __init__(self, astern: float, steering: Steering, name: str = "") -> None:
        super().__init__(steering, name, signal="u", force="X")
        self._astern = astern

    @property
    def meta_fields(self) -> Mapping[str, Any]:
        """Throttle and thrust astern [fraction of full] by name, for the trial's ``meta``."""
        return {**super().meta_fields, "dof": "surge", "astern": self._astern}

    def commands(self, now: Observation) -> Commands:
        """Yield the commands of the approach, then zero thrust or thrust astern."""
        now = yield from self._approached(now)
        speed, start = self._approach.speed, now.t
        if not speed >= LEAST_SPEED:
            self._end(
                "aborted",
                f"the craft makes {speed:.2f} m/s at {self._steering.throttle:.0%} throttle, too little for a stopping "
                "trial. Use more --throttle, and check that the vehicle reports its speed",
            )
        self.phase, self.target = "stopping", STOPPED * speed
        self._mark(now.t, "execute", {"X": -self._astern})
        recent = Steadiness(COASTING_WINDOW)
        while self.outcome is None:
            recent.update(now.t, now.u)
            if (now.u if self._astern else recent.mean) <= STOPPED * speed:
                self._end("completed", "stopped by thrust astern" if self._astern else "coasted until stopped")
            elif now.t - start > PATIENCE:
                self._end(
                    "stopped",
                    f"not stopped {PATIENCE:.0f} s after {speed:.2f} m/s: the craft still makes {now.u:.2f} m/s",
                )
            else:
                now = yield self._command(0.0, now, -self._astern)
        yield self._command(0.0, now, 0.0)


KIND = ManoeuvreKind(
    name="stopping",
    help="steady speed ahead, then no thrust, or thrust astern (--astern), until the craft has stopped",
    excites=frozenset({"surge"}),
    drives=frozenset({"X"}),
    make=lambda options: Stopping(
        options.get("astern", 0.0), Steering.of({**options, "throttle": options["throttle"] or WITHOUT_THROTTLE})
    ),
    options=("astern",),
    room="about twenty lengths straight ahead",
    presets=(
        Preset("acceleration and coast-down", "X", coasting("stopping", (1.0,))),
        Preset("accelerations to three speeds and coast-down", "X", coasting("stopping", (0.3, 0.6, 1.0))),
    ),
)
