"""What a search under process noise says to a diagnosis: whether it takes the floor, and its names."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.diagnose.adequacy import WHITE, tests_of, whiteness_of
from gcs_autotune.diagnose.missing_force import MissingForce, missing_of, words_of_water
from gcs_autotune.diagnose.noise_scorer import may_be_weighed
from gcs_autotune.diagnose.process_noise import (
    PRESENT,
    WeatherSearch,
    asked_of,
    search_under_process_noise,
)
from gcs_autotune.diagnose.process_noise_starts import per_inertia_of
from gcs_autotune.diagnose.result import ErrorReduction, Value
from gcs_autotune.diagnose.sampling_interval import OF_THE_COMMAND, commanded, horizons
from gcs_autotune.diagnose.score import ALIKE, CandidateScore, key_of, may_be_none
from gcs_autotune.diagnose.state import SearchState
from gcs_autotune.effects import EFFECTS, INPUT, EffectInstance, force_unit, in_order
from gcs_autotune.identify import Doubt, Fitted, WanderingFit
from gcs_autotune.sname import DOFS, SIGNALS

__all__ = [
    "NO_MODEL",
    "above_the_command",
    "gains_under",
    "look_under_process_noise",
    "missing_under",
    "no_model_beneath",
    "numbers_under",
    "order_under",
    "shares_under",
    "values_under",
    "wanders",
]

Array = NDArray[np.float64]

LESS = 0.1
"""Chosen: share of its size at which the process noise of a fit begins once causes are beside it."""

NO_MODEL = "no-model"
"""Name of the doubt where no model of the craft was found to name a cause beside."""


def wanders(state: SearchState) -> tuple[SearchState, bool]:
    """Return the state, and whether a force that wanders is there whatever causes are named beside it.

    The answer is kept: the search under process noise is long. No where it cannot be asked.
    """
    question = state.question
    if question.given is not None or question.horizon is not None or not question.with_noise:
        return state, False
    if state.beneath is None or state.beneath[0] is not state.problem:
        found = search_under_process_noise(
            state.problem, state.base, question.slugs, question.unseen, question.say, in_blocks=question.one_flight
        )
        state = replace(state, beneath=(state.problem, found))
        assert state.beneath is not None
    search = state.beneath[1]
    if search is None or search.momentary:
        return state, False
    return state, search.calm >= PRESENT and search.still >= PRESENT


def look_under_process_noise(state: SearchState) -> SearchState | None:
    """Look again with a force that wanders in the model, where what is left over is no noise.

    Names found so take the place of those of a search that knew no such force. None where that search ended at the
    noise, where it named what a filter cannot judge (clocks, sensors), or where nothing wanders: then it stands.
    """
    question = state.question
    if question.given is not None or question.horizon is not None:
        return None
    if whiteness_of(tests_of(state.problem, state.fitted)) > WHITE:
        return None
    if any(not may_be_weighed(e, state.question.form.inputs) for e in state.causes):
        return None
    state, _ = wanders(state)
    search = None if state.beneath is None else state.beneath[1]
    if no_model_beneath(state):
        return _without_names(state)
    if search is None or search.calm < PRESENT:
        return state
    if search.momentary:
        return replace(state, doubts=(*state.doubts, _no_weather(search)))
    if search.cut:
        return replace(state, cut=(*state.cut, search.cut))
    if state.causes and _outdone(search, state):
        return state
    plain = replace(state, fitted=state.base, present_unseen=state.base_unseen, steps=(), renamed=())
    search, refused, gains = supported(search)
    above = above_the_command(search)
    if above > OF_THE_COMMAND:
        state = replace(state, doubts=(*state.doubts, _no_base(search, above)))
    kept = replace(plain, weather=search, refused=refused, own_gains=gains, doubts=state.doubts)
    if not search.accepted:
        return kept if not state.causes else replace(kept, doubts=(*state.doubts, _dropped(state.causes)))
    fitted = _as_fitted(state, search)
    doubt = Doubt(
        "process-noise",
        f"between the samples a force wanders ({words_of_water(search)}); the causes named foretell the {search.dof} "
        "of runs they were not fitted to better beside it, and are hypotheses",
        "take them for hypotheses; calm water, or a run on which the craft comes back to rest, would tell",
    )
    return replace(kept, fitted=fitted or state.base, doubts=(*state.doubts, doubt))


Refused = tuple[CandidateScore[WanderingFit], ...]


def supported(search: WeatherSearch) -> tuple[WeatherSearch, Refused, dict[tuple[str, str], ErrorReduction]]:
    """Return the search without the causes that help on no data left out, these, and what each other one gains there.

    A cause is refused where its 95 % interval contains no effect beside those found later, or where the error ahead on
    data left out is no smaller with it than without it. The weakest goes first: beside it another may seem to help.
    None stands beside a drifting force above the commands.
    """
    refused: list[CandidateScore[WanderingFit]] = []
    while True:
        own: dict[tuple[str, str], ErrorReduction] = {}
        weakest: tuple[float, CandidateScore[WanderingFit], WanderingFit] | None = None
        for cause in search.accepted:
            who = key_of(cause.effect)
            rest = tuple(e for e in search.fit.effects if key_of(e) != who)
            alone = search.plain if len(search.accepted) == 1 else None
            without = alone or search.problem.fit(search.fit.theta, rest, search.fit.water)
            if without is None:
                continue
            gain = gain_over(search, without)
            if gain is not None:
                own[who] = gain
            ratio = math.inf if _is_none(cause, search.fit) else 0.0 if gain is None else gain.ratio
            if ratio >= 1.0 and (weakest is None or ratio > weakest[0]):
                weakest = ratio, cause, without
        if weakest is None and search.accepted and above_the_command(search) > OF_THE_COMMAND:
            refused += [replace(cause, lacks="no-model") for cause in search.accepted]
            return replace(search, fit=search.plain), tuple(refused), {}
        if weakest is None:
            return search, tuple(refused), own
        _, cause, without = weakest
        refused.append(replace(cause, lacks="uncertain" if _is_none(cause, search.fit) else "no-gain"))
        search = replace(search, fit=without)


def _is_none(cause: CandidateScore[WanderingFit], fit: WanderingFit) -> bool:
    """Whether the 95 % interval of a cause's numbers in *fit* contains no effect."""
    now = next(e for e in fit.effects if key_of(e) == key_of(cause.effect))
    return may_be_none(now, fit.errors_of(now))


def above_the_command(search: WeatherSearch) -> float:
    """Return the size of the drifting force over that of what is commanded, both rms; 0 where nothing is."""
    reach = abs(float(search.fit.theta[0])) * commanded(search.problem)
    return search.fit.water.size / reach if reach > 0.0 else 0.0


def _no_base(search: WeatherSearch, above: float) -> Doubt:
    return Doubt(
        "above-command",
        f"a drifting {'moment' if DOFS[search.dof].angular else 'force'} drives the {search.dof} {above:.1f} times as "
        "much as the commands do: no cause is identified beside a disturbance of that size",
        "use larger commands or calmer water; check that the commands in the file are those that drove the craft",
    )


def no_model_beneath(state: SearchState) -> bool:
    """Whether the search under process noise was made, and found no model of the craft at all."""
    return state.beneath is not None and state.beneath[1] is None and asked_of(state.beneath[0]) is not None


def _without_names(state: SearchState) -> SearchState:
    """Return the state without causes, where no model was found beneath the weather: a name needs one to stand on."""
    asked = asked_of(state.problem)
    if asked is not None and _couples(state.causes, asked[0].dofs[0]):
        return state
    names = ", ".join(f"{e.slug} of {e.place}" for e in state.causes)
    doubt = Doubt(
        NO_MODEL,
        "no model of the craft was found beneath the weather: what is left over is no noise, and from no start does an "
        "equation with a force that wanders follow these runs"
        + (f"; {names} is not named on that account" * bool(names)),
        "look at columns, units and clocks first; then calmer water, or slower and larger commands",
    )
    return replace(
        state,
        fitted=state.base,
        present_unseen=state.base_unseen,
        steps=(),
        renamed=(),
        doubts=(*state.doubts, doubt),
    )


def _couples(causes: Sequence[EffectInstance], dof: str) -> bool:
    """Whether some cause drives another motion than *dof*: one motion alone cannot judge it."""
    return any(n[0] != DOFS[dof].force for e in causes for n in EFFECTS[e.slug].derivatives(e))


def _outdone(search: WeatherSearch, state: SearchState) -> bool:
    """Whether the causes of the search before explain the runs better under process noise too; what couples motions
    stands, for one motion alone cannot judge it.
    """
    if _couples(state.causes, search.dof):
        return True
    named = {key_of(a.effect) for a in search.accepted}
    scaled = [_per_inertia(e, search, state) for e in state.causes]
    if {(e.slug, e.place) for e in scaled} <= named:
        return False
    # The noise took what the causes explain, so beside them there is less of it, and another craft.
    own, water = per_inertia_of(state.fitted, search.problem.form), search.fit.water
    starts = ((search.fit.theta, water), (own, water), (own, replace(water, size=LESS * water.size)))
    fits = [search.problem.fit(theta, scaled, water) for theta, water in starts]
    other = max((f for f in fits if f is not None), key=lambda f: f.total, default=None)
    if other is None:
        return False
    samples = sum(len(e) for _, e, _ in other.innovations)
    price = 0.5 * (other.unknowns - search.fit.unknowns) * math.log(max(samples, 2))
    if search.fit.theta[0] < 0.0 < other.theta[0]:
        # Of a command with its sign wrong all along the filter had turned the gain round, which explains as much.
        return other.total - price > search.fit.total - 0.5 * ALIKE
    # Where this search names nothing, the other's name is the luckiest of all that were tried.
    luck = 0.0 if search.accepted else math.log(max(state.tried, 1))
    return other.total - price > search.fit.total + luck


def _no_weather(search: WeatherSearch) -> Doubt:
    return Doubt(
        "no-weather",
        f"what drives the {search.dof} besides its commands is forgotten within {search.plain.water.memory:.2g} s, no "
        "more than two samples: that is no wind, wake or current",
        "record commands with the moment they took effect, and the sensor without its filter: either leaves such a "
        "trace",
    )


def _dropped(causes: Sequence[EffectInstance]) -> Doubt:
    names = ", ".join(f"{e.slug} of {e.place}" for e in causes)
    return Doubt(
        "not-under-process-noise",
        f"{names} lowers the error of a simulation without weather, and foretells nothing once a force may wander",
        "repeat the runs in calmer water",
    )


def _inertia(search: WeatherSearch, state: SearchState) -> float:
    """Return the inertia the wandering fit speaks for, in the base model's own units."""
    d, form = DOFS[search.dof], state.base.form
    gain = float(search.fit.theta[0])
    for pairs in form.inputs.values():
        for force, share in pairs:
            if force == d.force and not isinstance(share, str):
                return abs(share) / gain if abs(gain) > 1e-12 else math.copysign(1e12, gain)
    return 1.0


def _scaled(effect: EffectInstance, factor: float, sense: float) -> EffectInstance:
    """Return an effect with its forces times *factor*."""
    entry = EFFECTS[effect.slug]
    if "motion" not in entry.acts_on:
        return effect
    forces = [q.name for q in entry.parameters if q.unit == INPUT or q.unit.startswith(("force", "moment"))]
    by = abs(factor) if "sense" in effect.constants else factor
    constants = {**effect.constants, **({"sense": sense} if "sense" in effect.constants else {})}
    values = {n: v * by if n in forces else v for n, v in effect.values.items()}
    return EffectInstance(effect.slug, effect.place, values, constants)


def _per_inertia(effect: EffectInstance, search: WeatherSearch, state: SearchState) -> EffectInstance:
    """Return *effect* of the present model per unit of that model's inertia: a base that is lost may have none."""
    i = state.fitted.form.dofs.index(search.dof)
    return _scaled(effect, 1.0 / float(state.fitted.model.base.inertia[i, i]), 1.0)


def _as_fitted(state: SearchState, search: WeatherSearch) -> Fitted | None:
    """Return the model found, in the base model's form and units, with the initial states that suit it."""
    d, base = DOFS[search.dof], state.base
    inertia = _inertia(search, state)
    gain, damping = search.fit.theta
    values = {
        f"{d.force}_{d.velocity}dot": -inertia,
        f"{d.force}_{d.velocity}": float(damping) * inertia,
        f"k_{d.force}": float(gain) * inertia,
    }
    names = base.form.parameters
    theta = np.array([values.get(n, v) for n, v in zip(names, base.theta.tolist(), strict=True)])
    effects = in_order([_scaled(e, inertia, math.copysign(1.0, inertia)) for e in search.fit.effects])
    with np.errstate(all="ignore"):
        return state.problem.states(theta, effects, base.initial)


# -- for the report


def order_under(search: WeatherSearch, state: SearchState) -> list[EffectInstance]:
    """Return the causes named, in the order found, as the final model has them."""
    now = {(e.slug, e.place): e for e in state.fitted.effects}
    keys = [key_of(a.effect) for a in search.accepted]
    return [now[k] for k in keys if k in now]


def values_under(search: WeatherSearch, state: SearchState) -> dict[tuple[str, str], dict[str, Value]]:
    """Return the numbers of the causes named with their standard errors, in the base model's units."""
    return {(e.slug, e.place): _told(e, search.fit, state) for e in order_under(search, state)}


def _told(effect: EffectInstance, fit: WanderingFit, state: SearchState) -> dict[str, Value]:
    """Return the numbers of *effect*, as in the base's units, with errors from *fit*."""
    here = next(e for e in fit.effects if (e.slug, e.place) == (effect.slug, effect.place))
    found = {}
    for name, value in effect.values.items():
        std = fit.std_of(effect.slug, effect.place, name)
        unit = EFFECTS[effect.slug].unit_of(name, effect.place, state.problem.data_summary)
        found[name] = Value(value, unit, std * abs(value / here.values[name]) if here.values[name] else std)
    return found


def numbers_under(one: CandidateScore[WanderingFit], search: WeatherSearch, state: SearchState) -> dict[str, Value]:
    """Return the numbers of a candidate with their standard errors, in the base model's units."""
    inertia = _inertia(search, state)
    return _told(_scaled(one.effect, inertia, math.copysign(1.0, inertia)), one.fit, state)


def shares_under(search: WeatherSearch) -> dict[tuple[str, str], float]:
    """Return by which share each cause lowers the variance of the force that wanders."""
    found, before = {}, search.plain
    first = before.water.size
    for a in search.accepted:
        drop = (before.water.size**2 - a.fit.water.size**2) / first**2
        found[a.effect.slug, a.effect.place] = float(np.clip(drop, 0.0, 1.0))
        before = a.fit
    return found


def gains_under(search: WeatherSearch) -> tuple[ErrorReduction, ...]:
    """Return the error several seconds ahead on data left out, before and after."""
    found = gain_over(search, search.plain)
    return () if found is None else (found,)


def gain_over(search: WeatherSearch, other: WanderingFit) -> ErrorReduction | None:
    """Return the error ahead on data left out of *other* and of the model found; None where unknown.

    Of :func:`.horizons`, that where the error falls more.
    """
    signal = next(iter(search.problem.segments[0].signals))
    unit, found = SIGNALS[signal][0], []
    for seconds in horizons(search.problem, search.plain):
        errors = seconds_ahead(search, other, seconds)
        if errors is not None:
            before, after, low, high, each = errors
            ratio = after / before if before > 0.0 else 1.0
            metric = f"error {seconds:g} s ahead"
            found.append(ErrorReduction(metric, signal, unit, before, after, ratio, (low, high), search.parts, each))
    return min(found, key=lambda g: g.ratio, default=None)


def missing_under(search: WeatherSearch, state: SearchState) -> MissingForce | None:
    """Return the missing force in the base model's units."""
    return missing_of(search, force_unit(search.dof, state.problem.data_summary), _inertia(search, state))


SEED = 0


def seconds_ahead(
    search: WeatherSearch, other: WanderingFit, ahead: float
) -> tuple[float, float, float, float, dict[str, tuple[float, float]]] | None:
    """Return rms errors *ahead* [s] on data left out of *other* and of the model with all causes.

    Then come the ends of a 95 % interval of their ratio, from parts drawn again with replacement (one part: of its
    errors), and run -> both errors on it, where whole runs are left out.
    """
    squares = []
    each: dict[str, tuple[float, float]] = {}
    for train, test in search.folds:
        rest, seen = search.problem.on(train), search.problem.on(test)
        errors = []
        for one in (other, search.fit):
            again = rest.fit(one.theta, one.effects, one.water, rounds=4)
            errors.append(seen.ahead(again or one, ahead))
        good = min(len(e) for e in errors)
        squares.append(np.array([e[:good] ** 2 for e in errors]))
        left_out = {s.run for s in test}
        if len(left_out) == 1 and good and not left_out & {s.run for s in train}:
            each[left_out.pop()] = (float(np.sqrt(squares[-1][0].mean())), float(np.sqrt(squares[-1][1].mean())))
    joined = np.hstack(squares)
    if joined.shape[1] < 2 or not np.all(np.isfinite(joined)):
        return None
    draws = np.random.default_rng(SEED)
    ratios = []
    for _ in range(400):
        chosen = [squares[i] for i in draws.integers(0, len(squares), len(squares))]
        again_all = np.hstack(chosen)
        again_all = again_all[:, draws.integers(0, again_all.shape[1], again_all.shape[1])]
        ratios.append(float(np.sqrt(again_all[1].mean() / max(again_all[0].mean(), 1e-300))))
    low, high = np.quantile(ratios, [0.025, 0.975])
    before, after = np.sqrt(joined.mean(axis=1)).tolist()
    return before, after, float(low), float(high), each
