"""Reasons not to trust a fit are in one table."""

from __future__ import annotations

import string
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from gcs_autotune.identify import Doubt
from gcs_autotune.identify.axis.run_comparison import RunComparison
from gcs_autotune.identify.coupled.one_axis import _in_own_names
from gcs_autotune.identify.doubts import DOUBTS, DoubtRow, doubts_about
from gcs_autotune.identify.fit_builder import axis_table
from gcs_autotune.identify.outlier_run import DifferentPair, MisfittingRun, OutlierRun
from gcs_autotune.models import SingleDof


@dataclass(frozen=True)
class Voltages:
    """What a method might know of a battery."""

    volts: tuple[float, ...]


def _low(known: Voltages) -> Iterator[dict[str, object]]:
    yield from ({"volts": v} for v in known.volts if v < 10.0)


LOW_BATTERY = DoubtRow("low-battery", Voltages, _low, "the battery had {volts:.1f} V", "charge it")


def test_adding_a_doubt_means_adding_a_row() -> None:
    run = MisfittingRun("second", 4.0, 2.0)
    found = doubts_about(Voltages((9.0, 12.0, 8.0)), run, None, rows=(*DOUBTS, LOW_BATTERY))
    assert [d.slug for d in found] == ["run-apart", "low-battery", "low-battery"]
    assert found[1] == Doubt("low-battery", "the battery had 9.0 V", "charge it")
    assert not doubts_about(Voltages((9.0,)))


@pytest.mark.parametrize("row", DOUBTS, ids=lambda row: row.slug)
def test_each_row_has_a_cause_and_a_cure_with_named_fields(row: DoubtRow[Any]) -> None:
    fields = [field for text in (row.cause, row.cure) for _, field, _, _ in string.Formatter().parse(text)]
    assert all(field is None or field.isidentifier() for field in fields)
    assert row.cause and row.cure


def test_runs_that_differ_raise_a_doubt_about_the_craft_or_the_model() -> None:
    odd = (OutlierRun("second", 9.0, 0.5),)
    (apart,) = doubts_about(RunComparison(odd))
    assert "run 'second' differs from the others by 9 standard errors" in apart.cause
    (lacking,) = doubts_about(RunComparison(odd, True, ("sway",), "surge,sway,yaw"))
    assert lacking.slug == "runs-disagree" and "also moved in sway" in lacking.cause
    assert lacking.cure.endswith("--dof surge,sway,yaw")
    (term,) = doubts_about(RunComparison(odd, True))
    assert term.cure == "find the missing term with `diagnose`" and "also moved" not in term.cause


def test_neither_of_two_runs_is_called_the_outlier() -> None:
    (pair,) = doubts_about(RunComparison((OutlierRun("a", 9.0, 0.5, ("a", "b")),)))
    assert pair.slug == "run-apart" and "'a' and 'b'" in pair.cause
    (different,) = doubts_about(DifferentPair(("a", "b"), 2.04))
    assert different.slug == "runs-disagree" and "2.0 times better" in different.cause


def test_a_doubt_about_one_axis_has_the_names_of_its_table() -> None:
    pitch = SingleDof("pitch", "1", 0.03, 0.07, 0.05, 0.0, 0.0, 0.1)
    table = axis_table(pitch, np.zeros((6, 6)), ["fitted"] * 6)
    doubt = Doubt("correlated", "M_q and M_qq, M_qdot and M_sintheta", "omit M_q")
    (renamed,) = _in_own_names(pitch.axis, table, [doubt])
    assert renamed == Doubt("correlated", "beta_q and beta_qq, alpha_q and gamma_theta", "omit beta_q")
