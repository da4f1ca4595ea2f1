"""A linear process as a ratio of polynomials, with integrators and a delay."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gcs_autotune.notebook import Displayed

if TYPE_CHECKING:
    import control

__all__ = ["TransferFunction"]


@dataclass(frozen=True, slots=True)
class TransferFunction(Displayed):
    """A transfer function with integrators and delay.

    - ``numerator``: coefficients b_0..b_m in rising powers of s (Miskovic2010 (6.7)).
    - ``denominator``: coefficients a_0..a_n in rising powers of s.
    - ``integrators``: number of integrators.
    - ``delay`` [s]: delay of the input.
    """

    numerator: tuple[float, ...]
    denominator: tuple[float, ...]
    integrators: int = 0
    delay: float = 0.0

    def response(self, omega: ArrayLike) -> NDArray[np.complex128]:
        """Return the frequency response G(j omega) at *omega* [rad/s], any shape."""
        s = 1j * np.asarray(omega, dtype=np.float64)
        rational = np.polyval(self.numerator[::-1], s) / np.polyval(self.denominator[::-1], s)
        value: NDArray[np.complex128] = rational * np.exp(-s * self.delay) / s**self.integrators
        return value

    def poles(self) -> NDArray[np.complex128]:
        """Return the poles [rad/s], with those of the integrators at the end."""
        found = np.roots(self.denominator[::-1]).astype(np.complex128)
        return np.concatenate([found, np.zeros(self.integrators, dtype=np.complex128)])

    def zeros(self) -> NDArray[np.complex128]:
        """Return the zeros [rad/s]."""
        return np.roots(self.numerator[::-1]).astype(np.complex128)

    def to_control(self, pade: int = 0) -> control.TransferFunction:
        """Return the transfer function for the ``control`` library.

        pade : order of the Pade approximation of the delay; 0 omits the delay.
        """
        import control

        denominator = [*self.denominator[::-1], *[0.0] * self.integrators]
        system = control.tf(list(self.numerator[::-1]), denominator)
        return system * control.tf(*control.pade(self.delay, pade)) if pade and self.delay else system

    def to_dict(self) -> dict[str, Any]:
        """Return the model as data for a model file."""
        return {
            "schema": 1,
            "model": "transfer-function",
            "numerator": list(self.numerator),
            "denominator": list(self.denominator),
            "integrators": self.integrators,
            "delay": self.delay,
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> TransferFunction:
        """Return the transfer function that :meth:`to_dict` wrote as *data*."""
        b, a = (tuple(float(v) for v in data[k]) for k in ("numerator", "denominator"))
        return cls(b, a, int(data["integrators"]), float(data["delay"]))
