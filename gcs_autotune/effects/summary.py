"""Data on the runs that are available before any effect is fitted, with units and typical sizes for start values.

For a craft steered by a rudder, the base model's moment is in units of rudder angle. If a positive rudder angle turns
the craft to port, inertia and drag are negative. :func:`sense` is then -1, so that damping and restoring forces keep
their sign.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from gcs_autotune.models import Form
from gcs_autotune.sname import DOFS, SIGNALS

__all__ = [
    "DataSummary",
    "force_scale",
    "force_unit",
    "inertia_scale",
    "known_of",
    "sense",
    "stiffness_unit",
    "top_speed",
]


@dataclass(frozen=True, slots=True, eq=False)
class DataSummary:
    """Data on the runs that are available before any effect is fitted.

    - ``form``: form of the base model. ``inputs``/``signals``: unit of each driven input and measured signal.
    - ``amplitude``: largest magnitude of each input.
    - ``spread``: standard deviation of each signal.
    - ``level``: noise of each signal, without a model.
    - ``channels``: names of all recorded channels.
    - ``interval`` [s]: between samples.
    - ``time_constant`` [s]: the base model's slowest.
    - ``duration`` [s]: of the longest run.
    - ``quantum``: grid step of each signal (0: none).
    """

    form: Form
    inputs: Mapping[str, str]
    signals: Mapping[str, str]
    amplitude: Mapping[str, float]
    spread: Mapping[str, float]
    level: Mapping[str, float]
    channels: frozenset[str]
    interval: float
    time_constant: float
    duration: float
    quantum: Mapping[str, float] = field(default_factory=dict)
    extent: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Smallest and largest value of every recorded channel."""
    rms: Mapping[str, float] = field(default_factory=dict)
    """Root mean square of every recorded channel."""
    usual: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Quantiles of 10 and 90 % of every recorded channel."""
    base: Mapping[str, float] = field(default_factory=dict)
    """Values of the base model's parameters."""
    runs: tuple[str, ...] = ()
    """Names of the runs."""
    twins: tuple[tuple[str, str], ...] = ()
    """Pairs of inputs with equal gains, apart from the sign: two thrusters of one kind."""
    commanded_alike: tuple[tuple[str, str], ...] = ()
    """Inputs whose commands were nearly equal in all runs, so that they are not distinguished."""
    still: frozenset[str] = frozenset()
    """Recorded velocities that never exceed their noise, so that nothing can depend on them."""
    lags: Mapping[str, float] = field(default_factory=dict)
    """Delay [s] of each signal by a filter aboard, if its stamps have been corrected for it."""

    @property
    def full(self) -> Mapping[str, float]:
        """Full output of each input: 1 if recorded as a normalised output, else the largest value recorded."""
        return {n: 1.0 if self.inputs.get(n) == "1" else s for n, s in self.amplitude.items()}

    def command_unit(self, name: str) -> str:
        """Return the unit of a command.

        A command that does not drive the model is assumed normalised if all driven inputs are.
        """
        shares = set(self.inputs.values()) == {"1"}
        return self.inputs.get(name, "1" if shares else SIGNALS[name][0])


RIGID_BODY = {"surge": "m", "sway": "m", "heave": "m", "roll": "I_x", "pitch": "I_y", "yaw": "I_z"}
"""Degree of freedom -> name of its rigid-body inertia."""


def known_of(data: DataSummary) -> Mapping[str, float]:
    """Return the base model's numbers: fitted ones, otherwise known ones, otherwise start values."""
    return {**data.form.start, **data.form.known, **data.base}


def _drives(dof: str, data: DataSummary) -> Iterator[tuple[str, float | str]]:
    """Yield (channel, gain) of every input that drives *dof*."""
    for channel, pairs in data.form.inputs.items():
        for force, gain in pairs:
            if force == DOFS[dof].force:
                yield channel, gain


def force_unit(dof: str, data: DataSummary) -> str:
    """Return the unit of the force in the equation of *dof*.

    If an input with a known gain drives it, this is the input's unit, otherwise the SI unit.
    """
    for channel, gain in _drives(dof, data):
        if not isinstance(gain, str):
            return data.inputs.get(channel, "1")
    if DOFS[dof].force in data.form.per_inertia:
        return "rad/s^2" if DOFS[dof].angular else "m/s^2"
    if data.form.normalised:
        return "1"
    return "N m" if DOFS[dof].angular else "N"


def stiffness_unit(dof: str, data: DataSummary) -> str:
    """Return the unit of force per metre or radian."""
    return f"{force_unit(dof, data)}/{DOFS[dof].position_unit}"


def force_scale(dof: str, data: DataSummary) -> float:
    """Return a typical force in the equation of *dof*: the largest from the inputs, otherwise that of the motion."""
    known, total = known_of(data), 0.0
    for channel, gain in _drives(dof, data):
        size = abs(known.get(gain.lstrip("-"), 1.0)) if isinstance(gain, str) else abs(gain)
        total += size * data.amplitude.get(channel, 0.0)
    return total or inertia_scale(dof, data) * top_speed(dof, data) / max(data.time_constant, data.interval)


def inertia_scale(dof: str, data: DataSummary) -> float:
    """Return the magnitude of the base model's inertia; 1 if it is unknown."""
    return abs(_inertia(dof, data)) or 1.0


def _inertia(dof: str, data: DataSummary) -> float:
    known, d = known_of(data), DOFS[dof]
    return known.get(RIGID_BODY[dof], 0.0) - known.get(f"{d.force}_{d.velocity}dot", 0.0)


def sense(dof: str, data: DataSummary) -> dict[str, float]:
    """Return the constant ``sense``: the sign of the base model's inertia."""
    return {"sense": -1.0 if _inertia(dof, data) < 0.0 else 1.0}


def top_speed(dof: str, data: DataSummary) -> float:
    """Return the largest recorded speed; otherwise that from recorded positions; otherwise 1."""
    d = DOFS[dof]
    fastest = max((abs(e) for e in data.extent.get(d.velocity, ())), default=0.0)
    return fastest or 2.0 * data.spread.get(d.position, 0.0) / max(data.time_constant, data.interval) or 1.0
