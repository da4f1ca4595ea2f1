"""A craft without its autopilot: hull, actuators and hidden effects, in steps of any length."""

from __future__ import annotations

from collections.abc import Sequence

from sitl.body import Loads
from sitl.catalogue import VehicleData
from sitl.effects import Effect
from sitl.effects.aboard import describe_vehicle
from sitl.modelfile import FlownModel
from sitl.replaced import fit_model
from sitl.sensors import Reading

__all__ = ["Rig"]


class Rig:
    """The hull of a vehicle in its water, moved by servo pulses.

    Parameters
    ----------
    data : its data file.
    effects : hidden effects, in order.
    model : hull dynamics to fly instead of its own, with effects that come first. ``BadModel`` when it cannot.
    """

    def __init__(self, data: VehicleData, *, effects: Sequence[Effect] = (), model: FlownModel | None = None) -> None:
        self.data = data
        self.effects = (*(model.effects if model else ()), *effects)
        self.body = data.make_body()
        self.actuators = data.make_actuators()
        if model is not None:
            self.body, self.actuators = fit_model(model, self.body, self.actuators)
        self._loads = Loads()
        self._plain = self.body.axes()

    def begin(self, seed: str) -> None:
        """Let the effects begin; *seed* is that of their chances. ``BadEffect`` when there is no place for one."""
        for effect in self.effects:
            effect.begin(describe_vehicle(self, seed))

    def move(self, t: float, dt: float, pwm: Sequence[int]) -> None:
        """Let *dt* [s] pass, up to time *t* [s], under servo pulses *pwm* [us]."""
        if self.effects:
            self._drive_altered(t, dt, pwm)
        else:
            self.actuators.drive(pwm, self.body, self._loads)
        for effect in self.effects:
            effect.alter_force(t, self._loads)
            effect.alter_parameters(t, self.body)
        self.body.step(self._loads, dt)

    def alter(self, t: float, reading: Reading) -> None:
        """Let the effects at what the sensors tell."""
        for effect in self.effects:
            effect.alter_measurement(t, reading)

    def _drive_altered(self, t: float, dt: float, pwm: Sequence[int]) -> None:
        """Drive with what the effects make of *pwm*, on the hull's plain inertia and drag."""
        pulses = list(pwm)
        for effect in self.effects:
            effect.alter_command(t, pulses)
        shares = self.actuators.read(pulses)
        for effect in self.effects:
            effect.alter_input(t, dt, shares)
        self.body.set_axes(self._plain)
        self.actuators.apply(shares, self.body, self._loads)
