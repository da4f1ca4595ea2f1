"""The specification of a loop, with further inputs of its design."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass, field

import numpy as np

from gcs_autotune.control import REFERENCE_MODELS
from gcs_autotune.design.laws import LoopStart
from gcs_autotune.errors import UsageError
from gcs_autotune.registry import lookup

__all__ = ["STYLES", "STYLE_STEPS", "Spec", "Style", "style_number", "style_of"]


@dataclass(frozen=True, slots=True)
class Style:
    """How much of what a loop could do is used.

    ``bandwidth``: relative to the fastest loop that keeps the margins. ``gain_margin`` (ratio) and ``phase_margin``
    [rad]: smallest ones over the 95 % region.
    """

    bandwidth: float
    gain_margin: float
    phase_margin: float

    @property
    def slower(self) -> float:
        """Factor by which its ITAE may exceed that of other gains: the ITAE of a step grows with the square of time."""
        return 1.0 / self.bandwidth**2

    def __str__(self) -> str:
        """Return its numbers in words."""
        return (
            f"{self.bandwidth:.0%} of the bandwidth of the fastest loop with a gain margin of {self.gain_margin:.3g} "
            f"and a phase margin of {math.degrees(self.phase_margin):.0f} deg"
        )


STYLES: Mapping[str, Style] = {
    "gentle": Style(0.5, 3.5, math.radians(60.0)),
    "normal": Style(1.0, 2.5, math.radians(45.0)),
    "quick": Style(1.0, 2.0, math.radians(35.0)),
}
"""Name -> style. Project choice: the margins of ``quick`` are near the least that any proposal may have."""
NORMAL = STYLES["normal"]
STYLE_STEPS = ("gentle", "12", "25", "38", "normal", "62", "75", "88", "quick")
"""Styles that are compared, from slow to fast. Between two of them a predicted step changes little. Project choice."""


def style_number(name: str) -> float:
    """Return the place of a style between 0 (gentle) and 100 (quick). *name*: one in :data:`STYLES`, or the number.

    Raises
    ------
    UsageError
        It is neither.
    """
    if name in STYLES:
        return 100.0 * list(STYLES).index(name) / (len(STYLES) - 1)
    try:
        number = float(name)
    except ValueError:
        number = math.nan
    if not 0.0 <= number <= 100.0:
        raise UsageError(f"unknown style '{name}'. Use {', '.join(STYLES)}, or a number from 0 (gentle) to 100 (quick)")
    return number


def style_of(name: str) -> Style:
    """Return the style called *name*, as for :func:`style_number`.

    The settings of a number lie on straight lines between those of the neighbouring names.

    Raises
    ------
    UsageError
        There is no such style.
    """
    at, known = style_number(name), np.linspace(0.0, 100.0, len(STYLES))
    return Style(*(float(np.interp(at, known, each)) for each in zip(*map(astuple, STYLES.values()), strict=True)))


@dataclass(frozen=True, slots=True)
class Spec:
    """Specification of a loop; everything except ``step`` is optional.

    Attributes
    ----------
    step : size of the step [rad or m] to design for; None: 30 deg or 1 m.
    kind : family in ``REFERENCE_MODELS``.
    omega_0 : characteristic frequency [rad/s]; None: the design selects the fastest acceptable one.
    settling_time : to 5 % [s], instead of ``omega_0``.
    speed : speed over ground [m/s] at which the model was identified; axes with ``needs_speed`` need it.
    full_scale : model input at full actuator output; None for models identified in fractions (unit ``1``).
    step_duration : recorded duration [s] of each flown step; predictions then start and last as flown. None: steps of
        a settled loop, as long as they take.
    windows : recorded durations [s] of step and step back with the present gains; empty: ``step_duration``.
    settled_band, settled_time : a flown half ends when the signal has been within ``settled_band`` [rad or m] of its
        target for ``settled_time`` [s]. The reported metrics are of these halves. Gains are selected over
        ``step_duration``, and must be better than the present ones over these halves too.
    settled_least : value [s] that replaces ``settled_time`` if signal and output are at rest by then.
    hold : time [s] for which the craft is held before the step, by a loop whose integral is zero at first. 0: a settled
        loop.
    start : state in which a velocity loop with the present gains began the flown step; None: a settled loop. Reported
        metrics of the present gains start from it.
    noise_std : measurement noise of the position [rad or m], white up to ``noise_bandwidth`` [Hz].
    jitter_std : standard deviation [rad or m] of the noise component that changes from sample to sample and therefore
        moves the actuator. None: all of ``noise_std``.
    noise_bandwidth : half the rate at which ``noise_std`` was measured [Hz].
    quantum : smallest step of the position's sensor [rad or m]. Errors up to this size count as zero.
    link_delay : amount of the identified delay [s] that is in the telemetry link, not in the autopilot's loop.
    loop_delay : additional delay [s] of autopilot and actuator, beyond the identified one; None: 1.5 loop periods.
    gain_margin, phase_margin : smallest acceptable values over the 95 % region, ratio and [rad].
    bandwidth : that of a loop whose speed the design selects, relative to the fastest one; at most 1.
    actuator_use : largest output for the required step, normalised.
    measured : parameters that are set to measured values instead of being designed.
    skid : whether the craft steers by the difference of two thrusters.
    beyond_ranges : whether gains may leave their documented ranges, with the same margins.
    throttle : throttle [fraction of full] at which a boat with vectored thrust, or with two thrusters, was identified;
        0 if unknown or not applicable.
    """

    step: float | None = None
    kind: str = "bessel"
    omega_0: float | None = None
    settling_time: float | None = None
    speed: float | None = None
    full_scale: float | None = None
    step_duration: float | None = None
    windows: Sequence[float] = ()
    settled_band: float = math.inf
    settled_time: float = math.inf
    settled_least: float = math.inf
    hold: float = 3.0
    start: LoopStart | None = None
    noise_std: float = 0.0
    jitter_std: float | None = None
    noise_bandwidth: float = 5.0
    quantum: float = 0.0
    link_delay: float = 0.0
    loop_delay: float | None = None
    gain_margin: float = NORMAL.gain_margin
    phase_margin: float = NORMAL.phase_margin
    bandwidth: float = NORMAL.bandwidth
    actuator_use: float = 0.8
    measured: Mapping[str, float] = field(default_factory=dict)
    skid: bool = False
    throttle: float = 0.0
    beyond_ranges: bool = False

    def __post_init__(self) -> None:
        lookup(REFERENCE_MODELS, self.kind, "reference model")
        if self.omega_0 is not None and self.settling_time is not None:
            raise UsageError("use either a characteristic frequency or a settling time, not both")
        positive = (
            "step",
            "omega_0",
            "settling_time",
            "speed",
            "step_duration",
            "gain_margin",
            "phase_margin",
            "bandwidth",
            "actuator_use",
        )
        for name in positive:
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0.0):
                raise UsageError(f"{name.replace('_', ' ')} must be a positive number, not {value}")
        for name in ("hold", "noise_std", "jitter_std", "quantum", "link_delay", "loop_delay"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value >= 0.0):
                raise UsageError(f"{name.replace('_', ' ')} must be zero or more, not {value}")

    @property
    def jitter(self) -> float:
        """Noise that moves the actuator [rad or m]: ``jitter_std``, or ``noise_std`` if that is None."""
        return self.noise_std if self.jitter_std is None else self.jitter_std

    @property
    def is_automatic(self) -> bool:
        """Whether the design selects the speed of the reference model."""
        return self.omega_0 is None and self.settling_time is None
