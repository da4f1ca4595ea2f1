"""Causes with process noise modelled: reported if they hold on held-out runs; the missing force is reported."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray
from open_loop_runs import towed
from test_evidence import scored

from benchmarks.blind.case import draw_case
from benchmarks.blind.process_noise import CALM
from gcs_autotune.diagnose import diagnose, noise_scorer, process_noise, search_with_noise
from gcs_autotune.diagnose.heldout import HeldOut
from gcs_autotune.diagnose.heldout_score import densities_of, interval_of
from gcs_autotune.diagnose.missing_force import MissingForce, missing_of, words_of
from gcs_autotune.diagnose.noise_scorer import WithProcessNoise, may_be_weighed
from gcs_autotune.diagnose.process_noise import (
    NoiseSearch,
    form_alone,
    search_with_process_noise,
)
from gcs_autotune.diagnose.process_noise_starts import errs_after_commands
from gcs_autotune.diagnose.question import Question
from gcs_autotune.diagnose.report_builder import build_report
from gcs_autotune.diagnose.retries import _is_another_craft, search_in_pieces
from gcs_autotune.diagnose.score import CandidateScore, SearchStep, lack_by_parts
from gcs_autotune.diagnose.search_with_noise import _outdone, model_process_noise
from gcs_autotune.diagnose.state import SearchState, begin
from gcs_autotune.effects import EffectInstance
from gcs_autotune.identify.kalman import NoisyFit, NoisyProblem, ProcessNoise
from gcs_autotune.identify.problems import Fitted, Problem, data_summary_of, fit_base, plain_form
from gcs_autotune.identify.signals import prepare_as_recorded, prepare_form
from gcs_autotune.report.diagnosis.cause_wording import evidence_notes
from gcs_autotune.report.diagnosis.wording import verdict_of
from gcs_autotune.trial import Channel, Trial

Array = NDArray[np.float64]

SOME = ("quadratic-drag", "dead-zone", "input-bias", "asymmetric-thrust")


def drifting_runs(
    seed: int,
    *,
    square: float = 0.0,
    size: float = 0.15,
    memory: float = 2.0,
    count: int = 3,
    offsets: Sequence[tuple[float, float]] = (),
) -> list[Trial]:
    """Return relay runs of 60 s of a craft of inertia one, and a drifting force of correlation time *memory* [s].

    offsets : constant moment of each run, and the excess of its thrust as a fraction.
    """
    rng = np.random.default_rng(seed)
    found = []
    for k in range(count):
        fine, samples = 0.02, 3000
        t = fine * np.arange(samples)
        command = (0.5, 1.0, 1.5)[k % 3] * np.where(np.floor(t / (3.0 + k)) % 2 == 0, 1.0, -1.0)
        psi, r, push, keep = 0.0, 0.0, rng.normal(0.0, size), math.exp(-fine / memory)
        moment, thrust = offsets[k] if offsets else (0.0, 0.0)
        path = np.empty(samples)
        for i in range(samples):
            path[i] = psi
            psi += fine * r
            r += fine * ((1.0 + thrust) * command[i] + moment - 0.8 * r - square * abs(r) * r + push)
            push = keep * push + rng.normal(0.0, size * math.sqrt(1.0 - keep * keep))
        at, seen = t[::10], path[::10] + rng.normal(0.0, 1e-3, samples // 10)
        channels = {
            "psi": Channel("psi", "rad", at, seen),
            "N": Channel("N", "N m", at, command[::10]),
        }
        found.append(Trial(f"run{k}", channels))
    return found


def test_a_single_motion_uses_only_its_own_input() -> None:
    """A diagnosis of positions, driven by X and N, ended in a traceback when it searched for process noise in yaw."""
    run = drifting_runs(1, count=1)[0]
    psi, N = run["psi"], run["N"]
    along = {n: Channel(n, "m", psi.t, psi.values) for n in ("x", "y")}
    run = Trial("run", {"psi": psi, **along, "X": replace(N, name="X", unit="N"), "N": N})
    segments = prepare_form(run, plain_form([run]), None)
    alone = form_alone(plain_form([run]), "yaw")
    assert alone is not None and segments[0].input_names == ("X", "N")
    data = data_summary_of(alone, segments)
    assert data.inputs == {"N": "N m"}
    assert data.amplitude == {"N": pytest.approx(0.5)}


@pytest.mark.slow
def test_only_quadratic_drag_is_identified_with_process_noise_modelled() -> None:
    found = diagnose(drifting_runs(1, square=1.0), effects=SOME)
    assert [c.effect.slug for c in found.causes] == ["quadratic-drag"]
    assert found.verdict == "partly-explained"
    value = found.causes[0].parameters["coefficient"]
    assert abs(value.value - 1.0) < 3.5 * value.std
    assert found.gain is not None
    assert found.gain.metric.endswith("s ahead")
    assert found.gain.ratio < 1.0
    assert found.missing is not None
    assert 0.05 < found.missing.size < 0.3
    assert "process-noise" in {d.slug for d in found.doubts}
    assert found.causes[0].is_structural
    result = {n.label: n.text for n in evidence_notes(found, found.causes[0])}["Evidence"]
    assert result.startswith("Very strong: log-likelihood of the held-out data +")
    assert len(found.ranking[0].unseen) == 3


@pytest.mark.slow
def test_a_smoother_together_with_a_delay_is_not_mistaken_for_a_tether() -> None:
    """Judged at every sample its shape halved the damping, and a spring was reported with the delay."""
    case = draw_case("process-noise", 90, 0, "input-delay")
    form = plain_form(case.runs)
    problem, base = fit_base(form, prepare_as_recorded(case.runs, form)[0])
    found = search_with_process_noise(problem, base, ["input-delay", "tether-pull", "actuator-lag"], (), no_progress)
    assert found is not None
    assert [a.effect.slug for a in found.accepted] == ["input-delay"]
    _, true = case.truth["input-delay"]
    assert found.accepted[0].effect["delay"] == pytest.approx(true["delay"], rel=0.1)
    damping = case.craft.linear["yaw"] / case.craft.inertia["yaw"]
    assert -found.fit.theta[1] == pytest.approx(damping, rel=0.3)


@pytest.mark.slow
def test_process_noise_alone_is_reported_as_a_force_without_a_cause() -> None:
    found = diagnose(drifting_runs(2), effects=SOME)
    assert found.causes == ()
    assert found.verdict == "unexplained"
    assert found.missing is not None
    assert 0.05 < found.missing.size < 0.3
    assert any("acts in yaw and is not in the model" in line for line in found.left.findings)
    assert found.to_dict()["missing"]["curves"]


def test_a_missing_force_of_normalised_inputs_is_reported_in_full_output() -> None:
    missing = MissingForce("yaw", "1", 0.0445, 0.4, math.nan, {})
    nothing = cast(NoiseSearch, SimpleNamespace(accepted=(), steps=()))
    assert words_of(nothing, missing)[0].startswith("a drifting moment of 0.0445 of full output (standard deviation)")
    assert words_of(nothing, replace(missing, unit="N m"))[0].startswith(
        "a drifting moment of 0.0445 N m (standard deviation)"
    )


def test_a_coupling_of_two_motions_is_not_judged_by_one_motion_alone() -> None:
    coupling = EffectInstance("sway-yaw-coupling", "sway+yaw", dict.fromkeys(("Y_rdot", "N_vdot", "Y_r", "N_v"), 0.2))
    search = cast(NoiseSearch, SimpleNamespace(dof="yaw", accepted=()))
    assert _outdone(search, cast(SearchState, SimpleNamespace(causes=(coupling,))))


def as_from_a_log(runs: list[Trial]) -> tuple[Problem, Fitted]:
    form = plain_form(runs)
    return fit_base(form, prepare_as_recorded(runs, form, None)[0])


def no_progress(stage: str, done: int, total: int) -> None:
    """Ignore progress."""


@pytest.mark.slow
def test_the_search_with_process_noise_converges_from_a_wrong_fit_without_it() -> None:
    """On a lake that fit had an inertia a hundred times too small, and the one with process noise stayed there."""
    problem, base = as_from_a_log(drifting_runs(3))
    inertia = base.form.parameters.index("N_rdot")
    theta = base.theta.copy()
    theta[inertia] *= 0.01
    lost = problem.states(theta, (), base.initial)
    assert lost is not None
    found = search_with_process_noise(problem, lost, (), (), no_progress)
    assert found is not None
    assert found.plain.theta == pytest.approx([1.0, -0.8], abs=0.2)
    assert not found.momentary


@pytest.mark.slow
def test_a_quick_craft_is_identified_with_process_noise_although_the_fit_without_it_was_sluggish() -> None:
    """A craft of 0.1 s was fitted as one of 535 s, with eighteen times the gain. From there the filter diverged, no
    model was found with process noise, and a change of mass was reported wrongly.
    """
    case = draw_case("process-noise", 77, 8, CALM)
    problem, base = as_from_a_log(list(case.runs))
    assert base.form.parameters == ("N_rdot", "N_r")
    lost = problem.states(np.array([-793118.34, -1482.04]), (), base.initial)
    assert lost is not None
    found = search_with_process_noise(problem, lost, (), (), no_progress)
    assert found is not None
    inertia, linear = case.craft.inertia["yaw"], case.craft.linear["yaw"]
    assert found.plain.theta == pytest.approx([1.0 / inertia, -linear / inertia], rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [75, 84])
def test_a_long_delay_is_identified_although_the_plain_model_without_it_is_wrong(seed: int) -> None:
    """Without its delay of 7 s the gain had the wrong sign and the time constant was too short, and a lag was
    reported. Of the other's delay, 1.4 s with commands that change every second, half was found.
    """
    case = draw_case("process-noise", seed, 0, "input-delay")
    found = search_with_process_noise(*as_from_a_log(list(case.runs)), ("input-delay", "rate-limit"), (), no_progress)
    assert found is not None
    assert [a.effect.slug for a in found.accepted] == ["input-delay"]
    _, true = case.truth["input-delay"]
    assert found.accepted[0].effect["delay"] == pytest.approx(true["delay"], rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "late"), [(232, 0.2125), (440, 0.6881)])
def test_a_heading_two_time_constants_late_is_reported_as_either_kind_of_delay(seed: int, late: float) -> None:
    """The gain had the wrong sign, no delay so long was tried, and a dead zone of a clean craft was reported;
    of the other, 17 samples late, a rate limit and a tether.
    """
    case = draw_case("rough", seed, 2, CALM)
    assert "lag" in case.circumstances
    slugs = ("input-delay", "dead-zone", "quadratic-actuator")
    found = search_with_process_noise(*as_from_a_log(list(case.runs)), slugs, (), no_progress)
    assert found is not None
    assert [a.effect.slug for a in found.accepted] == ["input-delay"]
    assert found.accepted[0].effect["delay"] == pytest.approx(late, rel=0.05)
    assert found.alike() == (("input-delay", "measurement-delay"),)


def test_waves_that_turn_the_bow_do_not_hide_the_inertia() -> None:
    """At every sample they dominated the fit, with a time constant of 2 ms; a search of 88 s reported a rate limit."""
    case = draw_case("rough", 247, 0, CALM)
    assert case.circumstances == ("waves", "lag")
    found = search_with_process_noise(*as_from_a_log(list(case.runs)), (), (), no_progress)
    assert found is not None
    assert -1.0 / found.plain.theta[1] > 3.0 * case.craft.interval


def test_the_time_constant_is_kept_in_waves_far_above_the_sensor_noise() -> None:
    """Begun at a sensor's noise alone a craft of 18 s came out as one of 0.7, and a backlash was reported."""
    case = draw_case("rough", 275, 0, "quadratic-actuator")
    assert "waves" in case.circumstances and case.craft.pace > 15.0
    found = search_with_process_noise(*as_from_a_log(list(case.runs)), (), (), no_progress)
    assert found is not None
    assert -1.0 / found.plain.theta[1] == pytest.approx(case.craft.pace, rel=1.0)


def test_waves_are_modelled_and_reported_with_their_period() -> None:
    """Without them the fit had a time constant of 0.5 s and a heading smoothed by 2 s."""
    case = draw_case("rough", 292, 0, "quadratic-actuator")
    assert case.circumstances == ("waves",) and case.flown is not None
    waves = next(h.values for h in case.flown.hidden if h.slug == "waves")
    found = search_with_process_noise(*as_from_a_log(list(case.runs)), (), (), no_progress)
    assert found is not None
    assert -1.0 / found.plain.theta[1] == pytest.approx(case.craft.pace, rel=0.1)
    missing = missing_of(found)
    assert missing is not None and missing.waves is not None
    assert missing.waves.period == pytest.approx(2.0 * math.pi / waves["frequency"], rel=0.05)
    assert missing.waves.swing == pytest.approx(waves["heading"], rel=0.3)
    assert missing.to_dict()["waves"]["period"] == missing.waves.period
    result = next(w for w in words_of(found, missing) if "waves" in w)
    assert result.startswith("the heading also oscillates by ")
    assert " with a period of 4.2 s, as from waves or a loose sensor mount. The moment behind it is " in result
    assert "N m. Both sizes are standard deviations." in result


def test_a_rougher_held_out_run_is_judged_by_its_own_process_noise() -> None:
    """In a lake boat's surge one gust of a held-out run counted 5,500 against the true drag, or 3,100 for it."""
    own = np.array([0.1, -0.2, 0.05])
    calm, rough = (
        NoisyFit(cast(Any, None), own, (), (), (), ProcessNoise(1.0, 1.0, 1.0), own, np.eye(5), ((own, k * own, S),))
        for k, S in ((1.0, np.full(3, 0.02)), (100.0, np.full(3, 0.02)))
    )
    assert rough.roughness == pytest.approx(1e4 * calm.roughness)
    same, other = densities_of([calm, rough], [calm, rough])
    assert same == pytest.approx(calm.densities())
    assert other == pytest.approx(rough.densities(rough.roughness))
    better = replace(rough, innovations=((own, 90.0 * own, np.full(3, 0.02)),))
    gain = densities_of([better], [rough])[0].sum() - other.sum()
    assert 0.0 < gain < 1.0 < better.densities().sum() - rough.densities().sum()
    assert densities_of([None], [None])[0].sum() < -1e5


@pytest.mark.slow
def test_a_cause_that_explains_nothing_after_a_later_one_is_dropped() -> None:
    """A stock sub's thrust seemed to fall with speed until its quadratic drag was found, and stayed at 0.1 +- 0.2."""
    problem, base = as_from_a_log(drifting_runs(5, square=0.3, size=0.05))
    found = search_with_process_noise(problem, base, ("quadratic-drag",), (), no_progress)
    assert found is not None and [a.effect.slug for a in found.accepted] == ["quadratic-drag"]
    bias = EffectInstance("input-bias", "yaw", {"bias": 0.01})
    both = found.problem.fit(found.fit.theta, (bias, *found.fit.effects), found.fit.noise)
    assert both is not None
    idle = replace(found.accepted[0], effect=bias)
    step = SearchStep(found.plain, (idle,), idle, ("input-bias", "wind-moment"))
    left = process_noise._without_idle(replace(found, steps=(step, *found.steps), fit=both))
    assert [a.effect.slug for a in left.accepted] == ["quadratic-drag"]
    assert [e.slug for e in left.fit.effects] == ["quadratic-drag"]
    assert left.alike() == found.alike()
    # One that still explains stays, whatever came after it.
    kept = process_noise._without_idle(replace(found, steps=(*found.steps, step), fit=both))
    assert [a.effect.slug for a in kept.accepted] == ["quadratic-drag", "input-bias"]


@pytest.mark.slow
def test_an_effect_is_identified_in_waves() -> None:
    case = draw_case("rough", 292, 0, "input-bias")
    assert "waves" in case.circumstances
    found = search_with_process_noise(*as_from_a_log(list(case.runs)), ("input-bias", "tether-pull"), (), no_progress)
    assert found is not None
    assert [a.effect.slug for a in found.accepted] == ["input-bias"]


def test_runs_without_waves_have_no_waves_in_the_model() -> None:
    found = search_with_process_noise(*as_from_a_log(drifting_runs(3)), (), (), no_progress)
    assert found is not None
    assert not found.plain.noise.wavy


@pytest.mark.slow
def test_a_helm_that_keeps_the_course_yields_no_delay() -> None:
    """Commands that answered pushes within two seconds looked 1 s late where a sample was judged every 2 s."""
    case = draw_case("rough", 284, 2, CALM)
    assert case.circumstances == ("driving",)
    found = search_with_process_noise(*as_from_a_log(list(case.runs)), ("input-delay", "actuator-lag"), (), no_progress)
    assert found is not None
    assert found.accepted == ()
    assert noise_scorer.answers_heading(found.problem, found.plain)
    open_loop = draw_case("rough", 284, 0, "input-delay")
    other = search_with_process_noise(*as_from_a_log(list(open_loop.runs)), ("input-delay",), (), no_progress)
    assert other is not None
    assert [a.effect.slug for a in other.accepted] == ["input-delay"]
    assert not noise_scorer.answers_heading(other.problem, other.fit)


def test_evenly_spaced_times_are_tried_for_effects_without_bounds(monkeypatch: pytest.MonkeyPatch) -> None:
    """An added effect needs no bounds."""
    problem, _ = as_from_a_log(drifting_runs(3))
    monkeypatch.setattr(type(noise_scorer.EFFECTS["input-delay"]), "bounds", lambda *_: {})
    (choices,) = noise_scorer.choices_of(problem.data_summary, ("input-delay",), ())
    assert len(choices) > noise_scorer.EVEN


def on_unseen(density: float) -> SimpleNamespace:
    """Return a fit of one sample of that log density."""
    return SimpleNamespace(roughness=1.0, densities=lambda _: np.array([density]))


@pytest.mark.parametrize(
    ("damping", "slug", "brief"),
    [(540.0, "actuator-lag", True), (540.0, "dead-zone", False), (0.5, "actuator-lag", False)],
)
def test_a_lag_is_too_brief_to_report_if_the_craft_shows_no_inertia(
    monkeypatch: pytest.MonkeyPatch, damping: float, slug: str, brief: bool
) -> None:
    """In waves that turned the bow no inertia was found (540 1/s), and a rate limit was reported instead."""
    number = {"actuator-lag": {"time_constant": 1.5}, "dead-zone": {"width": 0.1}}[slug]
    effect = EffectInstance(slug, "N", number)
    monkeypatch.setattr(WithProcessNoise, "unseen", lambda *_: [on_unseen(9.0), on_unseen(9.0)])
    data = SimpleNamespace(interval=0.1, amplitude={"N": 1.0})
    problem = SimpleNamespace(data_summary=data, interval=0.1)
    result = {"gain": 1.0, "damping": -damping, "effects": (effect,), "errors_of": lambda _: {}}
    fits = [SimpleNamespace(unknowns=n, total=t, samples=0, free_effects=(), **result) for n, t in ((5, 0), (6, 20))]
    before = [on_unseen(0.0), on_unseen(0.0)]
    scorer = WithProcessNoise(*cast(Any, (problem, (), fits[0], fits[0], 15, no_progress)), left_out=cast(Any, before))
    score = scorer.score(effect, cast(Any, fits[1]))
    assert (score.lacks == "brief") is brief


@pytest.mark.parametrize(("gain", "unseen", "named"), [(5.6, 18.0, True), (5.6, 6.3, False), (9.0, 2.5, True)])
def test_a_cause_is_accepted_by_a_large_gain_on_the_held_out_runs(gain: float, unseen: float, named: bool) -> None:
    """A dead zone gained 5.6 nats on two runs, and 36 where each was predicted from the other: it was not accepted."""
    effect = EffectInstance("dead-zone", "N", {"width": 0.1})
    lacks = lack_by_parts(scored(effect, gain, (unseen, unseen), 6.4, (1.0, 60.0)))
    assert (lacks is None) is named


def test_an_equally_likely_cause_is_reported_with_the_winner_although_its_held_out_gain_is_uncertain() -> None:
    """A trim and thrust that is weaker to one side: within two nats, and which predicts better depends on the runs."""

    def of(slug: str, gain: float, unseen: tuple[float, ...], low: float) -> CandidateScore[NoisyFit]:
        return scored(EffectInstance(slug, "N", {}), gain, unseen, 6.4, (low, 40.0))

    winner = of("asymmetric-thrust", 22.8, (14.6, 9.8), 14.2)
    trim = of("input-bias", 24.4, (3.7, 7.9), -3.0)
    less = of("tether-pull", 17.0, (5.0, 5.0), 1.0)
    assert lack_by_parts(winner) is None and lack_by_parts(trim) == "not-sure"
    assert noise_scorer._as_likely([trim, winner, less], winner) == [trim, winner]
    # Never accepted, but reported: a rate limit was accepted instead of a lag of less than a sample.
    short = replace(trim, lacks="brief")
    assert noise_scorer._as_likely([short, winner], winner) == [short, winner]


def search_with_drag(monkeypatch: pytest.MonkeyPatch) -> SearchState:
    """Return a search that found quadratic drag, and then no model with process noise."""
    monkeypatch.setattr(search_with_noise, "search_with_process_noise", lambda *_, **__: None)
    runs = drifting_runs(1, square=1.0, count=1)
    form = plain_form(runs)
    segments = prepare_as_recorded(runs, form, None)[0]
    state = begin(Question(form, segments, SOME, whole=segments))
    drag = EffectInstance("quadratic-drag", "yaw", {"coefficient": 0.5})
    fitted = state.problem.states(state.base.theta, (drag,), state.base.initial)
    assert fitted is not None
    return replace(state, fitted=fitted, present_unseen=HeldOut((), False))


def test_no_cause_is_reported_if_no_model_fits_with_process_noise(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A change of mass was reported with a fit of 500 s, for a craft of 0.1 s."""
    state = search_with_drag(monkeypatch)
    assert [e.slug for e in state.causes] == ["quadratic-drag"]
    after = model_process_noise(state)
    assert after is not None and after.causes == ()
    result = next(d for d in after.doubts if d.slug == "no-model")
    assert "quadratic drag (yaw) is therefore not identified" in result.cause
    assert search_in_pieces(after) is None
    found = build_report(after, (), [], [])
    assert (found.verdict, found.causes) == ("unexplained", ())
    assert verdict_of(found).text.startswith("An effect is missing, but no cause is reported: no model")


@pytest.mark.parametrize(("factor", "another"), [(1.0, False), (20.0, False), (1000.0, True), (0.001, True)])
def test_a_base_that_became_a_different_craft_during_the_search_is_recognised(
    monkeypatch: pytest.MonkeyPatch, factor: float, another: bool
) -> None:
    state = search_with_drag(monkeypatch)
    summary = state.problem.data_summary
    first = replace(summary, time_constant=factor * summary.time_constant)
    now = SimpleNamespace(base=state.base, problem=SimpleNamespace(data_summary=first))
    assert _is_another_craft(cast(SearchState, now)) is another


@pytest.mark.slow
def test_a_disturbance_shorter_than_two_samples_is_not_process_noise() -> None:
    """For ArduPilot's own boat in a calm harbour a moment was reported that changes within 0.04 s."""
    runs = drifting_runs(4, size=1.5, memory=0.02)
    problem, base = as_from_a_log(runs)
    found = search_with_process_noise(problem, base, (), (), no_progress)
    assert found is not None and found.momentary
    result = diagnose(runs, effects=("input-bias",))
    assert result.missing is None
    assert "no-weather" in {d.slug for d in result.doubts}


@pytest.mark.parametrize(("late", "own"), [(0.0, True), (5.0, False)])
def test_bursts_after_commands_are_errors_of_the_model(late: float, own: bool) -> None:
    """Taken for gusts, they made the damping of a lake boat four times too large, and no cause was found."""
    t = np.arange(0.0, 200.0, 0.2)
    e = np.where((t - late) % 10.0 < 1.0, 3.0, 0.3) * np.where(np.arange(len(t)) % 2 == 0, 1.0, -1.0)
    commands = np.where(np.arange(0.0, 200.0, 10.0) // 10.0 % 2 == 0, 1.0, -1.0)[:, None]
    segment = SimpleNamespace(input_names=("N",), inputs=commands, t_in=np.arange(0.0, 200.0, 10.0))
    problem = SimpleNamespace(segments=(segment,), form=SimpleNamespace(inputs={"N": ()}), interval=0.2)
    fit = SimpleNamespace(theta=np.array([1.0, -2.0]), gain=1.0, damping=-2.0, innovations=((t, e, np.ones(len(t))),))
    assert errs_after_commands(cast(NoisyProblem, problem), cast(NoisyFit, fit)) is own


def test_an_equal_gain_in_every_run_is_certain_although_blocks_vary() -> None:
    """A sway moment gained on each of six runs of a lake, and quiet blocks cancelled the gain of lively ones."""
    before = [np.zeros(200) for _ in range(6)]
    oscillation = np.repeat([3.0, -2.8], 100) * 0.1
    after = [oscillation + 0.002 * k for k in range(6)]
    low, high = interval_of(before, after)
    assert 0.0 < low < high
    low, _ = interval_of(before[:2], after[:2])
    assert low < 0.0


def test_a_gain_from_a_single_gust_is_not_certain() -> None:
    before = [np.zeros(200), np.zeros(200)]
    steady = [np.full(200, 0.05), np.full(200, 0.05)]
    one = [np.zeros(200), np.zeros(200)]
    one[0][100] = 20.0
    low, high = interval_of(before, steady)
    assert low == pytest.approx(20.0, rel=0.02) and high == pytest.approx(20.0, rel=0.02)
    low, high = interval_of(before, one)
    assert low < 0.0 < 20.0 < high


def followed(settles: float) -> Trial:
    """Return steps of a craft whose turn rate follows within *settles* [s], recorded every 0.1 s."""
    rng = np.random.default_rng(5)
    fine, samples = 0.01, 3000
    t = fine * np.arange(samples)
    command = np.repeat(rng.uniform(-1.0, 1.0, samples // 150), 150)
    r, psi = np.zeros(samples), np.zeros(samples)
    keep = math.exp(-fine / settles)
    for i in range(1, samples):
        r[i] = keep * r[i - 1] + (1.0 - keep) * command[i - 1]
        psi[i] = psi[i - 1] + 0.5 * fine * (r[i] + r[i - 1])
    noise = rng.normal(0.0, 0.005, (2, samples // 10))
    columns = {"psi": ("rad", psi[::10] + noise[0]), "r": ("rad/s", r[::10] + noise[1]), "N": ("N m", command[::10])}
    return Trial("run", {n: Channel(n, unit, t[::10], values) for n, (unit, values) in columns.items()})


@pytest.mark.parametrize(("settles", "result"), [(0.03, True), (1.0, False)])
def test_a_rate_that_follows_within_three_samples_is_reported_to_show_no_inertia(settles: float, result: bool) -> None:
    doubts = {d.slug: d.cause for d in diagnose(followed(settles), effects=[]).doubts}
    assert ("no-inertia" in doubts) == result
    if result:
        below = float(doubts["no-inertia"].split("below ")[1].split(" s ")[0])
        assert settles < below < 2.0 * settles


@pytest.mark.slow
@pytest.mark.parametrize(
    ("slug", "place", "may"),
    [
        ("sign-error", "N@run1", True),
        ("sign-error", "psi", False),
        ("mass-change", "yaw", True),
        ("quadratic-drag", "yaw", True),
        ("compass-deviation", "psi", False),
        ("wave-disturbance", "yaw", False),
    ],
)
def test_the_filter_judges_effects_on_commands_and_motion_and_command_errors(slug: str, place: str, may: bool) -> None:
    assert may_be_weighed(EffectInstance(slug, place, {}), {"N"}) is may


def test_runs_without_disturbance_give_the_result_without_process_noise() -> None:
    found = diagnose(towed(("dead-zone", "N", {"width": 0.2})), effects=["quadratic-drag", "dead-zone"])
    assert found.verdict == "effect-found"
    assert found.missing is None
