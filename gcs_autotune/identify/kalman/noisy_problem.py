"""One degree of freedom with process noise: wind, wake and current as a drifting force, fitted with the model.

The equation of motion, with whatever effects stand in it, is driven besides by a force that is an Ornstein-Uhlenbeck
process: its standard deviation and time constant are unknowns beside the model's and the noise of the sensor. The
filter carries that force as a parameter that decays (:class:`.filter_bank.Levels`), so initial states and what the
force did are integrated out; what is left is the likelihood of the innovations (Ljung1999, chapter 7). Gusts come in
bursts: innovations may follow Student's law of *freedom* degrees instead of the normal one, its variance the filter's.

Derivatives by the unknowns are those of ``noisy_objective``; steps and covariance come from the expected information.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.clock import spend
from gcs_autotune.effects import EFFECTS, DataSummary, Drive, EffectInstance, in_order
from gcs_autotune.identify.free_numbers import ModelProblem
from gcs_autotune.identify.kalman.days import RunSays, integrate_out
from gcs_autotune.identify.kalman.filter_bank import FilterBank, FilterRecord, FilterResult, Levels, Prior
from gcs_autotune.identify.kalman.linear_pass import LinearTerms, linear_pass, linear_terms
from gcs_autotune.identify.kalman.noisy_fit import NoisyFit, Tangent
from gcs_autotune.identify.kalman.noisy_objective import NoisyObjective, Point, ProcessNoise
from gcs_autotune.identify.kalman.thinning import smoothed_drive
from gcs_autotune.identify.kalman.waves import waves_ahead
from gcs_autotune.identify.least_squares import Local, Rules, descend, step_of
from gcs_autotune.identify.limits import Limits
from gcs_autotune.identify.segment import Segment
from gcs_autotune.kept_results import recalled
from gcs_autotune.models import Form, Simulator, states_of
from gcs_autotune.sname import DOFS

__all__ = ["NoisyProblem"]

Array = NDArray[np.float64]

WANDERS, OF_THE_DAY = "gust", "day"
"""Inputs, always 1, whose gains are the drifting force and a run's own constant force."""

KNOWN_WITHIN = 0.2
"""Chosen: share of thrust, and of the largest commanded force, within which a run is asked for what it has of its own:
wide enough to leave the answer to the run, narrow enough for a bent equation."""

ROUNDS = 30
"""Most scoring rounds."""

MOST_TRIALS = 10_000
"""Of a fit: its scoring rounds end it, or the damping."""

ENOUGH = 2e-2
"""Expected gain of the log-likelihood at which a search ends."""

LINEAR_STATES = 3
"""Position, velocity and the force: what a sample of the linear filter counts as work, as in a filter bank."""

MOST_KEPT = 60
"""Commands as effects make them that are kept, at most."""

Made = TypeVar("Made")


class NoisyProblem(ModelProblem):
    """A form of one degree of freedom and segments with its position, ready to fit with any effects.

    As of :class:`.ModelProblem`; the form is per unit of inertia: its inertia known as one.
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
        """How many runs the segments are of."""
        return len({s.run for s in self.segments})

    def on(self, segments: Sequence[Segment]) -> NoisyProblem:
        """Return the same problem on other segments."""
        return NoisyProblem(self.form, segments, self.data_summary, self.limits)

    def _first(self) -> tuple[Array, Array]:
        """Return first position and velocity (records, 2) and their standard deviations, wide."""
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

    # -- passes

    def _kept(
        self,
        effects: Sequence[EffectInstance],
        noise: ProcessNoise,
        kept: dict[tuple[object, ...], Made],
        make: Callable[[Sequence[EffectInstance], ProcessNoise], Made],
    ) -> Made:
        """Return what *make* returns, made once for as long as *effects* do the same to the commands."""
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
        """Return the records as *effects* make them of the commands.

        In the state is the drifting force; where runs differ, the constant force of each, and its gain.
        """
        return self._kept(effects, noise, self._banks, self._new_bank)

    def _formed(self, effects: Sequence[EffectInstance]) -> tuple[Form, list[str]]:
        """Return the form with the inputs that *effects* add, and the derivatives they add."""
        more = [n for e in effects for n in EFFECTS[e.slug].inputs(e)]
        added = [n for e in effects for n in EFFECTS[e.slug].derivatives(e)]
        inputs = {**self.form.inputs, **{n: () for n in more if n not in self.form.inputs}}
        return replace(self.form, inputs=inputs), list(dict.fromkeys(added))

    def _new_bank(self, effects: Sequence[EffectInstance], noise: ProcessNoise) -> FilterBank:
        form, added = self._formed(effects)
        ones = (WANDERS, OF_THE_DAY) if noise.differs else (WANDERS,)
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
        """Return what *effects*, and a smoother of the signal, make of the commands, segment by segment."""
        return self._kept(effects, noise, self._drives, self._new_drives)

    def _new_drives(self, effects: Sequence[EffectInstance], noise: ProcessNoise) -> tuple[Drive, ...]:
        found, smoothing = [], noise.smoothing
        for segment in self.segments:
            passage = segment.passage
            drive = Drive(passage.t_in, passage.commands, passage.start, passage.measured, passage.run)
            for effect in effects:
                drive = EFFECTS[effect.slug].drive(effect, drive)
            if smoothing > 0.0:
                end = float(segment.stamps[-1])
                drive = smoothed_drive(drive, smoothing, end, self.data_summary.interval, self.form.inputs)
            found.append(drive)
        return tuple(found)

    @cached_property
    def _tracks(self) -> tuple[FilterRecord, ...]:
        """The segments' stamps and samples, whatever drives them."""
        return FilterBank(self.form, self.segments, ()).tracks

    def _linear(self, effects: Sequence[EffectInstance]) -> LinearTerms | None:
        """Return the equation's terms where it is linear in its velocity with *effects*, else None."""
        key = tuple((e.slug, e.place) for e in effects)
        if key not in self._terms:
            self._terms[key] = linear_terms(*self._formed(effects))
        return self._terms[key]

    def ease(self, effects: Sequence[EffectInstance], noise: ProcessNoise) -> bool:
        """Return whether the filter's steps were finer than they need be: see :meth:`.filter_bank.FilterBank.ease`."""
        return self._linear(effects) is None and self.bank(effects, noise).ease()

    def afresh(self, effects: Sequence[EffectInstance], noise: ProcessNoise) -> None:
        """Forget how fine the filter's steps were: see :meth:`.filter_bank.FilterBank.afresh`."""
        if self._linear(effects) is None:
            self.bank(effects, noise).afresh()

    def run(
        self, theta: Array, effects: Sequence[EffectInstance], noise: ProcessNoise, *, full: bool = False
    ) -> tuple[FilterBank, FilterResult, Levels] | None:
        """Pass the filter over all records; None when it runs away."""
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
        """Return all parameters of *form*, the effects' derivatives added to the base's."""
        values = self._values(theta, effects)
        return np.array([values.get(n, 0.0) for n in form.parameters])

    def _values(self, theta: Array, effects: Sequence[EffectInstance]) -> dict[str, float]:
        values = dict(zip(self.form.free, theta.tolist(), strict=True)) | dict(self.form.known)
        for effect in effects:
            for n, v in EFFECTS[effect.slug].derivatives(effect).items():
                values[n] = values.get(n, 0.0) + v
        return values

    # -- likelihood

    def innovations_at(
        self, theta: Array, effects: Sequence[EffectInstance], noise: ProcessNoise
    ) -> tuple[tuple[Array, Array, Array], ...] | None:
        """Return stamps, innovations and their variances of every segment, (n,) each; None where the filter fails."""
        terms = self._linear(effects)
        if terms is not None:
            return self._linear_innovations(terms, theta, effects, noise)
        done = self.run(theta, effects, noise)
        if done is None:
            return None
        bank, result, _ = done
        found = []
        for track, history in zip(bank.tracks, result.histories, strict=True):
            seen = ~np.isnan(history.S[:, 0])
            found.append((track.stamps[seen], history.e[seen, 0], history.S[seen, 0]))
        return tuple(found)

    def _linear_innovations(
        self, terms: LinearTerms, theta: Array, effects: Sequence[EffectInstance], noise: ProcessNoise
    ) -> tuple[tuple[Array, Array, Array], ...] | None:
        """Do as :meth:`innovations_at` with exact transitions."""
        values = self._values(theta, effects)
        states, spread = self._priors
        order = [states_of(self.form).index(n) for n in (self.dof.velocity, self.dof.position)]
        found = []
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
            found.append((track.stamps[seen], own, S))
        return tuple(found)

    def says(self, fit: NoisyFit) -> tuple[RunSays, ...] | None:
        """Return what each run says of its own constant force and thrust at *fit*; None where the filter fails."""
        full = abs(float(fit.theta[0])) * sum(self.data_summary.amplitude.values())
        wide = np.array([fit.noise.size + KNOWN_WITHIN * full, KNOWN_WITHIN])
        noise = replace(fit.noise, day_force=float(wide[0]), day_thrust=float(wide[1]))
        done = self.run(fit.theta, fit.effects, noise, full=True)
        if done is None:
            return None
        bank, result, _ = done
        first, gain, found = len(bank.states) + 1, float(fit.theta[0]), {}
        for track, history in zip(bank.tracks, result.histories, strict=True):  # of a run in parts the last knows all
            scale = np.array([1.0, gain])
            cov = history.covariance[-1, first : first + 2, first : first + 2] / np.outer(scale, scale)
            told: Array = np.asarray(np.linalg.inv(cov), dtype=np.float64)
            mean = (history.mean[-1, first : first + 2] - [0.0, gain]) / scale
            found[track.record.run] = RunSays(track.record.run, told - np.diag(wide**-2.0), told @ mean)
        return tuple(found.values())

    def fit(
        self,
        theta: Array,
        effects: Sequence[EffectInstance],
        noise: ProcessNoise,
        *,
        rounds: int = ROUNDS,
        only_log_likelihood: bool = False,
    ) -> NoisyFit | None:
        """Fit from these values on; None when the filter runs away at the start already.

        Within :func:`.keeping` a fit that is known is only evaluated.
        """
        effects = in_order(effects)
        if only_log_likelihood or rounds == 0:
            return self._fit(theta, effects, noise, rounds, only_log_likelihood=only_log_likelihood)
        return recalled(
            lambda: ("noisy fit", self, theta, effects, noise, rounds),
            lambda: self._fit(theta, effects, noise, rounds),
            _plain_fit,
            self._refit,
        )

    def _refit(self, kept: dict[str, Any] | None) -> NoisyFit | None:
        """Return the fit that was kept as :func:`_plain_fit` has it."""
        if kept is None:
            return None
        effects = in_order([EffectInstance(**e) for e in kept["effects"]])
        noise, theta = ProcessNoise(**kept["noise"]), np.array(kept["theta"], dtype=np.float64)
        found = self._fit(theta, effects, noise, 0)
        return None if found is None else replace(found, covariance=np.array(kept["covariance"], dtype=np.float64))

    def _fit(
        self,
        theta: Array,
        effects: tuple[EffectInstance, ...],
        noise: ProcessNoise,
        rounds: int,
        *,
        only_log_likelihood: bool = False,
    ) -> NoisyFit | None:
        objective = NoisyObjective(self, theta, effects, noise)
        x = objective.clipped(objective.pack())
        rules, reach = Rules(enough=2.0 * ENOUGH), objective.reach
        rounds = 0 if only_log_likelihood else rounds
        end = descend(
            objective.local,
            x,
            objective.low,
            objective.high,
            trials=MOST_TRIALS,
            rules=rules,
            rounds=rounds,
            reach=reach,
        )
        if end is None:
            return None
        inverse: Array = np.full((len(x), len(x)), np.nan)
        if not only_log_likelihood:
            inverse = np.asarray(np.linalg.pinv(objective.information), dtype=np.float64)
        return self._fit_at(objective, end.place, inverse)

    def _fit_at(self, objective: NoisyObjective, here: Point, covariance: Array) -> NoisyFit:
        theta, effects, noise = objective.unpack(here.x)
        free = objective.free_effects
        return NoisyFit(self.form, theta, effects, noise, here.each, free, covariance, here.innovations)

    def tangent(self, fit: NoisyFit) -> Tangent | None:
        """Return how the innovations of *fit* move with its unknowns; None where it is about to run away."""
        objective = NoisyObjective(self, fit.theta, fit.effects, fit.noise)
        x = objective.pack()
        here = objective.begun(x)
        if here is None:
            return None
        scale = 1.0 / np.sqrt(np.maximum(np.diag(fit.covariance), 1e-30))
        return Tangent(*objective.derivatives(x, here, objective.steps_for(x, scale)))

    def adapted(self, fit: NoisyFit, own: EffectInstance, tangent: Tangent) -> NoisyFit | None:
        """Return *fit* with an effect more, its own numbers moved to first order by what the effect leaves."""
        effects = in_order((*fit.effects, own))
        held = [(own.slug, own.place, name) for name in own.values]
        objective = NoisyObjective(self, fit.theta, effects, fit.noise, held)
        x = objective.pack()
        here = objective.begun(x)
        if here is None:
            return None
        J, D = tangent.J, tangent.D
        if EFFECTS[own.slug].acts_on & {"commands"}:
            # What changes commands changes what a gain makes of them: a long delay may turn its sign.
            J, D = J.copy(), D.copy()
            J[0], D[0] = objective.derivative(0, x, here, 0.1 * x[0])
        for _ in range(2):
            gradient, information = objective.gathered(J, D, here)
            near = Local(here.cost, -gradient, information)
            move, _ = step_of(near, x, objective.low, objective.high, 1e-3, objective.reach)
            other = objective.clipped(x + move)
            there = objective.at(other)
            if there is None or there.total <= here.total:
                break
            x, here = other, there
        return self._fit_at(objective, here, np.zeros((len(x), len(x))))

    def judge(self, fit: NoisyFit) -> NoisyFit | None:
        """Return *fit* as it is on this problem's segments: their log-likelihoods and innovations."""
        return self.fit(fit.theta, fit.effects, fit.noise, only_log_likelihood=True)

    def ahead(self, fit: NoisyFit, seconds: float) -> Array:
        """Return errors (k,) of the signal *seconds* [s] ahead of samples all along the records."""
        done = self.run(fit.theta, fit.effects, fit.noise, full=True)
        if done is None:
            return np.array([np.nan])
        bank, result, _ = done
        names, n = bank.form.parameters, len(bank.states)
        theta = self.theta_of(bank.form, fit.theta, fit.effects)
        theta[names.index(bank.free[0])] = 1.0
        own = [names.index(n) for n in bank.free[1:]]
        gust = list(bank.form.inputs).index(WANDERS)
        simulator, errors, waves = Simulator(bank.form), [], fit.noise.waves
        for track, history in zip(bank.tracks, result.histories, strict=True):
            signal = next(iter(track.record.signals.values()))
            seen = int(next(i for i, name in enumerate(bank.states) if name == signal.name))
            t_in, table = track.record.t_in, track.record.inputs
            begin = track.stamps[0] + seconds
            while begin + seconds <= track.stamps[-1]:
                s = int(np.searchsorted(track.stamps, begin))
                start = float(track.stamps[s])
                goal = int(np.searchsorted(signal.t, start + seconds))
                begin += 0.5 * seconds
                if goal >= len(signal.t):
                    break
                end = float(signal.t[goal])
                inside = t_in[(t_in > start) & (t_in < end)]
                t = np.union1d(np.append(inside, start), np.arange(start, end, self.interval))
                rows = table[np.maximum(np.searchsorted(t_in, t, side="right") - 1, 0)].copy()
                sea = waves_ahead(waves, history.mean[s, -2:], np.append(t, end) - start)
                rows[:, gust] = history.mean[s, n] * np.exp(-(t - start) / fit.noise.memory) + waves[1] * sea[:-1]
                theta[own] = history.mean[s, n + 1 : n + 1 + len(own)]
                found = simulator.run(theta, history.mean[s, :n].copy(), t, rows, np.array([start, end]))
                if found is not None:
                    errors.append(signal.values[goal] - found[0][-1, seen] - waves[0] * sea[-1])
        return np.array(errors)


def _plain_fit(fit: NoisyFit | None) -> dict[str, Any] | None:
    """Return a fit in JSON's own types: its numbers, from which the innovations follow."""
    if fit is None:
        return None
    return {
        "theta": fit.theta.tolist(),
        "effects": [e.to_dict() for e in fit.effects],
        "noise": asdict(fit.noise),
        "covariance": fit.covariance.tolist(),
    }
