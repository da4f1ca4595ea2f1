"""Search for causes with process noise modelled, in one degree of freedom.

Wind and wakes push a craft. In a free simulation their effects add up, so that no model follows the record and all
candidates look alike. Here they are part of the model (:class:`.NoisyProblem`), as a force whose size and time constant
are fitted. Each sample is predicted from the samples before it. A candidate is fitted to all runs, and again with each
run (or block of one) left out in turn. It must improve the likelihood in both cases.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gcs_autotune.clock import OutOfTime
from gcs_autotune.diagnose.heldout_score import Folds, gains_ahead, unseen_of
from gcs_autotune.diagnose.noise_scorer import WithProcessNoise, choices_of
from gcs_autotune.diagnose.process_noise_starts import Say, at_the_right_interval, momentary, plain_with_process_noise
from gcs_autotune.diagnose.result import ErrorReduction, Value
from gcs_autotune.diagnose.run_to_run import differing
from gcs_autotune.diagnose.sampling_interval import OF_THE_COMMAND, changes_at, commanded
from gcs_autotune.diagnose.score import FAR_MORE, MIN_HELD_OUT_GAIN, CandidateScore, SearchStep, key_of, may_be_none
from gcs_autotune.diagnose.search import add_one_by_one, fits_of, judge
from gcs_autotune.effects import EFFECTS, INPUT, EffectInstance, name_of
from gcs_autotune.identify.kalman import NoisyFit, NoisyProblem, thinned_to
from gcs_autotune.identify.problems import Fitted, Problem
from gcs_autotune.identify.signals import Segment
from gcs_autotune.models import Form
from gcs_autotune.sname import DOFS

__all__ = [
    "CONSTANT",
    "PRESENT",
    "NoiseSearch",
    "above_the_command",
    "form_alone",
    "noise_equation",
    "scaled",
    "search_with_process_noise",
    "supported",
]

PRESENT = 8.0
"""Log-likelihood that a drifting force, together with waves, must gain to be accepted."""

CONSTANT = ("input-bias", "net-buoyancy")
"""Slugs of the effects that are a constant force."""

SHRUNK = 0.3
"""Factor on size and time constant of the process noise, at the start of a fit with a constant force added."""

FOLLOWED = 2
"""Number of candidates to which a second cause is added if none is accepted alone."""

MOST_CAUSES = 4
MOST_BLOCKS = 4


@dataclass(frozen=True, slots=True, eq=False)
class NoiseSearch:
    """Result of a search with process noise.

    ``plain``: the model without any cause. ``fit``: the model with the accepted causes. ``steps``: every candidate that
    was fitted to convergence. ``calm``: log-likelihood gained by the drifting force and waves. ``still``:
    log-likelihood gained by them with the accepted causes; inf if the search was stopped before. ``cut``: where it was
    stopped, in words. ``words``: what was left out in turn.
    """

    problem: NoisyProblem
    dof: str
    plain: NoisyFit
    fit: NoisyFit
    steps: tuple[SearchStep[NoisyFit], ...]
    calm: float
    tried: int
    words: str
    folds: Folds
    still: float = math.inf
    cut: tuple[str, ...] = ()
    hint: NoisyFit | None = None
    """A fit with one cause, used as an additional start; None if there is none."""
    whole: Problem | None = None
    """The supplied runs with the base model's form and units."""
    refused: tuple[CandidateScore[NoisyFit], ...] = ()
    """Causes that were accepted first and later rejected by :func:`supported`."""
    own_gains: Mapping[tuple[str, str], ErrorReduction] = field(default_factory=dict)
    """Held-out gain of each cause over the model without it."""
    interval: str = ""
    """Description of how the result changes with the sampling interval of the thinned runs; empty if it does not."""

    @property
    def accepted(self) -> tuple[CandidateScore[NoisyFit], ...]:
        """Accepted causes, in the order in which they were accepted."""
        causes: dict[tuple[str, str], CandidateScore[NoisyFit]] = {}
        for one in (s.accepted for s in self.steps if s.accepted is not None):
            causes.pop(key_of(one.effect), None)  # accepted again, it was not before
            causes[key_of(one.effect)] = one
        there = {key_of(e) for e in self.fit.effects}
        return tuple(one for key, one in causes.items() if key in there)

    def alike(self, order: Sequence[EffectInstance] = ()) -> tuple[tuple[str, ...], ...]:
        """Return groups of causes that these runs do not distinguish; each starts with an accepted cause."""
        known = self.accepted
        return tuple(s.alike for s in self.steps if len(s.alike) > 1 and s.accepted in known)

    @property
    def names(self) -> set[str]:
        """Names of the accepted causes, and of the causes that these runs do not distinguish from them."""
        return {name for group in self.alike() for name in group} | {name_of(a.effect) for a in self.accepted}

    def stopped(self, over: OutOfTime) -> NoiseSearch:
        """Return the search so far, marked as stopped by the limit that *over* reports."""
        return replace(self, cut=(*self.cut, str(over)))

    @property
    def inertia(self) -> float:
        """Inertia of the model in the base model's units; its own equation is per unit of inertia."""
        d, gain = DOFS[self.dof], self.fit.gain
        for pairs in () if self.whole is None else self.whole.form.inputs.values():
            for force, share in pairs:
                if force == d.force and not isinstance(share, str):
                    return abs(share) / gain if abs(gain) > 1e-12 else math.copysign(1e12, gain)
        return 1.0

    def in_base_units(self, effect: EffectInstance) -> EffectInstance:
        """Convert an effect of this search to the base model's units."""
        return scaled(effect, self.inertia, math.copysign(1.0, self.inertia))

    def values(self, effect: EffectInstance, fit: NoisyFit | None = None) -> dict[str, Value]:
        """Return the numbers of an effect in the base model's units.

        fit : the fit to read them from; None: the fit with all causes.
        """
        assert self.whole is not None
        fit = self.fit if fit is None else fit
        here, errors, numbers = fit.own(effect), fit.errors_of(effect), {}
        for name, value in self.in_base_units(here).values.items():
            std = errors.get(name, math.nan)
            unit = EFFECTS[here.slug].unit_of(name, here.place, self.whole.data_summary)
            numbers[name] = Value(value, unit, std * abs(value / here.values[name]) if here.values[name] else std)
        return numbers

    def shares(self, order: Sequence[EffectInstance]) -> dict[tuple[str, str], float]:
        """Return for each cause the relative reduction of the drifting force's variance."""
        shares, before = {}, self.plain
        first = before.noise.size
        for a in self.accepted:
            drop = (before.noise.size**2 - a.fit.noise.size**2) / first**2
            shares[key_of(a.effect)] = float(np.clip(drop, 0.0, 1.0))
            before = a.fit
        return shares

    def gain_over(self, other: NoisyFit) -> ErrorReduction | None:
        """Return the held-out error ahead of *other* and of the model with all causes; None if unknown.

        The horizon is the one of :func:`.horizons` with the larger reduction.
        """
        before, after = (unseen_of(self.problem, self.plain, self.folds, fit) for fit in (other, self.fit))
        gains = gains_ahead(self.problem, self.plain, self.folds, before, after, self.words)
        return min((gain for _, gain in gains), key=lambda g: g.ratio, default=None)

    def gains(self, order: Sequence[EffectInstance]) -> tuple[ErrorReduction, ...]:
        """Return the held-out error some seconds ahead, without causes and with all causes."""
        if len(order) < 2:  # of a single cause what it gains is known
            return tuple(self.own_gains.values())[: len(order)]
        gain = self.gain_over(self.plain)
        return () if gain is None else (gain,)

    def gains_of_each(
        self, order: Sequence[EffectInstance], gains: Sequence[ErrorReduction]
    ) -> Mapping[tuple[str, str], ErrorReduction]:
        """Return the held-out gain of each cause over the model without it."""
        return self.own_gains

    @property
    def momentary(self) -> bool:
        """Whether the drifting force has too short a time constant to be a disturbance."""
        return momentary(self.problem, self.plain)


def form_alone(form: Form, dof: str) -> Form | None:
    """Return the equation of *dof* alone, per unit of its inertia.

    Return None if it is not an uncoupled equation with linear damping, or if no input drives it.
    """
    d = DOFS[dof]
    gain = f"k_{d.force}"
    inputs: dict[str, tuple[tuple[str, float | str], ...]] = {}
    for channel, pairs in form.inputs.items():
        for force, share in pairs:
            if force == d.force:
                sign = share < 0.0 if not isinstance(share, str) else share.startswith("-")
                inputs[channel] = ((d.force, f"-{gain}" if sign else gain),)
    damping = f"{d.force}_{d.velocity}"
    if not inputs or form.coriolis or damping not in form.parameters:
        return None
    rigid = {"u": "m", "v": "m", "w": "m", "p": "I_x", "q": "I_y", "r": "I_z"}[d.velocity]
    title = f"model of {dof} alone, per unit of inertia"
    free = (gain, damping)
    return Form("plain", title, (dof,), free, {rigid: 1.0}, inputs, coriolis=False, per_inertia=(d.force,))


def noise_equation(problem: Problem) -> tuple[Form, str] | None:
    """Return the equation that a search with process noise uses, and its signal; None if there is none."""
    dof = "yaw" if "yaw" in problem.form.dofs else problem.form.dofs[0]
    form = form_alone(problem.form, dof)
    d = DOFS[dof]
    signal = next((n for n in (d.position, d.velocity) if any(n in s.signals for s in problem.segments)), None)
    return None if form is None or signal is None else (form, signal)


def search_with_process_noise(
    problem: Problem,
    base: Fitted,
    slugs: Sequence[str],
    unseen: Sequence[Segment],
    say: Say,
    *,
    in_blocks: bool = False,
) -> NoiseSearch | None:
    """Search for causes in one degree of freedom: yaw if the model has it, otherwise the first.

    Return None if that is impossible, or if no model of the craft with process noise is found.

    problem, base : the plain model from the usual fit, as a start. slugs : effects to try. unseen : separate runs, used
    only for scoring. in_blocks : leave out blocks of every run in turn instead of whole runs.
    """
    equation = noise_equation(problem)
    begun = None if equation is None else plain_with_process_noise(problem, base, *equation, say)
    hint, by_interval = None, ""
    if equation is not None and begun is not None and not momentary(*begun):
        begun, hint, by_interval = at_the_right_interval(problem, *equation, begun, slugs, say)
    if equation is None or begun is None:
        return None
    (form, signal), (noisy, plain) = equation, begun
    dof = form.dofs[0]
    held = thinned_to(unseen, signal, noisy.interval)
    calm = _over_constants(noisy, plain)
    folds, words = _folds(noisy.segments, held, in_blocks=in_blocks)
    search = NoiseSearch(noisy, dof, plain, plain, (), calm, 0, words, folds, still=calm)
    search = replace(search, hint=hint, interval=by_interval, whole=problem)
    if calm < PRESENT or search.momentary:
        return search
    try:
        search = _with_constant(search, slugs)
        if search.accepted:
            search = replace(search, still=_over_constants(noisy, search.fit))
        most = MOST_CAUSES + len(search.steps)
        search = add_one_by_one(
            search, most, lambda now: _one_more(now, slugs, say), lambda now: _reconsidered(now, slugs, say)
        )
        if search.accepted and not search.cut:
            wider = noisy.on(thinned_to(problem.segments, signal, 2.0 * noisy.interval))
            changes = changes_at(noisy, search.fit, wider)
            search = replace(search, interval="; ".join(filter(None, (by_interval, *changes))))
    except OutOfTime as over:
        search = search.stopped(over)
    return search


def _reconsidered(search: NoiseSearch, slugs: Sequence[str], say: Say) -> NoiseSearch:
    """Reconsider the earlier causes, and calculate the gain of the drifting force beside the remaining ones."""
    search = _without_idle(_curve_for_constant(search, slugs, say))
    return replace(search, still=_over_constants(search.problem, search.fit))


def _curve_for_constant(search: NoiseSearch, slugs: Sequence[str], say: Say) -> NoiseSearch:
    """Let a structural effect replace the constant force, if the runs support it more.

    The constant was tried first. A craft that only moves ahead uses one side of its curves of thrust and drag, and the
    tangent of a curve has a constant. Once one of the two curves is known, the other can be found in its place.
    """
    constant = next((a.effect for a in search.accepted[:-1] if a.effect.slug in CONSTANT), None)
    if constant is None:
        return search
    rest, noises = search.fit.without(constant), (search.fit.noise, search.plain.noise)
    fits = [search.problem.fit(search.fit.theta, rest, noise) for noise in noises]
    without = max((f for f in fits if f is not None), key=lambda f: f.total, default=None)
    if without is None:
        return search
    structural = [s for s in slugs if EFFECTS[s].is_structural]
    choices = choices_of(search.problem.data_summary, structural, without.effects)
    scorer = _scorer_of(search, without, max(search.tried, len(choices)), say)
    ends = []
    for own, fit in fits_of(scorer, choices):  # without the constant the other values may have moved far
        again = search.problem.fit(search.fit.theta, (*rest, own), search.fit.noise)
        ends.append((own, again if again is not None and again.total > fit.total else fit))
    step = judge(scorer, ends)
    won = step.accepted
    if won is None or won.fit.total - won.fit.price(won.fit.unknowns - search.fit.unknowns) <= search.fit.total:
        return search
    return replace(search, fit=won.fit, steps=(*search.steps, step))


def _without_idle(search: NoiseSearch) -> NoiseSearch:
    """Return the search without the causes that explain nothing once the last one is present.

    Example: on a stock sub, quadratic drag was found after thrust that falls with speed and explained the same. Of the
    latter, 0.149 +- 0.2 remained.
    """
    for cause in search.accepted[:-1]:
        rest = search.fit.without(cause.effect)
        without = search.problem.fit(search.fit.theta, rest, search.fit.noise)
        if without is not None and search.fit.total - without.total < MIN_HELD_OUT_GAIN:
            search = replace(search, fit=without)
    return search


def supported(search: NoiseSearch) -> NoiseSearch:
    """Return the search without unsupported causes, and with the held-out gains of the others.

    A cause is rejected if its 95 % interval includes no effect once later causes are present. It is also rejected if it
    does not reduce the held-out error ahead. The weakest cause is removed first, because another cause may seem to help
    only in its presence. All causes are rejected if the drifting force exceeds the commanded force.
    """
    refused: list[CandidateScore[NoisyFit]] = []
    while True:
        own: dict[tuple[str, str], ErrorReduction] = {}
        weakest: tuple[float, CandidateScore[NoisyFit], NoisyFit] | None = None
        for cause in search.accepted:
            who = key_of(cause.effect)
            rest = tuple(e for e in search.fit.effects if key_of(e) != who)
            alone = search.plain if len(search.accepted) == 1 else None
            without = alone or search.problem.fit(search.fit.theta, rest, search.fit.noise)
            if without is None:
                continue
            gain = search.gain_over(without)
            if gain is not None:
                own[who] = gain
            ratio = math.inf if _is_none(cause, search.fit) else 0.0 if gain is None else gain.ratio
            if ratio >= 1.0 and (weakest is None or ratio > weakest[0]):
                weakest = ratio, cause, without
        if weakest is None and search.accepted and above_the_command(search) > OF_THE_COMMAND:
            refused += [replace(cause, lacks="no-model") for cause in search.accepted]
            return replace(search, fit=search.plain, refused=tuple(refused))
        if weakest is None:
            return replace(search, refused=tuple(refused), own_gains=own)
        _, cause, without = weakest
        refused.append(replace(cause, lacks="uncertain" if _is_none(cause, search.fit) else "no-gain"))
        search = replace(search, fit=without)


def _is_none(cause: CandidateScore[NoisyFit], fit: NoisyFit) -> bool:
    """Return whether the 95 % interval of a cause's numbers in *fit* includes zero effect."""
    now = next(e for e in fit.effects if key_of(e) == key_of(cause.effect))
    return may_be_none(now, fit.errors_of(now))


def above_the_command(search: NoiseSearch) -> float:
    """Return the size of the drifting force relative to the commanded force, both rms; 0 without commands."""
    reach = abs(search.fit.gain) * commanded(search.problem)
    return search.fit.noise.size / reach if reach > 0.0 else 0.0


def scaled(effect: EffectInstance, factor: float, sense: float) -> EffectInstance:
    """Return an effect with its forces multiplied by *factor*."""
    entry = EFFECTS[effect.slug]
    if "motion" not in entry.acts_on:
        return effect
    forces = [q.name for q in entry.parameters if q.unit == INPUT or q.unit.startswith(("force", "moment"))]
    by = abs(factor) if "sense" in effect.constants else factor
    constants = {**effect.constants, **({"sense": sense} if "sense" in effect.constants else {})}
    values = {n: v * by if n in forces else v for n, v in effect.values.items()}
    return EffectInstance(effect.slug, effect.place, values, constants)


def _over_constants(problem: NoisyProblem, fit: NoisyFit) -> float:
    """Return the log-likelihood gained by the noise and waves of *fit* over simpler models of the disturbance.

    The simpler models are no force, one constant force, and a constant force for each run. A drifting force with a long
    time constant is nearly a constant. The noisy model may have a constant force too, at the cost of one parameter
    (Schwarz). Return inf if none of the simpler models can be evaluated.
    """
    still = fit.noise.still
    constants = _constants(problem, fit)
    laws = [(fit.effects, still), *[((*fit.effects, own), still) for own in constants]]
    if problem.runs > 1:
        laws.append((fit.effects, replace(still, day_force=max(fit.noise.size, fit.noise.day_force))))
    best = -math.inf
    for effects, noise in laws:
        if problem.fit(fit.theta, effects, noise, rounds=0) is None:
            continue
        fits = [problem.fit(fit.theta, effects, replace(noise, sensor=noise.sensor * k)) for k in (1.0, 10.0)]
        best = max(
            [best, *[f.total - f.price(len(f.free_effects) - len(fit.free_effects)) for f in fits if f is not None]]
        )
    noisy = [f for own in constants if (f := _beside(problem, fit, own)) is not None]
    return max([fit.total, *[f.total - f.price(len(f.free_effects) - len(fit.free_effects)) for f in noisy]]) - best


def _beside(problem: NoisyProblem, fit: NoisyFit, own: EffectInstance) -> NoisyFit | None:
    """Refit *fit* with a constant force, also from smaller process noise with a shorter time constant."""
    shorter = replace(fit.noise, size=SHRUNK * fit.noise.size, memory=SHRUNK * fit.noise.memory)
    tries = [problem.fit(fit.theta, (*fit.effects, own), noise) for noise in (fit.noise, shorter)]
    return max((f for f in tries if f is not None), key=lambda f: f.total, default=None)


def _constants(problem: NoisyProblem, fit: NoisyFit) -> list[EffectInstance]:
    """Return start values of the constant force in this degree of freedom; empty if *fit* has one."""
    dof = problem.form.dofs[0]
    present = {(e.slug, e.place) for e in fit.effects}
    return [
        EffectInstance(slug, dof, dict(EFFECTS[slug].starts(dof, problem.data_summary)[0]))
        for slug in CONSTANT
        if (slug, dof) not in present and dof in EFFECTS[slug].places(problem.data_summary)
    ]


def _with_constant(search: NoiseSearch, slugs: Sequence[str]) -> NoiseSearch:
    """Return the search with a constant force as a cause, if it is supported with process noise; otherwise unchanged.

    A constant and a drifting force are nested models, and a drifting force can approximate a constant. The constant is
    therefore tried before any other cause, and as a single trial.
    """
    problem = search.problem
    offered = [e for e in _constants(problem, search.plain) if e.slug in slugs]
    plain = differing(problem, search.plain) if offered else search.plain
    for own in offered:
        fit = _beside(problem, plain, own)
        if fit is None:
            continue
        scorer = _scorer_of(search, plain, 1, lambda *_: None)
        score = replace(scorer, left_out=scorer.unseen(plain)).score(own, fit)
        if score.lacks is None:
            search = replace(search, steps=(SearchStep(plain, (score,), score),), fit=fit)
    return search


def _scorer_of(search: NoiseSearch, present: NoisyFit, tried: int, say: Say) -> WithProcessNoise:
    stage, hint = f"process noise, cause {len(search.accepted) + 1}", None if search.accepted else search.hint
    return WithProcessNoise(search.problem, search.folds, search.plain, present, tried, say, stage, hint)


def _one_more(search: NoiseSearch, slugs: Sequence[str], say: Say) -> NoiseSearch:
    """Return the search after one more step."""
    present = differing(search.problem, search.fit)
    choices = choices_of(search.problem.data_summary, slugs, present.effects)
    scorer = _scorer_of(search, present, max(search.tried, len(choices)), say)
    step = judge(scorer, fits_of(scorer, choices))
    if step.accepted is None:
        pair = _pair(replace(search, tried=scorer.tried), step, slugs, say)
        if pair is not None:
            return pair
    return replace(
        search,
        tried=scorer.tried,
        plain=search.plain if search.accepted else step.present,
        fit=step.present if step.accepted is None else step.accepted.fit,
        still=search.still if step.accepted is None else math.inf,
        steps=(*search.steps, step),
    )


def _pair(search: NoiseSearch, step: SearchStep[NoisyFit], slugs: Sequence[str], say: Say) -> NoiseSearch | None:
    """Return the search with two causes that improve held-out prediction together; None if the best pair does not.

    step : the one in which no cause was accepted. A drifting force takes what a second cause leaves, so a single cause
    may improve the fitted runs only. Beside other causes it must improve these far more.
    """
    data, present = search.problem.data_summary, step.present
    scorer = _scorer_of(search, present, math.comb(search.tried, 2), say)
    pairs: list[tuple[CandidateScore[NoisyFit], EffectInstance, NoisyFit]] = []
    times = FAR_MORE if search.accepted else 1.0
    likely = [j for j in step.judged if j.gained > times * j.needed and j.lacks in ("not-sure", "not-on-each")]
    for first in likely[:FOLLOWED]:
        beside = replace(scorer, present=first.fit)
        ends = fits_of(beside, choices_of(data, slugs, first.fit.effects))
        pairs += [(first, own, fit) for own, fit in ends]
    if not pairs:
        return None
    first, own, fit = max(pairs, key=lambda p: p[2].total - p[2].price(p[2].unknowns - present.unknowns))
    one, two = (replace(scorer, left_out=scorer.unseen(present)).scores([(e, fit)])[0] for e in (first.effect, own))
    if one.lacks is not None or two.lacks is not None:
        return None
    steps = (replace(step, accepted=replace(first, effect=one.effect)), SearchStep(first.fit, (two,), two))
    plain = search.plain if search.accepted else present
    return replace(search, plain=plain, fit=fit, still=math.inf, steps=(*search.steps, *steps))


def _folds(segments: Sequence[Segment], held: Sequence[Segment], *, in_blocks: bool) -> tuple[Folds, str]:
    runs = list(dict.fromkeys(s.run for s in segments))
    folds: list[tuple[tuple[Segment, ...], tuple[Segment, ...]]] = []
    if len(runs) > 1 and in_blocks:
        pieces = [s.pieces(MOST_BLOCKS) for s in segments]
        for k in range(max(map(len, pieces))):
            own = tuple(b for blocks in pieces for b in blocks[k : k + 1])
            rest = tuple(b for blocks in pieces for b in (*blocks[:k], *blocks[k + 1 :]))
            folds.append((rest, own))
        words = f"{len(folds)} blocks of every run held out in turn"
    elif len(runs) > 1:
        for run in runs:
            folds.append((tuple(s for s in segments if s.run != run), tuple(s for s in segments if s.run == run)))
        words = f"each of {len(runs)} runs held out in turn"
    else:
        blocks = [b for s in segments for b in s.pieces(MOST_BLOCKS)]
        folds = [(tuple(b for b in blocks if b is not own), (own,)) for own in blocks]
        words = f"{len(blocks)} blocks of the run held out in turn"
    if held:
        folds.append((tuple(segments), tuple(held)))
        words += ", and the held-out runs"
    return tuple(folds), words
