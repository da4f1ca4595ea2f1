"""Spirals: measure the steady yaw rate as a function of the helm, in steps of helm (Dieudonne) or of rate (Bech).

For a craft that is unstable on course, the rate jumps in the direct spiral. In the reverse spiral its curve has a
negative slope (ITTC 7.5-04-02-01).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from gcs_autotune.craft import Observation
from gcs_autotune.manoeuvres.approach import Steering, UnderWay
from gcs_autotune.manoeuvres.kind import ManoeuvreKind
from gcs_autotune.manoeuvres.manoeuvre import Commands

__all__ = ["KINDS", "BechSpiral", "DirectSpiral"]

KNEE = 1.0 - math.exp(-1.0)
"""Fraction of the steady rate that a turn reaches after one time constant: 1 - 1/e."""
RATE_TIMES, LEAST_RATE_TIME = 6.0, 8.0
"""Duration of a held rate, in time constants of the turn, and its minimum [s]. Project choice."""
LEAST_LAG = 0.5
"""Shortest time constant assumed [s]; with a shorter one the link's delay would cause oscillation. Project choice."""
LEAST_TURN = math.radians(0.5)
"""Turn rate [rad/s] below which a helm counts as causing no turn. Project choice."""


class DirectSpiral(UnderWay):
    """Direct spiral: step the helm from one side to the other and back; each helm is held until the turn is steady.

    ``levels``: number of helms on either side, in addition to amidships.
    """

    kind = "spiral"

    def __init__(self, levels: int, steering: Steering, name: str = "") -> None:
        super().__init__(steering, name)
        self._levels = levels

    @property
    def meta_fields(self) -> Mapping[str, Any]:
        """Settings of the steering and number of levels by name, for the trial's ``meta``."""
        return {**super().meta_fields, "levels": self._levels}

    def commands(self, now: Observation) -> Commands:
        """Yield the commands of the approach, then the helms in turn."""
        now = yield from self._approached(now)
        n, helm = self._levels, self._steering.side * self._steering.share
        there = [k / n for k in range(n, -n - 1, -1)]
        for k, share in enumerate([*there, *reversed(there[:-1])], start=1):
            self._execute(f"helm {k}", share * helm, now)
            now = yield from self._held(share * helm, now)
        self._end("completed", f"{4 * n + 1} steering levels held")
        yield self._command(0.0, now)


class BechSpiral(UnderWay):
    """Reverse spiral: step the yaw rate from that of the first rudder angle to the opposite rate. A slow controller
    holds each rate.

    The first turn determines the rate and the controller. Its proportional gain closes the loop with about the craft's
    own time constant. Its integral has the same time constant.
    """

    kind = "reverse-spiral"

    def __init__(self, levels: int, steering: Steering, name: str = "") -> None:
        super().__init__(steering, name)
        self._levels = levels

    @property
    def meta_fields(self) -> Mapping[str, Any]:
        """Settings of the steering and number of levels by name, for the trial's ``meta``."""
        return {**super().meta_fields, "levels": self._levels}

    def commands(self, now: Observation) -> Commands:
        """Yield the commands of the approach, of the first turn, and of the controller at each rate."""
        now = yield from self._approached(now)
        helm = self._steering.side * self._steering.share
        self._execute("first turn", helm, now)
        now = yield from self._held(helm, now)
        rate, lag = self._reading()
        if abs(rate) < LEAST_TURN:
            self._end(
                "aborted",
                f"at {abs(helm):.0%} steering the craft turns at only {math.degrees(abs(rate)):.1f} deg/s. Use more "
                "rudder (--rudder or --steering) or more speed (--throttle)",
            )
            yield self._command(0.0, now)
        n, integral = self._levels, helm
        for k in range(n, -n - 1, -1):
            wanted, start = rate * k / n, now.t
            self.phase = f"rate {n - k + 1}"
            self._mark(now.t, "rate", {"r": wanted})
            while now.t - start < max(RATE_TIMES * lag, LEAST_RATE_TIME):
                error = (wanted - now.r) * helm / rate
                before = now.t
                now = yield self._command(_within(integral + error), now)
                integral = _within(integral + error * (now.t - before) / lag)
        self._end("completed", f"{2 * n + 1} rates held")
        yield self._command(0.0, now)

    def _reading(self) -> tuple[float, float]:
        """Return rate [rad/s] and time constant [s] of the turn just held."""
        late = [r for _, r in self._rates[-max(len(self._rates) // 4, 1) :]]
        rate = sum(late) / len(late)
        lag = next(t for t, r in self._rates if abs(r) >= KNEE * abs(rate))
        return rate, max(lag, LEAST_LAG)


def _within(helm: float) -> float:
    return max(-1.0, min(1.0, helm))


KINDS: tuple[ManoeuvreKind, ...] = (
    ManoeuvreKind(
        name="spiral",
        help="direct spiral (Dieudonne): steering (a rudder, or unequal thrust) in steps from one side to the other "
        "and back, each held until steady",
        excites=frozenset({"yaw"}),
        drives=frozenset({"N"}),
        make=lambda options: DirectSpiral(int(options["levels"]), Steering.of(options)),
        options=("levels", "rudder", "full-rudder", "steering"),
        room="the turning circle of the smallest rudder angle",
        turns=True,
    ),
    ManoeuvreKind(
        name="reverse-spiral",
        help="reverse spiral (Bech): a series of yaw rates, each held by a slow controller, to record the rudder "
        "each rate needs",
        excites=frozenset({"yaw"}),
        drives=frozenset({"N"}),
        make=lambda options: BechSpiral(int(options["levels"]), Steering.of(options)),
        options=("levels", "rudder", "full-rudder", "steering"),
        room="the turning circle of the smallest yaw rate",
        turns=True,
    ),
)
"""Entries of the table of manoeuvres for spirals."""
