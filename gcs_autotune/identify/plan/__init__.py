"""Run sequenced experiments (Erunsal2017): a plan defines which manoeuvre identifies which parameters.

The module ``plan`` reads the plan, and ``run`` executes the fits in the plan's order. ``combine`` weights the estimates
of shared parameters by their information, and fits all runs together.
"""

from __future__ import annotations

from gcs_autotune.identify.plan.combine import Agreement
from gcs_autotune.identify.plan.plan import load_plan
from gcs_autotune.identify.plan.run import PlanResult, run_plan

__all__ = ["Agreement", "PlanResult", "load_plan", "run_plan"]
