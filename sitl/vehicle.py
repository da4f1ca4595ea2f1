"""The whole craft: hull, actuators, sensors, battery and autopilot, in steps of one autopilot loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from sitl.autopilot import FIRMWARE, Autopilot
from sitl.autopilot.generations import Spoken
from sitl.autopilot.parameters import ParameterStore
from sitl.battery import Battery
from sitl.catalogue import VehicleData
from sitl.effects import Effect
from sitl.modelfile import FlownModel
from sitl.rig import Rig
from sitl.sensors import Reading, Sensors

__all__ = ["TICKS_PER_SECOND", "Vehicle"]

TICKS_PER_SECOND = 50
"""SCHED_LOOP_RATE. Time is counted in whole ticks, so that stamps are exact."""
_DT = 1.0 / TICKS_PER_SECOND
_MS_PER_TICK = 1000 // TICKS_PER_SECOND


class Vehicle:
    """One craft in its own water.

    Parameters
    ----------
    data : its data file.
    seed : of all sensor noise.
    parameters : autopilot parameters set before boot, over those of the data file. ``KeyError`` when unknown.
    names : the firmware generation whose parameter names and units it uses towards the ground (``GENERATIONS``).
    effects : hidden effects, in order.
    model : hull dynamics to fly instead of its own, with effects that come first. ``BadModel`` when it cannot.
    """

    def __init__(
        self,
        data: VehicleData,
        *,
        seed: int = 0,
        parameters: Mapping[str, float] | None = None,
        effects: Sequence[Effect] = (),
        model: FlownModel | None = None,
        names: str = "own",
    ) -> None:
        self.rig = Rig(data, effects=effects, model=model)
        self.data = data
        self.effects, self.body, self.actuators = self.rig.effects, self.rig.body, self.rig.actuators
        self._make_autopilot, definitions = FIRMWARE[data.firmware]
        self.parameters = ParameterStore(definitions)
        for name, value in data.parameters.items():
            self.parameters.preset(name, value)
        self.spoken = Spoken(self.parameters, names, data.firmware)
        for name, value in (parameters or {}).items():
            self.spoken.preset(name, value)
        self.battery = Battery()
        self.tick = 0
        self._boot_tick = 0
        self._reading = Reading()
        self._sensors = Sensors(data.sensors, seed, floats=data.is_boat)
        self.autopilot = self._boot()
        self.rig.begin(str(seed))

    @property
    def ms(self) -> int:
        """Milliseconds since the autopilot booted."""
        return (self.tick - self._boot_tick) * _MS_PER_TICK

    @property
    def seconds(self) -> float:
        """Seconds since the simulation began."""
        return self.tick / TICKS_PER_SECOND

    def move(self) -> None:
        """Let one tick pass in the water, under the pulses of the last loop, and sample the sensors."""
        self.tick += 1
        pwm: Sequence[int] = self.autopilot.pwm
        t = self.seconds
        self.rig.move(t, _DT, pwm)
        self.battery.drain(pwm, _DT)
        self._sensors.sample(self.body, self._reading)
        self.rig.alter(t, self._reading)

    def control(self) -> None:
        """Let the autopilot run its loop on that sample."""
        voltage = self.battery.voltage(self.parameters["SIM_BATT_VOLTAGE"])
        self.autopilot.tick(self.ms, self._reading, voltage, self.battery.consumed_mah)

    def reboot(self) -> None:
        """Restart the autopilot: its clock at zero, disarmed, parameters kept."""
        self._boot_tick = self.tick
        self.autopilot = self._boot()

    def _boot(self) -> Autopilot:
        return self._make_autopilot(self.parameters, _DT, round(1000.0 * self.data.ready_time))
