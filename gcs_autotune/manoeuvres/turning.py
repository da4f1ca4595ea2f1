"""The turning circle and the pull-out: the rudder is held until the heading has turned once, then set amidships.

From the circle follow advance, transfer, tactical diameter and the steady turn. The remaining turn after the pull-out
shows directional stability (ITTC 7.5-04-02-01; IMO MSC.137(76), MSC/Circ.1053).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from gcs_autotune.craft import Observation
from gcs_autotune.manoeuvres.approach import Steering, UnderWay
from gcs_autotune.manoeuvres.kind import ManoeuvreKind, Preset
from gcs_autotune.manoeuvres.manoeuvre import Commands
from gcs_autotune.manoeuvres.open_loop import turning

__all__ = ["KINDS", "CircleAndPullOut", "PullOuts"]

LEAST_GAIN, PATIENCE = math.radians(30.0), 60.0
"""Smallest change of heading [rad], and the time [s] in which it must be reached for a craft to count as turning.
Project choice.
"""
LEAST_PULL_OUT = 10.0
"""Shortest time [s] for which the rudder stays amidships. Project choice."""


class CircleAndPullOut(UnderWay):
    """Turning circle and pull-out: approach, rudder to one side until the heading has changed by ``turn`` [rad], then
    amidships until steady.
    """

    kind = "turning-circle"

    def __init__(self, turn: float, steering: Steering, name: str = "") -> None:
        super().__init__(steering, name)
        self._turn = turn

    @property
    def meta_fields(self) -> Mapping[str, Any]:
        """Settings of the steering and change of heading [rad] by name, for the trial's ``meta``."""
        return {**super().meta_fields, "turn": self._turn}

    def commands(self, now: Observation) -> Commands:
        """Yield the commands of the approach, the turn and the pull-out."""
        now = yield from self._approached(now)
        side, base = self._steering.side, now.psi
        helm = side * self._steering.share
        self._execute("turn", helm, now)
        since, gained = now.t, LEAST_GAIN
        while side * (now.psi - base) < self._turn:
            turned = side * (now.psi - base)
            if turned >= gained:
                since, gained = now.t, turned + LEAST_GAIN
                # a target would be shown as a heading: after a full turn that at which the turn began
                self.phase = f"turn, {math.degrees(turned):.0f} of {math.degrees(self._turn):.0f} deg"
            elif now.t - since > PATIENCE:
                self._end("aborted", self._stuck(turned))
            now = yield self._command(helm, now)
        self._execute("pull-out", 0.0, now)
        now = yield from self._held(0.0, now, LEAST_PULL_OUT)
        self._end("completed", f"turned by {math.degrees(self._turn):.0f} deg and pulled out")
        yield self._command(0.0, now)

    def _stuck(self, turned: float) -> str:
        return (
            f"the heading changed by {math.degrees(turned):.0f} deg of {math.degrees(self._turn):.0f} deg, and by "
            f"less than {math.degrees(LEAST_GAIN):.0f} deg in the last {PATIENCE:.0f} s. Use more helm (--rudder "
            "or --steering; less if it stalls) or more speed (--throttle)"
        )


class PullOuts(UnderWay):
    """Pull-outs to both sides, to test directional stability: approach, then a steady turn and the rudder amidships, to
    either side.
    """

    kind = "pull-out"

    def commands(self, now: Observation) -> Commands:
        """Yield the commands of a turn and a pull-out, then of a turn and a pull-out to the other side."""
        now = yield from self._approached(now)
        for k, side in enumerate((self._steering.side, -self._steering.side), start=1):
            helm = side * self._steering.share
            self._execute(f"turn {k}", helm, now)
            now = yield from self._held(helm, now)
            self._execute(f"pull-out {k}", 0.0, now)
            now = yield from self._held(0.0, now, LEAST_PULL_OUT)
        self._end("completed", "pulled out of one turn to each side")
        yield self._command(0.0, now)


KINDS: tuple[ManoeuvreKind, ...] = (
    ManoeuvreKind(
        name="turning-circle",
        help="steering to one side until the heading has changed by an angle, then amidships (pull-out)",
        excites=frozenset({"yaw", "surge", "sway"}),
        drives=frozenset({"N"}),
        make=lambda options: CircleAndPullOut(options["turn"], Steering.of(options)),
        options=("turn", "rudder", "full-rudder", "steering"),
        room="two turning circles",
        turns=True,
        presets=tuple(
            Preset(f"turning circle at {p} % throttle", "X N", turning("turning-circle", p / 100.0))
            for p in (30, 60, 100)
        ),
    ),
    ManoeuvreKind(
        name="pull-out",
        help="a steady turn, then helm amidships, to one side and to the other",
        excites=frozenset({"yaw"}),
        drives=frozenset({"N"}),
        make=lambda options: PullOuts(Steering.of(options)),
        options=("rudder", "full-rudder", "steering"),
        room="two turning circles",
        turns=True,
    ),
)
"""Entries of the table of manoeuvres for turning manoeuvres."""
