"""What to fly: one manoeuvre of the table, or a plan of several manoeuvres from a TOML file.

A plan::

    title = "Charlie, calm harbour"
    area = "harbour.geojson"       # or "lat,lon lat,lon lat,lon"
    order = "shuffled"             # or "listed"; the shuffled order is reproducible, so that a plan can be resumed
    [conditions]
    calm = true                    # roll and pitch must be small before each run
    min-depth = 1.5                # m; an ROV dives to it before each run
    [defaults]                     # options of every run that has them
    full-rudder = 30
    [[run]]
    manoeuvre = "zig-zag"
    heading = 20                   # units and ranges as on the command line
    rudder = [10, 20]              # one run for each value
    sides = "both"                 # or "starboard", "port", or a list of these
    repeat = 2
    hold-out = false               # true: not used in the fit, but to validate the model
"""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

from gcs_autotune.errors import AutotuneError, BadFile, UsageError
from gcs_autotune.firmware import Firmware
from gcs_autotune.identify import ModelFile
from gcs_autotune.limits import limit_of
from gcs_autotune.link import MavlinkCraft
from gcs_autotune.manoeuvres import (
    MANOEUVRES,
    Area,
    Envelope,
    Manoeuvre,
    ManoeuvreKind,
    Preview,
    Trajectory,
    read_area,
    read_points,
)
from gcs_autotune.registry import lookup
from gcs_autotune.trial import Trial
from gcs_autotune.workflow.excursion import Excursion
from gcs_autotune.workflow.precision import Precision
from gcs_autotune.workflow.settings import CommonSettings
from gcs_autotune_files import Refused, clipped, parse, read_text

__all__ = ["FlightPlan", "FlightRun", "FlownAgain", "FlySettings", "load_flight_plan"]


UNTRIED = {"CRUISE_SPEED": 2.0, "CRUISE_THROTTLE": 50.0}
"""Default values of ArduRover's cruise parameters. A boat with these values has probably not been configured."""
SCALES = tuple(0.8**k for k in range(1, 11))
"""Sizes of a manoeuvre tried one after the other, as fractions of its usual size.

Below a tenth a run is not informative. Project choice.
"""


@dataclass(frozen=True, slots=True)
class FlySettings:
    """Settings of one run: which manoeuvre to fly.

    Attributes
    ----------
    options : the options that the user set (SI and radians), by their names in the table of limits.
    side : 1 to begin to starboard, -1 to port.
    force : the force to apply, if the manoeuvre can apply any.
    model : the model for the preview; None: the vehicle's own figures.
    full_scale : the model's input at full output.
    name : name of the run and its record; empty: the name of the manoeuvre.
    held_out : whether the run is used for validation and not for the fit.
    points : timed points (s, m ahead, m to starboard), for a manoeuvre that takes them.
    beside : further models of the same craft, for other motions than ``model``.
    follows : whether the run follows another one of the same command, and so need not be one that `fly` offers.

    Raises
    ------
    UnknownName, UsageError
        No such manoeuvre, one that another command flies, or an option that it does not have.
    """

    manoeuvre: str
    common: CommonSettings
    options: Mapping[str, float] = field(default_factory=dict)
    side: int = 1
    model: ModelFile | None = None
    full_scale: float | None = None
    force: str = ""
    name: str = ""
    held_out: bool = False
    points: tuple[tuple[float, float, float], ...] = ()
    beside: tuple[ModelFile, ...] = ()
    follows: bool = False

    def __post_init__(self) -> None:
        """Check that the run can be flown."""
        kind = self.kind
        if kind.make is None or not (kind.is_alone or self.follows):
            raise UsageError(
                f"{kind.name} is not flown by itself, but by {kind.command}. `gcs-autotune fly --list` shows the others"
            )
        strange = [name for name in self.options if name not in kind.options]
        if strange:
            have = ", ".join(f"--{name}" for name in (*kind.options, "throttle"))
            raise UsageError(f"{kind.name} has no option --{strange[0]}. Its options are {have} and --first-to")
        if "rudder" in self.options and "full-rudder" not in self.options:
            raise UsageError(
                "--rudder is an angle. Add --full-rudder, the rudder angle at full output, or use --steering"
            )
        if self.options.get("rudder", 0.0) > self.options.get("full-rudder", math.inf):
            raise UsageError("--rudder is larger than --full-rudder. Use at most --full-rudder")
        if kind.timed != bool(self.points):
            raise UsageError(
                f'{kind.name} needs points. Use --points "20,10,0 40,10,10" (seconds, metres ahead, to starboard)'
                if kind.timed
                else f"{kind.name} takes no --points. Only trajectory does"
            )
        for name, value in self.options.items():
            try:
                limit_of(name, kind.axis).check_si(value)
            except UsageError as error:
                raise UsageError(f"--{name}: {error}") from None
        self.make(0.0)

    @property
    def kind(self) -> ManoeuvreKind:
        """The entry of the manoeuvre in the table of manoeuvres."""
        return lookup(MANOEUVRES, self.manoeuvre, "manoeuvre").of(self.force)

    def cruise(self, firmware: Firmware, present: Mapping[str, float]) -> tuple[float, float]:
        """Return throttle [fraction] and speed [m/s]: the user's values, otherwise the vehicle's own cruise
        (*present*)."""
        s = self.common
        if not firmware.needs_way:
            return s.throttle or 0.0, s.speed or 0.0
        throttle = present.get("CRUISE_THROTTLE", 50.0) / 100.0 if s.throttle is None else s.throttle
        return throttle, present.get("CRUISE_SPEED", 1.0) if s.speed is None else s.speed

    def knows_its_cruise(self, present: Mapping[str, float]) -> bool:
        """Whether throttle and speed belong together: both set by the user, or both the vehicle's own and not
        ArduRover's defaults."""
        s = self.common
        if s.throttle is not None or s.speed is not None:
            return bool(s.throttle and s.speed)
        own = {name: present[name] for name in UNTRIED if present.get(name, 0.0) > 0.0}
        return len(own) == len(UNTRIED) and own != UNTRIED

    def envelope(self, speed: float) -> Envelope:
        """Return the safety limits at *speed* [m/s].

        A manoeuvre that turns through a full circle has no heading limit.
        """
        envelope = replace(self.common.envelope, cruise=speed)
        return replace(envelope, heading_excursion=math.inf) if self.kind.turns else envelope

    @property
    def _usual(self) -> dict[str, float]:
        """The default values (SI and radians) of all options."""
        rows = {name: limit_of(name, self.kind.axis) for name in self.kind.options}
        return {name: row.default * row.factor for name, row in rows.items() if row.default is not None}

    def smaller(self) -> Iterator[FlySettings]:
        """Yield settings with ever smaller and shorter values of the options that the user did not set."""
        free = {name: power for name, power in self.kind.shrinks.items() if name not in self.options}
        usual = self._usual
        for scale in SCALES if free else ():
            factors = {name: limit_of(name, self.kind.axis).factor for name in free}  # round as people read them
            sizes = {n: float(f"{usual[n] * scale**power / factors[n]:.2g}") * factors[n] for n, power in free.items()}
            try:
                yield replace(self, options={**self.options, **sizes})
            except UsageError:  # out of range, or not together with what was given
                return

    def make(self, throttle: float, *, speed: float = 0.0, keep_still: bool = False) -> Manoeuvre:
        """Return the manoeuvre, recorded under the name of the run. Options that the user did not set have
        their defaults.
        """
        kind = self.kind
        assert kind.make is not None  # refused when these settings were made
        given = dict(self.options)
        if "rudder" in given:
            given["steering"] = given["rudder"] / given["full-rudder"]
        manoeuvre = kind.make(
            {
                **self._usual,
                **given,
                "throttle": throttle,
                "speed": speed,
                "side": float(self.side),
                "keep-still": float(keep_still),
            }
        )
        manoeuvre.name = self.name or manoeuvre.name
        if isinstance(manoeuvre, Trajectory):
            manoeuvre.points = self.points
        return manoeuvre

    @property
    def apart(self) -> float:
        """Distance between two rangefinders ahead [m]."""
        return self.options.get("apart", self._usual.get("apart", 0.2))

    @property
    def models(self) -> tuple[ModelFile, ...]:
        """The models of the craft, in the order in which they are used."""
        return (*([] if self.model is None else [self.model]), *self.beside)


class FlownAgain(Protocol):
    """A rule that evaluates the record of a run and may request another run."""

    def meet(self, craft: MavlinkCraft) -> None:
        """Process the vehicle's identity and parameters, before anything moves."""
        ...

    def further(self, run: FlySettings) -> tuple[FlySettings, str, str]:
        """Return the run that may follow *run*, its announcement as a sentence, and in a few words."""
        ...

    def another(self, run: FlySettings, trial: Trial, think: Callable[..., Any]) -> FlySettings | None:
        """Return the next run after *run*, whose record is *trial*; None if no further run is needed.

        *think* runs a computation while the link is served.
        """
        ...


@dataclass(frozen=True, slots=True)
class FlightPlan:
    """Runs in the order in which they are flown.

    Attributes
    ----------
    calm, min_depth : conditions before each run: calm water, a minimum depth [m].
    area : the permitted area [deg].
    text : content of the plan's file.
    until : the required precision; further runs are chosen after these until it is reached.
    options : options common to the runs chosen.
    known : earlier runs of the same craft; with them the first run is also chosen from the data.
    again : the rule that may repeat a run, depending on its record.
    """

    title: str
    runs: tuple[FlySettings, ...]
    calm: bool = False
    min_depth: float | None = None
    text: str = ""
    area: Area | None = None
    until: Precision | None = None
    options: Mapping[str, float] = field(default_factory=dict)
    known: tuple[Trial, ...] = ()
    again: FlownAgain | None = None

    @classmethod
    def of(cls, settings: FlySettings) -> FlightPlan:
        """Return the plan that consists of one run with *settings*."""
        return cls(settings.kind.name, (replace(settings, name=settings.kind.name),))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the plan's runs, in order."""
        return tuple(run.name for run in self.runs)


@dataclass(frozen=True, slots=True, eq=False)
class FlightRun:
    """A run of a plan with its preview and, once flown, its record.

    Attributes
    ----------
    throttle, speed, envelope : a boat's throttle [fraction] and speed [m/s], and the limits.
    preview : the preview of the manoeuvre alone.
    excursion : space and time of the manoeuvre and of all stages before and after it.
    trial : record of the run, once flown.
    """

    settings: FlySettings
    throttle: float
    speed: float
    envelope: Envelope
    preview: Preview
    excursion: Excursion
    trial: Trial | None = None

    @property
    def name(self) -> str:
        """Name of the run in the plan."""
        return self.settings.name

    @property
    def why_not(self) -> str:
        """Why the run is rejected before arming: it would exceed a limit that the user set. Empty if the run is not
        rejected.
        """
        return self.excursion.beyond(self.envelope, self.name)

    @property
    def rejection(self) -> str:
        """Why the run is not flown, also because its preview with known parameters ends early. Empty if it is flown."""
        return self.why_not or ("" if self.preview.craft.assumed else self.preview.trouble)

    @property
    def caution(self) -> str:
        """How the preview ends early with assumed parameters; empty if it does not. The flight is still permitted."""
        is_guess = self.preview.craft.assumed and self.preview.trouble
        return f"with assumed parameters the run ends early: {self.preview.trouble}" if is_guess else ""


_SIDES: Mapping[str, tuple[int, ...]] = {"starboard": (1,), "port": (-1,), "both": (1, -1)}
_ORDERS = ("listed", "shuffled")
_RUN = ("manoeuvre", "force", "sides", "repeat", "hold-out", "throttle", "speed", "points")
"""Keys of a run in addition to the options of its manoeuvre."""
_CONDITIONS = ("calm", "min-depth")
MOST_RUNS = 100
"""Largest number of runs in a plan. A larger number is treated as a typing error. Project choice."""


def load_flight_plan(
    path: Path,
    common: CommonSettings,
    model: ModelFile | None,
    full_scale: float | None,
    beside: tuple[ModelFile, ...] = (),
) -> FlightPlan:
    """Return the plan in the file *path*; ``common``, ``model``, ``full_scale`` and the further models
    ``beside`` apply to every run.

    Raises
    ------
    BadFile
        The file is not readable, not TOML, or not a plan. The message states the run, the reason and similar spellings.
    """
    try:
        text = read_text(path)
        data = parse(text, "toml")
    except Refused as error:
        raise BadFile(f"{path} cannot be read as a plan: {error}") from error
    try:
        _check_keys(data, ("title", "order", "area", "conditions", "defaults", "run"), "the plan")
        conditions = _table(data, "conditions")
        _check_keys(conditions, _CONDITIONS, "[conditions]")
        order = lookup(dict.fromkeys(_ORDERS, True), _text(data, "order", "listed"), "order")
        title = _text(data, "title", path.stem)
        runs = list(_runs(data, common, model, full_scale, beside))
    except (AutotuneError, TypeError, ValueError) as error:
        raise BadFile(f"{path}: {error}") from error
    assert order
    if data.get("order") == "shuffled":
        random.Random(len(runs)).shuffle(runs)
    if not 0 < len(runs) <= MOST_RUNS:
        raise BadFile(
            f"{path}: a plan contains 1 to {MOST_RUNS} runs, each a [[run]] table. This plan contains {len(runs)}"
        )
    depth = conditions.get("min-depth")
    calm = conditions.get("calm", False)
    if not isinstance(calm, bool):
        raise BadFile(f"{path}: calm must be true or false, not {clipped(repr(calm))}")
    try:
        least = None if depth is None else limit_of("min-depth").check(_number(depth))
    except (UsageError, TypeError, ValueError) as error:
        raise BadFile(f"{path}: min-depth: {error}") from error
    try:
        area = read_area(_text(data, "area")) if "area" in data else None
    except UsageError as error:
        raise BadFile(f"{path}: {error}") from error
    return FlightPlan(title, tuple(_named(runs)), calm, least, text, area)


def _check_keys(data: Mapping[str, Any], known: Sequence[str], where: str) -> None:
    for key in data:
        try:
            lookup(dict.fromkeys(known, True), key, "key")
        except AutotuneError as error:
            raise UsageError(f"{where}: {error}") from None


def _table(data: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    value = data.get(key, {})
    if not isinstance(value, dict):
        raise UsageError(f"{key} must be a table. Write [{key}] and its keys below")
    return value


def _text(data: Mapping[str, Any], key: str, default: str = "") -> str:
    value = data.get(key, default)
    if not isinstance(value, str):
        raise UsageError(f"{key} must be text in quotation marks, not {clipped(repr(value))}")
    return value


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise TypeError(f"must be a number, not {clipped(repr(value))}")
    return float(value)


def _runs(
    data: Mapping[str, Any],
    common: CommonSettings,
    model: ModelFile | None,
    full_scale: float | None,
    beside: tuple[ModelFile, ...],
) -> Iterator[FlySettings]:
    defaults, listed = _table(data, "defaults"), data.get("run", [])
    every = {name for kind in MANOEUVRES.values() for name in kind.options}
    _check_keys(defaults, (*_RUN[1:], *sorted(every)), "[defaults]")
    if not isinstance(listed, list):
        raise UsageError("run must be a list of tables. Write each run as [[run]]")
    left = MOST_RUNS
    for number, entry in enumerate(listed, start=1):
        try:
            if not isinstance(entry, dict):
                raise UsageError("run must be a list of tables. Write each run as [[run]]")
            made = list(_of_entry(entry, defaults, common, model, full_scale, left, beside))
        except AutotuneError as error:
            raise UsageError(f"run {number}: {error}") from None
        left -= len(made)
        yield from made


def _of_entry(
    entry: Mapping[str, Any],
    defaults: Mapping[str, Any],
    common: CommonSettings,
    model: ModelFile | None,
    full_scale: float | None,
    left: int,
    beside: tuple[ModelFile, ...],
) -> Iterator[FlySettings]:
    """Yield the runs of a ``[[run]]`` table: one for each combination of levels, sides and repeats, at most *left*."""
    if "manoeuvre" not in entry:
        raise UsageError('no manoeuvre given (manoeuvre = "zig-zag"). See `gcs-autotune fly --list`')
    kind = lookup(MANOEUVRES, _text(entry, "manoeuvre"), "manoeuvre")
    _check_keys(entry, (*_RUN, *kind.options), kind.name)
    given = {**{k: v for k, v in defaults.items() if k in (*_RUN, *kind.options)}, **entry}
    force = _text(given, "force")
    kind = kind.of(force)
    asked = given.get("sides", "starboard")
    named = [lookup(_SIDES, str(name)[:40], "side") for name in (asked if isinstance(asked, list) else [asked])]
    sides = dict.fromkeys(itertools.chain.from_iterable(named))
    repeat = given.get("repeat", 1)
    if isinstance(repeat, bool) or not isinstance(repeat, int) or not 1 <= repeat <= MOST_RUNS:
        raise UsageError(f"repeat must be a whole number from 1 to {MOST_RUNS}, not {clipped(repr(repeat))}")
    held_out = given.get("hold-out", False)
    if not isinstance(held_out, bool):
        raise UsageError(f"hold-out must be true or false, not {clipped(repr(held_out))}")
    points = read_points(_text(given, "points")) if "points" in given else ()
    numbers = {k: _levels(k, v, kind.axis) for k, v in given.items() if k in (*kind.options, "throttle", "speed")}
    own = [k for k in entry if k in numbers]
    count = len(sides) * repeat * math.prod(len(values) for values in numbers.values())
    if not 0 < count <= left:
        raise UsageError(
            f"its lists, sides and repeats make {count:.4g} runs, but a plan contains at most {MOST_RUNS} and {left} "
            "are left. Use fewer levels"
        )
    for values in itertools.product(*numbers.values()):
        typed = dict(zip(numbers, values, strict=True))
        options = {k: v * limit_of(k, kind.axis).factor for k, v in typed.items() if k in kind.options}
        here = replace(common, throttle=typed.get("throttle", common.throttle), speed=typed.get("speed", common.speed))
        label = "-".join([kind.name, *([force] if force else []), *(f"{k}{typed[k]:g}" for k in own)])
        for side in sides:
            name = label if side > 0 else f"{label}-port"
            settings = FlySettings(
                kind.name, here, options, side, model, full_scale, force, name, held_out, points, beside
            )
            yield from itertools.repeat(settings, repeat)


def _levels(name: str, value: Any, axis: str) -> list[float]:
    try:
        return [limit_of(name, axis).check(_number(v)) for v in (value if isinstance(value, list) else [value])]
    except (TypeError, ValueError):
        raise UsageError(f"{name} must be a number or a list of numbers, not {clipped(repr(value))}") from None
    except UsageError as error:
        raise UsageError(f"{name}: {error}") from None


def _named(runs: Sequence[FlySettings]) -> Iterator[FlySettings]:
    """Yield the runs, with a number appended to names that occur more than once."""
    labels = [run.name for run in runs]
    for i, run in enumerate(runs):
        again = labels[: i + 1].count(run.name)
        yield replace(run, name=f"{run.name}-{again}") if labels.count(run.name) > 1 else run
