"""Process noise for the open-loop simulator: drifting moment, waves, run-to-run differences, heading lag and helm.

The moment is an Ornstein-Uhlenbeck process, with bursts such as those of wakes. Waves are a moment in a narrow
frequency band, and also a motion of the bow (Fossen2011, chapter 8). The heading in the file is smoothed forwards and
backwards, or late, or filtered in one direction. The turn rate is computed from this heading. This module shares no
code with the diagnosis.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, MutableMapping

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.craft import Craft, log_uniform
from benchmarks.blind.foreign import Foreign
from sitl.effects import EffectParameter, Setting
from sitl.sensors import SensorReading

__all__ = [
    "BURSTS",
    "CALM",
    "DISTURBANCES",
    "HIDDEN",
    "MILD_HIDDEN",
    "DriftingMoment",
    "draw_drifting_moment",
    "draw_mild_moment",
    "smoothed",
]

Array = NDArray[np.float64]
Rng = np.random.Generator

HIDDEN = (
    "input-delay",
    "dead-zone",
    "quadratic-drag",
    "asymmetric-thrust",
    "input-bias",
    "saturation",
    "actuator-lag",
    "quadratic-actuator",
)
"""Effects hidden in runs with process noise. Half of the cases have none (:data:`CALM`)."""

MILD_HIDDEN = (*HIDDEN, "backlash")
"""Effects hidden in runs with mild process noise."""

CALM = "clean"
"""Name of a case without an effect."""


BURSTS = "bursts"
"""Column of the simulator's file that is not passed to the diagnosis."""


class DriftingMoment(Foreign):
    """A drifting moment (Ornstein-Uhlenbeck process) with bursts."""

    slug = "drifting-moment"
    parameters = (
        EffectParameter("spread", "N m"),
        EffectParameter("memory", "s"),
        EffectParameter("burst", "N m"),
        EffectParameter("every", "s"),
    )

    def reset(self) -> None:
        """Start at random."""
        self._force = self.draw.gauss(0.0, self["spread"])
        self._burst, self._left = 0.0, 0.0
        self._bursts: list[tuple[float, int]] = [(-math.inf, 0)]

    def alter_input(self, t: float, dt: float, inputs: MutableMapping[str, float]) -> None:
        """Add the moment."""
        keep = math.exp(-dt / self["memory"])
        self._force = keep * self._force + self.draw.gauss(0.0, self["spread"] * math.sqrt(1.0 - keep * keep))
        self._left -= dt
        if self._left <= 0.0:
            if self._burst:
                self._bursts.append((t, -abs(self._bursts[-1][1])))
            self._burst = 0.0
            if self.draw.random() < dt / self["every"]:
                self._burst = self.draw.gauss(0.0, self["burst"])
                self._left = self.draw.expovariate(1.0 / self["memory"])
                if self._burst:
                    self._bursts.append((t, abs(self._bursts[-1][1]) + 1))
        inputs[self.channel] += self._force + self._burst

    def alter_file(self, columns: dict[str, Array]) -> None:
        """Write the number of the present burst for the scoring; without a burst, minus the number of the last one."""
        began, number = np.array(self._bursts).T
        columns[BURSTS] = number[np.searchsorted(began, columns["t"], side="right") - 1]


class Waves(Foreign):
    """A moment in a narrow frequency band, and a heading motion with it.

    Both are white noise through ``s / (s^2 + 2 damping frequency s + frequency^2)``.
    """

    slug = "waves"
    parameters = (
        EffectParameter("moment", "N m"),
        EffectParameter("heading", "rad"),
        EffectParameter("frequency", "rad/s"),
        EffectParameter("damping", "1"),
    )

    def quickness(self, setting: Setting) -> float:
        """Return the reciprocal of the frequency [s]."""
        return 1.0 / self["frequency"]

    def reset(self) -> None:
        """Start at a random phase. The second state is the wave, of unit variance; the first follows its integral."""
        self._wave = np.array([self.draw.gauss(0.0, 1.0), self.draw.gauss(0.0, 1.0)])
        self._dt = math.nan
        self._log: list[tuple[float, float]] = []
        self._seen: Array | None = None

    def _set_step(self, dt: float) -> None:
        """Compute the exact transition and noise of a step. The variance of both states stays 1."""
        omega, zeta = self["frequency"], self["damping"]
        root = math.sqrt(1.0 - zeta * zeta)
        c, s, fade = math.cos(omega * root * dt), math.sin(omega * root * dt) / root, math.exp(-zeta * omega * dt)
        F = fade * np.array([[c + zeta * s, s], [-s, c - zeta * s]])
        L = np.linalg.cholesky(np.eye(2) - F @ F.T + 1e-12 * np.eye(2))
        self._dt, self._F, self._L = dt, F, L

    def alter_input(self, t: float, dt: float, inputs: MutableMapping[str, float]) -> None:
        """Add the moment."""
        if dt != self._dt:
            self._set_step(dt)
        self._log.append((t, float(self._wave[1])))
        inputs[self.channel] += self["moment"] * self._log[-1][1]
        self._wave = self._F @ self._wave + self._L @ (self.draw.gauss(0.0, 1.0), self.draw.gauss(0.0, 1.0))

    def alter_measurement(self, t: float, reading: SensorReading) -> None:
        """Add the heading motion."""
        if self._seen is None:  # the run is over: see open_loop
            self._seen = np.array(self._log).T
        reading.psi += self["heading"] * float(np.interp(t, *self._seen))


class RunToRun(Foreign):
    """Run-to-run differences: a constant moment (wind, trim), and a factor of the thrust."""

    slug = "run-to-run"
    parameters = (EffectParameter("moment", "N m"), EffectParameter("thrust", "1"))

    def alter_input(self, t: float, dt: float, inputs: MutableMapping[str, float]) -> None:
        """Add the moment, and scale the command."""
        inputs[self.channel] = self["thrust"] * inputs[self.channel] + self["moment"]


class Lag(Foreign):
    """A heading with a delay and a first-order filter in one direction, as from a GPS or compass."""

    slug = "lag"
    parameters = (EffectParameter("delay", "s"), EffectParameter("time_constant", "s"))

    def lateness(self) -> Mapping[str, float]:
        """Return the delay of the heading."""
        return {"psi": self["delay"]}

    def alter_file(self, columns: dict[str, Array]) -> None:
        """Filter the recorded heading, starting at the first sample."""
        t, psi, time = columns["t"], columns["psi"], self["time_constant"]
        if time > 0.0:
            kept = np.exp(-np.diff(t) / time)
            for i in range(1, len(psi)):
                psi[i] = kept[i - 1] * psi[i - 1] + (1.0 - kept[i - 1]) * psi[i]


class Helm(Foreign):
    """A person at the helm who alternates between the planned commands and keeping the present heading.

    ``gain``: command per heading error; ``rate``: command per turn rate; ``every``: time between two corrections [s];
    ``spell``: mean duration of either [s]; ``most``: largest command.
    """

    slug = "helm"
    parameters = tuple(
        EffectParameter(n, u)
        for n, u in (("gain", "N m"), ("rate", "N m s"), ("every", "s"), ("spell", "s"), ("most", "N m"))
    )

    def reset(self) -> None:
        """Start with the planned commands."""
        self._next, self._change, self._keeping = -math.inf, -math.inf, True
        self._commands: list[tuple[float, float]] = []
        self._goal, self._now = 0.0, 0.0

    def alter_input(self, t: float, dt: float, inputs: MutableMapping[str, float]) -> None:
        """Apply the planned command, or that which keeps the heading."""
        if t >= self._next - 1e-9:
            self._next = t + self["every"]
            if t >= self._change:
                self._change = t + self.draw.expovariate(1.0 / self["spell"])
                self._keeping, self._goal = not self._keeping, self.state.psi
            error = self._goal - self.state.psi
            command = self["gain"] * error - self["rate"] * self.state.r
            self._now = min(max(command, -self["most"]), self["most"])
        if self._keeping:
            inputs[self.channel] = self._now
        self._commands.append((t, inputs[self.channel]))

    def alter_file(self, columns: dict[str, Array]) -> None:
        """Record the commands."""
        t, commands = np.array(self._commands).T
        columns[self.channel] = commands[np.searchsorted(t, columns["t"] + 1e-9, side="right") - 1]


DISTURBANCES: Mapping[str, type[Foreign]] = {kind.slug: kind for kind in (DriftingMoment, Waves, RunToRun, Lag, Helm)}
"""Slug -> disturbance or sensor error that is added to the hidden effects."""


def draw_drifting_moment(rng: Rng, craft: Craft) -> Mapping[str, float]:
    """Return parameters of a drifting moment of 10 to 100 % of full command.

    The correlation time is 0.5 to 5 time constants of the craft. The moment has bursts with a probability of 0.5.
    """
    spread = craft.full[craft.input] * log_uniform(rng, 0.1, 1.0)
    memory = craft.pace * log_uniform(rng, 0.5, 5.0)
    return {
        "spread": spread,
        "memory": memory,
        "burst": spread * rng.uniform(1.0, 3.0) if rng.random() < 0.5 else 0.0,
        "every": craft.duration * rng.uniform(0.1, 0.3),
    }


def draw_mild_moment(rng: Rng, craft: Craft) -> Mapping[str, float]:
    """Return parameters of a drifting moment of 25 to 35 % of full command, without bursts.

    The correlation time is 0.5 to 5 time constants of the craft.
    """
    spread = craft.full[craft.input] * rng.uniform(0.25, 0.35)
    memory = craft.pace * log_uniform(rng, 0.5, 5.0)
    return {"spread": spread, "memory": memory, "burst": 0.0, "every": craft.duration}


def smoothed(file: Mapping[str, Array], width: int) -> dict[str, Array]:
    """Return the file with its heading smoothed forwards and backwards over *width* samples, and its rate from that."""
    found = {name: values for name, values in file.items() if name != BURSTS}
    if width > 1:
        keep = 1.0 - 1.0 / width
        psi = file["psi"].copy()
        for _ in range(2):
            for i in range(1, len(psi)):
                psi[i] = keep * psi[i - 1] + (1.0 - keep) * psi[i]
            psi = psi[::-1]
        found["psi"] = psi
    found["r"] = np.gradient(found["psi"], file["t"])
    return found
