"""Bases that lose the craft altogether: pieces to begin from, wiring tried anew, what runs of one size can tell."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from runs_in_the_tank import sailed, squares, towed

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


def named(told) -> list[str]:
    return [cause.effect.slug for cause in told.causes]


def test_drag_is_found_from_a_base_that_has_none_and_drifts_away_within_seconds() -> None:
    """A blind case that ended `unexplained` before pieces were tried as well."""
    found = run_case("single", 9101, 1, "linear-drag")
    assert (found.verdict, found.causes) == ("effect-found", ["linear-drag"])


def test_a_rudder_stalled_so_deep_that_more_helm_turns_the_craft_back_is_found() -> None:
    stalled = ("rudder-stall", "N", {"angle": 0.4, "drop": 1.5})
    told = diagnose(squares(0.35, 0.5, 0.6, period=6.0, effects=[stalled]))
    assert told.verdict == "effect-found"
    assert named(told) == ["rudder-stall"]
    assert told.causes[0].parameters["angle"].value == pytest.approx(0.4, rel=0.05)


def test_where_no_run_is_foretold_by_the_others_blocks_of_every_run_are_left_out() -> None:
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


def test_a_limit_that_only_the_runs_kept_apart_tell_is_found_in_all_together_and_that_is_said() -> None:
    *runs, unseen = squares(0.8, 1.0, 0.3, period=6.0, effects=[("saturation", "N", {"limit": 0.6})])
    told = diagnose(runs, unseen=[unseen])
    assert "saturation" in {slug for group in (*told.indistinguishable, named(told)) for slug in group}
    assert "validation-was-needed" in {doubt.slug for doubt in told.doubts}


def test_a_change_of_mass_is_dated_right_although_some_swings_too_late_fits_nearly_as_well() -> None:
    """A blind case that ended `unexplained` before other moments were tried."""
    found = run_case("single", 9101, 2, "mass-change")
    assert (found.verdict, found.causes) == ("effect-found", ["mass-change"])


def test_signals_are_read_as_they_were_before_a_wrong_sign_or_unit() -> None:
    (run, *_) = towed()
    form = plain_form([run])
    (segment,) = prepare_as_recorded([run], form)[0]
    wrong = [EffectInstance("sign-error", "psi", {}), EffectInstance("unit-error", "r", {"factor": 180.0 / math.pi})]
    right = undo_data_errors(wrong, segment)
    np.testing.assert_allclose(right.signals["psi"].values, -segment.signals["psi"].values)
    np.testing.assert_allclose(right.signals["r"].values, segment.signals["r"].values * math.pi / 180.0)
    assert undo_data_errors([EffectInstance("sign-error", "psi@another", {})], segment) is segment


def test_a_heading_that_counts_the_other_way_is_found_on_a_boat_whose_way_over_ground_is_measured() -> None:
    told = diagnose(sailed(("sign-error", "psi", {}), samples=125), effects=["sign-error", "channel-swap"])
    assert told.verdict == "effect-found"
    assert [(c.effect.slug, c.effect.place) for c in told.causes] == [("sign-error", "psi")]


def test_of_two_columns_that_disagree_by_a_unit_either_may_be_wrong_and_that_is_said() -> None:
    told = diagnose(towed(("unit-error", "psi", {"factor": 180.0 / math.pi})), effects=["unit-error", "time-scale"])
    assert named(told) == ["unit-error"]
    (doubt,) = (d for d in told.doubts if d.slug == "another-place")
    assert {"psi", "r"} <= set(doubt.cause.replace(",", "").split())
    assert "0.01745" in doubt.cause
    assert "57.3" in doubt.cause


def test_late_sensors_and_late_commands_are_named_together_as_only_the_time_before_the_runs_could_tell() -> None:
    runs = towed(("measurement-delay", "psi+r", {"delay": 0.5}), noise=0.02)
    told = diagnose(runs, effects=["input-delay", "measurement-delay", "gyro-bias"])
    assert told.verdict == "effect-found"
    assert any({"input-delay", "measurement-delay"} <= set(group) for group in told.indistinguishable)


def test_a_heading_in_degrees_that_says_radians_is_found_although_the_fit_took_it_for_thirteen_turns() -> None:
    """A blind case that ended `unexplained` before headings were put back by whole turns."""
    case = draw_case("single", 9103, 2, "unit-error")
    effects = ["unit-error", "sign-error", "compass-deviation"]
    told = diagnose(list(case.runs), unseen=list(case.unseen), effects=effects)
    assert (told.verdict, named(told)) == ("effect-found", ["unit-error"])
