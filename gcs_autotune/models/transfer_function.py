"""A linear process as a ratio of polynomials, with integrators and a delay."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    import control

__all__ = ["TransferFunction"]


@dataclass(frozen=True, slots=True)
class TransferFunction:
    """A transfer function with integrators and delay.

    - ``numerator``: b_0..b_m.
    - ``denominator``: a_0..a_n, both in rising powers of s (Miskovic2010 (6.7)).
    - ``integrators``: their number.
    - ``delay``: [s].
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

        The delay is a Pade approximation of that order; 0 omits it.
        """
        import control

        denominator = [*self.denominator[::-1], *[0.0] * self.integrators]
        system = control.tf(list(self.numerator[::-1]), denominator)
        return system * control.tf(*control.pade(self.delay, pade)) if pade and self.delay else system

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for a model file."""
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
        """Rebuild a transfer function from the data of :meth:`to_dict`."""
        b, a = (tuple(float(v) for v in data[k]) for k in ("numerator", "denominator"))
        return cls(b, a, int(data["integrators"]), float(data["delay"]))
