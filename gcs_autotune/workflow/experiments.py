"""Select the manoeuvres for tuning an axis, and evaluate the step from the record."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.axes import AXES, OWN_AXES, SIGNAL_FORCES, excitation_of
from gcs_autotune.craft import Observation
from gcs_autotune.design import StepMetrics, combine, step_metrics, throttle_of
from gcs_autotune.firmware import Axis, Firmware
from gcs_autotune.link import MavlinkCraft
from gcs_autotune.manoeuvres import (
    LEVELS,
    Dive,
    DiveSettings,
    Relay,
    RelaySettings,
    StopCriterion,
    ThrottleSteps,
    ThrottleStepsSettings,
    WallRelay,
    are_read,
    windows_of,
)
from gcs_autotune.sensor import noise_of, quantum
from gcs_autotune.trial import Trial
from gcs_autotune.workflow.settings import TuneSettings

Array = NDArray[np.float64]

CALMED: Mapping[str, float] = {a.stepped: a.calmed for a in AXES.values() if a.calmed}
"""Signal -> length [s] of the centred moving average through which its step is measured, because it is noisy."""

__all__ = [
    "SHALLOW",
    "STEP_AHEAD",
    "SWING_AHEAD",
    "WORKING_DEPTH",
    "Relays",
    "dive_for",
    "dive_words",
    "measure",
    "measure_halves",
    "noise_as_read",
    "noise_in",
    "resolution",
    "second_output",
    "speed_for",
    "steering_throttle",
    "throttle_steps_for",
]


def speed_for(settings: TuneSettings, axis: Axis, present: Mapping[str, float]) -> tuple[float, float]:
    """Return (throttle [fraction of full], speed [m/s]) for the tune: the user's values, otherwise the vehicle's own
    cruise.
    """
    if not axis.needs_speed:
        return settings.throttle or 0.0, settings.speed or 0.0
    throttle = settings.throttle
    if throttle is None:
        throttle = present.get("CRUISE_THROTTLE", 50.0) / 100.0
    speed = settings.speed if settings.speed is not None else present.get("CRUISE_SPEED", 1.0)
    return throttle, speed


def steering_throttle(step: Trial, present: Mapping[str, float], throttle: float) -> float:
    """Return the throttle [fraction] at which to identify the steering of a boat that flew *step* in an automatic
    mode.

    A steerable thruster steers by its thrust, and the autopilot compensates for the throttle that it uses. So the
    throttle is read from the step, whatever *throttle* the cruise parameters state. A rudder is identified at
    *throttle*.
    """
    begun = next((mark.t for mark in step.marks if mark.kind == "target"), math.inf)
    if not present.get("MOT_VEC_ANGLEMAX", 0.0) > 0.0 or "X" not in step.channels:
        return throttle
    driven = step["X"].values[step["X"].t >= begun]
    if not len(driven):
        return throttle
    return min(max(throttle_of(float(np.median(driven)), present), LEAST_THROTTLE), MOST_THROTTLE)


LEAST_THROTTLE, MOST_THROTTLE = 0.1, 0.9
"""Limits of the throttle [fraction of full] at which a boat is identified.

Between them the boat has headway and the autopilot can still compensate for steered thrust. Project choice.
"""


def throttle_steps_for(throttle: float, number: int, name: str, *, short: bool = False) -> ThrottleSteps:
    """Return the *number*-th (from 0) surge experiment of a boat about *throttle* [fraction].

    short : each throttle level ends once the boat has responded to it.
    """
    levels = LEVELS[number % len(LEVELS)]
    return ThrottleSteps(ThrottleStepsSettings(throttle, levels, until_answered=short), name)


@dataclass(frozen=True, slots=True)
class Relays:
    """The relay experiments on one degree of freedom of a vehicle.

    Attributes
    ----------
    throttle : fraction of full thrust ahead. A boat's surge oscillates about its cruise, an ROV's about rest.
    keep_still : whether the vehicle's other axes are controlled during the relay.
    least_period : shortest oscillation period [s] for which the link is fast enough.
    """

    settings: TuneSettings
    dof: str
    throttle: float
    keep_still: bool
    least_period: float = 0.0

    @classmethod
    def of(cls, settings: TuneSettings, dof: str, craft: MavlinkCraft, throttle: float) -> Relays:
        """Return the relay experiments for *craft*."""
        return cls(settings, dof, throttle, not craft.firmware.needs_way, craft.least_period)

    @property
    def motion(self) -> str:
        """Degree of freedom, if it is not the one that the run is about; else empty."""
        return self.dof if self.settings.axis in OWN_AXES else ""

    @property
    def against_wall(self) -> bool:
        """Whether they oscillate about the distance to a wall.

        One such relay is flown. A VideoRay with rangefinders of 2 Hz does not settle at twice its output, and takes
        more than ten minutes at half of it.
        """
        return self.settings.axis == "distance"

    def second_output(self, first: Trial) -> float:
        """Return the output of the second relay."""
        return second_output(first, 0.9 - abs(self.throttle) if excitation_of(self.dof).by_throttle else 0.9)

    def name(self, number: int) -> str:
        """Return the name of the *number*-th relay (from 1)."""
        return f"relay-{self.motion}-{number}" if self.motion else f"relay-{number}"

    def stage(self, which: str) -> str:
        """Return the stage of the relay *which* (``first``)."""
        return f"{which} {self.motion} self-oscillation" if self.motion else f"{which} self-oscillation"

    def relay(
        self,
        number: int,
        output: float | None,
        *,
        noise_std: float | None = None,
        criterion: StopCriterion | None = None,
    ) -> Relay:
        """Return the *number*-th relay (from 1) with amplitude *output*; if it is None, the relay determines a suitable
        amplitude itself.

        noise_std : noise [rad or m] of a vehicle that needs no approach. criterion : the rule that may end it before
            its periods agree.
        """
        make = WallRelay if self.against_wall else Relay
        return make(self.relay_settings(output, noise_std), self.name(number), criterion)

    def relay_settings(self, output: float | None, noise_std: float | None = None) -> RelaySettings:
        """Return the settings of a relay; arguments as for :meth:`relay`."""
        d, throttle = excitation_of(self.dof), self.throttle
        along, wall = d.by_throttle, self.against_wall
        return RelaySettings(
            signal="d" if wall else d.signal,
            force=d.names.force,
            output=output,
            hysteresis=WALL_HYSTERESIS if wall else self.settings.relay_hysteresis,
            least_distance=LEAST_DISTANCE if wall else 0.0,
            throttle=throttle,
            reference_speed=(self.settings.speed or 0.0) if along else 0.0,
            most_output=0.9 - abs(throttle) if along else 0.9,
            first_output=min(0.3, 0.9 - abs(throttle)) if along else 0.3,
            keep_still=self.keep_still,
            least_hysteresis=d.least_hysteresis,
            least_period=self.least_period,
            noise_std=noise_std,
        )


WALL_HYSTERESIS = 0.1
"""Hysteresis of a relay on the distance to a wall [m]: Miskovic2010, section 7.6."""
LEAST_DISTANCE = 0.3
"""Smallest distance to the wall during that relay [m]. Project choice."""


def second_output(first: Trial, room: float = 0.9) -> float:
    """Return the relay output of the second experiment: as different as *room* allows (Miskovic2010, 7.1).

    It is smaller than that of the *first* if no larger output is available. It is also smaller if a larger one would
    oscillate too fast for the relay's control ticks.
    """
    C = float(first.meta["C"])
    return min(2.0 * C, room) if C <= room / 1.5 and not _is_hasty(first) else 0.5 * C


def _is_hasty(relay: Trial) -> bool:
    """Return whether half a period of *relay* is shorter than ten of its control ticks."""
    switches = [m.t for m in relay.marks if m.kind == "switch"]
    ticks = np.diff(relay["psi"].t)
    if len(switches) < 3 or not len(ticks):
        return False
    return bool(np.median(np.diff(switches)) < 10.0 * np.median(ticks))


STEP_AHEAD, SWING_AHEAD = 60.0, 30.0
"""Longest time straight ahead [s]: of the step that proves gains, and of an experiment that oscillates or is short.
Project choice.
"""
WORKING_DEPTH, SHALLOW = 1.5, 1.0
"""Depth [m] at which the depth loop is tuned if the craft is shallower than the second number [m]. Project choice."""


def dive_for(dof: str, firmware: Firmware, now: Observation) -> Dive | None:
    """Return the dive that takes an ROV away from the surface before a depth relay. None if the ROV is deep enough."""
    if firmware.floats or not excitation_of(dof).below_surface or not now.z < SHALLOW:
        return None
    return Dive(DiveSettings(WORKING_DEPTH, enough=SHALLOW))


def dive_words(dof: str, firmware: Firmware, now: Observation) -> tuple[str, str]:
    """Return what an announcement states on dives, in a sentence and briefly; both empty if *dof* needs none.

    A buoyant ROV may rise during the run, and then dives although it is deep enough now.
    """
    if firmware.floats or not excitation_of(dof).below_surface:
        return "", ""
    down, is_sure = f"dive to {WORKING_DEPTH:g} m", dive_for(dof, firmware, now) is not None
    return (
        (f"{down}, then ", f"{down}, ")
        if is_sure
        else (
            f"dive to {WORKING_DEPTH:g} m whenever it is shallower than {SHALLOW:g} m, then ",
            f"{down} if shallow, ",
        )
    )


def resolution(trial: Trial) -> float:
    """Return the resolution [rad or m] of the sensor that recorded a step trial; 0 if it is negligible."""
    return quantum(trial[str(trial.meta["signal"])].values)


def noise_in(trial: Trial, signal: str) -> float:
    """Return the standard deviation of a signal's noise, from second differences, which suppress slow motion."""
    return noise_of(trial[signal].values)


def noise_as_read(step: Trial, noise_std: float) -> float:
    """Return the standard deviation of the noise in the motion that is measured, for *noise_std* of the stepped signal.

    A prediction must ignore errors up to the same size as the measurement, and a moving average has less noise.
    """
    signal = str(step.meta["signal"])
    return noise_std / math.sqrt(_averaged(step[signal].t, signal))


def _averaged(t: Array, signal: str) -> int:
    """Return the number of samples in the moving average of :data:`CALMED`; 1 without one."""
    if signal not in CALMED or len(t) <= 2:
        return 1
    half = max(round(0.5 * CALMED[signal] / float(np.median(np.diff(t)))), 1)
    return min(2 * half + 1, len(t))


def _calmed(x: Array, width: int) -> Array:
    """Return the moving average of *x* (n,) over *width* samples, centred except at the ends."""
    low = np.clip(np.arange(len(x)) - width // 2, 0, len(x) - width)
    total = np.concatenate([[0.0], np.cumsum(x)])
    mean: Array = (total[low + width] - total[low]) / width
    return mean


def measure(
    trial: Trial, noise_std: float = 0.0, resolution: float = 0.0, windows: Sequence[float] = ()
) -> StepMetrics:
    """Return the metrics of a step trial: the mean of the step out and the step back, and the worse of their limits.
    Arguments as for :func:`measure_halves`. If the loop diverged before the target moved, nothing can be measured and
    all numbers are NaN.
    """
    return combine(measure_halves(trial, noise_std, resolution, windows))


def measure_halves(
    trial: Trial, noise_std: float = 0.0, resolution: float = 0.0, windows: Sequence[float] = ()
) -> list[StepMetrics]:
    """Return the metrics of the step out and of the step back of a step trial, as far as they were flown. Each half is
    evaluated over its first ``windows`` [s], or over its record if that is shorter. A half that is too short is left
    out (:func:`gcs_autotune.manoeuvres.are_read`).

    A step that was stopped because the loop diverged counts as if its last error had lasted to the end. *noise_std* and
    the sensor's *resolution* [rad or m] as :func:`gcs_autotune.design.step_metrics`: a compass with a resolution of two
    degrees cannot show an error of one degree.
    """
    signal, late = str(trial.meta["signal"]), _seen_late(trial)
    targets = [m for m in trial.marks if m.kind == "target"]
    own, found = windows_of(trial), []
    read = (*map(min, own, windows), *own[len(windows) :])
    for (before, after), window, is_read in zip(itertools.pairwise(targets), read, are_read(read), strict=True):
        if not is_read:
            continue
        values = float(before.detail["value"]), float(after.detail["value"])
        asked = _Step(*values, after.t + late, window)
        found.append(_one_step(trial, signal, asked, noise_std, resolution))
    return found


def _seen_late(trial: Trial) -> float:
    """Return the smallest delay [s] with which a response to a command can appear in the record, as far as measured.

    The delay of the link is not part of the loop. A mark has the time stamp of the attitude message that its command
    answers. So the delay is that of the round trip, not only of the command. Turn rates are recorded at the time they
    apply to, so the delay of the gyro filter does not appear here.
    """
    link = trial.meta.get("link_times", {})
    return float(link.get("loop", link.get("command_to_servo", 0.0)))


@dataclass(frozen=True, slots=True)
class _Step:
    """One step of a target, from ``before`` to ``after`` (SI) at ``start`` [s], evaluated over its first ``window``
    [s]."""

    before: float
    after: float
    start: float
    window: float


def _one_step(trial: Trial, signal: str, asked: _Step, noise_std: float, quantum: float) -> StepMetrics:
    start, end = asked.start, asked.start + asked.window
    position = trial[signal].between(start - 1.0, end)
    t, x = position.t, position.values
    width = _averaged(t, signal)
    if width > 1:
        x, noise_std = _calmed(x, width), noise_std / math.sqrt(width)
    first = int(np.searchsorted(t, start))  # the clock of a step starts with it, not with the next sample
    t, x = np.insert(t, first, start), np.insert(x, first, np.interp(start, t, x))
    if t[-1] < end - 1.0:
        t, x = np.append(t, np.linspace(t[-1] + 0.1, end, 10)), np.append(x, np.full(10, x[-1]))
    output = np.array([trial[SIGNAL_FORCES[signal]].held_at(moment) for moment in t])
    return step_metrics(
        t - start,
        np.where(t < start, asked.before, asked.after),
        x,
        output,
        noise_std=noise_std,
        quantum=quantum,
        noise_time=CALMED.get(signal, 0.0),
    )
