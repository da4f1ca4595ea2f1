"""Every number a user may give: what it means, its unit, its least and greatest value, and why.

One table serves the command line (parser and help), the settings of the workflow, and any page that asks for the same
numbers. A number that is not finite, or outside its range, is refused by name before anything is opened, made or moved.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from gcs_autotune.errors import UsageError

__all__ = ["LIMITS", "Limit", "Slip", "axes_of", "finite", "limit_of"]

_TO_SI: Mapping[str, float] = {"deg": math.pi / 180.0, "deg/s": math.pi / 180.0, "%": 0.01, "min": 60.0}
"""Unit as typed -> factor to SI; the others are SI."""
_ROUNDING = 1e-9
"""Share of a limit by which a value may miss it: radians and back."""


@dataclass(frozen=True, slots=True)
class Slip:
    """A usual mistake: the value times ``factor`` is what was meant, when it is *words*, e.g. "in percent"."""

    factor: float
    words: str


_PERCENT = Slip(0.01, "in percent")
_CENTI = Slip(0.01, "in hundredths of a degree")
_RADIANS = Slip(180.0 / math.pi, "in radians")
_CM = Slip(0.01, "in centimetres")
_CM_S = Slip(0.01, "in cm/s")
_MS = Slip(0.001, "in milliseconds")
_MM = Slip(0.001, "in millimetres")


@dataclass(frozen=True, slots=True)
class Limit:
    """One number. ``least`` and ``greatest`` are in ``unit``, as typed; SI otherwise.

    Attributes
    ----------
    name : the option without its dashes.
    meaning : what it is, for the help; ``unset`` says in words what stands in for a missing ``default``.
    reason : why the range ends where it does.
    axis : the axis it holds for, where that decides unit and range; empty for all.
    slips : what was probably meant by a value outside.
    whole : a whole number; ``signed``: its size is bounded, and it may be negative.
    """

    name: str
    meaning: str
    unit: str
    least: float
    greatest: float
    reason: str
    default: float | None = None
    unset: str = ""
    axis: str = ""
    slips: tuple[Slip, ...] = ()
    whole: bool = False
    signed: bool = False

    @property
    def range(self) -> str:
        """The range in words, e.g. ``2 to 120 deg``, ``0.02 to 1``."""
        ends = f"{_shown(self.least)} to {_shown(self.greatest)}"
        return ends + (f" {self.unit}" if self.unit else "") + (" either way" if self.signed else "")

    @property
    def factor(self) -> float:
        """What a typed value is multiplied by to be in SI and radians."""
        return _TO_SI.get(self.unit, 1.0)

    @property
    def help(self) -> str:
        """What the help says: meaning, range and default."""
        default = f" (default {_shown(self.default)})" if self.default is not None else ""
        unset = f" (default: {self.unset})" if self.unset else ""
        return f"{self.meaning}, {self.range}{default}{unset}"

    def parse(self, text: str) -> float:
        """Return the number typed as *text*.

        Raises
        ------
        UsageError
            It is no number, not finite, or out of range; the message says what was probably meant.
        """
        try:
            value = float(text)
        except ValueError:
            raise UsageError(f"'{_quoted(text)}' is no number; {self._wanted}{self._comma(text)}") from None
        return self.check(value)

    def check(self, value: float) -> float:
        """Return *value* (as typed, in ``unit``) when it may be used.

        Raises
        ------
        UsageError
            It may not; the message has range, reason and what was probably meant.
        """
        if not math.isfinite(value):
            raise UsageError(f"{value:g} is no finite number; {self._wanted}")
        if self.whole and value != round(value):
            raise UsageError(f"{value:g} is no whole number; {self._wanted}")
        if not self._holds(value):
            raise UsageError(f"{_shown(value)} is out of range; {self._wanted}{self._meant(value)}")
        return int(value) if self.whole else value

    def check_si(self, value: float) -> None:
        """See that *value*, in SI and radians, may be used; errors as those of :meth:`check`, with its name."""
        try:
            self.check(value / self.factor)
        except UsageError as error:
            raise UsageError(f"{self.name}: {error}") from None

    def _holds(self, value: float) -> bool:
        size = abs(value) if self.signed else value
        slack = 0.0 if self.whole else _ROUNDING
        return self.least - slack * abs(self.least) <= size <= self.greatest + slack * abs(self.greatest)

    @property
    def _wanted(self) -> str:
        return f"allowed is {self.range}: {self.reason}"

    def _meant(self, value: float) -> str:
        for slip in self.slips:
            meant = float(f"{value * slip.factor:.6g}")
            if self._holds(meant):
                return f". Did you mean {_shown(meant)} ({_shown(value)} is that {slip.words})?"
        if self._holds(-value):
            return f". Did you mean {_shown(-value)}?"
        nearest = self.least if value < self.least else self.greatest
        usual = f"; usual is {_shown(self.default)}" if self.default is not None else ""
        return f". The nearest allowed is {_shown(math.copysign(nearest, value) if self.signed else nearest)}{usual}"

    def _comma(self, text: str) -> str:
        try:
            value = float(text.replace(",", "."))
        except ValueError:
            return ""
        return f". Did you mean {text.replace(',', '.')}?" if self._holds(value) else ""


def finite(text: str) -> float:
    """Return the number written as *text*, whatever its size.

    Raises
    ------
    UsageError
        It is no finite number.
    """
    try:
        value = float(text)
    except ValueError:
        raise UsageError(f"'{_quoted(text)}' is no number") from None
    if not math.isfinite(value):
        raise UsageError(f"{text.strip()} is no finite number")
    return value


def limit_of(name: str, axis: str = "") -> Limit:
    """Return the limit called *name*, that of *axis* where axes differ."""
    return LIMITS.get((name, axis)) or LIMITS[name, ""]


def axes_of(name: str) -> Sequence[Limit]:
    """Return the limits called *name*: one, or one per axis."""
    return [limit for (called, _), limit in LIMITS.items() if called == name]


def _shown(value: float) -> str:
    return f"{value:.0f}" if value == round(value) and abs(value) < 1e12 else f"{value:.6g}"


def _quoted(text: str) -> str:
    return text.encode("unicode_escape").decode()[:40]


_FULL = "it is a fraction of full output, 1 is all there is"
_BY_AXIS = (
    Limit(
        "step",
        "heading step",
        "deg",
        2.0,
        120.0,
        "less drowns in a compass' noise, more leaves the heading limit or is shorter the other way round",
        30.0,
        axis="heading",
        slips=(_RADIANS, _CENTI),
        signed=True,
    ),
    Limit(
        "step",
        "depth step",
        "m",
        0.1,
        20.0,
        "less drowns in the depth sensor's noise, more needs water that no tuning is done in",
        1.0,
        axis="depth",
        slips=(_CM,),
        signed=True,
    ),
    Limit(
        "step",
        "speed step",
        "m/s",
        0.05,
        10.0,
        "less drowns in a receiver's noise, more is a larger change of speed than such boats make",
        unset="40 % of the speed",
        axis="speed",
        slips=(_CM_S,),
        signed=True,
    ),
    Limit(
        "step",
        "turn-rate step",
        "deg/s",
        2.0,
        180.0,
        "less drowns in a gyro's noise, more than half a turn a second no such craft makes",
        30.0,
        axis="yaw",
        slips=(_RADIANS, _CENTI),
        signed=True,
    ),
    *(
        Limit(
            "relay-hysteresis",
            "switching value in heading",
            "deg",
            0.5,
            60.0,
            "less switches on a compass' noise, more swings the craft out of the heading limit",
            unset="by the noise",
            axis=axis,
            slips=(_RADIANS, _CENTI),
        )
        for axis in ("heading", "yaw")
    ),
    *(
        Limit(
            "relay-hysteresis",
            f"switching value in {what}",
            "m",
            0.01,
            10.0,
            "less switches on the sensor's noise, more swings the craft out of the room it has",
            unset="by the noise",
            axis=axis,
            slips=(_CM,),
        )
        for axis, what in (("depth", "depth"), ("surge", "distance ahead"), ("speed", "distance ahead"))
    ),
)
_FLOWN = (
    Limit(
        "step-duration",
        "longest time given to each step",
        "s",
        1.0,
        300.0,
        "in less nothing settles, for longer no water stays the same",
        unset="30 s; by the craft for speed, 6 s for yaw",
        slips=(_MS,),
    ),
    Limit("relay-output", "output, of full", "", 0.02, 1.0, _FULL, unset="found", slips=(_PERCENT,)),
    Limit(
        "relays",
        "self-oscillations at most; a third only where two cannot tell",
        "",
        2,
        3,
        "a model takes two, and a third tells a dead band from a curve",
        3,
        whole=True,
    ),
    Limit(
        "throttle",
        "throttle meanwhile, of full",
        "",
        0.0,
        1.0,
        _FULL,
        unset="cruise for boats, 0 for ROVs",
        slips=(_PERCENT,),
    ),
    Limit(
        "speed",
        "speed meanwhile",
        "m/s",
        0.0,
        30.0,
        "astern nothing is tuned, and nothing this was made for goes faster",
        unset="from CRUISE_SPEED for boats, 0 for ROVs",
        slips=(_CM_S,),
    ),
    Limit(
        "control-rate",
        "rate of our relay",
        "Hz",
        2.0,
        100.0,
        "slower switches a swing away, quicker no autopilot reports its attitude over a link",
        unset="25, simulated 10",
        slips=(_MS,),
    ),
    Limit(
        "delay",
        "known input delay",
        "s",
        0.0,
        60.0,
        "nothing answers before it is told to, and what answers later is no actuator's delay",
        unset="looked for",
        slips=(_MS,),
    ),
    Limit(
        "full-scale",
        "the model's input at full output, in its unit (N m, N, rad), if not 1",
        "",
        1e-6,
        1e9,
        "it is a force, a moment or an angle at full output, and positive",
    ),
    Limit(
        "settling-time",
        "wanted settling time",
        "s",
        0.1,
        600.0,
        "no craft settles sooner, and slower ones need no tuning",
        slips=(_MS,),
    ),
    Limit(
        "omega-0",
        "wanted characteristic frequency",
        "rad/s",
        0.01,
        60.0,
        "it is what the closed loop swings at: slower takes minutes, quicker no actuator follows",
    ),
)
_SWEPT = "slower than a thousand seconds nobody waits for, and quicker no link commands"
_FADED = "0 is none, and five minutes are longer than any sweep"
_MANOEUVRED = (
    Limit(
        "heading",
        "change of heading at which the rudder is reversed",
        "deg",
        0.5,
        90.0,
        "less drowns in a compass' noise, more is a turn and no zig-zag",
        20.0,
        slips=(_RADIANS, _CENTI),
    ),
    Limit(
        "rudder",
        "rudder angle to either side, for craft that have a rudder",
        "deg",
        1.0,
        60.0,
        "less is lost in the linkage's play, and beyond every rudder stalls",
        unset="by --steering",
        slips=(_RADIANS, _CENTI),
    ),
    Limit(
        "full-rudder",
        "rudder angle at full steering output, which no autopilot knows",
        "deg",
        5.0,
        80.0,
        "it is how far the rudder really goes to either side",
        slips=(_RADIANS, _CENTI),
    ),
    Limit("steering", "output of what is driven, of full", "", 0.02, 1.0, _FULL, 0.67, slips=(_PERCENT,)),
    Limit(
        "executes",
        "times the rudder is put over",
        "",
        2,
        40,
        "an overshoot takes two, and beyond forty the battery tells nothing new",
        5,
        whole=True,
    ),
    Limit(
        "turn",
        "change of heading of the turning circle; from two turns on the current is told, too",
        "deg",
        90.0,
        3600.0,
        "a circle's figures begin at 90 degrees, and ten turns tell no more",
        720.0,
        slips=(_RADIANS,),
    ),
    *(
        Limit(
            f"{which}{name}",
            f"{meaning}{of}",
            "deg",
            1.0,
            90.0,
            "below a degree it is the compass' noise, and beyond 90 no autopilot is asked at once",
            usual,
            slips=(_RADIANS,),
        )
        for which, of, C, x_a in (("", "", 10.0, 3.0), ("second-", " of the second relay", 6.0, 3.0))
        for name, meaning, usual in (
            ("set-point", "change of heading commanded to either side", C),
            ("hysteresis", "heading at which the relay switches", x_a),
        )
    ),
    Limit(
        "wall-hysteresis",
        "distance at which the relay before a wall switches",
        "m",
        0.02,
        2.0,
        "below it the rangefinder's steps switch it, and beyond it the wall is out of reach",
        0.1,
        slips=(_CM,),
    ),
    Limit(
        "least-distance",
        "nearest to the wall ahead",
        "m",
        0.0,
        50.0,
        "a wall is not to be touched",
        0.3,
        slips=(_CM,),
    ),
    Limit(
        "levels",
        "levels to either side",
        "",
        2,
        12,
        "two and amidships are the fewest that show a curve, and finer steps drown in the noise",
        3,
        whole=True,
    ),
    Limit("astern", "thrust astern, of full", "", 0.0, 1.0, _FULL, unset="none", slips=(_PERCENT,)),
    Limit("f-start", "first frequency", "Hz", 0.001, 10.0, _SWEPT, 0.02),
    Limit("f-stop", "last frequency", "Hz", 0.001, 10.0, _SWEPT, 0.5),
    Limit("fade-in", "time to full size", "s", 0.0, 300.0, _FADED, 5.0, slips=(_MS,)),
    Limit("fade-out", "time from full size to none", "s", 0.0, 300.0, _FADED, 2.0, slips=(_MS,)),
    Limit(
        "shortest",
        "shortest time between two changes",
        "s",
        0.1,
        60.0,
        "quicker no link commands, and slower nothing quick is told",
        1.0,
        slips=(_MS,),
    ),
    Limit(
        "push",
        "how long it is pushed before it is let go",
        "s",
        0.5,
        300.0,
        "in less nothing moves, for longer it only goes further",
        10.0,
        slips=(_MS,),
    ),
    Limit(
        "duration",
        "length of what is flown by the clock",
        "s",
        2.0,
        600.0,
        "in less nothing answers, for longer no water stays the same",
        60.0,
        slips=(_MS,),
    ),
)
_GUARDED = (
    Limit(
        "max-heading-excursion",
        "from the starting heading",
        "deg",
        5.0,
        720.0,
        "less trips over a compass, and two turns are as good as no limit",
        120.0,
        slips=(_RADIANS, _CENTI),
    ),
    Limit(
        "max-depth-excursion",
        "from the starting depth",
        "m",
        0.1,
        100.0,
        "less trips over the depth sensor, more guards nothing",
        3.0,
        slips=(_CM,),
    ),
    Limit(
        "max-depth", "greatest depth", "m", 0.1, 6000.0, "it is how deep the craft may go", unset="off", slips=(_CM,)
    ),
    Limit("min-depth", "least depth", "m", 0.0, 6000.0, "it is how near the surface it may come, 0: off", 0.0),
    Limit(
        "max-speed",
        "over ground",
        "m/s",
        0.1,
        40.0,
        "less trips over a receiver at rest, more guards nothing",
        unset="4, or 1.5 times cruise",
        slips=(_CM_S,),
    ),
    Limit(
        "max-distance",
        "from the start",
        "m",
        1.0,
        10000.0,
        "less trips over a receiver at rest, and further no telemetry radio reaches",
        unset="300, or 100 s of cruise",
    ),
    Limit("max-roll", "roll", "deg", 1.0, 180.0, "less trips over a wave, more there is not", 45.0, slips=(_RADIANS,)),
    Limit("max-pitch", "pitch", "deg", 1.0, 90.0, "less trips over a wave, more there is not", 45.0, slips=(_RADIANS,)),
    Limit(
        "min-battery-voltage",
        "least battery voltage",
        "V",
        0.0,
        1000.0,
        "it is where the battery counts as empty, 0: off",
        unset="off",
        slips=(Slip(0.001, "in millivolts"),),
    ),
    Limit(
        "min-battery",
        "least charge remaining",
        "%",
        0.0,
        95.0,
        "it is in percent of a full battery, and more than nearly full none remains; 0: off",
        10.0,
    ),
    Limit(
        "total-time",
        "of the runs of a trial that plans itself",
        "min",
        1.0,
        240.0,
        "a run takes half a minute, and no battery lasts longer",
        30.0,
        slips=(Slip(1.0 / 60.0, "in seconds"),),
    ),
    Limit(
        "max-time",
        "of one manoeuvre",
        "s",
        5.0,
        7200.0,
        "less ends every manoeuvre before it tells anything, and for two hours none lasts",
        600.0,
        slips=(_MS,),
    ),
)
_LINKED = (
    Limit(
        "baud",
        "serial speed when the URI has none",
        "baud",
        300,
        10_000_000,
        "it is the serial port's speed",
        57600,
        whole=True,
        slips=(Slip(1000.0, "in kbaud"),),
    ),
    Limit(
        "system-id",
        "the vehicle's system id, when several are heard",
        "",
        1,
        255,
        "MAVLink knows no others, and 0 means everybody",
        whole=True,
    ),
    Limit(
        "source-system",
        "our own system id",
        "",
        1,
        255,
        "MAVLink knows no others, and 0 means everybody",
        unset="the one the vehicle takes commands from, MAV_GCS_SYSID",
        whole=True,
    ),
    Limit(
        "patience",
        "longest silence of the vehicle that is waited out; what it interrupted is flown again",
        "s",
        0.0,
        600.0,
        "0 ends the run at the first silence, and in ten minutes a craft drifts out of its free water",
        60.0,
        slips=(_MS,),
    ),
    Limit(
        "listen",
        "how long each port is listened to",
        "s",
        0.2,
        600.0,
        "a vehicle says its name once a second",
        2.5,
        slips=(_MS,),
    ),
    Limit(
        "number",
        "which log on board; 0 only lists them",
        "",
        0,
        65535,
        "logs are counted so",
        unset="newest",
        whole=True,
    ),
    Limit("seed", "noise seed of a sitl: vehicle", "", 0, 2**32 - 1, "it begins a generator", 1, whole=True),
)
_DESK = (
    Limit(
        "plan-next",
        "propose what to fly next, for so long, so that the uncertain parameters become certain",
        "s",
        5.0,
        36000.0,
        "in less nothing can be told, and for ten hours nobody plans a manoeuvre",
        unset="60",
        slips=(_MS,),
    ),
    Limit(
        "horizon",
        "how long a simulation runs before it starts again at what was measured",
        "s",
        0.1,
        86400.0,
        "it is a part of a run",
        unset="whole runs first",
        slips=(_MS,),
    ),
    Limit("jobs", "processes to use; 0: all cores", "", 0, 1024, "0 takes all cores there are", 1, whole=True),
    Limit(
        "length",
        "ship length, for figures in lengths and IMO's limits",
        "m",
        0.01,
        600.0,
        "no model is shorter, no ship longer",
        slips=(_MM,),
    ),
    Limit(
        "trial-speed",
        "trial speed, when the run does not hold it",
        "m/s",
        0.001,
        60.0,
        "at rest there is no trial, and no ship goes faster",
        slips=(_CM_S,),
    ),
    Limit("scale", "of a scale model: its ship is so many times longer", "", 1.0, 1000.0, "1 is full scale", 1.0),
    Limit(
        "neutral",
        "command of no force, when known",
        "",
        -1e6,
        1e6,
        "it is a command, in the unit of the file",
        unset="found",
    ),
    Limit(
        "diameter",
        "propeller diameter; gives K_T(J) and K_Q(J)",
        "m",
        0.001,
        20.0,
        "no propeller is smaller or larger",
        slips=(_MM,),
    ),
    Limit(
        "density",
        "density of the water",
        "kg/m^3",
        500.0,
        2000.0,
        "fresh water has 1000, sea water 1025",
        1000.0,
        slips=(Slip(1000.0, "in t/m^3"),),
    ),
)

LIMITS: Mapping[tuple[str, str], Limit] = {
    (limit.name, limit.axis): limit for limit in (*_BY_AXIS, *_FLOWN, *_MANOEUVRED, *_GUARDED, *_LINKED, *_DESK)
}
"""(Option without dashes, axis or empty) -> its limit; adding a number is one row here."""
