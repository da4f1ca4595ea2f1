"""Simulate a proposed manoeuvre: inputs, motion, space, and the expected record.

A manoeuvre commands normalised forces per equation. Any input channels are possible (thrust and moment, a rudder, a
pair of thrusters). :class:`ChannelAllocation` converts the forces into channel values inside the range of the runs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.craft import Actuate, Command, Observation
from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.problems import FittedModel
from gcs_autotune.identify.signals import Segment, Signal
from gcs_autotune.manoeuvres import Preset, fly_on
from gcs_autotune.models import FORCES, Form, Simulator, states_of
from gcs_autotune.sname import DOFS, SIGNALS

__all__ = [
    "CONTROL_STEP",
    "ROLES",
    "ChannelAllocation",
    "Flight",
    "Kind",
    "ManoeuvringRoom",
    "allocation_of",
    "allocation_of_shares",
    "fly",
    "room_of",
    "room_of_runs",
]

Array = NDArray[np.float64]

Kind = Literal["circle", "straight run", "zig-zag", "run"]

STEADY = 3.0
"""Ratio of mean yaw rate to its standard deviation above which a turn counts as a circle. Project choice."""


@dataclass(frozen=True, slots=True)
class ManoeuvringRoom:
    """Extremes of a motion, SI units.

    - ``largest``: magnitude of each velocity (``u`` .. ``r``).
    - ``turned``: total range of the heading [rad].
    - ``tilt``: largest roll or pitch [rad].
    - ``room``: longer side of the box around the track [m].
    - ``deep``: range of the depth [m], 0 if the form has none.
    - ``seconds``: duration of the motion.
    - ``kind``: kind of manoeuvre that the motion resembles.
    """

    largest: Mapping[str, float]
    turned: float
    tilt: float
    room: float
    deep: float
    seconds: float
    kind: Kind

    def beyond(self, seen: ManoeuvringRoom, factor: float) -> tuple[str, ...]:
        """Return descriptions of the quantities that exceed *seen* by more than *factor*, including turning and
        depth.
        """
        exceeded = []
        for name, value in self.largest.items():
            unit = SIGNALS[name][0]
            scale, shown = (180.0 / math.pi, "deg/s") if "rad" in unit else (1.0, unit)
            known = seen.largest.get(name, 0.0)
            if value > factor * known + 1e-9:
                exceeded.append(f"{SIGNALS[name][1]} {value * scale:.3g} {shown} (seen {known * scale:.3g})")
        for what, mine, known, scale, unit in (
            ("tilt", self.tilt, seen.tilt, 180.0 / math.pi, "deg"),
            ("room", self.room, seen.room, 1.0, "m"),
            ("depth range", self.deep, seen.deep, 1.0, "m"),
        ):
            if mine > factor * known + 1e-9:
                exceeded.append(f"{what} {mine * scale:.3g} {unit} (seen {known * scale:.3g})")
        return tuple(exceeded)


def room_of(form: Form, t: Array, X: Array) -> ManoeuvringRoom:
    """Return the extremes of simulated states *X* (s, n) at stamps *t* (s,)."""
    states = states_of(form)

    def span(name: str) -> float:
        return float(np.ptp(X[:, states.index(name)])) if name in states else 0.0

    velocities = [DOFS[d].velocity for d in form.dofs]
    tilts = [float(np.abs(X[:, states.index(n)]).max()) for n in ("phi", "theta") if n in states]
    return ManoeuvringRoom(
        largest={n: float(np.abs(X[:, states.index(n)]).max()) for n in velocities},
        turned=span("psi"),
        tilt=max(tilts, default=0.0),
        room=max(span("x"), span("y")),
        deep=span("z"),
        seconds=float(t[-1] - t[0]),
        kind=_kind(X[:, states.index("r")] if "r" in states else None, span("psi")),
    )


def room_of_runs(subject: FittedModel) -> tuple[ManoeuvringRoom, tuple[ManoeuvringRoom, ...]]:
    """Return the extremes of all runs of *subject* together, and those of each record.

    Both are simulated with the inputs of the runs.
    """
    each = tuple(room_of(subject.form, *subject.motion(i)) for i in range(len(subject.records)))
    return _together(each), each


def _together(each: Sequence[ManoeuvringRoom]) -> ManoeuvringRoom:
    kinds = {r.kind for r in each}
    return ManoeuvringRoom(
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


ROLES: Mapping[str, str] = {"N": "steer", "X": "thrust", "Z": "heave", "Y": "sway", "K": "roll", "M": "pitch"}
"""Force letter -> role of a channel.

Roles are assigned in this order, so that a rudder, which also pushes sideways, gets the role ``steer``.
"""


@dataclass(frozen=True, slots=True, eq=False)
class ChannelAllocation:
    """Conversion of normalised outputs per role to channel values.

    - ``columns[role]`` (m,): channel values of a role at full output.
    - ``low``, ``high`` (m,): limits of the channels.
    """

    channels: tuple[str, ...]
    columns: Mapping[str, Array]
    low: Array
    high: Array

    def inputs(self, shares: Mapping[str, float]) -> Array:
        """Return channel values (m,) for *shares*, the normalised outputs (-1 to 1) by role.

        They are limited to the range of the channels.
        """
        total = np.zeros(len(self.channels))
        for role, share in shares.items():
            if role in self.columns:  # thrust ahead moves nothing in a model of the yaw alone
                total += share * self.columns[role]
        held: Array = np.clip(total, self.low, self.high)
        return held


def allocation_of_shares(form: Form, most: Mapping[str, float]) -> ChannelAllocation:
    """Return the allocation of *form*, whose inputs are normalised forces.

    most : force -> largest normalised output.
    """
    channels = tuple(form.inputs)
    high = np.array([most.get(c, 1.0) for c in channels])
    columns = {ROLES[c]: np.eye(len(channels))[i] for i, c in enumerate(channels) if c in ROLES}
    return ChannelAllocation(channels, columns, -high, high)


def allocation_of(form: Form, theta: Array, records: Sequence[Segment]) -> ChannelAllocation:
    """Return the allocation of *form* with the parameters *theta*, limited to the range of inputs in *records*.

    A surge channel that was never negative stays positive; other channels use both signs.

    Raises
    ------
    NotInformative
        No input was used.
    """
    used = np.vstack([r.inputs for r in records])
    most = np.abs(used).max(axis=0)
    if not np.any(most > 0.0):
        raise NotInformative(
            "the inputs of these runs are zero throughout, so the size of the next input cannot be chosen"
        )
    gains = _gains(form, theta)
    ahead_only = (gains[FORCES.index("X")] != 0.0) & (used.min(axis=0) >= 0.0)
    chosen: list[str] = []
    rows: list[Array] = []
    for letter in ROLES:
        row = gains[FORCES.index(letter)] * (most > 0.0)
        if not row.any():
            continue
        row = row / np.linalg.norm(row)
        if np.linalg.matrix_rank(np.array([*rows, row]), tol=1e-6) > len(rows):
            chosen.append(ROLES[letter])
            rows.append(row)
    columns = {}
    for role, column in zip(chosen, np.linalg.pinv(np.array(rows)).T, strict=True):
        busy = np.abs(column) > 1e-12
        columns[role] = column * float(np.min(most[busy] / np.abs(column[busy])))
    return ChannelAllocation(tuple(form.inputs), columns, np.where(ahead_only, 0.0, -most), most)


def _gains(form: Form, theta: Array) -> Array:
    """Return the force per channel value (6, m); a derivative with more factors (``N_uudelta``) counts by its sign."""
    gains = np.zeros((6, len(form.inputs)))
    named = {g.lstrip("-") for pairs in form.inputs.values() for _, g in pairs if isinstance(g, str)}
    for j, (channel, pairs) in enumerate(form.inputs.items()):
        for force, gain in pairs:
            row = FORCES.index(force)
            if isinstance(gain, str):
                value = float(theta[form.parameters.index(gain.lstrip("-"))])
                gains[row, j] += -value if gain.startswith("-") else value
            else:
                gains[row, j] += gain
        for name, value in zip(form.parameters, theta.tolist(), strict=True):
            if name not in named and name[0] in FORCES and name[1:2] == "_" and name[2:].endswith(channel):
                gains[FORCES.index(name[0]), j] += value
    return gains


_SHOWN = frozenset(f.name for f in fields(Observation))

CONTROL_STEP = 0.1
"""Interval [s] between two commands of a proposed manoeuvre. Project choice."""


@dataclass(frozen=True, slots=True, eq=False)
class Flight:
    """A simulated flight.

    - ``t`` (j,), ``inputs`` (j, m): stamps [s] and held inputs, as commanded.
    - ``record``: the expected record without noise.
    - ``thinned``: for each signal, the number of samples in the runs that one sample of the record represents.
    """

    t: Array
    inputs: Array
    record: Segment
    initial: Array
    reach: ManoeuvringRoom
    thinned: Mapping[str, float]

    def as_fitted_model(self, subject: FittedModel) -> FittedModel:
        """Return *subject* with this flight as its only run.

        A sample that represents *n* samples has the noise of their mean.
        """
        noise = {n: std / math.sqrt(self.thinned.get(n, 1.0)) for n, std in subject.noise.items()}
        return replace(subject, records=(self.record,), initial=(self.initial,), noise=noise)


def fly(
    subject: FittedModel,
    allocation: ChannelAllocation,
    preset: Preset,
    seconds: float,
    *,
    to_its_end: bool = False,
    step: float = CONTROL_STEP,
) -> Flight | None:
    """Return the flight of *preset*, simulated with the model for *seconds*, or None if the motion diverges.

    The simulation starts at rest. If no input drives surge, it starts at the median speed of the runs. ``to_its_end``:
    whether the flight ends with the manoeuvre. The result is then None if the manoeuvre takes more than *seconds* or is
    aborted. Otherwise the inputs are zero after the manoeuvre. ``step`` [s]: interval between two commands. A longer
    interval is faster to calculate. The record is then thinned to this interval as well.
    """
    x_0 = _start(subject, allocation)
    t: Array = np.arange(round(seconds / step), dtype=np.float64) * step
    plant, manoeuvre = _FittedPlant(subject, allocation, t, x_0, closed=preset.closed), preset.make(seconds)
    if not fly_on(plant, manoeuvre, ticks=len(t), tick=step):
        return None
    inputs, used, outcome = plant.inputs, plant.used, manoeuvre.outcome
    if to_its_end:
        if outcome is None or outcome.ending == "aborted":
            return None
        t, inputs, seconds = t[:used], inputs[:used], used * step
    signals, thinned = {}, {}
    for name, period in _periods(subject).items():
        thinned[name] = max(step / period, 1.0) if step > CONTROL_STEP else 1.0
        own = np.arange(0.0, seconds, thinned[name] * period)
        signals[name] = Signal(name, own, np.zeros(len(own)), 0.0)
    record = replace(
        subject.records[0],
        name=preset.name,
        run=preset.name,
        t_in=t,
        inputs=inputs,
        signals=signals,
        slack=np.zeros(len(t)),
        dating=0.0,
    )
    simulator = Simulator(subject.form)
    stamps = record.stamps
    found = simulator.run(subject.theta, x_0, t, inputs, stamps)
    if found is None:
        return None
    X, S = found
    for name, signal in signals.items():
        value = simulator.outputs(subject.theta, X, S, name)[0][np.searchsorted(stamps, signal.t)]
        signals[name] = replace(signal, values=value)
    return Flight(t, inputs, replace(record, signals=signals), x_0, room_of(subject.form, stamps, X), thinned)


class _FittedPlant:
    """The identified model as a plant: it starts in the state *x_0* and receives commands at the stamps *t* (j,).

    closed : whether it moves between the commands; otherwise the state stays and only time passes. ``inputs`` (j, m)
    are zero after the last command, which is the ``used``-th.
    """

    def __init__(
        self, subject: FittedModel, allocation: ChannelAllocation, t: Array, x_0: Array, *, closed: bool
    ) -> None:
        self._theta, self._allocation, self._t, self._closed = subject.theta, allocation, t, closed
        self._simulator, self._x = Simulator(subject.form), x_0
        self.inputs = np.zeros((len(t), len(allocation.channels)))
        self.used = 0

    def observe(self) -> Observation:
        """Return the present motion."""
        return _observed(float(self._t[self.used]), self._simulator.states, self._x)

    def take(self, command: Command) -> None:
        """Apply the command of this tick."""
        self.inputs[self.used] = self._allocation.inputs(_shares(command))
        self.used += 1

    def advance(self, seconds: float) -> bool:
        """Advance to the next stamp."""
        if not self._closed:
            return True
        t, k = self._t, self.used
        found = self._simulator.run(self._theta, self._x, t[:k], self.inputs[:k], t[k - 1 : k + 1])
        if found is None:
            return False
        self._x = found[0][-1]
        return True


def _shares(command: Command) -> Mapping[str, float]:
    assert isinstance(command, Actuate)  # presets drive the actuators themselves
    return {role: getattr(command, force) for force, role in ROLES.items() if getattr(command, force)}


def _observed(t: float, states: Sequence[str], x: Array) -> Observation:
    known = {n: v for n, v in zip(states, x.tolist(), strict=True) if n in _SHOWN}
    speed = math.hypot(known.get("u", 0.0), known.get("v", 0.0))
    return Observation(**{"psi": 0.0, **known, "t": t, "speed": speed})


def _start(subject: FittedModel, allocation: ChannelAllocation) -> Array:
    states = Simulator(subject.form).states
    x_0 = np.zeros(len(states))
    if "u" in states and "thrust" not in allocation.columns:
        at = states.index("u")
        x_0[at] = float(np.median(np.concatenate([subject.motion(i)[1][:, at] for i in range(len(subject.records))])))
    return x_0


def _periods(subject: FittedModel) -> dict[str, float]:
    """Return the sampling period [s] of every signal, as in the runs."""
    steps: dict[str, list[float]] = {}
    for record in subject.records:
        for name, signal in record.signals.items():
            steps.setdefault(name, []).append(float(np.median(np.diff(signal.t))))
    return {name: float(np.median(own)) for name, own in steps.items()}
