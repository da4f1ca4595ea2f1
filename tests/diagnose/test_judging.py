"""Evidence, p-values and held-out parts, number by number, on made-up fits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from open_loop_runs import towed
from scipy import stats

from gcs_autotune.diagnose import report_builder
from gcs_autotune.diagnose.heldout import HeldOut, Parts, blocks, p_value, parts_of, ratio_interval, rms_of
from gcs_autotune.diagnose.retries import _refuted, _surely_gains
from gcs_autotune.diagnose.score import (
    ALIKE,
    LUCK,
    SIGNIFICANCE,
    CandidateScore,
    SearchStep,
    bic_penalty,
    error_ratio,
    is_material,
    is_needed,
    key_of,
    lack_by_error,
    needed_of,
    ordered,
    winner_of,
)
from gcs_autotune.diagnose.state import SearchState
from gcs_autotune.effects import EffectInstance
from gcs_autotune.identify.problems.base_model import plain_form
from gcs_autotune.identify.problems.fitted import Fitted
from gcs_autotune.identify.problems.likelihood import Residual
from gcs_autotune.identify.problems.problem import Problem
from gcs_autotune.identify.signals.preparation import prepare_as_recorded
from gcs_autotune.identify.signals.segment import Segment
from gcs_autotune.models.coupled import CoupledModel
from gcs_autotune.models.coupled.form import Form

# --- evidence --------------------------------------------------------------------------------


def fit(
    parameters: int, *, samples: int = 500, cost: float = 0.0, learnt: int = 0, signals: tuple[str, ...] = ("r",)
) -> Fitted:
    """Return as much of a fit as judging looks at; *learnt* numbers were learnt from the residuals."""
    wave = EffectInstance("wave-disturbance", "yaw", {f"w{i}": 1.0 for i in range(learnt)})
    return cast(
        Fitted,
        SimpleNamespace(
            parameters=parameters,
            samples=samples,
            cost=cost,
            effects=(wave,) if learnt else (),
            levels=dict.fromkeys(signals, 1.0),
        ),
    )


BASE = fit(3)


def judged(slug: str, tried: int = 10, **values: Any) -> CandidateScore[Fitted]:
    result: dict[str, Any] = {"fit": fit(4), "evidence": 50.0, "gained": 30.0, "gain": 0.3, "p": 1e-6, **values}
    found = CandidateScore(EffectInstance(slug, "yaw", {}), needed=needed_of(1, tried), numbers=1, **result)
    return replace(found, lacks=lack_by_error(found))


@pytest.mark.parametrize(("parameters", "learnt", "more"), [(3, 0, 0), (4, 0, 1), (5, 0, 2), (4, 3, 4), (2, 0, -1)])
def test_every_extra_parameter_costs_the_logarithm_of_the_samples(parameters: int, learnt: int, more: int) -> None:
    assert bic_penalty(fit(parameters, learnt=learnt), BASE) == pytest.approx(more * math.log(500))


def test_parameters_of_the_present_model_are_not_penalised_again() -> None:
    assert bic_penalty(fit(5, learnt=3), fit(3, learnt=3)) == pytest.approx(2.0 * math.log(500))


@pytest.mark.parametrize("tried", [1, 10, 300])
@pytest.mark.parametrize("more", [1, 2])
def test_more_candidates_require_more_evidence(tried: int, more: int) -> None:
    edge = stats.chi2.isf(SIGNIFICANCE / tried, more)
    assert is_needed(1.001 * edge, fit(3 + more), BASE, tried)
    assert not is_needed(0.999 * edge, fit(3 + more), BASE, tried)


def test_only_new_parameters_learnt_from_the_residuals_are_counted() -> None:
    edge = float(stats.chi2.isf(SIGNIFICANCE, 4))
    for likelihood, enough in ((0.999 * edge, False), (1.001 * edge, True)):
        assert is_needed(likelihood, fit(4, learnt=3), BASE, 1) is enough
        assert is_needed(likelihood, fit(4, learnt=5), fit(3, learnt=2), 1) is enough


def test_a_cause_without_a_parameter_is_judged_as_if_it_had_one() -> None:
    edge = stats.chi2.isf(SIGNIFICANCE, 1)
    assert not is_needed(0.999 * edge, fit(3), BASE, 0)
    assert is_needed(1.001 * edge, fit(3), BASE, 0)


@pytest.mark.parametrize(
    ("gain", "signals", "material"),
    [
        (0.021, ("r",), True),
        (0.019, ("r",), False),
        (0.0, ("r",), False),
        (-0.5, ("r",), False),
        (0.011, ("r", "psi"), True),
        (0.009, ("r", "psi"), False),
        (1.0, ("r",), True),
    ],
)
def test_a_held_out_gain_is_material_by_its_sum_over_signals(
    gain: float, signals: tuple[str, ...], material: bool
) -> None:
    assert is_material(judged("input-bias", gain=gain, fit=fit(4, signals=signals))) is material


@pytest.mark.parametrize(
    "spoilt", [{"evidence": 0.0}, {"gained": 1.0}, {"gain": 0.0}, {"p": LUCK}, {"p": 0.5}], ids=repr
)
def test_a_winner_passes_every_test(spoilt: dict[str, float]) -> None:
    good = judged("input-bias")
    assert winner_of([good]) is good
    assert winner_of([judged("input-bias", **spoilt)]) is None
    assert winner_of([judged("saturation", **spoilt), good]) is good


def test_evidence_sufficient_for_one_candidate_is_insufficient_among_a_thousand() -> None:
    once, often = (judged("input-bias", tried, gained=7.5) for tried in (1, 1000))
    assert winner_of([once]) is once
    assert winner_of([often]) is None


def test_a_disturbance_yields_only_to_a_cause_that_predicts_better() -> None:
    wave = judged("wave-disturbance", gain=0.3)
    better, worse = judged("input-bias", gain=0.31), judged("input-bias", gain=0.29)
    assert winner_of([wave, better]) is better
    assert winner_of([wave, worse]) is wave
    assert winner_of([wave, judged("quantisation", gain=0.4)]) is wave
    assert winner_of([worse, better]) is worse, "the likeliest, not the one that gains most"


def test_a_sign_error_yields_only_to_a_cause_that_fits_and_predicts_better() -> None:
    slip = judged("sign-error", gain=0.3, fit=fit(3, cost=100.0))
    assert winner_of([slip, judged("saturation", gain=0.4, fit=fit(4, cost=90.0))]) is not slip
    assert winner_of([slip, judged("saturation", gain=0.4, fit=fit(4, cost=110.0))]) is slip
    assert winner_of([slip, judged("saturation", gain=0.2, fit=fit(4, cost=90.0))]) is slip
    saturated = judged("saturation", gain=0.3, fit=fit(4, cost=100.0))
    assert winner_of([saturated, judged("input-bias", gain=0.4, fit=fit(4, cost=90.0))]) is saturated


def test_equally_likely_causes_are_ordered_by_how_usual_they_are() -> None:
    late = judged("measurement-delay", evidence=50.0)
    usual = judged("input-delay", evidence=50.0 - 0.9 * ALIKE)
    far = judged("input-delay", evidence=50.0 - 1.1 * ALIKE)
    assert ordered([usual, late]) == [usual, late]
    assert ordered([late, usual]) == [usual, late]
    assert ordered([far, late]) == [late, far]
    loss, drag = judged("advance-speed-loss", evidence=50.0), judged("quadratic-drag", evidence=50.0 - 0.5 * ALIKE)
    assert ordered([loss, drag]) == [drag, loss]


# --- unseen data --------------------------------------------------------------------------------


def rest(judged: Sequence[float], *, signal: str = "r", fold: int = 0, penalty: float = 0.0) -> Residual:
    values = np.array(judged, dtype=np.float64)
    nothing = np.zeros(len(values))
    return Residual(0, signal, nothing, nothing, nothing, values, penalty=penalty, fold=fold)


def held(*rests: Residual, complete: bool = True) -> HeldOut:
    return HeldOut(rests, complete)


def test_the_error_ratio_is_the_geometric_mean_over_signals() -> None:
    before = held(rest([2.0, -2.0]), rest([3.0, 3.0], signal="psi"))
    after = held(rest([1.0, 1.0]), rest([6.0, -6.0, math.nan], signal="psi"))
    assert rms_of(after.rests) == {"r": 1.0, "psi": 6.0}
    assert error_ratio(before, after) == pytest.approx(1.0)
    assert error_ratio(before, held(rest([1.0, 1.0]))) == pytest.approx(0.5)
    assert error_ratio(held(), after) == 1.0


OLD, NEW = [2.0, -2.0, 2.0, -2.0], [1.0, -1.0, 1.0, -1.0]


def p_value_of(before: HeldOut, after: HeldOut, *, numbers: int = 0, tried: int = 1, raised: float = 1.0) -> float:
    return p_value(before, after, {"r": 0.5, "psi": 0.5}, raised, numbers, tried)


def many(values: Sequence[float], n: int = 10, **options: Any) -> Residual:
    return rest([*values] * n, **options)


def test_the_p_value_is_the_inverse_split_likelihood_ratio_times_the_tries() -> None:
    level = {"r": 1.0}
    gained = 0.5 * 40 * (math.log(4.0) + 1.0) - 0.5 * 40 * 1.0
    for numbers, tried, raised in ((0, 1, 1.0), (2, 1, 1.0), (2, 7, 1.0), (2, 7, 3.0)):
        p = p_value(held(many(OLD)), held(many(NEW)), level, raised, numbers, tried)
        assert p == pytest.approx(tried * math.exp(-(gained - numbers) / raised), rel=1e-9)
    assert p_value(held(many(OLD)), held(many(NEW)), level, 1.0, 0, 10**14) == 1.0


def test_the_p_value_uses_the_noise_level_of_each_signal() -> None:
    old, new, n = [2.0, -2.0, 2.0, -2.0], [1.0, -1.0, 1.0, -1.0], 40
    for level in (0.5, 1.0, 2.0):
        gained = 0.5 * n * (math.log(4.0) + 1.0) - 0.5 * n * (math.log(level**2) + 1.0 / level**2)
        p = p_value(held(many(old)), held(many(new)), {"r": level}, 10.0, 0, 1)
        assert p == pytest.approx(min(1.0, math.exp(-max(gained, 0.0) / 10.0)), rel=1e-9)


def test_the_p_value_is_averaged_over_folds_like_e_values() -> None:
    before = held(many(OLD, fold=0), many(OLD, 2, fold=1))
    after = held(many(NEW, fold=0), many(NEW, 2, fold=1))
    first, second = (p_value(held(many(OLD, n)), held(many(NEW, n)), {"r": 1.0}, 1.0, 0, 1) for n in (10, 2))
    assert p_value(before, after, {"r": 1.0}, 1.0, 0, 1) == pytest.approx(2.0 / (1.0 / first + 1.0 / second))


def test_a_penalty_counts_against_the_model_that_has_it() -> None:
    level = {"r": 1.0}
    plain = p_value(held(many(OLD)), held(many(NEW)), level, 1.0, 0, 1)
    paid_after = p_value(held(many(OLD)), held(many(NEW, penalty=4.0)), level, 1.0, 0, 1)
    paid_before = p_value(held(many(OLD, penalty=4.0)), held(many(NEW)), level, 1.0, 0, 1)
    assert (paid_after / plain, paid_before / plain) == (pytest.approx(math.exp(2.0)), pytest.approx(math.exp(-2.0)))


def test_a_diverged_model_or_one_of_other_data_has_p_one() -> None:
    before, after = held(many(OLD)), held(many(NEW))
    assert p_value_of(before, HeldOut(after.rests, complete=False)) == 1.0
    assert p_value_of(before, held(*after.rests, *after.rests)) == 1.0
    assert p_value_of(held(), held()) == 1.0


@pytest.mark.parametrize(
    ("after", "is_sure"),
    [
        ({"r": [0.5] * 64}, True),
        ({"r": [0.5] * 16 + [1.2] * 48}, False),
        ({"r": [1.1] * 64}, False),
        ({"r": [1.1] * 64, "psi": [0.5] * 64}, True),
        ({"r": [0.5] * 12}, False),
    ],
)
def test_causes_found_in_pieces_are_certain_if_together_they_reduce_an_error(
    after: dict[str, list[float]], is_sure: bool
) -> None:
    before = held(*(rest([1.0] * len(left), signal=name) for name, left in after.items()))
    now = held(*(rest(left, signal=name) for name, left in after.items()))
    searched = SimpleNamespace(base_unseen=before, present_unseen=now, parts=SimpleNamespace(words=""))
    assert _surely_gains(cast(SearchState, searched)) is is_sure


def test_blocks_are_equal_and_a_missing_sample_is_left_out_of_its_own_model() -> None:
    lost = [*[1.0] * 15, math.nan]
    found, size = blocks([rest([2.0] * 16)], [rest(lost)])
    assert size == 8
    assert found == [("r", 32.0, 8.0, 8), ("r", 32.0, 7.0, 7)]
    assert blocks([rest([math.nan] * 16)], [rest([1.0] * 16)])[0] == []


def test_the_interval_of_a_ratio_contains_it_and_needs_three_blocks() -> None:
    noise = np.random.default_rng(4).normal(size=4800)
    low, high = ratio_interval([rest(2.0 * noise)], [rest(noise[::-1])])
    assert low < 0.5 < high
    assert high - low < 0.1
    assert all(math.isnan(edge) for edge in ratio_interval([rest([1.0] * 16)], [rest([1.0] * 16)]))


# --- what is left out --------------------------------------------------------------------------------


def segments(runs: int) -> list[Segment]:
    towed_runs = towed(runs=runs, samples=100)
    return prepare_as_recorded(towed_runs, plain_form(towed_runs))[0]


def problem_of(own: Sequence[Segment]) -> Problem:
    """Return a problem with segments only; initial states are identified by run and first stamp."""

    def first_states(wanted: Sequence[Segment]) -> tuple[Any, ...]:
        return tuple((s.run, s.start) for s in wanted)

    return cast(Problem, SimpleNamespace(segments=tuple(own), first_states=first_states))


def samples_of(parts: Sequence[Segment]) -> list[tuple[str, float]]:
    return [(s.run, float(t)) for s in parts for t in s.signals["r"].t]


@pytest.mark.parametrize(
    ("runs", "in_blocks", "kind", "folds", "words"),
    [
        (1, False, "blocks", 4, "4 blocks of the run held out in turn"),
        (3, False, "runs", 3, "each of 3 runs held out in turn"),
        (6, False, "runs", 4, "4 groups of runs held out in turn"),
        (3, True, "blocks", 4, "4 blocks of every run held out in turn"),
    ],
)
def test_every_sample_is_tested_once_and_never_fitted_in_the_same_fold(
    runs: int, in_blocks: bool, kind: str, folds: int, words: str
) -> None:
    own = segments(runs)
    parts = parts_of(problem_of(own), in_blocks=in_blocks)
    assert (parts.kind, len(parts.folds), parts.words) == (kind, folds, words)
    every = sorted(samples_of(own))
    tested = []
    for fold in parts.folds:
        fitted, predicted = samples_of(fold.train), samples_of(fold.test)
        assert predicted
        assert not set(fitted) & set(predicted)
        assert sorted(fitted + predicted) == every
        tested += predicted
    assert sorted(tested) == every
    _starts_belong(parts)


def test_held_out_runs_are_only_tested() -> None:
    own = segments(3)
    parts = parts_of(problem_of(own[:2]), own[2:])
    (fold,) = parts.folds
    assert (parts.kind, fold.train, fold.test) == ("apart", tuple(own[:2]), tuple(own[2:]))
    assert parts.words == "held-out runs: run2"
    _starts_belong(parts)


def _starts_belong(parts: Parts) -> None:
    result = [[(s.run, s.start) for s in fold.train] for fold in parts.folds]
    assert [list(states) for states in parts.starts] == result
    result = [[(s.run, s.start) for s in fold.test] for fold in parts.folds]
    assert [list(states) for states in parts.tests] == result


@pytest.mark.parametrize(("evidence", "first"), [(30.0, "sway-moment"), (20.0, "munk-moment")])
def test_the_simpler_law_of_a_cause_is_preferred_if_about_as_likely(evidence: float, first: str) -> None:
    """Which of two laws of one cause was likelier changed with the time limit of a search."""
    found = winner_of([judged("munk-moment"), judged("sway-moment", evidence=evidence)])
    assert found is not None and found.effect.slug == first


def test_a_simpler_law_at_another_place_is_another_cause() -> None:
    elsewhere = replace(judged("sway-moment"), effect=EffectInstance("sway-moment", "pitch", {}))
    found = winner_of([judged("munk-moment", evidence=60.0), elsewhere])
    assert found is not None and found.effect.slug == "munk-moment"


@pytest.mark.parametrize(
    ("beside", "refuted"), [({"p": 1.0}, True), ({"p": 1e-6}, False), ({"p": 1.0, "evidence": -1.0}, False)]
)
def test_a_cause_that_improves_only_the_fitted_runs_is_refuted(beside: dict[str, float], refuted: bool) -> None:
    """A run with one size of command contains nothing about a dead zone, and predicts the others wrongly."""
    assert _refuted(SearchStep(BASE, (judged("input-delay", **beside),), None)) is refuted


# --- what is reported of the estimates -------------------------------------------------------


@pytest.mark.parametrize(("error", "result"), [(0.1, True), (1.0, True), (1.2, False), (40.0, False), (1e9, False)])
def test_no_inertia_is_reported_only_if_the_runs_would_have_shown_one(
    error: float, result: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By hand: 0.05 s may be 0.3 s, three samples, where its relative error is ln 6 / 1.645 = 1.09."""
    form = Form("plain", "yaw", ("yaw",), ("N_rdot", "N_r"), {}, {"N": (("N", 1.0),)}, coriolis=False)
    quick = SimpleNamespace(base=CoupledModel(form, {"N_rdot": -0.05, "N_r": -1.0}))
    summary = SimpleNamespace(data_summary=SimpleNamespace(interval=0.1))
    monkeypatch.setattr(report_builder, "_relative_error", lambda *_: error)
    found = SimpleNamespace(fitted=SimpleNamespace(model=quick), problem=summary, with_noise=None)
    assert [d.slug for d in report_builder._weightless(cast(SearchState, found))] == ["no-inertia"] * result


@pytest.mark.parametrize(
    ("dof", "memory", "result"),
    [("yaw", 0.05, False), ("yaw", 0.4, True), ("yaw", 2.0, False), ("heave", 0.4, False)],
)
def test_a_brief_correlation_time_is_reported_as_a_possible_time_constant(
    dof: str, memory: float, result: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    form = Form("plain", "yaw", ("yaw",), ("N_rdot", "N_r"), {}, {"N": (("N", 1.0),)}, coriolis=False)
    quick = SimpleNamespace(base=CoupledModel(form, {"N_rdot": -0.05, "N_r": -1.0}))
    weather = SimpleNamespace(dof=dof, fit=SimpleNamespace(noise=SimpleNamespace(memory=memory)))
    summary = SimpleNamespace(data_summary=SimpleNamespace(interval=0.1))
    monkeypatch.setattr(report_builder, "_relative_error", lambda *_: 0.1)
    found = SimpleNamespace(fitted=SimpleNamespace(model=quick), problem=summary, with_noise=weather)
    (doubt,) = report_builder._weightless(cast(SearchState, found))
    assert ("(or 0.4 s, the correlation time of the disturbance" in doubt.cause) is result


# --- shares ----------------------------------------------------------------------------------

CAUSES = [EffectInstance(slug, "N", {}) for slug in ("dead-zone", "backlash", "input-delay", "saturation")]


def shares_after(*models: tuple[Sequence[EffectInstance], float]) -> dict[str, float]:
    """Return slug -> share after *models*: their causes, and the fraction of the error that each leaves."""

    def unseen(left: float) -> HeldOut:
        return held(rest([math.sqrt(1.0 + 99.0 * left)] * 10))

    def fitted(causes: Sequence[EffectInstance]) -> Fitted:
        return cast(Fitted, SimpleNamespace(effects=tuple(causes), levels={"r": 1.0}))

    base, before = fitted(()), unseen(1.0)
    nothing = cast(Any, None)
    state = SearchState(nothing, nothing, base, base, nothing, before, before)
    for causes, left in models:
        state = state.with_model(fitted(causes), unseen(left))
    shares = state.shares(state.causes)
    assert set(shares) == {key_of(e) for e in state.causes}
    assert sum(shares.values()) == pytest.approx(1.0 - models[-1][1] if state.causes else 0.0)
    return {slug: share for (slug, _), share in shares.items()}


def test_a_cause_gets_also_the_share_of_the_one_it_replaces() -> None:
    zone, backlash, delay, _ = CAUSES
    shares = shares_after(([zone], 0.4), ([zone, backlash], 0.1), ([backlash, delay], 0.05))
    assert shares == pytest.approx({"backlash": 0.3, "input-delay": 0.65})


def test_the_share_of_a_removed_cause_goes_to_the_others() -> None:
    zone, backlash, delay, _ = CAUSES
    three = ([zone], 0.8), ([zone, backlash], 0.4), ([zone, backlash, delay], 0.1)
    assert shares_after(*three) == pytest.approx({"dead-zone": 0.2, "backlash": 0.4, "input-delay": 0.3})
    assert shares_after(*three, ([zone, backlash], 0.1)) == pytest.approx({"dead-zone": 0.3, "backlash": 0.6})
    assert shares_after(*three, ([], 1.0), ([delay], 0.5)) == pytest.approx({"input-delay": 0.5})


def test_of_causes_that_help_only_together_the_last_has_the_share() -> None:
    zone, backlash, _, _ = CAUSES
    assert shares_after(([zone, backlash], 0.1)) == pytest.approx({"dead-zone": 0.0, "backlash": 0.9})


def test_a_replacement_of_a_cause_that_helps_only_together_has_no_share_either() -> None:
    zone, backlash, delay, _ = CAUSES
    shares = shares_after(([zone, backlash], 0.1), ([delay, backlash], 0.05))
    assert shares == pytest.approx({"input-delay": 0.0, "backlash": 0.95})


@settings(max_examples=200, deadline=None)
@given(
    st.lists(
        st.tuples(st.lists(st.sampled_from(CAUSES), unique_by=key_of), st.floats(0.0, 1.0)), min_size=1, max_size=8
    )
)
def test_shares_add_up_to_what_all_causes_explain(models: list[tuple[list[EffectInstance], float]]) -> None:
    assert min(shares_after(*models).values(), default=0.0) >= 0.0
