"""Correct wording: noise, unexplained remainder, damping, one verdict, margins."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import diagnosis_stories as diagnosed
import numpy as np
import pytest
import report_stories as stories
from matplotlib.figure import Figure

from gcs_autotune.design import Margins, StepMetrics, TrackMetrics
from gcs_autotune.diagnose import Signature
from gcs_autotune.effects import EffectInstance
from gcs_autotune.identify import AxisFit, Parameter, Trace, fit, is_of_one_axis, validate
from gcs_autotune.identify.doubts import FittedDelay, doubts_about
from gcs_autotune.identify.signals.whiteness import remainder_of
from gcs_autotune.report import Document, MethodOutcome, RunRow, Study, format_factor, study_document, to_html
from gcs_autotune.report.diagnosis.wording import left_sentence
from gcs_autotune.report.diagnosis.wording import verdict_of as diagnosis_verdict_of
from gcs_autotune.report.plots import draw_trace
from gcs_autotune.report.study.study import verdict_of
from gcs_autotune.report.toolkit.axis_fit import (
    candidate_table,
    cycle_table,
    estimate_table,
    model_sentences,
    model_table,
    model_words,
    remainder_sentence,
)
from gcs_autotune.report.toolkit.document import Remark
from gcs_autotune.report.toolkit.terminal import render_text
from gcs_autotune.report.toolkit.wording import UNKNOWN, format_error, sentence
from gcs_autotune.report.tune.tables import margins_table, metrics_table
from gcs_autotune.report.tune.wording import follows, improvement, safety
from gcs_autotune.report.tune.wording import verdict_of as tune_verdict_of
from gcs_autotune.trial import Channel, Trial


def noise(std: float, n: int = 2000, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).normal(0.0, std, n)


def test_a_white_remainder_is_noise() -> None:
    left = remainder_of([noise(0.01), noise(0.01, seed=2)])
    assert left.rms == pytest.approx(0.01, rel=0.05)
    assert left.unexplained == 0.0
    assert "is mostly white, like measurement noise" in remainder_sentence(left, "rad")


def test_a_slightly_correlated_remainder_is_not_only_noise() -> None:
    """`diagnose` tests it for whiteness too, so both must say the same."""
    white = noise(0.01, 8000)
    left = remainder_of([white[1:] + 0.1 * white[:-1]])
    assert left.unexplained == 0.0
    assert "mostly white, but not only noise" in remainder_sentence(left, "rad")
    assert "below the limit of 0.01: not only noise" in left_sentence(Signature((), left.p))


def test_a_correlated_remainder_is_unexplained_beyond_the_sensor_noise() -> None:
    slow = 0.05 * np.sin(np.arange(2000) * 0.02)
    left = remainder_of([slow + noise(0.004)])
    assert left.noise == pytest.approx(0.004, rel=0.05)
    assert left.unexplained == pytest.approx(0.05 / np.sqrt(2.0), rel=0.05)
    reported = remainder_sentence(left, "rad")
    assert reported == "The residual is 2° rms: 0.23° white (noise), 2° correlated and unexplained."
    assert "measurement noise" not in reported


def test_rounding_by_a_coarse_sensor_counts_as_noise() -> None:
    motion = np.sin(np.arange(2000) * 0.01)
    step = 0.1
    left = remainder_of([np.round(motion / step) * step - motion], step / np.sqrt(12.0))
    assert left.unexplained == 0.0


def wave() -> Trial:
    """A yaw run under a slow wave that its input knows nothing of; its sensor's noise is 0.01 rad/s."""
    rng = np.random.default_rng(4)
    t = np.arange(0.0, 40.0, 0.1)
    tau = np.repeat(rng.uniform(-1.0, 1.0, 20), 20)
    r = np.zeros(len(t))
    for k in range(len(t) - 1):
        r[k + 1] = tau[k] + (r[k] - tau[k]) * np.exp(-0.05)
    seen = r + 0.15 * np.sin(1.3 * t) + rng.normal(0.0, 0.01, len(t))
    return Trial("wavy", {"r": Channel("r", "rad/s", t, seen), "N": Channel("N", "N m", t, tau)})


@pytest.fixture(scope="module")
def found() -> AxisFit:
    answer = fit(wave(), "linear")
    assert is_of_one_axis(answer)
    return answer


def test_a_fit_reports_noise_and_unexplained_remainder(found: AxisFit) -> None:
    left = found.remainder["r"]
    assert left.noise == pytest.approx(0.01, rel=0.5)
    assert left.unexplained > 0.05
    assert "unexplained" in model_sentences(found)[-1]
    assert found.to_dict()["remainder"]["r"]["unexplained"] == pytest.approx(left.unexplained)


def study(found: AxisFit, unseen: float) -> Study:
    checked = validate(found.model, wave())
    checked = replace(checked, statistics=tuple(replace(s, fit_percent=unseen) for s in checked.statistics))
    row = RunRow("wavy", "wavy.csv", 40.0, 400, ("r", "N"), "identification")
    outcome = MethodOutcome("output-error", found, 0.2, checked)
    return Study("Identification of yaw", "2026-11-21T10:00:00", (row,), (outcome,), how_unseen="Predicted.")


@pytest.mark.parametrize("unseen", [81.0, -15.0])
@pytest.mark.usefixtures("words_only")
def test_terminal_and_page_show_one_verdict_and_the_terminal_shows_it_last(found: AxisFit, unseen: float) -> None:
    judged = study(found, unseen)
    verdict = verdict_of(judged.fit, judged.answer.unseen)
    _, _, boxed = render_text(study_document(judged)).partition("╭")
    assert " ".join(boxed.strip("╭╮╰╯─\n").replace("│", " ").split()) == " ".join([verdict.text, *verdict.sentences])
    assert verdict.text in to_html(study_document(judged)).replace("\u00a0", " ")


def test_a_prediction_worse_than_none_explains_nothing(found: AxisFit) -> None:
    judged = study(found, -15.0)
    verdict = verdict_of(judged.fit, judged.answer.unseen)
    assert verdict.text.startswith("Simulated from the inputs alone, the model explains nothing of held-out motion")
    assert "-15" not in verdict.text
    assert verdict.tone == "bad"


def test_damping_structures_have_standard_names_explained_at_first_use(found: AxisFit) -> None:
    assert model_words(found) == "linear damping"
    assert model_sentences(found)[0] == "Linear damping: drag is proportional to speed."
    assert "linear damping" in {row[3] for row in model_table(found).rows}


def test_a_model_with_a_thrust_curve_is_named_so_and_its_numbers_are_in_the_table() -> None:
    curve = EffectInstance("quadratic-actuator", "N", {"share": 0.824}, {"u_ref": 1.0})
    plain = stories.fit()
    share = Parameter("quadratic-actuator@N.share", 0.824, "1", 0.031)
    bent = replace(
        plain,
        effects=(curve,),
        parameters={**plain.parameters, share.name: share},
        covariance=np.diag([*np.diag(plain.covariance), share.std**2]),
    )
    assert model_words(bent) == "quadratic damping, with quadratic thrust curve"
    assert any("q = 0.82 ± 0.03" in reported for reported in model_sentences(bent))
    assert ("share", "0.82 ± 0.03", "1", "quadratic fraction of the thrust at full output", "") in model_table(
        bent
    ).rows
    flown = replace(bent, effects=(replace(curve, constants={"u_ref": 0.965}),))
    assert "quadratic fraction of the thrust at the largest command" in {row[3] for row in model_table(flown).rows}
    slight = replace(share, value=-0.01)
    straight = replace(
        bent, effects=(curve.with_values({"share": -0.01}),), parameters={**bent.parameters, share.name: slight}
    )
    assert model_words(straight) == "quadratic damping"


def test_the_steady_speed_at_full_output_includes_the_actuator_effects() -> None:
    fitted = stories.fit("linear")
    plain = replace(
        fitted, model=replace(fitted.model, beta_quadratic=0.0), covariance=np.zeros_like(fitted.covariance), extra={}
    )
    dead = EffectInstance("dead-zone", "N", {"width": 0.144})
    bent = EffectInstance("quadratic-actuator", "N", {"share": 0.8}, {"u_ref": 0.5})

    def top(*effects: EffectInstance) -> float:
        output = " ".join(model_sentences(replace(plain, effects=effects)))
        return float(output.partition("Full output sustains ")[2].partition("°/s")[0])

    assert top(dead) == pytest.approx((1.0 - 0.144) * top(), rel=0.01)
    assert top(bent) == pytest.approx((0.2 + 0.8 / 0.5) * top(), rel=0.01)
    assert "dead zone: no force below 0.144" in " ".join(model_sentences(replace(plain, effects=(dead,))))


def test_a_thrust_curve_is_not_extrapolated_beyond_the_largest_output_flown() -> None:
    """By hand: a square law under quadratic damping makes the speed proportional to the output, and so its error."""
    fitted = stories.fit()
    model = replace(fitted.model, beta=0.0, delta=0.0)
    square = EffectInstance("quadratic-actuator", "N", {"share": 1.0}, {"u_ref": 1.0})
    flown = replace(fitted, model=model, effects=(square,), extra={**fitted.extra, "largest": {"N": 0.6}})
    output = " ".join(model_sentences(flown)).partition("An output of 60 %, the largest of the fitted runs, sustains ")[
        2
    ]
    drag = fitted.parameters["beta_rr"]
    speed = math.degrees(0.6 / math.sqrt(model.beta_quadratic))
    assert float(output.split()[0]) == pytest.approx(speed, rel=0.01)
    assert float(output.split()[2].partition("°")[0]) == pytest.approx(speed * 0.5 * drag.std / drag.value, rel=0.1)
    assert "Full output sustains" not in " ".join(model_sentences(flown))


def test_without_a_curve_the_steady_speed_also_refers_to_the_largest_output_flown() -> None:
    fitted = stories.fit("linear")
    model = replace(fitted.model, beta_quadratic=0.0)
    flown = replace(fitted, model=model, extra={"largest": {"N": 0.63}})
    output = " ".join(model_sentences(flown)).partition("An output of 63 %, the largest of the fitted runs, sustains ")[
        2
    ]
    assert float(output.split()[0]) == pytest.approx(math.degrees(0.63 / model.beta), rel=0.01)
    by_rudder = replace(flown, extra={"largest": {"delta": 0.63}})
    assert "An output of 63 %, the largest of the fitted runs, sustains" in " ".join(model_sentences(by_rudder))


def test_no_steady_speed_is_reported_for_inputs_that_are_not_normalised() -> None:
    fitted = stories.fit("linear")
    pulses = replace(fitted, extra={"largest": {"N": 500.0}})
    assert "sustains" in " ".join(model_sentences(fitted))
    assert "sustains" not in " ".join(model_sentences(pulses))


def test_the_inertia_at_full_output_includes_the_error_of_the_dead_zone() -> None:
    """By hand: a / (1 - w), whose variance is that of a, of w, and what both have in common."""
    plain, width, own, common = stories.fit("linear"), 0.3, 0.02, 0.5
    at, inertia = list(plain.parameters).index("alpha_r"), plain.model.alpha
    covariance = np.zeros((len(plain.parameters) + 1,) * 2)
    covariance[at, at], covariance[-1, -1] = (0.01 * inertia) ** 2, own**2
    covariance[at, -1] = covariance[-1, at] = common * 0.01 * inertia * own
    name = "dead-zone@N.width"
    fitted = replace(
        plain,
        effects=(EffectInstance("dead-zone", "N", {"width": width}),),
        parameters={**plain.parameters, name: Parameter(name, width, "1", own)},
        covariance=covariance,
    )
    output = " ".join(model_sentences(fitted))
    words = output.partition("Relative to this force the inertia is ")[2].split()
    relative = np.array([0.01, own / (1.0 - width)])
    error = inertia / (1.0 - width) * np.sqrt(np.sum(relative**2) + 2.0 * common * np.prod(relative))
    assert "Full output gives 0.7 in the table's unit of force" in output
    assert float(words[0]) == pytest.approx(inertia / (1.0 - width), rel=0.02)
    assert float(words[2]) == pytest.approx(error, rel=0.1)


def test_negative_damping_is_reported_as_the_reason_for_another_choice() -> None:
    fitted = stories.fit("linear")
    pushing = [
        replace(c, model=replace(c.model, beta_quadratic=-2.2), bic=-9000.0) if c.structure == "affine" else c
        for c in fitted.candidates
    ]
    remarks = {row[0]: row[-1] for row in candidate_table(replace(fitted, candidates=tuple(pushing))).rows}
    assert remarks == {"linear": "chosen", "nonlinear": "", "affine": "negative damping"}


def test_a_delay_is_rounded_to_its_error_and_its_criterion_is_named() -> None:
    solution: Any = SimpleNamespace(free=("delay",), value=lambda name: 0.16108)
    (doubt,) = doubts_about(FittedDelay(solution, 7.6))
    assert "a delay of 0.16 s" in doubt.cause
    assert "BIC" in doubt.cause and "lowers BIC" in doubt.cause and "evidence" not in doubt.cause


@pytest.mark.parametrize("gain", [140.0, float("inf")])
def test_a_gain_margin_above_100_is_worded_the_same_everywhere(gain: float) -> None:
    assert format_factor(gain) == "more than 100"
    wide = Margins(gain=gain, phase=1.0, delay=0.5, stable=True)
    proposal = replace(stories.proposal(), margins=wide, worst_margins=wide)
    assert "a factor of more than 100 in gain" in safety(proposal)
    assert ("gain margin", "more than 100", "more than 100") in margins_table(proposal).rows


def test_no_new_gains_are_called_stable_if_none_were_proposed() -> None:
    proposal = stories.proposal()
    assert proposal.changes and safety(proposal).startswith("With the new gains")
    assert safety(replace(proposal, changes=())).startswith("With the present gains")


def test_a_heading_axis_begins_within_a_turn_and_rises_from_label_to_label() -> None:
    t = np.linspace(0.0, 60.0, 400)
    psi = np.radians(660.0 + 6.0 * t)
    trace = Trace("turns", t, psi, psi + 0.01, np.full(len(t), 0.1), "psi", "rad")
    figure = Figure()
    top, bottom = figure.subplots(2, 1)
    draw_trace(top, bottom, trace)
    figure.canvas.draw()
    shown = [float(label.get_text()) for label in top.get_yticklabels()]
    assert len(shown) >= 3
    assert shown == sorted(shown)
    assert 180.0 <= shown[0] <= 360.0
    assert all(degrees % 45.0 == 0.0 or degrees % 30.0 == 0.0 for degrees in shown)


def test_depth_is_plotted_downwards() -> None:
    t = np.linspace(0.0, 60.0, 400)
    trace = Trace("dive", t, 0.1 * t, 0.1 * t, np.full(len(t), 0.1), "z", "m")
    top, bottom = Figure().subplots(2, 1)
    draw_trace(top, bottom, trace)
    low, high = top.get_ylim()
    assert low > high


@pytest.mark.parametrize(("p", "word"), [(0.4, "within measurement noise"), (1e-6, "unexplained")])
def test_a_diagnosis_calls_a_correlated_remainder_unexplained(p: float, word: str) -> None:
    judged = replace(diagnosed.dead_zone(), left=Signature((), p))
    output = " ".join((diagnosis_verdict_of(judged).text, *diagnosis_verdict_of(judged).sentences))
    assert word in output
    assert ("measurement noise" in output) == (p > 0.01)


def test_a_heading_error_beyond_half_a_turn_is_shown_as_over_180() -> None:
    assert format_error(np.radians(539.5), "rad") == "over 180°"
    assert format_error(np.radians(92.7), "rad") == "92.7°"
    assert format_error(539.5, "m") == "540 m"


def test_estimates_of_the_refined_fit_are_rounded_to_their_errors() -> None:
    assert estimate_table(stories.fit()).rows[-1] == (
        "refined", "0.1795 ± 0.0011", "0", "0.408 ± 0.006", "0.0100 ± 0.0009"
    )  # fmt: skip


def test_a_single_period_has_no_scatter() -> None:
    fitted = stories.fit()
    first, *others = fitted.iso
    once = replace(first, cycle=replace(first.cycle, periods=1, scatter=np.inf))
    row = cycle_table(replace(fitted, iso=(once, *others))).rows[0]
    assert row[6:8] == ("1", UNKNOWN)


@pytest.mark.parametrize(("scatter", "validity"), [(0.05, "yes"), (1.26, "uneven")])
def test_a_limit_cycle_whose_extremes_scatter_is_not_called_valid(scatter: float, validity: str) -> None:
    fitted = stories.fit()
    first, *others = fitted.iso
    cycle = replace(first, cycle=replace(first.cycle, scatter=scatter, valid=True))
    assert cycle_table(replace(fitted, iso=(cycle, *others))).rows[0][-1] == validity


def test_doubts_about_figures_do_not_contradict_a_fit_without_doubts() -> None:
    reported = render_text(Document("", (), doubts=(Remark("The approach was not steady."),), doubted="figures"))
    assert reported.strip().splitlines()[0] == "Doubts about the figures"


def test_a_signal_name_at_the_start_of_a_sentence_is_unchanged() -> None:
    assert sentence("p of run 'a' never changes") == "p of run 'a' never changes."
    assert sentence("psi and r disagree") == "psi and r disagree."
    assert sentence("a pause") == "A pause."
    assert sentence("the boat drifts") == "The boat drifts."


def test_an_unsettled_step_reports_its_duration() -> None:
    before = StepMetrics(3.5, 0.29, 1.8, math.nan, 0.26, 0.2, span=5.0)
    after = StepMetrics(0.7, 0.02, 1.2, 1.9, 0.01, 0.6, span=5.1)
    assert "settled after 1.9 s (before: not in 5.0 s)" in improvement(before, after, "measured")
    assert "not settled in 5.0 s (before: 1.9 s)" in improvement(after, before, "measured")
    table = metrics_table(before, after)
    assert ("settling time (to within 5 %)", "not in 5.0 s", "1.9 s", "") in table.rows
    assert table.note.startswith("Over at least 5.0 s after each step")


def test_the_verdict_of_a_line_states_that_a_mission_was_measured() -> None:
    track = TrackMetrics(2.0, 1.0, 0.5, (3.0,), 60.0, 20.0)
    story = replace(stories.kept(), axis="line", track_before=track, track_after=track)
    assert tune_verdict_of(story).text == "The new line parameters are better in a measured mission and are kept."


def test_only_matched_gains_are_reported_to_follow_a_reference_model() -> None:
    proposal = stories.proposal()
    assert "reference model" in follows(replace(proposal, is_matched=True))
    assert "reference model" not in follows(replace(proposal, is_matched=False))
    assert "The design found no better gains" in follows(replace(proposal, changes=()))


def test_a_thrust_curve_is_stated_for_the_largest_output_and_beyond_the_dead_zone() -> None:
    effects = (
        EffectInstance("dead-zone", "N", {"width": 0.06}),
        EffectInstance("quadratic-actuator", "N", {"share": 0.3}, {"u_ref": 0.3}),
    )
    output = " ".join(model_sentences(replace(stories.fit(), effects=effects)))
    assert "The force at output x beyond the dead zone is (1 - q) x + q x²/0.3 with q = 0.3" in output


def test_an_actuator_of_a_model_that_lacks_a_term_has_no_standard_error() -> None:
    zone = Parameter("dead-zone@N.width", 0.0558, "1", 0.0005)
    plain = stories.fit()
    bent = replace(
        plain,
        effects=(EffectInstance("dead-zone", "N", {"width": 0.0558}),),
        parameters={**plain.parameters, zone.name: zone},
        covariance=np.diag([*np.diag(plain.covariance), zone.std**2]),
    )
    t = np.linspace(0.0, 100.0, 2000)
    for slow, force in ((0.0, "0.0558 ± 0.0005"), (0.02, "about 0.056")):
        trace = Trace("relay-1", t, noise(0.004) + slow * np.sin(0.4 * t), 0.0 * t, 0.0 * t, "psi", "rad")
        assert f"no force below {force} of full" in " ".join(model_sentences(replace(bent, traces=(trace,))))
