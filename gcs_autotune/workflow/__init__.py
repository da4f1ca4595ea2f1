"""Whole jobs, from link to report: what the command line's verbs do.

* ``tune``: its legs ``announcement``, ``axis_parameters``, ``preflight``, ``identification``, ``proof``, ``designing``,
  ``decision`` share a ``voyage``; ``experiment`` is the first half of it. Both steer by the ``helm``, come ``aboard``,
  keep a ``ledger`` and fill a ``record`` directory; ``experiments`` says what is flown on an axis.
* ``restore``, ``parameter_files``: putting a vehicle back. ``study``, ``diagnosis``, ``findings``: work at the desk.
"""

from __future__ import annotations

from gcs_autotune.workflow.experiment import experiment
from gcs_autotune.workflow.fly import FlightResult, FlySettings, fly, preview_of_model
from gcs_autotune.workflow.operator import Operator, Unattended
from gcs_autotune.workflow.parameter_files import restore_parameters, save_parameters
from gcs_autotune.workflow.restore import is_settled, link_of, restore_run
from gcs_autotune.workflow.settings import Connection, TuneSettings
from gcs_autotune.workflow.study import StudySettings, study
from gcs_autotune.workflow.tune import tune

__all__ = [
    "Connection",
    "FlightResult",
    "FlySettings",
    "Operator",
    "StudySettings",
    "TuneSettings",
    "Unattended",
    "experiment",
    "fly",
    "is_settled",
    "link_of",
    "preview_of_model",
    "restore_parameters",
    "restore_run",
    "save_parameters",
    "study",
    "tune",
]
