"""The files on disk after a run."""

from __future__ import annotations

import io
import json
import math
from dataclasses import replace

import numpy as np
import pytest
import report_stories as stories
from rich.console import Console

from gcs_autotune.models import SingleDof
from gcs_autotune.report import Document, print_document, save_page, tune_document, write_story
from gcs_autotune.report.toolkit import page
from gcs_autotune.report.tune import run_directory as room


@pytest.fixture(autouse=True)
def without_pictures(monkeypatch):
    """The files are looked at, and what JSON is in them; pictures are in ``test_report_page`` and others."""
    monkeypatch.setattr(page, "drawn", lambda figure: iter(()))


def _read(path):
    def refuse(name: str) -> None:
        raise AssertionError(f"{name} is not JSON")

    return json.loads(path.read_text(encoding="utf-8"), parse_constant=refuse)


@pytest.mark.slow
def test_a_finished_tune_leaves_all_its_files_and_no_drafts(tmp_path):
    page = write_story(stories.kept(), tmp_path)
    assert page == tmp_path / "report.html"
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "fit.json",
        "gains.json",
        "model.json",
        "parameters_after.json",
        "parameters_before.json",
        "report.html",
        "summary.json",
    ]


@pytest.mark.slow
def test_the_model_on_disk_can_be_read_back(tmp_path):
    story = stories.kept()
    write_story(story, tmp_path)
    assert SingleDof.from_dict(_read(tmp_path / "model.json")) == story.fit.model
    assert _read(tmp_path / "parameters_before.json") == stories.PARAMETERS


@pytest.mark.slow
def test_the_summary_contains_the_ending_for_programs(tmp_path):
    write_story(stories.kept(), tmp_path)
    summary = _read(tmp_path / "summary.json")
    assert (summary["schema"], summary["ending"], summary["kept"]) == (1, "kept", True)
    assert summary["metrics"]["before"]["itae"] == 9.8
    assert summary["gains"]["ATC_ANG_YAW_P"] == [4.5, 1.82]
    assert summary["stable"] == {"model": True, "worst": True}


def test_non_finite_numbers_are_null_in_the_json(tmp_path):
    story = replace(
        stories.restored(),
        vehicle={"odd": np.float32(1.5), "worse": math.nan, "array": np.array([1.0, math.inf]), "thing": object},
    )
    write_story(story, tmp_path)
    summary = _read(tmp_path / "summary.json")
    assert summary["metrics"]["after"]["settling"] is None
    assert summary["vehicle"]["odd"] == 1.5
    assert summary["vehicle"]["worse"] is None
    assert summary["vehicle"]["array"] == [1.0, None]


def test_a_tune_that_never_started_leaves_a_summary_and_a_page(tmp_path):
    write_story(stories.never_started(), tmp_path / "new" / "run")
    assert sorted(p.name for p in (tmp_path / "new" / "run").iterdir()) == ["report.html", "summary.json"]
    assert _read(tmp_path / "new" / "run" / "summary.json")["kept"] is None


def test_the_page_lists_the_files_in_the_directory(tmp_path):
    (tmp_path / "trials").mkdir()
    (tmp_path / "trials" / "01-step.csv").write_text("t[s]\n", encoding="utf-8")
    text = write_story(replace(stories.aborted(), files=()), tmp_path).read_text(encoding="utf-8")
    assert "trials/01-step.csv" in text
    assert "summary.json" in text
    assert ".part" not in text


def test_the_numbers_are_saved_even_if_the_page_fails(tmp_path, monkeypatch):
    def fail(document: object) -> str:
        raise RuntimeError("no ink")

    monkeypatch.setattr(room, "to_html", fail)
    with pytest.raises(RuntimeError, match="no ink"):
        write_story(stories.kept(), tmp_path)
    assert _read(tmp_path / "summary.json")["ending"] == "kept"


@pytest.mark.slow
def test_a_failed_write_leaves_the_old_file_intact(tmp_path, monkeypatch):
    write_story(stories.kept(), tmp_path)
    old = (tmp_path / "summary.json").read_bytes()

    def full(descriptor: int) -> None:
        raise OSError("no space left on device")

    monkeypatch.setattr(room.os, "fsync", full)
    with pytest.raises(OSError, match="no space"):
        write_story(stories.aborted(), tmp_path)
    assert (tmp_path / "summary.json").read_bytes() == old


def test_the_undo_command_is_on_one_line():
    out = io.StringIO()
    console = Console(file=out, width=40, force_terminal=False, color_system=None, legacy_windows=False)
    print_document(console, tune_document(stories.kept()))
    lines = out.getvalue().splitlines()
    assert "  gcs-autotune params restore runs/2026-11-20T20-12-00-heading" in lines


def test_every_page_has_the_vehicle_in_its_title_and_links_to_the_files(tmp_path):
    (tmp_path / "trials").mkdir()
    (tmp_path / "trials" / "01 step.csv").write_text("t[s]\n")
    document = Document("Recheck of heading: udpin:0.0.0.0:14550", ())
    text = save_page(tmp_path, document).read_text(encoding="utf-8")
    assert "<h1>Recheck of heading: udpin:0.0.0.0:14550</h1>" in text
    assert "gcs-autotune share" not in text  # no vehicle, so not a run
    (tmp_path / "journal.jsonl").write_text('{"event": "opened", "vehicle": {"firmware": "ArduRover"}}\n')
    text = save_page(tmp_path, document).read_text(encoding="utf-8")
    assert "<h1>Recheck of heading: udpin:0.0.0.0:14550 · ArduRover</h1>" in text
    assert f"gcs-autotune share {tmp_path}" in text
    for name in ("trials/01%20step.csv", "journal.jsonl", "summary.json"):
        assert f'<a href="{name}">' in text
