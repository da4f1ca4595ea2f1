"""Formats results for users: pages, terminal tables, live lines, wording. No other package does this.

Each report is a :class:`Document`, built by the function named after it and shown by :func:`to_html`,
:func:`print_document` or :func:`to_json`. To add a section, add a function to the module of its report.

=========  ======================================================================
toolkit    the document model, its three renderers, and common parts
plots      figures of results, for pages and notebooks
tune       the report of a tune, and its run directory
study      the report of an identification or experiment
cases      the report of a study of many cases
flight     the report of a manoeuvre, and of its preview
diagnosis  the report of what a simulation gets wrong
designed   the report of gains designed at the desk
navigated  the report of a navigation solution
summaries  reports of the commands that write no page
=========  ======================================================================
"""

from __future__ import annotations

from gcs_autotune.observer import SilentObserver
from gcs_autotune.report.cases import (
    BOUND_CLASSES,
    BoundCheck,
    CaseStudy,
    Confusion,
    Rate,
    Spread,
    StudyComparison,
    SuccessMap,
    WorstCase,
    case_study_document,
    draw_success_map,
)
from gcs_autotune.report.designed import DesignedGains, DesignedOwn, DesignedRelay, designed_document, styles_compared
from gcs_autotune.report.diagnosis.document import diagnosis_document
from gcs_autotune.report.diagnosis.lead import hint_notes, hint_title, lead_sentence
from gcs_autotune.report.diagnosis.tables import effects_document, parameter_table_document
from gcs_autotune.report.flight.authority import authority_document
from gcs_autotune.report.flight.compared import ComparedRun, Comparison, comparison_document, reference_of
from gcs_autotune.report.flight.document import (
    FlightModel,
    FlightStory,
    TrialSummary,
    flight_document,
    preview_document,
)
from gcs_autotune.report.flight.held import (
    Held,
    HeldDistance,
    HeldLine,
    HeldLoop,
    HeldPosition,
    distance_figures,
    figures_on,
    hold_document,
    position_figures,
)
from gcs_autotune.report.flight.recheck import LoopCheck, LoopNumbers, recheck_document
from gcs_autotune.report.navigated import navigation_document
from gcs_autotune.report.plots import correlation_plot, frequency_plot, plan_plot, plot, profile_plot
from gcs_autotune.report.study.document import fit_document, method_list, study_document
from gcs_autotune.report.study.study import MethodOutcome, RunRow, Study
from gcs_autotune.report.summaries import (
    laser_document,
    log_document,
    plan_document,
    propeller_document,
    sheets_document,
    thruster_document,
    twin_document,
)
from gcs_autotune.report.toolkit.chart import script_digest
from gcs_autotune.report.toolkit.data import to_json
from gcs_autotune.report.toolkit.document import Document, files_section
from gcs_autotune.report.toolkit.live import StageBar, TerminalObserver
from gcs_autotune.report.toolkit.page import to_html
from gcs_autotune.report.toolkit.terminal import print_document, to_terminal
from gcs_autotune.report.toolkit.wording import (
    beside_telemetry,
    format_error,
    format_factor,
    format_share,
    how_to_resume,
    sentence,
)
from gcs_autotune.report.tune.all_loops import JobStep, JobStory, job_document, simulated_with
from gcs_autotune.report.tune.document import tune_document
from gcs_autotune.report.tune.run_directory import save_page, write_story
from gcs_autotune.report.tune.story import TuneStory
from gcs_autotune.report.tune.wording import parameters_sentence, proof_command

__all__ = [
    "BOUND_CLASSES",
    "BoundCheck",
    "CaseStudy",
    "ComparedRun",
    "Comparison",
    "Confusion",
    "DesignedGains",
    "DesignedOwn",
    "DesignedRelay",
    "Document",
    "FlightModel",
    "FlightStory",
    "Held",
    "HeldDistance",
    "HeldLine",
    "HeldLoop",
    "HeldPosition",
    "JobStep",
    "JobStory",
    "LoopCheck",
    "LoopNumbers",
    "MethodOutcome",
    "Rate",
    "RunRow",
    "SilentObserver",
    "Spread",
    "StageBar",
    "Study",
    "StudyComparison",
    "SuccessMap",
    "TerminalObserver",
    "TrialSummary",
    "TuneStory",
    "WorstCase",
    "authority_document",
    "beside_telemetry",
    "case_study_document",
    "comparison_document",
    "correlation_plot",
    "designed_document",
    "diagnosis_document",
    "distance_figures",
    "draw_success_map",
    "effects_document",
    "figures_on",
    "files_section",
    "fit_document",
    "flight_document",
    "format_error",
    "format_factor",
    "format_share",
    "frequency_plot",
    "hint_notes",
    "hint_title",
    "hold_document",
    "how_to_resume",
    "job_document",
    "laser_document",
    "lead_sentence",
    "log_document",
    "method_list",
    "navigation_document",
    "parameter_table_document",
    "parameters_sentence",
    "plan_document",
    "plan_plot",
    "plot",
    "position_figures",
    "preview_document",
    "print_document",
    "profile_plot",
    "proof_command",
    "propeller_document",
    "recheck_document",
    "reference_of",
    "save_page",
    "script_digest",
    "sentence",
    "sheets_document",
    "simulated_with",
    "study_document",
    "styles_compared",
    "thruster_document",
    "to_html",
    "to_json",
    "to_terminal",
    "tune_document",
    "twin_document",
    "write_story",
]
