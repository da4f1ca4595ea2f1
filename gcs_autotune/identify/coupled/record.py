"""Runs made fit for a coupled model: the inputs it needs, the signals it predicts, cleaned and cut at gaps."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import MissingChannel, NotInformative
from gcs_autotune.identify.axis.record import MIN_SAMPLES, Signal, edges
from gcs_autotune.identify.cleaning import clean, quantum, unwrap
from gcs_autotune.identify.input_holes import holes_of, outside
from gcs_autotune.identify.notes import told
from gcs_autotune.identify.rails import within_range
from gcs_autotune.identify.result import Doubt
from gcs_autotune.models.coupled import Form
from gcs_autotune.sname import DOFS
from gcs_autotune.trial import Channel, Trial

__all__ = ["CoupledRecord", "later", "pieces_of", "prepare_coupled", "signals_of", "within_horizon"]

Array = NDArray[np.float64]

TRANSITION = 4.0
"""Standard deviation of a velocity over its noise that makes a transition."""

SETTLED = 2.0
"""Standard deviation of its second half over the noise up to which it has settled."""

_VELOCITIES = frozenset(d.velocity for d in DOFS.values())


@dataclass(frozen=True, slots=True, eq=False)
class CoupledRecord:
    """One uninterrupted stretch of a run.

    ``t_in`` (j,), ``inputs`` (j, m): the form's inputs in its order, each row held from its stamp on (zero-order hold,
    joined over the stamps of all inputs). ``signals``: measured outputs by name, every sample with its own stamp.
    """

    run: str
    t_in: Array
    inputs: Array
    input_units: tuple[str, ...]
    signals: Mapping[str, Signal]
    notes: tuple[Doubt, ...] = ()

    @property
    def start(self) -> float:
        """First stamp of any signal [s]; simulations begin here."""
        return min(float(s.t[0]) for s in self.signals.values())

    @property
    def stamps(self) -> Array:
        """All stamps of all signals, sorted, each once."""
        return np.unique(np.concatenate([s.t for s in self.signals.values()]))

    def until(self, share: float) -> CoupledRecord:
        """Return the first *share* of the record's time, but of every signal no less than its first samples."""
        if share >= 1.0:
            return self
        end = self.start + share * (max(float(s.t[-1]) for s in self.signals.values()) - self.start)
        count = {n: max(int(np.searchsorted(s.t, end)), MIN_SAMPLES) for n, s in self.signals.items()}
        signals = {n: replace(s, t=s.t[: count[n]], values=s.values[: count[n]]) for n, s in self.signals.items()}
        return replace(self, signals=signals)


def signals_of(form: Form) -> tuple[str, ...]:
    """Return the names of the signals a form predicts: velocities, then positions."""
    dofs = [DOFS[d] for d in form.dofs]
    return (*(d.velocity for d in dofs), *(d.position for d in dofs))


def prepare_coupled(
    trial: Trial, form: Form, use: Sequence[str] | None = None, *, continuous: bool = False
) -> tuple[CoupledRecord, ...]:
    """Return the usable stretches of *trial* for *form*.

    Parameters
    ----------
    use : names of the signals to take; when None all velocities and angles measured, and of the positions those whose
        velocity is not.
    continuous : angles are continuous already.

    Raises
    ------
    MissingChannel
        An input of the form, or every signal, is missing.
    BadFile
        Stamps that run backwards.
    NotInformative
        Too few samples, inputs that never change, nothing that moves.
    """
    absent = [c for c in form.inputs if c not in trial or not len(trial[c])]
    if absent:
        have = ", ".join(trial.channels) or "nothing"
        raise MissingChannel(f"run '{trial.name}' lacks the input {', '.join(absent)} of '{form.name}'; it has {have}")
    names = _names(trial, form, use)
    notes = told(trial)
    drives = [clean(trial[c], trial.name, notes) for c in form.inputs]
    channels = {n: clean(trial[n], trial.name, notes) for n in names}
    for name, channel in channels.items():
        dof = next(d for d in DOFS.values() if name in (d.position, d.velocity))
        if name == dof.position and dof.angular and not continuous:
            channels[name] = replace(channel, values=unwrap(channel.t, channel.values, channels.get(dof.velocity)))
    for drive in drives:
        hidden = holes_of(drive, trial.name, notes)
        channels = {n: outside(c, hidden) for n, c in channels.items()}
    _check(trial, form, drives, channels)
    t_in, table = _joined(drives)
    return _cut(trial, t_in, table, tuple(d.unit for d in drives), channels, notes)


def _names(trial: Trial, form: Form, use: Sequence[str] | None) -> list[str]:
    there = [n for n in signals_of(form) if n in trial and len(trial[n]) >= MIN_SAMPLES]
    if use is not None:
        missing = [n for n in use if n not in there]
        if missing:
            have = ", ".join(there) or "nothing"
            raise MissingChannel(f"run '{trial.name}' has no {', '.join(missing)} for '{form.name}'; it has {have}")
        return list(use)
    dofs = [DOFS[d] for d in form.dofs]
    taken = [d.velocity for d in dofs if d.velocity in there]
    taken += [d.position for d in dofs if d.position in there and (d.angular or d.velocity not in there)]
    if not taken:
        raise MissingChannel(
            f"run '{trial.name}' has none of the signals of '{form.name}' ({', '.join(signals_of(form))}) in at least "
            f"{MIN_SAMPLES} samples; it has {', '.join(trial.channels)}"
        )
    return taken


def _check(trial: Trial, form: Form, drives: Sequence[Channel], channels: Mapping[str, Channel]) -> None:
    end = max(float(c.t[-1]) for c in channels.values())
    moving = [d for d in drives if len(d) and np.ptp(d.between(-np.inf, end).values) > 0.0]
    if form.inputs and not moving and not any(_gathers_way(c) for n, c in channels.items() if n in _VELOCITIES):
        raise NotInformative(
            f"no input of run '{trial.name}' ({', '.join(form.inputs)}) ever changes: inertia and drag cannot be told "
            "apart; fly steps, a zig-zag or a relay"
        )
    if all(np.ptp(c.values) == 0.0 for c in channels.values()):
        raise NotInformative(f"nothing moves in run '{trial.name}': {', '.join(channels)} never change")


def _gathers_way(velocity: Channel) -> bool:
    """Whether a velocity goes from one steady value to another: that tells of the craft under constant inputs too.

    A velocity that never settles under "constant" inputs is answering to something else: a stuck log, wind, waves.
    """
    values = velocity.values
    noise = float(np.std(np.diff(values))) / math.sqrt(2.0)
    late = float(np.std(values[len(values) // 2 :]))
    return float(np.std(values)) > TRANSITION * noise and late < max(SETTLED * noise, 1e-12)


def _joined(drives: Sequence[Channel]) -> tuple[Array, Array]:
    if not drives:
        return np.zeros(1), np.zeros((1, 0))
    t = np.unique(np.concatenate([d.t for d in drives]))
    columns = [d.values[np.maximum(np.searchsorted(d.t, t, side="right") - 1, 0)] for d in drives]
    table = np.column_stack(columns)
    changes = np.concatenate([[True], np.any(np.diff(table, axis=0) != 0.0, axis=1)])
    return t[changes], np.ascontiguousarray(table[changes])


def _cut(
    trial: Trial,
    t_in: Array,
    table: Array,
    units: tuple[str, ...],
    channels: Mapping[str, Channel],
    notes: list[Doubt],
) -> tuple[CoupledRecord, ...]:
    everything = np.unique(np.concatenate([c.t for c in channels.values()]))
    borders = edges(everything)
    if len(borders) > 2:
        notes.append(
            Doubt(
                "gaps",
                f"run '{trial.name}' has {len(borders) - 2} hole(s) in its telemetry",
                "fly within good radio range; the stretches were fitted with initial states of their own",
            )
        )
    channels = {n: within_range(c, trial.name, notes) for n, c in channels.items()}
    parts: list[CoupledRecord] = []
    for start, end in itertools.pairwise(borders):
        signals = {}
        for name, channel in channels.items():
            keep = (channel.t >= start) & (channel.t < end)
            if int(keep.sum()) >= MIN_SAMPLES:
                signals[name] = Signal(name, channel.t[keep], channel.values[keep], quantum(channel.values[keep]))
        if signals:
            name = trial.name if len(borders) == 2 else f"{trial.name}#{len(parts) + 1}"
            parts.append(CoupledRecord(name, t_in, table, units, signals, tuple(notes) if not parts else ()))
    if not parts:
        raise NotInformative(f"run '{trial.name}' has no uninterrupted stretch of {MIN_SAMPLES} samples")
    return tuple(parts)


def later(record: CoupledRecord, delay: float) -> CoupledRecord:
    """Return *record* without the samples that answer to inputs from before the first input stamp.

    What was commanded before the record began is unknown. As it is when too little would be left.
    """
    start = float(record.t_in[0]) + delay
    if delay <= 0.0 or start <= record.start:
        return record
    kept = {n: s.since(start) for n, s in record.signals.items()}
    if any(len(s.t) < MIN_SAMPLES for s in kept.values()):
        return record
    return replace(record, signals=kept)


def pieces_of(record: CoupledRecord, count: int) -> Iterator[CoupledRecord]:
    """Cut *record* into *count* pieces of about as many stamps each."""
    for part in np.array_split(record.stamps, count):
        signals = {}
        for name, signal in record.signals.items():
            keep = (signal.t >= part[0]) & (signal.t <= part[-1])
            if keep.any():
                signals[name] = replace(signal, t=signal.t[keep], values=signal.values[keep])
        if signals:
            yield replace(record, signals=signals)


def within_horizon(record: CoupledRecord, horizon: float) -> tuple[CoupledRecord, ...]:
    """Cut *record* into pieces no longer than *horizon* [s], none shorter than can be fitted."""
    stamps = record.stamps
    wanted = math.ceil((float(stamps[-1]) - record.start) / horizon)
    fewest = min(len(s.t) for s in record.signals.values())
    return tuple(pieces_of(record, max(1, min(wanted, fewest // MIN_SAMPLES))))
