"""Our own loop in place of the autopilot's: carries out a set-point command by direct output."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Protocol

from gcs_autotune.control.feedback import FeedbackLaw
from gcs_autotune.craft import Actuate, Command, Observation
from gcs_autotune.sname import Dof

__all__ = ["OwnLoop", "SetPointLoop"]


class OwnLoop(Protocol):
    """What turns a set-point command into direct output, once per control tick."""

    def update(self, target: Command, now: Observation) -> Actuate:
        """Return the output that brings the craft to *target*."""


def _as_it_is(force: float) -> float:
    return force


class SetPointLoop:
    """The loop of one degree of freedom, for commands that name its position (``HeadingTarget``, ``DepthTarget``).

    Parameters
    ----------
    throttle : thrust ahead that a boat keeps [fraction of full].
    output : the inverse of the actuator, from the law's force to normalised output (Miskovic2010, fig. 8.2: actuator
        nonlinearity compensation).
    """

    def __init__(
        self, law: FeedbackLaw, dof: Dof, *, throttle: float = 0.0, output: Callable[[float], float] = _as_it_is
    ) -> None:
        self._dof, self._throttle, self._output = dof, throttle, output
        self._controller = law.started()
        self._value = self._t = math.nan

    def update(self, target: Command, now: Observation) -> Actuate:
        """Return the output; neutral in this degree of freedom while its position is unknown.

        Raises
        ------
        AttributeError
            The command is of another signal.
        """
        value = now.value(self._dof.position)
        if not math.isfinite(value):
            return Actuate(X=self._throttle)
        rate = now.value(self._dof.velocity)
        if not math.isfinite(rate):
            dt = now.t - self._t
            rate = (value - self._value) / dt if dt > 0.0 else 0.0
        self._value, self._t = value, now.t
        demand = self._controller.update(float(getattr(target, self._dof.position)), value, rate, now.t)
        return Actuate(**{"X": self._throttle, self._dof.force: self._output(demand)})
