"""Whole jobs, from link to report: what the command line's verbs do."""

from __future__ import annotations

from gcs_autotune.workflow.experiment import experiment
from gcs_autotune.workflow.operator import Operator, Unattended
from gcs_autotune.workflow.parameter_files import restore_parameters, save_parameters
from gcs_autotune.workflow.restore import is_settled, link_of, restore_run
from gcs_autotune.workflow.settings import EXPERIMENTS, Connection, TuneSettings
from gcs_autotune.workflow.study import StudySettings, study
from gcs_autotune.workflow.tune import tune

__all__ = [
    "EXPERIMENTS",
    "Connection",
    "Operator",
    "StudySettings",
    "TuneSettings",
    "Unattended",
    "experiment",
    "is_settled",
    "link_of",
    "restore_parameters",
    "restore_run",
    "save_parameters",
    "study",
    "tune",
]
