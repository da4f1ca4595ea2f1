"""Controllers of our own: frozen laws made from a model by a rule.

The same law flies on a craft, runs in the preview and is analysed by python-control.
"""

from __future__ import annotations

from gcs_autotune.control.choice import (
    LEAST_MARGINS,
    AxisLoop,
    LoopMargins,
    OwnDesign,
    design_own,
    margins,
    simulated_step,
    step_response,
)
from gcs_autotune.control.distance import DistanceController, DistanceLaw, design_distance
from gcs_autotune.control.feedback import FeedbackController, FeedbackLaw
from gcs_autotune.control.helm import Helm, Reach, helm_for, reach_of
from gcs_autotune.control.ipd import (
    Uncertainty,
    design_ipd,
    drag_speed_limit,
    least_inertia_ratio,
    stability_bound,
    uncertainty_of,
)
from gcs_autotune.control.line import (
    LINE_LAWS,
    AdaptiveLineOfSight,
    DirectLine,
    IndirectLine,
    IntegralLineOfSight,
    Line,
    LineGuidance,
    LineOfHeading,
    LineQuestion,
    LineState,
    design_direct,
    design_indirect,
    simplify,
)
from gcs_autotune.control.path import TimedPath
from gcs_autotune.control.position import (
    POSITION_LAWS,
    IntegralSlidingMode,
    PidPosition,
    Pose,
    PositionController,
    PositionTarget,
    RigidModel,
    SlidingMode,
)
from gcs_autotune.control.reference_model import (
    REFERENCE_MODELS,
    SETTLED,
    ReferenceModel,
    ReferenceStep,
    omega_for_settling,
    reference_coefficients,
    reference_model,
    settling_time,
    wanted_step,
)
from gcs_autotune.control.set_point import OwnLoop, SetPointLoop
from gcs_autotune.control.structure import STRUCTURES, Structure
from gcs_autotune.control.wall_filter import WallEstimate, WallFilter, WallReading

__all__ = [
    "LEAST_MARGINS",
    "LINE_LAWS",
    "POSITION_LAWS",
    "REFERENCE_MODELS",
    "SETTLED",
    "STRUCTURES",
    "AdaptiveLineOfSight",
    "AxisLoop",
    "DirectLine",
    "DistanceController",
    "DistanceLaw",
    "FeedbackController",
    "FeedbackLaw",
    "Helm",
    "IndirectLine",
    "IntegralLineOfSight",
    "IntegralSlidingMode",
    "Line",
    "LineGuidance",
    "LineOfHeading",
    "LineQuestion",
    "LineState",
    "LoopMargins",
    "OwnDesign",
    "OwnLoop",
    "PidPosition",
    "Pose",
    "PositionController",
    "PositionTarget",
    "Reach",
    "ReferenceModel",
    "ReferenceStep",
    "RigidModel",
    "SetPointLoop",
    "SlidingMode",
    "Structure",
    "TimedPath",
    "Uncertainty",
    "WallEstimate",
    "WallFilter",
    "WallReading",
    "design_direct",
    "design_distance",
    "design_indirect",
    "design_ipd",
    "design_own",
    "drag_speed_limit",
    "helm_for",
    "least_inertia_ratio",
    "margins",
    "omega_for_settling",
    "reach_of",
    "reference_coefficients",
    "reference_model",
    "settling_time",
    "simplify",
    "simulated_step",
    "stability_bound",
    "step_response",
    "uncertainty_of",
    "wanted_step",
]
