"""Settings of a relay experiment and the names of its options."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from gcs_autotune.errors import UsageError

__all__ = ["OF_A_TUNE", "OptionNames", "RelaySettings"]


class OptionNames(NamedTuple):
    """Names of the options that set a relay's size, for use in advice."""

    output: str = "--relay-output"
    hysteresis: str = "--relay-hysteresis"


OF_A_TUNE = OptionNames()
"""Names of the options of ``tune`` and ``experiment``."""


@dataclass(frozen=True, slots=True)
class RelaySettings:
    """Settings of a relay. Outputs are normalised; angles rad, lengths m, times s.

    Attributes
    ----------
    signal, force : the feedback signal (``psi``, ``z``, ``d``; ``x``, ``y`` for integrated surge and sway speed) and
        the driven force.
    output : relay output C; None: start at ``first_output`` and grow by ``growth`` up to ``most_output``.
    hysteresis : switching value x_a; None: ``least_hysteresis`` or five times the measured noise.
    throttle : constant thrust ahead during the experiment (a boat's rudder needs speed).
    reference_speed : mean speed of a surge relay [m/s].
    keep_still : hold an ROV's other axes (heading, depth).
    periods, tolerance : number of consecutive periods that must agree, and their relative tolerance.
    unsettled_periods, most_widenings : after this many unsettled periods an automatic hysteresis is widened by
        ``growth``, at most this many times.
    patience : longest time without a switching [s].
    least_distance : smallest distance to a wall ahead [m], for a relay on ``d``.
    noise_std : noise of the signal, if known; then there is no approach.
    least_period : shortest period [s] that the link can resolve; for a shorter one the hysteresis is increased, then
        the relay is rejected.
    names : names of output and hysteresis in the present command.

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
    least_distance: float = 0.0
    noise_std: float | None = None
    names: OptionNames = OF_A_TUNE

    def __post_init__(self) -> None:
        """Check that the settings form a relay: it switches, and its output is not above full output."""
        for name in ("output", "first_output", "most_output"):
            value = getattr(self, name)
            if value is not None and not 0.0 < value <= 1.0:
                raise UsageError(
                    f"relay: {name} is {value:g}. It must be a normalised output above 0, at most 1"
                    + (f" with a throttle of {self.throttle:g}" if self.throttle else "")
                )
        for name in ("hysteresis", "least_hysteresis"):
            value = getattr(self, name)
            if value is not None and not 0.0 < value < math.inf:
                raise UsageError(f"relay: {name} is {value:g}. The hysteresis must be finite and above 0")
        if not (abs(self.throttle) <= 1.0 and math.isfinite(self.reference_speed)):
            raise UsageError(f"relay: throttle {self.throttle:g} or speed {self.reference_speed:g} m/s is out of range")
