"""Open-loop manoeuvres: forces as functions of time, independent of the motion.

Steps, staircases, doublets, chirps, multisines, pseudo-random levels and free decay, each of any force; and
S-manoeuvres (Miskovic2010, section 4.3).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np

from gcs_autotune.craft import Actuate, Observation
from gcs_autotune.manoeuvres.excitation import (
    Signal,
    chirp,
    decay,
    full,
    growing,
    levels,
    multisine,
    prbs,
    sine,
    staircase,
)
from gcs_autotune.manoeuvres.free_decay import released
from gcs_autotune.manoeuvres.hold_controller import HELD_DURING, HeadingHold, HoldController, hold
from gcs_autotune.manoeuvres.kind import ManoeuvreKind, Preset
from gcs_autotune.manoeuvres.manoeuvre import Commands, Manoeuvre, Outcome
from gcs_autotune.sname import DOFS

__all__ = ["DOF_OF", "KINDS", "WITHOUT_THROTTLE", "OpenLoopProgramme", "Programme", "coasting", "turning"]

Programme = Callable[[float], Mapping[str, float]]
"""Function of the time since the beginning [s] that returns force name -> fraction of full output."""

APPROACH, NO_APPROACH = 0.12, 0.02
"""Fraction of the duration before the first steering: with an approach straight ahead, and without one."""

DOF_OF: Mapping[str, str] = {dof.force: name for name, dof in DOFS.items()}
"""Force -> the degree of freedom that it drives."""


class OpenLoopProgramme(Manoeuvre):
    """Flies a programme for ``duration`` [s]. It marks ``level`` when *force* jumps.

    ``keep_still``: hold an ROV's other axes. ``on_course``: hold the heading with low gains.
    """

    def __init__(
        self,
        kind: str,
        programme: Programme,
        duration: float,
        *,
        force: str = "N",
        keep_still: bool = False,
        on_course: bool = False,
        jump: float | None = None,
    ) -> None:
        self.kind = kind  # one class flies many kinds
        super().__init__(force=force, signal={"X": "u", "Y": "v", "Z": "z", "K": "phi", "M": "theta"}.get(force, "psi"))
        self.drifts = {"Z": "z", "N": "psi"}.get(force, "")
        self._programme, self._duration = programme, duration
        self._level = 0.0
        self._jump = JUMP if jump is None else jump
        held = {"N": "psi", "Z": "z", "X": "x"}.get(force, "x")
        self._holds = [HoldController(gains) for gains in HELD_DURING[held]] if keep_still else []
        self._heading_hold = HeadingHold() if on_course else None

    @property
    def held(self) -> frozenset[str]:
        """Signals that are held during the manoeuvre. They are its only feedback."""
        course = {"psi"} if self._heading_hold is not None else set()
        return frozenset({hold.signal for hold in self._holds} | course)

    @property
    def meta_fields(self) -> Mapping[str, Any]:
        """Force, its degree of freedom and the duration [s] by name, for the trial's ``meta``."""
        return {"dof": DOF_OF[self.force], "force": self.force, "duration": self._duration}

    def commands(self, now: Observation) -> Commands:
        """Yield commands with the programme's forces."""
        start, level = now.t, math.nan
        if self._heading_hold is not None:
            self._heading_hold.start(now)
        while True:
            shares = self._programme(now.t - start)
            last, level = level, shares.get(self.force, 0.0)
            self._level = level
            if not abs(level - last) < self._jump:
                self._mark(now.t, "level", {self.force: level})
                self.phase = f"{self.force} {100.0 * level:+.0f} %"
            if now.t - start >= self._duration:
                if abs(level) >= self._jump:  # neutral follows; the last order was carried out
                    self._mark(now.t, "level", {self.force: 0.0})
                self._end("completed", f"flown for {self._duration:.0f} s")
            command = hold(Actuate(**shares), self._holds, now)
            if self._heading_hold is not None:
                # a craft that coasts is left alone: thrusters that steer by their difference push it ahead
                command = replace(command, N=self._heading_hold.steer(now) if command.X else 0.0)
            now = yield command

    def where_drift_ends(self, where: str, side: float) -> Outcome | None:
        """Return the outcome "stopped", unless the force already drives the craft back."""
        return None if side * self._level < 0.0 else Outcome("stopped", f"{where}. The record so far is used")


JUMP = 0.1
"""Change of a force between two commands [fraction of full output] above which it is marked as a jump.

A smaller change belongs to a curve. Project choice.
"""


# --- programmes: functions of time from 0 to 1 after the approach ------------------------------------------------


def _timed(signal: Callable[[float], float], force: str, thrust: float, size: float, seconds: float) -> Programme:
    """Return a programme of *signal* on *force* at constant *thrust*, after the approach."""
    begin = (APPROACH if thrust else NO_APPROACH) * seconds

    def at(t: float) -> Mapping[str, float]:
        share = size * signal((t - begin) / (seconds - begin)) if t >= begin else 0.0
        return {force: share} if force == "X" or not thrust else {"X": thrust, force: share}

    return at


def _random(forces: str, thrust: tuple[float, float], shortest: float, size: float, seconds: float) -> Programme:
    """Return a programme with levels of random length and sign, independent for each force; thrust is between two
    limits."""
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


def coasting(kind: str, shares: tuple[float, ...]) -> Callable[[float], OpenLoopProgramme]:
    """Return a function that makes, for a duration [s], a programme that accelerates at each thrust level and coasts
    after it.
    """

    def make(seconds: float) -> OpenLoopProgramme:
        each = seconds / len(shares)

        def at(t: float) -> Mapping[str, float]:
            k = min(int(t / each), len(shares) - 1)
            return {"X": shares[k] if t - k * each < 0.55 * each else 0.0}

        return OpenLoopProgramme(kind, at, seconds, force="X")

    return make


def turning(kind: str, thrust: float) -> Callable[[float], OpenLoopProgramme]:
    """Return a function that makes, for a duration [s], a turn at full steering and constant *thrust*."""
    return lambda seconds: OpenLoopProgramme(kind, _timed(full, "N", thrust, 1.0, seconds), seconds)


def _s_legs(thrust: float, astern: float, size: float, seconds: float) -> Programme:
    """Return a programme that steers one way and the other at constant *thrust*, then again astern (Miskovic2007,
    II-D)."""
    legs = [(thrust, size), (thrust, -size)] + [(-astern, size), (-astern, -size)] * (astern > 0.0)
    begin = APPROACH * seconds

    def at(t: float) -> Mapping[str, float]:
        if t < begin:
            return {"X": thrust, "N": 0.0}
        X, N = legs[min(int((t - begin) / (seconds - begin) * len(legs)), len(legs) - 1)]
        return {"X": X, "N": N}

    return at


def _s_throttle(size: float, seconds: float) -> Programme:
    """Return a programme that steers an S while the thrust changes from leg to leg."""

    def at(t: float) -> Mapping[str, float]:
        x = t / seconds
        return {"X": (1.0, 0.4, 0.8, 0.2)[min(int(4.0 * x), 3)], "N": size if int(6.0 * x) % 2 else -size}

    return at


# --- the kinds ----------------------------------------------------------------------------------------------


def _preset(title: str, forces: str, kind: str, programme: Callable[[float, float], Programme]) -> Preset:
    """Return a preset of *programme*, a function of amplitude and seconds, at full amplitude."""
    return Preset(
        title, forces, lambda seconds: OpenLoopProgramme(kind, programme(1.0, seconds), seconds, force=forces[-1])
    )


def _of_any_force(
    name: str,
    help: str,
    signal: Callable[[Mapping[str, float], bool], Signal],
    *presets: tuple[str, str, Callable[[float, float], Programme]],
    options: Sequence[str] = (),
    tied: bool = False,
    shrinks: Mapping[str, float] = MappingProxyType({}),
    instead: Mapping[str, Callable[..., ManoeuvreKind]] = MappingProxyType({}),
) -> ManoeuvreKind:
    """Return a row for a manoeuvre on any force; *signal* (options, whether the force may reverse) is the waveform.

    *instead*: force -> function that returns its row, called with the force and this function.
    *shrinks*: as in the row, in addition to the duration. It includes the amplitude if a smaller one needs less space.
    """

    def row(force: str) -> ManoeuvreKind:
        if force in instead:
            return instead[force](force, row)

        def make(given: Mapping[str, float]) -> OpenLoopProgramme:
            seconds, keep_still = given["duration"], bool(given["keep-still"]) and not tied
            ahead_only = force == "X" and not keep_still and not tied
            size = given["steering"] * (1.0 if ahead_only else given["side"])
            thrust = 0.0 if force == "X" or tied else given["throttle"]
            jump = 0.5 * abs(size) / given["levels"] if "levels" in given else None
            programme = _timed(signal(given, not ahead_only), force, thrust, size, seconds)
            return OpenLoopProgramme(
                name, programme, seconds, force=force, keep_still=keep_still, on_course=ahead_only, jump=jump
            )

        return ManoeuvreKind(
            name=name,
            help=help,
            excites=frozenset({DOF_OF[force]}),
            drives=frozenset({force}),
            make=make,
            options=("steering", "duration", *options),
            room="none: the craft is tied to a bollard" if tied else ROOM[force],
            turns=force == "N" or tied,
            identifies=not tied,
            tied=tied,
            presets=tuple(_preset(title, forces, name, programme) for title, forces, programme in presets),
            for_force=row,
            shrinks={} if tied else {"duration": 1.0, **shrinks, **({} if force == "N" else {"steering": GENTLER})},
        )

    return row("N")


def _steered(
    name: str,
    help: str,
    flown: Callable[[Mapping[str, float]], Programme],
    *presets: tuple[str, str, Callable[[float, float], Programme]],
    room: str,
    options: Sequence[str] = (),
) -> ManoeuvreKind:
    """Return a row for a manoeuvre that steers under way; *flown* makes the programme from the options."""

    def make(given: Mapping[str, float]) -> OpenLoopProgramme:
        return OpenLoopProgramme(name, flown(given), given["duration"], keep_still=bool(given["keep-still"]))

    return ManoeuvreKind(
        name=name,
        help=help,
        excites=frozenset({"yaw", "surge", "sway"}),
        drives=frozenset({"N"}),
        make=make,
        options=("steering", "duration", *options),
        room=room,
        turns=True,
        presets=tuple(_preset(title, forces, name, programme) for title, forces, programme in presets),
        shrinks={"duration": 1.0},
    )


def _ahead(signal: Signal, either_way: bool) -> Signal:
    """Return *signal*, or, for a force with one direction only, the same signal about half of full output."""
    return signal if either_way else lambda x: 0.5 + 0.5 * signal(x)


def _s_flown(given: Mapping[str, float]) -> Programme:
    thrust = given["throttle"] or WITHOUT_THROTTLE
    astern = given.get("astern", 0.0) or (thrust if given["keep-still"] else 0.0)
    return _s_legs(thrust, astern, given["side"] * given["steering"], given["duration"])


def _grown(given: Mapping[str, float]) -> Programme:
    return _timed(growing, "N", given["throttle"], given["side"] * given["steering"], given["duration"])


GENTLER = 0.4
"""The amplitude is reduced by this power of the factor by which the duration is reduced. At an eighth of the duration,
thrusters are still outside their dead band. Project choice.
"""
WITHOUT_THROTTLE = 0.5
"""Default thrust ahead of a craft without cruise throttle and without --throttle. Project choice."""
ROOM: Mapping[str, str] = {
    "N": "a few turning circles under way; at the spot without --throttle",
    "X": "distance of speed times duration, straight ahead",
    "Y": "a few metres to either side",
    "Z": "the depth the manoeuvre needs",
    "K": "at the spot",
    "M": "at the spot",
}
_UP_AND_DOWN = levels(1.0, 0.0, -1.0, 0.0, 0.5, -0.5)
_EITHER_WAY = levels(1.0, 0.5, 0.0, -1.0, -0.5, 0.0)
_THROTTLES = levels(0.3, 1.0, 0.0, 0.6, 0.2, 0.8)
_DOUBLET, _DOUBLETS = levels(1.0, -1.0, 0.0), levels(1.0, -1.0, 0.0, 1.0, -1.0, 0.0)

KINDS: tuple[ManoeuvreKind, ...] = (
    _of_any_force(
        "steps",
        "one force in timed steps: full, half, none, in each direction that is allowed",
        lambda given, either_way: _EITHER_WAY if either_way else _THROTTLES,
        ("steering step", "N", partial(_timed, full, "N", 0.0)),
        ("steering steps", "N", partial(_timed, _EITHER_WAY, "N", 0.0)),
        ("throttle steps", "X", partial(_timed, _THROTTLES, "X", 0.0)),
        ("heave steps", "Z", partial(_timed, _UP_AND_DOWN, "Z", 0.0)),
        ("sway steps", "Y", partial(_timed, _UP_AND_DOWN, "Y", 0.0)),
    ),
    _of_any_force(
        "staircase",
        "one force in equal steps up and down, in each direction that is allowed",
        lambda given, either_way: staircase(int(given["levels"]), either_way),
        options=("levels",),
    ),
    _of_any_force(
        "bollard-staircase",
        "one force in equal steps up and down, in both directions, on a craft tied to a bollard; enter the pulls later",
        lambda given, either_way: staircase(int(given["levels"]), either_way),
        options=("levels",),
        tied=True,
    ),
    _of_any_force(
        "doublets",
        "one force in one direction, in the other, then none, repeated",
        lambda given, either_way: _DOUBLETS if either_way else levels(1.0, 0.0, 0.5, 1.0, 0.0, 0.5),
        ("steering doublet", "N", partial(_timed, _DOUBLET, "N", 0.0)),
        ("roll doublets", "K", partial(_timed, _DOUBLETS, "K", 0.0)),
        ("pitch doublets", "M", partial(_timed, _DOUBLETS, "M", 0.0)),
    ),
    _of_any_force(
        "chirp",
        "one force as a sine sweep, faded in and out",
        lambda given, either_way: _ahead(chirp(given), either_way),
        options=("f-start", "f-stop", "fade-in", "fade-out"),
        shrinks={"f-start": -1.0, "fade-in": 1.0, "fade-out": 1.0},
    ),
    _of_any_force(
        "multisine",
        "one force as a multisine between two frequencies",
        lambda given, either_way: _ahead(multisine(given), either_way),
        options=("f-start", "f-stop"),
        shrinks={"f-start": -1.0},
    ),
    _of_any_force(
        "prbs",
        "one force as a pseudo-random binary sequence",
        lambda given, either_way: _ahead(prbs(given), either_way),
        ("pseudo-random steering", "N", partial(_random, "N", (0.0, 0.0), 1.0)),
        ("pseudo-random steering at 60 % throttle", "X N", partial(_random, "N", (0.0, 0.6), 1.0)),
        ("pseudo-random steering and throttle", "X N", partial(_random, "N X", (0.1, 1.0), 1.5)),
        ("pseudo-random sway and steering", "Y N", partial(_random, "Y N", (0.0, 0.0), 1.5)),
        ("pseudo-random throttle", "X", partial(_random, "X", (0.1, 1.0), 1.5)),
        ("pseudo-random heave", "Z", partial(_random, "Z", (0.0, 0.0), 1.0)),
        options=("shortest",),
        shrinks={"shortest": 1.0},
    ),
    _of_any_force(
        "free-decay",
        "one force for a set time, then none, to record the decay of the motion",
        lambda given, either_way: decay(given),
        options=("push",),
        shrinks={"push": 1.0},
        instead={"K": released, "M": released},
    ),
    _steered(
        "s-manoeuvre",
        "constant thrust, steering to one side, then to the other; with thrust astern also (ROVs, and with --astern)",
        _s_flown,
        ("S-manoeuvre at 60 % throttle", "X N", partial(_timed, sine(3.0), "N", 0.6)),
        ("S-manoeuvre with changing throttle", "X N", _s_throttle),
        room="distance of speed times duration, straight ahead",
        options=("astern",),
    ),
    _steered(
        "growing-turn",
        "steering that grows from zero to full",
        _grown,
        ("growing turn (spiral) at 60 % throttle", "X N", partial(_timed, growing, "N", 0.6)),
        ("growing turn (spiral) at 100 % throttle", "X N", partial(_timed, growing, "N", 1.0)),
        room="a few turning circles",
    ),
)
"""Entries of the table of manoeuvres for open-loop manoeuvres."""
