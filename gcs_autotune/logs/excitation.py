"""How much a run may tell of each degree of freedom, at a glance: was it driven, did it answer, how densely told.

A first look before anybody waits for a fit; what can really be told the identification says, with standard errors.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.logs.tape import Note
from gcs_autotune.sname import DOFS, Dof
from gcs_autotune.trial import Channel, Trial

__all__ = ["Excitation", "excitation_of", "little_told"]

Array = NDArray[np.float64]

AXES = ("yaw", "surge", "sway", "heave")
SMALL_INPUT = 0.05
"""Chosen: an input that moves by less of full output tells nothing a sensor could see."""
FEW_CHANGES = 4
"""Chosen: fewer swings of the input from one side to the other leave inertia and drag hard to tell apart."""
QUIET = 3.0
"""Chosen: a response that scatters by less than so many times its noise is none."""
SLOW = 0.5
"""Chosen [s]: samples further apart miss what a small craft does."""
FEWEST = 20
GOOD = "worth a try"


@dataclass(frozen=True, slots=True)
class Excitation:
    """One degree of freedom of one run.

    Attributes
    ----------
    input_range : of full output (or in the input's unit), from the 2nd to the 98th percentile.
    swings : times the input went from the upper to the lower third of that range or back.
    response : name of the channel looked at. response_to_noise : its scatter over that of its short-time noise.
    input_interval, response_interval : median [s] between samples.
    verdict : ``worth a try``, ``weak`` or ``nothing``; why : in words.
    """

    dof: str
    input: str
    input_range: float
    swings: int
    response: str
    response_to_noise: float
    input_interval: float
    response_interval: float
    verdict: str
    why: str

    def to_dict(self) -> dict[str, Any]:
        """Return plain data."""
        return asdict(self)


def excitation_of(run: Trial) -> list[Excitation]:
    """Return a first look at each degree of freedom that *run* has an input and a response of."""
    found = (_look(run, DOFS[name]) for name in AXES)
    return [e for e in found if e is not None]


def little_told(looks: list[Excitation]) -> Note | None:
    """Return the doubt of a run none of whose axes is worth a try; None when one is, or there was none to look at."""
    if not looks or any(e.verdict == GOOD for e in looks):
        return None
    return (
        "little-excitation",
        f"this run hardly tells anything ({'; '.join(f'{e.dof}: {e.why}' for e in looks)})",
        "record a relay, a zig-zag or steps to both sides, larger and longer",
    )


def _look(run: Trial, dof: Dof) -> Excitation | None:
    names = [n for n in ((dof.force, "delta") if dof.name == "yaw" else (dof.force,)) if n in run]
    answers = [n for n in (dof.velocity, dof.position, *(("U",) if dof.name == "surge" else ())) if n in run]
    answers = [n for n in answers if len(run[n]) >= FEWEST]
    if not names or not answers or len(run[names[0]]) < 2:
        return None
    cause, effect = run[names[0]], run[answers[0]]
    low, high = np.percentile(cause.values, [2.0, 98.0])
    swings = _swings(cause.values, float(low), float(high))
    ratio = _to_noise(effect, is_angle=effect.unit == "rad")
    step, beat = _interval(cause), _interval(effect)
    reasons = [
        (high - low < SMALL_INPUT, "nothing", "the input hardly moves"),
        (ratio < QUIET, "nothing", "the response is lost in its noise"),
        (swings < FEW_CHANGES, "weak", f"the input swings only {swings} times from side to side"),
        (max(step, beat) > SLOW, "weak", f"a sample every {max(step, beat):.2g} s is slow for a small craft"),
    ]
    verdict, why = next(((v, w) for holds, v, w in reasons if holds), (GOOD, ""))
    return Excitation(
        dof.name, cause.name, float(high - low), swings, effect.name, ratio, step, beat, verdict, why
    )  # fmt: skip


def _swings(values: Array, low: float, high: float) -> int:
    third = (high - low) / 3.0
    if third <= 0.0:
        return 0
    side = np.where(values > high - third, 1, np.where(values < low + third, -1, 0))
    side = side[side != 0]
    return int(np.sum(side[1:] != side[:-1])) if len(side) else 0


def _to_noise(channel: Channel, *, is_angle: bool) -> float:
    values = np.unwrap(channel.values) if is_angle else channel.values
    noise = float(np.median(np.abs(np.diff(values, n=2)))) / (0.6745 * np.sqrt(6.0))
    steps = np.unique(np.abs(np.diff(values)))
    smallest = float(steps[steps > 0.0][0]) if np.any(steps > 0.0) else 0.0
    floor = max(noise, smallest / np.sqrt(12.0))
    return float(np.std(values)) / floor if floor > 0.0 else 0.0


def _interval(channel: Channel) -> float:
    steps = np.diff(channel.t)
    steps = steps[steps > 0.0]
    return float(np.median(steps)) if len(steps) else float("inf")
