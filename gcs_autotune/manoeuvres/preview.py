"""Simulated preview of a manoeuvre: track, space, time, and a limit that would end it.

Every preview is a closed loop of a manoeuvre and a :class:`Plant` (:func:`fly_on`). The plant is the nominal one here,
and an identified model in ``experiments``.

The nominal plant represents a craft of which few figures are known, so its degrees of freedom are uncoupled. Its yaw
model alone determines its turns. It does not slow down in turns, and moves sideways only if driven. This gives a
conservative estimate of the space. Its equations are in plain Python, because previews are computed while the link is
served and must not wait for a compiler.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from gcs_autotune.craft import Actuate, Command, DepthTarget, HeadingTarget, Observation
from gcs_autotune.errors import GuardTripped, NotInformative
from gcs_autotune.manoeuvres.envelope import Envelope, Watch
from gcs_autotune.manoeuvres.manoeuvre import Manoeuvre, Outcome
from gcs_autotune.trial import Channel, Trial

if TYPE_CHECKING:
    from gcs_autotune.identify.relay import PredictedCycle
    from gcs_autotune.models import SingleDof

__all__ = ["DEEP", "SPEED_TIME", "NominalPlant", "Plant", "PlantState", "Preview", "fly_on", "preview"]

TICK, INSIDE = 0.1, 5
"""Time between two commands [s], as on a link with 10 Hz, and number of integration steps between them. Project
choice.
"""
LONGEST = 3600.0
RELAYS = ("relay", "wall-relay")
"""Manoeuvres whose limit cycle can be predicted."""
ANGULAR = ("K", "M", "N")
"""Forces whose relays are on an angle."""
LOOP_RATE = 0.5
"""Turn rate per heading error of the simulated heading loop [1/s]. Project choice."""
DEEP = 10.0
"""Assumed depth [m] of a submerged craft without depth information. Project choice."""
SURFACE = 0.2
"""Depth [m] at which a craft counts as at the surface, where its thrusters draw air. Project choice."""
WALL = 5.0
"""Assumed distance [m] to a wall ahead, for manoeuvres that need one. Project choice."""
SPEED_TIME = 3.0
"""Assumed time constant [s] of the speed of a craft of a few metres. Project choice."""


@dataclass(frozen=True, slots=True)
class NominalPlant:
    """A simulated craft; inputs are normalised outputs.

    Attributes
    ----------
    yaw : yaw model. others : models along a force (``X``, ``Y``, ``Z``) or about one of the axes ``K`` and ``M``;
        without one it does not respond to it, except that any thrust ahead gives ``speed`` [m/s].
    speed_gain : thrust per speed error [1/(m/s)] of the autopilot's own speed loop, in addition to the steady thrust.
    source : text on the origin of the numbers. assumed : whether they are assumptions, sufficient only to estimate
        the space.
    """

    yaw: SingleDof
    speed: float
    source: str
    assumed: bool = False
    others: Mapping[str, SingleDof] = field(default_factory=dict)
    speed_gain: float = 0.0


@dataclass(frozen=True, slots=True)
class PlantState:
    """State of a simulated craft: time [s], heading [rad], metres from home, depth (NaN: it floats), velocities."""

    t: float = 0.0
    psi: float = 0.0
    r: float = 0.0
    x: float = 0.0
    y: float = 0.0
    z: float = math.nan
    u: float = 0.0
    v: float = 0.0
    w: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Preview:
    """The result of a preview.

    ``trial``: record with psi, r, x, y, u and the forces.
    ``outcome``: how the manoeuvre ended; None if a safety limit ended it (``refusal``).
    ``room`` [m]: longer side of the box around the track.
    ``turned`` [rad]: range of the heading.
    ``deep`` [m]: range of the depth.
    ``away`` [m]: greatest distance from home.
    ``ends``: the last state.
    """

    trial: Trial
    outcome: Outcome | None
    refusal: str
    craft: NominalPlant
    room: float = math.nan
    turned: float = math.nan
    deep: float = 0.0
    away: float = math.nan
    ends: PlantState = field(default_factory=PlantState)

    @property
    def seconds(self) -> float:
        """Simulated duration of the manoeuvre [s]."""
        return self.trial.duration

    @property
    def trouble(self) -> str:
        """Reason not to fly the manoeuvre; empty if there is none."""
        if self.refusal or self.outcome is None:
            return self.refusal
        return self.outcome.reason if self.outcome.ending == "aborted" else ""

    def summary(self) -> str:
        """Return one sentence with time, space and turning of the manoeuvre."""
        way = f", {self.room:.0f} m of free water" if self.room >= 1.0 else ""
        turned, fastest = math.degrees(self.turned), math.degrees(float(np.max(np.abs(self.trial["r"].values))))
        at = f" at up to roughly {fastest:.0f} deg/s" if fastest >= 1.0 else ""
        deep = f", {self.deep:.1f} m of depth" if self.deep >= 0.1 else ""
        cycle = self._cycle_words()
        return (
            f"{self.seconds:.0f} s{way}{deep}, {turned:.0f} deg of turning{at}{cycle} "
            f"(predicted from {self.craft.source})"
        )

    @property
    def motion(self) -> SingleDof | None:
        """The model of the motion that the manoeuvre drives; None if there is none."""
        force = str(self.trial.meta.get("force", ""))
        return self.craft.yaw if force == "N" else self.craft.others.get(force)

    def cycle(self) -> PredictedCycle | None:
        """Return the limit cycle that the first harmonic predicts for a relay on a known model; None if there is none.

        Output and hysteresis are those at which the simulated relay ended.
        """
        meta, motion = self.trial.meta, self.motion
        if meta.get("manoeuvre") not in RELAYS or self.craft.assumed or motion is None:
            return None
        from gcs_autotune.identify.relay import predict_cycle  # takes a second

        try:
            return predict_cycle(motion, float(meta["C"]), float(meta["x_a"]), sample_time=TICK)
        except NotInformative:
            return None

    def _cycle_words(self) -> str:
        """Return the predicted limit cycle in words; empty without one."""
        cycle, force = self.cycle(), str(self.trial.meta.get("force", ""))
        if cycle is None:
            return ""
        size = f"{math.degrees(cycle.X_m):.3g} deg" if force in ANGULAR else f"{cycle.X_m:.2g} m"
        return f", limit cycle at {100.0 * cycle.C:.0f} % output: amplitude {size}, period {cycle.period:.3g} s"


class Plant(Protocol):
    """A simulated craft on which a manoeuvre is flown."""

    def observe(self) -> Observation:
        """Return the present motion as an observation."""
        ...

    def take(self, command: Command) -> None:
        """Store the command of this control tick."""
        ...

    def advance(self, seconds: float) -> bool:
        """Advance by *seconds* [s], one control tick, with the last command. Return False if the motion diverges."""
        ...


def fly_on(
    plant: Plant, manoeuvre: Manoeuvre, *, ticks: int, tick: float, ends: Callable[[Observation], bool] | None = None
) -> bool:
    """Fly *manoeuvre* on *plant* for at most *ticks* of fixed length; return False if the plant diverges.

    ends : whether the flight ends at an observation that the manoeuvre has not received yet.
    """
    commands = manoeuvre.commands(plant.observe())
    command = next(commands)
    for n in range(ticks):
        plant.take(command)
        if manoeuvre.outcome is not None or n + 1 == ticks:
            break
        if not plant.advance(tick):
            return False
        now = plant.observe()
        if ends is not None and ends(now):
            break
        command = commands.send(now)
    return True


class _NominalMotion:
    """Simulates the motion of *plant* from the state *begins*. ``rows``: time, motion and outputs at every tick.

    by_hand : whether a person pushes the craft.
    """

    def __init__(self, plant: NominalPlant, begins: PlantState, *, by_hand: bool) -> None:
        self._plant, self._by_hand, self._start = plant, by_hand, begins.t
        self._t, self._psi, self._r = begins.t, begins.psi, begins.r
        self._x, self._y, self._z = begins.x, begins.y, begins.z
        self._along = {"X": begins.u, "Y": begins.v, "Z": begins.w}
        self._tilt = {force: (0.0, 0.0) for force in ("K", "M") if force in plant.others}
        self._late: deque[float] = deque([0.0] * round(plant.yaw.delay * INSIDE / TICK))
        self._command: Command = Actuate()
        self._output = Actuate()
        self.rows: list[tuple[float, ...]] = []

    @property
    def state(self) -> PlantState:
        """The present state of the simulated craft."""
        return PlantState(self._t, self._psi, self._r, self._x, self._y, self._z, *self._along.values())

    def observe(self) -> Observation:
        """Return the present motion as an observation."""
        u, v, w = self._along.values()
        pushed = _pushed(self._t - self._start) if self._by_hand else 0.0
        (phi, p), (theta, q) = (self._tilt.get(force, (0.0, 0.0)) for force in "KM")
        o = self._output
        return Observation(
            t=self._t, psi=self._psi, r=self._r, phi=phi + pushed, theta=theta + pushed, p=p, q=q, x=self._x, y=self._y,
            z=self._z, u=u, v=v, w=w, speed=math.hypot(u, v), d=WALL - self._x,
            output={"N": o.N, "X": o.X, "Y": o.Y, "Z": o.Z, "K": o.K, "M": o.M}, armed=True,
        )  # fmt: skip

    def take(self, command: Command) -> None:
        """Store the command of this control tick, after applying the autopilot's own loop if it commands one."""
        self._command = command
        self._output = o = _steered(command, self._plant, self._psi, self._r, self._along["X"])
        place = self._t, self._psi, self._r, self._x, self._y, self._z
        self.rows.append((*place, self._along["X"], o.N, o.X, o.Y, o.Z))

    def advance(self, seconds: float) -> bool:
        """Advance by *seconds* [s], one control tick."""
        o, h, late, turn = self._output, seconds / INSIDE, self._late, self._plant.yaw.acceleration
        forces = (("X", o.X), ("Y", o.Y), ("Z", o.Z))
        psi, r, x, y, z, along = self._psi, self._r, self._x, self._y, self._z, self._along
        driven = [(f, law) for f, tau in forces if (law := _law(self._command, self._plant, f, tau, along[f]))]
        for _ in range(INSIDE):
            late.append(o.N)
            r += h * turn(r, late.popleft())
            psi += h * r
            for force, law in driven:
                along[force] += h * law(along[force], z)
            for force, (angle, rate) in self._tilt.items():
                if isinstance(self._command, HeadingTarget):
                    wanted = {"K": self._command.phi, "M": self._command.theta}[force]
                    rate += h * 2.0 * LOOP_RATE * (LOOP_RATE * (wanted - angle) - rate)
                else:
                    rate += h * self._plant.others[force].acceleration(rate, getattr(o, force), angle)
                self._tilt[force] = angle + h * rate, rate
            (u, v, w), north, east = along.values(), math.cos(psi), math.sin(psi)
            x += h * (u * north - v * east)
            y += h * (u * east + v * north)
            z += h * w
        self._psi, self._r, self._x, self._y, self._z = psi, r, x, y, z
        self._t += seconds
        return True


class _Monitor:
    """Ends a preview at a safety limit (``refusal``), or if the manoeuvre ends for lack of space (``outcome``)."""

    def __init__(self, manoeuvre: Manoeuvre, envelope: Envelope, now: Observation) -> None:
        self._manoeuvre, self._depth = manoeuvre, now.z
        self._watch = Watch(envelope, now, replace(now, x=0.0, y=0.0))
        self.refusal = ""
        self.outcome: Outcome | None = None

    def ends(self, now: Observation) -> bool:
        """Return whether a safety limit ends the preview at the observation *now*."""
        try:
            self._watch.check(now)
        except GuardTripped as error:
            self.refusal = str(error).partition(". The actuators")[0]
            return True
        where = self._watch.room_ends(now)
        self.outcome = self._manoeuvre.where_room_ends(where) if where and self._manoeuvre.outcome is None else None
        if self.outcome is None and self._manoeuvre.force == "Z" and now.z < SURFACE <= self._depth:
            self.refusal = f"the craft would surface from {self._depth:.1f} m. Start deeper, or use less output"
        return self.outcome is not None or bool(self.refusal)


def preview(
    manoeuvre: Manoeuvre,
    craft: NominalPlant,
    envelope: Envelope,
    *,
    floats: bool = True,
    way: float = 0.0,
    depth: float = DEEP,
    begins: PlantState | None = None,
) -> Preview:
    """Fly *manoeuvre* in a simulation inside *envelope*, and return the result.

    It starts at home with the bow to the north, at the speed *way* [m/s], and at *depth* [m] unless it *floats*.
    Alternatively it starts in the state *begins*, in which another manoeuvre ended.
    """
    begins = begins or PlantState(z=math.nan if floats else depth, u=way)
    motion = _NominalMotion(craft, begins, by_hand=manoeuvre.by_hand)
    monitor = _Monitor(manoeuvre, envelope, motion.observe())
    fly_on(motion, manoeuvre, ticks=round(LONGEST / TICK), tick=TICK, ends=monitor.ends)
    table, ends = np.array(motion.rows).T, motion.state
    units = {
        "psi": "rad", "r": "rad/s", "x": "m", "y": "m", "z": "m", "u": "m/s", "N": "1", "X": "1", "Y": "1", "Z": "1"
    }  # fmt: skip
    channels = {n: Channel(n, unit, table[0], table[i]) for i, (n, unit) in enumerate(units.items(), start=1)}
    if math.isnan(ends.z):
        del channels["z"]
    trial = Trial("predicted", channels, tuple(manoeuvre.take_marks()), meta=manoeuvre.settings)
    spans = np.ptp(table, axis=1)
    deep = 0.0 if math.isnan(ends.z) else float(spans[5])
    away = float(np.max(np.hypot(table[3], table[4])))
    outcome = None if monitor.refusal else monitor.outcome or manoeuvre.outcome
    space = float(max(spans[3], spans[4])), float(spans[1]), deep, away
    return Preview(trial, outcome, monitor.refusal, craft, *space, ends)


def _pushed(t: float) -> float:
    """Return the tilt [rad] of a craft that is pushed by hand after 10 s and then oscillates for some seconds."""
    since = t - 10.0
    return 0.3 * math.exp(-since / 3.0) * math.cos(2.0 * since) if since >= 0.0 else 0.0


def _steered(command: Command, craft: NominalPlant, psi: float, r: float, u: float) -> Actuate:
    """Return the forces of a command. Heading is held as by a well tuned autopilot, at the commanded speed."""
    if isinstance(command, Actuate):
        return command
    if not isinstance(command, HeadingTarget):
        return Actuate()
    yaw, wanted = craft.yaw, LOOP_RATE * (command.psi - psi)
    N = 2.0 * LOOP_RATE * yaw.alpha * (wanted - r) + (yaw.beta + yaw.beta_quadratic * abs(wanted)) * wanted
    ahead = craft.others.get("X")
    thrust = float(command.speed > 0.0)
    if ahead is not None:
        drag = (ahead.beta + ahead.beta_quadratic * command.speed) * command.speed
        thrust = max(-1.0, min(1.0, drag + craft.speed_gain * (command.speed - u)))
    return Actuate(X=thrust, N=max(-1.0, min(1.0, N)))


def _law(
    command: Command, craft: NominalPlant, force: str, tau: float, nu: float
) -> Callable[[float, float], float] | None:
    """Return the acceleration [m/s^2] along *force* as a function of velocity and depth. None: it stays zero.

    The autopilot's own depth or speed loop acts if *command* is for it, otherwise the output *tau*. Without a model the
    craft moves ahead at its speed, or not at all. *nu* is the present velocity: a craft at rest without a force stays
    at rest.
    """
    if force == "Z" and isinstance(command, DepthTarget):
        return lambda nu, z: 2.0 * LOOP_RATE * (LOOP_RATE * (command.z - z) - nu)
    if model := craft.others.get(force):
        at_rest = nu == 0.0 and tau + model.delta == 0.0
        return None if at_rest else lambda nu, z: model.acceleration(nu, tau)
    if force != "X":
        return None
    speed = command.speed if isinstance(command, HeadingTarget) else craft.speed if tau > 0.0 else 0.0
    return lambda nu, z: (speed - nu) / SPEED_TIME
