"""``fly``: one manoeuvre of the table on a vehicle; its preview before, its figures and its model after."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from gcs_autotune.axes import excitation_of
from gcs_autotune.craft import Observation
from gcs_autotune.design import reduce
from gcs_autotune.design.plant import in_fractions
from gcs_autotune.errors import (
    AutotuneError,
    NotInformative,
    OperatorStopped,
    PreconditionFailed,
    UsageError,
    WrongVehicle,
)
from gcs_autotune.firmware import Firmware
from gcs_autotune.identify import AxisFit, fit_axis
from gcs_autotune.identify.model_file import ModelFile, save_model
from gcs_autotune.limits import limit_of
from gcs_autotune.link import MavlinkCraft
from gcs_autotune.manoeuvres import (
    DOF_OF,
    MANOEUVRES,
    SPEED_TIME,
    Envelope,
    Manoeuvre,
    ManoeuvreKind,
    PaperCraft,
    Preview,
    preview,
)
from gcs_autotune.models import SingleDof
from gcs_autotune.registry import lookup
from gcs_autotune.report import render_flight, render_preview
from gcs_autotune.seatrials import MANOEUVRES as SHIP_MANOEUVRES
from gcs_autotune.seatrials import Sheet, ship_figures
from gcs_autotune.sname import DOFS
from gcs_autotune.trial import Trial
from gcs_autotune.watch import Watcher
from gcs_autotune.workflow.announcement import after_a_silence, battery, how_long
from gcs_autotune.workflow.background import agreed, beside
from gcs_autotune.workflow.connection import TWITCHING, connect_craft
from gcs_autotune.workflow.context import armed
from gcs_autotune.workflow.experiments import dive_for
from gcs_autotune.workflow.itinerary import CHECK, DIVE, Itinerary, Leg, Paced
from gcs_autotune.workflow.operator import Operator
from gcs_autotune.workflow.preflight import STAGE, see_depth_is_told, see_signs, sign_check_for
from gcs_autotune.workflow.record import RunDirectory
from gcs_autotune.workflow.runner import ManoeuvreRunner
from gcs_autotune.workflow.settings import TuneSettings

__all__ = ["FlightResult", "FlySettings", "fly", "preview_of_model"]

_NOTED, _LIMITED = 0.1, 0.9
"""An order that matters, as a share of full, and the share of it that must come out."""
_DOF = {"N": "yaw", "X": "surge", "Z": "heave"}
"""Force -> degree of freedom whose actuator is checked before it is driven."""
_UNTUNED = 0.2
"""ATC_STR_RAT_FF as ArduRover sets it: that of no craft in particular."""
_RADIUS, _LAG = 4.0, 1.5
"""Chosen: turning radius [m] at full rudder and time constant [s] of boats of 1 to 3 m, where nothing is known."""
_ROV_RATE, _ROV_LAG = 0.8, 1.0
"""Chosen: yaw rate [rad/s] at full output of an ROV, and its time constant [s], likewise."""
_FULL_SPEED: Mapping[str, float] = {"X": 1.0, "Y": 0.5, "Z": 0.5}
"""Chosen [m/s]: speed at full output along each force, likewise."""


@dataclass(frozen=True, slots=True)
class FlySettings:
    """What to fly: ``options`` (SI and radians) are those given, by their names in the table of limits.

    ``side`` is 1 to begin to starboard, -1 to port; ``force`` the one driven, where any may be. ``model`` is what the
    preview is made with, ``full_scale`` its input at full output; without, the vehicle's own figures are.

    Raises
    ------
    UnknownName, UsageError
        No such manoeuvre, one that another command flies, or an option that it does not have.
    """

    manoeuvre: str
    common: TuneSettings
    options: Mapping[str, float] = field(default_factory=dict)
    side: int = 1
    model: ModelFile | None = None
    full_scale: float | None = None
    force: str = ""

    def __post_init__(self) -> None:
        """See that it can be flown at all."""
        kind = self.kind
        if kind.make is None:
            raise UsageError(f"{kind.name} is flown by {kind.command}; `gcs-autotune fly --list` tells the others")
        strange = [name for name in self.options if name not in kind.options]
        if strange:
            have = ", ".join(f"--{name}" for name in kind.options)
            raise UsageError(f"{kind.name} takes no --{strange[0]}; it takes {have}, --throttle and --first-to")
        if "rudder" in self.options and "full-rudder" not in self.options:
            raise UsageError(
                "--rudder is an angle: say with --full-rudder what angle full output gives, or use --steering"
            )
        if self.options.get("rudder", 0.0) > self.options.get("full-rudder", math.inf):
            raise UsageError("--rudder is more than --full-rudder: it goes no further")
        self.make(0.0)

    @property
    def kind(self) -> ManoeuvreKind:
        """The row of the table."""
        return lookup(MANOEUVRES, self.manoeuvre, "manoeuvre").of(self.force)

    def make(self, throttle: float, *, keep_still: bool = False) -> Manoeuvre:
        """Return the manoeuvre; what was not given is as the table of limits says."""
        kind = self.kind
        assert kind.make is not None  # refused when these settings were made
        rows = {name: limit_of(name) for name in kind.options}
        usual = {name: row.default * row.factor for name, row in rows.items() if row.default is not None}
        given = dict(self.options)
        if "rudder" in given:
            given["steering"] = given["rudder"] / given["full-rudder"]
        return kind.make(
            {**usual, **given, "throttle": throttle, "side": float(self.side), "keep-still": float(keep_still)}
        )


@dataclass(frozen=True, slots=True, eq=False)
class FlightResult:
    """What came of it: the preview, and unless it was only that, ``trial``, ``sheets`` of figures and the ``fit``."""

    preview: Preview
    page: Path | None = None
    trial: Trial | None = None
    sheets: Sequence[Sheet] = ()
    fit: AxisFit | None = None
    remarks: Sequence[str] = ()


def preview_of_model(settings: FlySettings, when: str) -> FlightResult:
    """Preview the manoeuvre with the model given, no vehicle at hand, and draw it where the settings say.

    Raises
    ------
    UsageError
        No model, one without yaw, or no speed for a throttle.
    """
    s, kind = settings.common, settings.kind
    assert settings.model is not None  # asked by the command
    throttle = s.throttle or 0.0
    if throttle and s.speed is None:
        raise UsageError("say with --speed how fast the craft goes at that throttle")
    paper = _paper(settings, None, {}, throttle, s.speed or 0.0)
    if paper.assumed:
        wanted = " and ".join(sorted(DOF_OF[force] for force in kind.drives))
        have = ", ".join(settings.model.model.base.form.dofs)
        raise UsageError(f"model '{settings.model.name}' is about {have}; {kind.name} moves {wanted}")
    seen = preview(settings.make(throttle), paper, _envelope(settings, s.speed or 0.0))
    return FlightResult(seen, _draw_preview(settings, seen, when))


def fly(
    settings: FlySettings,
    operator: Operator,
    watcher: Watcher,
    when: str,
    *,
    only_preview: bool = False,
) -> FlightResult:
    """Preview, announce, ask, fly, read: the run directory has ``trials/``, figures, model and ``report.html``.

    No parameter is written. The craft is left as found on every ending.

    Raises
    ------
    WrongVehicle
        It has not what this manoeuvre drives.
    PreconditionFailed
        The predicted track leaves the envelope.
    OperatorStopped, GuardTripped, NotAchieved, LinkError
        What ended it early; the record is on disk.
    """
    s, kind = settings.common, settings.kind
    record = RunDirectory(s.directory)
    with connect_craft(s.connection, operator, watcher, record, s.control_rate, s.axis) as craft:
        firmware = craft.firmware
        _see_it_suits(settings, craft)
        cruise = craft.parameters.read_existing(["CRUISE_THROTTLE", "CRUISE_SPEED", "ATC_STR_RAT_FF"])
        throttle, speed = _cruise(settings, firmware, cruise)
        envelope = _envelope(settings, speed)
        keep_still = not firmware.needs_way
        paper = _paper(settings, firmware, cruise, throttle, speed)
        foreseen = preview(settings.make(throttle), paper, envelope, floats=not keep_still)
        watcher.say(f"preview: {foreseen.told()}")
        if foreseen.trouble and not paper.assumed:
            raise PreconditionFailed(f"not flown, for the preview ends early: {foreseen.trouble}; nothing was armed")
        if foreseen.trouble:
            watcher.say(f"the preview ends early, but on assumed numbers: {foreseen.trouble}")
        if only_preview:
            return FlightResult(foreseen, _draw_preview(settings, foreseen, when))
        dof = _checked(kind)
        if dof:
            see_depth_is_told(craft, dof)
        now = craft.observe()
        dive = dive_for(dof, firmware, now)
        itinerary = Itinerary(
            [
                *([Leg(STAGE, CHECK)] if dof else []),
                *([Leg("diving", DIVE)] if dive is not None else []),
                Leg(kind.name, foreseen.seconds),
            ]
        )
        _announce(settings, craft, operator, watcher, now, itinerary, foreseen, excitation_of(dof).check if dof else "")
        watcher = Paced(watcher, itinerary)
        keep = lambda trial: beside(craft, partial(record.keep, trial))  # noqa: E731 - as tune and experiment do
        runner = ManoeuvreRunner(craft, envelope, watcher, keep, s.patience, partial(agreed, craft, operator, watcher))
        with armed(craft, watcher, record, s.connection):
            if dof:
                check = sign_check_for(dof, firmware, craft.servos, throttle, needs_speed=firmware.needs_way)
                see_signs(check, runner.attempt)
            if dive is not None:
                runner.fly(dive, "diving")
            trial = runner.fly(settings.make(throttle, keep_still=keep_still), kind.name).trial
    return _read(settings, record, foreseen, trial, when)


def _read(settings: FlySettings, record: RunDirectory, foreseen: Preview, trial: Trial, when: str) -> FlightResult:
    """Read figures and model off the record; what it does not tell is a remark, for the record itself is good."""
    remarks = _limited(trial)
    sheets: Sequence[Sheet] = ()
    fit: AxisFit | None = None
    try:
        sheets = ship_figures(trial) if settings.kind.name in SHIP_MANOEUVRES else ()
    except AutotuneError as error:
        remarks.append(f"no figures: {error}")
    s, dof = settings.common, str(trial.meta.get("dof", ""))
    if settings.kind.identifies and dof:
        try:
            fit = fit_axis([trial], dof=dof, structure=s.structure, delay="auto" if s.delay is None else s.delay)
            record.save_json("fit.json", fit.to_dict())
            save_model(fit, record.path / "model.json")
        except NotInformative as error:
            remarks.append(f"no model: {error}")
    if sheets:
        record.save_json("figures.json", json.loads(json.dumps({"sheets": [x.to_dict() for x in sheets]}, default=str)))
    page = record.path / "report.html"
    title = f"{settings.kind.name}: {settings.common.connection.uri}"
    page.write_text(render_flight(title, when, trial, foreseen.trial, sheets, fit, remarks), encoding="utf-8")
    return FlightResult(foreseen, page, trial, sheets, fit, remarks)


def _limited(trial: Trial) -> list[str]:
    """Return a remark where clearly less came out of an actuator than was asked for: it stands at a limit."""
    orders = [m for m in trial.marks if m.kind in ("execute", "level")]
    for k, order in enumerate(orders):
        until = orders[k + 1].t if k + 1 < len(orders) else trial.end
        for force, asked in order.detail.items():
            if force not in DOF_OF or force not in trial or not isinstance(asked, float) or abs(asked) < _NOTED:
                continue
            held = trial[force].between(order.t + 0.5 * (until - order.t), until).values
            came = float(np.median(held)) / asked if len(held) else 1.0
            if came < _LIMITED:
                return [
                    f"of {abs(asked):.0%} {force} asked for, {abs(came * asked):.0%} came out: it stands at a limit "
                    "(less --throttle leaves thrusters room to steer). Figures and model are by what came out"
                ]
    return []


def motion_of(file: ModelFile, dof: str, full_scale: float | None) -> SingleDof:
    """Return one degree of freedom of a model file with its input as a fraction of full output.

    Raises
    ------
    UsageError
        It has none, or its input is an angle or a force and nobody says what full output is.
    """
    reduction = reduce(file.model, dof, file.inputs, names=file.names, covariance=file.covariance)
    unit = reduction.model.input_unit
    if unit != "1" and full_scale is None:
        raise UsageError(f"the model's input is in {unit}: say with --full-scale how many {unit} full output gives")
    return in_fractions(reduction.model, np.zeros((5, 5)), full_scale)[0]


def _see_it_suits(settings: FlySettings, craft: MavlinkCraft) -> None:
    kind, firmware = settings.kind, craft.firmware
    if not kind.suits(firmware):
        wanted = ", ".join(sorted(kind.drives - set(firmware.channels))) or "way on"
        fits = ", ".join(k.name for k in MANOEUVRES.values() if k.make is not None and k.suits(firmware))
        raise WrongVehicle(
            f"this vehicle ({firmware.name}) cannot fly {kind.name}, which takes {wanted}; it can: {fits}"
        )
    if "rudder" in settings.options and (craft.servos.skid or not firmware.needs_way):
        raise UsageError(
            "this vehicle steers by its thrusters and has no rudder: give --steering, a share of full output"
        )


def _cruise(settings: FlySettings, firmware: Firmware, present: Mapping[str, float]) -> tuple[float, float]:
    """Return throttle [fraction] and speed [m/s]: the vehicle's own cruise unless told otherwise."""
    s = settings.common
    if not firmware.needs_way:
        return s.throttle or 0.0, s.speed or 0.0
    throttle = present.get("CRUISE_THROTTLE", 50.0) / 100.0 if s.throttle is None else s.throttle
    return throttle, present.get("CRUISE_SPEED", 1.0) if s.speed is None else s.speed


def _envelope(settings: FlySettings, speed: float) -> Envelope:
    envelope = replace(settings.common.envelope, cruise=speed)
    return replace(envelope, heading_excursion=math.inf) if settings.kind.turns else envelope


def _paper(
    settings: FlySettings, firmware: Firmware | None, present: Mapping[str, float], throttle: float, speed: float
) -> PaperCraft:
    """Return the craft on paper: from the model given, from its feed-forward gain, else an assumed one of its size."""
    under_way = firmware is not None and firmware.needs_way
    gain = present.get("ATC_STR_RAT_FF", 0.0)
    if under_way and gain > 0.0 and abs(gain - _UNTUNED) > 1e-6:
        yaw, words = SingleDof("yaw", "1", gain * _LAG, gain), f"its ATC_STR_RAT_FF {gain:g}"
    else:
        rate, lag = (max(speed, 0.1) / _RADIUS, _LAG) if under_way else (_ROV_RATE, _ROV_LAG)
        yaw = SingleDof("yaw", "1", lag / rate, 1.0 / rate)
        words = f"an assumed turn rate of {math.degrees(rate):.0f} deg/s at full steering (a --model file tells better)"
    ahead = speed / math.sqrt(throttle) if speed and throttle else _FULL_SPEED["X"]
    others = {f: _lag_of(DOF_OF[f], full) for f, full in {**_FULL_SPEED, "X": ahead}.items()}
    known: set[str] = set()
    if settings.model is not None:
        for dof in settings.model.model.base.form.dofs:
            force = DOFS[dof].force
            if force in settings.kind.drives or force == "N":
                motion = motion_of(settings.model, dof, settings.full_scale)
                yaw, others = (motion, others) if force == "N" else (yaw, {**others, force: motion})
                known.add(force)
        words = f"model '{settings.model.name}'"
    missing = sorted(DOF_OF[f] for f in settings.kind.drives - known)
    if known and missing:
        words += f" with an assumed {' and '.join(missing)}"
    return PaperCraft(yaw, speed, words, assumed=bool(missing), others=others)


def _lag_of(dof: str, full_speed: float) -> SingleDof:
    """Return a craft that reaches *full_speed* [m/s] at full output, with drag by the square and a usual lag."""
    drag = full_speed**-2
    return SingleDof(dof, "1", 2.0 * drag * full_speed * SPEED_TIME, 0.0, drag)


def _checked(kind: ManoeuvreKind) -> str:
    """Return the degree of freedom whose actuator is checked before."""
    return next((_DOF[force] for force in sorted(kind.drives) if force in _DOF), "")


def _draw_preview(settings: FlySettings, seen: Preview, when: str) -> Path:
    directory = settings.common.directory
    directory.mkdir(parents=True, exist_ok=True)
    page = directory / "preview.html"
    page.write_text(
        render_preview(f"Preview of a {settings.kind.name}", when, seen.trial, seen.told(), seen.trouble),
        encoding="utf-8",
    )
    return page


def _announce(
    settings: FlySettings,
    craft: MavlinkCraft,
    operator: Operator,
    watcher: Watcher,
    now: Observation,
    itinerary: Itinerary,
    foreseen: Preview,
    check: str,
) -> None:
    s, firmware = settings.common, craft.firmware
    armed = "leave the vehicle armed, as it is" if now.armed else "arm the vehicle, and disarm it at the end"
    for text in (
        f"{armed}; {TWITCHING}",
        f"use mode {firmware.manual_mode}, and go back to {now.mode} at the end",
        f"move: {check}{settings.kind.name} ({settings.kind.help})",
        f"need {foreseen.told()}",
        how_long(itinerary),
        battery(now, s.envelope, itinerary.seconds),
        *after_a_silence(s, now),
        "write no parameter",
    ):
        watcher.say(f"will {text}")
    if not agreed(craft, operator, watcher, "Go ahead?"):
        raise OperatorStopped("not started: the answer was no; nothing was armed or moved")
