"""The specification of a loop, and further inputs of its design."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from gcs_autotune.control import REFERENCE_MODELS
from gcs_autotune.errors import UsageError
from gcs_autotune.registry import lookup

__all__ = ["Spec"]


@dataclass(frozen=True, slots=True)
class Spec:
    """The specification. Everything except ``step`` may be left open.

    Attributes
    ----------
    step : the step to design for [rad or m]; None: 30 deg or 1 m.
    kind : family in ``REFERENCE_MODELS``.
    omega_0 : characteristic frequency [rad/s]; None lets the design find the fastest acceptable.
    settling_time : to 5 % [s], instead of ``omega_0``.
    speed : speed over ground [m/s] at which the model was identified; axes with ``needs_speed`` need it.
    full_scale : model input at full actuator output; None for models identified in fractions (unit ``1``).
    step_duration : how long each flown step is recorded [s]; predictions then start and last as the flown ones do.
        None: steps of a loop that has long settled, as long as they take.
    windows : how long [s] step and step back were recorded with the present gains; empty: ``step_duration``.
    settled_band, settled_time : a flown half is over when the signal has been so near its target [rad or m] for so
        long [s]. Gains are chosen over ``step_duration`` all the same; only the reported metrics are of such halves.
    settled_least : ... or for so long [s], where signal and output are at rest by then.
    hold : how long [s] the craft is held before that step, by a loop whose integral is empty at first; 0: one that
        has long settled.
    noise_std : measurement noise of the position [rad or m], white up to ``noise_bandwidth`` [Hz].
    jitter_std : the part of that noise which changes from sample to sample and so moves the actuator [rad or m]; None:
        all of it.
    noise_bandwidth : half the rate at which that noise was measured [Hz].
    quantum : smallest step of the position's sensor [rad or m]; errors within it count as zero.
    link_delay : part of the identified delay [s] that lies in the telemetry link, not in the autopilot's loop.
    loop_delay : extra delay [s] of autopilot and actuator, beyond the identified one; None = 1.5 loop periods.
    gain_margin, phase_margin : least acceptable over the 95 % region, ratio and [rad].
    actuator_use : largest output for the required step, normalised.
    measured : parameters set to measured values, not designed.
    skid : whether the craft steers by the difference of two thrusters.
    beyond_ranges : whether gains may leave their documented ranges, with the same margins.
    throttle : throttle that a boat of vectored thrust, or of two thrusters, was identified at, fraction of full; 0 when
        unknown, or not so.
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
    noise_std: float = 0.0
    jitter_std: float | None = None
    noise_bandwidth: float = 5.0
    quantum: float = 0.0
    link_delay: float = 0.0
    loop_delay: float | None = None
    gain_margin: float = 2.5
    phase_margin: float = math.radians(45.0)
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
        """``jitter_std``, or all of the noise [rad or m]."""
        return self.noise_std if self.jitter_std is None else self.jitter_std

    @property
    def is_automatic(self) -> bool:
        """Whether the design chooses the speed of the reference model."""
        return self.omega_0 is None and self.settling_time is None
