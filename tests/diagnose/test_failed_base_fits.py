"""Base fits that fail: starts from pieces, wiring tried again, and what runs of one size can identify."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from open_loop_runs import sailed, squares, towed

from benchmarks.blind.case import draw_case
from benchmarks.blind.referee import run_case
from gcs_autotune.diagnose import diagnose
from gcs_autotune.diagnose.question import Question
from gcs_autotune.diagnose.state import begin_with
from gcs_autotune.diagnose.strategies import blocked_cv
from gcs_autotune.diagnose.undo_data_errors import undo_data_errors
from gcs_autotune.effects import EffectInstance
from gcs_autotune.identify.problems import fit_base, plain_form
from gcs_autotune.identify.signals import prepare_as_recorded

pytestmark = pytest.mark.slow


def slugs_of(result) -> list[str]:
    return [cause.effect.slug for cause in result.causes]


def test_drag_is_identified_from_a_base_without_drag_that_diverges_within_seconds() -> None:
    """A blind case that ended `unexplained` before pieces were tried as well."""
    found = run_case("single", 9101, 1, "linear-drag")
    assert (found.verdict, found.causes) == ("effect-found", ["linear-drag"])


def test_a_rudder_so_stalled_that_more_helm_turns_less_is_identified() -> None:
    stalled = ("rudder-stall", "N", {"angle": 0.4, "drop": 1.5})
    result = diagnose(squares(0.35, 0.5, 0.6, period=6.0, effects=[stalled]))
    assert result.verdict == "effect-found"
    assert slugs_of(result) == ["rudder-stall"]
    assert result.causes[0].parameters["angle"].value == pytest.approx(0.4, rel=0.05)


def test_blocks_of_every_run_are_held_out_if_no_run_predicts_the_others() -> None:
    runs = squares(0.3, 1.0, period=6.0, effects=[("saturation", "N", {"limit": 0.6})])
    form = plain_form(runs)
    segments = prepare_as_recorded(runs, form)[0]
    begun = begin_with(Question(form, segments, ["saturation", "input-delay"]), *fit_base(form, segments))
    assert begun.parts.kind == "runs"
    state, step = begun.step("cause 1")
    again = blocked_cv(state, replace(step, accepted=None))
    assert again is not None
    blocks, judged = again
    assert judged.accepted is not None
    assert judged.accepted.effect.slug == "saturation"
    assert blocks.parts.kind == "blocks"
    assert blocks.parts.words == "4 blocks of every run held out in turn"
    assert all({s.run for s in fold.test} == {"run0", "run1"} for fold in blocks.parts.folds)
    assert blocked_cv(blocks, replace(step, accepted=None)) is None
    assert begun.parts.kind == "runs", "a state never changes"


def test_a_limit_visible_only_in_the_held_out_runs_is_found_from_all_runs_and_reported() -> None:
    *runs, unseen = squares(0.8, 1.0, 0.3, period=6.0, effects=[("saturation", "N", {"limit": 0.6})])
    result = diagnose(runs, unseen=[unseen])
    assert "saturation" in {slug for group in (*result.indistinguishable, slugs_of(result)) for slug in group}
    assert "validation-was-needed" in {doubt.slug for doubt in result.doubts}


def test_a_change_of_mass_is_dated_correctly_although_a_later_time_fits_nearly_as_well() -> None:
    """A blind case that ended `unexplained` before other moments were tried."""
    found = run_case("single", 9101, 2, "mass-change")
    assert (found.verdict, found.causes) == ("effect-found", ["mass-change"])


def test_wrong_signs_and_units_are_undone_in_the_signals() -> None:
    (run, *_) = towed()
    form = plain_form([run])
    (segment,) = prepare_as_recorded([run], form)[0]
    wrong = [EffectInstance("sign-error", "psi", {}), EffectInstance("unit-error", "r", {"factor": 180.0 / math.pi})]
    right = undo_data_errors(wrong, segment)
    np.testing.assert_allclose(right.signals["psi"].values, -segment.signals["psi"].values)
    np.testing.assert_allclose(right.signals["r"].values, segment.signals["r"].values * math.pi / 180.0)
    assert undo_data_errors([EffectInstance("sign-error", "psi@another", {})], segment) is segment


def test_a_reversed_heading_is_identified_on_a_boat_with_a_measured_track() -> None:
    result = diagnose(sailed(("sign-error", "psi", {}), samples=125), effects=["sign-error", "channel-swap"])
    assert result.verdict == "effect-found"
    assert [(c.effect.slug, c.effect.place) for c in result.causes] == [("sign-error", "psi")]


def test_either_of_two_columns_that_disagree_by_a_unit_is_reported_as_possibly_wrong() -> None:
    result = diagnose(towed(("unit-error", "psi", {"factor": 180.0 / math.pi})), effects=["unit-error", "time-scale"])
    assert slugs_of(result) == ["unit-error"]
    (doubt,) = (d for d in result.doubts if d.slug == "another-place")
    assert {"psi", "r"} <= set(doubt.cause.replace(",", "").split())
    assert "0.01745" in doubt.cause
    assert "57.3" in doubt.cause


def test_late_sensors_and_late_commands_are_reported_as_indistinguishable() -> None:
    runs = towed(("measurement-delay", "psi+r", {"delay": 0.5}), noise=0.02)
    result = diagnose(runs, effects=["input-delay", "measurement-delay", "gyro-bias"])
    assert result.verdict == "effect-found"
    assert any({"input-delay", "measurement-delay"} <= set(group) for group in result.indistinguishable)


def test_a_heading_in_degrees_labelled_radians_is_identified() -> None:
    """A blind case that ended `unexplained` before headings were corrected by whole turns."""
    case = draw_case("single", 9103, 2, "unit-error")
    effects = ["unit-error", "sign-error", "compass-deviation"]
    result = diagnose(list(case.runs), unseen=list(case.unseen), effects=effects)
    assert (result.verdict, slugs_of(result)) == ("effect-found", ["unit-error"])
