"""Causes looked for under process noise: one degree of freedom whose heading wanders as wind and wakes push it.

Over a free run such pushes add up until no simulation follows, whatever its model, and every candidate looks alike.
Here they are part of the model (:class:`.WanderingProblem`): a force of fitted size and memory, so that what is judged
is how well each sample is foretold from those before it. Each candidate is fitted to the runs together, and whole runs
(blocks of one) are left out in turn: a name must pay on both. What does not is told
with what it came to on the second.
"""

from __future__ import annotations

import math
from collections.abc import Container, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune import chi_square
from gcs_autotune.clock import OutOfTime
from gcs_autotune.diagnose.attested import WORTH, Attested, densities_of, interval_of, plainest
from gcs_autotune.diagnose.day_to_day import alike_in, differing
from gcs_autotune.diagnose.process_noise_starts import (
    FEWEST_TO_COMPARE,
    ROUGH,
    WAVES,
    Say,
    at_the_right_interval,
    momentary,
    plain_under_process_noise,
)
from gcs_autotune.diagnose.sampling_interval import changes_at, foresight, horizons, refitted, rms_ahead, stands
from gcs_autotune.diagnose.score import ALIKE, HALF, SIGNIFICANCE, is_form_of, may_be_none
from gcs_autotune.effects import EFFECTS, INPUT, DataSummary, EffectInstance, columns_of, name_of, twins_of
from gcs_autotune.identify import (
    Fitted,
    Problem,
    Segment,
    Tangent,
    WanderingFit,
    WanderingProblem,
    thinned_to,
)
from gcs_autotune.models import Form
from gcs_autotune.slow_imports import scipy_stats
from gcs_autotune.sname import DOFS

__all__ = [
    "CONSTANT",
    "WeatherSearch",
    "asked_of",
    "may_be_told",
    "refits_of",
    "search_under_process_noise",
    "weathered_form",
]

Array = NDArray[np.float64]

BRIEF = 1.0
"""Chosen: a time of an effect, in samples of the record, below which it may as well be a filter of the sensor."""

AGAINST = 4.0
"""Chosen: standard deviations of a rank correlation between innovations and the commands' next changes from which on a
command is fed back; open loops of the blind suite came to 2 at most."""

PRESENT = 8.0
"""Log-likelihood by which a wandering force, with waves, must beat none to be there at all."""

REFIT = 4
"""Scoring rounds of a fit to the rest when a run is left out."""

RUNNERS = 6
"""Candidates fitted to the end."""

SLOWER_THAN_FOUND = 2.0
"""Chosen: factor by which the craft may be slower than a fit took her for that lacks a delay or a lag: how long these
may be goes with it."""

EVEN = 16
"""Chosen: times alone are tried so many besides, evenly: beside commands that change often, a delay is found only where
it is nearly right.
"""

DOZEN = 12.0
"""Samples of the record that such times are tried up to at least, and besides as far as the book allows: without her
delay a quick craft may come out quicker still (rough water, seed 232 case 2: one of two time constants was none tried;
seed 463: one of 0.39 s, nearly three, which is worth 338)."""

LATE = ("input-delay", "actuator-lag")
"""What a sensor that is late, or filters one way, does as well: of one signal alone they are the same but for noise."""

FAR_AHEAD = 0.85
"""Chosen: share of the likeliest candidate's error some seconds ahead below which another is named in its place."""

CONSTANT = ("input-bias", "net-buoyancy")
"""The constant force of a degree of freedom, by the slugs that it may have."""

SHRUNK = 0.3
"""Chosen: share of its size and memory at which the process noise of a fit begins once a constant is beside it."""

MOST_CAUSES = 4
MOST_BLOCKS = 4


@dataclass(frozen=True, slots=True, eq=False)
class WeatherSearch:
    """What a search under process noise ended with.

    ``plain``: without any cause, ``fit``: with those named, in the order of ``named``. ``judged``: every candidate of
    every step that was fitted to the end. ``calm``: log-likelihood gained by the wandering force, and waves, over none.
    ``still``: the same beside the causes named, inf where it was stopped before; ``cut``: where, in words.
    ``parts``: what was left out in turn, in words; ``alike``: groups of slugs these runs cannot tell apart.
    """

    problem: WanderingProblem
    dof: str
    plain: WanderingFit
    fit: WanderingFit
    named: tuple[Attested, ...]
    judged: tuple[Attested, ...]
    alike: tuple[tuple[str, ...], ...]
    calm: float
    tried: int
    parts: str
    folds: tuple[tuple[tuple[Segment, ...], tuple[Segment, ...]], ...]
    still: float = math.inf
    cut: str = ""
    hint: WanderingFit | None = None
    """A fit with one cause to begin from, besides those the search has itself."""
    interval: str = ""
    """How the answer changes with the interval between the samples judged, in words; empty where it does not."""

    @property
    def momentary(self) -> bool:
        """Whether what wanders is forgotten so soon that it is no weather."""
        return momentary(self.problem, self.plain)


def weathered_form(form: Form, dof: str) -> Form | None:
    """Return the equation of *dof* alone, per unit of its inertia.

    None where it is not an uncoupled equation with linear damping, or nothing drives it.
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
    title = f"{dof} alone, per unit of inertia"
    free = (gain, damping)
    return Form("plain", title, (dof,), free, {rigid: 1.0}, inputs, coriolis=False, per_inertia=(d.force,))


def asked_of(problem: Problem) -> tuple[Form, str] | None:
    """Return the equation that a search under process noise looks at, and the signal it is judged by; None for none."""
    dof = "yaw" if "yaw" in problem.form.dofs else problem.form.dofs[0]
    form = weathered_form(problem.form, dof)
    d = DOFS[dof]
    signal = next((n for n in (d.position, d.velocity) if any(n in s.signals for s in problem.segments)), None)
    return None if form is None or signal is None else (form, signal)


def search_under_process_noise(
    problem: Problem,
    base: Fitted,
    slugs: Sequence[str],
    unseen: Sequence[Segment],
    say: Say,
    *,
    in_blocks: bool = False,
) -> WeatherSearch | None:
    """Look for causes in the degree of freedom that these runs show best; None where this cannot be done, or no model
    of the craft was found beneath the weather.

    problem, base : the plain model fitted as ever, for where to begin. slugs : effects to try. unseen : runs kept
    apart, to judge on only. in_blocks : blocks of every run are left out in turn, not whole runs.
    """
    asked = asked_of(problem)
    begun = None if asked is None else plain_under_process_noise(problem, base, *asked, say)
    hint, words = None, ""
    if asked is not None and begun is not None and not momentary(*begun):
        begun, hint, words = at_the_right_interval(problem, *asked, begun, slugs, say)
    if asked is None or begun is None:
        return None
    (form, signal), (wandering, plain) = asked, begun
    dof = form.dofs[0]
    held = thinned_to(unseen, signal, wandering.interval)
    calm = _over_constants(wandering, plain)
    folds, parts = _folds(wandering.segments, held, in_blocks=in_blocks)
    search = WeatherSearch(wandering, dof, plain, plain, (), (), (), calm, 0, parts, folds, still=calm)
    search = replace(search, hint=hint, interval=words)
    if calm < PRESENT or search.momentary:
        return search
    try:
        search = _with_constant(search, slugs)
        if search.named:
            search = replace(search, still=_over_constants(wandering, search.fit))
        for _ in range(MOST_CAUSES):
            before, search = search, _one_more(search, slugs, say)
            if len(search.named) == len(before.named):
                break
            search = replace(_without_idle(search), still=math.inf)
            search = replace(search, still=_over_constants(wandering, search.fit))
        if search.named:
            wider = wandering.on(thinned_to(problem.segments, signal, 2.0 * wandering.interval))
            changes = changes_at(wandering, search.fit, wider)
            search = replace(search, interval="; ".join(filter(None, (words, *changes))))
    except OutOfTime as over:
        search = replace(search, cut=str(over))
    return search


def _without_idle(search: WeatherSearch) -> WeatherSearch:
    """Return the search without the names that explain nothing any more beside the one found last.

    A stock sub's thrust that falls with speed was its quadratic drag, found after it: 0.149 +- 0.2 was left of it.
    """
    for name in search.named[:-1]:
        who = (name.effect.slug, name.effect.place)
        rest = tuple(e for e in search.fit.effects if (e.slug, e.place) != who)
        without = search.problem.fit(search.fit.theta, rest, search.fit.water)
        if without is not None and search.fit.total - without.total < WORTH:
            named = tuple(a for a in search.named if a is not name)
            groups = tuple(g for g in search.alike if g[0] != name_of(name.effect))
            search = replace(search, named=named, fit=without, alike=groups)
    return search


def _over_constants(problem: WanderingProblem, fit: WanderingFit) -> float:
    """Return the log-likelihood that the noise and waves of *fit* gain over the plainer laws of their family.

    These are no force, one constant, and a constant of each run: with a long memory, a drifting force is a constant.
    Beside the noise there may be a constant, too. Its number is paid for (Schwarz). inf where none of the plainer laws
    can be evaluated.
    """
    still = fit.water.still
    constants = _constants(problem, fit)
    laws = [(fit.effects, still), *[((*fit.effects, own), still) for own in constants]]
    if problem.runs > 1:
        laws.append((fit.effects, replace(still, day_force=max(fit.water.size, fit.water.day_force))))
    best = -math.inf
    for effects, water in laws:
        if problem.fit(fit.theta, effects, water, rounds=0) is None:
            continue
        fits = [problem.fit(fit.theta, effects, replace(water, noise=water.noise * k)) for k in (1.0, 10.0)]
        best = max([best, *[f.total - _price_of_effects(f, fit) for f in fits if f is not None]])
    noisy = [f for own in constants if (f := _beside(problem, fit, own)) is not None]
    return max([fit.total, *[f.total - _price_of_effects(f, fit) for f in noisy]]) - best


def _beside(problem: WanderingProblem, fit: WanderingFit, own: EffectInstance) -> WanderingFit | None:
    """Return *fit* again with a constant force beside its noise, which is smaller and forgotten sooner without it."""
    shorter = replace(fit.water, size=SHRUNK * fit.water.size, memory=SHRUNK * fit.water.memory)
    tries = [problem.fit(fit.theta, (*fit.effects, own), water) for water in (fit.water, shorter)]
    return max((f for f in tries if f is not None), key=lambda f: f.total, default=None)


def _constants(problem: WanderingProblem, fit: WanderingFit) -> list[EffectInstance]:
    """Return the constant force of this degree of freedom, to begin from; none where *fit* has one."""
    dof = problem.form.dofs[0]
    present = {(e.slug, e.place) for e in fit.effects}
    return [
        EffectInstance(slug, dof, dict(EFFECTS[slug].starts(dof, problem.data)[0]))
        for slug in CONSTANT
        if (slug, dof) not in present and dof in EFFECTS[slug].places(problem.data)
    ]


def _with_constant(search: WeatherSearch, slugs: Sequence[str]) -> WeatherSearch:
    """Return the search with a constant force named, where it is supported beside process noise; else unchanged.

    A constant and a drifting force are nested laws, and a drifting force remembers a constant as well as it can. So the
    constant is tried before any other cause, and as the only try.
    """
    problem = search.problem
    offered = [e for e in _constants(problem, search.plain) if e.slug in slugs]
    plain = differing(problem, search.plain) if offered else search.plain
    for own in offered:
        fit = _beside(problem, plain, own)
        if fit is None:
            continue
        found = _attested(replace(search, tried=1), own, fit, plain, _unseen(search, plain))
        if found.paid:
            search = replace(search, named=(found,), judged=(found,), fit=fit)
    return search


def _folds(
    segments: Sequence[Segment], held: Sequence[Segment], *, in_blocks: bool
) -> tuple[tuple[tuple[tuple[Segment, ...], tuple[Segment, ...]], ...], str]:
    runs = list(dict.fromkeys(s.run for s in segments))
    folds: list[tuple[tuple[Segment, ...], tuple[Segment, ...]]] = []
    if len(runs) > 1 and in_blocks:
        pieces = [s.pieces(MOST_BLOCKS) for s in segments]
        for k in range(max(map(len, pieces))):
            own = tuple(b for blocks in pieces for b in blocks[k : k + 1])
            rest = tuple(b for blocks in pieces for b in (*blocks[:k], *blocks[k + 1 :]))
            folds.append((rest, own))
        words = f"{len(folds)} blocks of every run left out in turn"
    elif len(runs) > 1:
        for run in runs:
            folds.append((tuple(s for s in segments if s.run != run), tuple(s for s in segments if s.run == run)))
        words = f"each of {len(runs)} runs left out in turn"
    else:
        blocks = [b for s in segments for b in s.pieces(MOST_BLOCKS)]
        folds = [(tuple(b for b in blocks if b is not own), (own,)) for own in blocks]
        words = f"{len(blocks)} blocks of the run left out in turn"
    if held:
        folds.append((tuple(segments), tuple(held)))
        words += ", and the runs kept apart"
    return tuple(folds), words


# -- one cause more


def _choices(data: DataSummary, slugs: Sequence[str], present: Sequence[EffectInstance]) -> list[list[EffectInstance]]:
    found = []
    slower = replace(data, time_constant=SLOWER_THAN_FOUND * data.time_constant)
    for slug in slugs:
        entry = EFFECTS[slug]
        if not may_be_told(slug):
            continue
        for place in entry.places(data):
            if any(e.slug == slug and e.place == place for e in present):
                continue
            constants = dict(entry.constants(place, data))
            starts = [dict(s) for d in (data, slower) for s in entry.starts(place, d)]
            if [q.unit for q in entry.parameters] == ["s"]:
                name = entry.parameters[0].name
                allowed = entry.bounds(place, data).get(name, (0.0, math.inf))[1]
                most = max(slower.time_constant, DOZEN * data.interval), allowed
                even = [np.linspace(0.0, t, EVEN + 1)[1:] for t in most if math.isfinite(t)]
                starts += [{name: float(t)} for t in np.concatenate(even)]
            own = [s for k, s in enumerate(starts) if s not in starts[:k]]
            found.append([EffectInstance(slug, place, s, constants) for s in own])
    return found


def may_be_told(slug: str) -> bool:
    """Whether a search under process noise looks for an effect: what acts on commands or in the equation of motion, at
    all times.
    """
    entry = EFFECTS[slug]
    return entry.family != "data errors" and not entry.happens_at and _is_motion(slug)


def may_be_weighed(effect: EffectInstance, inputs: Container[str]) -> bool:
    """Whether a filter can judge an effect that was found otherwise: one that happens at a time, or one of the records'
    errors at a column of *inputs*, too. When something happened is no question for its tangent; what it is worth once
    the time is known is.
    """
    if EFFECTS[effect.slug].family == "data errors":
        return all(n in inputs for n in columns_of(effect.place))
    return _is_motion(effect.slug)


def _is_motion(slug: str) -> bool:
    entry = EFFECTS[slug]
    return not entry.is_disturbance and bool(entry.acts_on) and not entry.acts_on - {"commands", "motion"}


def _one_more(search: WeatherSearch, slugs: Sequence[str], say: Say) -> WeatherSearch:
    """Return the search one cause further, or the same with what was judged where none pays."""
    problem = search.problem
    present = differing(problem, search.fit)
    choices = _choices(problem.data, slugs, present.effects)
    stage = f"process noise, cause {len(search.named) + 1}"
    rough: list[tuple[EffectInstance, WanderingFit]] = []
    tangent = problem.tangent(present)
    if tangent is None:
        return search
    for k, own in enumerate(choices):
        fit = _rough(problem, present, own, tangent)
        if fit is not None:
            rough.append((own[0], fit))
        say(stage, k + 1, len(choices))
    rough.sort(key=lambda f: -(f[1].total - _price(f[1], present)))
    ends = []
    for k, (tried_one, fit) in enumerate(rough[:RUNNERS]):
        say(f"{stage}: fitting to the end", k, RUNNERS)
        tries = [fit, problem.fit(fit.theta, fit.effects, fit.water)]
        same = alike_in(fit.water, problem.runs)
        if fit.water.day_thrust or fit.water.day_force > 1.01 * same.day_force:
            # What bends thrust makes runs of other commands differ, and may explain them alike.
            tries.append(problem.fit(fit.theta, fit.effects, same))
        if fit.water.wavy:
            # What answers the commands in a rhythm may be taken for waves until its cause is there.
            tries.append(problem.fit(fit.theta, fit.effects, replace(fit.water, wave_swing=0.0, wave_force=0.0)))
        best_try = max((f for f in tries if f is not None), key=lambda f: f.total - WAVES * f.water.wavy)
        ends.append((tried_one, _or_hinted(search, present, tried_one, best_try)))
    if ends:
        best = max(ends, key=lambda e: e[1].total)[1]
        again = problem.fit(best.theta, present.effects, best.water)
        if again is not None and again.total > present.total + 0.5:
            present = again
    search = replace(search, tried=max(search.tried, len(choices)))
    before = _unseen(search, present)
    judged = []
    for k, (effect, fit) in enumerate(ends):
        say(f"{stage}: runs left out", k, len(ends))
        judged.append(_sound(search, _attested(search, effect, fit, present, before), present, before))
    judged.sort(key=lambda a: -(a.gain - _price(a.fit, present)))
    search = replace(search, judged=(*search.judged, *judged), fit=present)
    if not search.named:
        search = replace(search, plain=present)
    paid = [a for a in judged if a.paid]
    if not paid:
        return search
    # On runs it has not seen a model pays for its own parameters; on real water those fitted tell less.
    best_foretold = max(a.foretold for a in paid)
    alike = sorted((a for a in paid if a.foretold > best_foretold - 0.5 * ALIKE), key=lambda a: -a.foretold)
    slugs_alike = {a.effect.slug for a in alike}
    alike.sort(key=lambda a: len(slugs_alike & set(EFFECTS[a.effect.slug].yields_to)))
    # The likelihood is of the next sample. Where another predicts far better some seconds ahead, and gains on every
    # part left out as well, that is felt.
    first = alike[0]
    better = [a for a in paid if a.ahead < FAR_AHEAD * first.ahead and bool(np.all(a.unseen > 0.0))]
    winner = plainest(min(better, key=lambda a: a.ahead, default=first), paid)
    forms = [a for a in paid if is_form_of(a.effect, winner.effect) and a.foretold > HALF * winner.foretold]
    groups = search.alike
    told = [winner.effect, *(a.effect for a in (*alike, *forms, *_as_likely(judged, winner)))]
    late = ["measurement-delay" for effect in told if effect.slug in LATE]
    others = [*twins_of(winner.effect, problem.data), *map(name_of, told[1:]), *late]
    names = tuple(dict.fromkeys([name_of(winner.effect), *others]))
    if len(names) > 1:
        groups = (*groups, names)
    return replace(search, named=(*search.named, winner), fit=winner.fit, alike=groups)


def _or_hinted(search: WeatherSearch, present: WanderingFit, tried: EffectInstance, best: WanderingFit) -> WanderingFit:
    """Return the fit of a candidate, or the valley beside it that the hint lies in, where that predicts far better.

    Of a craft that was taken for a quicker one a candidate may stay in the valley where the plain model was.
    """
    hint, problem = search.hint, search.problem
    if hint is None or search.named or [(e.slug, e.place) for e in hint.effects] != [(tried.slug, tried.place)]:
        return best
    water = replace(hint.water, day_force=present.water.day_force, day_thrust=present.water.day_thrust)
    fits = [problem.fit(hint.theta, hint.effects, w) for w in (water, alike_in(hint.water, problem.runs))]
    seconds = foresight(problem, search.plain)
    other = max((f for f in fits if f is not None), key=lambda f: f.total, default=None)
    if other is None or seconds is None or other.total <= present.total:
        return best
    far = rms_ahead(problem, other, seconds) < FAR_AHEAD * rms_ahead(problem, best, seconds)
    return other if far or other.total > best.total else best


def _attested(
    search: WeatherSearch,
    effect: EffectInstance,
    fit: WanderingFit,
    present: WanderingFit,
    left_out: Sequence[WanderingFit | None],
) -> Attested:
    """Return what *effect* gains in *fit* over *present*, whose fits on what is *left_out* are given."""
    more = fit.unknowns - present.unknowns
    needed = 0.5 * chi_square.threshold(SIGNIFICANCE / max(search.tried, 1), max(more, 1))
    gain = fit.total - present.total
    now = next(e for e in fit.effects if (e.slug, e.place) == (effect.slug, effect.place))
    before = densities_of(left_out, left_out)
    after = densities_of(_unseen(search, fit), left_out) if gain > min(0.5 * needed, WORTH) else before
    foretold = np.array([float(np.sum(a - b)) for a, b in zip(after, before, strict=True)])
    lasts, short = _lasts(now, search.problem.data), BRIEF * search.problem.data.interval
    # Of a craft that shows no inertia, what takes time is that inertia.
    brief = lasts < short or (math.isfinite(lasts) and 1.0 < abs(float(fit.theta[1])) * short)
    brief = brief or (lasts < search.problem.interval and answers_heading(search.problem, fit))
    sure, uncertain = interval_of(before, after), may_be_none(now, fit.errors_of(now))
    return Attested(now, fit, gain, foretold, needed, len(search.named) + 1, sure, brief, uncertain)


def _sound(
    search: WeatherSearch, found: Attested, present: WanderingFit, left_out: Sequence[WanderingFit | None]
) -> Attested:
    """Return *found* with its error some seconds ahead, over that of *present*, and why it is not to be named although
    it pays, if so: no model of the craft stands, or what is *left_out* is predicted no better so far ahead.
    """
    if not found.paid:
        return found
    if not stands(search.problem, found.fit):
        return replace(found, unsound="no model of the craft stands with it")
    refitted, seen = _unseen(search, found.fit), []
    for seconds in horizons(search.problem, search.plain):
        squares = [0.0, 0.0]
        for (_, test), before, after in zip(search.folds, left_out, refitted, strict=True):
            runs = search.problem.on(test)
            for k, fit in enumerate((before, after)):
                errors = np.array([math.inf]) if fit is None else runs.ahead(fit, seconds)
                squares[k] += float(np.sum(errors**2))
        given = [rms_ahead(search.problem, fit, seconds) for fit in (present, found.fit)]
        if 0.0 < squares[0] < math.inf and 0.0 < given[0] < math.inf:
            seen.append((math.sqrt(squares[1] / squares[0]), seconds, given[1] / given[0]))
        if seen and seen[-1][0] < 1.0:
            break
    if not seen:
        return found
    ratio, seconds, ahead = min(seen)
    why = "" if ratio < 1.0 else f"predicts no better {seconds:g} s ahead ({ratio:.2f} times the error)"
    return replace(found, ahead=ahead, unsound=why)


def answers_heading(problem: WanderingProblem, fit: WanderingFit) -> bool:
    """Whether commands turn against what the weather did just before: somebody, or something, keeps a course.

    Between two samples judged commands then know of pushes that the filter has yet to see: it looks as if they acted
    late. Told by the ranks of innovations and of the commands' next changes.
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
    sense = math.copysign(1.0, float(fit.theta[0]))
    return sense * float(scipy_stats().spearmanr(one, two).statistic) * math.sqrt(len(one)) < -AGAINST


def _as_likely(judged: Sequence[Attested], winner: Attested) -> list[Attested]:
    """Return those that explain the given runs as well as *winner* and predict others too, if not surely, or are too
    brief to be named, and those that explain them better: these runs do not distinguish them.
    """
    enough = winner.gain - 0.5 * ALIKE
    return [
        a
        for a in judged
        if a.gain > enough and (a.foretold > WORTH or a.gain - _price(a.fit, winner.fit) > winner.gain)
    ]


def _lasts(effect: EffectInstance, data: DataSummary) -> float:
    """Return the shortest time [s] among an effect's numbers, a rate told as the time to the largest command."""
    times = [math.inf]
    for q in EFFECTS[effect.slug].parameters:
        value = abs(effect.values.get(q.name, math.inf))
        if q.unit == "s":
            times.append(value)
        elif q.unit == f"{INPUT}/s":
            times.append(data.amplitude.get(effect.place, math.inf) / max(value, 1e-300))
    return min(times)


def _price(fit: WanderingFit, present: WanderingFit) -> float:
    """Return what additional parameters cost (Schwarz), as log-likelihood."""
    samples = sum(len(e) for _, e, _ in fit.innovations)
    return 0.5 * (fit.unknowns - present.unknowns) * math.log(max(samples, 2))


def _price_of_effects(fit: WanderingFit, present: WanderingFit) -> float:
    """Return what the additional numbers of effects alone cost (Schwarz), as log-likelihood."""
    samples = sum(len(e) for _, e, _ in fit.innovations)
    return 0.5 * (len(fit.free_effects) - len(present.free_effects)) * math.log(max(samples, 2))


TRACE = 0.1
"""A small amount of an effect, in shares of the size it is tried at."""


def _rough(
    problem: WanderingProblem, present: WanderingFit, choices: Sequence[EffectInstance], tangent: Tangent
) -> WanderingFit | None:
    """Return the better end of the most promising of the values to begin from, and of small amounts of them, all else
    adapted.

    Both are gone on from: a trace changes little and so looks well, where the whole has yet to find its pace.
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
        end = None if best is None else problem.fit(best.theta, best.effects, best.water, rounds=ROUGH)
        ends += [] if end is None else [end]
    return max(ends, key=lambda f: f.total, default=None)


def refits_of(search: WeatherSearch, fit: WanderingFit) -> list[WanderingFit | None]:
    """Return *fit*, refitted to what each fold does not leave out; None where it runs away."""
    seconds = foresight(search.problem, search.plain)
    return [refitted(search.problem.on(train), fit, REFIT, seconds) for train, _ in search.folds]


def _unseen(search: WeatherSearch, fit: WanderingFit) -> list[WanderingFit | None]:
    """Return *fit*, refitted to the rest, as it is on what each fold leaves out; None where it runs away."""
    refits = zip(refits_of(search, fit), search.folds, strict=True)
    return [None if again is None else search.problem.on(test).judge(again) for again, (_, test) in refits]
