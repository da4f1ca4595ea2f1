"""Random tunes with faults, by seed."""

from __future__ import annotations

import math
import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

from benchmarks.faults.fault import KINDS, STATION_KINDS, Fault

__all__ = ["FLEET", "STATION_MODES", "Case", "Subject", "draw_case", "draw_station_case"]


@dataclass(frozen=True, slots=True)
class Subject:
    """A vehicle and one of its axes.

    ``model``: alpha, beta, beta_quadratic per fraction of full output; ``lasts``: typical duration of a short tune [s];
    ``parameters``: poor initial ones; ``modes``: its possible initial modes.
    """

    vehicle: str
    axis: str
    dof: str
    model: tuple[float, float, float]
    lasts: float
    parameters: Mapping[str, float]
    modes: tuple[int, ...]


_SUB_MODES = (19, 2, 0)

FLEET: tuple[Subject, ...] = (
    Subject("charlie", "heading", "yaw", (16.36, 4.912, 0.0), 96.0, {}, (4, 0, 1)),
    Subject("videoray", "heading", "yaw", (0.18006, 0.0, 0.40550), 60.0, {"ATC_RAT_YAW_P": 0.05}, _SUB_MODES),
    Subject("automarine", "heading", "yaw", (0.63060, 0.0, 1.14594), 60.0, {"ATC_RAT_YAW_P": 0.05}, _SUB_MODES),
    Subject("falcon", "heading", "yaw", (0.2, 0.75, 0.025), 60.0, {"ATC_RAT_YAW_P": 0.05}, _SUB_MODES),
    Subject("videoray", "depth", "heave", (0.82372, 1.49571, 0.0), 60.0, {"PSC_ACCZ_P": 0.2}, _SUB_MODES),
    Subject("falcon", "depth", "heave", (0.43333, 0.66667, 0.06667), 60.0, {"PSC_ACCZ_P": 0.2}, _SUB_MODES),
)

STEP_DURATION = 8.0
_FULL_SHARE = 0.02
_FULL_LASTS = 330.0
_MOMENTS = (
    ("PARAM_REQUEST_READ", 100),
    ("COMMAND_LONG", 26),
    ("RC_CHANNELS_OVERRIDE", 450),
    ("PARAM_SET", 4),
    ("PARAM_SET", 8),
)
"""Messages of the tool after which a fault may start, and how many of them a short tune sends at most."""

_SIZES: Mapping[str, tuple[float, float]] = {
    "loss": (0.05, 0.7),
    "delay": (0.05, 2.5),
    "reorder": (0.1, 2.5),
    "duplicate": (0.1, 3.0),
    "corrupt": (0.02, 0.5),
    "forged-foreign": (0.1, 1.0),
    "forged-own": (0.02, 0.6),
    "reboot": (0.0, 20.0),
}
_HAPPEN_TWICE = 0.25


@dataclass(frozen=True, slots=True)
class Case:
    """One tune: its subject, initial state, faults, and the faults while restoring.

    ``has_receiver``: it has a radio with centred sticks. A boat without one does not stay in a pilot's mode, and starts
    in HOLD.
    """

    seed: int
    index: int
    subject: Subject
    is_full: bool
    found_mode: int
    found_armed: bool
    faults: tuple[Fault, ...]
    restore_faults: tuple[Fault, ...]
    has_receiver: bool = False
    has_station: bool = False

    def to_dict(self) -> dict[str, Any]:
        """Return plain data, for the file of outcomes."""
        return {
            "seed": self.seed,
            "index": self.index,
            "subject": f"{self.subject.vehicle} {self.subject.axis}",
            "full": self.is_full,
            "mode": self.found_mode,
            "armed": self.found_armed,
            "receiver": self.has_receiver,
            "faults": [str(f) for f in self.faults],
            "restore_faults": [str(f) for f in self.restore_faults],
        }

    @classmethod
    def of(cls, subject: Subject, *faults: Fault, **options: Any) -> Self:
        """Return a case with chosen faults."""
        plain: dict[str, Any] = {
            "seed": 0,
            "index": 0,
            "is_full": False,
            "found_mode": subject.modes[0],
            "found_armed": False,
            "restore_faults": (),
        }
        return cls(subject=subject, faults=faults, **{**plain, **options})


def draw_case(seed: int, index: int, kinds: Sequence[str] = ()) -> Case:
    """Return the *index*-th case of *seed*; *kinds*: the only kinds of faults."""
    draw = random.Random(f"{seed}-{index}")
    subject = draw.choice(FLEET)
    is_full = draw.random() < _FULL_SHARE
    lasts = _FULL_LASTS if is_full else subject.lasts
    table = [k for k in KINDS if not kinds or k in kinds]
    count = 2 if draw.random() < _HAPPEN_TWICE else 1
    faults = tuple(_draw_fault(draw, draw.choice(table), lasts) for _ in range(count))
    receiver = draw.random() < 0.5
    armed = receiver and subject.vehicle == "charlie" and draw.random() < 0.3
    again: tuple[Fault, ...] = ()
    if draw.random() < 0.4:
        again = (_draw_fault(draw, draw.choice(("killed", "loss", "silence", "delay", "reboot", "disk-full")), 12.0),)
    modes = subject.modes if receiver or subject.vehicle != "charlie" else subject.modes[:1]
    return Case(seed, index, subject, is_full, draw.choice(modes), armed, faults, again, receiver)


STATION_MODES: Mapping[str, tuple[int, ...]] = {"charlie": (4, 4, 1, 3), "": (0, 2, 19)}
"""Vehicle (empty: the others) -> modes that another station orders; half of a boat's orders are HOLD."""


def draw_station_case(seed: int, index: int, kinds: Sequence[str] = ()) -> Case:
    """Return the *index*-th case of *seed* in which another station interferes at a random time of a whole tune.

    In half of the cases the tool's computer also pauses then, with or without a failsafe. In one of ten the link is
    silent then.
    """
    draw = random.Random(f"station-{seed}-{index}")
    subject = draw.choice((FLEET[0], FLEET[0], FLEET[0], *FLEET[1:]))
    table = [
        k for k in ("station-mode", "station-mode", *tuple(STATION_KINDS)[1:4], "reboot") if not kinds or k in kinds
    ]
    kind, at = draw.choice(table), draw.uniform(8.0, subject.lasts)
    modes = STATION_MODES.get(subject.vehicle, STATION_MODES[""])
    size = {"station-mode": float(draw.choice(modes)), "reboot": draw.choice((0.0, draw.uniform(0.0, 8.0)))}.get(
        kind, 0.0
    )
    faults = [Fault(kind, at, draw.uniform(2.0, 6.0), size)]
    if draw.random() < 0.5:
        stall = draw.choice((draw.uniform(0.2, 1.5), draw.uniform(0.2, 1.5), draw.uniform(2.0, 4.0)))
        faults.append(Fault("stall", max(at - draw.uniform(0.0, 1.2), 0.0), 0.0, stall))
    if draw.random() < 0.1:
        faults.append(Fault("silence", at - draw.uniform(0.0, 4.0), draw.uniform(4.0, 10.0)))
    receiver = draw.random() < 0.5
    found = subject.modes if receiver or subject.vehicle != "charlie" else subject.modes[:1]
    return Case(seed, index, subject, False, draw.choice(found), False, tuple(faults), (), receiver, has_station=True)


def _draw_fault(draw: random.Random, kind: str, lasts: float) -> Fault:
    low, high = _SIZES.get(kind, (0.0, 0.0))
    size = draw.choice((0.0, 1.0)) if kind == "stuck" else draw.uniform(low, high)
    duration = math.inf if draw.random() < 0.4 else 10.0 ** draw.uniform(-0.3, 1.7)
    way = draw.choice(("up", "down", "both", "both"))
    if draw.random() < 0.5:
        return Fault(kind, draw.uniform(0.0, lasts), duration, size, way)
    name, often = draw.choice(_MOMENTS)
    after = draw.choice((0.0, draw.uniform(0.0, 0.1), draw.uniform(0.0, 3.0)))
    return Fault(kind, after, duration, size, way, name, draw.randint(1, often))
