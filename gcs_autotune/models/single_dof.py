"""The model of one degree of freedom.

``alpha * nu_dot + (beta + beta_quadratic*|nu|) * nu = tau(t - delay) + delta``, ``eta_dot = nu`` (Miskovic2010, eq.
(6.33)-(6.35); signs in :mod:`gcs_autotune.sname`). In roll and pitch, ``restoring * sin(eta)`` is added on the left:
weight and buoyancy pull a craft back to level (Fossen2011, (4.6)).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gcs_autotune.documents import conformed
from gcs_autotune.notebook import Displayed
from gcs_autotune.sname import DOFS, Dof
from gcs_autotune_files.model import SingleDofData

__all__ = ["SCHEMA", "SingleDof"]

SCHEMA = 1


@dataclass(frozen=True, slots=True)
class SingleDof(Displayed):
    """Identified model of one degree of freedom.

    - ``dof``: name of the degree of freedom.
    - ``input_unit``: ``N m``, ``N``, ``rad`` (rudder) or ``1`` (fraction of full output). The units of the other fields
      follow from it, see ``Dof.parameter_units``.
    - ``delay`` [s]: delay between input and force.
    - ``restoring``: moment per angle, near level, that pulls the craft back; 0 for other degrees of freedom.
    """

    dof: str
    input_unit: str
    alpha: float
    beta: float
    beta_quadratic: float = 0.0
    delta: float = 0.0
    delay: float = 0.0
    restoring: float = 0.0

    @property
    def axis(self) -> Dof:
        """Definition of the degree of freedom: names of its motion, force and parameters."""
        return DOFS[self.dof]

    def acceleration(self, nu: float, tau: float, eta: float = 0.0) -> float:
        """Return the acceleration [rad/s^2 or m/s^2] at the velocity *nu* under *tau*, which is already delayed.

        eta : angle [rad] from level, for a model with a restoring moment.
        """
        drag = (self.beta + self.beta_quadratic * abs(nu)) * nu
        return (tau + self.delta - drag - self.restoring * math.sin(eta)) / self.alpha

    def steady_velocity(self, tau: float) -> float:
        """Return the velocity [rad/s or m/s] at which drag balances ``tau + delta`` (Miskovic2010, eq. (7.4),
        (7.6))."""
        sign = math.copysign(1.0, self.alpha)
        force, b, c = sign * (tau + self.delta), sign * self.beta, sign * self.beta_quadratic
        if c == 0.0:
            return force / b if b else math.copysign(math.inf, force)
        return math.copysign((-b + math.sqrt(b * b + 4.0 * c * abs(force))) / (2.0 * c), force)

    def rise_time(self, tau: float, share: float) -> float:
        """Return the time [s] from rest to the fraction *share* of the steady velocity under *tau*, without ``delta``
        and ``delay``.

        For linear drag it is ``alpha / beta`` at ``share = 1 - 1/e``. For quadratic drag it is ``alpha / sqrt(beta_nn
        |tau|)`` at ``tanh(1)`` (Miskovic2010, (7.8), (7.10)). The result is NaN if there is no steady velocity.
        """
        sign = math.copysign(1.0, self.alpha)
        b, c = sign * self.beta, sign * self.beta_quadratic
        rate = math.sqrt(max(b * b + 4.0 * c * abs(tau), 0.0))
        if rate <= 0.0 or rate + b <= 0.0:
            return math.nan
        return 2.0 * abs(self.alpha) / rate * math.atanh(share * rate / (rate + b - share * b))

    def equivalent_drag(self, amplitude: float) -> float:
        """Return the linear drag coefficient with the same first harmonic at the velocity *amplitude* (Miskovic2010
        (6.43)).
        """
        return self.beta + 8.0 / (3.0 * math.pi) * self.beta_quadratic * abs(amplitude)

    def to_dict(self) -> dict[str, Any]:
        """Return the model as data for a model file."""
        return {
            "schema": SCHEMA,
            "model": "single-dof",
            "dof": self.dof,
            "input_unit": self.input_unit,
            "alpha": self.alpha,
            "beta": self.beta,
            "beta_quadratic": self.beta_quadratic,
            "delta": self.delta,
            "delay": self.delay,
            **({"restoring": self.restoring} if self.restoring else {}),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> SingleDof:
        """Return the model that :meth:`to_dict` wrote as *data*.

        Raises
        ------
        BadFile
            Something is missing, of the wrong kind, or a number is out of range.
        """
        return cls.of_data(conformed(data, SingleDofData, "model"))

    @classmethod
    def of_data(cls, contents: SingleDofData) -> SingleDof:
        """Return the model that a file contains."""
        numbers = (
            contents.alpha,
            contents.beta,
            contents.beta_quadratic,
            contents.delta,
            contents.delay,
            contents.restoring,
        )
        return cls(contents.dof, contents.input_unit, *numbers)
