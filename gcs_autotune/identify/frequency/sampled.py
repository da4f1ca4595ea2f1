"""A record on one even grid, input and velocity averaged over the same steps.

Over a step both are box averages: of the held input exactly, of the velocity as the position's difference. The box
then cancels from their ratio. A measured velocity is averaged by the trapezoid rule, whose box differs a little;
:func:`mending` is the ratio of the two.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.axis.record import Record, Signal
from gcs_autotune.identify.axis.signals import first_names
from gcs_autotune.identify.axis.validation import run_freely
from gcs_autotune.models.single_dof import SingleDof

__all__ = ["Sampled", "mending", "sampled", "trusted"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Sampled:
    """``tau`` and ``nu`` (n,) averaged over even steps of ``dt`` [s]; ``derived``: from the position."""

    dt: float
    tau: Array
    nu: Array
    derived: bool

    @property
    def duration(self) -> float:
        """Seconds."""
        return self.dt * len(self.nu)


def trusted(record: Record) -> Signal:
    """Return the signal of *record* that a fit of its degree of freedom trusts first."""
    name = first_names([record])[0]
    return next((s for s in record.signals if s.name == name), record.main)


def sampled(record: Record, model: SingleDof | None = None) -> Sampled:
    """Return *record* on the grid of its median time step.

    Between samples the signal is taken as straight; with stamps as uneven as telemetry's that shows near half the
    sampling rate only, where the spectra do not look.

    Parameters
    ----------
    model : what it makes of the input, from the initial state that suits best, is taken off the motion.
    """
    signal = trusted(record)
    derived = signal is record.position
    if model is not None:
        run = run_freely(model, record)
        signal = replace(signal, t=run.t, values=run.measured - run.fitted)
    step = float(np.median(np.diff(signal.t)))
    count = int((signal.t[-1] - signal.t[0]) / step + 1e-6)
    grid = signal.t[0] + step * np.arange(count + 1)
    at = np.interp(grid, signal.t, signal.values)
    nu = np.diff(at) / step if derived else 0.5 * (at[1:] + at[:-1])
    return Sampled(step, np.diff(_impulse(record, grid)) / step, nu, derived)


def _impulse(record: Record, t: Array) -> Array:
    """Return the integral of the held input up to *t*, exactly; the first value holds before its stamp too."""
    area = np.concatenate([[0.0], np.cumsum(record.tau[:-1] * np.diff(record.t_in))])
    i = np.maximum(np.searchsorted(record.t_in, t, side="right") - 1, 0)
    total: Array = area[i] + record.tau[i] * (t - record.t_in[i])
    return total


def mending(omega: Array, dt: float, derived: bool) -> Array:
    """Return what a response must be multiplied by for the trapezoid average of a measured velocity."""
    if derived:
        return np.ones_like(omega)
    half = 0.5 * omega * dt
    factor: Array = np.sinc(half / np.pi) / np.cos(half)
    return factor
