"""Recorded signals made fit for identification: chosen, cleaned, unwrapped, cut at gaps.

Nothing is resampled or smoothed: every sample keeps its own stamp, and what was removed is counted and
reported as a doubt.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import MissingChannel, NotInformative, UsageError
from gcs_autotune.identify.axis.ahead import DISTANCE, ahead_doubt, with_ahead
from gcs_autotune.identify.axis.track import along_track
from gcs_autotune.identify.cleaning import clean, quantum, unwrap
from gcs_autotune.identify.input_holes import holes_of, outside
from gcs_autotune.identify.notes import told
from gcs_autotune.identify.rails import within_range
from gcs_autotune.identify.result import Doubt
from gcs_autotune.registry import lookup
from gcs_autotune.sname import DOFS, Dof
from gcs_autotune.trial import Channel, Trial

__all__ = ["INPUTS", "MIN_SAMPLES", "Record", "Signal", "after_delay", "dating_of", "edges", "guess_dof", "prepare"]

Array = NDArray[np.float64]

INPUTS: dict[str, tuple[str, ...]] = {
    "yaw": ("N", "delta"),
    "heave": ("Z",),
    "surge": ("X",),
    "sway": ("Y",),
    "roll": ("K",),
    "pitch": ("M",),
}
"""Degree of freedom -> channels that may drive it, preferred first."""

MIN_SAMPLES = 20
"""Fewest output samples of a stretch worth fitting. Chosen: three per parameter to be told apart."""

WITHIN_LOOP = 0.25
"""Chosen: share of an autopilot's loop by which outputs and attitudes of one loop may differ in time."""

GAP_SECONDS, GAP_STEPS = 1.0, 10.0
"""A hole longer than both (seconds, median steps) starts a new stretch with free initial state."""


@dataclass(frozen=True, slots=True, eq=False)
class Signal:
    """A measured output: stamps [s], values (angles continuous), smallest step of its scale (0 if none)."""

    name: str
    t: Array
    values: Array
    step: float

    def since(self, start: float) -> Signal:
        """Return the samples from *start* [s] on."""
        keep = self.t >= start
        return replace(self, t=self.t[keep], values=self.values[keep])


@dataclass(frozen=True, slots=True, eq=False)
class Record:
    """One uninterrupted stretch of a run. ``t_in``, ``tau``: the input at its jumps, zero-order hold.

    ``dating`` [s]: how far all jumps together may lie from their stamps, 0 when the stamps are exact. ``slack`` (m,)
    [s]: how far each may lie from its own for having happened at another ``loop`` [s] of the autopilot; 0 where there
    is no other, and throughout where the loop is not known.
    """

    run: str
    dof: Dof
    input_name: str
    input_unit: str
    t_in: Array
    tau: Array
    position: Signal | None
    velocity: Signal | None
    doubts: tuple[Doubt, ...] = ()
    dating: float = 0.0
    slack: Array = field(default_factory=lambda: np.zeros(0))
    loop: float = 0.0

    def __post_init__(self) -> None:
        if len(self.slack) != len(self.t_in):
            object.__setattr__(self, "slack", np.zeros(len(self.t_in)))

    @property
    def signals(self) -> tuple[Signal, ...]:
        """What was measured, position first."""
        return tuple(s for s in (self.position, self.velocity) if s is not None)

    @property
    def main(self) -> Signal:
        """Position when there is one, else velocity."""
        return self.signals[0]


def guess_dof(trial: Trial) -> Dof:
    """Return the degree of freedom a run is about, from its meta data or from what moves in it.

    Raises
    ------
    MissingChannel
        No pair of input and output.
    UsageError
        More than one pair whose input varies.
    """
    told = trial.meta.get("dof")
    if isinstance(told, str) and told in DOFS:
        return DOFS[told]
    pairs = [d for d in DOFS.values() if _input_names(trial, d) and _output_names(trial, d)]
    moving = [d for d in pairs if any(_varies(trial[n]) for n in _input_names(trial, d))]
    if len(moving) == 1:
        return moving[0]
    have = ", ".join(trial.channels) or "nothing"
    if not pairs:
        raise MissingChannel(
            f"run '{trial.name}' has no input with its output; it has {have}. Needed is a pair like "
            "N (or delta) with psi or r, Z with z or w, X with u or x, Y with v or y"
        )
    if not moving:
        if len(pairs) == 1:
            return pairs[0]
        raise NotInformative(f"no input of run '{trial.name}' ever changes: nothing can be learnt from it")
    names = ", ".join(d.name for d in moving)
    raise UsageError(f"run '{trial.name}' moves in several degrees of freedom ({names}): say which with --dof")


def _input_names(trial: Trial, dof: Dof) -> list[str]:
    return [n for n in INPUTS[dof.name] if n in trial and len(trial[n])]


def _output_names(trial: Trial, dof: Dof) -> list[str]:
    other = (DISTANCE,) if dof.name == "surge" else ()
    return [n for n in (dof.position, dof.velocity, *other) if n in trial and len(trial[n])]


def _varies(channel: Channel) -> bool:
    return bool(np.nanmin(channel.values) < np.nanmax(channel.values)) if len(channel) else False


def prepare(trial: Trial, dof: Dof | str) -> tuple[Record, ...]:
    """Return the usable stretches of *trial* for *dof*.

    Raises
    ------
    MissingChannel
        No input or no output for this degree of freedom.
    BadFile
        Stamps that run backwards.
    NotInformative
        Too few samples, a constant input, or an output that never moves.
    """
    axis = lookup(DOFS, dof, "degree of freedom") if isinstance(dof, str) else dof
    measured = trial
    trial = with_ahead(trial) if axis.name == "surge" else trial
    names, outputs = _input_names(trial, axis), _output_names(trial, axis)
    if not names or not outputs:
        want = f"{' or '.join(INPUTS[axis.name])} with {axis.position} or {axis.velocity}"
        raise MissingChannel(
            f"run '{trial.name}' lacks what {axis.name} needs ({want}); it has {', '.join(trial.channels)}"
        )
    source = next((n for n in names if _varies(trial[n])), names[0])
    doubt = ahead_doubt(trial) if trial is not measured else None
    notes = [*told(trial), *([] if doubt is None else [doubt])]
    drive = clean(trial[source], trial.name, notes)
    rate = clean(trial[axis.velocity], trial.name, notes) if axis.velocity in outputs else None
    position = clean(trial[axis.position], trial.name, notes) if axis.position in outputs else None
    if position is not None and rate is None and trial is measured:
        position = along_track(trial, axis, position, notes)
    hidden = holes_of(drive, trial.name, notes)
    rate = None if rate is None else outside(rate, hidden)
    position = None if position is None else outside(position, hidden)
    _check_excitation(trial, drive, [c for c in (position, rate) if c is not None])
    if position is not None and axis.angular:
        position = replace(position, values=unwrap(position.t, position.values, rate))
    return _stretches(trial, axis, drive, position, rate, notes)


def _check_excitation(trial: Trial, drive: Channel, outputs: Sequence[Channel]) -> None:
    most = max((len(c) for c in outputs), default=0)
    if most < MIN_SAMPLES:
        raise NotInformative(
            f"run '{trial.name}' is too short: {most} output samples, at least {MIN_SAMPLES} are needed"
        )
    overlap = drive.t[(drive.t <= outputs[0].t[-1])] if len(drive) else drive.t
    if len(overlap) == 0 or not _varies(drive.between(-np.inf, float(outputs[0].t[-1]))):
        raise NotInformative(
            f"the input {drive.name} of run '{trial.name}' never changes while the output is recorded: "
            "inertia, damping and constant force cannot be told apart; fly a relay or a sequence of steps"
        )
    if not any(_varies(c) for c in outputs):
        names = " and ".join(c.name for c in outputs)
        raise NotInformative(
            f"nothing moves in run '{trial.name}': {names} never changes; do sensor and actuator work?"
        )


def _stretches(
    trial: Trial, axis: Dof, drive: Channel, position: Channel | None, rate: Channel | None, notes: list[Doubt]
) -> tuple[Record, ...]:
    changes = np.concatenate([[True], np.diff(drive.values) != 0.0])
    dating, slack, loop = dating_of(trial, drive), _slack_of(trial, drive), float(trial.meta.get("loop_period", 0.0))
    main = position if position is not None and len(position) >= MIN_SAMPLES else rate
    assert main is not None
    borders = edges(main.t)
    if len(borders) > 2:
        notes.append(
            Doubt(
                "gaps",
                f"run '{trial.name}' has {len(borders) - 2} hole(s) in its telemetry",
                "fly within good radio range; the stretches were fitted with initial states of their own",
            )
        )
    measured = [None if c is None else within_range(c, trial.name, notes) for c in (position, rate)]
    parts: list[Record] = []
    for start, end in itertools.pairwise(borders):
        signals = [_signal(c, float(start), float(end)) for c in measured]
        if max((len(s.t) for s in signals if s is not None), default=0) < MIN_SAMPLES:
            continue
        name = trial.name if len(borders) == 2 else f"{trial.name}#{len(parts) + 1}"
        parts.append(
            Record(
                name,
                axis,
                drive.name,
                drive.unit,
                drive.t[changes],
                drive.values[changes],
                signals[0],
                signals[1],
                tuple(notes) if not parts else (),
                dating,
                slack[changes],
                loop,
            )
        )
    if not parts:
        raise NotInformative(f"run '{trial.name}' has no uninterrupted stretch of {MIN_SAMPLES} samples")
    return tuple(parts)


def dating_of(trial: Trial, drive: Channel) -> float:
    """Return how far [s] a jump of *drive* may lie from its stamp: 0 when stamps are exact, else (midway between two
    messages) half their distance.

    The last moment without it is as far before the stamp as the first message with it comes after; that moment is the
    message before, or, where the autopilot's ``loop_period`` is known, one loop later. An autopilot changes
    its outputs at its own loop only and a relay switches in step with the telemetry, so the error is the same at
    every jump: it does not average out.
    """
    if trial.meta.get("outputs_dated") != "midway":
        return 0.0
    jumps = np.flatnonzero(np.diff(drive.values) != 0.0) + 1
    if len(jumps) == 0:
        return 0.0
    loop = float(trial.meta.get("loop_period", 0.0))
    return max(float(np.median(drive.t[jumps] - drive.t[jumps - 1])) - loop, WITHIN_LOOP * loop)


def _slack_of(trial: Trial, drive: Channel) -> Array:
    """Return how far [s] each value of *drive* may lie from its stamp for the autopilot's loop being another."""
    slack = np.zeros(len(drive))
    loop = float(trial.meta.get("loop_period", 0.0))
    if trial.meta.get("outputs_dated") != "midway" or loop <= 0.0:
        return slack
    whole = np.round((np.diff(drive.t) - loop) / (0.5 * loop)) * 0.5 * loop
    slack[1:] = np.where(whole < GAP_SECONDS, np.maximum(whole, 0.0), 0.0)
    return slack


def edges(t: Array) -> Array:
    """Return the boundaries of uninterrupted stretches, outermost at the ends of *t*."""
    dt = np.diff(t)
    holes = np.flatnonzero(dt > max(GAP_SECONDS, GAP_STEPS * float(np.median(dt))))
    return np.concatenate([t[:1], t[holes + 1], [np.inf]])


def _signal(channel: Channel | None, start: float, end: float) -> Signal | None:
    if channel is None:
        return None
    keep = (channel.t >= start) & (channel.t < end)
    if int(keep.sum()) < MIN_SAMPLES:
        return None
    values = channel.values[keep]
    return Signal(channel.name, channel.t[keep], values, quantum(values))


def after_delay(record: Record, delay: float) -> Record:
    """Return *record* without the outputs that answer to inputs from before the first input stamp.

    What was commanded before the record began is unknown, so with a delay the first of it cannot be simulated.
    The record is returned as it is when too little would be left.
    """
    start = float(record.t_in[0]) + delay
    if delay <= 0.0 or start <= min(float(s.t[0]) for s in record.signals):
        return record
    later = [None if s is None else s.since(start) for s in (record.position, record.velocity)]
    if any(s is not None and len(s.t) < MIN_SAMPLES for s in later):
        return record
    return replace(record, position=later[0], velocity=later[1])
