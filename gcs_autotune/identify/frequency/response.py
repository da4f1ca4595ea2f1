"""The measured frequency response: frequencies, complex gains, coherence, uncertainty.

:class:`Sampled` is a record on one even grid, with input and velocity averaged over the same steps. The average of the
held input is exact. The average velocity is the difference of the position over a step, if the position was measured.
If velocity and input are both averaged in this way, the effect of averaging cancels in their ratio. A measured velocity
is averaged by the trapezoid rule, which differs slightly. :func:`mending` corrects for this.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.axis.signals import first_names
from gcs_autotune.identify.free_run import run_freely
from gcs_autotune.identify.signals.segment import Segment, Signal
from gcs_autotune.models import SingleDof
from gcs_autotune.notebook import Displayed
from gcs_autotune.slow_imports import scipy_stats

__all__ = ["FrequencyResponse", "Sampled", "mending", "sampled", "together", "trusted"]

Array = NDArray[np.float64]

COHERENT = 0.6
"""Squared coherence from which a frequency counts as measured.

With eight averages the gain is then known to 20 %. Pure noise exceeds this value by chance once in six hundred
frequencies. Project choice.
"""


@dataclass(frozen=True, slots=True, eq=False)
class FrequencyResponse(Displayed):
    """Frequency response from input to *velocity*, as arrays (k,).

    - ``omega`` [rad/s]: frequencies, ascending.
    - ``value``: complex gain [velocity unit per input unit].
    - ``std``: standard deviation of the real part, and of the imaginary part, of ``value``.
    - ``coherence``: squared coherence, 0 to 1.
    - ``averages``: number of independent averages per point.
    - ``input_power``: power of the input, relative to that of the strongest point.
    - ``source``: how the response was measured: ``spectrum`` or ``harmonics``.
    """

    omega: Array
    value: NDArray[np.complex128]
    std: Array
    coherence: Array
    averages: Array
    input_power: Array
    source: Literal["spectrum", "harmonics"]

    def __len__(self) -> int:
        return len(self.omega)

    @property
    def magnitude(self) -> Array:
        """Magnitude (k,) of the complex gain [velocity unit per input unit]."""
        return np.abs(self.value)

    @property
    def phase(self) -> Array:
        """Phase (k,) of the complex gain [rad], continuous over frequency."""
        return np.unwrap(np.angle(self.value))

    def radius(self, level: float = 0.95) -> Array:
        """Return the radius (k,) of the circle about ``value`` that contains the true gain with probability *level*.

        The radius follows from the residual spectrum with ``2 averages - 2`` degrees of freedom (Bendat and Piersol,
        Random Data).
        """
        quantile = scipy_stats().f.ppf(level, 2.0, np.maximum(2.0 * self.averages - 2.0, 1.0))
        radii: Array = self.std * np.sqrt(2.0 * quantile)
        return radii

    def measured(self, coherence: float = COHERENT) -> FrequencyResponse:
        """Return the response restricted to the points whose squared coherence is at least *coherence*."""
        return self.at(self.coherence >= coherence)

    def at(self, keep: NDArray[np.bool_]) -> FrequencyResponse:
        """Return the response restricted to the points selected by the mask *keep* (k,)."""
        return FrequencyResponse(
            omega=self.omega[keep],
            value=self.value[keep],
            std=self.std[keep],
            coherence=self.coherence[keep],
            averages=self.averages[keep],
            input_power=self.input_power[keep],
            source=self.source,
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the response as data for JSON."""
        return {
            "source": self.source,
            "omega": self.omega.tolist(),
            "magnitude": self.magnitude.tolist(),
            "phase": self.phase.tolist(),
            "std": self.std.tolist(),
            "coherence": self.coherence.tolist(),
            "averages": self.averages.tolist(),
            "input_power": self.input_power.tolist(),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> FrequencyResponse:
        """Return the response from *data* that :meth:`to_dict` returned."""
        columns = {k: np.asarray(v, dtype=np.float64) for k, v in data.items() if k != "source"}
        value = columns.pop("magnitude") * np.exp(1j * columns.pop("phase"))
        return cls(value=value, source="harmonics" if data["source"] == "harmonics" else "spectrum", **columns)


def together(parts: Sequence[FrequencyResponse]) -> FrequencyResponse:
    """Return the points of several responses from the same source as one response, sorted by frequency."""
    order = np.argsort(np.concatenate([p.omega for p in parts]), kind="stable")
    return FrequencyResponse(
        omega=np.concatenate([p.omega for p in parts])[order],
        value=np.concatenate([p.value for p in parts])[order],
        std=np.concatenate([p.std for p in parts])[order],
        coherence=np.concatenate([p.coherence for p in parts])[order],
        averages=np.concatenate([p.averages for p in parts])[order],
        input_power=np.concatenate([p.input_power for p in parts])[order],
        source=parts[0].source,
    )


@dataclass(frozen=True, slots=True, eq=False)
class Sampled:
    """Input ``tau`` and velocity ``nu`` (n,), averaged over even steps of ``dt`` [s].

    ``derived``: whether the velocity was derived from the position.
    """

    dt: float
    tau: Array
    nu: Array
    derived: bool

    @property
    def duration(self) -> float:
        """Duration of the record [s]."""
        return self.dt * len(self.nu)


def trusted(record: Segment) -> Signal:
    """Return the signal of *record* that a fit of its degree of freedom uses first."""
    name = first_names([record])[0]
    return record.signals.get(name, record.main)


def sampled(record: Segment, model: SingleDof | None = None) -> Sampled:
    """Return *record* on an even grid whose interval is the median time step of its signal.

    The signal is interpolated linearly between samples. With the uneven stamps of telemetry the error is visible only
    near half the sampling rate. The spectra do not use these frequencies.

    Parameters
    ----------
    model : model whose free run, with fitted initial state, is subtracted from the motion, or None.
    """
    signal = trusted(record)
    derived = signal is record.position
    if model is not None:
        (run,) = run_freely(model, record)
        signal = replace(signal, t=run.t, values=run.measured - run.fitted)
    step = float(np.median(np.diff(signal.t)))
    count = int((signal.t[-1] - signal.t[0]) / step + 1e-6)
    grid = signal.t[0] + step * np.arange(count + 1)
    at = np.interp(grid, signal.t, signal.values)
    nu = np.diff(at) / step if derived else 0.5 * (at[1:] + at[:-1])
    return Sampled(step, np.diff(_impulse(record, grid)) / step, nu, derived)


def _impulse(record: Segment, t: Array) -> Array:
    """Return the exact integral of the held input up to *t*.

    The first value also counts before its stamp.
    """
    area = np.concatenate([[0.0], np.cumsum(record.tau[:-1] * np.diff(record.t_in))])
    i = np.maximum(np.searchsorted(record.t_in, t, side="right") - 1, 0)
    total: Array = area[i] + record.tau[i] * (t - record.t_in[i])
    return total


def mending(omega: Array, dt: float, derived: bool) -> Array:
    """Return the factor (k,) that corrects a response at *omega* [rad/s] for the trapezoid average of a measured
    velocity.

    dt : time step [s].
    derived : whether the velocity was derived from a position. No correction is then necessary, and the factor is 1.
    """
    if derived:
        return np.ones_like(omega)
    half = 0.5 * omega * dt
    factor: Array = np.sinc(half / np.pi) / np.cos(half)
    return factor
