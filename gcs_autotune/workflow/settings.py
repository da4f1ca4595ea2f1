"""Settings of jobs, with or without a vehicle; SI units and radians."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from gcs_autotune.design import style_of
from gcs_autotune.effects import ExtendedModel
from gcs_autotune.errors import UsageError
from gcs_autotune.identify import ModelFile, Structure
from gcs_autotune.limits import limit_of
from gcs_autotune.link import Transport, open_link
from gcs_autotune.manoeuvres import Envelope, StepSettings
from gcs_autotune.mavlink import SigningKey
from gcs_autotune.models import Form
from gcs_autotune.thrusters import PullTest

__all__ = ["SETTLED", "STOP_RULES", "CommonSettings", "Connection", "StudySettings", "SuppliedGains", "TuneSettings"]

SETTLED = "settled"
STOP_RULES = ("design", SETTLED)
"""Criteria that end a relay.

``settled``: five periods agree within 10 % (Miskovic2010, 6.7). ``design``: the gains that the design would propose are
known as well.
"""


PATIENCE = 60.0
"""Usual longest silence [s] of the vehicle after which a run continues. Project choice."""

_COMMON_NUMBERS = ("throttle", "speed", "delay", "control_rate", "patience")
_TUNE_NUMBERS = (
    *("step", "step_duration", "relay_output", "relay_hysteresis", "settling_time", "omega_0", "full_scale"),
)


def _check_limits(settings: object, fields: Sequence[str], axis: str = "") -> None:
    for name in fields:
        value = getattr(settings, name)
        if value is not None:
            limit_of(name.replace("_", "-"), axis).check_si(float(value))


@dataclass(frozen=True, slots=True)
class Connection:
    """How to connect to the vehicle; ``opened`` is the link object if it is already open.

    Raises
    ------
    UsageError
        A number is outside its limits (:data:`gcs_autotune.limits.LIMITS`).
    """

    uri: str
    baud: int = 57600
    system_id: int | None = None
    source_system: int | None = None
    seed: int | None = 1
    backend: str = "pymavlink"
    signing: SigningKey | None = None
    opened: Transport | None = None

    def __post_init__(self) -> None:
        """Check that the numbers are within their limits."""
        _check_limits(self, ("baud", "system_id", "source_system", "seed"))

    def open(self) -> Transport:
        """Open the link, or return the one already open.

        Raises
        ------
        CannotOpenLink, UsageError, UnknownName
        """
        if self.opened is not None:
            return self.opened
        return open_link(self.uri, baud=self.baud, seed=self.seed, backend=self.backend)


@dataclass(frozen=True, slots=True)
class CommonSettings:
    """Settings of every job on a vehicle; SI units and radians. None means that the program chooses.

    Attributes
    ----------
    connection, directory : how to connect to the vehicle, and the run directory.
    throttle, speed : a boat's throttle [fraction] and speed [m/s]; None: its own cruise.
    structure, delay : structure of the drag, and the delay [s], used for identification; None: estimated.
    control_rate : control ticks per second [Hz]; None: 25, or 10 in simulated time.
    patience : longest silence [s] of the vehicle after which the run continues.
    resume : directory of an earlier run to continue from.
    fetch_log : whether to fetch the vehicle's own log of the run afterwards.
    envelope : the safety limits.
    agreed : whether the operator has agreed beforehand to what the run announces, as part of a longer job.

    Raises
    ------
    UsageError
        A number is outside its limits (:data:`gcs_autotune.limits.LIMITS`).
    """

    connection: Connection
    directory: Path
    throttle: float | None = None
    speed: float | None = None
    structure: Structure | None = None
    delay: float | None = None
    control_rate: float | None = None
    patience: float = PATIENCE
    resume: Path | None = None
    fetch_log: bool = False
    envelope: Envelope = field(default_factory=Envelope)
    agreed: bool = False

    def __post_init__(self) -> None:
        """Check that the numbers are within their limits."""
        _check_limits(self, _COMMON_NUMBERS)


@dataclass(frozen=True, slots=True)
class SuppliedGains:
    """Gains from a file, under the vehicle's own parameter names.

    ``file``: the file that contains them.
    ``step``: the step flown in the run of the file. None if the file is not in the directory of a run that flew a step.
    ``noise``: residual standard deviation per signal (SI) of the model identified in that run, if there is one.
    """

    file: Path
    values: Mapping[str, float]
    step: StepSettings | None
    noise: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class TuneSettings(CommonSettings):
    """Settings of one tune. An experiment uses those of the tune's first half.

    Attributes
    ----------
    axis : the loop, or the degree of freedom of an experiment.
    leg_length : length of a leg [m] of the mission that proves them; None: by the speed.
    untuned : whether to fly that mission even if speed or heading have ArduRover's own gains.
    step, step_duration : size of the step that proves gains [rad, m, m/s or rad/s], and duration [s] of each half.
    relay_output, relay_hysteresis : amplitude of the relays [fraction of full output] and their hysteresis [rad or m].
    model : family of the reference model. settling_time [s], omega_0 [rad/s] : speed of the reference model.
    style : margins and bandwidth, one of ``design.style_of``.
    given : a model to design from instead of flying experiments. full_scale : the model's input at full output, in its
        unit.
    dry_run : whether to write nothing.
    most_relays : largest number of relays, 2 or 3. The third is flown only if two do not separate a dead zone from a
    thrust curve.
    stop_rule : when relays end, one of :data:`STOP_RULES`.
    gains : gains to prove instead of designing any. proving : the command that proves gains of a file under these
        settings, without the file name.
    beyond_ranges : whether gains may leave their documented ranges.
    pull_test : pull test of one thruster, the source of the thrust curve.
    loops : names of the loops that ``tune all`` tunes; empty: those without ``Tunable.on_request``.

    Raises
    ------
    UsageError
        A number is outside its limits (:data:`gcs_autotune.limits.LIMITS`), or there is no such stop rule.
    """

    axis: str
    leg_length: float | None = None
    untuned: bool = False
    step: float | None = None
    step_duration: float | None = None
    relay_output: float | None = None
    relay_hysteresis: float | None = None
    model: str = "bessel"
    settling_time: float | None = None
    omega_0: float | None = None
    style: str = "normal"
    given: ModelFile | None = None
    full_scale: float | None = None
    dry_run: bool = False
    most_relays: int = 3
    stop_rule: str = STOP_RULES[0]
    gains: SuppliedGains | None = None
    proving: str = ""
    beyond_ranges: bool = False
    pull_test: PullTest | None = None
    loops: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check that the numbers are within their limits and that the stop rule exists."""
        CommonSettings.__post_init__(self)
        _check_limits(self, _TUNE_NUMBERS, self.axis)
        style_of(self.style)
        if self.stop_rule not in STOP_RULES:
            raise UsageError(f"unknown stop rule '{self.stop_rule}'. Use {' or '.join(STOP_RULES)}")

    @property
    def ends_early(self) -> bool:
        """Whether relays, steps and waits end once they are informative enough.

        Otherwise a boat also turns before each stage.
        """
        return self.stop_rule != SETTLED


@dataclass(frozen=True, slots=True)
class StudySettings:
    """Settings of ``identify``; the names are those of :func:`gcs_autotune.identify.fit`.

    ``effects``: effects to fit with the model.
    ``begin``: a model to start from.
    ``check``: validate on held-out data.
    ``choose``: drop the terms of a coupled form that these runs do not justify.
    ``plan_next``: propose manoeuvres of this duration [s].
    ``profile``: parameters whose intervals are computed by profile likelihood.
    ``compare``: a model, or a method for the same runs, with which to compare the result.
    """

    dof: str | None = None
    structure: str | Path | Form | None = None
    method: str = "output-error"
    delay: Literal["auto"] | float = "auto"
    use: tuple[str, ...] | None = None
    loss: Literal["linear", "soft_l1"] = "linear"
    options: Mapping[str, Any] = field(default_factory=dict)
    known: Mapping[str, float] = field(default_factory=dict)
    effects: tuple[str, ...] = ()
    begin: ExtendedModel | None = None
    check: bool = True
    choose: bool = False
    plan_next: float | None = None
    profile: tuple[str, ...] = ()
    compare: ModelFile | str | None = None
