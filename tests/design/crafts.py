"""The craft and parameter sets the design is tried on; inputs in fractions of full output."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.design import Spec
from gcs_autotune.firmware import FIRMWARE, Axis
from gcs_autotune.models import SingleDof

ROVER_HEADING = FIRMWARE["ardurover"].axes["heading"]
SUB_HEADING = FIRMWARE["ardusub"].axes["heading"]
SUB_DEPTH = FIRMWARE["ardusub"].axes["depth"]

ROVER_DEFAULTS = {
    "ATC_STR_RAT_FF": 0.2,
    "ATC_STR_RAT_P": 0.2,
    "ATC_STR_RAT_I": 0.2,
    "ATC_STR_RAT_D": 0.0,
    "ATC_STR_ANG_P": 2.0,
}
SUB_HEADING_DEFAULTS = {
    "ATC_RAT_YAW_P": 0.18,
    "ATC_RAT_YAW_I": 0.018,
    "ATC_RAT_YAW_D": 0.0,
    "ATC_ANG_YAW_P": 6.0,
}
SUB_DEPTH_DEFAULTS = {
    "PSC_POSZ_P": 3.0,
    "PSC_VELZ_P": 8.0,
    "PSC_VELZ_I": 0.0,
    "PSC_ACCZ_P": 0.5,
    "PSC_ACCZ_I": 0.1,
    "PSC_ACCZ_FF": 0.0,
}
ROVER_SPEED_DEFAULTS = {
    "ATC_SPEED_P": 0.2,
    "ATC_SPEED_I": 0.2,
    "ATC_SPEED_D": 0.0,
    "ATC_SPEED_FF": 0.0,
    "CRUISE_SPEED": 2.0,
    "CRUISE_THROTTLE": 50.0,
}
SUB_ROLL_DEFAULTS, SUB_PITCH_DEFAULTS = (
    {gain.parameter: gain.default for gain in FIRMWARE["ardusub"].axes[name].gains} for name in ("roll", "pitch")
)
DEFAULTS: Mapping[str, Mapping[str, float]] = {
    "rover-heading": ROVER_DEFAULTS,
    "rover-yaw": ROVER_DEFAULTS,
    "rover-speed": ROVER_SPEED_DEFAULTS,
    "sub-heading": SUB_HEADING_DEFAULTS,
    "sub-yaw": SUB_HEADING_DEFAULTS,
    "sub-depth": SUB_DEPTH_DEFAULTS,
    "sub-roll": SUB_ROLL_DEFAULTS,
    "sub-pitch": SUB_PITCH_DEFAULTS,
}

DEG = math.pi / 180.0


def yaw(alpha: float, beta: float, beta_rr: float = 0.0, delta: float = 0.0, delay: float = 0.0) -> SingleDof:
    return SingleDof("yaw", "1", alpha, beta, beta_rr, delta, delay)


def heave(alpha: float, beta: float, beta_ww: float = 0.0, delta: float = 0.0, delay: float = 0.0) -> SingleDof:
    return SingleDof("heave", "1", alpha, beta, beta_ww, delta, delay)


def surge(alpha: float, beta: float, beta_uu: float = 0.0, delta: float = 0.0, delay: float = 0.0) -> SingleDof:
    return SingleDof("surge", "1", alpha, beta, beta_uu, delta, delay)


def boat(time_constant: float, gain: float, delta: float = 0.01, delay: float = 0.05) -> SingleDof:
    return yaw(time_constant / gain, 1.0 / gain, 0.0, delta, delay)


CHARLIE = boat(3.1, 0.22, delta=0.0, delay=0.0)
VIDEORAY_HEAVE = heave(0.824, 0.0, 1.496, -0.05)

CRAFTS: Mapping[str, tuple[SingleDof, Axis, Spec]] = {
    "charlie": (CHARLIE, ROVER_HEADING, Spec(speed=1.1, noise_std=0.25 * DEG)),
    "slow boat": (boat(2.0, 0.35, 0.015, 0.0), ROVER_HEADING, Spec(speed=1.2, noise_std=0.25 * DEG)),
    "charlie trimmed off": (boat(3.1, 0.22, 0.05, 0.1), ROVER_HEADING, Spec(speed=1.1, noise_std=0.25 * DEG)),
    "charlie slow": (boat(3.1, 0.22, 0.02, 0.0), ROVER_HEADING, Spec(speed=0.9, noise_std=0.25 * DEG)),
    "blueboat": (boat(0.574, 0.669, 0.0085, 0.0), ROVER_HEADING, Spec(speed=1.5, skid=True, noise_std=0.25 * DEG)),
    "boat 0.5 s": (boat(0.5, 1.0), ROVER_HEADING, Spec(speed=3.0)),
    "boat 2 s": (boat(2.0, 0.3), ROVER_HEADING, Spec(speed=3.0)),
    "boat 8 s": (boat(8.0, 0.3), ROVER_HEADING, Spec(speed=3.0)),
    "videoray yaw": (yaw(0.0307 / 0.171, 0.0, 0.0697 / 0.171), SUB_HEADING, Spec(noise_std=1.0 * DEG)),
    "videoray yaw late": (yaw(0.0307 / 0.171, 0.0, 0.0697 / 0.171, 0.0, 0.2), SUB_HEADING, Spec()),
    "automarine": (yaw(0.0407 / 0.0646, 0.0, 0.074 / 0.0646), SUB_HEADING, Spec(noise_std=0.5 * DEG)),
    "falcon yaw": (yaw(0.2, 0.75, 0.025), SUB_HEADING, Spec()),
    "bluerov yaw": (yaw(0.1, 0.02, 0.3, 0.0, 0.03), SUB_HEADING, Spec()),
    "falcon heave": (heave(130 / 300, 200 / 300, 20 / 300, 10 / 300), SUB_DEPTH, Spec()),
    "videoray heave": (VIDEORAY_HEAVE, SUB_DEPTH, Spec(noise_std=0.005)),
    "bluerov heave": (heave(0.25, 0.1, 0.8, 0.0, 0.05), SUB_DEPTH, Spec()),
}
"""Name -> (model, axis, spec). FALCON, VideoRay, AutoMarine, Charlie: Miskovic2010, tables 7.1, 7.3, 7.9, 7.11, 7.12
over
their full output; the others are like craft people own."""


def uncertain(model: SingleDof, relative: float = 0.05) -> NDArray[np.float64]:
    """A covariance (5, 5) with *relative* standard errors, 0.01 in delta, 10 ms in a delay that is there."""
    numbers = [model.alpha, model.beta, model.beta_quadratic]
    std = [*(relative * n for n in numbers), 0.01, 0.01 if model.delay else 0.0]
    return np.diag(np.square(std))


def present(axis: Axis) -> dict[str, float]:
    return dict(DEFAULTS[axis.law])
