"""Manoeuvres that excite a craft's dynamics, and the sequencer that flies them safely.

A manoeuvre (:mod:`~gcs_autotune.manoeuvres.manoeuvre`) is only a generator of commands that receives observations.
:class:`Sequencer` flies it inside an :class:`Envelope`, and cleans up on every ending.

``sign-check`` comes first and verifies that an actuator acts in the right direction. ``relay`` identifies one degree of
freedom in a few oscillations. ``zig-zag``, ``turning-circle``, ``pull-out``, the spirals and ``stopping`` determine the
standard manoeuvring figures of ships. ``steps`` to ``free-decay`` apply to any force. ``throttle-steps`` identifies a
boat's surge. ``step`` proves a closed loop. ``turn-around`` turns a boat around between two manoeuvres. ``dive`` takes
an ROV away from the surface. The table :data:`MANOEUVRES` contains all of them.
"""

from __future__ import annotations

from gcs_autotune.manoeuvres.aboard import ABOARD_ENDINGS, MOST_CORNERS, AboardEnding, AboardScript, headroom
from gcs_autotune.manoeuvres.aboard import PLAN as ABOARD_PLAN
from gcs_autotune.manoeuvres.approach import Steering
from gcs_autotune.manoeuvres.area import Area, Zone, how_far, read_area
from gcs_autotune.manoeuvres.between_runs import CalmCheck, ComeBack, ComeToRest
from gcs_autotune.manoeuvres.dive import Dive, DiveSettings
from gcs_autotune.manoeuvres.envelope import FAR_OUT, GUARDS, NEARLY, STOPPING, TO_COME_ABOUT, Envelope, Guard, far_out
from gcs_autotune.manoeuvres.fly_mission import FlyMission, ProofCourse
from gcs_autotune.manoeuvres.follow_line import FollowLine, state_on
from gcs_autotune.manoeuvres.hold_controller import HELD_DURING
from gcs_autotune.manoeuvres.keep_distance import FaceWall, KeepDistance
from gcs_autotune.manoeuvres.keep_position import KeepPosition
from gcs_autotune.manoeuvres.kind import ManoeuvreKind, Preset
from gcs_autotune.manoeuvres.layered import FollowWall, Layered, OwnLoops, Trajectory, read_points, seen_from
from gcs_autotune.manoeuvres.manoeuvre import Commands, Ending, Manoeuvre, Outcome, limited_orders
from gcs_autotune.manoeuvres.open_loop import DOF_OF, OpenLoopProgramme
from gcs_autotune.manoeuvres.own_loop import KeepSetPoint, UnderOwnLoop
from gcs_autotune.manoeuvres.preview import DEEP, SPEED_TIME, NominalPlant, PlantState, Preview, fly_on, preview
from gcs_autotune.manoeuvres.relay import LEAST_REVERSALS, Relay, StopCriterion, WallRelay
from gcs_autotune.manoeuvres.relay_settings import RelaySettings
from gcs_autotune.manoeuvres.sequencer import DISARMED_ITSELF, Sequencer, restore_on_exit
from gcs_autotune.manoeuvres.sign_check import SignCheck, SignCheckSettings
from gcs_autotune.manoeuvres.sign_messages import Outlet
from gcs_autotune.manoeuvres.step import (
    MOST_DURATION,
    SHARE_OF_TOP,
    Step,
    StepSettings,
    are_read,
    common_windows,
    speed_step,
    step_from_present,
    windows_of,
)
from gcs_autotune.manoeuvres.step_position import PushPosition, StepPosition
from gcs_autotune.manoeuvres.table import MANOEUVRES
from gcs_autotune.manoeuvres.throttle_steps import BOTH_WAYS, LEVELS, ThrottleSteps, ThrottleStepsSettings
from gcs_autotune.manoeuvres.thrust_check import ThrustCheck, ThrustCheckSettings
from gcs_autotune.manoeuvres.turn_around import TurnAround, TurnAroundSettings
from gcs_autotune.manoeuvres.zig_zag import ZigZag, ZigZagSettings

__all__ = [
    "ABOARD_ENDINGS",
    "ABOARD_PLAN",
    "BOTH_WAYS",
    "DEEP",
    "DISARMED_ITSELF",
    "DOF_OF",
    "FAR_OUT",
    "GUARDS",
    "HELD_DURING",
    "LEAST_REVERSALS",
    "LEVELS",
    "MANOEUVRES",
    "MOST_CORNERS",
    "MOST_DURATION",
    "NEARLY",
    "SHARE_OF_TOP",
    "SPEED_TIME",
    "STOPPING",
    "TO_COME_ABOUT",
    "AboardEnding",
    "AboardScript",
    "Area",
    "CalmCheck",
    "ComeBack",
    "ComeToRest",
    "Commands",
    "Dive",
    "DiveSettings",
    "Ending",
    "Envelope",
    "FaceWall",
    "FlyMission",
    "FollowLine",
    "FollowWall",
    "Guard",
    "KeepDistance",
    "KeepPosition",
    "KeepSetPoint",
    "Layered",
    "Manoeuvre",
    "ManoeuvreKind",
    "NominalPlant",
    "OpenLoopProgramme",
    "Outcome",
    "Outlet",
    "OwnLoops",
    "PlantState",
    "Preset",
    "Preview",
    "ProofCourse",
    "PushPosition",
    "Relay",
    "RelaySettings",
    "Sequencer",
    "SignCheck",
    "SignCheckSettings",
    "Steering",
    "Step",
    "StepPosition",
    "StepSettings",
    "StopCriterion",
    "ThrottleSteps",
    "ThrottleStepsSettings",
    "ThrustCheck",
    "ThrustCheckSettings",
    "Trajectory",
    "TurnAround",
    "TurnAroundSettings",
    "UnderOwnLoop",
    "WallRelay",
    "ZigZag",
    "ZigZagSettings",
    "Zone",
    "are_read",
    "common_windows",
    "far_out",
    "fly_on",
    "headroom",
    "how_far",
    "limited_orders",
    "preview",
    "read_area",
    "read_points",
    "restore_on_exit",
    "seen_from",
    "speed_step",
    "state_on",
    "step_from_present",
    "windows_of",
]
