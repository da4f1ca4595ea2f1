"""Numbers of a supplied model, or of a foreign simulator, that the runs contradict."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace

import numpy as np
import open_loop_runs
import pytest
from open_loop_runs import towed

from gcs_autotune.diagnose import diagnose
from gcs_autotune.diagnose.question import Question
from gcs_autotune.diagnose.state import begin_with
from gcs_autotune.diagnose.strategies import SEARCH, drop_insignificant, follow
from gcs_autotune.effects import EffectInstance, ExtendedModel
from gcs_autotune.identify.axis.form import as_extended
from gcs_autotune.identify.model_file import ModelFile, load_model
from gcs_autotune.identify.problems.base_model import fit_base, plain_form
from gcs_autotune.identify.signals.preparation import prepare_as_recorded
from gcs_autotune.models import SingleDof
from gcs_autotune.models.coupled import CoupledModel, Form
from gcs_autotune.report import diagnosis_document
from gcs_autotune.report.diagnosis.wording import scale_words
from gcs_autotune.report.toolkit.terminal import render_text
from gcs_autotune.workflow.diagnosis import write_diagnosis
from sitl.open_loop import Hull

pytestmark = pytest.mark.slow

FEW = ["dead-zone", "input-bias", "input-delay"]
TRUE = {"N_rdot": -2.0, "N_r": -1.0}
FORM = Form("plain", "yaw", ("yaw",), ("N_rdot", "N_r"), {}, {"N": (("N", 1.0),)}, coriolis=False)
DEAD_ZONE = ("dead-zone", "N", {"width": 0.15})


def with_numbers(*effects, **factors):
    return ExtendedModel(CoupledModel(FORM, {n: factors.get(n, 1.0) * v for n, v in TRUE.items()}), effects)


def of_simulator(monkeypatch, inertia, drag, **others):
    """What a simulator with these constants makes of the commands of ``towed``."""
    with monkeypatch.context() as patch:
        patch.setattr(open_loop_runs, "HULL", Hull(("yaw",), {"yaw": inertia}, {"yaw": drag}))
        return [replace(run, name=f"sim{k}") for k, run in enumerate(towed(noise=0.0, **others))]


def words(result):
    return " ".join(render_text(diagnosis_document(result)).split())


def test_an_inertia_raised_by_half_is_the_only_number_reported():
    result = diagnose(towed(), model=with_numbers(N_rdot=1.5), effects=FEW)
    assert result.verdict == "wrong-numbers"
    (wrong,) = result.wrong_numbers
    assert (wrong.name, wrong.unit, wrong.given) == ("N_rdot", "N m s^2/rad", -3.0)
    assert abs(wrong.value + 2.0) < 4.0 * wrong.std < 0.02
    assert wrong.ci95[0] < wrong.value < wrong.ci95[1] < -1.9
    assert result.numbers is not None and result.numbers.gain is not None
    assert result.numbers.gain.ratio < 0.1
    assert result.gain is None
    assert "One number of your simulation is wrong: inertia in yaw." in words(result)
    assert "Wrong number in the model: N_rdot is -3, but -1.99" in words(result)
    assert result.base_model.base["N_rdot"] == -3.0
    assert result.extended_model.base["N_rdot"] == wrong.value
    assert result.extended_model.base["N_r"] == pytest.approx(-1.0, abs=1e-3)


def test_two_wrong_numbers_are_both_reported():
    result = diagnose(towed(), model=with_numbers(N_rdot=0.7, N_r=1.3), effects=FEW)
    assert result.verdict == "wrong-numbers"
    assert {n.name for n in result.wrong_numbers} == {"N_rdot", "N_r"}


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_model_with_correct_numbers_has_no_wrong_number(seed):
    result = diagnose(towed(seed=seed), model=with_numbers(), effects=FEW)
    assert result.verdict == "no-effect"
    assert result.numbers is not None
    assert [n.wrong for n in result.numbers.rows] == [False, False]
    assert result.numbers.gains == ()
    assert "These runs contradict no number of the model" in words(result)


def test_an_effect_does_not_make_correct_numbers_wrong():
    result = diagnose(towed(DEAD_ZONE, seed=2), model=with_numbers(), effects=FEW)
    assert result.verdict == "effect-found"
    assert result.wrong_numbers == ()
    assert [c.effect.slug for c in result.causes] == ["dead-zone"]


def test_the_gain_of_an_effect_is_relative_to_the_model_with_corrected_numbers():
    result = diagnose(towed(DEAD_ZONE, seed=2), model=with_numbers(N_r=1.3), effects=FEW)
    assert result.verdict == "wrong-numbers-and-effect"
    assert [n.name for n in result.wrong_numbers] == ["N_r"]
    assert [c.effect.slug for c in result.causes] == ["dead-zone"]
    assert result.numbers is not None and result.gain is not None
    right = {g.signal: g for g in result.numbers.gains}
    assert right.keys() == {g.signal for g in result.gains}
    for gain in result.gains:
        assert gain.before == pytest.approx(right[gain.signal].after)
    text = words(result)
    assert text.index("N_r is -1.3") < text.index("Also found: dead zone")


def test_the_gain_of_a_cause_is_relative_to_the_better_of_supplied_and_fitted_numbers():
    model = as_extended(SingleDof("yaw", "N m", alpha=3.0, beta=1.0, delta=1e-6))  # a free constant force drifts unseen
    result = diagnose(towed(DEAD_ZONE, seed=2), model=model, effects=FEW)
    assert [c.effect.slug for c in result.causes] == ["dead-zone"]
    assert result.numbers is not None
    given = {g.signal: (g.before, g.after) for g in result.numbers.gains}
    errors = np.array([[*given[g.signal], g.before] for g in result.gains])
    as_given, set_right, counted = np.exp(np.log(errors).mean(axis=0))
    assert counted == pytest.approx(min(as_given, set_right))


def test_a_number_of_an_effect_in_the_model_may_be_the_wrong_one():
    own = EffectInstance("input-delay", "N", {"delay": 0.8})
    result = diagnose(towed(("input-delay", "N", {"delay": 0.4})), model=with_numbers(own), effects=FEW)
    assert result.verdict == "wrong-numbers"
    (wrong,) = result.wrong_numbers
    assert (wrong.name, wrong.given) == ("input-delay@N.delay", 0.8)
    assert abs(wrong.value - 0.4) < max(4.0 * wrong.std, 0.01)
    assert result.extended_model.effects[0]["delay"] == wrong.value


def test_a_diverging_model_has_a_wrong_number_and_is_not_rejected():
    result = diagnose(towed(), model=with_numbers(N_r=-4.0), effects=FEW)
    assert result.verdict == "wrong-numbers"
    assert [n.name for n in result.wrong_numbers] == ["N_r"]


def test_numbers_marked_as_known_are_judged_if_all_are_known():
    form = replace(FORM, free=(), known={"N_rdot": -3.0, "N_r": -1.0})
    result = diagnose(towed(), model=ExtendedModel(CoupledModel(form, {})), effects=["input-bias"])
    assert result.verdict == "wrong-numbers"
    assert [(n.name, n.given) for n in result.wrong_numbers] == [("N_rdot", -3.0)]


def test_numbers_all_wrong_by_one_factor_suggest_a_wrong_command_scale():
    result = diagnose(towed(), model=with_numbers(N_rdot=1.5, N_r=1.5), effects=["input-bias"])
    assert len(result.wrong_numbers) == 2
    assert re.search(
        r"All numbers differ by the same factor \(0\.66\d\)\. A wrong scale of the commands", words(result)
    )
    assert result.numbers is not None
    apart = [replace(n, value=1.1 * n.value) if n.name == "N_r" else n for n in result.numbers.rows]
    assert scale_words(replace(result.numbers, rows=tuple(apart))) == []


def test_numbers_are_reported_with_the_names_and_signs_of_the_file(tmp_path):
    path = tmp_path / "theirs.json"
    path.write_text(json.dumps(SingleDof("yaw", "N m", alpha=3.0, beta=1.0).to_dict()))
    result = diagnose(towed(), model=load_model(path), effects=FEW)
    (wrong,) = result.wrong_numbers
    assert (wrong.name, wrong.unit, wrong.given) == ("alpha", "N m s^2/rad", 3.0)
    assert wrong.value == pytest.approx(2.0, abs=0.02)
    assert wrong.ci95[0] < wrong.ci95[1]
    assert "Wrong number in the model: alpha is 3, but 1.99" in words(result)


def test_a_number_within_the_error_that_its_file_states_is_not_wrong():
    model = as_extended(SingleDof("yaw", "N m", alpha=2.2, beta=1.0))
    axis = SingleDof("yaw", "N m", alpha=2.2, beta=1.0)
    known = ModelFile("theirs", model, axis, names=("alpha",), covariance=np.array([[0.1**2]]))
    assert diagnose(towed(), model=replace(known, names=(), covariance=np.zeros((0, 0))), effects=FEW).wrong_numbers
    result = diagnose(towed(), model=known, effects=FEW)
    assert result.verdict == "no-effect"


def test_wrong_gain_and_time_constant_of_a_simulator_are_reported(monkeypatch):
    result = diagnose(towed(), simulations=of_simulator(monkeypatch, 3.0, 1.25), effects=FEW)
    assert result.verdict == "wrong-numbers"
    assert result.numbers is not None and result.numbers.of == "simulation"
    rows = {n.name: n for n in result.numbers.rows}
    assert set(rows) == {"gain of yaw", "time constant of yaw", "delay of N", "trim of N"}
    assert {n for n, row in rows.items() if row.wrong} == {"gain of yaw", "time constant of yaw"}
    for name, theirs, ours in (("gain of yaw", 0.8, 1.0), ("time constant of yaw", 2.4, 2.0)):
        assert rows[name].given == pytest.approx(theirs, rel=0.01)
        assert abs(rows[name].value - ours) < 4.0 * rows[name].std < 0.05
    assert result.causes == ()


def test_a_correct_simulator_has_no_wrong_number(monkeypatch):
    result = diagnose(towed(), simulations=of_simulator(monkeypatch, 2.0, 1.0), effects=FEW)
    assert result.verdict == "no-effect"
    assert result.wrong_numbers == ()


def test_page_document_and_model_file_agree(tmp_path):
    result = diagnose(towed(), model=with_numbers(N_rdot=1.5), effects=FEW)
    page = write_diagnosis(result, tmp_path, "2026-01-01T00:00:00").read_text(encoding="utf-8")
    data = json.loads((tmp_path / "diagnosis.json").read_text())
    (row,) = [r for r in data["numbers"]["rows"] if r["wrong"]]
    assert data["verdict"] == "wrong-numbers"
    assert data["numbers"]["wrong"] == ["N_rdot"]
    assert data["numbers"]["gain"]["ratio"] < 0.1
    assert load_model(tmp_path / "model.json").model.base["N_rdot"] == row["value"]
    assert "Wrong number in the model: N_rdot is -3" in page
    assert "The model’s numbers and these runs" in page.replace("&#39;", "’").replace("'", "’")


def the_search(runs, slugs):
    form = plain_form(runs)
    segments, _ = prepare_as_recorded(runs, form)
    problem, fitted = fit_base(form, segments)
    return begin_with(Question(form, segments, slugs), problem, fitted)


def test_a_cause_that_only_frees_the_fit_from_a_local_minimum_is_not_credited():
    search = the_search(towed(), FEW)
    base = search.base
    theta = np.array([-3.0, -1.0])
    poor = search.problem.fit(theta, (), base.initial, trials=0)
    assert poor is not None and poor.cost > base.cost + 100.0
    stuck = follow(begin_with(search.question, search.problem, poor), SEARCH)
    assert stuck.fitted.effects == ()
    assert stuck.base.cost == pytest.approx(base.cost, abs=1.0)


def test_a_cause_whose_interval_contains_zero_is_dropped():
    search = the_search(towed(), FEW)
    base = search.fitted
    late = search.problem.fit(base.theta, (EffectInstance("input-bias", "yaw", {"bias": 0.0}),), base.initial)
    assert late is not None and math.isfinite(late.cost)
    left = drop_insignificant(search.with_model(late))
    assert left is not None
    assert left.fitted.effects == ()
