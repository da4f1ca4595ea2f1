"""What the user asked ``tune`` for; SI and radians."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from gcs_autotune.errors import UsageError
from gcs_autotune.identify import ModelFile, Structure
from gcs_autotune.limits import limit_of
from gcs_autotune.link import Transport, open_link
from gcs_autotune.manoeuvres import Envelope
from gcs_autotune.mavlink import SigningKey

if TYPE_CHECKING:
    from gcs_autotune.workflow.supplied_gains import SuppliedGains

__all__ = ["SETTLED", "STOP_RULES", "Connection", "TuneSettings"]

SETTLED = "settled"
STOP_RULES = ("design", SETTLED)
"""When experiments end: once the design is known, or once five periods agree within 10 % (Miskovic2010, 6.7)."""


_NUMBERS = (
    *("step", "step_duration", "relay_output", "relay_hysteresis", "throttle", "speed"),
    *("settling_time", "omega_0", "delay", "full_scale", "control_rate", "patience"),
)
"""What a tune is given as numbers."""


def _see_limits(settings: object, fields: Sequence[str], axis: str = "") -> None:
    for name in fields:
        value = getattr(settings, name)
        if value is not None:
            limit_of(name.replace("_", "-"), axis).check_si(float(value))


@dataclass(frozen=True, slots=True)
class Connection:
    """How to reach the vehicle; ``opened`` is the link itself where it was opened already.

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
        """See that the numbers may be used."""
        _see_limits(self, ("baud", "system_id", "source_system", "seed"))

    def open(self) -> Transport:
        """Open the link, or return the one that is open already.

        Raises
        ------
        CannotOpenLink, UsageError, UnknownName
        """
        if self.opened is not None:
            return self.opened
        return open_link(self.uri, baud=self.baud, seed=self.seed, backend=self.backend)


@dataclass(frozen=True, slots=True)
class TuneSettings:
    """One tune. None means: choose for me.

    ``step`` [rad, m, m/s or rad/s], ``step_duration`` [s] each way, ``relay_output`` fraction of full output,
    ``relay_hysteresis`` [rad or m], ``throttle`` fraction and ``speed`` [m/s] for boats, ``model`` the model
    function's family, ``settling_time`` [s] or ``omega_0`` [rad/s] its speed, ``control_rate`` [Hz] (None: 25, or 10 in
    simulated time). ``given``: a model
    to design from, instead of experiments; ``full_scale`` its input at full output, when that is in newtons or rad.
    ``gains``: gains to prove instead of designing any; ``proving``: the command that proves the gains of a file as they
    would be here, less the file.
    ``most_relays``: self-oscillations flown at most, 2 or 3; the third only where two cannot tell what they should.
    ``stop_rule`` one of :data:`STOP_RULES`; with ``settled`` steps run to their end, too, and a boat turns about before
    each manoeuvre. ``patience`` [s]: longest silence of the vehicle after which the run goes on. ``resume``:
    directory of a run that ended early, to go on from. ``fetch_log``: the vehicle's own log of the run is fetched
    afterwards. ``beyond_ranges``: gains may leave their documented ranges.

    Raises
    ------
    UsageError
        A number is outside its limits (:data:`gcs_autotune.limits.LIMITS`).
    """

    axis: str
    connection: Connection
    directory: Path
    step: float | None = None
    step_duration: float | None = None
    relay_output: float | None = None
    relay_hysteresis: float | None = None
    throttle: float | None = None
    speed: float | None = None
    model: str = "bessel"
    settling_time: float | None = None
    omega_0: float | None = None
    structure: Structure | None = None
    delay: float | None = None
    given: ModelFile | None = None
    full_scale: float | None = None
    dry_run: bool = False
    control_rate: float | None = None
    most_relays: int = 3
    stop_rule: str = STOP_RULES[0]
    gains: SuppliedGains | None = None
    proving: str = ""
    patience: float = 60.0
    resume: Path | None = None
    fetch_log: bool = False
    beyond_ranges: bool = False
    envelope: Envelope = field(default_factory=Envelope)

    def __post_init__(self) -> None:
        """See that the numbers may be used, and that there is such a rule."""
        _see_limits(self, _NUMBERS, self.axis)
        if self.stop_rule not in STOP_RULES:
            raise UsageError(f"unknown stop rule '{self.stop_rule}'. Use {' or '.join(STOP_RULES)}")
