"""A manoeuvre flown on paper before anything moves: the track, the room and the time it takes, and what would end it.

The craft on paper turns as a model of its yaw says and goes at one speed; it does not slip sideways. For room that is
enough: a craft that slows down in its turns needs less.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from gcs_autotune.craft import Actuate, Observation
from gcs_autotune.errors import GuardTripped
from gcs_autotune.manoeuvres.envelope import Envelope, Watch
from gcs_autotune.manoeuvres.manoeuvre import Manoeuvre, Outcome
from gcs_autotune.models import SingleDof
from gcs_autotune.trial import Channel, Trial

__all__ = ["PaperCraft", "Preview", "preview"]

TICK, INSIDE = 0.1, 5
"""Seconds between two commands, as a link at 10 Hz gives; steps of the integration within."""
LONGEST = 3600.0
SPEED_TIME = 3.0
"""Chosen [s]: time constant with which a craft of a few metres gains its speed."""


@dataclass(frozen=True, slots=True)
class PaperCraft:
    """``yaw``: its turning, input as a fraction of full output. ``speed`` [m/s] at the throttle flown, ``source`` of
    these numbers in words. ``assumed``: they are guesses, good enough for room but not to refuse by."""

    yaw: SingleDof
    speed: float
    source: str
    assumed: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Preview:
    """What came of it.

    ``trial`` has psi, r, x, y, u, N and X. ``outcome``: how it ended, None when a safety limit did, which ``refusal``
    tells. ``room`` [m] is the longer side of the box around the track, ``turned`` [rad] the range of the heading.
    """

    trial: Trial
    outcome: Outcome | None
    refusal: str
    craft: PaperCraft
    room: float = math.nan
    turned: float = math.nan

    @property
    def seconds(self) -> float:
        """How long it takes."""
        return self.trial.duration

    @property
    def trouble(self) -> str:
        """Why it had better not be flown; empty when nothing speaks against it."""
        if self.refusal or self.outcome is None:
            return self.refusal
        return self.outcome.reason if self.outcome.ending == "aborted" else ""

    def told(self) -> str:
        """Return time, room and turning in one sentence."""
        way = f", {self.room:.0f} m of free water" if self.room >= 1.0 else ""
        turned = math.degrees(self.turned)
        return f"{self.seconds:.0f} s{way}, {turned:.0f} deg of turning, by {self.craft.source}"


def preview(manoeuvre: Manoeuvre, craft: PaperCraft, envelope: Envelope, *, floats: bool = True) -> Preview:
    """Fly *manoeuvre* on paper inside *envelope*, from rest, bow to the north; *floats*: it has no depth."""
    t = psi = r = x = y = u = 0.0
    z = math.nan if floats else 10.0
    late: deque[float] = deque([0.0] * round(craft.yaw.delay * INSIDE / TICK))
    rows: list[tuple[float, ...]] = []

    def seen(command: Actuate) -> Observation:
        output = {"N": command.N, "X": command.X}
        return Observation(t=t, psi=psi, r=r, x=x, y=y, z=z, u=u, v=0.0, w=0.0, speed=u, output=output, armed=True)

    now = seen(Actuate())
    watch, commands = Watch(envelope, now), manoeuvre.commands(now)
    outcome, refusal = None, ""
    command = next(commands)
    while t < LONGEST:
        asked = command if isinstance(command, Actuate) else Actuate()
        rows.append((t, psi, r, x, y, u, asked.N, asked.X))
        outcome = manoeuvre.outcome
        if outcome is not None:
            break
        for _ in range(INSIDE):
            h = TICK / INSIDE
            late.append(asked.N)
            r += h * _acceleration(craft.yaw, r, late.popleft())
            psi += h * r
            u += h * ((craft.speed if asked.X > 0.0 else 0.0) - u) / SPEED_TIME
            x, y = x + h * u * math.cos(psi), y + h * u * math.sin(psi)
        t += TICK
        now = seen(asked)
        try:
            watch.check(now)
        except GuardTripped as error:
            refusal = str(error).partition(". The actuators")[0]
            break
        command = commands.send(now)
    table = np.array(rows).T
    units = {"psi": "rad", "r": "rad/s", "x": "m", "y": "m", "u": "m/s", "N": "1", "X": "1"}
    channels = {n: Channel(n, unit, table[0], table[i]) for i, (n, unit) in enumerate(units.items(), start=1)}
    trial = Trial("predicted", channels, tuple(manoeuvre.take_marks()), meta=manoeuvre.settings)
    room = max(float(np.ptp(table[3])), float(np.ptp(table[4])))
    return Preview(trial, outcome, refusal, craft, room, float(np.ptp(table[1])))


def _acceleration(yaw: SingleDof, r: float, tau: float) -> float:
    return (tau + yaw.delta - (yaw.beta + yaw.beta_quadratic * abs(r)) * r) / yaw.alpha
