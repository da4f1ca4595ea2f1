"""Filter one degree of freedom with process noise, and return its innovations for any values of the unknowns.

An Ornstein-Uhlenbeck force drives the equation of motion in addition to the commands. Its standard deviation and time
constant are unknowns, as are the parameters of the model and the noise of the sensor. The filter carries the force as a
parameter that decays (:class:`.filter_bank.Levels`). Initial states and the force are thus integrated out, and the
innovations have a likelihood (Ljung1999, chapter 7).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.clock import spend
from gcs_autotune.effects import EFFECTS, DataSummary, Drive, EffectInstance
from gcs_autotune.identify.kalman.filter_bank import FilterBank, FilterRecord, FilterResult, Levels, Prior
from gcs_autotune.identify.kalman.linear_pass import LinearTerms, linear_pass, linear_terms
from gcs_autotune.identify.kalman.process_noise import ProcessNoise
from gcs_autotune.identify.kalman.run_to_run import integrate_out
from gcs_autotune.identify.kalman.thinning import smoothed_drive
from gcs_autotune.identify.problems.free_numbers import ModelProblem
from gcs_autotune.identify.problems.limits import Limits
from gcs_autotune.identify.signals.segment import Segment
from gcs_autotune.models import Form, states_of
from gcs_autotune.sname import DOFS

__all__ = ["DRIFTING_FORCE", "NoiseFilter"]

Array = NDArray[np.float64]

DRIFTING_FORCE, FORCE_OF_THE_RUN = "gust", "day"
"""Names of two inputs that are always 1. Their gains are the drifting force and the constant force of a run."""

LINEAR_STATES = 3
"""Number of states of the filter: position, velocity and force. They determine the computing effort of one sample."""

MOST_KEPT = 60
"""Maximum number of series of modified commands that are cached. Project choice."""

Made = TypeVar("Made")


class NoiseFilter(ModelProblem):
    """Filter for a form of one degree of freedom and segments with its position.

    Parameters are those of :class:`.ModelProblem`. The form is scaled to unit inertia.
    """

    def __init__(self, form: Form, segments: Sequence[Segment], data_summary: DataSummary, limits: Limits) -> None:
        super().__init__(form, segments, data_summary, limits)
        self.dof = DOFS[form.dofs[0]]
        self.interval = float(np.median(np.concatenate([np.diff(s.stamps) for s in self.segments])))
        self._banks: dict[tuple[object, ...], FilterBank] = {}
        self._drives: dict[tuple[object, ...], tuple[Drive, ...]] = {}
        self._terms: dict[tuple[tuple[str, str], ...], LinearTerms | None] = {}
        self._priors = self._first()

    @property
    def runs(self) -> int:
        """Number of runs that the segments come from."""
        return len({s.run for s in self.segments})

    def _first(self) -> tuple[Array, Array]:
        """Return the first position and velocity (records, 2), and wide standard deviations of them."""
        states, spread = [], []
        for s in self.segments:
            own = next(iter(s.signals.values()))
            rate = float(np.sqrt(np.mean(np.diff(own.values) ** 2 / np.diff(own.t) ** 2)))
            few = min(5, len(own.t))
            slope = float(np.polyfit(own.t[:few], own.values[:few], 1)[0])
            states.append([own.values[0], slope])
            spread.append([max(10.0 * rate * self.interval, 1e-6), max(rate, 1e-9)])
        order = [0, 1] if states_of(self.form)[0] == self.dof.position else [1, 0]
        return np.array(states)[:, order], np.array(spread)[:, order]

    def _kept(
        self,
        effects: Sequence[EffectInstance],
        noise: ProcessNoise,
        kept: dict[tuple[object, ...], Made],
        make: Callable[[Sequence[EffectInstance], ProcessNoise], Made],
    ) -> Made:
        """Return the result of *make* from the cache, or call it and store the result.

        The key contains all that changes the commands: effects, smoothing, and whether runs differ.
        """
        early = [e for e in effects if EFFECTS[e.slug].acts_on & {"commands"}]
        key: tuple[object, ...] = tuple((e.slug, e.place, *sorted(e.values.items())) for e in early)
        key = (
            *key,
            *((e.slug, e.place) for e in effects),
            noise.smoothing,
            noise.day_force > 0.0,
            noise.day_thrust > 0.0,
        )
        if key not in kept:
            if len(kept) > MOST_KEPT:
                kept.clear()
            kept[key] = make(effects, noise)
        return kept[key]

    def bank(self, effects: Sequence[EffectInstance], noise: ProcessNoise) -> FilterBank:
        """Return a filter bank of the records with the commands modified by *effects*.

        The state of the filter contains the drifting force. If runs differ, it also contains the constant force and the
        gain of each run.
        """
        return self._kept(effects, noise, self._banks, self._new_bank)

    def _formed(self, effects: Sequence[EffectInstance]) -> tuple[Form, list[str]]:
        """Return the form with the inputs that *effects* add, and the names of the derivatives that they add."""
        more = [n for e in effects for n in EFFECTS[e.slug].inputs(e)]
        added = [n for e in effects for n in EFFECTS[e.slug].derivatives(e)]
        inputs = {**self.form.inputs, **{n: () for n in more if n not in self.form.inputs}}
        return replace(self.form, inputs=inputs), list(dict.fromkeys(added))

    def _new_bank(self, effects: Sequence[EffectInstance], noise: ProcessNoise) -> FilterBank:
        form, added = self._formed(effects)
        ones = (DRIFTING_FORCE, FORCE_OF_THE_RUN) if noise.differs else (DRIFTING_FORCE,)
        names = [f"{self.dof.force}_{n}" for n in ones]
        form = replace(form, inputs={**form.inputs, **dict.fromkeys(ones, ())})
        form = form.freeing(*(n for n in (*added, *names) if n not in self.form.parameters))
        records = []
        for segment, drive in zip(self.segments, self._driven(effects, noise), strict=True):
            table = {n: np.ones(len(drive.t)) if n in ones else drive.channels[n] for n in form.inputs}
            records.append(segment.driven(drive.t, table))
        gain = (self.form.free[0],) if noise.day_thrust > 0.0 else ()
        return FilterBank(form, records, (*names, *gain), per_run=True)

    def _driven(self, effects: Sequence[EffectInstance], noise: ProcessNoise) -> tuple[Drive, ...]:
        """Return the commands as modified by *effects* and by the smoother of the signal, per segment."""
        return self._kept(effects, noise, self._drives, self._new_drives)

    def _new_drives(self, effects: Sequence[EffectInstance], noise: ProcessNoise) -> tuple[Drive, ...]:
        drives, smoothing = [], noise.smoothing
        for segment in self.segments:
            passage = segment.passage
            drive = Drive(passage.t_in, passage.commands, passage.start, passage.measured, passage.run)
            for effect in effects:
                drive = EFFECTS[effect.slug].drive(effect, drive)
            if smoothing > 0.0:
                end = float(segment.stamps[-1])
                drive = smoothed_drive(drive, smoothing, end, self.data_summary.interval, self.form.inputs)
            drives.append(drive)
        return tuple(drives)

    @cached_property
    def _tracks(self) -> tuple[FilterRecord, ...]:
        """Stamps and samples of the segments. They do not depend on the inputs."""
        return FilterBank(self.form, self.segments, ()).tracks

    def _linear(self, effects: Sequence[EffectInstance]) -> LinearTerms | None:
        """Return the terms of the equation if it is linear in its velocity with *effects*, else None."""
        key = tuple((e.slug, e.place) for e in effects)
        if key not in self._terms:
            self._terms[key] = linear_terms(*self._formed(effects))
        return self._terms[key]

    def ease(self, effects: Sequence[EffectInstance], noise: ProcessNoise) -> bool:
        """Reset the integration step of the filter to the one that is needed, and return whether it changed.

        See :meth:`.filter_bank.FilterBank.ease`.
        """
        return self._linear(effects) is None and self.bank(effects, noise).ease()

    def afresh(self, effects: Sequence[EffectInstance], noise: ProcessNoise) -> None:
        """Reset the integration step of the filter to its initial value; see :meth:`.filter_bank.FilterBank.afresh`."""
        if self._linear(effects) is None:
            self.bank(effects, noise).afresh()

    def run(
        self, theta: Array, effects: Sequence[EffectInstance], noise: ProcessNoise, *, full: bool = False
    ) -> tuple[FilterBank, FilterResult, Levels] | None:
        """Return the filter bank, the pass over all records and its noise levels, or None if the pass diverges."""
        bank = self.bank(effects, noise)
        every = self.theta_of(bank.form, theta, effects)
        decay = 1.0 / noise.memory
        begin, std, states = [0.0], [noise.size], len(bank.states)
        if noise.differs:
            begin, std = [0.0, 0.0], [noise.size, noise.day_force]
        if noise.day_thrust > 0.0:  # the gain itself is in the state: a thrust of the day is a share of it
            begin, std = [*begin, theta[0]], [*std, noise.day_thrust * abs(theta[0])]
        constant = np.zeros(len(begin) - 1)
        levels = Levels(
            np.array([noise.sensor**2]),
            np.zeros(states),
            np.append(2.0 * decay * noise.size**2, constant),
            np.append(decay, constant),
            noise.waves,
        )
        prior = Prior(*self._priors, np.array(begin), np.diag(np.square(std)))
        with np.errstate(all="ignore"):
            result = bank.run(every, prior, levels, full=full)
        return None if result is None else (bank, result, levels)

    def theta_of(self, form: Form, theta: Array, effects: Sequence[EffectInstance]) -> Array:
        """Return all parameters (p,) of *form*.

        Derivatives from *effects* are added to those of the base model *theta*.
        """
        values = self._values(theta, effects)
        return np.array([values.get(n, 0.0) for n in form.parameters])

    def _values(self, theta: Array, effects: Sequence[EffectInstance]) -> dict[str, float]:
        values = dict(zip(self.form.free, theta.tolist(), strict=True)) | dict(self.form.known)
        for effect in effects:
            for n, v in EFFECTS[effect.slug].derivatives(effect).items():
                values[n] = values.get(n, 0.0) + v
        return values

    def innovations_at(
        self, theta: Array, effects: Sequence[EffectInstance], noise: ProcessNoise
    ) -> tuple[tuple[Array, Array, Array], ...] | None:
        """Return the stamps, innovations and variances (each (n,)) of every segment, or None if the filter fails."""
        terms = self._linear(effects)
        if terms is not None:
            return self._linear_innovations(terms, theta, effects, noise)
        done = self.run(theta, effects, noise)
        if done is None:
            return None
        bank, result, _ = done
        innovations = []
        for track, history in zip(bank.tracks, result.histories, strict=True):
            seen = ~np.isnan(history.S[:, 0])
            innovations.append((track.stamps[seen], history.e[seen, 0], history.S[seen, 0]))
        return tuple(innovations)

    def _linear_innovations(
        self, terms: LinearTerms, theta: Array, effects: Sequence[EffectInstance], noise: ProcessNoise
    ) -> tuple[tuple[Array, Array, Array], ...] | None:
        """Return the result of :meth:`innovations_at`, calculated with exact transitions."""
        values = self._values(theta, effects)
        states, spread = self._priors
        order = [states_of(self.form).index(n) for n in (self.dof.velocity, self.dof.position)]
        innovations = []
        drives = self._driven(effects, noise)
        run, mean, cov = None, np.zeros(2), np.zeros((2, 2))
        for track, drive, start, std in zip(self._tracks, drives, states[:, order], spread[:, order], strict=True):
            rows, damping = terms.rows(values, drive.channels)
            forces = [rows]
            if noise.differs:
                forces.append(np.ones(len(rows)))
            if noise.day_thrust > 0.0:
                forces.append(terms.share_of(self.form.free[0], values, drive.channels))
            if track.record.run != run:
                run, mean, cov = track.record.run, np.zeros(2), np.diag([noise.day_force**2, noise.day_thrust**2])
            y = track.Y[:, 0]
            seen = ~np.isnan(y)
            e, S = np.zeros((3 if noise.differs else 1, len(y))), np.zeros(len(y))
            of_velocity = self.dof.velocity in track.record.signals
            spend(len(y) * LINEAR_STATES)
            finite = linear_pass(
                drive.t, np.stack(forces), damping, track.stamps, y, of_velocity, noise.size, noise.memory,
                noise.sensor, noise.waves, start, std, e, S,
            )  # fmt: skip
            own, S = e[0, seen], S[seen]
            if not finite or not np.all(np.isfinite(own)) or not np.all(S > 0.0):
                return None
            if noise.differs:
                integrate_out(e[1:, seen], mean, cov, own, S)
            innovations.append((track.stamps[seen], own, S))
        return tuple(innovations)
