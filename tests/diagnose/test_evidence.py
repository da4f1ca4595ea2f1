"""Evidence for a cause: conditions on reported causes, noticeable gains, and hints."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from benchmarks.blind.case import draw_case
from gcs_autotune.diagnose import Diagnosis, ErrorReduction, diagnose, process_noise, search_with_noise, strategies
from gcs_autotune.diagnose.evidence import chance_of, equivalent_gain, hints_of, weak_among
from gcs_autotune.diagnose.process_noise import NoiseSearch, supported
from gcs_autotune.diagnose.result import Value
from gcs_autotune.diagnose.score import CandidateScore, SearchStep, lack_by_parts
from gcs_autotune.diagnose.state import SearchState
from gcs_autotune.effects import EffectInstance, may_be_none, name_of
from gcs_autotune.identify.kalman import NoisyFit
from gcs_autotune.identify.signals import Segment

MANY = [
    *("input-bias", "dead-zone", "gain-drift", "quadratic-drag", "asymmetric-thrust", "quadratic-actuator"),
    *("saturation", "backlash", "input-delay", "actuator-lag", "rate-limit", "advance-speed-loss", "wind-moment"),
    *("tether-pull", "rudder-stall", "linear-drag"),
]


def with_mild_disturbance(seed: int, slug: str, effects: list[str] | None = None) -> Diagnosis:
    """Two relays and steps with a drifting moment of some 30 % of full command, and an effect hidden."""
    return diagnose(list(draw_case("mild", seed, 0, slug).runs), effects=effects or MANY)


# -- what may be reported as a cause


@pytest.mark.parametrize(
    ("std", "none"),
    [(1.75, True), (0.2, False), (math.nan, True), (math.inf, True)],
)
def test_a_parameter_whose_interval_contains_zero_is_not_a_cause(std: float, none: bool) -> None:
    damping = EffectInstance("speed-damping", "yaw", {"N_|u|r": -0.71})
    assert may_be_none(damping, {"N_|u|r": std}) is none
    assert not may_be_none(damping, {})  # it was not fitted


def scored(
    effect: EffectInstance,
    gained: float,
    unseen: Sequence[float],
    needed: float,
    interval: tuple[float, float] = (0.0, math.inf),
) -> CandidateScore[NoisyFit]:
    """Return a candidate's score with process noise, as far as its evidence goes."""
    parts = np.array(unseen)
    evidence, gain = 2.0 * float(parts.sum()), 0.1 * float(parts.sum())
    fit = cast(NoisyFit, None)
    return CandidateScore(effect, fit, gained, needed, 1, evidence, gain, parts=parts, interval=interval)


def test_an_uncertain_candidate_is_not_accepted_even_with_a_large_gain() -> None:
    effect = EffectInstance("speed-damping", "yaw", {"N_|u|r": -0.71})
    sure = scored(effect, 30.0, (9.0, 8.0, 9.0), 7.0, (10.0, 40.0))
    assert lack_by_parts(sure) is None and lack_by_parts(sure, uncertain=True) == "uncertain"


@pytest.mark.parametrize(
    ("unseen", "named"),
    [((4.7, 4.1, 2.2), True), ((9.7, 0.2, 0.2), False), ((4.7, 5.1), False), ((2.0, 2.0, 2.0), False)],
)
def test_a_gain_of_ten_nats_shared_by_every_held_out_part_is_accepted(unseen: tuple[float, ...], named: bool) -> None:
    effect = EffectInstance("backlash", "N", {"width": 0.1})
    lacks = lack_by_parts(scored(effect, 11.2, unseen, 6.4, (-3.2, 25.3)))
    assert (lacks is None) is named


def searched(*named: str) -> NoiseSearch:
    effects = tuple(EffectInstance(slug, "N", {}) for slug in named)
    fit = SimpleNamespace(theta=None, effects=effects, noise=None, errors_of=lambda _: {})
    plain = SimpleNamespace(theta=None, effects=(), noise=None)
    problem = SimpleNamespace(fit=lambda theta, rest, noise: SimpleNamespace(effects=rest, errors_of=lambda _: {}))
    causes = [replace(scored(e, 20.0, (9.0, 9.0), 6.4), fit=cast(NoisyFit, fit)) for e in effects]
    steps = tuple(SearchStep(cast(NoisyFit, plain), (one,), one) for one in causes)
    plain_search: dict[str, Any] = {"dof": "yaw", "calm": 50.0, "tried": 9, "words": "", "folds": ()}
    return NoiseSearch(problem=problem, plain=plain, fit=fit, steps=steps, **plain_search)  # type: ignore[arg-type]


def test_with_process_noise_a_cause_gets_also_the_share_of_the_one_it_replaces() -> None:
    """A constant force, then backlash; a dead zone then replaces the constant."""
    constant, backlash, zone = (EffectInstance(slug, "N", {}) for slug in ("input-bias", "backlash", "dead-zone"))

    def fit(variance: float, *effects: EffectInstance) -> NoisyFit:
        return cast(NoisyFit, SimpleNamespace(effects=effects, noise=SimpleNamespace(size=math.sqrt(variance))))

    def step(present: NoisyFit, own: EffectInstance, fit: NoisyFit) -> SearchStep[NoisyFit]:
        won = replace(scored(own, 20.0, (9.0, 9.0), 6.4), fit=fit)
        return SearchStep(present, (won,), won)

    plain, one, two = fit(1.0), fit(0.5, constant), fit(0.3, constant, backlash)
    without, last = fit(0.7, backlash), fit(0.2, backlash, zone)
    steps = step(plain, constant, one), step(one, backlash, two), step(without, zone, last)
    search = replace(searched(), plain=plain, fit=last, steps=steps)
    assert search.shares(()) == pytest.approx({("backlash", "N"): 0.3, ("dead-zone", "N"): 0.5})
    assert replace(search, fit=fit(0.6, zone)).shares(()) == pytest.approx({("dead-zone", "N"): 0.4})


def test_a_cause_that_does_not_reduce_the_held_out_prediction_error_is_rejected(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The weakest goes first, and the others are judged without it."""
    ratios = {frozenset(): 1.15, frozenset({"dead-zone"}): 0.97, frozenset({"backlash"}): 0.8}

    def gain_over(search: NoiseSearch, other: Any) -> ErrorReduction:
        ratio = ratios[frozenset(e.slug for e in other.effects)]
        return ErrorReduction("error 1 s ahead", "psi", "rad", 1.0, ratio, ratio, (ratio, ratio))

    monkeypatch.setattr(NoiseSearch, "gain_over", gain_over)
    monkeypatch.setattr(process_noise, "above_the_command", lambda search: 0.5)
    one = supported(searched("dead-zone"))
    assert not one.accepted and not one.own_gains
    assert [(a.effect.slug, a.lacks) for a in one.refused] == [("dead-zone", "no-gain")]
    two = supported(searched("dead-zone", "backlash"))
    assert [a.effect.slug for a in two.accepted] == ["dead-zone", "backlash"] and not two.refused
    assert two.own_gains["dead-zone", "N"].ratio == 0.8
    monkeypatch.setattr(process_noise, "above_the_command", lambda search: 1.2)
    none = supported(searched("dead-zone", "backlash"))
    assert not none.accepted and not none.own_gains and {a.lacks for a in none.refused} == {"no-model"}


# -- hints


def test_evidence_is_measured_by_its_probability_under_chance() -> None:
    assert equivalent_gain(6.0, 1) == pytest.approx(6.0)
    assert equivalent_gain(6.0, 2) < equivalent_gain(6.0, 1)
    assert chance_of(3.0, 1, 1) == pytest.approx(0.0143, abs=1e-4)
    assert chance_of(3.0, 1, 40) == pytest.approx(0.438, abs=1e-3)


@pytest.mark.slow
def test_a_weak_cause_is_only_a_hint() -> None:
    result = with_mild_disturbance(7, "quadratic-drag")
    assert result.verdict == "unexplained" and not result.causes
    first = result.hints[0]
    assert first.cause == "quadratic-drag" and 3.0 < first.gained < 10.0 and first.lacks == "weak"
    assert sum(first.unseen) > 0.0 and len(first.unseen) == 3
    assert first.needed == pytest.approx(first.seconds * 10.0 / first.gained)
    assert 0.0 < first.chance < 0.05


@pytest.mark.slow
def test_a_constant_force_is_identified_together_with_a_drifting_one() -> None:
    (cause,) = with_mild_disturbance(5, "input-bias").causes
    assert cause.effect.slug == "input-bias" and cause.effect["bias"] == pytest.approx(1.25, rel=0.2)


@pytest.mark.slow
def test_a_lag_shorter_than_a_sample_is_only_a_hint() -> None:
    """A sensor's filter looks the same, so that it is never named; what fits worse does not take its place."""
    result = with_mild_disturbance(33, "actuator-lag", ["actuator-lag", "tether-pull"])
    assert not result.causes
    assert (result.hints[0].cause, result.hints[0].lacks) == ("actuator-lag", "brief")


@pytest.mark.slow
def test_no_hint_on_a_clean_craft() -> None:
    result = with_mild_disturbance(108, "clean")
    assert result.verdict == "unexplained" and not result.hints


@pytest.mark.slow
def test_no_cause_is_reported_with_a_disturbance_larger_than_the_commands(monkeypatch: pytest.MonkeyPatch) -> None:
    """What would have been a cause is a hint with the reason why it is not one."""
    for module in (process_noise, search_with_noise):
        monkeypatch.setattr(module, "above_the_command", lambda search: 1.3)
    result = with_mild_disturbance(5, "backlash", ["backlash", "dead-zone"])
    assert result.verdict == "unexplained"
    assert "above-command" in {d.slug for d in result.doubts}
    assert (result.hints[0].cause, result.hints[0].lacks) == ("backlash", "no-model")


def test_the_size_of_a_disturbance_is_compared_with_the_acting_command() -> None:
    """A thruster that saturates early: a third of full command in disturbance is more than what it gives."""
    result = with_mild_disturbance(1, "saturation", ["dead-zone", "backlash"])
    assert result.missing is not None and result.missing.share > 1.0
    assert "above-command" in {d.slug for d in result.doubts}


def test_a_second_velocity_product_may_be_a_hint() -> None:
    """They have one slug; the derivative distinguishes them."""

    def product(place: str) -> CandidateScore[NoisyFit]:
        effect = EffectInstance("velocity-product", place, {"coefficient": 1.0})
        return replace(scored(effect, 5.0, (2.0, 2.0, 1.0), 7.0, (-1.0, 9.0)), lacks="weak")

    named, other = product("N_|u|r"), product("N_|v|r")
    steps = (SearchStep(named.fit, (named,), named), SearchStep(named.fit, (named, other), None))
    search = SimpleNamespace(steps=steps, tried=10, names={name_of(named.effect)}, refused=())
    assert [w.one.effect.place for w in weak_among(cast(NoiseSearch, search))] == ["N_|v|r"]


def weak(slug: str, place: str, name: str, gain: float) -> CandidateScore[NoisyFit]:
    """A candidate that gains a little of what it gains on each of three parts left out."""
    one = scored(EffectInstance(slug, place, {name: 1.0}), gain, [0.3 * gain] * 3, 7.0, (-1.0, 9.0))
    return replace(one, lacks="weak")


def hinted(*judged: CandidateScore[NoisyFit], tried: int = 30) -> list[tuple[str, tuple[str, ...]]]:
    steps = (SearchStep(judged[0].fit, judged, None),)
    search = SimpleNamespace(steps=steps, names=(), refused=(), tried=tried)
    return [(w.one.effect.slug, w.alike) for w in weak_among(cast(NoiseSearch, search))]


@pytest.mark.parametrize(("std", "count"), [(0.006, 0), (0.001, 1)])
def test_a_number_that_may_be_zero_is_not_a_hint(std: float, count: int) -> None:
    late = weak("input-delay", "N", "delay", 9.0)
    numbers = {"delay": Value(0.006, "s", std)}
    steps = (SearchStep(late.fit, (late,), None),)
    told = SimpleNamespace(steps=steps, names=(), refused=(), tried=3, words="", values=lambda effect, fit: numbers)
    segment = SimpleNamespace(stamps=np.array([0.0, 60.0]), start=0.0, run="steps")
    assert len(hints_of(cast(NoiseSearch, told), (), [cast(Segment, segment)])) == count


def test_a_gain_expected_by_chance_among_the_candidates_is_not_a_hint() -> None:
    drag = weak("quadratic-drag", "yaw", "coefficient", 4.0)
    assert hinted(drag, tried=30) == []
    assert hinted(drag, tried=5) == [("quadratic-drag", ())]


def test_an_indistinguishable_hint_is_listed_with_the_stronger_one() -> None:
    thrust = weak("quadratic-actuator", "N", "share", 7.0)
    dead, late = weak("dead-zone", "N", "width", 4.5), weak("input-delay", "N", "delay", 3.5)
    assert hinted(thrust, dead, late) == [("quadratic-actuator", ("dead-zone",))]


def test_an_external_force_needs_more_evidence_with_a_drifting_force() -> None:
    assert hinted(weak("tether-pull", "yaw", "stiffness", 7.0)) == []
    assert hinted(weak("tether-pull", "yaw", "stiffness", 11.0)) == [("tether-pull", ())]
    assert hinted(weak("input-bias", "yaw", "bias", 7.0)) == [("input-bias", ())]


def test_hints_of_velocity_products_are_distinguished_by_their_derivatives() -> None:
    one, other = (weak("velocity-product", place, "coefficient", 12.0) for place in ("N_u", "N_|v|r"))
    assert [alike for _, alike in hinted(one, other)] == [("N_|v|r",), ("N_u",)]


@dataclass(frozen=True)
class WithOneCause:
    """A state with one cause."""

    causes: tuple[EffectInstance, ...]
    problem: object = None
    fitted: object = None
    renamed: tuple[tuple[str, str], ...] = ()


def test_a_velocity_product_that_fits_as_well_is_named_by_its_derivative(monkeypatch: pytest.MonkeyPatch) -> None:
    """Groups of equal causes have this name too. Under two names one cause looked like two."""
    product = EffectInstance("velocity-product", "N_u", {"coefficient": 0.1})

    def as_likely(problem: object, now: object, effect: EffectInstance, slugs: Sequence[str]) -> object:
        return (product, None) if product.slug in slugs else None

    monkeypatch.setattr(strategies, "_as_likely", as_likely)
    bias = WithOneCause((EffectInstance("input-bias", "yaw", {"bias": 0.1}),))
    assert strategies.tie_break(cast(SearchState, bias)).renamed == (("input-bias", "N_u"),)
