"""Manoeuvres by the clock: forces as functions of time, whatever the craft does. Steps, doublets, circles, spirals,
S-manoeuvres, coasting, pseudo-random levels (Miskovic2010, section 4.3)."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from gcs_autotune.craft import Actuate, Observation
from gcs_autotune.manoeuvres.hold_controller import HELD_MEANWHILE, HoldController, hold
from gcs_autotune.manoeuvres.kind import ManoeuvreKind, Preset
from gcs_autotune.manoeuvres.manoeuvre import Commands, Manoeuvre

__all__ = ["KINDS", "OpenLoop", "Programme"]

Programme = Callable[[float], Mapping[str, float]]
"""Time since the beginning [s] -> force name -> fraction of full."""

APPROACH, NO_APPROACH = 0.12, 0.02
"""Shares of the time spent straight ahead, or at rest, before anything is steered."""


class OpenLoop(Manoeuvre):
    """Flies a programme for ``duration`` [s]. Marks ``level`` where a force jumps."""

    def __init__(
        self, kind: str, programme: Programme, duration: float, *, force: str = "N", keep_still: bool = False
    ) -> None:
        self.kind = kind  # one class flies many kinds
        super().__init__(force=force, signal={"X": "u", "Z": "z"}.get(force, "psi"))
        self._programme, self._duration = programme, duration
        held = {"N": "psi", "Z": "z", "X": "x"}.get(force, "x")
        self._holds = [HoldController(gains) for gains in HELD_MEANWHILE[held]] if keep_still else []

    @property
    def asked(self) -> Mapping[str, Any]:
        """Force and duration."""
        return {"force": self.force, "duration": self._duration}

    def commands(self, now: Observation) -> Commands:
        """Yield the programme's forces."""
        start, level = now.t, math.nan
        while True:
            shares = self._programme(now.t - start)
            if shares.get(self.force, 0.0) != level:
                level = shares.get(self.force, 0.0)
                self._mark(now.t, "level", {self.force: level})
            if now.t - start >= self._duration:
                self._end("completed", f"flown for {self._duration:.0f} s")
            now = yield hold(Actuate(**shares), self._holds, now)


# --- programmes: functions of time from 0 to 1 after the approach ------------------------------------------------


def _levels(*values: float) -> Callable[[float], float]:
    return lambda x: values[min(int(x * len(values)), len(values) - 1)]


def _sine(periods: float) -> Callable[[float], float]:
    return lambda x: math.sin(2.0 * math.pi * periods * x)


def _full(x: float) -> float:
    return 1.0


def _growing(x: float) -> float:
    return min(x / 0.9, 1.0)


def _timed(signal: Callable[[float], float], force: str, thrust: float, size: float, seconds: float) -> Programme:
    """Return *signal* on *force* at constant *thrust*, after the approach."""
    begin = (APPROACH if thrust else NO_APPROACH) * seconds

    def at(t: float) -> Mapping[str, float]:
        share = size * signal((t - begin) / (seconds - begin)) if t >= begin else 0.0
        return {force: share} if force == "X" or not thrust else {"X": thrust, force: share}

    return at


def _random(forces: str, thrust: tuple[float, float], shortest: float, size: float, seconds: float) -> Programme:
    """Return levels of random length and sign, each force its own; thrust between two shares."""
    rng = np.random.default_rng(20)
    names = forces.split()
    now, until = dict.fromkeys(names, 0.0), dict.fromkeys(names, 0.0)

    def at(t: float) -> Mapping[str, float]:
        for name in names:
            if t >= until[name]:
                until[name] = t + shortest * float(rng.integers(1, 5))
                one, other = thrust if name == "X" else (-size, size)
                now[name] = one if rng.random() < 0.5 else other
        return {**({} if "X" in names or not thrust[1] else {"X": thrust[1]}), **now}

    return at


def _coast(shares: tuple[float, ...], size: float, seconds: float) -> Programme:
    """Return acceleration at each share of thrust in turn, and coasting after it."""
    each = seconds / len(shares)

    def at(t: float) -> Mapping[str, float]:
        k = min(int(t / each), len(shares) - 1)
        return {"X": size * shares[k] if t - k * each < 0.55 * each else 0.0}

    return at


def _s_throttle(size: float, seconds: float) -> Programme:
    """Return steering in an S while the thrust changes from leg to leg."""

    def at(t: float) -> Mapping[str, float]:
        x = t / seconds
        return {"X": (1.0, 0.4, 0.8, 0.2)[min(int(4.0 * x), 3)], "N": size if int(6.0 * x) % 2 else -size}

    return at


# --- the kinds ----------------------------------------------------------------------------------------------


def _preset(title: str, forces: str, kind: str, programme: Callable[[float, float], Programme]) -> Preset:
    """Return a preset of *programme*, a function of size and seconds, at full size."""
    return Preset(title, forces, lambda seconds: OpenLoop(kind, programme(1.0, seconds), seconds, force=forces[-1]))


def _kind(
    name: str,
    help: str,
    excites: str,
    force: str,
    flown: Callable[[float, float, float], Programme],
    *presets: tuple[str, str, Callable[[float, float], Programme]],
    room: str = "about where the craft is",
    turns: bool = False,
) -> ManoeuvreKind:
    """Return a row; *flown* (throttle, size, seconds) is what ``fly`` flies."""

    def make(options: Mapping[str, float]) -> OpenLoop:
        seconds, thrust = options["duration"], options["throttle"]
        size = options["side"] * options["steering"] if force == "N" else options["steering"]
        keep_still = bool(options["keep-still"])
        return OpenLoop(name, flown(thrust, size, seconds), seconds, force=force, keep_still=keep_still)

    return ManoeuvreKind(
        name=name,
        help=help,
        excites=frozenset(excites.split()),
        drives=frozenset({force}),
        make=make,
        options=("steering", "duration"),
        room=room,
        turns=turns,
        presets=tuple(_preset(title, forces, name, programme) for title, forces, programme in presets),
    )


def _by_throttle(signal: Callable[[float], float], force: str = "N") -> Callable[[float, float, float], Programme]:
    return lambda thrust, size, seconds: _timed(signal, force, thrust, size, seconds)


_UP_AND_DOWN = _levels(1.0, 0.0, -1.0, 0.0, 0.5, -0.5)
_EITHER_WAY = _levels(1.0, 0.5, 0.0, -1.0, -0.5, 0.0)
_THROTTLES = _levels(0.3, 1.0, 0.0, 0.6, 0.2, 0.8)
_DOUBLETS = _levels(1.0, -1.0, 0.0, 1.0, -1.0, 0.0)
_AHEAD = "what the speed makes of the duration, straight ahead"
_WIDE = "some turning circles"

KINDS: tuple[ManoeuvreKind, ...] = (
    _kind(
        "steering-steps",
        "steering by the clock: full, half, none, then the other way",
        "yaw",
        "N",
        _by_throttle(_EITHER_WAY),
        ("steering step", "N", partial(_timed, _full, "N", 0.0)),
        ("steering steps", "N", partial(_timed, _EITHER_WAY, "N", 0.0)),
        room=_WIDE,
        turns=True,
    ),
    _kind(
        "steering-doublet",
        "steering one way, the other way, none",
        "yaw",
        "N",
        _by_throttle(_levels(1.0, -1.0, 0.0)),
        ("steering doublet", "N", partial(_timed, _levels(1.0, -1.0, 0.0), "N", 0.0)),
        room=_WIDE,
        turns=True,
    ),
    _kind(
        "turning-circle",
        "the same steering for all of the duration",
        "yaw surge sway",
        "N",
        _by_throttle(_full),
        *((f"turning circle at {p} % throttle", "X N", partial(_timed, _full, "N", p / 100.0)) for p in (30, 60, 100)),
        room="a few turning circles",
        turns=True,
    ),
    _kind(
        "s-manoeuvre",
        "steering as a sine of three periods",
        "yaw surge sway",
        "N",
        _by_throttle(_sine(3.0)),
        ("S-manoeuvre at 60 % throttle", "X N", partial(_timed, _sine(3.0), "N", 0.6)),
        ("S-manoeuvre with changing throttle", "X N", _s_throttle),
        room=_AHEAD,
        turns=True,
    ),
    _kind(
        "growing-turn",
        "steering that grows from none to all",
        "yaw surge sway",
        "N",
        _by_throttle(_growing),
        ("growing turn (spiral) at 60 % throttle", "X N", partial(_timed, _growing, "N", 0.6)),
        ("growing turn (spiral) at 100 % throttle", "X N", partial(_timed, _growing, "N", 1.0)),
        room=_WIDE,
        turns=True,
    ),
    _kind(
        "steering-random",
        "pseudo-random steering",
        "yaw",
        "N",
        lambda thrust, size, seconds: _random("N", (0.0, thrust), 1.0, size, seconds),
        ("pseudo-random steering", "N", partial(_random, "N", (0.0, 0.0), 1.0)),
        ("pseudo-random steering at 60 % throttle", "X N", partial(_random, "N", (0.0, 0.6), 1.0)),
        ("pseudo-random steering and throttle", "X N", partial(_random, "N X", (0.1, 1.0), 1.5)),
        ("pseudo-random sway and steering", "Y N", partial(_random, "Y N", (0.0, 0.0), 1.5)),
        room=_WIDE,
        turns=True,
    ),
    _kind(
        "thrust-steps",
        "thrust ahead by the clock",
        "surge",
        "X",
        _by_throttle(_THROTTLES, "X"),
        ("throttle steps", "X", partial(_timed, _THROTTLES, "X", 0.0)),
        ("pseudo-random throttle", "X", partial(_random, "X", (0.1, 1.0), 1.5)),
        room=_AHEAD,
    ),
    _kind(
        "coast-down",
        "thrust ahead for a little over half of the duration, then none",
        "surge",
        "X",
        lambda thrust, size, seconds: _coast((1.0,), size, seconds),
        ("acceleration and coast-down", "X", partial(_coast, (1.0,))),
        ("accelerations to three speeds and coast-down", "X", partial(_coast, (0.3, 0.6, 1.0))),
        room=_AHEAD,
    ),
    _kind(
        "heave-steps",
        "vertical thrust by the clock",
        "heave",
        "Z",
        _by_throttle(_UP_AND_DOWN, "Z"),
        ("heave steps", "Z", partial(_timed, _UP_AND_DOWN, "Z", 0.0)),
        ("pseudo-random heave", "Z", partial(_random, "Z", (0.0, 0.0), 1.0)),
        room="the depth that it takes",
    ),
    _kind(
        "sway-steps",
        "thrust sideways by the clock",
        "sway",
        "Y",
        _by_throttle(_UP_AND_DOWN, "Y"),
        ("sway steps", "Y", partial(_timed, _UP_AND_DOWN, "Y", 0.0)),
        room="some metres to either side",
    ),
    _kind(
        "roll-doublets",
        "roll moment one way and the other",
        "roll",
        "K",
        _by_throttle(_DOUBLETS, "K"),
        ("roll doublets", "K", partial(_timed, _DOUBLETS, "K", 0.0)),
    ),
    _kind(
        "pitch-doublets",
        "pitch moment one way and the other",
        "pitch",
        "M",
        _by_throttle(_DOUBLETS, "M"),
        ("pitch doublets", "M", partial(_timed, _DOUBLETS, "M", 0.0)),
    ),
)
"""The rows of the table that are flown by the clock."""
