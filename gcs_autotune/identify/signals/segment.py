"""A segment: one uninterrupted stretch of a run, the input of every identification method and of the diagnosis.

Nothing is resampled or smoothed: every sample keeps its own stamp.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects import Passage, passage_of
from gcs_autotune.errors import UsageError
from gcs_autotune.identify.doubt import Doubt
from gcs_autotune.sname import DOFS, Dof
from gcs_autotune.trial import Channel

__all__ = ["MIN_SAMPLES", "MOST_ALIKE", "Segment", "Signal", "within_horizon", "without_signal"]

Array = NDArray[np.float64]

MIN_SAMPLES = 20
"""Minimum number of output samples of a segment. Project choice: three per parameter to be distinguished."""

MOST_ALIKE = 0.999
"""Largest correlation of the errors of two neighbouring samples. Project choice.

A greater one would weigh their difference more than any model deserves.
"""


@dataclass(frozen=True, eq=False)
class Signal:
    """A measured output.

    - ``t`` (n,): stamps [s].
    - ``values`` (n,): samples; angles are continuous.
    - ``step``: resolution of the sensor, 0 if negligible.
    - ``std`` (n,): standard deviation of each sample if the run contains it (``std_u``), else empty.
    - ``memory`` (n,): correlation time [s] of the error of each sample if the run contains it (``memory_u``), else
      empty.
    - ``common`` (n, c): errors with causes that last for the whole run, each for a cause of one standard deviation, if
      the run contains them (``common1_u``). ``std`` and ``memory`` are then those of the remaining error.
    """

    name: str
    t: Array
    values: Array
    step: float
    std: Array = field(default_factory=lambda: np.zeros(0))
    memory: Array = field(default_factory=lambda: np.zeros(0))
    common: Array = field(default_factory=lambda: np.zeros((0, 0)))

    @cached_property
    def alike(self) -> Array:
        """Correlation (n,) of the error of each sample with that of the sample before; empty if all are independent."""
        if not np.any(self.memory > 0.0):
            return np.zeros(0)
        correlation = np.zeros(len(self.t))
        correlation[1:] = np.minimum(np.exp(-np.diff(self.t) / np.maximum(self.memory[1:], 1e-9)), MOST_ALIKE)
        return correlation

    def since(self, start: float) -> Signal:
        """Return the signal from the time *start* [s] on."""
        keep = self.t >= start
        return self._kept(keep)

    def between(self, first: float, last: float) -> Signal:
        """Return the signal between the times *first* and *last* [s], both included."""
        keep = (self.t >= first) & (self.t <= last)
        return self._kept(keep)

    def first(self, count: int) -> Signal:
        """Return the first *count* samples."""
        return self._kept(np.arange(len(self.t)) < count)

    def _kept(self, keep: NDArray[np.bool_]) -> Signal:
        std, memory, common = (own[keep] if len(own) else own for own in (self.std, self.memory, self.common))
        return replace(self, t=self.t[keep], values=self.values[keep], std=std, memory=memory, common=common)


@dataclass(frozen=True, eq=False)
class Segment:
    """One uninterrupted stretch of a run.

    - ``run``: name of the run.
    - ``name``: name of the run, with ``#`` and a number if the run was cut.
    - ``t_in`` (j,) [s]: times at which an input changes.
    - ``inputs`` (j, m): values of the inputs ``input_names`` from each of these times, held until the next change.
    - ``signals``: measured outputs by name. For one degree of freedom the position comes first.

    - ``dating`` [s]: possible common error of all input stamps (decision 3), 0 if they are exact.
    - ``loop`` [s]: loop time of the autopilot.
    - ``slack`` (j,) [s]: shift of each input change if it happened in another loop, 0 if only one loop is possible.
    - ``lags``: name of the signal -> delay [s] of an onboard filter, for which the stamps are corrected.
    - ``measured``: name -> unprocessed channel of the run.
    """

    name: str
    run: str
    t_in: Array
    inputs: Array
    input_names: tuple[str, ...]
    input_units: tuple[str, ...]
    signals: Mapping[str, Signal]
    notes: tuple[Doubt, ...] = ()
    dating: float = 0.0
    slack: Array = field(default_factory=lambda: np.zeros(0))
    loop: float = 0.0
    lags: Mapping[str, float] = field(default_factory=dict)
    measured: Mapping[str, Channel] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if len(self.slack) != len(self.t_in):
            object.__setattr__(self, "slack", np.zeros(len(self.t_in)))

    @property
    def start(self) -> float:
        """First stamp of any signal [s], at which simulations begin."""
        return float(self.stamps[0])

    @cached_property
    def stamps(self) -> Array:
        """Stamps (s,) of all signals [s], sorted, without repeats."""
        return np.unique(np.concatenate([s.t for s in self.signals.values()]))

    @cached_property
    def at(self) -> Mapping[str, NDArray[np.int64]]:
        """Signal -> indices (n,) of its stamps in :attr:`stamps`."""
        return {n: np.searchsorted(self.stamps, s.t).astype(np.int64) for n, s in self.signals.items()}

    @cached_property
    def passage(self) -> Passage:
        """This segment in the format for simulations with effects."""
        commands = {n: np.ascontiguousarray(self.inputs[:, i]) for i, n in enumerate(self.input_names)}
        return passage_of(self.run, self.t_in, commands, {n: s.t for n, s in self.signals.items()}, self.measured)

    def passage_at(self, shift: float) -> Passage:
        """Return :attr:`passage` with its inputs delayed by *shift* [s], or unchanged if the stamps are exact."""
        return replace(self.passage, t_in=self.passage.t_in + shift) if shift and self.dating else self.passage

    @property
    def tau(self) -> Array:
        """Input (j,) of a segment with only one input."""
        only: Array = self.inputs[:, 0]
        return only

    @property
    def dof(self) -> Dof:
        """Degree of freedom of the first signal."""
        first = next(iter(self.signals))
        return next(d for d in DOFS.values() if first in (d.position, d.velocity))

    @property
    def position(self) -> Signal | None:
        """Position of :attr:`dof`, None if it was not measured."""
        return self.signals.get(self.dof.position)

    @property
    def velocity(self) -> Signal | None:
        """Velocity of :attr:`dof`, None if it was not measured."""
        return self.signals.get(self.dof.velocity)

    @property
    def main(self) -> Signal:
        """First signal. For one degree of freedom it is the position if measured, else the velocity."""
        return next(iter(self.signals.values()))

    def driven(self, t_in: Array, commands: Mapping[str, Array]) -> Segment:
        """Return the segment with the inputs *commands*, each (j,), held from the times *t_in* (j,) [s].

        The unit of a new input is 1.
        """
        units = dict(zip(self.input_names, self.input_units, strict=True))
        return replace(
            self,
            t_in=t_in,
            inputs=np.column_stack(list(commands.values())),
            input_names=tuple(commands),
            input_units=tuple(units.get(n, "1") for n in commands),
            slack=np.zeros(len(t_in)),
        )

    def only(self, names: Sequence[str]) -> Segment:
        """Return the segment with only the signals in *names*."""
        return replace(self, signals={n: s for n, s in self.signals.items() if n in names})

    def after(self, delay: float) -> Segment:
        """Return the segment without the samples that depend on inputs before the first input stamp.

        delay : delay of the inputs [s].

        Commands before the record are unknown. With a delay, the start of the record therefore cannot be simulated. The
        segment is returned unchanged if too few samples would remain.
        """
        return self if delay <= 0.0 else self.since(float(self.t_in[0]) + delay)

    def since(self, start: float) -> Segment:
        """Return the segment with the samples from the time *start* [s] on. The inputs are not cut.

        The segment is returned unchanged if too few samples would remain.
        """
        kept = {n: s.since(start) for n, s in self.signals.items()}
        if start <= self.start or any(len(s.t) < MIN_SAMPLES for s in kept.values()):
            return self
        return replace(self, signals=kept)

    def until(self, share: float) -> Segment:
        """Return the beginning of the segment, which is the fraction *share* of its duration.

        Every signal keeps at least its first :data:`MIN_SAMPLES` samples.
        """
        if share >= 1.0:
            return self
        end = self.start + share * (float(self.stamps[-1]) - self.start)
        count = {n: max(int(np.searchsorted(s.t, end)), MIN_SAMPLES) for n, s in self.signals.items()}
        signals = {n: s.first(count[n]) for n, s in self.signals.items()}
        return replace(self, signals=signals)

    def pieces(self, count: int) -> list[Segment]:
        """Return *count* segments with about the same number of stamps each. The inputs are not cut."""
        segments = []
        for part in np.array_split(self.stamps, count):
            cut = {n: s.between(float(part[0]), float(part[-1])) for n, s in self.signals.items()}
            if signals := {n: s for n, s in cut.items() if len(s.t)}:
                segments.append(replace(self, signals=signals))
        return segments

    def within(self, horizon: float) -> tuple[Segment, ...]:
        """Return the segment cut into segments no longer than *horizon* [s], or longer if these would have too few
        samples. The inputs are not cut.
        """
        if not math.isfinite(horizon):
            return (self,)
        wanted = math.ceil((float(self.stamps[-1]) - self.start) / horizon)
        fewest = min(len(s.t) for s in self.signals.values())
        return tuple(self.pieces(max(1, min(wanted, fewest // MIN_SAMPLES))))


def within_horizon(segments: Sequence[Segment], horizon: float) -> list[Segment]:
    """Return the segments, cut into pieces no longer than *horizon* [s].

    Each piece has its own initial states.

    Raises
    ------
    UsageError
        The horizon is not above zero.
    """
    if not horizon > 0.0:
        raise UsageError(f"a horizon of {horizon} s is not valid. Use more than 0 s, or inf for whole runs")
    return [piece for s in segments for piece in s.within(horizon)]


def without_signal(segments: Sequence[Segment], name: str) -> list[Segment]:
    """Return the segments without the signal *name*. Segments without any other signal are left out."""
    return [s.only([n for n in s.signals if n != name]) for s in segments if any(n != name for n in s.signals)]
