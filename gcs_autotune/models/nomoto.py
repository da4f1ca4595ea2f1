"""Nomoto's steering models, with their K and T.

The first-order model is ``T r_dot + r = K delta(t - delay)`` (Miskovic2010, eq. (4.50)). The second-order model is
``T_1 T_2 r_ddot + (T_1 + T_2) r_dot + r = K (delta + T_3 delta_dot)`` (Nomoto1957; Miskovic2010 uses the first only).
It includes the effect of sway. Any velocity and input may replace ``r`` and ``delta``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gcs_autotune.models.single_dof import SingleDof
from gcs_autotune.models.transfer_function import TransferFunction
from gcs_autotune.notebook import Displayed

__all__ = ["Nomoto1", "Nomoto2"]


@dataclass(frozen=True, slots=True)
class Nomoto1(Displayed):
    """Nomoto's first-order model ``K exp(-s delay) / (T s + 1)`` from input to velocity.

    - ``K`` [velocity unit per input unit], ``T`` [s]: gain and time constant.
    - ``delay`` [s]: delay of the input.

    If both K and T are negative, the craft is unstable on its course and at first turns against a held rudder.
    """

    K: float
    T: float
    delay: float = 0.0

    @classmethod
    def from_single_dof(cls, model: SingleDof, amplitude: float = 0.0) -> Nomoto1:
        """Return the first-order model of *model*, with ``K = 1/beta`` and ``T = alpha/beta``.

        amplitude : velocity [rad/s or m/s] at which quadratic drag is linearised (Miskovic2010 (6.43)). If the drag is
            zero at that velocity, K and T are infinite.
        """
        beta = model.equivalent_drag(amplitude)
        if beta == 0.0:
            return cls(math.inf, math.inf, model.delay)
        return cls(1.0 / beta, model.alpha / beta, model.delay)

    def transfer_function(self) -> TransferFunction:
        """Return the transfer function as a ratio of polynomials; ``.to_control()`` converts it for the ``control``
        library."""
        return TransferFunction((self.K,), (1.0, self.T), 0, self.delay)

    def response(self, omega: ArrayLike) -> NDArray[np.complex128]:
        """Return the complex frequency response at *omega* [rad/s], any shape."""
        return self.transfer_function().response(omega)

    def to_dict(self) -> dict[str, Any]:
        """Return the model as data for a model file."""
        return {"schema": 1, "model": "nomoto-1", "K": self.K, "T": self.T, "delay": self.delay}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Nomoto1:
        """Return the model that :meth:`to_dict` wrote as *data*."""
        return cls(float(data["K"]), float(data["T"]), float(data["delay"]))


@dataclass(frozen=True, slots=True)
class Nomoto2(Displayed):
    """Nomoto's second-order model ``K (T_3 s + 1) exp(-s delay) / ((T_1 s + 1)(T_2 s + 1))`` from input to velocity.

    - ``K`` [velocity unit per input unit]: gain.
    - ``T_1``, ``T_2``, ``T_3`` [s]: time constants, with ``|T_1| >= |T_2|``.
    - ``delay`` [s]: delay of the input.
    """

    K: float
    T_1: float
    T_2: float
    T_3: float
    delay: float = 0.0

    def first_order(self) -> Nomoto1:
        """Return the first-order model with the same response at low frequency, ``T = T_1 + T_2 - T_3``
        (Nomoto1957).
        """
        return Nomoto1(self.K, self.T_1 + self.T_2 - self.T_3, self.delay)

    def transfer_function(self) -> TransferFunction:
        """Return the transfer function as a ratio of polynomials; ``.to_control()`` converts it for the ``control``
        library."""
        denominator = (1.0, self.T_1 + self.T_2, self.T_1 * self.T_2)
        return TransferFunction((self.K, self.K * self.T_3), denominator, 0, self.delay)

    def response(self, omega: ArrayLike) -> NDArray[np.complex128]:
        """Return the complex frequency response at *omega* [rad/s], any shape."""
        return self.transfer_function().response(omega)

    def to_dict(self) -> dict[str, Any]:
        """Return the model as data for a model file."""
        times = {"T_1": self.T_1, "T_2": self.T_2, "T_3": self.T_3}
        return {"schema": 1, "model": "nomoto-2", "K": self.K, **times, "delay": self.delay}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Nomoto2:
        """Return the model that :meth:`to_dict` wrote as *data*."""
        return cls(*(float(data[k]) for k in ("K", "T_1", "T_2", "T_3", "delay")))
