"""What the exact fit minimises: minus twice the log-likelihood of the free parameters, with its derivatives.

The stamps of the input may be off by a constant few milliseconds (:attr:`Segment.dating`). That is a nuisance, not a
delay of the craft: it is fitted with what is known about it (:class:`Timing`) and so takes its share of certainty
from the inertia, which a quick craft would otherwise get wrong by more than its standard error.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.axis.likelihood import Law
from gcs_autotune.identify.axis.residuals import Residual, residuals_of
from gcs_autotune.identify.least_squares import Local
from gcs_autotune.identify.segment import Segment

__all__ = ["DELAY", "SHARED", "Bounds", "Mask", "Objective", "Timing", "information_of", "timing_of"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SHARED = ("b", "a", "c", "d", "delay")
"""The parameters all runs share, in this order."""

DELAY = 4
"""Where the delay stands among them."""

SLACK = 2.0
"""Standard deviation of the time shift in units of ``Segment.dating``. Chosen: the shift may well stand at the very
end of what the stamps allow, and twice that is weak enough not to pull it back by a tenth of its standard error."""

WIDEST = 4.0
"""Standard deviations a time shift may go."""


@dataclass(frozen=True, slots=True)
class Bounds:
    """What the data can resolve at all.

    Largest drag rate [1/s] (``a``, and ``c`` at the typical *speed* [rad/s or m/s]), largest delay [s].
    """

    rate: float
    delay: float
    speed: float


@dataclass(frozen=True, slots=True)
class Timing:
    """The time [s] from input stamp to motion is about ``mean``, give or take ``std``; it may be negative."""

    mean: float
    std: float


def timing_of(records: Sequence[Segment], delay: float) -> Timing | None:
    """Return what the records tell about the time from input stamp to motion of a craft with this *delay* [s]."""
    slack = SLACK * max(r.dating for r in records)
    return Timing(delay, slack) if slack > 0.0 else None


@dataclass(frozen=True, slots=True, eq=False)
class Objective:
    """The cost of one choice of ``free`` parameters of *theta*, as a function of one packed vector.

    ``timing`` given: the delay is free and stands for the time shift.
    """

    records: Sequence[Segment]
    names: Sequence[str]
    theta: Array
    free: Mask
    timing: Timing | None = None
    state: Mask = field(init=False)

    def __post_init__(self) -> None:
        has_position = [r.dof.position in r.signals and r.dof.position in self.names for r in self.records]
        object.__setattr__(self, "state", np.array([[p, True] for p in has_position]).ravel())
        if self.timing is not None:
            object.__setattr__(self, "free", np.array([*self.free[:DELAY], True]))

    @property
    def shared(self) -> int:
        """How many of the packed numbers belong to theta; they come first."""
        return int(self.free.sum())

    def pack(self, theta: Array, initial: Array) -> Array:
        """Return the vector of *theta* (5,) and the *initial* states (runs, 2)."""
        return np.concatenate([theta[self.free], initial.ravel()[self.state]])

    def unpack(self, x: Array) -> tuple[Array, Array]:
        """Undo :meth:`pack`; what is not free is as it was given."""
        theta = self.theta.copy()
        theta[self.free] = x[: self.shared]
        initial = np.zeros(2 * len(self.records))
        initial[self.state] = x[self.shared :]
        return theta, initial.reshape(-1, 2)

    def limits(self, bounds: Bounds) -> tuple[Array, Array]:
        """Return the smallest and the largest vector allowed."""
        steep = bounds.rate / bounds.speed
        low = np.array([-np.inf, -bounds.rate, -steep, -np.inf, 0.0])
        high = np.array([np.inf, bounds.rate, steep, np.inf, bounds.delay])
        if self.timing is not None:
            reach = WIDEST * self.timing.std
            low[DELAY], high[DELAY] = self.timing.mean - reach, self.timing.mean + reach
        states = np.full(int(self.state.sum()), np.inf)
        return np.concatenate([low[self.free], -states]), np.concatenate([high[self.free], states])

    def residuals(self, x: Array) -> list[Residual] | None:
        """Return the residuals at *x*, None when the simulation runs away."""
        return residuals_of(self.records, self.names, *self.unpack(x))

    def at(self, x: Array, laws: Mapping[str, Law]) -> Local | None:
        """Return cost, gradient and curvature at *x*, None when the simulation runs away."""
        found = self.residuals(x)
        if found is None:
            return None
        cost, gradient, curvature = 0.0, np.zeros(len(x)), np.zeros((len(x), len(x)))
        for residual in found:
            terms, J = laws[residual.signal.name].terms(residual.error), self.columns(residual)
            cost += float(terms.deviance.sum())
            gradient -= J.T @ terms.slope
            curvature += J.T @ (terms.curvature[:, None] * J)
        if self.timing is not None:
            off, weight = x[self.shared - 1] - self.timing.mean, self.timing.std**-2
            cost += weight * off**2
            gradient[self.shared - 1] += weight * off
        return Local(cost, gradient, curvature + self.known(len(x)))

    def columns(self, residual: Residual) -> Array:
        """Return a residual's Jacobian in the columns of the packed vector."""
        states = np.zeros((len(residual.error), 2 * len(self.records)))
        states[:, 2 * residual.record : 2 * residual.record + 2] = residual.jacobian[:, 5:]
        return np.hstack([residual.jacobian[:, :5][:, self.free], states[:, self.state]])

    def known(self, size: int) -> Array:
        """Return the information (size, size) that was there before the data: that about the time shift."""
        information = np.zeros((size, size))
        if self.timing is not None:
            information[self.shared - 1, self.shared - 1] = self.timing.std**-2
        return information


def information_of(residuals: Sequence[Residual], columns: Sequence[Array], laws: Mapping[str, Law]) -> Array:
    """Return the expected information (p, p) of parameters whose Jacobians are *columns* (n, p) each.

    The noise levels are unknown too: what they take away, ``I_ps I_ss^-1 I_sp``, is taken off.
    """
    p = columns[0].shape[1]
    total = np.zeros((p, p))
    for name, law in laws.items():
        mixed, own = np.zeros(p), 0.0
        for residual, J in zip(residuals, columns, strict=True):
            if residual.signal.name == name:
                by_truth, by_both, by_sigma = law.information(residual.error).T
                total += J.T @ (by_truth[:, None] * J)
                mixed += J.T @ by_both
                own += float(by_sigma.sum())
        if own > 0.0:
            total -= np.outer(mixed, mixed) / own
    return total
