"""Run sequenced experiments (Erunsal2017).

A plan defines which manoeuvre identifies which parameters. ``plan`` reads the plan, and ``run`` executes the fits in
its order. ``combine`` weights the estimates of shared parameters by their information, and fits all runs together.
"""

from __future__ import annotations

from gcs_autotune.identify.plan.combine import Agreement
from gcs_autotune.identify.plan.plan import PLANS, Plan, PlanStep, load_plan, plan_from
from gcs_autotune.identify.plan.run import PlanResult, StepResult, run_plan

__all__ = ["PLANS", "Agreement", "Plan", "PlanResult", "PlanStep", "StepResult", "load_plan", "plan_from", "run_plan"]
