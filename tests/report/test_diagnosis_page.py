"""The outputs of a diagnosis: the page, the terminal, the list of effects, the progress bar."""

from __future__ import annotations

import io
import json
import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from diagnosis_stories import STORIES, WHEN, cause, dead_zone, deviation, page_of, portraits, unexplained
from page_reader import Page
from rich.console import Console

from gcs_autotune.diagnose import MissingCurve, MissingForce, Signature, Value
from gcs_autotune.effects import EFFECTS, EffectInstance
from gcs_autotune.report import StageBar, diagnosis_document, effects_document, to_json
from gcs_autotune.report.diagnosis.cause_wording import cause_title
from gcs_autotune.report.diagnosis.figures import bin_means, most_informative_view, views_of
from gcs_autotune.report.diagnosis.wording import named, place_words, value_words, verdict_of
from gcs_autotune.report.toolkit.terminal import render_text
from gcs_autotune.report.toolkit.wording import format_parameter
from gcs_autotune.trial import Channel, Trial

TITLE = "Diagnosis of 'boat' <b>"


@cache
def story(name):
    return STORIES[name]()


@cache
def html_of(name):
    return page_of(story(name), TITLE, WHEN, "out dir")


def text_of(name):
    return Page(html_of(name)).text


def terminal_of(name):
    return shown(story(name))


def shown(diagnosed):
    return " ".join(render_text(diagnosis_document(diagnosed)).replace("│", " ").split())


@pytest.mark.slow
@pytest.mark.parametrize("name", STORIES)
def test_every_verdict_gives_a_well_formed_page_without_external_resources(name):
    page = Page(html_of(name))
    assert page.open == []
    assert len(page.ids) == len(set(page.ids))
    assert all(reference.startswith("#") for reference in page.references)
    assert not {"iframe", "img"} & set(page.tags)
    assert page.runs_only_ours


@pytest.mark.slow
def test_the_same_diagnosis_gives_the_same_bytes():
    assert page_of(deviation(), TITLE, WHEN, "out dir") == html_of("deviation")


@pytest.mark.slow
def test_names_from_the_user_are_escaped():
    page = html_of("dead-zone")
    assert "morning &lt;1&gt;" in page
    assert "<1>" not in page
    assert "Diagnosis of &#39;boat&#39; &lt;b&gt;" in page


def test_the_verdict_is_one_sentence_with_both_errors_on_unseen_data():
    gain = story("dead-zone").gain
    verdict = verdict_of(story("dead-zone"))
    assert "dead zone on yaw moment (N), width 0.302 ± 0.006 N m" in verdict.text
    first = verdict.sentences[0]
    assert f"{math.degrees(gain.before):.3g}°/s before, {math.degrees(gain.after):.3g}°/s after" in first
    assert "held-out" in first
    for text in (text_of("dead-zone"), terminal_of("dead-zone")):
        assert first in text
        assert "95 % interval" in text


def test_a_found_effect_is_reported_with_curve_gain_ranking_and_commands():
    text = text_of("dead-zone")
    assert "N acting [N m]" in text
    assert "half-width of the dead zone" in text
    assert "< 1e-15" not in text
    assert "2e-12" in text


def test_commands_for_the_extended_model_can_be_copied_for_any_directory_name():
    text = text_of("dead-zone")
    assert "gcs-autotune sitl VEHICLE --model 'out dir/model.json'" in text
    assert "gcs-autotune identify RUN --start 'out dir/model.json'" in text
    assert "gcs-autotune tune heading --model 'out dir/model.json'" in text


def test_causes_of_a_partly_explained_diagnosis_are_called_hypotheses():
    for text in (text_of("deviation"), terminal_of("deviation")):
        assert "Hypothesis: compass deviation on heading (psi)" in text
        assert "treat the causes as hypotheses" in text
        assert "0.01 ± ? N m" in text
        assert "The third run is short" in text


def test_a_deviation_card_is_plotted_on_a_compass_rose():
    text = text_of("deviation")
    assert "In the polar plot the dark circle marks zero" in text
    assert "NW" in text


def test_an_unexplained_diagnosis_reports_the_error_and_recommends_no_command():
    for text in (text_of("unexplained"), terminal_of("unexplained")):
        assert "no effect tried explains it" in text
        assert "the error of the simulated" in text
        assert "None of the 41 candidates" in text
    assert "--model" not in text_of("unexplained")


def test_a_diagnosis_without_effect_claims_only_what_the_runs_show():
    for text in (text_of("nothing"), terminal_of("nothing")):
        assert "These runs show no missing effect" in text
        assert "Other motion may show a missing effect" in text
        assert "Found" not in text


def test_unknown_numbers_are_left_out():
    text = text_of("bare")
    assert "nan" not in text.lower()
    assert "error of the simulated" not in text


def test_a_cause_without_gain_or_figures_is_reported():
    diagnosed = replace(dead_zone(), gain=None, gains=(), before=(), after=(), ranking=())
    for text in (Page(page_of(diagnosed, TITLE, WHEN)).text, shown(diagnosed)):
        assert "Found: dead zone on yaw moment (N)" in text
        assert "falls from" not in text


def test_alternative_causes_are_listed_with_the_manoeuvre_that_distinguishes_them():
    for text in (text_of("dead-zone"), terminal_of("dead-zone")):
        assert "Dead zone and quadratic thrust curve explain these runs about equally well" in text
        assert "Steps of several sizes" in text


@pytest.mark.parametrize(
    ("diagnosed", "slug", "place", "kind", "name", "signal"),
    [
        (dead_zone, "dead-zone", "N", "against", "N", "r"),
        (deviation, "compass-deviation", "psi", "against", "psi", "psi"),
    ],
)
def test_the_figure_in_which_the_effect_is_visible_is_shown(diagnosed, slug, place, kind, name, signal):
    view = most_informative_view(diagnosed().before, EFFECTS[slug], place)
    assert (view.kind, view.name, view.portrait.signal) == (kind, name, signal)
    assert view.share > 0.5


def test_without_a_cause_the_most_informative_figure_is_shown():
    view = most_informative_view(unexplained().before)
    assert (view.kind, view.portrait.signal) == ("spectrum", "r")


def test_no_view_of_white_noise_claims_to_explain_it():
    views = [view for portrait in portraits(lambda tau: tau, lambda psi: psi) for view in views_of(portrait)]
    assert len(views) > 3
    assert all(view.share < 0.05 for view in views)


def test_bins_contain_all_samples_once_even_with_three_command_values():
    x = np.repeat([-1.0, 0.0, 1.0], 40)
    centre, mean, _, count = bin_means(x, 2.0 * x)
    assert count.sum() == len(x)
    assert np.all(np.abs(mean - 2.0 * centre) < 1e-12)


def test_places_and_values_have_plain_names():
    assert place_words("u+v") == "surge velocity (u) and sway velocity (v)"
    assert place_words("t") == "the file's clock"
    assert place_words("surge+sway+yaw") == "surge, sway and yaw"
    assert place_words("psi+r+u+v") == "4 columns (psi, r, u, v)"
    current = replace(dead_zone().causes[0], effect=EffectInstance("steady-current", "over ground", {}))
    assert named(current) == "steady current (over ground)"
    assert value_words(Value(math.radians(6.93), "rad", math.radians(0.17))) == "0.121 ± 0.003 rad (6.93°)"
    assert value_words(Value(math.nan, "rad", math.nan)) == "?"


@pytest.mark.parametrize("turns", [-1, 0, 1, 3])
def test_a_heading_parameter_is_wrapped_to_one_turn(turns: int) -> None:
    """The direction to which a tether or wind turns the bow is a heading, independent of full turns."""
    anchor = Value(math.radians(178.0 + 360.0 * turns), "rad", math.radians(2.0))
    assert value_words(anchor, "anchor") == "3.11 ± 0.03 rad (178°)"
    assert format_parameter("tether-pull@yaw.anchor", anchor.value, anchor.std, "rad") == "3.11 ± 0.03"


def test_an_unidentifiable_heading_is_not_shown_and_a_depth_is_never_wrapped() -> None:
    assert value_words(Value(22.7, "rad", 7.0), "anchor") == "not identifiable from these runs"
    assert value_words(Value(22.7, "m", 7.0), "anchor") == "23 ± 7 m"
    assert value_words(Value(0.05, "rad/s", 0.01), "bias") == "0.050 ± 0.010 rad/s (2.9°/s)"
    assert value_words(Value(1.514, "rad/s", 0.01), "frequency") == "1.514 ± 0.010 rad/s"


def test_the_list_of_effects_has_every_entry_under_its_family():
    text = " ".join(render_text(effects_document(EFFECTS)).split())
    for slug, effect in EFFECTS.items():
        assert slug in text
        assert all(f"{q.name} [" in text for q in effect.parameters)
    listed = json.loads(json.dumps(to_json(effects_document(EFFECTS))))["effects"]
    assert [e["slug"] for e in listed] == list(EFFECTS)
    assert all(e["separated_by"] and e["family"] for e in listed)
    bounds = {(e["slug"], q["name"]): q["bounds"] for e in listed for q in e["parameters"]}
    assert bounds["dead-zone", "width"] == [0.0, 0.95]
    assert bounds["net-buoyancy", "force"] == [None, None]
    assert "0 to 0.95" in text


@pytest.mark.parametrize("name", STORIES)
def test_the_json_of_every_story_is_plain(name):
    diagnosed = story(name)
    assert json.loads(diagnosed.to_json())["verdict"] == diagnosed.verdict


@pytest.mark.parametrize("terminal", [False, True])
def test_progress_is_shown_only_on_a_terminal(terminal):
    stream = io.StringIO()
    with StageBar(Console(file=stream, force_terminal=terminal, width=80)) as bar:
        bar("cause 1: screening", 3, 23)
    assert ("cause 1: screening" in stream.getvalue()) is terminal


@pytest.mark.parametrize(("limit", "expected"), [(600.0, True), (float("inf"), False)])
def test_the_remaining_time_is_shown_if_the_work_has_a_known_end(limit, expected):
    stream = io.StringIO()
    with StageBar(Console(file=stream, force_terminal=True, width=120), given=limit) as bar:
        bar("cause 1: screening", 3, 23)
    assert ("at most 10:00 left" in stream.getvalue()) is expected


@pytest.mark.slow
def test_a_cause_with_a_flat_view_gets_no_figure():
    diagnosed = dead_zone()
    rng = np.random.default_rng(3)
    flat = []
    for portrait in diagnosed.before:
        against = {n: (x, rng.normal(0.0, 1.0, len(x)), u) for n, (x, _, u) in portrait.against.items()}
        flat.append(replace(portrait, against=against, cross={}, spectrum=None))
    assert "This indicates" in html_of("dead-zone")
    assert "This indicates" not in page_of(replace(diagnosed, before=tuple(flat)), "t", WHEN)


@pytest.mark.slow
def test_the_input_is_plotted_below_the_response_with_the_track_of_a_boat():
    diagnosed = dead_zone()
    trace = diagnosed.before[0].traces[0]
    channel = next(iter(diagnosed.base_model.base.form.inputs))
    t = np.linspace(trace.t[0], trace.t[-1], 50)
    places = {n: Channel(n, "m", t, 40.0 * f(t / 9.0)) for n, f in (("x", np.sin), ("y", np.cos))}
    run = Trial(trace.run, {channel: Channel(channel, "N m", t, np.sign(np.sin(t))), **places})
    bare, full = html_of("dead-zone"), page_of(diagnosed, "t", WHEN, runs=(run,))
    label = f">{channel} [N m]<"
    assert label in full
    assert label not in bare
    assert "Track over ground" in full
    assert "Track over ground" not in bare


def test_missing_model_terms_are_distinguished_from_faults_of_the_craft():
    fault = dead_zone()
    drag = cause("quadratic-drag", "yaw", 0.4, coefficient=(0.8, "N m s^2/rad^2", 0.05))
    both = replace(fault, causes=(drag, *fault.causes))
    headline = verdict_of(both).text
    assert "Found: dead zone on yaw moment (N); missing from the plain model: quadratic drag in yaw." in headline
    assert cause_title(both, drag) == "Missing from the plain model: quadratic drag in yaw"
    assert cause_title(replace(both, verdict="partly-explained"), drag).startswith(
        "Hypothesis: missing from the plain model: "
    )
    assert cause_title(both, fault.causes[0]) == "Dead zone on yaw moment (N)"
    alone = verdict_of(replace(both, causes=(drag,))).text
    assert alone.startswith(
        "Found: missing from the plain model: quadratic drag in yaw, coefficient 0.80 \N{PLUS-MINUS SIGN}"
    )


def test_every_cause_shows_its_evidence_and_the_best_alternative():
    diagnosed = terminal_of("dead-zone")
    assert "Very strong: log-likelihood +406.0, after the penalty for the added parameters." in diagnosed
    assert "Best alternative: quadratic thrust curve, log-likelihood +260.0." in diagnosed
    assert diagnosed.count("log-likelihood +406.0") == text_of("dead-zone").count("log-likelihood +406.0") == 1


@pytest.mark.parametrize(("shares", "is_said"), [((0.0, 0.9), True), ((0.9, 0.0), False)])
def test_only_a_cause_before_another_one_improves_the_prediction_together_with_it(
    shares: tuple[float, float], is_said: bool
) -> None:
    found = dead_zone()
    first, second = (replace(found.causes[0], share=share) for share in shares)
    text = shown(replace(found, causes=(first, second)))
    assert ("only together with the next ones" in text) is is_said
    # its evidence is that without the causes it needs, and so are its rivals
    assert text.count("Very strong: log-likelihood") == (1 if is_said else 2)


def test_with_process_noise_the_evidence_is_shown_for_each_part():
    weak = dead_zone()
    first = replace(weak.ranking[0], evidence=7.0, unseen=(5.5, -2.0), ci90=(0.5, 6.5))
    text = shown(replace(weak, ranking=(first,)))
    assert "Strong: log-likelihood of the held-out data +3.5 (per part +5.5, -2.0; 90 % interval +0.5 to +6.5)" in text
    assert "There is no evidence for an alternative effect." in text


def test_an_alternative_with_more_evidence_is_not_called_the_second_best():
    found = dead_zone()
    accepted, *others = found.ranking
    better = [replace(r, evidence=2.0 * accepted.evidence) if r.step == accepted.step else r for r in others]
    text = shown(replace(found, ranking=(accepted, *better)))
    assert "These runs support another cause as well: quadratic thrust curve, log-likelihood +812.0." in text
    equal = [replace(r, evidence=accepted.evidence - 0.01) if r.step == accepted.step else r for r in others]
    text = shown(replace(found, ranking=(accepted, *equal)))
    assert "These runs support another cause as well: quadratic thrust curve, log-likelihood +406.0." in text
    assert "Best alternative: quadratic thrust curve" not in text


def test_the_missing_force_is_plotted_over_the_signals_that_predict_it():
    x = np.array([-1.0, 0.0, 1.0])
    over_rate = MissingCurve("r", "rad/s", x, 0.2 * x, np.full(3, 0.05), 0.4)
    over_time = MissingCurve("time", "s", 10.0 * x + 10.0, 0.01 * x, np.full(3, 0.05), -0.1)
    over_way = MissingCurve("u", "m/s", x, 0.0 * x, np.full(3, 0.05), -0.2)
    missing = MissingForce("yaw", "N m", 0.3, 4.0, 0.2, {c.over: c for c in (over_rate, over_time, over_way)})
    page = Page(page_of(replace(unexplained(), missing=missing), TITLE, WHEN)).text
    assert "over yaw rate. The curve from the other runs predicts 40 % of its power." in page
    assert "over time into the run. The curve from the other runs predicts none of it." in page
    assert "surge velocity. The curve from the other runs" not in page


def test_a_cause_that_does_not_reduce_the_error_is_not_credited_with_it():
    diagnosed = dead_zone()
    worse = replace(diagnosed.gain, ratio=1.6, after=1.6 * diagnosed.gain.before, metric="error 5 s ahead")
    text = verdict_of(replace(diagnosed, verdict="partly-explained", gain=worse, gains=(worse,))).text
    assert "does not improve prediction of the yaw rate 5 s ahead on held-out data." in text
    assert "falls from" not in text


@pytest.mark.parametrize(("p", "noise"), [(0.4, True), (0.0058, False)])
def test_a_correlated_residual_without_findings_is_not_called_noise(p: float, noise: bool) -> None:
    told = shown(replace(dead_zone(), left=Signature((), p)))
    assert ("cannot be distinguished from noise" in told) is noise
    assert ("The residual is correlated" in told) is not noise
