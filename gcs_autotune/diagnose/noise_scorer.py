"""Fit and score candidates with process noise modelled: each sample is predicted from the samples before it."""

from __future__ import annotations

import math
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gcs_autotune.diagnose.candidates import candidates
from gcs_autotune.diagnose.heldout_score import Folds, Unseen, densities_of, gains_ahead, interval_of, unseen_of
from gcs_autotune.diagnose.process_noise_starts import FEWEST_TO_COMPARE, ROUGH, WAVES, Say
from gcs_autotune.diagnose.run_to_run import alike_in
from gcs_autotune.diagnose.sampling_interval import prediction_horizon, rms_ahead, stands
from gcs_autotune.diagnose.score import (
    ALIKE,
    HALF,
    MIN_HELD_OUT_GAIN,
    CandidateScore,
    alike_of,
    is_form_of,
    key_of,
    lack_by_parts,
    lasts,
    may_be_none,
    needed_of,
    plainest,
)
from gcs_autotune.effects import EFFECTS, DataSummary, Effect, EffectInstance, columns_of, name_of, twins_of
from gcs_autotune.identify.kalman import NoisyFit, NoisyProblem, Tangent
from gcs_autotune.slow_imports import scipy_stats

__all__ = ["EVEN", "WithProcessNoise", "answers_heading", "choices_of", "may_be_weighed", "suits_process_noise"]

Attempt = tuple[EffectInstance, NoisyFit]

Score = CandidateScore[NoisyFit]

BRIEF = 1.0
"""Time constant of an effect, in samples of the record, below which it may be a filter of the sensor."""

AGAINST = 4.0
"""Rank correlation, in standard deviations, above which a command counts as feedback.

The correlation is between innovations and the next changes of the command. In the open loops of the blind suite it was
at most 2.
"""

RUNNERS = 6
"""Number of candidates that are fitted to convergence. Project choice."""

SLOWER_THAN_FOUND = 2.0
"""Factor by which the craft may be slower than in a fit without a delay or a lag.

The range of delays and lags that are tried is scaled by it.
"""

EVEN = 16
"""Number of evenly spaced start values, for effects whose only number is a time.

If commands change often, a fit converges to the right delay only from a start value near it.
"""

DOZEN = 12.0
"""Minimum upper end of these start values, in samples of the record; the effect's own bounds may extend the range.

A fit without the delay may estimate too small a time constant for a fast craft. In rough water, seed 232 case 2, the
range otherwise ended below a delay of two time constants. Seed 463 has a delay of 0.39 s, nearly three time constants,
which improves the log-likelihood by 338.
"""

LATE = ("input-delay", "actuator-lag")
"""Effects that are similar to a late sensor, or to a one-way filter of the sensor.

With one signal, they differ from these only in their noise.
"""

FAR_AHEAD = 0.85
"""Ratio of prediction errors ahead, to that of the likeliest candidate, below which another candidate is preferred."""

TRACE = 0.1
"""A small amount of an effect, relative to its trial size."""


@dataclass(frozen=True, slots=True, eq=False)
class WithProcessNoise:
    """Scorer that adds candidates to the model ``present`` and fits them with process noise modelled.

    ``tried``: total number of candidates. ``folds``: the folds held out in turn. ``left_out``: the present model,
    refitted to the rest and evaluated on each fold. ``plain``: the model without any cause. ``hint``: a fit with one
    cause, as a further start.
    """

    problem: NoisyProblem
    folds: Folds
    plain: NoisyFit
    present: NoisyFit
    tried: int
    say: Say
    stage: str = ""
    hint: NoisyFit | None = None
    left_out: Unseen = ()

    @property
    def runners(self) -> int:
        """Number of candidates that are fitted to convergence."""
        return RUNNERS

    def rough(self, choices: Sequence[Sequence[EffectInstance]]) -> list[Attempt]:
        """Return the candidates after a rough fit, the best first."""
        rough: list[Attempt] = []
        tangent = self.problem.tangent(self.present)
        if tangent is None:
            return []
        for k, own in enumerate(choices):
            fit = _rough(self.problem, self.present, own, tangent)
            if fit is not None:
                rough.append((own[0], fit))
            self.say(self.stage, k + 1, len(choices))
        return sorted(rough, key=lambda f: -(f[1].total - f[1].price(f[1].unknowns - self.present.unknowns)))

    def to_the_end(self, rough: Sequence[Attempt]) -> list[Attempt]:
        """Return the roughly fitted candidates, fitted to convergence from several starts of the process noise."""
        problem, ends = self.problem, []
        for k, (tried_one, fit) in enumerate(rough):
            self.say(f"{self.stage}: final fits", k, RUNNERS)
            tries = [fit, problem.fit(fit.theta, fit.effects, fit.noise)]
            same = alike_in(fit.noise, problem.runs)
            if fit.noise.day_thrust or fit.noise.day_force > 1.01 * same.day_force:
                # What bends thrust makes runs of other commands differ, and may explain them alike.
                tries.append(problem.fit(fit.theta, fit.effects, same))
            if fit.noise.wavy:
                # What answers the commands in a rhythm may be taken for waves until its cause is there.
                tries.append(problem.fit(fit.theta, fit.effects, replace(fit.noise, wave_swing=0.0, wave_force=0.0)))
            best_try = max((f for f in tries if f is not None), key=lambda f: f.total - WAVES * f.noise.wavy)
            ends.append((tried_one, self._or_hinted(tried_one, best_try)))
        return ends

    def _or_hinted(self, tried: EffectInstance, best: NoisyFit) -> NoisyFit:
        """Return the fit of a candidate, or the local minimum near the hint if that predicts far better.

        If the craft's time constant was underestimated, a candidate may stay in the local minimum of the plain model.
        """
        hint, problem, present = self.hint, self.problem, self.present
        if hint is None or [(e.slug, e.place) for e in hint.effects] != [(tried.slug, tried.place)]:
            return best
        noise = replace(hint.noise, day_force=present.noise.day_force, day_thrust=present.noise.day_thrust)
        fits = [problem.fit(hint.theta, hint.effects, w) for w in (noise, alike_in(hint.noise, problem.runs))]
        seconds = prediction_horizon(problem, self.plain)
        other = max((f for f in fits if f is not None), key=lambda f: f.total, default=None)
        if other is None or seconds is None or other.total <= present.total:
            return best
        far = rms_ahead(problem, other, seconds) < FAR_AHEAD * rms_ahead(problem, best, seconds)
        return other if far or other.total > best.total else best

    def rebased(self, ends: Sequence[Attempt]) -> WithProcessNoise:
        """Return this scorer with a better fit of the present model, if a refit from the best of *ends* gives one."""
        present = self.present
        if ends:
            best = max(ends, key=lambda e: e[1].total)[1]
            again = self.problem.fit(best.theta, present.effects, best.noise)
            if again is not None and again.total > present.total + 0.5:
                present = again
        return replace(self, present=present, left_out=self.unseen(present) if ends else ())

    def unseen(self, fit: NoisyFit) -> Unseen:
        """Return *fit*, for each fold, refitted without the fold and evaluated on it."""
        return unseen_of(self.problem, self.plain, self.folds, fit)

    def scores(self, ends: Sequence[Attempt]) -> list[Score]:
        """Return the scores of the converged candidates, the candidate likeliest on the fitted runs first."""
        scores = []
        for k, (effect, fit) in enumerate(ends):
            self.say(f"{self.stage}: held-out runs", k, len(ends))
            scores.append(self._sound(self.score(effect, fit)))
        return sorted(scores, key=lambda a: -(a.gained - a.fit.price(a.fit.unknowns - self.present.unknowns)))

    def score(self, effect: EffectInstance, fit: NoisyFit) -> Score:
        """Return the score of a fit with *effect*."""
        problem, tried = self.problem, self.tried
        gained, needed = fit.total - self.present.total, needed_of(fit.unknowns - self.present.unknowns, tried)
        now = next(e for e in fit.effects if key_of(e) == key_of(effect))
        before = densities_of(self.left_out, self.left_out)
        after = (
            densities_of(self.unseen(fit), self.left_out) if gained > min(0.5 * needed, MIN_HELD_OUT_GAIN) else before
        )
        parts = np.array([float(np.sum(a - b)) for a, b in zip(after, before, strict=True)])
        held_out_gain = float(parts.sum())
        score = CandidateScore(
            now,
            fit,
            gained,
            needed,
            numbers=sum(fit.effects[i] is now for i, _ in fit.free_effects),
            evidence=2.0 * held_out_gain,
            gain=1.0 - math.exp(-max(held_out_gain, -50.0) / max(fit.samples, 1)),
            p=min(1.0, tried * math.exp(-max(min(held_out_gain, 700.0), 0.0))),
            parts=parts,
            interval=interval_of(before, after),
        )
        lacks = lack_by_parts(score, brief=_is_brief(problem, now, fit), uncertain=may_be_none(now, fit.errors_of(now)))
        return replace(score, lacks=lacks)

    def _sound(self, score: Score) -> Score:
        """Return *score* with its error some seconds ahead, relative to the present model.

        It is marked as rejected, with the reason, if the fit is not a model of the craft or does not reduce that error.
        """
        if score.lacks is not None:
            return score
        if not stands(self.problem, score.fit):
            return replace(score, lacks="no-model", unsound="with it no model of the craft fits")
        seen: list[tuple[float, float]] = []
        unseen = self.unseen(score.fit)
        for seconds, gain in gains_ahead(self.problem, self.plain, self.folds, self.left_out, unseen, ""):
            seen.append((gain.ratio, seconds))
            if gain.ratio < 1.0:
                break
        if not seen:
            return score
        ratio, seconds = min(seen)
        before, after = (rms_ahead(self.problem, fit, seconds) for fit in (self.present, score.fit))
        score = replace(score, ahead=after / before if 0.0 < before < math.inf else 1.0)
        if ratio < 1.0:
            return score
        why = f"it does not improve prediction {seconds:g} s ahead ({ratio:.2f} times the error)"
        return replace(score, lacks="no-gain", unsound=why)

    def winner(self, scores: Sequence[Score]) -> Score | None:
        """Return the accepted candidate; None if there is none."""
        paid = [a for a in scores if a.lacks is None]
        if not paid:
            return None
        # On held-out runs a model is penalised for its parameters by its errors. The fitted runs show less.
        first = alike_of(paid)[0]
        # The likelihood is of the next sample. Where another predicts far better some seconds ahead, and gains on every
        # part left out as well, that is felt.
        better = [a for a in paid if a.ahead < FAR_AHEAD * first.ahead and bool(np.all(a.parts > 0.0))]
        return plainest(min(better, key=lambda a: a.ahead, default=first), paid)

    def alike(self, scores: Sequence[Score], winner: Score) -> tuple[str, ...]:
        """Return the causes that these runs do not distinguish from *winner*, starting with *winner* itself."""
        paid = [a for a in scores if a.lacks is None]
        forms = [a for a in paid if is_form_of(a.effect, winner.effect) and a.evidence > HALF * winner.evidence]
        others = [a.effect for a in (*alike_of(paid), *forms, *_as_likely(scores, winner))]
        late = ["measurement-delay" for effect in (winner.effect, *others) if effect.slug in LATE]
        twins = twins_of(winner.effect, self.problem.data_summary)
        return tuple(dict.fromkeys([name_of(winner.effect), *twins, *map(name_of, others), *late]))


def choices_of(
    data: DataSummary, slugs: Sequence[str], present: Sequence[EffectInstance]
) -> list[list[EffectInstance]]:
    """Return start values for every effect and place that is not *present*, with evenly spaced times."""
    slower = replace(data, time_constant=SLOWER_THAN_FOUND * data.time_constant)

    def starts(entry: Effect, place: str) -> Sequence[Mapping[str, float]]:
        guesses = [dict(s) for d in (data, slower) for s in entry.starts(place, d)]
        if [q.unit for q in entry.parameters] == ["s"]:
            name = entry.parameters[0].name
            allowed = entry.bounds(place, data).get(name, (0.0, math.inf))[1]
            most = max(slower.time_constant, DOZEN * data.interval), allowed
            even = [np.linspace(0.0, t, EVEN + 1)[1:] for t in most if math.isfinite(t)]
            guesses += [{name: float(t)} for t in np.concatenate(even)]
        return [s for k, s in enumerate(guesses) if s not in guesses[:k]]

    return candidates(data, present, [s for s in slugs if suits_process_noise(s)], starts)


def suits_process_noise(slug: str) -> bool:
    """Return whether a search with process noise considers an effect.

    It considers effects that act all the time, on commands or in the equation of motion.
    """
    entry = EFFECTS[slug]
    return entry.family != "data errors" and not entry.happens_at and _is_motion(slug)


def may_be_weighed(effect: EffectInstance, inputs: Container[str]) -> bool:
    """Return whether a filter can score an effect that another search found.

    This includes effects that happen at one time, and errors of the record at a column of *inputs*. The filter cannot
    find the time itself, but it can score the effect once the time is known.
    """
    if EFFECTS[effect.slug].family == "data errors":
        return all(n in inputs for n in columns_of(effect.place))
    return _is_motion(effect.slug)


def _is_motion(slug: str) -> bool:
    entry = EFFECTS[slug]
    return not entry.is_disturbance and bool(entry.acts_on) and not entry.acts_on - {"commands", "motion"}


def _is_brief(problem: NoisyProblem, effect: EffectInstance, fit: NoisyFit) -> bool:
    """Return whether an effect is too fast for these runs to identify.

    Its time may then be a filter of the recorded signal, or the craft's inertia. If commands react to the heading, its
    time must also exceed the sampling interval of the thinned runs.
    """
    time, short = lasts(effect, problem.data_summary), BRIEF * problem.data_summary.interval
    # Of a craft that shows no inertia, what takes time is that inertia.
    if time < short or (math.isfinite(time) and 1.0 < abs(fit.damping) * short):
        return True
    return time < problem.interval and answers_heading(problem, fit)


def answers_heading(problem: NoisyProblem, fit: NoisyFit) -> bool:
    """Return whether commands react to the disturbance just before them, because an operator or controller holds a
    course.

    Between two samples of the thinned runs, such commands react to disturbances that the filter has not yet processed.
    They then look delayed. The test is a rank correlation between innovations and the next changes of the commands.
    """
    pushed, turned = [], []
    for segment, (t, e, S) in zip(problem.segments, fit.innovations, strict=True):
        row = np.maximum(np.searchsorted(segment.t_in, t, side="right") - 1, 0)
        for name, column in zip(segment.input_names, segment.inputs.T, strict=True):
            for _, share in problem.form.inputs.get(name, ()):
                pushed.append((e / np.sqrt(S))[:-1])
                turned.append(np.diff(column[row]) * (-1.0 if str(share).startswith("-") else 1.0))
    one, two = np.concatenate(pushed), np.concatenate(turned)
    if len(one) < FEWEST_TO_COMPARE or not np.ptp(two) > 0.0:
        return False
    sense = math.copysign(1.0, fit.gain)
    return sense * float(scipy_stats().spearmanr(one, two).statistic) * math.sqrt(len(one)) < -AGAINST


def _as_likely(judged: Sequence[Score], winner: Score) -> list[Score]:
    """Return the candidates that these runs do not distinguish from *winner*.

    They explain the fitted runs as well, and also improve the held-out likelihood, even if it is not significant or the
    effect is too brief. Candidates that explain the fitted runs better are included too.
    """
    enough = winner.gained - 0.5 * ALIKE
    return [
        a
        for a in judged
        if a.gained > enough
        and (
            a.held_out_gain > MIN_HELD_OUT_GAIN
            or a.gained - a.fit.price(a.fit.unknowns - winner.fit.unknowns) > winner.gained
        )
    ]


def _rough(
    problem: NoisyProblem, present: NoisyFit, choices: Sequence[EffectInstance], tangent: Tangent
) -> NoisyFit | None:
    """Return the better of two rough fits, with everything else adapted.

    One starts at the most promising start values, the other at small amounts of them. A small amount changes the fit
    little and therefore looks promising. The full amount may first need another time constant.
    """
    entry = EFFECTS[choices[0].slug]
    growing = [n for n in entry.grows_with if n in choices[0].values]
    zero = {n: entry.neutral.get(n, 0.0) for n in growing}
    traces = [
        o.with_values({n: zero[n] + TRACE * (o.values[n] - zero[n]) for n in growing}) for o in choices if growing
    ]
    ends = []
    for group in (choices, traces):
        tried = [problem.adapted(present, own, tangent) for own in group]
        best = max((f for f in tried if f is not None), key=lambda f: f.total, default=None)
        end = None if best is None else problem.fit(best.theta, best.effects, best.noise, rounds=ROUGH)
        ends += [] if end is None else [end]
    return max(ends, key=lambda f: f.total, default=None)
