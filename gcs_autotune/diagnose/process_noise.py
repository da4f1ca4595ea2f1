"""Causes looked for under process noise: one degree of freedom whose heading wanders as wind and wakes push it.

Over a free run such pushes add up until no simulation follows, whatever its model, and every candidate looks alike.
Here they are part of the model (:class:`.WanderingProblem`): a force of fitted size and memory, so that what is judged
is how well each sample is foretold from those before it. Each candidate is fitted to the runs together, and whole runs
(blocks of one) are left out in turn: a name must pay on both. What does not is told
with what it came to on the second.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune import chi_square
from gcs_autotune.clock import OutOfTime
from gcs_autotune.diagnose.attested import RUNS_AWAY, WORTH, Attested, interval_of, plainest
from gcs_autotune.diagnose.score import ALIKE, HALF, SIGNIFICANCE, is_form_of
from gcs_autotune.effects import EFFECTS, INPUT, DataSummary, EffectInstance, columns_of
from gcs_autotune.identify import (
    Fitted,
    Problem,
    Segment,
    Tangent,
    WanderingFit,
    WanderingProblem,
    Water,
    data_summary_of,
    thinned_to,
)
from gcs_autotune.models import Form
from gcs_autotune.sname import DOFS

__all__ = ["WeatherSearch", "may_be_told", "search_under_process_noise", "weathered_form"]

Array = NDArray[np.float64]

PACE = 5.0
"""Chosen: samples judged per time constant of the craft; closer ones tell of the sensor's own filter."""

FEWEST = 60
"""Samples a run keeps at least, where it has them."""

FREEDOMS = (math.inf, 8.0, 4.0)
"""Degrees of freedom of the innovations' law to choose among: normal, and two with bursts."""

OWN = 4.0
"""Chosen: squares of innovations just after a command, over those elsewhere, from which on bursts are of the craft's
own making: a law with bursts would then make light of just what tells the craft."""

STIRRED = 0.05
"""Chosen: step of a command, in shares of its range, after which a craft is stirred."""

BLUR = 4.0
"""Chosen: time constants of a sensor's smoother between samples: closer ones tell of its shape, of which this one knows
the width alone."""

WIDEST = 2.0
"""Chosen: time constants of the craft between samples, at most, on that account."""

FEWEST_TO_COMPARE = 30
"""Samples on each side of such a comparison."""

BRIEF = 1.0
"""Chosen: a time of an effect, in samples of the record, below which it may as well be a filter of the sensor."""

PRESENT = 8.0
"""Log-likelihood by which a wandering force must beat none to be there at all."""

MOMENTARY = 2.0
"""Chosen: samples of the record within which a force that is forgotten is no weather: commands that took effect at
other moments than recorded, or what the sensor's own filter does."""

ROUGH, REFIT = 2, 4
"""Scoring rounds of a rough fit, and of one to the rest when a run is left out."""

RUNNERS = 6
"""Candidates fitted to the end."""

MOST_CAUSES = 4
MOST_BLOCKS = 4

Say = Callable[[str, int, int], None]


@dataclass(frozen=True, slots=True, eq=False)
class WeatherSearch:
    """What a search under process noise ended with.

    ``plain``: without any cause, ``fit``: with those named, in the order of ``named``. ``judged``: every candidate of
    every step that was fitted to the end. ``calm``: log-likelihood gained by the wandering force over none.
    ``still``: the same beside the causes named, inf where there was no time to ask; ``cut``: where time was over, in
    words.
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

    @property
    def momentary(self) -> bool:
        """Whether what wanders is forgotten so soon that it is no weather."""
        return self.plain.water.memory <= 1.01 * MOMENTARY * self.problem.data.interval


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


def search_under_process_noise(
    problem: Problem, base: Fitted, slugs: Sequence[str], unseen: Sequence[Segment], say: Say
) -> WeatherSearch | None:
    """Look for causes in the degree of freedom that these runs show best; None where this cannot be done.

    problem, base : the plain model fitted as ever, for where to begin. slugs : effects to try. unseen : runs kept
    apart, to judge on only.
    """
    dof = "yaw" if "yaw" in problem.form.dofs else problem.form.dofs[0]
    form = weathered_form(problem.form, dof)
    d = DOFS[dof]
    signal = next((n for n in (d.position, d.velocity) if any(n in s.signals for s in problem.segments)), None)
    if form is None or signal is None:
        return None
    theta, pace = _from_base(base, dof, form)
    limits = np.full(2, -np.inf), np.array([np.inf, np.inf if "delta" in form.inputs else 0.0])
    wandering = _thinned(problem, form, signal, theta, pace, limits)
    plain = None if wandering is None else _base_of(wandering, theta, pace, say)
    if wandering is None or plain is None:
        return None
    # A fit without weather may be lost altogether; how fast the craft is, and so how closely it is looked at, is told
    # by one that knows of weather.
    pace = _pace_of(plain.theta)
    blurred = float(np.clip(BLUR * plain.water.smoothing, pace, WIDEST * pace))
    closest = blurred if _errs_after_commands(wandering, plain) else 0.0
    again = _thinned(problem, form, signal, plain.theta, pace, limits, closest)
    if again is not None and not 1.0 / FAR_OFF < again.interval / wandering.interval < FAR_OFF:
        found = _base_of(again, plain.theta, pace, say)
        wandering, plain = (wandering, plain) if found is None else (again, found)
    held = thinned_to(unseen, signal, wandering.interval)
    calm = _over_none(wandering, plain)
    folds, words = _folds(wandering.segments, held)
    search = WeatherSearch(wandering, dof, plain, plain, (), (), (), calm, 0, words, folds, still=calm)
    if calm < PRESENT or search.momentary:
        return search
    try:
        while len(search.named) < MOST_CAUSES:
            before, search = search, _one_more(search, slugs, say)
            if len(search.named) == len(before.named):
                break
            search = replace(search, still=math.inf)
            search = replace(search, still=_over_none(wandering, search.fit))
    except OutOfTime as over:
        search = replace(search, cut=str(over))
    return search


def _thinned(
    problem: Problem,
    form: Form,
    signal: str,
    theta: Array,
    pace: float,
    limits: tuple[Array, Array],
    closest: float = 0.0,
) -> WanderingProblem | None:
    """Return the runs with *signal* alone, as closely as a craft of that *pace* [s] needs; None where none has it.

    closest : seconds between samples, at least.
    """
    longest = max(float(s.stamps[-1]) - s.start for s in problem.segments)
    segments = thinned_to(problem.segments, signal, min(max(pace / PACE, closest), longest / FEWEST))
    if not segments:
        return None
    own = dict(zip(form.free, theta.tolist(), strict=True))
    data = replace(data_summary_of(form, segments, own), time_constant=pace, interval=problem.data_summary.interval)
    return WanderingProblem(form, segments, data, limits)


def _pace_of(theta: Array) -> float:
    """Return the time constant [s] of gain and damping per inertia."""
    return 1.0 / max(abs(float(theta[1])), 1e-3)


def _over_none(problem: WanderingProblem, fit: WanderingFit) -> float:
    """Return the log-likelihood that the wandering force of *fit* gains over none, inf where none runs away."""
    water = fit.water
    if problem.fit(fit.theta, fit.effects, replace(water, size=1e-9), rounds=0) is None:
        return math.inf
    fits = [
        problem.fit(fit.theta, fit.effects, replace(water, size=1e-9, noise=water.noise * k), rounds=8)
        for k in (1.0, 10.0)
    ]
    return fit.total - max((f.total for f in fits if f is not None), default=-math.inf)


def _from_base(base: Fitted, dof: str, form: Form) -> tuple[Array, float]:
    """Return gain and damping per inertia of the plain fit, and its time constant [s]."""
    d, model = DOFS[dof], base.model.base
    i = model.form.dofs.index(dof)
    inertia = float(model.inertia[i, i])
    gain = 1.0
    for pairs in model.form.inputs.values():
        for force, share in pairs:
            if force == d.force:
                gain = model[share.lstrip("-")] if isinstance(share, str) else abs(share)
    damping = model[f"{d.force}_{d.velocity}"] / inertia
    theta = np.array([gain / inertia, damping])
    return theta, _pace_of(theta)


SLOWER = (1.0, 0.3, 3.0)
"""Chosen: shares of the numbers fitted without weather at which a fit beneath it begins."""

PACES = (3.0, 10.0, 40.0)
"""Chosen: samples of the record in a time constant at which it begins besides: without weather a fit of rough water may
end anywhere."""

FAR_OFF = 2.0
"""Factor between the interval that suited the fit without weather and the one that suits it beneath, from which on the
runs are looked at anew."""


def _base_of(problem: WanderingProblem, theta: Array, pace: float, say: Say) -> WanderingFit | None:
    """Return the best fit without any effect, from several starts, with the law that suits its innovations."""
    own = [next(iter(s.signals.values())) for s in problem.segments]
    rate = float(np.median([np.sqrt(np.mean(np.diff(c.values) ** 2) / np.mean(np.diff(c.t)) ** 2) for c in own]))
    noise = 0.02 * rate * problem.interval
    rough = []
    starts = [(theta * share, pace / share) for share in SLOWER]
    for samples in PACES:
        other = samples * problem.data.interval
        if all(not 0.5 < other / known < 2.0 for _, known in starts):
            # A fit that was lost knows the gain no better than the pace.
            starts.append((np.array([_gain_at(problem, other), -1.0 / other]), other))
    for k, (begun, own_pace) in enumerate(starts):
        for memory in (2.0, 20.0):
            say("process noise", k, len(starts))
            water = Water(0.2 * rate / own_pace, memory * own_pace, noise)
            fit = problem.fit(begun, (), water, rounds=ROUGH)
            rough += [] if fit is None else [fit]
    rough.sort(key=lambda f: -f.total)
    ends = []
    for k, f in enumerate(rough[:2]):
        say("process noise: fitting to the end", k, 2)
        ends.append(problem.fit(f.theta, (), f.water))
    best = max((f for f in ends if f is not None), key=lambda f: f.total, default=None)
    if best is None:
        return None
    for k, freedom in enumerate(FREEDOMS[1:]):
        say("process noise: law of the innovations", k, len(FREEDOMS))
        tailed = problem.fit(best.theta, (), replace(best.water, freedom=freedom))
        if tailed is None or tailed.total <= best.total + WORTH or _errs_after_commands(problem, best):
            break
        best = tailed
    say("process noise: law of the innovations", len(FREEDOMS) - 1, len(FREEDOMS))
    blurred = problem.fit(best.theta, (), replace(best.water, smoothing=problem.data.interval))
    return blurred if blurred is not None and blurred.total > best.total + WORTH else best


def _gain_at(problem: WanderingProblem, pace: float) -> float:
    """Return the gain per inertia with which a craft of that *pace* [s] best follows the commands from rest.

    From one sample to the next, for what a force that wanders did before adds up in the position itself.
    """
    told, drawn = 0.0, 0.0
    for segment in problem.segments:
        own = next(iter(segment.signals.values()))
        push = np.zeros(len(segment.t_in))
        for name, column in zip(segment.input_names, segment.inputs.T, strict=True):
            for _, share in problem.form.inputs.get(name, ()):
                push += -column if str(share).startswith("-") else column
        t = np.union1d(segment.t_in, own.t)
        force = push[np.maximum(np.searchsorted(segment.t_in, t, side="right") - 1, 0)]
        held = np.diff(t)
        velocity = np.zeros(len(t))
        for k, kept in enumerate(np.exp(-held / pace).tolist()):
            velocity[k + 1] = kept * velocity[k] + (1.0 - kept) * pace * force[k]
        path = velocity
        if own.name == problem.dof.position:
            path = pace * (np.append(0.0, np.cumsum(force[:-1] * held)) - velocity)
        model, measured = np.diff(path[np.searchsorted(t, own.t)]), np.diff(own.values)
        told, drawn = told + float(model @ measured), drawn + float(model @ model)
    return told / drawn if drawn > 0.0 else 0.0


def _errs_after_commands(problem: WanderingProblem, fit: WanderingFit) -> bool:
    """Whether a model errs just after its commands far more than elsewhere: no wind waits for these."""
    window = 2.0 * max(_pace_of(fit.theta), problem.interval)
    squares: list[list[Array]] = [[], []]
    for segment, (t, e, S) in zip(problem.segments, fit.innovations, strict=True):
        stirred = np.zeros(len(t), dtype=bool)
        for name, column in zip(segment.input_names, segment.inputs.T, strict=True):
            if name in problem.form.inputs:
                steps = segment.t_in[1:][np.abs(np.diff(column)) > STIRRED * np.ptp(column)]
                since = np.append(-np.inf, steps)[np.searchsorted(steps, t, side="right")]
                stirred |= t - since < window
        for k in (0, 1):
            squares[k].append((e * e / S)[stirred == bool(k)])
    calm, after = (np.concatenate(s) for s in squares)
    return min(len(calm), len(after)) >= FEWEST_TO_COMPARE and float(after.mean()) > OWN * float(calm.mean())


def _folds(
    segments: Sequence[Segment], held: Sequence[Segment]
) -> tuple[tuple[tuple[tuple[Segment, ...], tuple[Segment, ...]], ...], str]:
    runs = list(dict.fromkeys(s.run for s in segments))
    folds: list[tuple[tuple[Segment, ...], tuple[Segment, ...]]] = []
    if len(runs) > 1:
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
    for slug in slugs:
        entry = EFFECTS[slug]
        if not may_be_told(slug):
            continue
        for place in entry.places(data):
            if any(e.slug == slug and e.place == place for e in present):
                continue
            constants = dict(entry.constants(place, data))
            found.append([EffectInstance(slug, place, dict(s), constants) for s in entry.starts(place, data)])
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
    problem, present = search.problem, search.fit
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
        end = problem.fit(fit.theta, fit.effects, fit.water)
        ends.append((tried_one, end if end is not None and end.total > fit.total else fit))
    if ends:
        best = max(ends, key=lambda e: e[1].total)[1]
        again = problem.fit(best.theta, present.effects, best.water)
        if again is not None and again.total > present.total + 0.5:
            present = again
    tried = max(search.tried, len(choices))
    before = _unseen(search, present)
    judged = []
    for k, (effect, fit) in enumerate(ends):
        say(f"{stage}: runs left out", k, len(ends))
        more = fit.unknowns - present.unknowns
        needed = 0.5 * chi_square.threshold(SIGNIFICANCE / max(tried, 1), max(more, 1))
        gain = fit.total - present.total
        now = next(e for e in fit.effects if (e.slug, e.place) == (effect.slug, effect.place))
        after = _unseen(search, fit) if gain > 0.5 * needed else before
        foretold = np.array([float(np.sum(a - b)) for a, b in zip(after, before, strict=True)])
        brief = _lasts(now, problem.data) < BRIEF * problem.data.interval
        judged.append(
            Attested(now, fit, gain, foretold, needed, len(search.named) + 1, interval_of(before, after), brief)
        )
    judged.sort(key=lambda a: -(a.gain - _price(a.fit, present)))
    search = replace(search, judged=(*search.judged, *judged), tried=tried, fit=present)
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
    winner = plainest(alike[0], paid)
    forms = [a for a in paid if is_form_of(a.effect, winner.effect) and a.foretold > HALF * winner.foretold]
    groups = search.alike
    names = tuple(dict.fromkeys(a.effect.slug for a in (winner, *alike, *forms)))
    if len(names) > 1:
        groups = (*groups, names)
    return replace(search, named=(*search.named, winner), fit=winner.fit, alike=groups)


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


TRACE = 0.1
"""A small amount of an effect, in shares of the size it is tried at."""


def _rough(
    problem: WanderingProblem, present: WanderingFit, choices: Sequence[EffectInstance], tangent: Tangent
) -> WanderingFit | None:
    """Return the most promising of the values to begin from, and of small amounts of them, all else adapted."""
    entry = EFFECTS[choices[0].slug]
    growing = [n for n in entry.grows_with if n in choices[0].values]
    more = list(choices)
    for own in choices if growing else ():
        zero = {n: entry.neutral.get(n, 0.0) for n in growing}
        more.append(own.with_values({n: zero[n] + TRACE * (own.values[n] - zero[n]) for n in growing}))
    tried = [problem.adapted(present, own, tangent) for own in more]
    best = max((f for f in tried if f is not None), key=lambda f: f.total, default=None)
    return None if best is None else problem.fit(best.theta, best.effects, best.water, rounds=ROUGH)


def _unseen(search: WeatherSearch, fit: WanderingFit) -> list[Array]:
    """Return the log densities (samples,) of what each fold leaves out, by *fit* refitted to the rest of it."""
    found = []
    for train, test in search.folds:
        rest = search.problem.on(train)
        again = rest.fit(fit.theta, fit.effects, fit.water, rounds=REFIT)
        seen = None if again is None else search.problem.on(test).judge(again)
        found.append(np.full(1, RUNS_AWAY) if seen is None else seen.densities)
    return found
