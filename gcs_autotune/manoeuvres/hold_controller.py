"""Controllers that hold the other axes in manual mode.

They hold an ROV's depth during a heading relay, its heading during a depth relay, and a boat's heading during throttle
steps.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from gcs_autotune.craft import Actuate, Observation

__all__ = ["HELD_BEFORE", "HELD_DURING", "HeadingHold", "HoldController", "HoldGains", "hold"]


@dataclass(frozen=True, slots=True)
class HoldGains:
    """Gains of a slow PID controller: its signal, the signal's rate, the force it drives, and gains in fractions of
    full output. The loop is slow and well damped on craft that full output accelerates at 0.3 to 5 m/s^2 or rad/s^2.
    ``most`` is its largest output. Project choice.
    """

    signal: str
    rate: str
    force: str
    P: float = 0.4
    I: float = 0.03  # noqa: E741 - the integral gain's own name
    D: float = 0.4
    most: float = 0.5


_DEPTH = HoldGains("z", "w", "Z")
_HEADING = HoldGains("psi", "r", "N")

HELD_DURING: Mapping[str, tuple[HoldGains, ...]] = {
    "psi": (_DEPTH,),
    "z": (_HEADING,),
    "x": (_HEADING, _DEPTH),
    "y": (_HEADING, _DEPTH),
    "d": (_HEADING, _DEPTH),
    "phi": (_HEADING, _DEPTH),
    "theta": (_HEADING, _DEPTH),
}
"""Signal of a relay -> controllers of the signals that are held during the relay."""
HELD_BEFORE: Mapping[str, HoldGains] = {"z": _DEPTH}
"""Signal of a relay -> controller that holds the signal before the relay.

With neutral outputs a buoyant craft would rise to the surface, where it can move in one direction only.
"""


class HoldController:
    """Holds a signal at *reference*; NaN: at its value in the first observation.

    It is idle while the signal is unknown.
    """

    def __init__(self, gains: HoldGains, reference: float = math.nan) -> None:
        self._gains = gains
        self._reference = reference
        self._t = math.nan
        self._integral = 0.0

    @property
    def force(self) -> str:
        """Name of the force that the controller drives."""
        return self._gains.force

    @property
    def signal(self) -> str:
        """Name of the signal that the controller holds."""
        return self._gains.signal

    def demand(self, observation: Observation) -> float:
        """Return the output to apply now [fraction of full]."""
        g = self._gains
        x, rate = observation.value(g.signal), observation.value(g.rate)
        if not math.isfinite(x):
            return 0.0
        if math.isnan(self._reference):
            self._reference = x
        if math.isnan(self._t):
            self._t = observation.t
        error = self._reference - x
        self._integral += g.I * error * (observation.t - self._t)
        self._integral = max(-g.most, min(g.most, self._integral))
        self._t = observation.t
        wanted = g.P * error - (g.D * rate if math.isfinite(rate) else 0.0) + self._integral
        return max(-g.most, min(g.most, wanted))


def hold(command: Actuate, controllers: Iterable[HoldController], observation: Observation) -> Actuate:
    """Return *command* with the forces of *controllers* set to their outputs."""
    return replace(command, **{c.force: c.demand(observation) for c in controllers})


# --- a boat's rudder ----------------------------------------------------------------------------------------

RUDDER_GAIN = 0.2
"""Steering per heading error [1/rad] at 1 m/s. Project choice.

Above 1 m/s it is divided by the speed, because a rudder's effect grows with speed. The controller is purely
proportional. With a turning lag T and a turn rate K at full rudder it is damped while ``RUDDER_GAIN K T`` is below
about 1/2. This is sufficient for boats of K = 0.6 rad/s and T = 4 s.
"""
MOST_RUDDER = 0.4
CALMING = 0.5
"""Factor by which the heading hold multiplies its gain after every oscillation that is not clearly smaller than the
previous one. Project choice.
"""
LEAST_SHARE = 0.1
"""Lower limit of the heading hold's gain relative to :data:`RUDDER_GAIN`. Project choice."""
NOTED = math.radians(5.0)
"""Heading oscillation [rad] up to which the heading hold keeps its gain. Project choice."""


class HeadingHold:
    """Holds a boat on the heading of the first observation, and reduces its gain whenever the boat oscillates.

    The boat's own heading loop is not available in MANUAL, and its gains may be wrong.
    """

    def __init__(self) -> None:
        self._reference = math.nan
        self._share = 1.0
        self._side = 0.0
        self._peak = self._last_peak = 0.0

    def start(self, observation: Observation) -> None:
        """Use the present heading as the course."""
        self._reference = observation.psi

    def steer(self, observation: Observation) -> float:
        """Return the steering to apply now [fraction of full, positive to starboard]."""
        error = self._reference - observation.psi
        if not math.isfinite(error):
            return 0.0
        self._notice(error)
        speed = observation.speed if math.isfinite(observation.speed) else 1.0
        wanted = self._share * RUDDER_GAIN * error / max(speed, 1.0)
        return max(-MOST_RUDDER, min(MOST_RUDDER, wanted))

    def _notice(self, error: float) -> None:
        if error * self._side < 0.0:
            if self._peak > NOTED and self._peak > 0.8 * self._last_peak > 0.0:
                self._share = max(CALMING * self._share, LEAST_SHARE)
            self._last_peak, self._peak = self._peak, 0.0
        self._side = math.copysign(1.0, error) if error else self._side
        self._peak = max(self._peak, abs(error))
