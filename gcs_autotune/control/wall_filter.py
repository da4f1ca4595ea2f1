"""The Kalman filter of distance keeping: angle and distance to a flat wall, and the speeds that nothing measures.

Miskovic2010, section 8.2.1, eq. (8.31)-(8.40) and table 8.2. Erratum of (8.38): the derivative of ``d`` by the angle,
``u sin(phi)``, belongs into the column of ``phi``; the heading has no disturbance of its own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.models import SingleDof
from gcs_autotune.sname import wrap

__all__ = ["WallEstimate", "WallFilter", "WallReading"]

Array = NDArray[np.float64]

U, R, PHI, PSI, D, V_PHI, V_D = range(7)
_DEGREE = math.radians(1.0)

_UNITS = np.diag([1.0, _DEGREE**2, _DEGREE**2, _DEGREE**2, 1.0, _DEGREE**2, 1.0])
"""Squared units of the states where Miskovic2010 counts in m and degrees."""
PROCESS_NOISE = 0.1 * _UNITS
"""Q per step of 0.1 s, Miskovic2010, section 8.2.1."""
STEP = 0.1
"""Control period that :data:`PROCESS_NOISE` belongs to [s]; it grows in proportion to the time passed."""
MEASUREMENT_NOISE = (0.5 * _DEGREE**2, 10.0 * _DEGREE**2, 0.1)
"""Variances of angle [rad^2], heading [rad^2] and distance [m^2], Miskovic2010, section 8.2.1."""
START = 1000.0 * _UNITS
"""P_0: so large that the first measurements decide, Miskovic2010, section 8.2.1."""


@dataclass(frozen=True, slots=True)
class WallReading:
    """What sensors report at one tick: heading *psi* [rad], always; distance *d* [m] and angle *phi* [rad] to the wall.

    ``d`` and ``phi`` are NaN between two measurements of the rangefinder and while it sees nothing.
    """

    psi: float
    d: float = math.nan
    phi: float = math.nan

    @classmethod
    def of_two(cls, psi: float, port: float, starboard: float, apart: float) -> WallReading:
        """Return the reading of two rangefinders ahead, *apart* [m]; NaN where one of them sees nothing.

        Miskovic2010, eq. (3.7)-(3.8). (3.7) prints the complement of the angle, 90 deg at right angles to the wall; the
        controller and (2.43) use 0 for that. The distance is along the normal of the wall, as in (8.35).
        """
        phi = math.atan2(starboard - port, apart)
        return cls(psi, 0.5 * (port + starboard) * math.cos(phi), phi)

    @property
    def sees_wall(self) -> bool:
        """Whether distance and angle are measured."""
        return math.isfinite(self.d) and math.isfinite(self.phi)


@dataclass(frozen=True, slots=True)
class WallEstimate:
    """State of the filter, SI and radians: speed ahead, turn rate, angle, heading, distance, two drift rates."""

    u: float
    r: float
    phi: float
    psi: float
    d: float
    v_phi: float
    v_d: float


class WallFilter:
    """Extended Kalman filter with seven states, run at every control tick.

    Parameters
    ----------
    surge, yaw : identified motions; their inputs are what :meth:`predict` receives.
    """

    def __init__(self, surge: SingleDof, yaw: SingleDof) -> None:
        self._surge, self._yaw = surge, yaw
        self._x = np.zeros(7)
        self._P = START.copy()
        self._is_set = False

    @property
    def estimate(self) -> WallEstimate:
        """The present estimate."""
        return WallEstimate(*(float(value) for value in self._x))

    @property
    def std(self) -> WallEstimate:
        """Standard deviations of the estimate."""
        return WallEstimate(*(float(math.sqrt(max(value, 0.0))) for value in np.diag(self._P)))

    def predict(self, X: float, N: float, dt: float) -> None:
        """Advance by *dt* [s] under surge force *X* and yaw moment *N*, in the units of the models."""
        if not self._is_set or dt <= 0.0:
            return
        u, r, phi, _, _, v_phi, v_d = self._x
        surge, yaw = self._surge, self._yaw
        A = np.eye(7)
        A[U, U] -= dt * (surge.beta + 2.0 * surge.beta_quadratic * abs(u)) / surge.alpha
        A[R, R] -= dt * (yaw.beta + 2.0 * yaw.beta_quadratic * abs(r)) / yaw.alpha
        A[PHI, R] = A[PSI, R] = A[PHI, V_PHI] = dt
        A[D, U], A[D, PHI], A[D, V_D] = -dt * math.cos(phi), dt * u * math.sin(phi), dt
        self._x += dt * np.array(
            [
                surge.acceleration(u, X),
                yaw.acceleration(r, N),
                r + v_phi,
                r,
                -u * math.cos(phi) + v_d,
                0.0,
                0.0,
            ]
        )
        self._P = A @ self._P @ A.T + PROCESS_NOISE * (dt / STEP)

    def correct(self, reading: WallReading) -> None:
        """Use what was measured at this tick; the heading alone where the wall is not seen."""
        if not self._is_set:
            if not reading.sees_wall:
                return
            self._x[PHI], self._x[PSI], self._x[D] = reading.phi, reading.psi, reading.d
            self._is_set = True
        rows = [PHI, PSI, D] if reading.sees_wall else [PSI]
        residuals = {
            PHI: wrap(reading.phi - self._x[PHI]),
            PSI: wrap(reading.psi - self._x[PSI]),
            D: reading.d - self._x[D],
        }
        noise = dict(zip((PHI, PSI, D), MEASUREMENT_NOISE, strict=True))
        H, R_rows = np.eye(7)[rows], np.diag([noise[row] for row in rows])
        gain = np.linalg.solve(H @ self._P @ H.T + R_rows, H @ self._P).T
        self._x += gain @ np.array([residuals[row] for row in rows])
        # Joseph's form: (I - K H) P alone loses its symmetry within minutes, because speed and drift of the distance
        # are distinguished only by the drag, so that their variances keep growing
        left = np.eye(7) - gain @ H
        self._P = left @ self._P @ left.T + gain @ R_rows @ gain.T
