"""Sequenced experiments (Erunsal2017): a plan defines which manoeuvre identifies what, and the fits run in that order.

``plan`` reads it and ``run`` executes it. ``combine`` weights the steps' estimates of shared parameters by their
information, and fits all runs at once.
"""

from __future__ import annotations

from gcs_autotune.identify.plan.combine import Agreement
from gcs_autotune.identify.plan.plan import load_plan
from gcs_autotune.identify.plan.run import PlanResult, run_plan

__all__ = ["Agreement", "PlanResult", "load_plan", "run_plan"]
