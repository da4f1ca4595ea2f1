"""The pull-out: the rudder goes amidships from a steady turn; a craft that keeps its course stops turning.

From turns to both sides a stable craft comes to the same small rate (its trim and the wind), an unstable one keeps
turning either way; ITTC 7.5-04-02-01.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.axis.record import prepare
from gcs_autotune.identify.result import Doubt
from gcs_autotune.identify.ship.log import ShipLog
from gcs_autotune.identify.ship.readings import Reading
from gcs_autotune.identify.ship.steps import StepReading, read_steps
from gcs_autotune.trial import Trial

__all__ = ["PullOut", "read_pull_out"]

AMIDSHIPS = 0.15
"""Helm that counts as amidships, as a fraction of the one before."""

CLEAR = 3.0
"""Standard errors at which a difference is believed."""

SMALL = 0.02
"""Residual rate, as a fraction of that of the turn, below which the craft has stopped turning."""


@dataclass(frozen=True, slots=True, eq=False)
class PullOut:
    """What was left of the turn after the helm went amidships.

    ``after_starboard``, ``after_port`` [rad/s]: residual yaw rates after a turn to that side, NaN when not flown;
    ``turning`` [rad/s] mean rate of the turns before. ``residual`` half the difference of both sides: what a stable
    craft has none of; ``offset`` their mean: trim and wind.
    """

    run: str
    after_starboard: Reading
    after_port: Reading
    turning: Reading
    residual: Reading
    offset: Reading
    verdict: Literal["stable", "unstable", "undecided"]
    doubts: tuple[Doubt, ...]


def read_pull_out(trial: Trial, log: ShipLog) -> PullOut:
    """Return the pull-outs of a run.

    Raises
    ------
    NotInformative
        The helm never goes amidships from a steady turn, or not for long enough to be read.
    """
    largest = float(np.max(np.abs(log.steering.values)))
    pulls = [
        s
        for s in read_steps(prepare(trial, "yaw"))
        if abs(s.before) > 0.3 * largest and abs(s.tau) < AMIDSHIPS * abs(s.before) and not s.steady_only
    ]
    if not pulls:
        raise NotInformative(f"run '{log.name}' holds no pull-out: the helm never goes amidships from a turn")
    starboard, port = _mean([p for p in pulls if p.nu_0.value > 0.0]), _mean([p for p in pulls if p.nu_0.value < 0.0])
    turning = float(np.mean([abs(p.nu_0.value) for p in pulls]))
    residual = Reading(0.5 * (starboard.value - port.value), 0.5 * math.hypot(starboard.std, port.std), "rad/s")
    offset = Reading(0.5 * (starboard.value + port.value), residual.std, "rad/s")
    doubts = list(log.doubts)
    settled = all(p.settled for p in pulls)
    if not settled:
        doubts.append(
            Doubt("not-settled", "the rate was still falling when the record ended", "wait until the rate is steady")
        )
    verdict: Literal["stable", "unstable", "undecided"] = "undecided"
    if math.isfinite(residual.value):
        small = abs(residual.value) < max(SMALL * turning, CLEAR * residual.std)
        verdict = "stable" if small else "unstable" if settled and residual.value > 0.0 else "undecided"
    else:
        doubts.append(
            Doubt("one-side", "pull-outs from one side only: trim and instability look alike", "pull out to both sides")
        )
    return PullOut(
        log.name, starboard, port, Reading(turning, math.nan, "rad/s"), residual, offset, verdict, tuple(doubts)
    )


def _mean(pulls: list[StepReading]) -> Reading:
    """Return the mean residual rate of pull-outs from one side."""
    if not pulls:
        return Reading(math.nan, math.nan, "rad/s")
    values = np.array([p.k_ss.value for p in pulls])
    noise = math.sqrt(sum(p.k_ss.std**2 for p in pulls)) / len(pulls)
    scatter = float(values.std(ddof=1)) / math.sqrt(len(values)) if len(values) > 1 else 0.0
    return Reading(float(values.mean()), max(noise, scatter), "rad/s")
