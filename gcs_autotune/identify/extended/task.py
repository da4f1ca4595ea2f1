"""One fit with effects: numbers packed into a vector, simulated, weighed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects import EFFECTS, STEP, DataSummary, EffectInstance, ExtendedSimulator, Leftover, horizon
from gcs_autotune.identify.coupled.objective import free_states
from gcs_autotune.identify.extended.fitted import Fitted, Rest
from gcs_autotune.identify.least_squares import Local
from gcs_autotune.identify.segment import Segment

if TYPE_CHECKING:
    from gcs_autotune.identify.extended.fitting import Problem

__all__ = ["Task", "judged_by", "typical_of"]

Array = NDArray[np.float64]

Left = tuple[list[Rest], list[Array], float]

REMEMBERED = 2
"""Places whose residuals are kept."""

REACH = 1.5
"""How far a shift of input stamps may go, in units of ``Segment.dating``: to the end of what the messages allow, and a
little beyond for an autopilot that acts on its next loop only."""


def judged_by(effects: Sequence[EffectInstance], left: Leftover, columns: Array) -> tuple[Array, Array, float]:
    """Return a residual (n,), its derivatives (n, k) and the penalty as all disturbances among *effects* leave them."""
    fee = 0.0
    for own in effects:
        if EFFECTS[own.slug].is_disturbance:
            error, columns, more = EFFECTS[own.slug].judge(own, left, columns)
            left, fee = replace(left, error=error), fee + more
    return left.error, columns, fee


def slack_of(dating: float) -> float:
    """Return the standard deviation [s] with which a shift is known to be none: it may well be all of *dating*."""
    return dating


def typical_of(own: EffectInstance, scene: DataSummary) -> dict[str, float]:
    """Return the size of each parameter of an effect: the largest of its starts, or of its value."""
    entry = EFFECTS[own.slug]
    starts = entry.starts(own.place, scene)
    sizes = {}
    for name in own.values:
        largest = max((abs(s.get(name, 0.0)) for s in starts), default=0.0)
        sizes[name] = max(largest, abs(own.values[name])) or 1.0
    return sizes


class Task:
    """One fit: packs numbers into a vector, simulates, weighs."""

    def __init__(
        self,
        problem: Problem,
        theta: Array,
        effects: tuple[EffectInstance, ...],
        initial: tuple[Array, ...],
        fixed_effects: bool,
        shift: float,
    ) -> None:
        self.problem, self.theta, self.effects, self.initial = problem, theta, effects, initial
        self.shift, self.dated = shift, problem.dating > 0.0
        self.levels: dict[str, float] = {}
        self._recent: dict[bytes, Left | None] = {}
        scene = problem.scene
        self.free_effects = tuple(
            (i, name)
            for i, own in enumerate(effects)
            for name in own.values
            if not fixed_effects and name not in EFFECTS[own.slug].fixed and not (EFFECTS[own.slug].is_disturbance)
            if (own.slug, own.place, name) not in problem.held
        )
        sizes = [typical_of(own, scene) for own in effects]
        typical = [sizes[i][name] for i, name in self.free_effects]
        self.places = [problem.form.parameters.index(n) for n in problem.free]
        self.simulators, self.columns, self.state_places = [], [], []
        used = len(self.places) + len(self.free_effects)
        self.shared = used
        by_names: dict[tuple[str, ...], ExtendedSimulator] = {}
        for segment in problem.segments:
            names = self._states(segment)
            if names not in by_names:
                by_names[names] = ExtendedSimulator(
                    problem.form, effects, problem.free, self.free_effects, names, typical
                )
            simulator = by_names[names]
            self.simulators.append(simulator)
            self.columns.append(np.r_[np.arange(self.shared), used + np.arange(len(names))])
            self.state_places.append([simulator.states.index(n) for n in names])
            used += len(names)
        self.size = used + self.dated
        if self.dated:
            self.columns = [np.r_[own, used] for own in self.columns]

    def _states(self, segment: Segment) -> tuple[str, ...]:
        form = ExtendedSimulator(self.problem.form, self.effects).form
        names = free_states(form, segment)
        return tuple(n for n in names if not n.startswith("lagged"))

    def pack(self) -> Array:
        """Return the vector (q,): base parameters, effects' parameters, initial states, shift of stamps."""
        own = [self.effects[i].values[n] for i, n in self.free_effects]
        states = [x_0[at] for x_0, at in zip(self.initial, self.state_places, strict=True)]
        return np.concatenate([self.theta[self.places], own, *states, [self.shift] if self.dated else []])

    def limits(self) -> tuple[Array, Array]:
        """Return the smallest and the largest vector allowed."""
        low, high = self.problem.edges(self.effects, self.free_effects)
        rest = np.full(self.size - self.shared, np.inf)
        if self.dated:
            rest[-1] = REACH * self.problem.dating
        return np.concatenate([low, -rest]), np.concatenate([high, rest])

    def unpack(self, x: Array) -> tuple[Array, tuple[EffectInstance, ...], list[Array], float]:
        """Undo :meth:`pack`."""
        p = len(self.places)
        theta = self.theta.copy()
        theta[self.places] = x[:p]
        values: list[dict[str, float]] = [{} for _ in self.effects]
        for (i, name), value in zip(self.free_effects, x[p : self.shared].tolist(), strict=True):
            values[i][name] = value
        effects = tuple(e.with_values(v) for e, v in zip(self.effects, values, strict=True))
        initial = []
        for x_0, at, columns in zip(self.initial, self.state_places, self.columns, strict=True):
            mine = x_0.copy()
            mine[at] = x[columns[self.shared : self.shared + len(at)]]
            initial.append(mine)
        return theta, effects, initial, float(x[-1]) if self.dated else 0.0

    def _at(self, x: Array) -> Left | None:
        """Return :meth:`rests` with sensitivities; a search ends at one of the last places it looked at."""
        key = x.tobytes()
        if key not in self._recent:
            while len(self._recent) >= REMEMBERED:
                del self._recent[next(iter(self._recent))]
            self._recent[key] = self.rests(x, sensitivities=True)
        return self._recent[key]

    def rests(self, x: Array, *, sensitivities: bool) -> Left | None:
        """Return what is left of every signal, Jacobians of the prediction (n, own columns), and penalties."""
        theta, effects, initial, shift = self.unpack(x)
        rests, tables, penalty = [], [], 0.0
        for i, segment in enumerate(self.problem.segments):
            simulator, passage = self.simulators[i], segment.passage_at(shift)
            found = simulator.run(theta, effects, initial[i], passage, sensitivities=sensitivities)
            if found is None:
                return None
            if sensitivities and self.dated:
                h = STEP * horizon(self.problem.scene)[1]  # a delay's own: the two must not look different
                later = simulator.run(theta, effects, initial[i], segment.passage_at(shift + h))
                if later is None:
                    return None
                found = {n: (y, np.column_stack([by, (later[n][0] - y) / h])) for n, (y, by) in found.items()}
            for name, signal in segment.signals.items():
                predicted, by = found[name]
                error = signal.values - predicted
                left = Leftover(segment.run, name, signal.t, error, signal.values, self._level(name))
                error, columns, fee = judged_by(effects, left, by)
                penalty += fee
                rests.append(Rest(i, name, signal.t, signal.values, predicted, error, fee))
                tables.append(columns)
        return rests, tables, penalty

    def _level(self, name: str) -> float:
        return self.levels.get(name, self.problem.scene.level.get(name, 1.0))

    def local(self, x: Array) -> Local | None:
        """Return cost, gradient and curvature at *x*; None when the motion runs away."""
        found = self._at(x)
        if found is None:
            return None
        rests, tables, cost = found
        sums, counts = self._sums(rests)
        gradient, curvature = np.zeros(self.size), np.zeros((self.size, self.size))
        if self.dated:
            weight = 1.0 / slack_of(self.problem.dating) ** 2
            cost += weight * x[-1] ** 2
            gradient[-1], curvature[-1, -1] = weight * x[-1], weight
        for name, total in sums.items():
            n, floor = counts[name], self.problem.floors[name]
            cost += n * np.log((total + n * floor**2) / n / floor**2)
        for rest, J in zip(rests, tables, strict=True):
            n, floor = counts[rest.signal], self.problem.floors[rest.signal]
            weight = n / (sums[rest.signal] + n * floor**2)
            good = np.isfinite(rest.judged)
            e, own = rest.judged[good], J[good]
            at = self.columns[rest.segment]
            gradient[at] -= weight * (own.T @ e)
            curvature[np.ix_(at, at)] += weight * (own.T @ own)
        if not np.isfinite(cost) or not np.all(np.isfinite(gradient)):
            return None
        return Local(float(cost), gradient, curvature)

    def _sums(self, rests: Sequence[Rest]) -> tuple[dict[str, float], dict[str, int]]:
        sums: dict[str, float] = {}
        counts: dict[str, int] = {}
        for rest in rests:
            good = rest.judged[np.isfinite(rest.judged)]
            sums[rest.signal] = sums.get(rest.signal, 0.0) + float(good @ good)
            counts[rest.signal] = counts.get(rest.signal, 0) + len(good)
        return sums, counts

    def learn(self, x: Array) -> None:
        """Let disturbances learn from what is left over."""
        theta, effects, initial, shift = self.unpack(x)
        plain = tuple(e for e in effects if not EFFECTS[e.slug].is_disturbance)
        task = Task(self.problem, theta, plain, tuple(initial), True, shift)
        found = task.rests(task.pack(), sensitivities=False)
        if found is None:
            return
        rests = found[0]
        sums, counts = self._sums(rests)
        levels = {n: max(float(np.sqrt(sums[n] / max(counts[n], 1))), self.problem.floors[n]) for n in sums}
        runs = self.problem.segments
        left = [Leftover(runs[r.segment].run, r.signal, r.t, r.judged, r.measured, levels[r.signal]) for r in rests]
        self.effects = tuple(EFFECTS[e.slug].learn(e, left) if EFFECTS[e.slug].is_disturbance else e for e in effects)
        self._recent.clear()
        self.theta, self.initial, self.shift, self.levels = theta, tuple(initial), shift, levels

    def fitted(self, x: Array, converged: bool) -> Fitted | None:
        """Return the fit that ended at *x*."""
        found = self._at(x)
        if found is None:
            return None
        rests, tables, cost = found
        sums, counts = self._sums(rests)
        floors = self.problem.floors
        levels = {n: float(np.sqrt(s / max(counts[n], 1) + floors[n] ** 2)) for n, s in sums.items()}
        cost += sum(counts[n] * np.log(levels[n] ** 2 / floors[n] ** 2) for n in sums)
        if self.dated:
            cost += (x[-1] / slack_of(self.problem.dating)) ** 2
        rows = []
        for rest, J in zip(rests, tables, strict=True):
            good = np.isfinite(rest.judged)
            wide = np.zeros((int(good.sum()), self.size))
            wide[:, self.columns[rest.segment]] = J[good] / levels[rest.signal]
            rows.append(wide)
        theta, effects, initial, shift = self.unpack(x)
        slack = slack_of(self.problem.dating)
        return Fitted(
            form=self.problem.form,
            theta=theta,
            effects=effects,
            initial=tuple(initial),
            cost=float(cost),
            levels=levels,
            rests=tuple(rests),
            free=self.problem.free,
            free_effects=self.free_effects,
            jacobian=np.vstack(rows),
            samples=sum(counts.values()),
            converged=converged,
            shift=shift,
            slack=slack,
        )
