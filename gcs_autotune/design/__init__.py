"""Calculate gains for the autopilot's own control law from an identified model. Nothing is written to a vehicle.

:func:`design` returns a :class:`Proposal` for a plain model, and :func:`design_from` one for a model with effects.
:func:`provisional` returns nearly the same gains in a fifth of the time, while experiments are still being flown.
:func:`step_metrics` and :func:`is_better` measure and compare the flown steps by the same criteria. Controllers of this
project are in ``control``.

:func:`authority_of` computes what a craft can do, and :func:`limits_for` the limits that its autopilot should have.
"""

from __future__ import annotations

from gcs_autotune.design.actuator import USED, Actuator
from gcs_autotune.design.analysis import DiskMargin, LoopAnalysis, LoopResponse, analyse_own, analyse_proposal
from gcs_autotune.design.authority import (
    Authority,
    AuthorityFigure,
    Circle,
    CraftModels,
    FlownModel,
    Missing,
    authority_of,
)
from gcs_autotune.design.autopilot_limits import ParameterLimit, limits_for, rudder_trim
from gcs_autotune.design.laws import LAWS, OTHER_MODE, Law, LoopStart
from gcs_autotune.design.laws.law import Scenario
from gcs_autotune.design.laws.loops import holding
from gcs_autotune.design.laws.rover_speed import pulse_of, throttle_of
from gcs_autotune.design.line import LINE_PARAMETERS, HullTurn, OnLeg, current_on, line_changes, pivots_wide, too_short
from gcs_autotune.design.margins import Plant, crossings, margins_of_each
from gcs_autotune.design.motor_law import (
    SPEED_GAINS,
    STEERING_GAINS,
    Linearity,
    MotorFit,
    MotorLaw,
    fit_motor_law,
    is_more_linear,
    linearity,
    motor_changes,
)
from gcs_autotune.design.open_loop import OpenLoop
from gcs_autotune.design.other_mode import SHORTER, shortfall_of, turn_rate_step
from gcs_autotune.design.plant import in_fractions
from gcs_autotune.design.position import (
    LOITER_CONTEXT,
    LOITER_GAINS,
    POSITION_CONTEXT,
    POSITION_GAINS,
    PositionDesign,
    design_position,
    loiter_change,
)
from gcs_autotune.design.position_metrics import UNSTABLE, PositionMetrics, Stay, holds_better, position_metrics
from gcs_autotune.design.prediction import over_windows
from gcs_autotune.design.proposal import ProvisionalGains, design, design_from, provisional
from gcs_autotune.design.reduction import Reduction, Remark, reduce
from gcs_autotune.design.result import Change, Hunting, Margins, Prediction, Proposal, StepMetrics
from gcs_autotune.design.spec import STYLE_STEPS, STYLES, Spec, Style, style_number, style_of
from gcs_autotune.design.step_metrics import combine, step_metrics
from gcs_autotune.design.track_metrics import TrackMetrics, follows_better, track_metrics
from gcs_autotune.design.verdict import (
    Verdict,
    is_better,
    is_calmer,
    is_followed,
    is_foretold,
    is_no_worse,
    scatter_of,
)

__all__ = [
    "LAWS",
    "LINE_PARAMETERS",
    "LOITER_CONTEXT",
    "LOITER_GAINS",
    "OTHER_MODE",
    "POSITION_CONTEXT",
    "POSITION_GAINS",
    "SHORTER",
    "SPEED_GAINS",
    "STEERING_GAINS",
    "STYLES",
    "STYLE_STEPS",
    "UNSTABLE",
    "USED",
    "Actuator",
    "Authority",
    "AuthorityFigure",
    "Change",
    "Circle",
    "CraftModels",
    "DiskMargin",
    "FlownModel",
    "HullTurn",
    "Hunting",
    "Law",
    "Linearity",
    "LoopAnalysis",
    "LoopResponse",
    "LoopStart",
    "Margins",
    "Missing",
    "MotorFit",
    "MotorLaw",
    "OnLeg",
    "OpenLoop",
    "ParameterLimit",
    "Plant",
    "PositionDesign",
    "PositionMetrics",
    "Prediction",
    "Proposal",
    "ProvisionalGains",
    "Reduction",
    "Remark",
    "Scenario",
    "Spec",
    "Stay",
    "StepMetrics",
    "Style",
    "TrackMetrics",
    "Verdict",
    "analyse_own",
    "analyse_proposal",
    "authority_of",
    "combine",
    "crossings",
    "current_on",
    "design",
    "design_from",
    "design_position",
    "fit_motor_law",
    "follows_better",
    "holding",
    "holds_better",
    "in_fractions",
    "is_better",
    "is_calmer",
    "is_followed",
    "is_foretold",
    "is_more_linear",
    "is_no_worse",
    "limits_for",
    "line_changes",
    "linearity",
    "loiter_change",
    "margins_of_each",
    "motor_changes",
    "over_windows",
    "pivots_wide",
    "position_metrics",
    "provisional",
    "pulse_of",
    "reduce",
    "rudder_trim",
    "scatter_of",
    "shortfall_of",
    "step_metrics",
    "style_number",
    "style_of",
    "throttle_of",
    "too_short",
    "track_metrics",
    "turn_rate_step",
]
