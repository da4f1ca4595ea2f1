"""Determine steady velocity, velocity error and time constant of every step response (Miskovic2010, 4.3).

Every value comes from a line or a local polynomial, and therefore has a standard error. ``k_ss`` and ``eps_v`` are
fitted to the settled part of the response. The start values are fitted to the samples before the step.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.axis.signals import first_names
from gcs_autotune.identify.open_loop.readings import Hold, LocalFit, Reading, find_holds, local_fit
from gcs_autotune.identify.signals.segment import Segment, Signal

__all__ = ["SETTLED", "StepReading", "read_steps"]

Array = NDArray[np.float64]

SETTLED = 8.0
"""Number of time constants after which the settled part begins, if the hold is long enough. Project choice.

Then 0.03 % of the transient is left.
"""

ENOUGH = 3.0
"""Number of time constants that must pass before the settled part for it to be used. Project choice.

Then 5 % of the transient is left.
"""

LEAST = 6
"""Smallest number of samples to which a line or a polynomial is fitted. Project choice."""

KNEE = 1.0 - math.exp(-1.0)
"""Fraction of the change of velocity at which the time to the knee is measured, Miskovic2010 (4.33).

The change is 63.2 % complete after one time constant.
"""


@dataclass(frozen=True, slots=True, eq=False)
class StepReading:
    """Readings of one step.

    - ``t`` [s]: time of the step.
    - ``before``, ``tau``: input before and after the step.
    - ``k_ss``: steady velocity [rad/s or m/s].
    - ``nu_0``: velocity at the step [rad/s or m/s].
    - ``lag``: eta_0 - eps_v [rad or m] of a measured position, else NaN.
    - ``knee`` [s]: time to the velocity ``level`` of a measured velocity, else NaN.
    - ``shared``: covariance of ``k_ss`` and ``lag``.
    - ``settled``: whether the transient was over.
    - ``steady_only``: whether only ``k_ss`` is known, because the record does not contain the start of the step.
    - ``window``: interval [s] after the step over which ``k_ss`` and ``lag`` were measured.
    """

    run: str
    t: float
    before: float
    tau: float
    k_ss: Reading
    nu_0: Reading
    lag: Reading
    knee: Reading
    level: float = math.nan
    shared: float = 0.0
    settled: bool = True
    steady_only: bool = False
    window: tuple[float, float] = (math.nan, math.nan)

    @property
    def has_lag(self) -> bool:
        """Whether the lag is known, which requires a measured position."""
        return math.isfinite(self.lag.value)

    @property
    def has_knee(self) -> bool:
        """Whether the time to the knee is known, which requires a measured velocity."""
        return math.isfinite(self.knee.value)


def read_steps(records: Sequence[Segment]) -> tuple[StepReading, ...]:
    """Return the readings of every interval of constant input that is long enough to be evaluated."""
    name = first_names(records)[0]
    return tuple(s for record in records for s in _of_record(record, name))


def _of_record(record: Segment, name: str) -> list[StepReading]:
    signal = record.signals.get(name, record.main)
    is_position = signal.name == record.dof.position
    end = float(signal.t[-1])
    holds = find_holds(record.t_in, record.tau, end)
    readings: list[StepReading] = []
    previous: tuple[Hold, LocalFit | None] | None = None
    for hold in holds:
        reader = _Reader(signal, is_position, hold, previous, record)
        made = reader.read()
        previous = (hold, reader.tail)
        if made is not None:
            readings.append(made)
    return readings


class _Reader:
    """Evaluation of one hold.

    After :meth:`read`, ``tail`` is the fit of the last samples, from which the next step starts.
    """

    def __init__(
        self,
        signal: Signal,
        is_position: bool,
        hold: Hold,
        previous: tuple[Hold, LocalFit | None] | None,
        record: Segment,
    ) -> None:
        self.hold, self.record, self.is_position = hold, record, is_position
        self.previous = previous
        self.step = 0.5 * (hold.before + hold.start)  # a ramp acts like a jump at its middle
        keep = (signal.t >= hold.start) & (signal.t <= hold.end)
        self.t, self.y = signal.t[keep], signal.values[keep]
        self.floor = signal.step / math.sqrt(12.0)
        self.tail: LocalFit | None = None
        units = {"rad": ("rad", "rad/s"), "m": ("m", "m/s")}[record.dof.position_unit]
        self.position_unit, self.velocity_unit = units

    def read(self) -> StepReading | None:
        if len(self.t) < 2 * LEAST:
            return None
        nu_0, eta_0, known = self._origin()
        start, settled, constant = self._settled_from(nu_0.value, eta_0.value, known)
        fit = self._with_transient(self._fit_from(start), start, nu_0.value, constant)
        settled = settled and self._is_straight(start)
        self.tail = fit if settled else self._bent_tail()
        first = float(self.t[self._first(start)])
        nan = Reading(math.nan, math.nan)
        k = fit.slope(self.velocity_unit) if self.is_position else fit.value(self.velocity_unit)
        lag, shared, knee, level = nan, 0.0, nan, math.nan
        if known and self.is_position:
            variance = fit.covariance[0, 0] + eta_0.std**2
            lag = Reading(eta_0.value - float(fit.coefficients[0]), math.sqrt(variance), self.position_unit)
            shared = -float(fit.covariance[0, 1])
        elif known:
            level = nu_0.value + KNEE * (k.value - nu_0.value)
            knee = self._crossing(level, start)
        before = self.hold.level if self.previous is None else self.previous[0].level
        return StepReading(
            self.record.run, self.step, before, self.hold.level, k, nu_0, lag, knee, level, shared, settled, not known,
            (first - self.step, float(self.t[-1]) - self.step),
        )  # fmt: skip

    def _origin(self) -> tuple[Reading, Reading, bool]:
        """Return velocity and position at the step, and whether they are known.

        They are extrapolated from the stretch before the step.
        """
        fit = self.previous[1] if self.previous is not None else None
        if fit is None:
            return Reading(0.0, math.nan, self.velocity_unit), Reading(float(self.y[0]), math.nan), False
        reach = self.step - fit.at
        powers = reach ** np.arange(len(fit.coefficients))
        value = float(powers @ fit.coefficients)
        std = math.sqrt(max(float(powers @ fit.covariance @ powers), 0.0))
        if not self.is_position:
            return Reading(value, std, self.velocity_unit), Reading(math.nan, math.nan), True
        slopes = np.arange(len(powers)) * np.append(0.0, powers[:-1])
        slope = float(slopes @ fit.coefficients)
        slope_std = math.sqrt(max(float(slopes @ fit.covariance @ slopes), 0.0))
        return Reading(slope, slope_std, self.velocity_unit), Reading(value, std, self.position_unit), True

    def _settled_from(self, nu_0: float, eta_0: float, known: bool) -> tuple[float, bool, float]:
        """Return the start of the settled part, whether the transient was over by then, and its time constant [s]."""
        end = float(self.t[-1])
        latest = end - 0.3 * (end - self.step)
        start = end - 0.4 * (end - self.step)
        constant = math.inf
        for _ in range(8):
            constant = self._time_constant(start, nu_0, eta_0, known)
            wanted = self.step + SETTLED * constant
            start = float(np.clip(wanted, self.step, latest))
        return start, start >= self.step + ENOUGH * constant, constant

    def _with_transient(self, fit: LocalFit, start: float, nu_0: float, constant: float) -> LocalFit:
        """Return *fit*, with the possible effect of the remaining transient added to its covariance."""
        if not constant > 0.0:
            return fit
        t = self.t[self._first(start) :] - self.step
        rest = np.exp(-t / constant)
        if self.is_position:
            change = (
                (float(fit.coefficients[1]) - nu_0)
                * constant
                * np.linalg.lstsq(np.vander(t, 2), rest, rcond=None)[0][::-1]
            )
        else:
            change = (float(fit.coefficients[0]) - nu_0) * np.array([rest.mean()])
        return replace(fit, covariance=fit.covariance + np.outer(change, change))

    def _time_constant(self, start: float, nu_0: float, eta_0: float, known: bool) -> float:
        """Return the time constant [s] of the velocity.

        It is the area between the response and its steady value, divided by the change.
        """
        fit = self._fit_from(start)
        k = float(fit.coefficients[1] if self.is_position else fit.coefficients[0])
        if not known:
            return (float(self.t[-1]) - self.step) / (SETTLED + ENOUGH)
        if abs(k - nu_0) < 1e-12 or abs(k - nu_0) < 2.0 * math.sqrt(max(fit.covariance[-1, -1], 0.0)):
            return 0.0
        if self.is_position:
            return abs((eta_0 - float(fit.coefficients[0])) / (k - nu_0))
        area = float(np.trapezoid(k - self.y, self.t)) + (k - nu_0) * max(float(self.t[0]) - self.step, 0.0)
        return abs(area / (k - nu_0))

    def _first(self, start: float) -> int:
        """Return the index of the first sample at or after *start* [s]."""
        return min(int(np.searchsorted(self.t, start)), len(self.t) - LEAST)

    def _fit_from(self, start: float) -> LocalFit:
        first = self._first(start)
        degree = 1 if self.is_position else 0
        return local_fit(self.t[first:], self.y[first:], self.step, degree, self.floor)

    def _bent_tail(self) -> LocalFit:
        """Return a fit of the end of an unsettled response, with a polynomial one degree higher."""
        first = max(len(self.t) - max(LEAST + 2, len(self.t) // 4), 0)
        return local_fit(self.t[first:], self.y[first:], self.hold.end, 2 if self.is_position else 1, self.floor)

    def _is_straight(self, start: float) -> bool:
        """Return whether the settled part is straight.

        A curvature that a settled transient would leave is allowed.
        """
        first = self._first(start)
        t, y = self.t[first:], self.y[first:]
        degree = 2 if self.is_position else 1
        bend = local_fit(t, y, float(t[0]), degree, self.floor)
        change = float(bend.coefficients[-1]) * float(t[-1] - t[0]) * degree
        std = math.sqrt(max(float(bend.covariance[-1, -1]), 0.0)) * float(t[-1] - t[0]) * degree
        scale = float(np.max(np.abs(np.gradient(self.y, self.t)))) if self.is_position else float(np.ptp(self.y))
        return abs(change) < 3.0 * std or abs(change) < math.exp(-ENOUGH) * scale

    def _crossing(self, level: float, settled_from: float) -> Reading:
        """Return the time [s] from the step to the velocity *level*, from a local fit around the crossing."""
        rising = float(np.sign(self.y[-LEAST:].mean() - level)) or 1.0
        beyond = np.flatnonzero(rising * (self.y - level) > 0.0)
        if len(beyond) == 0 or beyond[0] == 0:
            return Reading(math.nan, math.nan, "s")
        first = float(self.t[beyond[0]])
        width = max(0.35 * (first - self.step), 0.0)
        for _ in range(4):
            keep = np.abs(self.t - first) <= width
            if int(keep.sum()) < 4:
                i = int(np.searchsorted(self.t, first))
                keep = np.zeros(len(self.t), dtype=bool)
                keep[max(i - 2, 0) : i + 2] = True
            fit = local_fit(self.t[keep], self.y[keep], first, min(2, int(keep.sum()) - 2), self.floor)
            slope = float(fit.coefficients[1])
            if slope * rising <= 0.0:
                return Reading(math.nan, math.nan, "s")
            first = float(np.clip(first + (level - fit.coefficients[0]) / slope, self.step, settled_from))
        return Reading(first - self.step, math.sqrt(float(fit.covariance[0, 0])) / abs(slope), "s")
