"""Draw a random craft: a hull with time constants from 0.1 s to 20 s, its largest commands, sensors and sampling."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

__all__ = ["FORCE", "KINDS", "POSITION", "SPEED", "Craft", "draw_craft", "log_uniform"]

Rng = np.random.Generator

SPEED: Mapping[str, str] = {"surge": "u", "sway": "v", "heave": "w", "yaw": "r"}
FORCE: Mapping[str, str] = {"surge": "X", "sway": "Y", "heave": "Z", "yaw": "N"}
POSITION: Mapping[str, str] = {"surge": "x", "sway": "y", "heave": "z", "yaw": "psi"}

FASTEST, SLOWEST = 0.1, 20.0
"""Range of the time constants [s] of the hulls."""


@dataclass(frozen=True)
class Craft:
    """A hull with its actuators and sensors.

    ``inertia``, ``linear`` per degree of freedom, SI (per radian of rudder if the input is ``delta``); ``full``: the
    largest command of each channel; ``top``: the steady speed at it; ``drives``: channel -> degree of freedom;
    ``signals``: the measured signals; ``scale``: the size of each signal, to which the noise is relative;
    ``interval``: sampling interval [s]; ``samples``: samples of a run.
    """

    kind: str
    dofs: tuple[str, ...]
    inertia: Mapping[str, float]
    linear: Mapping[str, float]
    full: Mapping[str, float]
    top: Mapping[str, float]
    drives: Mapping[str, str]
    signals: tuple[str, ...]
    scale: Mapping[str, float]
    interval: float
    samples: int

    @property
    def main(self) -> str:
        """The degree of freedom to diagnose: yaw, or the first."""
        return "yaw" if "yaw" in self.dofs else self.dofs[0]

    @property
    def input(self) -> str:
        """The channel that drives it."""
        return next(channel for channel, dof in self.drives.items() if dof == self.main)

    @property
    def pace(self) -> float:
        """Its time constant [s]."""
        return self.time_constant(self.main)

    @property
    def duration(self) -> float:
        """Seconds of a run."""
        return self.interval * self.samples

    def time_constant(self, dof: str) -> float:
        """Return inertia over linear drag [s]."""
        return self.inertia[dof] / self.linear[dof]

    @property
    def on_track(self) -> Craft:
        """The craft with measured track and heading and no measured speed, as with a camera above the basin."""
        return self.measuring("x", "y", "psi")

    def measuring(self, *signals: str) -> Craft:
        """Return the craft with other measured signals."""
        return replace(self, signals=signals)


def log_uniform(rng: Rng, low: float, high: float) -> float:
    """Return a number with a uniform logarithm."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _axis(rng: Rng, dof: str, pace: float, mass: float) -> tuple[float, float, float]:
    """Return inertia, linear drag and the steady speed at full command."""
    if dof == "yaw":
        top = min(log_uniform(rng, 0.3, 3.0) / pace, 1.5)
        top = max(top, 0.03)
    elif dof == "surge":
        top = log_uniform(rng, 0.4, 4.0)
    else:
        top = log_uniform(rng, 0.15, 1.0)
    return mass, mass / pace, top


def _make(rng: Rng, kind: str, dofs: tuple[str, ...], drives: Mapping[str, str], paces: Mapping[str, float]) -> Craft:
    mass = log_uniform(rng, 0.3, 3000.0)
    inertia, linear, top = {}, {}, {}
    for dof in dofs:
        share = 1.0 if len(dofs) == 1 else log_uniform(rng, 0.7, 1.5)
        inertia[dof], linear[dof], top[dof] = _axis(rng, dof, paces[dof], mass * share)
    full = {channel: linear[dof] * top[dof] for channel, dof in drives.items()}
    if "delta" in drives:
        angle = rng.uniform(0.3, 0.6)
        ratio = angle / full["delta"]
        inertia["yaw"] *= ratio
        linear["yaw"] *= ratio
        full["delta"] = angle
    main = "yaw" if "yaw" in dofs else dofs[0]
    interval = float(np.clip(paces[main] / log_uniform(rng, 6.0, 30.0), 0.02, 0.5))
    scale = {}
    for dof in dofs:
        scale[SPEED[dof]] = top[dof]
        scale[POSITION[dof]] = top[dof] * paces[dof] if dof != "yaw" else min(top[dof] * paces[dof], 0.5)
    signals = tuple(s for dof in dofs for s in (SPEED[dof], POSITION[dof]))
    samples = int(rng.integers(450, 751))
    return Craft(
        kind, dofs, inertia, linear, full, top, dict(drives), signals, scale, round(interval, 4), samples
    )  # fmt: skip


def _yaw(rng: Rng) -> Craft:
    channel = "delta" if rng.random() < 0.2 else "N"
    return _make(rng, "yaw", ("yaw",), {channel: "yaw"}, {"yaw": log_uniform(rng, FASTEST, SLOWEST)})


def _surge(rng: Rng) -> Craft:
    return _make(rng, "surge", ("surge",), {"X": "surge"}, {"surge": log_uniform(rng, 0.5, SLOWEST)})


def _heave(rng: Rng) -> Craft:
    return _make(rng, "heave", ("heave",), {"Z": "heave"}, {"heave": log_uniform(rng, 0.3, 10.0)})


def _steered(rng: Rng) -> Craft:
    """Return a craft that runs ahead and turns, with measured speed and no measured position."""
    pace = log_uniform(rng, 0.3, 10.0)
    paces = {"surge": float(np.clip(pace * log_uniform(rng, 0.7, 3.0), FASTEST, SLOWEST)), "yaw": pace}
    craft = _make(rng, "steered", ("surge", "yaw"), {"X": "surge", "N": "yaw"}, paces)
    return craft.measuring("u", "r", "psi")


def _plane(rng: Rng, drives: Mapping[str, str], kind: str) -> Craft:
    pace = log_uniform(rng, 0.3, 8.0)
    paces = {"yaw": pace}
    for dof, low, high in (("surge", 0.8, 3.0), ("sway", 0.5, 1.5)):
        paces[dof] = float(np.clip(pace * log_uniform(rng, low, high), FASTEST, SLOWEST))
    craft = _make(rng, kind, ("surge", "sway", "yaw"), drives, paces)
    return craft.measuring("u", "v", "r", "psi", "x", "y")


def _boat(rng: Rng) -> Craft:
    """Return a craft with surge and yaw actuators; only coupling, current and the like make it sway."""
    return _plane(rng, {"X": "surge", "N": "yaw"}, "boat")


def _raft(rng: Rng) -> Craft:
    """Return a craft with surge, sway and yaw actuators."""
    return _plane(rng, {"X": "surge", "Y": "sway", "N": "yaw"}, "raft")


def _diver(rng: Rng) -> Craft:
    """Return a craft that runs ahead, turns and dives."""
    pace = log_uniform(rng, 0.3, 8.0)
    paces = {"yaw": pace}
    for dof, low, high in (("surge", 0.8, 3.0), ("heave", 0.5, 1.5)):
        paces[dof] = float(np.clip(pace * log_uniform(rng, low, high), FASTEST, SLOWEST))
    dofs, drives = ("surge", "heave", "yaw"), {"X": "surge", "Z": "heave", "N": "yaw"}
    craft = _make(rng, "diver", dofs, drives, paces)
    craft = replace(craft, scale={**craft.scale, "y": craft.scale["x"]})
    return craft.measuring("u", "w", "r", "psi", "x", "y", "z")


KINDS = {
    "yaw": _yaw,
    "surge": _surge,
    "heave": _heave,
    "steered": _steered,
    "boat": _boat,
    "raft": _raft,
    "diver": _diver,
}


def draw_craft(kind: str, rng: Rng) -> Craft:
    """Return a random craft of a kind."""
    return KINDS[kind](rng)
