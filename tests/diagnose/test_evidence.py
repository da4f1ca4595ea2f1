"""What supports a cause: guards on names, gains a user notices, and hints."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from benchmarks.blind.case import draw_case
from gcs_autotune.diagnose import Diagnosis, ErrorReduction, diagnose, weathered
from gcs_autotune.diagnose.attested import Attested
from gcs_autotune.diagnose.evidence import chance_of, weak_under, worth
from gcs_autotune.diagnose.process_noise import WeatherSearch
from gcs_autotune.diagnose.score import may_be_none
from gcs_autotune.diagnose.weathered import supported
from gcs_autotune.effects import EffectInstance
from gcs_autotune.identify import WanderingFit

MANY = [
    *("input-bias", "dead-zone", "gain-drift", "quadratic-drag", "asymmetric-thrust", "quadratic-actuator"),
    *("saturation", "backlash", "input-delay", "actuator-lag", "rate-limit", "advance-speed-loss", "wind-moment"),
    *("tether-pull", "rudder-stall", "linear-drag"),
]


def in_mild_weather(seed: int, slug: str, effects: list[str] | None = None) -> Diagnosis:
    """Two relays and steps with a drifting moment of some 30 % of full command, and an effect hidden."""
    return diagnose(list(draw_case("mild", seed, 0, slug).runs), effects=effects or MANY)


# -- what may be named


@pytest.mark.parametrize(
    ("std", "none"),
    [(1.75, True), (0.2, False), (math.nan, True), (math.inf, True)],
)
def test_a_number_whose_own_interval_contains_zero_is_no_cause(std: float, none: bool) -> None:
    damping = EffectInstance("speed-damping", "yaw", {"N_|u|r": -0.71})
    assert may_be_none(damping, {"N_|u|r": std}) is none
    assert not may_be_none(damping, {})  # it was not fitted


def test_an_uncertain_candidate_is_not_named_however_much_it_gains() -> None:
    effect = EffectInstance("speed-damping", "yaw", {"N_|u|r": -0.71})
    sure = Attested(effect, cast(WanderingFit, None), 30.0, np.array([9.0, 8.0, 9.0]), 7.0, 1, (10.0, 40.0))
    assert sure.paid and not replace(sure, uncertain=True).paid


@pytest.mark.parametrize(
    ("unseen", "named"),
    [((4.7, 4.1, 2.2), True), ((9.7, 0.2, 0.2), False), ((4.7, 5.1), False), ((2.0, 2.0, 2.0), False)],
)
def test_ten_nats_to_which_every_part_left_out_contributes_are_named(unseen: tuple[float, ...], named: bool) -> None:
    effect = EffectInstance("backlash", "N", {"width": 0.1})
    assert Attested(effect, cast(WanderingFit, None), 11.2, np.array(unseen), 6.4, 1, (-3.2, 25.3)).paid is named


def searched(*named: str) -> WeatherSearch:
    effects = tuple(EffectInstance(slug, "N", {}) for slug in named)
    fit = SimpleNamespace(theta=None, effects=effects, water=None, errors_of=lambda _: {})
    plain = SimpleNamespace(theta=None, effects=(), water=None)
    problem = SimpleNamespace(fit=lambda theta, rest, water: SimpleNamespace(effects=rest, errors_of=lambda _: {}))
    attested = tuple(
        Attested(e, cast(WanderingFit, fit), 20.0, np.array([9.0, 9.0]), 6.4, k + 1) for k, e in enumerate(effects)
    )
    plain_search: dict[str, Any] = {"dof": "yaw", "judged": (), "calm": 50.0, "tried": 9, "parts": "", "folds": ()}
    return WeatherSearch(problem=problem, plain=plain, fit=fit, named=attested, alike=(), **plain_search)  # type: ignore[arg-type]


def test_what_lowers_no_error_ahead_on_data_left_out_is_not_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """The weakest goes first, and the others are judged without it."""
    ratios = {frozenset(): 1.15, frozenset({"dead-zone"}): 0.97, frozenset({"backlash"}): 0.8}

    def gain_over(search: WeatherSearch, other: Any) -> ErrorReduction:
        ratio = ratios[frozenset(e.slug for e in other.effects)]
        return ErrorReduction("error 1 s ahead", "psi", "rad", 1.0, ratio, ratio, (ratio, ratio))

    monkeypatch.setattr(weathered, "gain_over", gain_over)
    monkeypatch.setattr(weathered, "above_the_command", lambda search: 0.5)
    one, refused, gains = supported(searched("dead-zone"))
    assert not one.named and not gains
    assert [(a.effect.slug, why) for a, why in refused] == [("dead-zone", "no-gain")]
    two, refused, gains = supported(searched("dead-zone", "backlash"))
    assert [a.effect.slug for a in two.named] == ["dead-zone", "backlash"] and not refused
    assert gains["dead-zone", "N"].ratio == 0.8
    monkeypatch.setattr(weathered, "above_the_command", lambda search: 1.2)
    none, refused, gains = supported(searched("dead-zone", "backlash"))
    assert not none.named and not gains and {why for _, why in refused} == {"no-model"}


# -- hints


def test_evidence_is_counted_by_how_rarely_chance_gives_it() -> None:
    assert worth(6.0, 1) == pytest.approx(6.0)
    assert worth(6.0, 2) < worth(6.0, 1)
    assert chance_of(3.0, 1, 1) == pytest.approx(0.0143, abs=1e-4)
    assert chance_of(3.0, 1, 40) == pytest.approx(0.438, abs=1e-3)


def test_a_weak_cause_is_a_hint_and_no_name() -> None:
    told = in_mild_weather(7, "quadratic-drag")
    assert told.verdict == "unexplained" and not told.causes
    first = told.hints[0]
    assert first.cause == "quadratic-drag" and 3.0 < first.gained < 10.0 and first.lacks == "weak"
    assert sum(first.unseen) > 0.0 and len(first.unseen) == 3
    assert first.needed == pytest.approx(first.seconds * 10.0 / first.gained)
    assert 0.0 < first.chance < 0.05


def test_a_constant_force_beside_a_drifting_one_is_identified() -> None:
    (cause,) = in_mild_weather(5, "input-bias").causes
    assert cause.effect.slug == "input-bias" and cause.effect["bias"] == pytest.approx(1.25, rel=0.2)


def test_a_lag_shorter_than_a_sample_is_a_hint_and_no_name() -> None:
    """A sensor's filter looks the same, so that it is never named; what fits worse does not take its place."""
    told = in_mild_weather(33, "actuator-lag", ["actuator-lag", "tether-pull"])
    assert not told.causes
    assert (told.hints[0].cause, told.hints[0].lacks) == ("actuator-lag", "brief")


def test_no_hint_on_a_clean_craft() -> None:
    told = in_mild_weather(108, "clean")
    assert told.verdict == "unexplained" and not told.hints


def test_beside_a_disturbance_above_the_commands_nothing_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """What would have been named is a hint that says why it is none."""
    monkeypatch.setattr(weathered, "above_the_command", lambda search: 1.3)
    told = in_mild_weather(5, "backlash", ["backlash", "dead-zone"])
    assert told.verdict == "unexplained"
    assert "above-command" in {d.slug for d in told.doubts}
    assert (told.hints[0].cause, told.hints[0].lacks) == ("backlash", "no-model")


def test_the_size_of_a_disturbance_is_compared_with_what_is_commanded() -> None:
    """A thruster that saturates early: a third of full command in disturbance is more than what it gives."""
    told = in_mild_weather(1, "saturation", ["dead-zone", "backlash"])
    assert told.missing is not None and told.missing.share > 1.0
    assert "above-command" in {d.slug for d in told.doubts}


def test_a_product_beside_another_named_product_may_be_a_hint() -> None:
    """They have one slug; the derivative tells them apart."""

    def product(place: str, step: int) -> Attested:
        effect = EffectInstance("velocity-product", place, {"coefficient": 1.0})
        fit = cast(WanderingFit, SimpleNamespace(effects=(effect,), free_effects=((0, "coefficient"),)))
        return Attested(effect, fit, 5.0, np.array([2.0, 2.0, 1.0]), 7.0, step, (-1.0, 9.0))

    named, other = product("N_|u|r", 1), product("N_|v|r", 2)
    search = SimpleNamespace(judged=(named, other), alike=(), named=(named,), tried=10)
    assert [w.one.effect.place for w in weak_under(cast(WeatherSearch, search))] == ["N_|v|r"]


def weak(slug: str, place: str, name: str, gain: float) -> Attested:
    """A candidate that gains a little of what it gains on each of three parts left out."""
    effect = EffectInstance(slug, place, {name: 1.0})
    fit = cast(WanderingFit, SimpleNamespace(effects=(effect,), free_effects=((0, name),)))
    return Attested(effect, fit, gain, np.array([0.3, 0.3, 0.3]) * gain, 7.0, 1, (-1.0, 9.0))


def hinted(*judged: Attested, tried: int = 30) -> list[tuple[str, tuple[str, ...]]]:
    search = SimpleNamespace(judged=judged, alike=(), named=(), tried=tried)
    return [(w.one.effect.slug, w.alike) for w in weak_under(cast(WeatherSearch, search))]


def test_what_noise_gives_one_of_so_many_candidates_is_no_hint() -> None:
    drag = weak("quadratic-drag", "yaw", "coefficient", 4.0)
    assert hinted(drag, tried=30) == []
    assert hinted(drag, tried=5) == [("quadratic-drag", ())]


def test_hints_that_the_runs_do_not_distinguish_name_each_other() -> None:
    thrust = weak("quadratic-actuator", "N", "share", 7.0)
    dead, late = weak("dead-zone", "N", "width", 4.5), weak("input-delay", "N", "delay", 3.5)
    assert hinted(thrust, dead, late) == [("quadratic-actuator", ("dead-zone",))]


def test_a_force_from_outside_needs_more_beside_a_drifting_force() -> None:
    assert hinted(weak("tether-pull", "yaw", "stiffness", 7.0)) == []
    assert hinted(weak("tether-pull", "yaw", "stiffness", 11.0)) == [("tether-pull", ())]
    assert hinted(weak("input-bias", "yaw", "bias", 7.0)) == [("input-bias", ())]
