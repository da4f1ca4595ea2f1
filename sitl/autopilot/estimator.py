"""What the autopilot believes: the sensors' reading through its own filters."""

from __future__ import annotations

import math

from sitl.autopilot.parameters import ParameterStore
from sitl.autopilot.shaping import TwoPoleLowPass
from sitl.sensors import SensorReading

__all__ = ["StateEstimate"]


class StateEstimate:
    """The attitude and position estimate. SI, radians, NED; ``yaw`` is not filtered, ``yaw_rate`` is.

    ``yaw_rate`` lags by the gyro filter (INS_GYRO_FILTER): 4 Hz on Rover, which is about 55 ms. ``climb`` and
    ``climb_acceleration`` point up.
    """

    def __init__(self, parameters: ParameterStore) -> None:
        self._values = parameters.values
        self._gyro = TwoPoleLowPass()
        self._accelerometer = TwoPoleLowPass()
        self.roll = self.pitch = self.yaw = 0.0
        self.roll_rate = self.pitch_rate = self.yaw_rate = 0.0
        self.speed = 0.0
        self.x = self.y = self.z = 0.0
        self._sway = self.vz = 0.0
        self.climb = self.climb_acceleration = 0.0
        self.distance = math.nan

    def update(self, reading: SensorReading, dt: float) -> None:
        """Take in one sample of the sensors."""
        values = self._values
        self.roll, self.pitch, self.yaw = reading.phi, reading.theta, reading.psi
        self.roll_rate, self.pitch_rate = reading.p, reading.q
        self.yaw_rate = self._gyro.apply(reading.r, values["INS_GYRO_FILTER"], dt)
        self.speed = reading.u
        self.x, self.y, self.z = reading.x, reading.y, reading.z
        self._sway, self.vz = reading.v, reading.w
        self.distance = reading.d
        self.climb = -reading.w
        self.climb_acceleration = self._accelerometer.apply(-reading.az, values["INS_ACCEL_FILTER"], dt)

    @property
    def vx(self) -> float:
        """The velocity to the north [m/s]."""
        return self.speed * math.cos(self.yaw) - self._sway * math.sin(self.yaw)

    @property
    def vy(self) -> float:
        """The velocity to the east [m/s]."""
        return self.speed * math.sin(self.yaw) + self._sway * math.cos(self.yaw)
