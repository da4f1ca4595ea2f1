"""The hull, and what it looks like to ArduPilot's simulated sensors.

Roll and pitch are held at zero: our hulls have no dynamics there, and an attitude that the accelerometer does not
bear out would be worse than none. Sensor effects reach ArduPilot where they can: the heading through ``attitude``
(its compass), rates through ``gyro``, speed and position through ``velocity`` and ``position`` (its GPS; its pressure
sensor for depth). The accelerometer always tells the truth.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from sitl.ardupilot_json.wire import State
from sitl.battery import Battery
from sitl.catalogue import VehicleData
from sitl.effects import BadEffect, HiddenEffect
from sitl.modelfile import FlownModel
from sitl.plant import SimulatedPlant
from sitl.sensors import SensorReading

__all__ = ["Physics"]

_GRAVITY = 9.80665
"""ArduPilot's GRAVITY_MSS."""
_LONGEST_STEP = 0.02
"""Chosen: of the hull's Runge-Kutta [s], as in our own simulator; a longer frame is cut."""
_FULL_BATTERY = 12.6
"""Open-circuit voltage [V]: ArduPilot's SIM_BATT_VOLTAGE."""
_LEVEL = {"phi", "theta"}


class Physics:
    """One hull, from rest at home, at the surface, on the vehicle's own heading.

    Parameters
    ----------
    data : its data file.
    seed : of the chances in effects.
    effects : hidden effects, in order.
    model : hull dynamics to fly instead of its own.

    Raises
    ------
    BadEffect
        An effect cannot reach ArduPilot this way, or the vehicle has no place for it; the message says why.
    BadModel
        The vehicle cannot fly the model.
    """

    def __init__(
        self,
        data: VehicleData,
        *,
        seed: int = 0,
        effects: Sequence[HiddenEffect] = (),
        model: FlownModel | None = None,
    ) -> None:
        self._data, self._seed, self._effects, self._model = data, seed, tuple(effects), model
        self.restart()

    def restart(self) -> None:
        """Put a new hull at home, as a restart of ArduPilot does with its own models."""
        plant = SimulatedPlant(self._data, effects=self._effects, model=self._model)
        plant.body.z = 0.0
        for effect in plant.effects:
            _refuse(effect)
        plant.begin(str(self._seed))
        if not plant.body.over_ground:
            raise BadEffect("steady-current@through water: ArduPilot's GPS measures over ground; leave the place away")
        self.plant = plant
        self._tells_true = not any(effect.overrides("alter_measurement") for effect in plant.effects)
        self._reading = SensorReading()
        self._battery = Battery()
        self.seconds = 0.0
        self._pwm: Sequence[int] = [0] * 16
        self.state = State()
        self._tell((0.0, 0.0, 0.0))

    def step(self, dt: float, pwm: Sequence[int]) -> State:
        """Let *dt* [s] pass under servo pulses *pwm* [us] and return what it looks like then."""
        body, before = self.plant.body, self._velocity()
        self._pwm = pwm
        psi_before = body.psi
        count = max(1, math.ceil(dt / _LONGEST_STEP - 1e-9))
        for _ in range(count):
            self.seconds += dt / count
            self.plant.move(self.seconds, dt / count, pwm)
        self._battery.drain(pwm, dt)
        after = self._velocity()
        north, east, down = ((b - a) / dt for a, b in zip(before, after, strict=True))
        psi = 0.5 * (psi_before + body.psi)
        c, s = math.cos(psi), math.sin(psi)
        self._tell((c * north + s * east, c * east - s * north, down))
        return self.state

    @property
    def shares(self) -> dict[str, float]:
        """What the last pulses ask of each axis, as shares of full, before any effect."""
        return self.plant.actuators.read(self._pwm)

    def _velocity(self) -> tuple[float, float, float]:
        """Return the true velocity over ground (3,) [m/s]: north, east, down."""
        body = self.plant.body
        u, v, c, s = body.speed, body.drift, math.cos(body.psi), math.sin(body.psi)
        return c * u - s * v, s * u + c * v, body.w

    def _tell(self, acceleration: tuple[float, float, float]) -> None:
        """Fill the state from the truth, or from what the sensor effects make of it."""
        body, state, reading = self.plant.body, self.state, self._reading
        state.t = self.seconds
        state.voltage, state.current = self._battery.voltage(_FULL_BATTERY), self._battery.current
        state.force = (acceleration[0], acceleration[1], acceleration[2] - _GRAVITY)
        if self._tells_true:
            state.gyro = (0.0, 0.0, body.r)
            state.attitude = (0.0, 0.0, math.remainder(body.psi, math.tau))
            state.position = (body.x, body.y, body.z)
            state.velocity = self._velocity()
            return
        reading.psi, reading.r, reading.u, reading.v = (
            math.remainder(body.psi, math.tau),
            body.r,
            body.speed,
            body.drift,
        )
        reading.x, reading.y, reading.z, reading.w = body.x, body.y, body.z, body.w
        reading.p = reading.q = 0.0
        self.plant.alter(self.seconds, reading)
        c, s = math.cos(body.psi), math.sin(body.psi)
        state.gyro = (reading.p, reading.q, reading.r)
        state.attitude = (0.0, 0.0, math.remainder(reading.psi, math.tau))
        state.position = (reading.x, reading.y, reading.z)
        state.velocity = (c * reading.u - s * reading.v, s * reading.u + c * reading.v, reading.w)


def _refuse(effect: HiddenEffect) -> None:
    """Raise ``BadEffect`` when ArduPilot cannot be shown *effect*."""
    if effect.overrides("alter_report"):
        raise BadEffect(
            f"{effect.slug} sits in the record, and under --ardupilot-json ArduPilot itself writes the record; "
            "hide it in our own simulator (leave --ardupilot-json away)"
        )
    level = _LEVEL.intersection(effect.place.split("+"))
    if level:
        raise BadEffect(f"{effect.slug}@{effect.place}: roll and pitch are held level under --ardupilot-json")
