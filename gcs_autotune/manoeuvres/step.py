"""Step in heading, depth, speed or turn rate under the autopilot's own loop: the before/after proof.

The craft holds its value until it is steady, follows a step, and then the step back. Both directions are flown because
thrusters, rudders and buoyancy are not symmetric. Each half ends early once the signal has been at its target for long
enough. The duration of each half is stored, because two proofs can be compared only over the time that both recorded.

The waits before the step and at its target let the controller's integral settle. Its changes appear in the signal or in
the output. So a wait ends early if neither signal nor output would change noticeably in the remaining time.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.axes import AXES, SIGNAL_FORCES, AxisKind
from gcs_autotune.craft import Command, Observation, set_point
from gcs_autotune.manoeuvres.kind import ManoeuvreKind, of_loop
from gcs_autotune.manoeuvres.manoeuvre import Commands, Manoeuvre, Outcome
from gcs_autotune.settling import LOOK, TRIFLE, is_at_rest
from gcs_autotune.sname import DOFS
from gcs_autotune.trial import Trial

Array = NDArray[np.float64]

__all__ = [
    "KIND",
    "MOST_DURATION",
    "SHARE_OF_TOP",
    "Step",
    "StepSettings",
    "are_read",
    "common_windows",
    "speed_step",
    "step_from_present",
    "windows_of",
]

SHORTEST_HALF = 1.0
"""Shortest record [s] of a half that is evaluated. Project choice."""

SETTLED_BAND, SETTLED_NOISES = 0.03, 3.0
"""Distance from the target within which a signal counts as settled: fraction of the step, and standard deviations of
its noise. Project choice."""
ONE_QUANTUM = 1.01
"""Tolerance about the target, in steps of the sensor's resolution. Project choice."""
LEAST_CROSSINGS, LEAST_OSCILLATING = 4, 8.0
"""Number of mean crossings that counts as oscillation, and the hold [s] over whose last two thirds they are counted.

Waves or the loop cause such an oscillation. A longer hold adds no information. Project choice.
"""
MAX_OSCILLATION = 0.5
"""Largest oscillation about the target, relative to the step, that counts as settled.

A step with a larger oscillation is recorded for the full requested time. Project choice.
"""
LEAST_HALF = 4.0
"""Shortest half step that can be compared [s].

A boat has more than twice this time before its space ends. Project choice.
"""
LEAST_SAMPLES = 5
"""Smallest number of second differences from which the noise is computed. Project choice."""
HOLD = 10.0
"""Hold [s] before the step of a craft that can keep its position, for the integral to settle. Project choice."""
ENOUGH, ENOUGH_AT_REST = 5.0, 6.0
"""Time on target [s] that ends a half step, under way and at rest. Project choice.

A slow drift due to a dead band of the thrusters lasts longer than this.
"""
LEAST = 3.0
"""Shortest wait [s] on target, and before a step, even if craft and output are at rest. Project choice."""
SPEED_BAND = 0.2
"""Deviation from the held speed that counts as steady before the step, as a fraction of that speed.

It is large because speed signals are noisy.
"""
SHARE_OF_TOP = 0.4
"""Size of the speed step as a fraction of the working speed: from 60 % of it to 100 %. Project choice."""
MOST_DURATION = 25.0
"""Longest duration of a speed step [s]. Project choice."""


@dataclass(frozen=True, slots=True)
class StepSettings:
    """Settings of a step in SI units; times in s.

    ``signal``: one of :data:`gcs_autotune.axes.SIGNAL_FORCES`.
    ``size``: size of the step, in the signal's unit.
    ``base``: initial value; None: the present value, which a craft at rest can hold.
    ``speed`` [m/s]: speed ahead, unused for ``u``.
    ``settle``: longest wait until the signal is steady, i.e. within ``steady_band`` of the held value for
    ``steady_time``.
    ``hold``: shortest wait, steady or not, since the integral's state affects the step.
    ``diverged``: error beyond the step itself, as a multiple of the step, above which the loop counts as diverged and
    the manoeuvre stops.
    ``duration``: longest duration of each half.
    ``enough``: time at the target after which a half ends early.
    ``least_hold``, ``least_enough``: shortest ``hold`` and ``enough``, if signal and output are at rest.
    """

    signal: str
    size: float
    duration: float
    speed: float = 0.0
    base: float | None = None
    settle: float = 20.0
    steady_time: float = 3.0
    steady_band: float = 0.07
    hold: float = 0.0
    diverged: float = 2.5
    enough: float = math.inf
    least_hold: float = math.inf
    least_enough: float = math.inf


def step_from_present(
    signal: str, size: float, duration: float, speed: float, *, under_way: bool, ends_early: bool = True
) -> StepSettings:
    """Return the step of *size* [SI, rad] of a heading or depth from its present value, flown at *speed* [m/s].

    under_way : whether the craft keeps moving ahead. ends_early : whether a wait or a half may end early; not with the
    stop rule of Miskovic2010.
    """
    enough = ENOUGH if under_way else ENOUGH_AT_REST
    return StepSettings(
        signal=signal,
        size=size,
        duration=duration,
        speed=speed,
        hold=0.0 if under_way else HOLD,
        enough=enough if ends_early else math.inf,
        least_hold=LEAST if ends_early else math.inf,
        least_enough=LEAST if ends_early else math.inf,
    )


def speed_step(top: float, size: float, duration: float, *, ends_early: bool = True) -> StepSettings:
    """Return the step of *size* [m/s] up to the speed *top* [m/s]; *ends_early* as :func:`step_from_present`."""
    enough, least = (ENOUGH, LEAST) if ends_early else (math.inf, math.inf)
    return StepSettings("u", size, duration, base=top - size, steady_band=SPEED_BAND, enough=enough, least_enough=least)


class Rest:
    """Detects whether signal and output are at rest. They are not at rest if either is NaN."""

    def __init__(self) -> None:
        self._seen: deque[tuple[float, float, float]] = deque()

    def begin(self) -> None:
        """Discard the samples so far."""
        self._seen.clear()

    def update(self, t: float, x: float, output: float) -> None:
        """Add one sample: time [s], signal [SI] and output [fraction of full]."""
        self._seen.append((t, x, output))
        while self._seen[0][0] < t - LOOK:
            self._seen.popleft()

    def lasts(self, seconds: float, size: float) -> bool:
        """Return whether no change within the next *seconds* would be noticeable relative to a step of *size* or full
        output."""
        seen = np.array(self._seen)
        if len(seen) < 2 * LEAST_SAMPLES or seen[-1, 0] - seen[0, 0] < 0.9 * LOOK:
            return False
        t, x, output = seen.T
        return all(
            is_at_rest(t, y, seconds, trifle, _noise_in(y)) for y, trifle in ((x, TRIFLE * size), (output, TRIFLE))
        )


def _noise_in(x: Array) -> float:
    """Return the standard deviation of the noise of *x* (n,), from second differences; 0 with too few."""
    second = np.diff(x, n=2)
    return math.sqrt(float(np.mean(second**2)) / 6.0) if len(second) >= LEAST_SAMPLES else 0.0


def _later(held: Array) -> Array:
    """Return the later two thirds of *held* (n,), after earlier motion has decayed."""
    return held[len(held) // 3 :]


def _oscillation_in(x: Array) -> float:
    """Return the standard deviation of *x* (n,) about its mean if it crosses the mean often enough; else 0."""
    off = x - x.mean()
    std = float(off.std())
    plain = np.sign(off[np.abs(off) > 0.5 * std])  # noise about the mean does not count as a crossing
    return std if np.count_nonzero(np.diff(plain)) >= LEAST_CROSSINGS else 0.0


class Step(Manoeuvre):
    """Fly a step: hold, step, step back. The manoeuvre marks ``target`` at each change of the reference."""

    kind, purpose, in_manual = "step", "proof", False

    def __init__(self, settings: StepSettings, name: str = "step") -> None:
        super().__init__(name, signal=settings.signal, force=SIGNAL_FORCES[settings.signal])
        from gcs_autotune.sensor import quantum  # takes a second to import, too long in flight

        self._settings = settings
        self.drifts = next((d.position for d in DOFS.values() if d.velocity == settings.signal), "")
        self._quantum = quantum
        self._step = 0
        self._step_start = math.nan
        self._steady_since = math.nan
        self._base = math.nan
        self._course = math.nan
        self._held: list[float] = []
        self._rest = Rest()
        self._latest: deque[float] = deque(maxlen=3)
        self._there_since = math.inf
        self._band = math.nan
        self._lasted: list[float] = []
        self._now = math.nan

    @property
    def meta_fields(self) -> Mapping[str, Any]:
        """Settings of the step, and duration [s] of each half (``lasted``), by name, for the trial's ``meta``."""
        s = self._settings
        return {
            "dof": next(d.name for d in DOFS.values() if d.force == SIGNAL_FORCES[s.signal]),
            "signal": s.signal,
            "size": s.size,
            "duration": s.duration,
            "speed": s.speed,
            "settle": s.settle,
            "steady_time": s.steady_time,
            "steady_band": s.steady_band,
            "hold": s.hold,
            **({} if s.base is None else {"base": s.base}),
            **{n: v for n in ("enough", "least_hold", "least_enough") if math.isfinite(v := getattr(s, n))},
            **({"band": self._band} if math.isfinite(self._band) else {}),
            "lasted": list(self._lasted),
        }

    def commands(self, now: Observation) -> Commands:
        """Yield the reference commands: the initial value, the step, the step back."""
        base = self._settings.base
        self._base = now.value(self._settings.signal) if base is None else base
        self._course = now.psi
        self._steady_since = now.t
        self._enter(0, now.t, self._base)
        while True:
            now = yield self._tick(now)

    def _tick(self, observation: Observation) -> Command:
        s, self._now = self._settings, observation.t
        elapsed = observation.t - self._step_start
        error = observation.value(s.signal) - self.target
        self._rest.update(observation.t, error, observation.output.get(SIGNAL_FORCES[s.signal], math.nan))
        held = self._step > 0 or s.base is None
        if not math.isfinite(error):
            self._step = 3
            self._end("aborted", f"the vehicle does not report {s.signal}, the stepped signal. Check its sensor")
        elif held and abs(error) > (1.0 + s.diverged) * abs(s.size):
            self._step = 3
            self._end("stopped", "the loop departs from its target: it is unstable, or a disturbance is stronger")
        elif self._step == 0:
            self._held.append(error)
            self._wait_for_steadiness(observation, error, elapsed)
        elif elapsed >= s.duration or self._stands_there(observation.t, error):
            self._lasted.append(min(elapsed, s.duration))
            self._next(observation.t)
        return self._command()

    def where_room_ends(self, where: str) -> Outcome | None:
        """End the present half early if it is long enough to be compared. Return the outcome "stopped" after the second
        half, else None.
        """
        elapsed = self._now - self._step_start
        if self._step not in (1, 2) or not elapsed >= LEAST_HALF:
            return None
        self._lasted.append(elapsed)
        if self._step == 1:
            self._next(self._now)
            return None
        there, back = self._lasted
        return Outcome(
            "stopped",
            f"out of space {there:.0f} s into the step and {back:.0f} s into the step back: {where}. "
            "The record so far is used",
        )

    def where_drift_ends(self, where: str, side: float) -> Outcome | None:
        """End the hold or the half that drifts to *side*. Return the outcome "stopped" after the second half, else
        None.
        """
        if side * self.target <= 0.0:  # on its way back
            return None
        if self._step in (1, 2):
            self._lasted.append(self._now - self._step_start)
        if self._step < 2:
            self._next(self._now)
            return None
        return Outcome(
            "stopped", f"the step back ended after {self._lasted[-1]:.1f} s: {where}. The record so far is used"
        )

    def _stands_there(self, t: float, error: float) -> bool:
        """Return whether the signal has been at its target for long enough, ignoring single outliers."""
        self._latest.append(error)
        if abs(float(np.median(self._latest))) > self._band:
            self._there_since = math.inf
        else:
            self._there_since = min(self._there_since, t)
        s = self._settings
        return self._is_over(t - self._there_since, s.enough, s.least_enough)

    def _is_over(self, waited: float, enough: float, least: float) -> bool:
        """Return whether *waited* [s] is *enough*, or at least *least* and a longer wait would add no information."""
        return waited >= enough or (waited >= least and self._rest.lasts(enough - waited, abs(self._settings.size)))

    def _wait_for_steadiness(self, observation: Observation, error: float, elapsed: float) -> None:
        s = self._settings
        if not abs(error) <= s.steady_band * abs(s.size):
            self._steady_since = observation.t
        steady = observation.t - self._steady_since >= s.steady_time
        over = self._is_over(elapsed, s.hold, s.least_hold if steady else math.inf)
        if over and (steady or elapsed >= s.settle or self._only_oscillates(elapsed)):
            self._band = self._band_about(np.array(self._held))
            self._next(observation.t)

    def _only_oscillates(self, elapsed: float) -> bool:
        """Return whether the held signal oscillates persistently about its target."""
        s, late = self._settings, _later(np.array(self._held))
        if elapsed < LEAST_OSCILLATING or not math.isfinite(s.enough) or abs(late.mean()) > s.steady_band * abs(s.size):
            return False
        return 0.0 < SETTLED_NOISES * _oscillation_in(late) <= MAX_OSCILLATION * abs(s.size)

    def _band_about(self, held: Array) -> float:
        """Return the distance [SI] from the target that counts as settled, from the noise of the *held* signal (n,)
        before the step."""
        noise, size = SETTLED_NOISES * _noise_in(held), abs(self._settings.size)
        oscillation = SETTLED_NOISES * _oscillation_in(_later(held))
        oscillation = oscillation if oscillation <= MAX_OSCILLATION * size else 0.0
        return max(SETTLED_BAND * size, noise, oscillation, ONE_QUANTUM * self._quantum(held))

    def _next(self, t: float) -> None:
        if self._step == 2:
            self._step = 3
            self._end("completed", "step and step back flown")
        else:
            step = self._settings.size if self._step == 0 else 0.0
            self._enter(self._step + 1, t, self._base + step)

    def _enter(self, number: int, t: float, target: float) -> None:
        self._step, self._step_start, self.target = number, t, target
        self._there_since = math.inf
        self._latest.clear()
        self._rest.begin()
        self.phase = ("settling", "step", "step back")[number]
        self._mark(t, "target", {"value": target, "phase": ("hold", "step", "back")[number]})

    def _command(self) -> Command:
        s = self._settings
        return set_point(s.signal, self.target, course=self._course, speed=s.speed)


def windows_of(trial: Trial) -> tuple[float, ...]:
    """Return the recorded durations [s] of the step and the step back of a step *trial*, as far as they were flown.

    A step that was stopped because the loop diverged counts as recorded to its end.
    """
    flown = len([m for m in trial.marks if m.kind == "target"]) - 1
    lasted = [float(seconds) for seconds in trial.meta.get("lasted", ())]
    longest = float(trial.meta.get("duration", math.inf))
    return tuple(lasted[i] if i < len(lasted) else longest for i in range(max(flown, 0)))


def are_read(windows: Sequence[float]) -> list[bool]:
    """Return for each half of a step, recorded for *windows* [s], whether it is evaluated.

    A half that a limit ended at once is too short, and is left out if the other one is not.
    """
    return [seconds >= min(SHORTEST_HALF, max(windows)) for seconds in windows]


def common_windows(one: Trial, other: Trial) -> tuple[float, ...]:
    """Return the durations [s] of the step and the step back that both of two step trials contain. They limit the
    comparison.
    """
    return tuple(min(pair) for pair in zip(windows_of(one), windows_of(other), strict=False))


def _make(axis: AxisKind, options: Mapping[str, float]) -> Step:
    speed, duration = options.get("speed", 0.0), options.get("step-duration", axis.step_duration)
    if axis.dof == "surge":
        size = options.get("step", SHARE_OF_TOP * speed)
        return Step(speed_step(speed, size, duration if math.isfinite(duration) else MOST_DURATION))
    size, under_way = options.get("step", axis.step), not options.get("keep-still")
    return Step(step_from_present(axis.stepped, size, duration, speed, under_way=under_way))


def _row(axis: AxisKind) -> ManoeuvreKind:
    return ManoeuvreKind(
        name="step",
        help="step and step back under the autopilot's own loop, to test gains",
        excites=frozenset({axis.dof}),
        drives=frozenset(),
        make=partial(_make, axis),
        options=("step", "step-duration"),
        room="at the spot; a boat keeps its cruise speed",
        identifies=False,
        axis=axis.name,
        command="tune AXIS, and recheck AXIS",
        for_force=partial(of_loop, _row),
    )


KIND = _row(AXES["heading"])
