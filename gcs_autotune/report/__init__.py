"""The only room that formats for people: the report, the terminal tables, the live line, the wording.

``story`` is what there is to tell; ``tables``, ``figures`` and ``wording`` turn it into rows, pictures and
sentences; ``html`` and ``terminal`` put those on a page or a screen; ``study`` and what begins with it tell of an
identification by itself, what begins with ``diagnosis`` of what a simulation gets wrong; ``live`` shows a running
manoeuvre, ``stages`` a long calculation; ``run_directory`` writes everything down.
"""

from __future__ import annotations

from gcs_autotune.report.diagnosis_page import render_diagnosis
from gcs_autotune.report.diagnosis_terminal import diagnosis_summary, effects_list, effects_to_dict
from gcs_autotune.report.flight_page import render_flight, render_preview
from gcs_autotune.report.live import TerminalWatcher
from gcs_autotune.report.log_survey import log_summary
from gcs_autotune.report.run_directory import summarise, write_story
from gcs_autotune.report.ship_sheet import sheets_summary
from gcs_autotune.report.stages import StageBar
from gcs_autotune.report.story import TuneStory
from gcs_autotune.report.study import Outcome, RunRow, Study, study_to_dict
from gcs_autotune.report.study_page import render_study
from gcs_autotune.report.study_terminal import study_summary
from gcs_autotune.report.terminal import fit_summary, show_tune
from gcs_autotune.report.wording import proof_command
from gcs_autotune.watch import SilentWatcher

__all__ = [
    "Outcome",
    "RunRow",
    "SilentWatcher",
    "StageBar",
    "Study",
    "TerminalWatcher",
    "TuneStory",
    "diagnosis_summary",
    "effects_list",
    "effects_to_dict",
    "fit_summary",
    "log_summary",
    "proof_command",
    "render_diagnosis",
    "render_flight",
    "render_preview",
    "render_study",
    "sheets_summary",
    "show_tune",
    "study_summary",
    "study_to_dict",
    "summarise",
    "write_story",
]
