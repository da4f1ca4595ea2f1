"""``experiment``: fly the relay experiments of one degree of freedom, identify it, and change nothing."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

from gcs_autotune.axes import axis_kind
from gcs_autotune.craft import Observation
from gcs_autotune.errors import NotInformative, OperatorStopped, WrongVehicle
from gcs_autotune.identify import AxisFit, Structure, fit_axis
from gcs_autotune.identify.coupled.one_axis import with_actuator
from gcs_autotune.identify.model_file import save_model
from gcs_autotune.identify.surge import fit_surge
from gcs_autotune.link import MavlinkCraft
from gcs_autotune.manoeuvres import restore_on_exit
from gcs_autotune.report import render_study
from gcs_autotune.trial import Trial
from gcs_autotune.watch import Watcher
from gcs_autotune.workflow.aboard import TWITCHING, come_aboard, say_link_times
from gcs_autotune.workflow.announcement import after_a_silence, battery, how_long, room
from gcs_autotune.workflow.desk import Desk
from gcs_autotune.workflow.experiments import dive_for, relay_for, second_output, throttle_steps_for
from gcs_autotune.workflow.helm import Helm
from gcs_autotune.workflow.identification import delay_of
from gcs_autotune.workflow.itinerary import Itinerary, Paced, legs_of_experiment
from gcs_autotune.workflow.ledger import Ledger
from gcs_autotune.workflow.operator import Operator
from gcs_autotune.workflow.preflight import see_depth_is_told, see_signs, sign_check_for
from gcs_autotune.workflow.readiness import make_ready
from gcs_autotune.workflow.record import RunDirectory
from gcs_autotune.workflow.settings import TuneSettings
from gcs_autotune.workflow.study import study_of
from gcs_autotune.workflow.third_level import ThirdLevel, fly_third, third_level
from gcs_autotune.workflow.thrust_curve import fit_thrust_curve, told
from gcs_autotune.workflow.waiting import agreed, beside, think
from gcs_autotune.workflow.warming import warmed, warming

__all__ = ["experiment"]


@dataclass(frozen=True, slots=True)
class _Cruise:
    """How a boat goes while it swings: throttle fraction and speed [m/s]."""

    throttle: float
    speed: float


def experiment(settings: TuneSettings, operator: Operator, watcher: Watcher, when: str = "") -> AxisFit:
    """Fly, record and identify; the run directory gets ``trials/``, ``telemetry.tlog``, ``fit.json``, ``report.html``.

    No parameter is written. The craft is left as found on every ending.

    Raises
    ------
    WrongVehicle
        A boat has no heave.
    OperatorStopped, GuardTripped, NotAchieved, LinkError, NotInformative
        What ended it early; the record is on disk.
    """
    record = RunDirectory(settings.directory)
    dof = axis_kind(settings.axis).dof
    with (
        warming(settings.connection.uri, [dof], []) as desk,
        come_aboard(settings.connection, operator, watcher, record, settings.control_rate, settings.axis) as craft,
    ):
        if dof == "heave" and craft.firmware.floats:
            raise WrongVehicle(f"this vehicle ({craft.firmware.name}, a boat) does not heave; try heading or surge")
        see_depth_is_told(craft, dof)
        warmed(craft, desk, watcher)
        now = craft.observe()
        itinerary = Itinerary(
            legs_of_experiment(dof, under_way=craft.firmware.needs_way, dives=_dives(dof, craft, now))
        )
        _announce(settings, craft, operator, watcher, now, itinerary)
        watcher = Paced(watcher, itinerary)
        ledger = Ledger(record, settings.connection, watcher.say)
        try:
            with restore_on_exit(craft, watcher, ledger.settle) as found:
                ledger.open(craft, found)
                make_ready(craft, watcher)
                craft.arm()
                say_link_times(craft, watcher)
                helm, trials = _fly(settings, dof, craft, operator, watcher, record, desk)
                delay = delay_of(settings)
                surge = dof == "surge" and craft.firmware.needs_way
                if surge:
                    fit = think(craft, desk, helm.bear, fit_surge, trials, structure=settings.structure, delay=delay)
                else:
                    fit = think(
                        craft, desk, helm.bear, fit_axis, trials, dof=dof, structure=settings.structure, delay=delay
                    )
                    fit = _with_curve(settings, trials, fit, craft, watcher, desk, helm)
        finally:
            ledger.leave()
    (record.path / "fit.json").write_text(json.dumps(fit.to_dict(), indent=1) + "\n", encoding="utf-8")
    save_model(fit, record.path / "model.json")
    page = render_study(study_of(fit, [trial.proper for trial in trials], f"Experiment: {settings.axis}", when))
    (record.path / "report.html").write_text(page, encoding="utf-8")
    return fit


def _with_curve(
    settings: TuneSettings,
    trials: list[Trial],
    plain: AxisFit,
    craft: MavlinkCraft,
    watcher: Watcher,
    desk: Desk,
    helm: Helm,
) -> AxisFit:
    """Return the model with the thrust curve or dead band that the record calls for, *plain* when it calls for none."""
    if settings.structure is not None:
        return plain
    curved = think(craft, desk, helm.bear, fit_thrust_curve, trials, plain, None)
    if curved is None:
        return plain
    watcher.say(told(curved, plain))
    return with_actuator(curved, plain)


def _fly(
    settings: TuneSettings,
    dof: str,
    craft: MavlinkCraft,
    operator: Operator,
    watcher: Watcher,
    record: RunDirectory,
    desk: Desk,
) -> tuple[Helm, list[Trial]]:
    cruise, firmware = _cruise(settings, dof, craft), craft.firmware
    settings = replace(settings, speed=cruise.speed, envelope=replace(settings.envelope, cruise=cruise.speed))
    helm = Helm(
        craft,
        settings.envelope,
        watcher,
        lambda trial: beside(craft, partial(record.keep, trial)),
        settings.patience,
        partial(agreed, craft, operator, watcher),
    )
    if dof == "surge" and firmware.needs_way:
        return helm, [_swing(helm, cruise, n) for n in range(2)]
    room = 0.9 - abs(cruise.throttle) if dof == "surge" else 0.9
    output, trials = settings.relay_output, list[Trial]()
    check = sign_check_for(dof, firmware, craft.servos, cruise.throttle, needs_speed=False, output=output)
    see_signs(check, helm.fly)
    dive = dive_for(dof, firmware, craft.observe())
    if dive is not None:
        helm.achieve(dive, "diving")
    for name in ("relay-1", "relay-2"):
        if trials:
            helm.come_about(cruise.throttle)
        least = craft.least_period
        relay = relay_for(
            settings, dof, cruise.throttle, output, name, keep_still=not firmware.needs_way, least_period=least
        )
        trials.append(helm.achieve(relay, name).trial)
        output = second_output(trials[-1], room)
    if settings.most_relays > len(trials):
        third = think(craft, desk, helm.bear, _third, trials, dof, settings.structure, delay_of(settings))
        if third is not None:
            helm.come_about(cruise.throttle)
            trials += fly_third(third, settings, dof, craft, cruise.throttle, helm, watcher)
    return helm, trials


def _third(
    trials: list[Trial], dof: str, structure: Structure | None, delay: float | Literal["auto"]
) -> ThirdLevel | None:
    try:
        return third_level(trials, fit_axis(trials, dof=dof, structure=structure, delay=delay))
    except NotInformative:
        return None


def _swing(helm: Helm, cruise: _Cruise, number: int) -> Trial:
    """Fly one of a boat's surge experiments, the second on the way back."""
    if number:
        helm.come_about(cruise.throttle)
    name = f"throttle-{number + 1}"
    return helm.achieve(throttle_steps_for(cruise.throttle, number, name), name).trial


def _cruise(settings: TuneSettings, dof: str, craft: MavlinkCraft) -> _Cruise:
    """A boat's rudder, and its drag, need way on. An ROV starts from rest."""
    if not craft.firmware.needs_way:
        return _Cruise(settings.throttle or 0.0, settings.speed or 0.0)
    present = craft.parameters.read_existing(["CRUISE_THROTTLE", "CRUISE_SPEED"])
    throttle = settings.throttle
    if throttle is None:
        throttle = present.get("CRUISE_THROTTLE", 50.0) / 100.0
    speed = settings.speed
    if speed is None:
        speed = present.get("CRUISE_SPEED", 1.0)
    return _Cruise(throttle, speed)


def _dives(dof: str, craft: MavlinkCraft, now: Observation) -> bool:
    return dive_for(dof, craft.firmware, now) is not None


def _kind(settings: TuneSettings, craft: MavlinkCraft) -> str:
    return (
        "throttle-step" if axis_kind(settings.axis).dof == "surge" and craft.firmware.needs_way else "self-oscillation"
    )


def _maybe_more(settings: TuneSettings) -> str:
    if settings.most_relays < 3:
        return ""
    return ", and a third, as long again, if these cannot tell a dead band from a thrust curve"


def _announce(
    settings: TuneSettings,
    craft: MavlinkCraft,
    operator: Operator,
    watcher: Watcher,
    now: Observation,
    itinerary: Itinerary,
) -> None:
    armed = "leave the vehicle armed, as it is" if now.armed else "arm the vehicle, and disarm it at the end"
    dive = dive_for(axis_kind(settings.axis).dof, craft.firmware, now)
    modes, down = f"mode {craft.firmware.manual_mode}", ""
    if dive is not None:
        modes = f"modes {craft.firmware.hold_mode} and {craft.firmware.manual_mode}"
        down = f"dive to {dive.settings['depth']:g} m, then "
    for text in (
        f"{armed}; {TWITCHING}",
        f"use the {modes}, and go back to {now.mode} at the end",
        f"move: {axis_kind(settings.axis).excitation.check}{down}two {_kind(settings, craft)} "
        f"experiments in {settings.axis}{_maybe_more(settings)}",
        room(axis_kind(settings.axis).dof, _cruise(settings, axis_kind(settings.axis).dof, craft).speed, settings, now),
        how_long(itinerary),
        battery(now, settings.envelope, itinerary.seconds),
        *after_a_silence(settings, now),
        "write no parameter",
    ):
        watcher.say(f"will {text}")
    if not agreed(craft, operator, watcher, "Go ahead?"):
        raise OperatorStopped("not started: the answer was no; nothing was armed or moved")
