"""Common parts of the loops: firmware defaults, simulation with a craft, demands of position and velocity loops.

A new law defines a table of its parameters, their mapping to stages of the compiled :class:`.kernel.Cascade`, start
values of matching, transfer functions and notes. Its base class, :class:`PositionLoop` or :class:`VelocityLoop`,
defines the rest.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.control import ReferenceModel, wanted_step
from gcs_autotune.design.actuator import PERFECT, Actuator, ActuatorStep
from gcs_autotune.design.laws.kernel import (
    AT_REST,
    Cascade,
    LoopPlant,
    StartingVelocity,
    fly,
    gyro_coefficients,
    plant_of,
)
from gcs_autotune.design.laws.law import LoopMotion, Scenario, Settings, setting
from gcs_autotune.design.open_loop import Rational
from gcs_autotune.models import SingleDof

__all__ = ["PositionLoop", "VelocityLoop", "holding", "linearisations", "local_drag", "peak_demand", "start_of"]

Array = NDArray[np.float64]


class Loop(ABC):
    """Base class of the loops.

    Attributes
    ----------
    gyro : parameter with the gyro filter's cut-off [Hz]; empty if the velocity does not come from the gyro.
    """

    gyro: str = ""
    defaults: Settings
    free_overshoot = 0.0
    measured: Sequence[str] = ()
    late: Sequence[str] = ()

    def _get(self, settings: Settings, name: str) -> float:
        return setting(settings, self.defaults, name)

    def loop_period(self, settings: Settings) -> float:
        """Return the autopilot's loop period [s]."""
        return 1.0 / self._get(settings, "SCHED_LOOP_RATE")

    def matching_speed(self, settings: Settings, speed: float | None) -> float | None:
        """Return *speed*, because all terms of the loop act at any speed."""
        return speed

    def slopes(
        self, actuator: Actuator, model: SingleDof, step: float, settings: Settings, speed: float | None
    ) -> tuple[float, ...]:
        """Return the actuator's local gains for small motions."""
        return actuator.slopes()

    @abstractmethod
    def cascade(self, settings: Settings, speed: float | None, dt: float) -> Cascade:
        """Return the stages of the loop with *settings* at *speed*.

        dt : loop period [s]. A missing gain is 0.
        """

    def fly(
        self,
        settings: Settings,
        speed: float | None,
        duration: float,
        plant: LoopPlant,
        actuator: ActuatorStep,
        start: StartingVelocity = AT_REST,
    ) -> LoopMotion:
        """Return the motion of the loop, simulated for *duration* [s] from *start*."""
        dt = self.loop_period(settings)
        count = round(duration / dt) + 1
        position, output = np.empty(count), np.empty(count)
        gyro = gyro_coefficients(self._get(settings, self.gyro) if self.gyro else 0.0, 1.0 / dt)
        stages = (self.cascade(settings, speed, dt), gyro, plant, actuator, start)
        sent, memory = np.empty(int(start.before) + count), np.zeros(4)
        fly(*(_record(stage) for stage in stages), position, output, sent, memory)
        return LoopMotion(dt * np.arange(count, dtype=np.float64), position, output)


@lru_cache(maxsize=64)
def _dtype(fields: tuple[str, ...]) -> np.dtype[Any]:
    return np.dtype([(name, np.float64) for name in fields])


@lru_cache(maxsize=256, typed=True)  # one for each kind of tuple, although empty stages compare equal
def _record(values: Any) -> Any:
    """Convert a named tuple to a record of the same fields.

    For a named tuple, numba checks the type of every item at each call. A search for gains flies the same stages on the
    same craft in several steps.
    """
    return np.array(values, _dtype(values._fields))[()]


def peak_demand(model: SingleDof, wanted: ReferenceModel, step: float) -> tuple[float, float]:
    """Return the largest output [fraction] and the largest velocity, for following *wanted* exactly over *step*.

    Both follow from the inverse of the plant along the reference model's step, independent of the controller.
    """
    ideal = wanted_step(wanted, np.linspace(0.0, 12.0 / wanted.omega_0, 400))
    velocity, acceleration = step * ideal.velocity, step * ideal.acceleration
    drag = (model.beta + model.beta_quadratic * np.abs(velocity)) * velocity
    ahead = model.alpha * acceleration + drag + model.restoring * step * ideal.position
    return float(np.max(np.abs(ahead)) + abs(model.delta)), float(np.max(np.abs(velocity)))


@lru_cache(maxsize=1024)
def linearisations(model: SingleDof, wanted: ReferenceModel, step: float) -> tuple[float, ...]:
    """Return the values of linear drag for which stability is checked: at rest, and at half the peak velocity of
    the step.
    """
    moving = model.equivalent_drag(0.5 * peak_demand(model, wanted, step)[1])
    return (model.beta,) if model.beta_quadratic == 0.0 else (model.beta, moving)


class PositionLoop(Loop):
    """Base class of loops that control a position. The craft is at rest at the end of every step."""

    controls_velocity = False

    def demand(
        self, model: SingleDof, wanted: ReferenceModel, step: float, settings: Settings, speed: float | None
    ) -> tuple[float, float]:
        """Return the largest output [fraction] and the largest velocity, from :func:`peak_demand`."""
        return peak_demand(model, wanted, step)

    def drags(self, model: SingleDof, wanted: ReferenceModel, step: float, speed: float | None) -> tuple[float, ...]:
        """Return the values of linear drag for which stability is checked, from :func:`linearisations`."""
        return linearisations(model, wanted, step)

    def simulate(
        self,
        model: SingleDof,
        settings: Settings,
        scenario: Scenario,
        speed: float | None,
        delay: float,
        actuator: Actuator = PERFECT,
    ) -> LoopMotion:
        """Simulate a step of the loop with these settings on *model*, as *scenario* specifies."""
        dt = self.loop_period(settings)
        craft = plant_of(model, scenario, dt, delay, actuator)
        return self.fly(settings, speed, scenario.duration, craft, actuator.step(dt))


MIN_ROOM = 0.05
"""Smallest reserve of output that is assumed at the end of the step [normalised]. Project choice."""


def holding(model: SingleDof, velocity: float) -> float:
    """Return the force [fraction of full thrust] that keeps *model* at *velocity* [m/s or rad/s]."""
    return (model.beta + model.beta_quadratic * abs(velocity)) * velocity - model.delta


def local_drag(model: SingleDof, velocity: float) -> float:
    """Return the slope of the drag at *velocity*, which damps small motions about that velocity."""
    return model.beta + 2.0 * model.beta_quadratic * abs(velocity)


def start_of(step: float, base: float) -> float:
    """Return the velocity at which a step of size *step* starts:

    *base* for a positive step, ``base - step`` for a negative one.
    """
    return base if step >= 0.0 else base - step


class VelocityLoop(Loop):
    """Base class of loops that control a velocity.

    Attributes
    ----------
    both_ways : whether steps go from half their size in one direction to half their size in the other. Otherwise they
        start at the craft's speed.
    hold : time [s] for which a settled loop holds its velocity before the step.
    """

    controls_velocity = True
    both_ways = False
    hold: float

    def base(self, step: float, speed: float | None) -> float:
        """Return the velocity at which steps of size *step* start and to which they return."""
        return -0.5 * abs(step) if self.both_ways else speed or 0.0

    def demand(
        self, model: SingleDof, wanted: ReferenceModel, step: float, settings: Settings, speed: float | None
    ) -> tuple[float, float]:
        """Return the accelerating output, relative to the reserve of output at the end of the step, and the largest
        acceleration.
        """
        base = self.base(step, speed)
        ideal = wanted_step(wanted, np.linspace(0.0, 12.0 / wanted.omega_0, 400))
        acceleration = step * ideal.velocity
        room = max(1.0 - abs(holding(model, base + step)), MIN_ROOM)
        most = float(np.max(np.abs(acceleration)))
        velocity = base + step * ideal.position
        drag = (model.beta + model.beta_quadratic * np.abs(velocity)) * velocity - model.delta
        beyond = np.maximum(np.abs(model.alpha * acceleration + drag) - abs(holding(model, base + step)), 0.0)
        return float(np.max(beyond)) / room, most

    def drags(self, model: SingleDof, wanted: ReferenceModel, step: float, speed: float | None) -> tuple[float, ...]:
        """Return the slopes of the drag at the velocities before and after the step."""
        if model.beta_quadratic == 0.0:
            return (model.beta,)
        base = self.base(step, speed)
        return tuple(sorted({local_drag(model, base), local_drag(model, base + step)}))

    def holding_output(self, model: SingleDof, actuator: Actuator, settings: Settings, velocity: float) -> float:
        """Return the controller's output [fraction] that keeps *model* at *velocity*, limited to full output."""
        return min(max(holding(model, velocity), -1.0), 1.0)

    def output_behind(self, settings: Settings, sent: float) -> float:
        """Return the controller's output [fraction] for which the firmware sends *sent* [fraction] to the actuator."""
        return sent

    def simulate(
        self,
        model: SingleDof,
        settings: Settings,
        scenario: Scenario,
        speed: float | None,
        delay: float,
        actuator: Actuator = PERFECT,
    ) -> LoopMotion:
        """Simulate a step of the loop with these settings on *model*, as *scenario* specifies."""
        dt = self.loop_period(settings)
        velocity = start_of(scenario.step, self.base(scenario.step, speed))
        before = round(self.hold / dt) if scenario.lead == 0.0 else 0
        if scenario.start is None:
            start = StartingVelocity(velocity, self.holding_output(model, actuator, settings, velocity), before)
        else:
            output = self.output_behind(settings, scenario.start.output)
            start = StartingVelocity(velocity, output, 1, scenario.start.ahead)
        craft = plant_of(model, scenario, dt, delay)
        return self.fly(settings, speed, scenario.duration, craft, actuator.step(dt), start)

    def position_path(self, settings: Settings, speed: float | None) -> Rational:
        """Return the transfer function from measured velocity to output, which is the result of :meth:`controller`."""
        return self.controller(settings, speed)

    @abstractmethod
    def controller(self, settings: Settings, speed: float | None) -> Rational:
        """Return the transfer function from measured velocity to output."""
