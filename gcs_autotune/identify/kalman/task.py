"""Task of a filter: filter bank, start, checked options, and the noise levels that the user fixed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative, UsageError
from gcs_autotune.identify.case import Case
from gcs_autotune.identify.kalman.filter_bank import FilterBank, Levels, Prior, Smoothed, tuned
from gcs_autotune.identify.kalman.start import Start, begin
from gcs_autotune.identify.problems.free_numbers import WEAK
from gcs_autotune.models import Form

__all__ = ["OPTIONS", "REPEAT", "Task", "first_states", "task_of"]

Array = NDArray[np.float64]

OPTIONS = (
    (
        "state_noise",
        "process noise: standard deviation that a velocity gains in 1 s [m/s, rad/s], one number or one per velocity",
    ),
    ("measurement_noise", "standard deviation of each signal, by name [SI] (default: estimated)"),
    ("start", "start values of some or all parameters, by name (default: from a regression)"),
    ("spread", "initial standard deviation of a parameter, in units of its natural scale (1)"),
)
"""Options that all methods of this package accept, with a line of help each."""

REPEAT = 3.0
"""Prior standard deviation of a repeated pass, in standard errors of the last pass. Project choice.

It is large enough for parameters to move, and small enough for linearisation.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """Input of every method of this package.

    - ``form``: the form to fit. If input stamps are not exact (decision 3), the form of ``bank`` has their shift as its
      ``delay``.
    - ``stamps`` [s]: start value of that delay, None if stamps are exact.
    - ``spread``: prior standard deviation of a parameter, in units of its scale.
    - ``tune_noise``, ``tune_drive``: whether the noise variances and the process noise are estimated.
    - ``loose`` (n,): a high intensity of the process noise, with which the states follow the samples.
    """

    case: Case
    form: Form
    bank: FilterBank
    start: Start
    spread: float
    tune_noise: bool
    tune_drive: bool
    loose: Array
    stamps: float | None = None

    @property
    def prior(self) -> Prior:
        """Prior of states and parameters before the first sample."""
        theta = self.start.theta[self.bank.places]
        return Prior(self.start.states, self.start.spread, theta, np.diag((self.spread * self.start.scale) ** 2))

    def widened(self, factor: float) -> Array:
        """Return the prior covariance (p, p) with standard deviations multiplied by *factor*.

        The shift of stamps keeps its known width.
        """
        wide = np.array([1.0 if self.is_shift(n) else factor for n in self.bank.free])
        return self.prior.covariance * np.outer(wide, wide)

    def is_shift(self, name: str) -> bool:
        """Return whether the parameter *name* in the filter's state is the shift of input stamps."""
        return self.stamps is not None and name == "delay"

    def theta(self, free: Array) -> Array:
        """Return all parameters (all,), with the free ones set to *free* (p,)."""
        theta = self.start.theta.copy()
        theta[self.bank.places] = free
        return theta

    def tuned(self, levels: Levels, smoothed: Smoothed) -> Levels:
        """Return noise levels closer to the most likely ones than *levels*. Levels fixed by the user stay unchanged."""
        levels = tuned(levels, smoothed, self.start.floors, noise=self.tune_noise, drive=self.tune_drive)
        return levels if self.tune_drive else replace(levels, drive=self.start.levels.drive)


def first_states(smoothed: Smoothed, widest: Array) -> tuple[Array, Array]:
    """Return the smoothed first states of the records (records, n) and their standard deviations, for the next pass.

    widest : largest standard deviation allowed.
    """
    n = widest.shape[1]
    states = np.array([path[0, :n] for path in smoothed.trajectories])
    std = np.sqrt(np.array([var[0, :n] for var in smoothed.variances]))
    return states, np.minimum(REPEAT * std, widest)


def task_of(case: Case) -> Task:
    """Return the filter task of a case, with its options checked.

    Raises
    ------
    UsageError
        An option has an invalid value.
    NotInformative
        The form has no free parameter.
    """
    form = case.the_form
    if case.delay and "delay" not in form.free:
        form = form.fixing({"delay": case.delay})
    if not form.free:
        raise NotInformative(
            f"form '{form.name}' has no free parameter, so there is nothing to identify. Free at least one"
        )
    dating = max((s.dating for s in case.records), default=0.0)
    stamps = form.known.get("delay", 0.0) if dating > 0.0 and "delay" not in form.free else None
    requested = form
    form = form if stamps is None else form.freeing("delay")
    bank = FilterBank(form, case.records, form.free)
    given = {**form.start, **_numbers(case.options, "start")}
    unknown = set(given) - set(requested.parameters)
    if unknown:
        raise UsageError(
            f"start contains {', '.join(sorted(unknown))}, which form '{form.name}' does not have. Omit it"
        )
    if stamps is not None:
        given = {**given, "delay": stamps}
    start = begin(bank, given)
    levels, loose = start.levels, start.levels.drive
    noise, drive = _numbers(case.options, "measurement_noise"), case.options.get("state_noise")
    if noise:
        r = [noise[s] ** 2 if s in noise else v for s, v in zip(bank.signals, levels.noise, strict=True)]
        levels = replace(levels, noise=np.maximum(np.array(r), 1e-24))
    if drive is not None:
        levels = replace(levels, drive=_drive(bank, drive))
    spread = float(case.options.get("spread", 1.0))
    if not spread > 0.0:
        raise UsageError(f"spread must be positive, not {spread}")
    if stamps is not None:
        scale = start.scale.copy()
        scale[bank.free.index("delay")] = WEAK.std * dating / spread
        start = replace(start, scale=scale)
    tune_noise = not set(bank.signals) <= set(noise)
    return Task(case, requested, bank, replace(start, levels=levels), spread, tune_noise, drive is None, loose, stamps)


def _numbers(options: Mapping[str, Any], name: str) -> dict[str, float]:
    given = options.get(name, {})
    try:
        return {str(k): float(v) for k, v in dict(given).items()}
    except (TypeError, ValueError) as error:
        raise UsageError(f"option '{name}' needs numbers by name, such as {{'u': 0.1}}, not {given!r}") from error


def _drive(bank: FilterBank, given: Any) -> Array:
    velocities = [s for s in bank.states if s in "uvwpqr"]
    values = dict.fromkeys(velocities, float(given)) if isinstance(given, (int, float)) else dict(given)
    if set(values) - set(velocities) or any(float(v) < 0.0 for v in values.values()):
        raise UsageError(f"state_noise needs numbers of at least 0 for {', '.join(velocities)}, not {given!r}")
    return np.array([float(values.get(s, 0.0)) ** 2 for s in bank.states])
