"""Repeat the search with process noise, and decide whether its causes replace those found by least squares."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.diagnose.adequacy import WHITE, tests_of, whiteness_of
from gcs_autotune.diagnose.missing_force import words_of_noise
from gcs_autotune.diagnose.noise_scorer import may_be_weighed
from gcs_autotune.diagnose.process_noise import (
    PRESENT,
    NoiseSearch,
    above_the_command,
    noise_equation,
    scaled,
    search_with_process_noise,
    supported,
)
from gcs_autotune.diagnose.process_noise_starts import per_inertia_of
from gcs_autotune.diagnose.sampling_interval import OF_THE_COMMAND
from gcs_autotune.diagnose.score import ALIKE, key_of
from gcs_autotune.diagnose.state import SearchState
from gcs_autotune.effects import EFFECTS, EffectInstance, effect_at, in_order
from gcs_autotune.identify import Doubt
from gcs_autotune.identify.problems import Fitted
from gcs_autotune.sname import DOFS

__all__ = [
    "NO_MODEL",
    "model_noise_before_joining",
    "model_process_noise",
    "needs_process_noise",
    "no_model_with_noise",
]

Array = NDArray[np.float64]

LESS = 0.1
"""Factor on the size of the process noise, at the start of a fit with causes added."""

NO_MODEL = "no-model"
"""Slug of the doubt that no model of the craft was found with process noise."""


def needs_process_noise(state: SearchState) -> tuple[SearchState, bool]:
    """Return (the state, whether a drifting force remains even with the accepted causes). The state stores the search
    with process noise, because that takes long. The second value is False if such a search is impossible.
    """
    question = state.question
    if question.given is not None or question.horizon is not None or not question.with_noise:
        return state, False
    if state.noise_search is None or state.noise_search[0] is not state.problem:
        searched = search_with_process_noise(
            state.problem, state.base, question.slugs, question.unseen, question.say, in_blocks=question.one_flight
        )
        state = replace(state, noise_search=(state.problem, searched))
        assert state.noise_search is not None
    search = state.noise_search[1]
    if search is None or search.momentary:
        return state, False
    return state, search.calm >= PRESENT and search.still >= PRESENT


def model_process_noise(state: SearchState) -> SearchState | None:
    """Search again with a drifting force in the model, if the residuals are not noise.

    The causes found replace those of the search without it. Return None in these cases:

    - the residuals of that search are noise;
    - that search accepted causes that a filter cannot score (clocks, sensors);
    - this search has already accepted a cause;
    - a model or a horizon was given.

    If no force drifts, return the state unchanged.
    """
    question = state.question
    if question.given is not None or question.horizon is not None:
        return None
    if state.with_noise is not None and state.with_noise.accepted:
        return None
    if whiteness_of(tests_of(state.problem, state.fitted)) > WHITE:
        return None
    if any(not may_be_weighed(e, state.question.form.inputs) for e in state.causes):
        return None
    state, _ = needs_process_noise(state)
    search = None if state.noise_search is None else state.noise_search[1]
    if no_model_with_noise(state):
        return _without_names(state)
    if search is None or search.calm < PRESENT:
        return state
    if search.momentary:
        return replace(state, doubts=(*state.doubts, _no_disturbance(search)))
    if search.cut:
        return replace(state, cut=(*state.cut, *search.cut))
    if state.causes and _outdone(search, state):
        return state
    plain = replace(state, fitted=state.base, present_unseen=state.base_unseen, steps=(), renamed=())
    search = supported(search)
    above = above_the_command(search)
    if above > OF_THE_COMMAND:
        state = replace(state, doubts=(*state.doubts, _no_base(search, above)))
    kept = replace(plain, with_noise=search, doubts=state.doubts)
    if not search.accepted:
        return kept if not state.causes else replace(kept, doubts=(*state.doubts, _dropped(state.causes)))
    fitted = _as_fitted(state, search)
    doubt = Doubt(
        "process-noise",
        f"a slowly varying force is present ({words_of_noise(search)}). With it modelled, the reported causes still "
        f"improve prediction of the {search.dof} in held-out runs",
        "treat the causes as hypotheses. Repeat in calm water, or record a run in which the craft returns to rest",
    )
    return replace(kept, fitted=fitted or state.base, doubts=(*state.doubts, doubt))


def model_noise_before_joining(state: SearchState) -> SearchState | None:
    """Return the search of the fitted runs with a drifting force, before the separate runs are added to them.

    Example: three runs of a BlueBoat identify damping that grows with speed, and predict the two separate runs. All
    five together identify nothing. If nothing is found, only the computed results are kept.
    """
    if not state.question.unseen:
        return None
    modelled = model_process_noise(state)
    if modelled is None or (modelled.with_noise is not None and modelled.with_noise.accepted):
        return modelled
    return replace(state, noise_search=modelled.noise_search)


def _no_base(search: NoiseSearch, above: float) -> Doubt:
    return Doubt(
        "above-command",
        f"a drifting {'moment' if DOFS[search.dof].angular else 'force'} drives the {search.dof} {above:.1f} times "
        "as hard as the commands do. With so large a disturbance no cause can be identified",
        "use larger commands or record in calmer water. Check that the commands in the file are those that drove the "
        "craft",
    )


def no_model_with_noise(state: SearchState) -> bool:
    """Return whether a search with process noise was made and found no model of the craft."""
    return (
        state.noise_search is not None
        and state.noise_search[1] is None
        and noise_equation(state.noise_search[0]) is not None
    )


def _without_names(state: SearchState) -> SearchState:
    """Return the state without causes, because no model of the craft was found with process noise.

    Causes that couple degrees of freedom are kept.
    """
    equation = noise_equation(state.problem)
    if equation is not None and _couples(state.causes, equation[0].dofs[0]):
        return state
    names = ", ".join(map(effect_at, state.causes))
    doubt = Doubt(
        NO_MODEL,
        "no model of the craft fits these runs with process noise modelled, from any starting point, and the residual "
        "is more than noise" + (f". {names} is therefore not identified" * bool(names)),
        "check columns, units and clocks first. Then record in calmer water, or use slower and larger commands",
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
    """Return whether some cause acts on a degree of freedom other than *dof*, so that *dof* alone cannot test it."""
    return any(n[0] != DOFS[dof].force for e in causes for n in EFFECTS[e.slug].derivatives(e))


def _outdone(search: NoiseSearch, state: SearchState) -> bool:
    """Return whether the causes of the earlier search explain the runs better, also with process noise.

    Causes that couple motions are kept, because a single motion cannot test them.
    """
    if _couples(state.causes, search.dof):
        return True
    named = {key_of(a.effect) for a in search.accepted}
    scaled = [_per_inertia(e, search, state) for e in state.causes]
    if {(e.slug, e.place) for e in scaled} <= named:
        return False
    # The noise took what the causes explain, so beside them there is less of it, and another craft.
    own, noise = per_inertia_of(state.fitted, search.problem.form), search.fit.noise
    starts = ((search.fit.theta, noise), (own, noise), (own, replace(noise, size=LESS * noise.size)))
    fits = [search.problem.fit(theta, scaled, noise) for theta, noise in starts]
    other = max((f for f in fits if f is not None), key=lambda f: f.total, default=None)
    if other is None:
        return False
    price = other.price(other.unknowns - search.fit.unknowns)
    if search.fit.gain < 0.0 < other.gain:
        # Of a command with its sign wrong all along the filter had turned the gain round, which explains as much.
        return other.total - price > search.fit.total - 0.5 * ALIKE
    # Where this search names nothing, the other's name is the luckiest of all that were tried.
    luck = 0.0 if search.accepted else math.log(max(state.tried, 1))
    return other.total - price > search.fit.total + luck


def _no_disturbance(search: NoiseSearch) -> Doubt:
    return Doubt(
        "no-weather",
        f"the disturbance of the {search.dof} has a correlation time of {search.plain.noise.memory:.2g} s, at most "
        "two samples. Wind, wake or current usually vary more slowly",
        "check that each command is stamped when it takes effect, and that the sensor is logged unfiltered. A fault "
        "in either has this effect",
    )


def _dropped(causes: Sequence[EffectInstance]) -> Doubt:
    names = ", ".join(map(effect_at, causes))
    return Doubt(
        "not-under-process-noise",
        f"{names} lowers the error only without process noise modelled. With it modelled, prediction of held-out "
        "runs does not improve",
        "repeat the runs in calmer water",
    )


def _per_inertia(effect: EffectInstance, search: NoiseSearch, state: SearchState) -> EffectInstance:
    """Convert *effect* of the present model to units per inertia of that model.

    A base that has diverged may have no usable inertia of its own.
    """
    i = state.fitted.form.dofs.index(search.dof)
    return scaled(effect, 1.0 / float(state.fitted.model.base.inertia[i, i]), 1.0)


def _as_fitted(state: SearchState, search: NoiseSearch) -> Fitted | None:
    """Return the model of the search in the base model's form and units, with suitable initial states."""
    d, base = DOFS[search.dof], state.base
    inertia = search.inertia
    gain, damping = search.fit.theta
    values = {
        f"{d.force}_{d.velocity}dot": -inertia,
        f"{d.force}_{d.velocity}": float(damping) * inertia,
        f"k_{d.force}": float(gain) * inertia,
    }
    names = base.form.parameters
    theta = np.array([values.get(n, v) for n, v in zip(names, base.theta.tolist(), strict=True)])
    effects = in_order([search.in_base_units(e) for e in search.fit.effects])
    # The states of a base that is lost may be no craft's.
    starts = (base.initial, state.problem.first_states(state.problem.segments))
    with np.errstate(all="ignore"):
        fits = [state.problem.states(theta, effects, initial) for initial in starts]
    return min((f for f in fits if f is not None), key=lambda f: f.cost, default=None)
