"""Complete jobs from the link to the report, one for each command of the command line.

* ``mission``: one job on one vehicle, declared before anything moves and then carried out step by step. ``tune``,
  ``experiment``, ``aboard`` and ``fly`` each declare one. They share ``settings``, ``connection``, ``preflight``, the
  ``runner`` of manoeuvres, the ``record`` directory, ``resuming`` and a ``worker`` that computes in the ``background``.
* Before anything moves: ``itinerary`` computes stages and times. ``tune_preview`` and ``flight_preview`` simulate the
  ``nominal_plant`` and compute the required space as an ``excursion``. ``announcement`` reports all of it.
* ``tunable_loop`` defines the sequence of every tune. The autopilot's loops in ``autopilot_loop`` use
  ``identification``, ``stop_rule``, ``proof`` and ``designing``.
* ``restore`` restores a vehicle after an interrupted run. ``study``, ``diagnosis``, ``authority`` and ``compare`` need
  only records, not a vehicle.
"""

from __future__ import annotations

from gcs_autotune.workflow.aboard import AboardSettings, fly_aboard
from gcs_autotune.workflow.actuators import tune_actuators
from gcs_autotune.workflow.authority import authority
from gcs_autotune.workflow.comparison import COMPARED, compare, fits_in
from gcs_autotune.workflow.desk_design import DeskSettings, design_at_desk, designs_of_styles
from gcs_autotune.workflow.diagnosis import DiagnosisSettings, run_diagnosis, write_diagnosis
from gcs_autotune.workflow.doctor import Finding, examine, listened_to
from gcs_autotune.workflow.experiment import experiment
from gcs_autotune.workflow.flight_plan import FlightPlan, FlySettings, load_flight_plan
from gcs_autotune.workflow.flight_preview import preview_of_model
from gcs_autotune.workflow.flight_result import FlightResult
from gcs_autotune.workflow.fly import PLAN_FILE, fly, fly_plan
from gcs_autotune.workflow.hold import HoldSettings, hold
from gcs_autotune.workflow.line import tune_line
from gcs_autotune.workflow.onboard_log import fetch_onboard_log
from gcs_autotune.workflow.operator import Operator, Unattended
from gcs_autotune.workflow.own_loops import load_models
from gcs_autotune.workflow.position import tune_position
from gcs_autotune.workflow.precision import Precision, precision_of
from gcs_autotune.workflow.recheck import recheck
from gcs_autotune.workflow.restore import (
    is_settled,
    link_of,
    restore_parameters,
    restore_run,
    save_parameters,
    settled_words,
)
from gcs_autotune.workflow.self_planned import first_run
from gcs_autotune.workflow.settings import CommonSettings, Connection, StudySettings, SuppliedGains, TuneSettings
from gcs_autotune.workflow.share import Shared, share_run
from gcs_autotune.workflow.study import study
from gcs_autotune.workflow.supplied_gains import load_gains
from gcs_autotune.workflow.tune import job_of, tune
from gcs_autotune.workflow.tune_all import tune_all

__all__ = [
    "COMPARED",
    "PLAN_FILE",
    "AboardSettings",
    "CommonSettings",
    "Connection",
    "DeskSettings",
    "DiagnosisSettings",
    "Finding",
    "FlightPlan",
    "FlightResult",
    "FlySettings",
    "HoldSettings",
    "Operator",
    "Precision",
    "Shared",
    "StudySettings",
    "SuppliedGains",
    "TuneSettings",
    "Unattended",
    "authority",
    "compare",
    "design_at_desk",
    "designs_of_styles",
    "examine",
    "experiment",
    "fetch_onboard_log",
    "first_run",
    "fits_in",
    "fly",
    "fly_aboard",
    "fly_plan",
    "hold",
    "is_settled",
    "job_of",
    "link_of",
    "listened_to",
    "load_flight_plan",
    "load_gains",
    "load_models",
    "precision_of",
    "preview_of_model",
    "recheck",
    "restore_parameters",
    "restore_run",
    "run_diagnosis",
    "save_parameters",
    "settled_words",
    "share_run",
    "study",
    "tune",
    "tune_actuators",
    "tune_all",
    "tune_line",
    "tune_position",
    "write_diagnosis",
]
