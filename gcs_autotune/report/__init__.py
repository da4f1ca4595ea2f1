"""The only package that formats for people: pages, terminal tables, live lines, wording.

=========  ======================================================================
toolkit    the parts of every report
plots      figures of results, for pages and notebooks
tune       the report of a tune, and its run directory
study      the report of an identification or experiment
flight     the report of a manoeuvre, and of its preview
diagnosis  the report of what a simulation gets wrong
summaries  terminal output of the commands without a page
=========  ======================================================================
"""

from __future__ import annotations

from gcs_autotune.report.diagnosis.lead import hint_stories, lead_sentence
from gcs_autotune.report.diagnosis.page import MODEL_FILE, render_diagnosis
from gcs_autotune.report.diagnosis.tables import diagnosis_summary, effects_list, effects_to_dict
from gcs_autotune.report.flight.page import FlightModel, TrialTold, render_flight, render_preview
from gcs_autotune.report.flight.recheck import LoopCheck, LoopNumbers, recheck_summary, render_recheck
from gcs_autotune.report.plots import correlation_plot, frequency_plot, plan_plot, plot, profile_plot
from gcs_autotune.report.study.page import render_study
from gcs_autotune.report.study.study import MethodOutcome, RunRow, Study, study_to_dict
from gcs_autotune.report.study.tables import method_list, model_summary, study_summary
from gcs_autotune.report.summaries import (
    log_summary,
    plan_summary,
    propeller_summary,
    sheets_summary,
    thruster_summary,
)
from gcs_autotune.report.toolkit.axis_fit import fit_summary
from gcs_autotune.report.toolkit.live import StageBar, TerminalWatcher
from gcs_autotune.report.toolkit.wording import beside_telemetry, format_factor
from gcs_autotune.report.tune.run_directory import summarise, write_story
from gcs_autotune.report.tune.story import TuneStory
from gcs_autotune.report.tune.tables import show_tune
from gcs_autotune.report.tune.wording import proof_command
from gcs_autotune.watch import SilentWatcher

__all__ = [
    "MODEL_FILE",
    "FlightModel",
    "LoopCheck",
    "LoopNumbers",
    "MethodOutcome",
    "RunRow",
    "SilentWatcher",
    "StageBar",
    "Study",
    "TerminalWatcher",
    "TrialTold",
    "TuneStory",
    "beside_telemetry",
    "correlation_plot",
    "diagnosis_summary",
    "effects_list",
    "effects_to_dict",
    "fit_summary",
    "format_factor",
    "frequency_plot",
    "hint_stories",
    "lead_sentence",
    "log_summary",
    "method_list",
    "model_summary",
    "plan_plot",
    "plan_summary",
    "plot",
    "profile_plot",
    "proof_command",
    "propeller_summary",
    "recheck_summary",
    "render_diagnosis",
    "render_flight",
    "render_preview",
    "render_recheck",
    "render_study",
    "sheets_summary",
    "show_tune",
    "study_summary",
    "study_to_dict",
    "summarise",
    "thruster_summary",
    "write_story",
]
