"""How fast, how far and with how much turning a craft moves: of runs flown, and of manoeuvres proposed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.limits.subject import Subject
from gcs_autotune.models.coupled import Form
from gcs_autotune.models.coupled.program import states_of
from gcs_autotune.sname import DOFS, SIGNALS

__all__ = ["Kind", "Reach", "reach_of", "reach_of_runs"]

Array = NDArray[np.float64]

Kind = Literal["circle", "straight run", "zig-zag", "run"]

STEADY = 3.0
"""Mean yaw rate over its standard deviation above which a turn counts as a circle."""


@dataclass(frozen=True, slots=True)
class Reach:
    """Extremes of a motion, SI units.

    ``largest`` magnitude per velocity (``u`` .. ``r``); ``turned`` total range of the heading [rad], ``tilt`` largest
    roll or pitch [rad]; ``room`` longer side of the box around the track [m], ``deep`` range of the depth [m], 0 where
    the form has none; ``seconds`` of motion; ``kind`` what it looks like.
    """

    largest: Mapping[str, float]
    turned: float
    tilt: float
    room: float
    deep: float
    seconds: float
    kind: Kind

    def beyond(self, seen: Reach, factor: float) -> tuple[str, ...]:
        """Return, in words, what exceeds *seen* by more than *factor*; turning and depth count too."""
        said = []
        for name, value in self.largest.items():
            unit = SIGNALS[name][0]
            scale, shown = (180.0 / math.pi, "deg/s") if "rad" in unit else (1.0, unit)
            known = seen.largest.get(name, 0.0)
            if value > factor * known + 1e-9:
                said.append(f"{SIGNALS[name][1]} {value * scale:.3g} {shown} (seen {known * scale:.3g})")
        for what, mine, known, scale, unit in (
            ("tilt", self.tilt, seen.tilt, 180.0 / math.pi, "deg"),
            ("room", self.room, seen.room, 1.0, "m"),
            ("depth range", self.deep, seen.deep, 1.0, "m"),
        ):
            if mine > factor * known + 1e-9:
                said.append(f"{what} {mine * scale:.3g} {unit} (seen {known * scale:.3g})")
        return tuple(said)


def reach_of(form: Form, t: Array, X: Array) -> Reach:
    """Return the reach of simulated states *X* (s, n) at stamps *t* (s,)."""
    states = states_of(form)

    def span(name: str) -> float:
        return float(np.ptp(X[:, states.index(name)])) if name in states else 0.0

    velocities = [DOFS[d].velocity for d in form.dofs]
    tilts = [float(np.abs(X[:, states.index(n)]).max()) for n in ("phi", "theta") if n in states]
    return Reach(
        largest={n: float(np.abs(X[:, states.index(n)]).max()) for n in velocities},
        turned=span("psi"),
        tilt=max(tilts, default=0.0),
        room=max(span("x"), span("y")),
        deep=span("z"),
        seconds=float(t[-1] - t[0]),
        kind=_kind(X[:, states.index("r")] if "r" in states else None, span("psi")),
    )


def reach_of_runs(subject: Subject) -> tuple[Reach, tuple[Reach, ...]]:
    """Return the reach of all runs together and of each record, as the model moves on their inputs."""
    each = tuple(reach_of(subject.form, *subject.motion(i)) for i in range(len(subject.records)))
    return _together(each), each


def _together(each: Sequence[Reach]) -> Reach:
    kinds = {r.kind for r in each}
    return Reach(
        largest={n: max(r.largest[n] for r in each) for n in each[0].largest},
        turned=max(r.turned for r in each),
        tilt=max(r.tilt for r in each),
        room=max(r.room for r in each),
        deep=max(r.deep for r in each),
        seconds=sum(r.seconds for r in each),
        kind=each[0].kind if len(kinds) == 1 else "run",
    )


def _kind(r: Array | None, turned: float) -> Kind:
    if r is None:
        return "run"
    if turned < math.radians(10.0):
        return "straight run"
    if turned > 1.5 * math.pi and abs(float(r.mean())) > STEADY * float(r.std()):
        return "circle"
    big = r[np.abs(r) > 0.3 * np.abs(r).max()]
    changes = int(np.count_nonzero(np.diff(np.sign(big)))) if len(big) else 0
    return "zig-zag" if changes >= 3 and turned < math.pi else "run"
