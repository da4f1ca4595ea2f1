"""Select the effects that are promising enough for a fit, then fit them roughly and finally.

Each effect is tried at a few sizes, with the rest of the model adapted to first order. This takes one simulation per
effect, place and size. Everything that the model itself could adapt (parameters, initial states) is projected out of
the residual and of the effect's response. Their remaining correlation shows how promising the effect is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.diagnose.score import bic_penalty
from gcs_autotune.diagnose.undo_data_errors import turned
from gcs_autotune.effects import (
    EFFECTS,
    DataSummary,
    Effect,
    EffectInstance,
    EffectResidual,
    ExtendedSimulator,
    Observed,
    in_order,
)
from gcs_autotune.executor import Executor, SerialExecutor
from gcs_autotune.identify.problems import Fitted, Problem, judged_by
from gcs_autotune.kept_results import recalled

__all__ = [
    "ROUGH",
    "RUNNERS",
    "Attempt",
    "EffectCandidate",
    "best_of_each",
    "candidates",
    "fitted_roughly",
    "fitted_to_the_end",
    "screen",
]

Array = NDArray[np.float64]

Promise = tuple[int, EffectInstance, float, Array]
"""A promising start of a fit: index of the fit to start from, effect with its values, expected cost, first-order
parameter changes.
"""

ALSO = 2
"""Number of start values kept per effect, in addition to the most promising one."""

TRACE = 0.02
"""A small amount of an effect, relative to its trial size, at which the response is still proportional."""

LONGEST_SCALE = 4.0
"""Maximum size of a linear effect, relative to its trial size."""


@dataclass(frozen=True, slots=True)
class EffectCandidate:
    """An effect at a place, with start values, the fit to start from, and the expected cost.

    ``adapted`` (q,): first-order changes of the numbers of ``begin``, in the order of its Jacobian. ``also``: the next
    most promising values.
    """

    effect: EffectInstance
    begin: Fitted
    promised: float
    adapted: Array
    also: tuple[EffectInstance, ...] = ()


def candidates(
    data: DataSummary,
    present: Sequence[EffectInstance],
    slugs: Sequence[str],
    starts: Callable[[Effect, str], Sequence[Mapping[str, float]]] | None = None,
) -> list[list[EffectInstance]]:
    """Return start values for every effect and place that is not *present*.

    starts : values to use instead of the effect's own.
    """
    taken = {(e.slug, e.place) for e in present}
    choices = []
    for slug in slugs:
        entry = EFFECTS[slug]
        for place in entry.places(data):
            if (slug, place) in taken:
                continue
            constants = dict(entry.constants(place, data))
            own = entry.starts(place, data) if starts is None else starts(entry, place)
            choices.append([EffectInstance(slug, place, dict(s), constants) for s in own])
    return choices


def screen(
    problem: Problem,
    fits: Sequence[Fitted],
    others: Sequence[Fitted],
    choices: Sequence[Sequence[EffectInstance]],
    progress: Callable[[int, int], None] | None = None,
    executor: Executor | None = None,
) -> list[EffectCandidate]:
    """Return the most promising start of each effect and place, the best first.

    fits : possible starting fits, the present model first. others : further starting fits, for errors of the records
    only.
    """
    grounds = [_TangentSpace(problem, fitted) for fitted in (*fits, *others)]
    known = [problem, *((f.theta, f.effects, f.initial, f.shift) for f in (*fits, *others))]

    best_of = partial(_best_of, grounds, known, len(fits))
    listed = []
    for best in (executor or SerialExecutor()).map(best_of, choices, progress):
        if best:
            k, own, promised, adapted = best[0]
            begin = _begun(problem, grounds[k].fitted, own)
            listed.append(EffectCandidate(own, begin, promised, adapted, tuple(other[1] for other in best[1:])))
    return sorted(listed, key=lambda c: c.promised)


def _best_of(
    grounds: Sequence[_TangentSpace], known: Sequence[object], begun: int, choice: Sequence[EffectInstance]
) -> list[Promise]:
    """Return the best starts of one *choice*, the most promising first.

    Effects of the record are tried from all *grounds*, other effects from the first *begun* only.

    known : what the grounds were made of; it identifies a cached result.
    """
    entry = EFFECTS[choice[0].slug]

    def calculated() -> list[Promise]:
        likely = []
        for k, ground in enumerate(grounds if entry.family == "data errors" else grounds[:begun]):
            promises = (ground.promise(entry, own) for own in choice)
            likely += [(k, p.effect, p.promised, p.adapted) for p in promises if p is not None]
        return sorted(likely, key=lambda f: f[2])[: 1 + ALSO]

    return recalled(
        lambda: ("promise", *known, begun, [e.to_dict() for e in choice]),
        calculated,
        lambda likely: [(k, own.to_dict(), promised, adapted.tolist()) for k, own, promised, adapted in likely],
        lambda kept: [(int(k), EffectInstance(**own), float(p), np.array(a, float)) for k, own, p, a in kept],
    )


class _TangentSpace:
    """A fit and the directions in which its own numbers can move the prediction."""

    def __init__(self, problem: Problem, fitted: Fitted) -> None:
        self.problem, self.fitted = problem, fitted
        moves = fitted.jacobian.copy()
        if fitted.shift_std:
            moves[:, -1] = 0.0  # a shift of stamps looks like a delay, but may only be small: what is left of it counts
        norms = np.linalg.norm(moves, axis=0)
        scaled = moves / np.where(norms > 0.0, norms, 1.0)
        U, s, V = np.linalg.svd(scaled, full_matrices=False)
        kept = s > 1e-8 * s[0]
        self.Q = U[:, kept]
        self.back = (V[kept].T / s[kept]) / np.where(norms > 0.0, norms, 1.0)[:, None]
        self.residual = fitted.residual
        self.free = self._rest(self.residual)
        self.slices = self._slices()
        self.truths: dict[int, Observed | None] = {}
        self.traced: set[tuple[object, ...]] = set()

    def _slices(self) -> list[tuple[str, slice]]:
        slices, at = [], 0
        for rest in self.fitted.rests:
            n = int(np.isfinite(rest.judged).sum())
            slices.append((rest.signal, slice(at, at + n)))
            at += n
        return slices

    def _rest(self, r: Array) -> Array:
        left: Array = r - self.Q @ (self.Q.T @ r)
        return left

    def cost(self, r: Array) -> float:
        """Return minus twice the log-likelihood of a residual in units of the noise standard deviations of the fit."""
        sums: dict[str, float] = {}
        counts: dict[str, int] = {}
        for name, part in self.slices:
            sums[name] = sums.get(name, 0.0) + float(r[part] @ r[part])
            counts[name] = counts.get(name, 0) + part.stop - part.start
        total = 0.0
        for name, s in sums.items():
            n, level, floor = counts[name], self.fitted.levels[name], self.problem.floors[name]
            total += n * np.log((s * level**2 + n * floor**2) / n / floor**2)
        return float(total)

    def promise(self, entry: Effect, own: EffectInstance) -> EffectCandidate | None:
        """Return the expected gain from adding *own*; return None if the motion diverges with it.

        The effect is tried at its own size. If it grows with its numbers, it is also tried at the size that fits the
        residual best. That size is extrapolated from the full size and from a small amount (the score test).
        """
        if entry.is_disturbance:
            return self._learnt(own)
        begin = _begun(self.problem, self.fitted, own)
        return (self if begin is self.fitted else _TangentSpace(self.problem, begin))._from_here(entry, own)

    def _from_here(self, entry: Effect, own: EffectInstance) -> EffectCandidate | None:
        changed = self._residual_with(own)
        best = None if changed is None else self._promised(own, changed)
        growing = tuple(n for n in entry.grows_with if n in own.values)
        rest = (own.slug, own.place, *(v for n, v in own.values.items() if n not in growing))
        shares = (1.0, TRACE) if growing and rest not in self.traced else (1.0,) if growing else ()
        self.traced.add(rest)
        for share in shares:
            some = _grown(entry, own, growing, share)
            moved = changed if share == 1.0 else self._residual_with(some)
            if moved is None:
                continue
            scale, left = self._scaled(entry, some, moved, LONGEST_SCALE / share)
            sized = _grown(entry, some, growing, scale)
            other = self._promised(sized, left)
            if scale != 0.0 and (best is None or other.promised < best.promised):
                best = other
        return best

    def _promised(self, own: EffectInstance, left: Array) -> EffectCandidate:
        return EffectCandidate(own, self.fitted, self.cost(self._rest(left)), self.back @ (self.Q.T @ left))

    def _scaled(self, entry: Effect, own: EffectInstance, changed: Array, most: float) -> tuple[float, Array]:
        """Return the factor at which *own* fits the residual best, and the residual at that factor."""
        moved = self._rest(self.residual - changed)
        power = float(moved @ moved)
        if power <= 0.0:
            return 0.0, self.residual
        least = -most if _two_sided(entry, own, self) else 0.0
        scale = float(np.clip(float(moved @ self.free) / power, least, most))
        return scale, self.residual - scale * (self.residual - changed)

    def _learnt(self, own: EffectInstance) -> EffectCandidate | None:
        now = self.fitted
        tried = self.problem.fit(now.theta, (*now.effects, own), now.initial, trials=1, shift=now.shift)
        return (
            None
            if tried is None
            else EffectCandidate(tried.own(own), self.fitted, tried.cost, np.zeros(len(self.back)))
        )

    def _residual_with(self, own: EffectInstance) -> Array | None:
        effects = in_order((*self.fitted.effects, own))
        simulator = ExtendedSimulator(self.problem.form, effects)
        rows = []
        at = 0
        for i, segment in enumerate(self.problem.segments):
            predicted = self._predicted(simulator, effects, own, i)
            if predicted is None:
                return None
            for name in segment.signals:
                rest = self.fitted.rests[at]
                at += 1
                level = self.fitted.levels[name]
                error = rest.measured - predicted[name]
                left = EffectResidual(segment.run, name, rest.t, error, rest.measured, level)
                error, _, _ = judged_by(self.fitted.effects, left, np.empty((len(error), 0)))
                rows.append(error[np.isfinite(rest.judged)] / level)
        joined = np.concatenate(rows)
        return joined if np.all(np.isfinite(joined)) else None

    def _predicted(
        self, simulator: ExtendedSimulator, effects: tuple[EffectInstance, ...], own: EffectInstance, i: int
    ) -> Mapping[str, Array] | None:
        """Return the predicted signals of a segment with *own* among the effects.

        An effect that acts only on sensors needs no new simulation.
        """
        passage, initial = self.problem.segments[i].passage_at(self.fitted.shift), self.fitted.initial[i]
        if EFFECTS[own.slug].acts_on - {"sensors"}:
            simulated = simulator.run(self.fitted.theta, effects, initial, passage)
            return None if simulated is None else {n: y for n, (y, _) in simulated.items()}
        if i not in self.truths:
            alone = ExtendedSimulator(self.problem.form, self.fitted.effects)
            self.truths[i] = alone.truth(self.fitted.theta, self.fitted.effects, initial, passage)
        truth = self.truths[i]
        return None if truth is None else simulator.seen(effects, truth, passage)


def _begun(problem: Problem, fitted: Fitted, own: EffectInstance) -> Fitted:
    """Return the fit that *own* is added to.

    It differs from *fitted* only in whole turns of the initial heading, if *own* changes how the heading is read.
    """
    initial = turned(own, problem.form, problem.segments, fitted.initial)
    same = all(new is old for new, old in zip(initial, fitted.initial, strict=True))
    return fitted if same else replace(fitted, initial=initial)


def _grown(entry: Effect, own: EffectInstance, growing: Sequence[str], share: float) -> EffectInstance:
    """Return an effect whose distance from no effect is scaled by a factor."""
    zero = {n: entry.neutral.get(n, 0.0) for n in growing}
    return own.with_values({n: zero[n] + share * (own.values[n] - zero[n]) for n in growing})


def _two_sided(entry: Effect, own: EffectInstance, ground: _TangentSpace) -> bool:
    """Return whether the numbers of an effect may have either sign."""
    bounds = entry.bounds(own.place, ground.problem.data_summary)
    growing = [n for n in entry.grows_with if n in own.values]
    return bool(growing) and all(bounds.get(n, (-np.inf, np.inf))[0] < entry.neutral.get(n, 0.0) for n in growing)


Attempt = tuple[EffectCandidate, Fitted]

ROUGH = 8
"""Maximum number of iterations of a rough fit. Project choice."""

SETTLING = 30
"""Maximum number of iterations of a final fit. Project choice."""

RUNNERS = 5
"""Number of candidates per step that are fitted to convergence."""

MOMENTS, FEW = 6, 3
"""MOMENTS: number of times tried before and after the estimated time of an effect. FEW: iterations of each of these
fits."""


def best_of_each(attempts: Sequence[Attempt], present: Fitted) -> list[Attempt]:
    """Return the best of several fits for each effect and place, the best first."""
    best: dict[tuple[str, str], Attempt] = {}
    for candidate, fit in sorted(attempts, key=lambda f: f[1].cost + bic_penalty(f[1], present)):
        best.setdefault((candidate.effect.slug, candidate.effect.place), (candidate, fit))
    return list(best.values())


def fitted_roughly(problem: Problem, candidate: EffectCandidate) -> Fitted | None:
    """Return a rough fit, started at the model adapted to first order; return None if the motion diverges.

    If it diverges from there, the fit starts at the unadapted model. If the fit is no better than without the effect,
    other values of the effect are tried.
    """
    begin, fit = candidate.begin, problem.fit
    theta, effects, initial = problem.moved(begin, candidate.adapted)
    fitted = fit(theta, (*effects, candidate.effect), initial, trials=ROUGH, shift=begin.shift)
    if fitted is None or fitted.cost > begin.cost:
        for own in (candidate.effect, *candidate.also):
            again = fit(begin.theta, (*begin.effects, own), begin.initial, trials=ROUGH, shift=begin.shift)
            fitted = again if fitted is None or (again is not None and again.cost < fitted.cost) else fitted
            if fitted is not None and fitted.cost <= begin.cost:
                break
    return fitted


def fitted_to_the_end(problem: Problem, candidate: EffectCandidate, rough: Fitted) -> Fitted:
    """Return the fit of a candidate continued to convergence.

    The cost has many local minima for effects that act on commands, for effects that depend on a place or direction,
    and for effects that happen at one time. Other start values, or times near the estimated one, are then tried too.
    """
    best, entry = rough, EFFECTS[candidate.effect.slug]
    located = _has_location(candidate.effect)
    if located or ("commands" in entry.acts_on and candidate.effect.values):
        for own in candidate.also:
            effects = _replaced(rough.effects, own)
            trials = SETTLING if located else ROUGH
            other = problem.fit(rough.theta, effects, rough.initial, trials=trials, shift=rough.shift)
            best = other if other is not None and other.cost < best.cost else best
    best = _settled(problem, best)
    for name in EFFECTS[candidate.effect.slug].happens_at:
        best = _at_another_moment(problem, candidate.effect, name, best)
    if any(EFFECTS[e.slug].is_rounding for e in best.effects):
        again = problem.fit(best.theta, best.effects, best.initial, trials=1, shift=best.shift)
        best = again if again is not None and again.cost < best.cost else best
    return best


def _has_location(effect: EffectInstance) -> bool:
    """Return whether an effect of the surroundings has a place or direction, so that the cost has several deep minima.

    For example, walls on two sides of the track can fit the runs about equally well. Only the true one predicts another
    run. A rough fit is too short to compare the minima.
    """
    entry = EFFECTS[effect.slug]
    return entry.family == "environment" and not entry.is_disturbance and set(effect.values) > set(entry.grows_with)


def _settled(problem: Problem, best: Fitted) -> Fitted:
    fit = problem.fit(best.theta, best.effects, best.initial, trials=SETTLING, learn=False, shift=best.shift)
    return fit if fit is not None and fit.cost <= best.cost else best


def _at_another_moment(problem: Problem, own: EffectInstance, name: str, best: Fitted) -> Fitted:
    """Return the best fit with the time *name* of an effect shifted by multiples of the craft's time constant."""
    now = best.own(own)
    others = []
    for k in range(1, MOMENTS + 1):
        for moment in (
            now[name] - k * problem.data_summary.time_constant,
            now[name] + k * problem.data_summary.time_constant,
        ):
            effects = _replaced(best.effects, now.with_values({name: moment}))
            fit = problem.fit(best.theta, effects, best.initial, trials=FEW, learn=False, shift=best.shift)
            others += [] if fit is None else [fit]
    other = min(others, key=lambda f: f.cost, default=best)
    return _settled(problem, other) if other.cost < best.cost else best


def _replaced(effects: Sequence[EffectInstance], own: EffectInstance) -> tuple[EffectInstance, ...]:
    """Return *effects* with *own* in place of the effect with the same slug and place."""
    return tuple(own if (e.slug, e.place) == (own.slug, own.place) else e for e in effects)
