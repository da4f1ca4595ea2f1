"""The whole craft: hull, actuators, sensors, battery and autopilot, in steps of one autopilot loop.

A loop corresponds to the firmware's main loop: 50 a second on Rover, 400 on Sub (SCHED_LOOP_RATE). Real firmware
processes sticks, failsafes and battery at 50 Hz at any loop rate. The simulator processes them at
:data:`~sitl.autopilot.SLOW_RATE`. Sensor noise is updated at the same rate, so that it does not depend on the loop
rate.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from sitl.autopilot import FIRMWARE, SLOW_RATE, Autopilot, ParameterDialect, ParameterStore, loop_rate
from sitl.battery import Battery
from sitl.catalogue import VehicleData
from sitl.craft import Craft
from sitl.effects import HiddenEffect
from sitl.estimator import Estimator
from sitl.instruments import Suite
from sitl.modelfile import FlownModel
from sitl.plants import State
from sitl.sensors import SensorReading, Sensors

__all__ = ["Vehicle"]


class Vehicle:
    """One craft in its own water.

    Parameters
    ----------
    data : the vehicle's data file.
    seed : seed of all sensor noise. parameters : autopilot parameters set before boot, in addition to those of the data
        file. ``KeyError`` if a name is unknown. names : the firmware generation whose parameter names and units the
        vehicle uses over MAVLink (``GENERATIONS``).
    effects : hidden effects, in order.
    model : hull dynamics to fly instead of the vehicle's own. Its effects are applied first. ``BadModel`` if this is
    not possible.

    ``rate`` [Hz] is the rate of the autopilot's loop. Time is counted in whole ticks, so that time stamps are exact.
    ``card``: path -> content of the files on the SD card. ``folders``: its folders.
    """

    def __init__(
        self,
        data: VehicleData,
        *,
        seed: int = 0,
        parameters: Mapping[str, float] | None = None,
        effects: Sequence[HiddenEffect] = (),
        model: FlownModel | None = None,
        names: str = "own",
    ) -> None:
        self.card: dict[str, bytes] = {}
        self.folders = ("APM", "APM/LOGS", "APM/scripts")
        self.craft = Craft(data, effects=effects, model=model)
        self.data = data
        self.effects, self.plant, self.actuators = self.craft.effects, self.craft.plant, self.craft.actuators
        self._make_autopilot, definitions = FIRMWARE[data.firmware]
        self.parameters = ParameterStore(definitions)
        for name, value in data.parameters.items():
            self.parameters.preset(name, value)
        self.dialect = ParameterDialect(self.parameters, names, data.firmware)
        for name, value in (parameters or {}).items():
            self.dialect.preset(name, value)
        self.rate = loop_rate(self.parameters)
        self._dt = 1.0 / self.rate
        self._slowly = self.rate // SLOW_RATE
        self.battery = Battery(data.battery)
        self.tick = 0
        self._boot_tick = 0
        self._reading = SensorReading()
        self._sensors = Sensors(data.sensors, seed, floats=data.is_boat)
        self.rangefinder = data.make_rangefinder(seed)
        self.suite = Suite(data.make_instruments(seed))
        self._estimator = Estimator(self.suite.instruments, self.state, data.filter_model)
        self.autopilot = self._boot()
        self.craft.begin(str(seed))

    @property
    def state(self) -> State:
        """The true state of the plant."""
        return self.plant.state

    @property
    def ms(self) -> int:
        """Milliseconds since the autopilot booted."""
        return (self.tick - self._boot_tick) * 1000 // self.rate

    @property
    def boot_us(self) -> int:
        """Microseconds since the autopilot booted."""
        return (self.tick - self._boot_tick) * 1_000_000 // self.rate

    @property
    def us(self) -> int:
        """Microseconds since the simulation began."""
        return self.tick * 1_000_000 // self.rate

    @property
    def seconds(self) -> float:
        """Seconds since the simulation began, as a fraction."""
        return self.tick / self.rate

    @property
    def has_motion_sensor(self) -> bool:
        """Whether a GPS or DVL measures position or velocity. Without one ArduPilot's filter reports zero for both."""
        return self.autopilot.has_gps or "dvl" in self.suite.instruments

    def move(self) -> None:
        """Advance the plant by one tick under the pulses of the last loop, and sample the sensors."""
        self.tick += 1
        pwm: Sequence[int] = self.autopilot.pwm
        t, dt = self.seconds, self._dt
        self.craft.move(t, dt, pwm)
        slowly = self._slowly
        new = self.tick % slowly == 0
        if new:
            derating = self.craft.derating
            self.battery.drain(pwm, slowly * dt, derating.current if derating and self.data.battery else None)
        self._sensors.sample(self.plant, self._reading, new=new)
        if self.rangefinder is not None:
            distances = self.rangefinder.measure(t, self.state)
            self._reading.d, self._reading.d_starboard = distances[0], distances[-1]
        self.suite.step(t, dt, self.plant, self.battery.current)
        if self.suite.instruments:
            self._estimator.update(t, self._reading, self.actuators.read(pwm).get("N", 0.0))
        self.craft.alter(t, self._reading)
        if not self.has_motion_sensor:
            self._reading.x = self._reading.y = self._reading.u = self._reading.v = 0.0

    def control(self) -> None:
        """Run the autopilot's loop on the last sample."""
        voltage = self.battery.voltage(self.parameters["SIM_BATT_VOLTAGE"])
        self.autopilot.aided = self.has_motion_sensor and self._estimator.aided
        self.autopilot.tick(self.ms, self._reading, voltage, self.battery.consumed_mah)

    def reboot(self) -> None:
        """Restart the autopilot: its clock at zero, disarmed, parameters and mission kept."""
        self._boot_tick = self.tick
        items = self.autopilot.mission.items
        self.autopilot = self._boot()
        self.autopilot.mission.store(items)

    def _boot(self) -> Autopilot:
        autopilot = self._make_autopilot(self.parameters, self._dt, round(1000.0 * self.data.ready_time))
        autopilot.tilts = self.plant.state.tilts
        self._estimator.has_gps = autopilot.has_gps
        return autopilot
