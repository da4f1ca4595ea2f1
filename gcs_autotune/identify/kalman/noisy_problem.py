"""Fit one degree of freedom with process noise: wind, wake and current as a drifting force.

The likelihood is that of the innovations of :mod:`.noise_filter`. Because gusts come in bursts, the innovations may
follow Student's distribution with *freedom* degrees of freedom instead of the normal one. The filter calculates the
variance of either distribution, and ``noisy_objective`` the derivatives of the likelihood. Steps and covariance come
from the expected information.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects import EFFECTS, EffectInstance, in_order
from gcs_autotune.identify.kalman.noise_filter import DRIFTING_FORCE, NoiseFilter
from gcs_autotune.identify.kalman.noisy_fit import NoisyFit, Tangent
from gcs_autotune.identify.kalman.noisy_objective import NoisyObjective, Point
from gcs_autotune.identify.kalman.process_noise import ProcessNoise
from gcs_autotune.identify.kalman.run_to_run import RunLikelihood, RunLikelihoods
from gcs_autotune.identify.kalman.waves import waves_ahead
from gcs_autotune.identify.problems.least_squares import Local, Rules, descend, step_of
from gcs_autotune.identify.signals.segment import Segment
from gcs_autotune.kept_results import recalled
from gcs_autotune.models import Simulator

__all__ = ["NoisyProblem"]

Array = NDArray[np.float64]

KNOWN_WITHIN = 0.2
"""Prior standard deviations of the thrust change and of the constant force of a single run.

The first is relative to the thrust, the second to the largest commanded force. Project choice: the prior is wide, so
that the data of the run decide. It is narrow enough to linearise a nonlinear equation.
"""

ROUNDS = 30
"""Maximum number of scoring rounds of a fit, that is, of steps that lower its cost. Project choice."""

MOST_TRIALS = 10_000
"""Maximum number of trials of a fit.

In practice the number of scoring rounds or the damping ends it first. Project choice.
"""

ENOUGH = 2e-2
"""Expected gain of the log-likelihood below which a fit ends. Project choice."""


class NoisyProblem(NoiseFilter):
    """A form of one degree of freedom and segments with its position, to be fitted with process noise."""

    def on(self, segments: Sequence[Segment]) -> NoisyProblem:
        """Return the same problem on other segments."""
        return NoisyProblem(self.form, segments, self.data_summary, self.limits)

    def run_likelihoods(self, fit: NoisyFit) -> RunLikelihoods | None:
        """Return the likelihood of the constant force and the thrust change of each run at *fit*, or None if the filter
        fails.
        """
        full = abs(fit.gain) * sum(self.data_summary.amplitude.values())
        wide = np.array([fit.noise.size + KNOWN_WITHIN * full, KNOWN_WITHIN])
        noise = replace(fit.noise, day_force=float(wide[0]), day_thrust=float(wide[1]))
        done = self.run(fit.theta, fit.effects, noise, full=True)
        if done is None:
            return None
        bank, result, _ = done
        first, gain, likelihoods = len(bank.states) + 1, fit.gain, {}
        for track, history in zip(bank.tracks, result.histories, strict=True):  # of a run in parts the last knows all
            scale = np.array([1.0, gain])
            cov = history.covariance[-1, first : first + 2, first : first + 2] / np.outer(scale, scale)
            precision: Array = np.asarray(np.linalg.inv(cov), dtype=np.float64)
            mean = (history.mean[-1, first : first + 2] - [0.0, gain]) / scale
            likelihoods[track.record.run] = RunLikelihood(
                track.record.run, precision - np.diag(wide**-2.0), precision @ mean
            )
        return RunLikelihoods(tuple(likelihoods.values()))

    def fit(
        self,
        theta: Array,
        effects: Sequence[EffectInstance],
        noise: ProcessNoise,
        *,
        rounds: int = ROUNDS,
        only_log_likelihood: bool = False,
    ) -> NoisyFit | None:
        """Return the fit from these start values, or None if the filter diverges at them.

        theta : (p,) base parameters.
        rounds : maximum number of scoring rounds.
        only_log_likelihood : whether to evaluate the start values without fitting.

        Within :func:`.keeping` the result of a known fit is reused and only evaluated.
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
        """Return a fit from the cached data of :func:`_plain_fit`."""
        if kept is None:
            return None
        effects = in_order([EffectInstance(**e) for e in kept["effects"]])
        noise, theta = ProcessNoise(**kept["noise"]), np.array(kept["theta"], dtype=np.float64)
        fit = self._fit(theta, effects, noise, 0)
        return None if fit is None else replace(fit, covariance=np.array(kept["covariance"], dtype=np.float64))

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
        # A drifting force that vanished in the fit is not among the unknowns of its result.
        left = [n in noise.unknowns for n in objective.names]
        known = np.append(np.full(len(covariance) - len(left), fill_value=True), left)
        covariance = covariance[np.ix_(known, known)]
        fitted = (self.form.free, objective.free_effects)
        return NoisyFit(self.form, theta, effects, *fitted, noise, here.each, covariance, here.innovations)

    def tangent(self, fit: NoisyFit) -> Tangent | None:
        """Return the derivatives of the innovations of *fit* by the unknowns of *fit*, or None if the filter fails."""
        objective = NoisyObjective(self, fit.theta, fit.effects, fit.noise)
        x = objective.pack()
        here = objective.begun(x)
        if here is None:
            return None
        scale = 1.0 / np.sqrt(np.maximum(np.diag(fit.covariance), 1e-30))
        return Tangent(*objective.derivatives(x, here, objective.steps_for(x, scale)))

    def adapted(self, fit: NoisyFit, own: EffectInstance, tangent: Tangent) -> NoisyFit | None:
        """Return *fit* with the effect *own* added and its parameters adjusted, or None if the filter fails.

        The parameters of *own* stay fixed. The others are adjusted to first order, with the derivatives *tangent* of
        *fit*.
        """
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
        """Return *fit* evaluated on the segments of this problem, or None if the filter fails.

        Its log-likelihoods and innovations are replaced. No parameter is fitted.
        """
        return self.fit(fit.theta, fit.effects, fit.noise, only_log_likelihood=True)

    def ahead(self, fit: NoisyFit, seconds: float) -> Array:
        """Return the prediction errors (k,) of the signal, *seconds* [s] ahead.

        The predictions start at samples spread over all records.
        """
        done = self.run(fit.theta, fit.effects, fit.noise, full=True)
        if done is None:
            return np.array([np.nan])
        bank, result, _ = done
        names, n = bank.form.parameters, len(bank.states)
        theta = self.theta_of(bank.form, fit.theta, fit.effects)
        theta[names.index(bank.free[0])] = 1.0
        own = [names.index(n) for n in bank.free[1:]]
        gust = list(bank.form.inputs).index(DRIFTING_FORCE)
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
                motion = simulator.run(theta, history.mean[s, :n].copy(), t, rows, np.array([start, end]))
                if motion is not None:
                    errors.append(signal.values[goal] - motion[0][-1, seen] - waves[0] * sea[-1])
        return np.array(errors)


def _plain_fit(fit: NoisyFit | None) -> dict[str, Any] | None:
    """Return the parameters of a fit as data for JSON.

    The innovations can be calculated from them.
    """
    if fit is None:
        return None
    return {
        "theta": fit.theta.tolist(),
        "effects": [e.to_dict() for e in fit.effects],
        "noise": asdict(fit.noise),
        "covariance": fit.covariance.tolist(),
    }
