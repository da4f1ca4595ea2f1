"""The hull and its data for ArduPilot's simulated sensors.

Roll and pitch of a hull that stays level are held at zero, because an attitude must not contradict the accelerometer. A
body that tilts sends its own. Sensor effects act where the interface allows: heading through ``attitude`` (compass),
rates through ``gyro``, speed and position through ``velocity`` and ``position`` (GPS, and pressure sensor for depth).
The accelerometer is always exact.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from sitl.ardupilot_json.wire import State
from sitl.battery import Battery
from sitl.catalogue import VehicleData
from sitl.craft import Craft
from sitl.effects import BadEffect, HiddenEffect
from sitl.modelfile import FlownModel
from sitl.plants import GRAVITY, measured_speed
from sitl.sensors import SensorReading

__all__ = ["Physics"]

_LONGEST_STEP = 0.02
"""Longest Runge-Kutta step of the hull [s], as in our own simulator. A longer frame is divided. Project choice."""
_FULL_BATTERY = 12.6
"""Open-circuit voltage [V]: the value of ArduPilot's SIM_BATT_VOLTAGE."""
_NOTHING = 1000.0
"""Distance [m] reported if no wall is ahead, beyond the range of the firmware's rangefinder. Project choice."""
_LEVEL = {"phi", "theta"}


class Physics:
    """One hull, initially at rest at home, at the surface, with the vehicle's own heading.

    Parameters
    ----------
    data : the vehicle's data file. seed : seed of the random effects.
    effects : hidden effects, in order.
    model : hull dynamics to fly instead of the vehicle's own.

    Raises
    ------
    BadEffect
        An effect cannot be passed to ArduPilot through this interface, or the vehicle has no place for it. The message
            states the reason.
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
        """Put a new hull at home, as ArduPilot does with its own models on a restart."""
        craft = Craft(self._data, effects=self._effects, model=self._model)
        craft.plant.state.z = 0.0
        for effect in craft.effects:
            _refuse(effect, tilts=craft.plant.state.tilts)
        craft.begin(str(self._seed))
        if not craft.plant.water.over_ground:
            raise BadEffect(
                "steady-current@through water cannot be simulated, because ArduPilot's GPS measures over ground. "
                "Omit the place"
            )
        self.craft = craft
        self._tells_true = not any(effect.overrides("alter_measurement") for effect in craft.effects)
        self._reading = SensorReading()
        self._battery = Battery()
        self._rangefinder = self._data.make_rangefinder(self._seed)
        self.seconds = 0.0
        self._pwm: Sequence[int] = [0] * 16
        self.state = State()
        self._tell((0.0, 0.0, -GRAVITY))

    def step(self, dt: float, pwm: Sequence[int]) -> State:
        """Advance by *dt* [s] under servo pulses *pwm* [us] and return the state to report, with sensor effects."""
        self._pwm = pwm
        count = max(1, math.ceil(dt / _LONGEST_STEP - 1e-9))
        force = [0.0, 0.0, 0.0]
        for _ in range(count):
            self.seconds += dt / count
            self.craft.move(self.seconds, dt / count, pwm)
            force = [total + part / count for total, part in zip(force, self.craft.plant.specific_force(), strict=True)]
        self._battery.drain(pwm, dt)
        self._tell((force[0], force[1], force[2]))
        return self.state

    @property
    def shares(self) -> dict[str, float]:
        """Axis -> normalised output (-1 to 1) commanded by the last pulses, before any effect."""
        return self.craft.actuators.read(self._pwm)

    def _velocity(self) -> tuple[float, float, float]:
        """Return the true velocity over ground (3,) [m/s]: north, east, down."""
        plant = self.craft.plant
        (u, v, w), psi = measured_speed(plant.state, plant.water), plant.state.psi
        c, s = math.cos(psi), math.sin(psi)
        return c * u - s * v, s * u + c * v, w

    def _tell(self, force: tuple[float, float, float]) -> None:
        """Compute the reported state from the true one and the sensor effects."""
        plant, state, reading = self.craft.plant, self.state, self._reading
        true = plant.state
        state.t = self.seconds
        state.voltage, state.current = self._battery.voltage(_FULL_BATTERY), self._battery.current
        state.force = force
        if self._rangefinder is not None:
            measured = self._rangefinder.measure(self.seconds, true)
            state.distances = tuple(_NOTHING if math.isnan(distance) else distance for distance in measured)
        if self._tells_true:
            state.gyro = (true.p, true.q, true.r) if true.tilts else (0.0, 0.0, true.r)
            tilt = (true.phi, true.theta) if true.tilts else (0.0, 0.0)
            state.attitude = (*tilt, math.remainder(true.psi, math.tau))
            state.position = (true.x, true.y, true.z)
            state.velocity = self._velocity()
            return
        reading.psi, reading.r = math.remainder(true.psi, math.tau), true.r
        reading.u, reading.v, reading.w = measured_speed(true, plant.water)
        reading.x, reading.y, reading.z = true.x, true.y, true.z
        reading.p, reading.q, reading.phi, reading.theta = (
            (true.p, true.q, true.phi, true.theta) if true.tilts else (0.0, 0.0, 0.0, 0.0)
        )
        self.craft.alter(self.seconds, reading)
        c, s = math.cos(true.psi), math.sin(true.psi)
        state.gyro = (reading.p, reading.q, reading.r)
        tilt = (reading.phi, reading.theta) if true.tilts else (0.0, 0.0)
        state.attitude = (*tilt, math.remainder(reading.psi, math.tau))
        state.position = (reading.x, reading.y, reading.z)
        state.velocity = (c * reading.u - s * reading.v, s * reading.u + c * reading.v, reading.w)


def _refuse(effect: HiddenEffect, *, tilts: bool) -> None:
    """Raise ``BadEffect`` if *effect* cannot be passed to ArduPilot, for a body that *tilts* or not."""
    if effect.overrides("alter_report"):
        raise BadEffect(
            f"{effect.slug} acts on the record, which ArduPilot itself writes under --ardupilot-json. Use this "
            "simulator's own autopilot (omit --ardupilot-json)"
        )
    level = _LEVEL.intersection(effect.place.split("+"))
    if level and not tilts:
        raise BadEffect(
            f"{effect.slug}@{effect.place} cannot be simulated, because roll and pitch are held level under "
            "--ardupilot-json"
        )
