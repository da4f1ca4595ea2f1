"""The table of manoeuvres that can be proposed: one line each.

A manoeuvre is a function of (seconds, time step) that yields, per step, shares in -1..1 per role; the closed-loop ones
are sent the simulated state of that moment. All start with thrust already on where they have any, so that the approach
is part of the manoeuvre.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

__all__ = ["CANDIDATES", "Candidate", "Pilot", "Shares", "State"]

Shares = Mapping[str, float]
State = Mapping[str, float]
Pilot = Callable[[float, float], Generator[Shares, State, None]]
"""(seconds, step) -> one set of shares per step; what is sent in is the state at the next step."""

APPROACH = 0.12
"""Share of the time spent on straight approach before steering begins."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """One manoeuvre: ``roles`` it needs, ``pilot`` who flies it, ``closed``: whether it answers to the motion."""

    name: str
    title: str
    roles: frozenset[str]
    pilot: Pilot
    closed: bool = False


def _timed(
    signal: Callable[[float], float], role: str, thrust: float, seconds: float, step: float
) -> Generator[Shares, State, None]:
    """Fly ``signal`` (of time from 0 to 1 after the approach) on *role* at constant *thrust*."""
    begin = APPROACH * seconds if thrust else 0.02 * seconds
    for i in range(round(seconds / step)):
        t = i * step
        share = signal((t - begin) / (seconds - begin)) if t >= begin else 0.0
        yield {role: share} if role == "thrust" or not thrust else {role: share, "thrust": thrust}


def _levels(*values: float) -> Callable[[float], float]:
    return lambda x: values[min(int(x * len(values)), len(values) - 1)]


def _sine(periods: float) -> Callable[[float], float]:
    return lambda x: math.sin(2.0 * math.pi * periods * x)


def _full(x: float) -> float:
    return 1.0


def _growing(x: float) -> float:
    return min(x / 0.9, 1.0)


def _random(
    roles: tuple[str, ...], thrust: tuple[float, float], shortest: float, seconds: float, step: float
) -> Generator[Shares, State, None]:
    """Fly levels of random length and sign, each role its own; thrust between two shares."""
    rng = np.random.default_rng(20)
    now, until = dict.fromkeys(roles, 0.0), dict.fromkeys(roles, 0.0)
    for i in range(round(seconds / step)):
        for role in roles:
            if i * step >= until[role]:
                until[role] = i * step + shortest * float(rng.integers(1, 5))
                one, other = thrust if role == "thrust" else (-1.0, 1.0)
                now[role] = one if rng.random() < 0.5 else other
        steady = {} if "thrust" in roles or not thrust[1] else {"thrust": thrust[1]}
        yield {**now, **steady}


def _zigzag(angle: float, thrust: float, seconds: float, step: float) -> Generator[Shares, State, None]:
    """Kempf's manoeuvre: full steering to one side until the heading has left by *angle* [deg], then to the other."""
    begin, sign, psi_0 = (APPROACH * seconds if thrust else 0.02 * seconds), 1.0, None
    steady = {"thrust": thrust} if thrust else {}
    state: State = {}
    for i in range(round(seconds / step)):
        psi = state.get("psi", 0.0)
        if i * step < begin:
            state = yield {**steady, "steer": 0.0}
            continue
        psi_0 = psi if psi_0 is None else psi_0
        if sign * (psi - psi_0) > math.radians(angle):
            sign = -sign
        state = yield {**steady, "steer": sign}


def _relay(
    role: str, position: str, width: float, thrust: float, seconds: float, step: float
) -> Generator[Shares, State, None]:
    """Switch *role* with hysteresis *width* on its position: the self-oscillation of IS-O."""
    sign, zero = 1.0, None
    steady: Shares = {"thrust": thrust} if thrust else {}
    state: State = {}
    for _ in range(round(seconds / step)):
        here = state.get(position, 0.0)
        zero = here if zero is None else zero
        if sign * (here - zero) > width:
            sign = -sign
        state = yield {**steady, role: sign}


def _coast(shares: tuple[float, ...], seconds: float, step: float) -> Generator[Shares, State, None]:
    """Accelerate at each share of thrust in turn and coast after it."""
    each = seconds / len(shares)
    for i in range(round(seconds / step)):
        k = min(int(i * step / each), len(shares) - 1)
        yield {"thrust": shares[k] if i * step - k * each < 0.55 * each else 0.0}


def _s_throttle(seconds: float, step: float) -> Generator[Shares, State, None]:
    """Steer in an S while the thrust changes from leg to leg."""
    for i in range(round(seconds / step)):
        x = i * step / seconds
        yield {"thrust": (1.0, 0.4, 0.8, 0.2)[min(int(4.0 * x), 3)], "steer": 1.0 if int(6.0 * x) % 2 else -1.0}


def _name(title: str) -> str:
    return title.replace("%", "").replace("/", "-").replace(",", "").replace("  ", " ").replace(" ", "-").rstrip("-")


def _row(title: str, roles: str, pilot: Pilot, *, closed: bool = False) -> Candidate:
    return Candidate(_name(title), title, frozenset(roles.split()), pilot, closed)


_DEG = math.pi / 180.0
_BOTH = ("steer", "thrust")

CANDIDATES: Mapping[str, Candidate] = {
    c.name: c
    for c in (
        _row("throttle steps", "thrust", partial(_timed, _levels(0.3, 1.0, 0.0, 0.6, 0.2, 0.8), "thrust", 0.0)),
        _row("acceleration and coast-down", "thrust", partial(_coast, (1.0,))),
        _row("accelerations to three speeds and coast-down", "thrust", partial(_coast, (0.3, 0.6, 1.0))),
        _row("pseudo-random throttle", "thrust", partial(_random, ("thrust",), (0.1, 1.0), 1.5)),
        *(
            _row(f"zig-zag {a}/{a} at {p} % throttle", "thrust steer", partial(_zigzag, a, p / 100.0), closed=True)
            for a in (10, 20, 35)
            for p in (30, 60, 100)
        ),
        _row("zig-zag 20/20", "steer", partial(_zigzag, 20.0, 0.0), closed=True),
        _row("zig-zag 45/45", "steer", partial(_zigzag, 45.0, 0.0), closed=True),
        *(
            _row(f"turning circle at {p} % throttle", "thrust steer", partial(_timed, _full, "steer", p / 100.0))
            for p in (30, 60, 100)
        ),
        _row("S-manoeuvre at 60 % throttle", "thrust steer", partial(_timed, _sine(3.0), "steer", 0.6)),
        _row("S-manoeuvre with changing throttle", "thrust steer", _s_throttle),
        _row("growing turn (spiral) at 60 % throttle", "thrust steer", partial(_timed, _growing, "steer", 0.6)),
        _row("growing turn (spiral) at 100 % throttle", "thrust steer", partial(_timed, _growing, "steer", 1.0)),
        _row("steering step", "steer", partial(_timed, _full, "steer", 0.0)),
        _row("steering steps", "steer", partial(_timed, _levels(1.0, 0.5, 0.0, -1.0, -0.5, 0.0), "steer", 0.0)),
        _row("steering doublet", "steer", partial(_timed, _levels(1.0, -1.0, 0.0), "steer", 0.0)),
        _row("pseudo-random steering", "steer", partial(_random, ("steer",), (0.0, 0.0), 1.0)),
        _row("pseudo-random steering at 60 % throttle", "thrust steer", partial(_random, ("steer",), (0.0, 0.6), 1.0)),
        _row("pseudo-random steering and throttle", "thrust steer", partial(_random, _BOTH, (0.1, 1.0), 1.5)),
        _row("yaw relay", "steer", partial(_relay, "steer", "psi", 10.0 * _DEG, 0.0), closed=True),
        _row("heave bob", "heave", partial(_relay, "heave", "z", 0.2, 0.0), closed=True),
        _row("heave steps", "heave", partial(_timed, _levels(1.0, 0.0, -1.0, 0.0, 0.5, -0.5), "heave", 0.0)),
        _row("pseudo-random heave", "heave", partial(_random, ("heave",), (0.0, 0.0), 1.0)),
        _row("sway steps", "sway", partial(_timed, _levels(1.0, 0.0, -1.0, 0.0, 0.5, -0.5), "sway", 0.0)),
        _row("pseudo-random sway and steering", "sway steer", partial(_random, ("sway", "steer"), (0.0, 0.0), 1.5)),
        _row("roll relay", "roll", partial(_relay, "roll", "phi", 3.0 * _DEG, 0.0), closed=True),
        _row("roll doublets", "roll", partial(_timed, _levels(1.0, -1.0, 0.0, 1.0, -1.0, 0.0), "roll", 0.0)),
        _row("pitch relay", "pitch", partial(_relay, "pitch", "theta", 3.0 * _DEG, 0.0), closed=True),
        _row("pitch doublets", "pitch", partial(_timed, _levels(1.0, -1.0, 0.0, 1.0, -1.0, 0.0), "pitch", 0.0)),
    )
}  # fmt: skip
"""Name -> manoeuvre; adding one is one line here."""
