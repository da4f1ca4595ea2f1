"""The terminal reports, word for word, for good and bad endings."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import report_stories as stories

from gcs_autotune.identify import Doubt
from gcs_autotune.report import Document, fit_document, tune_document
from gcs_autotune.report.toolkit.terminal import render_text

GOLDEN = Path(__file__).parents[1] / "golden"

FAST = Doubt(
    "residuals-not-white",
    "the residuals follow a slow wave that the model does not know",
    "look for a current or a tether pulling, and repeat at slack water",
)


def undecided() -> Document:
    return fit_document(stories.fit("affine", verdict="undecided", stds=(0.0011, 0.004, 0.0064, 0.0009)))


def weakly_excited() -> Document:
    return fit_document(stories.fit(doubts=(stories.WEAK, FAST), stds=(0.0011, 0.0, 0.17, 0.0009)))


CASES = {
    "fit_good": lambda: fit_document(stories.fit()),
    "fit_undecided": undecided,
    "fit_weakly_excited": weakly_excited,
    "tune_kept_unsafe": lambda: tune_document(replace(stories.kept(), proposal=stories.proposal(worst_stable=False))),
    "tune_kept": lambda: tune_document(stories.kept()),
    "tune_restored": lambda: tune_document(stories.restored()),
    "tune_aborted": lambda: tune_document(stories.aborted()),
    "tune_never_started": lambda: tune_document(stories.never_started()),
    "tune_dry_run": lambda: tune_document(stories.dry_run()),
}


@pytest.mark.parametrize("name", CASES)
def test_the_terminal_report_equals_the_golden_file(name, tmp_path):
    text = render_text(CASES[name]())
    (tmp_path / f"{name}.txt").write_text(text, encoding="utf-8")
    assert text == (GOLDEN / f"{name}.txt").read_text(encoding="utf-8"), f"what came out is in {tmp_path}"


@pytest.mark.parametrize("name", CASES)
def test_nothing_is_wider_than_eighty_columns_and_nothing_is_cut_off(name):
    text = render_text(CASES[name]())
    assert max(len(line) for line in text.splitlines() if not line.startswith("  gcs-autotune ")) <= 80
    assert "…" not in text


def test_conflicting_evidence_on_damping_is_reported_with_the_choice():
    text = " ".join(render_text(fit_document(stories.fit("affine"))).split())
    assert "indicates quadratic damping. The fits to the whole records support linear and quadratic damping" in text
