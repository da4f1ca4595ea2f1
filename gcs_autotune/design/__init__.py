"""From an identified model to gains for the autopilot's own control law. Proposes; never writes to a vehicle.

What to use when: :func:`design` makes a :class:`Proposal`, :func:`design_from` of a model with effects;
:func:`step_metrics` and :func:`is_better` judge the flown steps by the same ruler; :func:`design_ipd` and
:func:`stability_bound` are the controller of Miskovic2010.
"""

from __future__ import annotations

from gcs_autotune.design.actuator import Actuator
from gcs_autotune.design.hunting import Hunting
from gcs_autotune.design.ipd import IpdGains, Uncertainty, design_ipd, stability_bound, uncertainty_of
from gcs_autotune.design.model_function import MODEL_FUNCTIONS, model_function, omega_for_settling, settling_time
from gcs_autotune.design.proposal import design, design_from
from gcs_autotune.design.reduction import Reduction, reduce
from gcs_autotune.design.result import Change, Margins, ModelFunction, Prediction, Proposal, StepMetrics
from gcs_autotune.design.spec import Spec
from gcs_autotune.design.step_metrics import combine, step_metrics
from gcs_autotune.design.verdict import Verdict, is_better

__all__ = [
    "MODEL_FUNCTIONS",
    "Actuator",
    "Change",
    "Hunting",
    "IpdGains",
    "Margins",
    "ModelFunction",
    "Prediction",
    "Proposal",
    "Reduction",
    "Spec",
    "StepMetrics",
    "Uncertainty",
    "Verdict",
    "combine",
    "design",
    "design_from",
    "design_ipd",
    "is_better",
    "model_function",
    "omega_for_settling",
    "reduce",
    "settling_time",
    "stability_bound",
    "step_metrics",
    "uncertainty_of",
]
