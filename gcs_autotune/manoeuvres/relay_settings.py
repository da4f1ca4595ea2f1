"""What a relay experiment is to be: signal and force, sizes, when it is settled, when it is given up."""

from __future__ import annotations

import math
from dataclasses import dataclass

from gcs_autotune.errors import UsageError

__all__ = ["RelaySettings"]


@dataclass(frozen=True, slots=True)
class RelaySettings:
    """What to fly. Outputs are fractions of full actuator output; angles rad, lengths m, times s.

    Attributes
    ----------
    signal, force : what is watched (``psi``, ``z`` or ``x`` for integrated surge speed) and what is driven.
    output : relay output C; None lets it start at ``first_output`` and grow by ``growth`` up to ``most_output``.
    hysteresis : switching value x_a; None takes ``least_hysteresis`` or five times the measured noise.
    throttle : constant thrust ahead during the experiment (a boat's rudder needs way on).
    reference_speed : speed [m/s] around which a surge relay swings.
    keep_still : hold an ROV's other axes (heading, depth) by hand meanwhile.
    periods, tolerance : the stop rule.
    unsettled_periods, most_widenings : after so many periods that do not settle, a hysteresis that was not
        given is widened by ``growth``, so many times at most.
    patience : longest time without a switching [s].
    least_period : shortest oscillation [s] that the link can carry; a quicker one is widened, then refused.

    Raises
    ------
    UsageError
        An output is not within 0 to 1, a hysteresis not above 0, or a number not finite.
    """

    signal: str
    force: str
    output: float | None = None
    hysteresis: float | None = None
    throttle: float = 0.0
    reference_speed: float = 0.0
    keep_still: bool = False
    first_output: float = 0.3
    growth: float = 1.5
    most_output: float = 0.9
    least_hysteresis: float = math.radians(10.0)
    periods: int = 5
    tolerance: float = 0.10
    most_periods: int = 30
    unsettled_periods: int = 10
    most_widenings: int = 2
    patience: float = 30.0
    least_period: float = 0.0

    def __post_init__(self) -> None:
        """See that a relay can be made of it: it switches, and pushes no harder than there is."""
        for name in ("output", "first_output", "most_output"):
            value = getattr(self, name)
            if value is not None and not 0.0 < value <= 1.0:
                raise UsageError(
                    f"relay: {name} is {value:g}; it is a fraction of full output, above 0 and up to 1"
                    + (f" beside a throttle of {self.throttle:g}" if self.throttle else "")
                )
        for name in ("hysteresis", "least_hysteresis"):
            value = getattr(self, name)
            if value is not None and not 0.0 < value < math.inf:
                raise UsageError(f"relay: {name} is {value:g}; a relay switches at a finite value above 0")
        if not (abs(self.throttle) <= 1.0 and math.isfinite(self.reference_speed)):
            raise UsageError(f"relay: throttle {self.throttle:g}, speed {self.reference_speed:g} m/s: no such numbers")
