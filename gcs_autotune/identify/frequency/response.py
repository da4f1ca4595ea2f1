"""The empirical frequency response: complex gains with coherence and confidence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.slow_imports import scipy_stats

__all__ = ["FrequencyResponse", "together"]

Array = NDArray[np.float64]

COHERENT = 0.6
"""Squared coherence above which a point counts as measured. Chosen: the gain is then known to 20 % with eight averages,
and chance alone exceeds it once in six hundred."""


@dataclass(frozen=True, slots=True, eq=False)
class FrequencyResponse:
    """Response from input to *velocity*, all arrays (k,).

    ``omega`` [rad/s] ascending; ``value`` complex gain [velocity unit per input unit]; ``std`` standard deviation of
    its real and of its imaginary part; ``coherence`` squared, 0 to 1; ``averages`` independent ones behind each point;
    ``input_power`` relative to the strongest point;
    ``source`` tells how it was measured.
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
        """Gain."""
        return np.abs(self.value)

    @property
    def phase(self) -> Array:
        """Phase [rad], continuous over frequency."""
        return np.unwrap(np.angle(self.value))

    def radius(self, level: float = 0.95) -> Array:
        """Return the radius (k,) of the circle about ``value`` that holds the truth with probability *level*.

        Of the residual spectrum with ``2 averages - 2`` degrees of freedom (Bendat and Piersol, Random Data).
        """
        quantile = scipy_stats().f.ppf(level, 2.0, np.maximum(2.0 * self.averages - 2.0, 1.0))
        found: Array = self.std * np.sqrt(2.0 * quantile)
        return found

    def measured(self, coherence: float = COHERENT) -> FrequencyResponse:
        """Return the points that are *coherence* or better."""
        return self.at(self.coherence >= coherence)

    def at(self, keep: NDArray[np.bool_]) -> FrequencyResponse:
        """Return the points marked in *keep*, (k,)."""
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
        """Return plain data."""
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
        """Rebuild from :meth:`to_dict`."""
        columns = {k: np.asarray(v, dtype=np.float64) for k, v in data.items() if k != "source"}
        value = columns.pop("magnitude") * np.exp(1j * columns.pop("phase"))
        return cls(value=value, source="harmonics" if data["source"] == "harmonics" else "spectrum", **columns)


def together(parts: Sequence[FrequencyResponse]) -> FrequencyResponse:
    """Return several responses of one source as one, sorted by frequency."""
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
