"""``experiment``: fly the relay experiments of one degree of freedom, identify it, and change nothing."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from typing import Literal

from gcs_autotune.craft import Observation
from gcs_autotune.errors import NotAchieved, NotInformative, OperatorStopped, WrongVehicle
from gcs_autotune.identify import AxisFit, fit_axis
from gcs_autotune.identify.surge import extended, fit_surge
from gcs_autotune.link import MavlinkCraft
from gcs_autotune.manoeuvres import Sequencer, visit
from gcs_autotune.trial import Trial
from gcs_autotune.watch import Watcher
from gcs_autotune.workflow.aboard import TWITCHING, come_aboard, say_link_times
from gcs_autotune.workflow.experiments import dive_for, relay_for, second_output, throttle_steps_for, turn_for
from gcs_autotune.workflow.ledger import Ledger
from gcs_autotune.workflow.operator import Operator
from gcs_autotune.workflow.preflight import ANNOUNCED, CHECKED, see_signs, sign_check_for
from gcs_autotune.workflow.readiness import make_ready
from gcs_autotune.workflow.record import RunDirectory
from gcs_autotune.workflow.settings import EXPERIMENTS, TuneSettings
from gcs_autotune.workflow.third_level import ThirdLevel, third_level
from gcs_autotune.workflow.waiting import ask, think

__all__ = ["experiment"]


@dataclass(frozen=True, slots=True)
class _Cruise:
    """How a boat goes while it swings: throttle fraction and speed [m/s]."""

    throttle: float
    speed: float


def experiment(settings: TuneSettings, operator: Operator, watcher: Watcher) -> AxisFit:
    """Fly, record and identify; the run directory gets ``trials/``, ``telemetry.tlog`` and ``fit.json``.

    No parameter is written. The craft is left as found on every ending.

    Raises
    ------
    WrongVehicle
        A boat has no heave.
    OperatorStopped, GuardTripped, NotAchieved, LinkError, NotInformative
        What ended it early; the record is on disk.
    """
    record = RunDirectory(settings.directory)
    dof = EXPERIMENTS[settings.axis]
    with come_aboard(settings.connection, operator, watcher, record, settings.control_rate) as craft:
        if dof == "heave" and craft.firmware.kind == "boat":
            raise WrongVehicle(f"this vehicle ({craft.firmware.name}, a boat) does not heave; try heading or surge")
        _announce(settings, craft, operator, watcher, craft.observe())
        ledger = Ledger(record, settings.connection, watcher.say)
        try:
            with visit(craft, watcher, ledger.settle) as found:
                ledger.open(craft, found)
                make_ready(craft, watcher)
                craft.arm()
                say_link_times(craft, watcher)
                trials = _fly(settings, dof, craft, watcher, record)
                delay: float | Literal["auto"] = "auto" if settings.delay is None else settings.delay
                surge = dof == "surge" and craft.firmware.kind == "boat"
                if surge:
                    fit = think(craft, lambda: fit_surge(trials, structure=settings.structure, delay=delay))
                else:
                    fit = think(craft, lambda: fit_axis(trials, dof=dof, structure=settings.structure, delay=delay))
        finally:
            ledger.leave()
    model = extended(fit).to_dict() if surge else fit.model.to_dict()
    (record.path / "fit.json").write_text(json.dumps(fit.to_dict(), indent=1) + "\n", encoding="utf-8")
    (record.path / "model.json").write_text(json.dumps(model, indent=1) + "\n", encoding="utf-8")
    return fit


def _fly(settings: TuneSettings, dof: str, craft: MavlinkCraft, watcher: Watcher, record: RunDirectory) -> list[Trial]:
    cruise = _cruise(settings, dof, craft)
    settings = replace(settings, speed=cruise.speed, envelope=replace(settings.envelope, cruise=cruise.speed))
    sequencer = Sequencer(craft, settings.envelope, watcher, record.keep)
    if dof == "surge" and craft.firmware.kind == "boat":
        return [_swing(sequencer, settings, craft, cruise, n) for n in range(2)]
    room = 0.9 - abs(cruise.throttle) if dof == "surge" else 0.9
    output, trials = settings.relay_output, list[Trial]()
    if dof in CHECKED:
        see_signs(
            sign_check_for(dof, craft.firmware, craft.servos, cruise.throttle, needs_speed=False, output=output),
            sequencer.fly,
        )
    dive = dive_for(dof, craft.firmware.kind, craft.observe())
    if dive is not None:
        flown = sequencer.fly(dive, "diving")
        if flown.outcome.ending == "aborted":
            raise NotAchieved(f"diving: {flown.outcome.reason}")
    for name in ("relay-1", "relay-2"):
        _turn_about(bool(trials), sequencer, settings, craft, cruise)
        trials.append(_relay(name, output, sequencer, settings, dof, craft, cruise))
        output = second_output(trials[-1], room)
    if dof in CHECKED and settings.most_relays > len(trials):
        third = think(craft, lambda: _third(trials, dof, settings))
        if third is not None:
            watcher.say(third.why)
            _turn_about(True, sequencer, settings, craft, cruise)
            try:
                trials.append(_relay("relay-3", third.output, sequencer, settings, dof, craft, cruise))
            except NotAchieved as error:
                watcher.say(f"{error}; going on with the two that were flown")
    return trials


def _third(trials: list[Trial], dof: str, settings: TuneSettings) -> ThirdLevel | None:
    delay: float | Literal["auto"] = "auto" if settings.delay is None else settings.delay
    try:
        return third_level(trials, fit_axis(trials, dof=dof, structure=settings.structure, delay=delay))
    except NotInformative:
        return None


def _relay(
    name: str,
    output: float | None,
    sequencer: Sequencer,
    settings: TuneSettings,
    dof: str,
    craft: MavlinkCraft,
    cruise: _Cruise,
) -> Trial:
    least = craft.least_period
    relay = relay_for(settings, dof, craft.firmware.kind, cruise.throttle, output, name, least_period=least)
    flown = sequencer.fly(relay, name)
    if flown.outcome.ending == "aborted":
        raise NotAchieved(f"{name}: {flown.outcome.reason}")
    return flown.trial


def _turn_about(
    wanted: bool, sequencer: Sequencer, settings: TuneSettings, craft: MavlinkCraft, cruise: _Cruise
) -> None:
    turn = turn_for(craft.firmware.kind, cruise.throttle)
    if wanted and turn is not None:
        sequencer.fly(turn, "turning about", replace(settings.envelope, heading_excursion=math.inf))


def _swing(sequencer: Sequencer, settings: TuneSettings, craft: MavlinkCraft, cruise: _Cruise, number: int) -> Trial:
    """Fly one of a boat's surge experiments, the second on the way back."""
    _turn_about(number > 0, sequencer, settings, craft, cruise)
    name = f"throttle-{number + 1}"
    flown = sequencer.fly(throttle_steps_for(cruise.throttle, number, name), name)
    if flown.outcome.ending == "aborted":
        raise NotAchieved(f"{name}: {flown.outcome.reason}")
    return flown.trial


def _cruise(settings: TuneSettings, dof: str, craft: MavlinkCraft) -> _Cruise:
    """A boat's rudder, and its drag, need way on. An ROV starts from rest."""
    if craft.firmware.kind != "boat":
        return _Cruise(settings.throttle or 0.0, settings.speed or 0.0)
    present = craft.parameters.read_existing(["CRUISE_THROTTLE", "CRUISE_SPEED"])
    throttle = settings.throttle
    if throttle is None:
        throttle = present.get("CRUISE_THROTTLE", 50.0) / 100.0
    speed = settings.speed
    if speed is None:
        speed = present.get("CRUISE_SPEED", 1.0)
    return _Cruise(throttle, speed)


def _kind(settings: TuneSettings, craft: MavlinkCraft) -> str:
    return "throttle-step" if settings.axis == "surge" and craft.firmware.kind == "boat" else "self-oscillation"


def _maybe_more(settings: TuneSettings) -> str:
    if EXPERIMENTS[settings.axis] not in CHECKED or settings.most_relays < 3:
        return ""
    return ", and a third, as long again, if these cannot tell a dead band from a thrust curve"


def _announce(
    settings: TuneSettings, craft: MavlinkCraft, operator: Operator, watcher: Watcher, now: Observation
) -> None:
    armed = "leave the vehicle armed, as it is" if now.armed else "arm the vehicle, and disarm it at the end"
    dive = dive_for(EXPERIMENTS[settings.axis], craft.firmware.kind, now)
    modes, down = f"mode {craft.firmware.manual_mode}", ""
    if dive is not None:
        modes = f"modes {craft.firmware.hold_mode} and {craft.firmware.manual_mode}"
        down = f"dive to {dive.settings['depth']:g} m, then "
    for text in (
        f"{armed}; {TWITCHING}",
        f"use the {modes}, and go back to {now.mode} at the end",
        f"move: {ANNOUNCED if EXPERIMENTS[settings.axis] in CHECKED else ''}{down}two {_kind(settings, craft)} "
        f"experiments in {settings.axis}{_maybe_more(settings)}",
        "write no parameter",
    ):
        watcher.say(f"will {text}")
    if craft.session.transport.is_simulated:
        watcher.say("Go ahead? Simulated vehicle: not asking.")
    elif not ask(craft, operator, "Go ahead?"):
        raise OperatorStopped("not started: the answer was no; nothing was armed or moved")
