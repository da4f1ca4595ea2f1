"""A toy craft for testing manoeuvres and the sequencer without any link.

One line of dynamics, nothing shared with ``sitl`` or ``gcs_autotune.models``: yaw acceleration follows the
demand and is damped; in the hold modes a plain PD loop steers to the target.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from gcs_autotune.clock import ManualClock
from gcs_autotune.craft import Actuate, Command, DepthTarget, HeadingTarget, Intervention, Observation
from gcs_autotune.errors import AutotuneError, OperatorStopped
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.manoeuvres import Manoeuvre
from gcs_autotune.trial import Channel, Mark, Trial


class PondCraft:
    """Implements ``Craft`` on ten lines of physics. ``fail_at`` tick -> exception to raise there."""

    def __init__(self, *, gain: float = 1.0, drag: float = 0.8, bias: float = 0.0, firmware: str = "ardusub") -> None:
        self.firmware = FIRMWARE[firmware]
        self.clock = ManualClock()
        self.gain, self.drag, self.bias = gain, drag, bias
        self.psi = self.r = self.z = self.w = self.speed = self.x = self.v = 0.0
        self.roll, self.pitch = [0.0, 0.0], [0.0, 0.0]
        self.mode, self.armed = "STABILIZE" if firmware == "ardusub" else "HOLD", False
        self.command: Command = Actuate()
        self.tick = 0
        self.fail_at: dict[int, AutotuneError] = {}
        self.fail_neutral: AutotuneError | None = None
        self.log: list[str] = []
        self.interventions: list[Intervention] = []
        self.stop_wanted = False
        self.battery = 0.9
        self._shielded = 0
        self._rows: list[Observation] = []
        self._marks: list[Mark] = []
        self._name = ""

    def observe(self) -> Observation:
        if self.stop_wanted and not self._shielded:
            raise OperatorStopped("stopped by the operator")
        self.tick += 1
        if self.tick in self.fail_at:
            raise self.fail_at[self.tick]
        for _ in range(10):
            self._advance(0.01)
        self.clock.advance(0.1)
        seen = Observation(
            t=self.clock.now(),
            psi=self.psi,
            r=self.r,
            z=self.z,
            x=self.x,
            y=0.0,
            phi=self.tilt() + self.roll[0],
            theta=self.tilt() + self.pitch[0],
            p=self.roll[1],
            q=self.pitch[1],
            u=self.speed,
            v=self.v,
            speed=self.speed,
            d=self.distance(),
            output=dict(zip("NZXY", (*self._demand(), self._sideways), strict=True)),
            armed=self.armed,
            mode=self.mode,
            battery_remaining=self.battery,
        )
        self._rows.append(seen)
        return seen

    def tilt(self) -> float:
        return 0.0

    def distance(self) -> float:
        return math.nan

    lateness = 0.0

    def send(self, command: Command) -> None:
        self.command = command

    def await_heartbeat(self) -> None:
        """It beats all the time."""

    def take_over(self) -> None:
        self.interventions.clear()

    def give_back(self) -> None:
        pass

    def intervention(self) -> Intervention | None:
        return self.interventions[0] if self.interventions else None

    def accept_intervention(self) -> None:
        self.interventions.clear()

    def set_mode(self, mode: str) -> None:
        self.log.append(f"mode {mode}")
        self.mode = mode

    def arm(self) -> None:
        self.log.append("arm")
        self.armed = True

    def disarm(self) -> None:
        self.log.append("disarm")
        self.armed = False

    def neutral(self) -> None:
        if self.fail_neutral is not None:
            raise self.fail_neutral
        self.log.append("neutral")
        self.command = Actuate()

    def release(self) -> None:
        self.log.append("release")

    def start_recording(self, name: str) -> None:
        self._name, self._rows, self._marks = name, [], []

    def mark(self, mark: Mark) -> None:
        self._marks.append(mark)

    def stop_recording(self, ending: str) -> Trial:
        t = np.array([o.t for o in self._rows])
        columns = {"psi": "rad", "r": "rad/s", "z": "m", "phi": "rad", "theta": "rad"}
        channels = {n: Channel(n, unit, t, np.array([o.value(n) for o in self._rows])) for n, unit in columns.items()}
        for force in ("N", "Z"):
            channels[force] = Channel(force, "1", t, np.array([o.output[force] for o in self._rows]))
        return Trial(self._name, channels, tuple(self._marks), ending)

    @contextmanager
    def shielded(self) -> Iterator[None]:
        self._shielded += 1
        try:
            yield
        finally:
            self._shielded -= 1

    def _demand(self) -> tuple[float, float, float]:
        c = self.command
        if isinstance(c, Actuate):
            return c.N, c.Z, c.X
        if isinstance(c, HeadingTarget):
            return max(-1.0, min(1.0, 2.0 * (c.psi - self.psi) - self.r)), 0.0, 0.0
        assert isinstance(c, DepthTarget)
        return 0.0, max(-1.0, min(1.0, 2.0 * (c.z - self.z) - self.w)), 0.0

    @property
    def _sideways(self) -> float:
        return self.command.Y if isinstance(self.command, Actuate) else 0.0

    def _advance(self, dt: float) -> None:
        N, Z, X = self._demand()
        self.v += dt * (self._sideways - 0.5 * self.v)
        self.r += dt * (self.gain * N + self.bias - self.drag * self.r)
        self.w += dt * (self.gain * Z + self.bias - self.drag * self.w)
        self.psi += dt * self.r
        self.z += dt * self.w
        self.speed += dt * (X - 0.5 * self.speed)
        for tilt, force in ((self.roll, "K"), (self.pitch, "M")):
            moment = getattr(self.command, force) if isinstance(self.command, Actuate) else 0.0
            tilt[1] += dt * (6.0 * moment - 1.5 * tilt[1] - 4.0 * tilt[0])
            tilt[0] += dt * tilt[1]


class BeforeWall(PondCraft):
    """Faces a wall 5 m ahead, which its rangefinder sees until ``blind_at`` [s]."""

    blind_at = math.inf
    gone = 0.0

    def _advance(self, dt: float) -> None:
        super()._advance(dt)
        self.gone += dt * self.speed

    def distance(self) -> float:
        return 5.0 - self.gone if self.clock.now() < self.blind_at else math.nan


class Pushed(PondCraft):
    """A push after 8 s: the craft rolls with *omega* [rad/s] and *zeta*, about a list of 0.02 rad."""

    omega, zeta = 2.5, 0.12

    def tilt(self) -> float:
        since = self.clock.now() - 8.0
        if since < 0.0:
            return 0.02
        whole = math.sqrt(1.0 - self.zeta**2)
        damped = self.omega * whole * since
        swing = math.cos(damped) + self.zeta / whole * math.sin(damped)
        return 0.02 + 0.25 * math.exp(-self.zeta * self.omega * since) * swing


class Buoyant(PondCraft):
    """ArduPilot's own submarine, *buoyancy* [N] light: thrust and drag with the square, a dead band, and a surface.

    Its reported depth has slowly varying noise (3 s), as an estimator's has.
    """

    def __init__(self, buoyancy: float, depth: float, seed: int, *, sign: float = 1.0) -> None:
        super().__init__()
        self.buoyancy, self.sign, self.z = buoyancy, sign, depth
        self.chance, self.wander = np.random.default_rng(seed), 0.0

    def _advance(self, dt: float) -> None:
        Z = self._demand()[1]
        thrust = 0.0 if abs(Z) < 0.0625 else self.sign * 103.0 * Z * abs(Z)
        covered = self.z - 0.127
        fall = 103.0 if covered < 0.0 else -self.buoyancy * min(covered / 0.254, 1.0)
        self.w += dt * (thrust + fall - 69.0 * self.w * abs(self.w)) / 10.5
        self.z += dt * self.w

    def observe(self) -> Observation:
        seen = super().observe()
        self.wander += -0.1 / 3.0 * self.wander + 0.005 * float(self.chance.normal())
        object.__setattr__(seen, "z", seen.z + self.wander + 0.005 * float(self.chance.normal()))
        return seen


def at_rest(**changes: float) -> Observation:
    """Return an observation of a craft at rest, with some numbers changed."""
    base = {"t": 0.0, "psi": 0.0, "r": 0.0, "z": 1.0, "x": 0.0, "y": 0.0, "phi": 0.0, "theta": 0.0, "speed": 0.0}
    return Observation(**{**base, **changes})  # type: ignore[arg-type]


def turned(degrees: float) -> float:
    return math.radians(degrees)


def answered(
    manoeuvre: Manoeuvre, seen: Callable[[float, Any], Observation], *, tick: float = 0.5, most: float = 400.0
) -> list[tuple[Observation, Any]]:
    """Return observations and the commands of *manoeuvre* until it ends; *seen* maps time and command to one."""
    now = seen(0.0, Actuate())
    commands = manoeuvre.commands(now)
    rows, k = [(now, next(commands))], 0
    while manoeuvre.outcome is None and k * tick < most:
        k += 1
        now = seen(k * tick, rows[-1][1])
        rows.append((now, commands.send(now)))
    return rows
