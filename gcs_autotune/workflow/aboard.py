"""``aboard``: the autopilot itself flies the experiments of an axis, by a Lua script, for a link too slow to fly them.

The script is uploaded, loads, removes its own file, and starts when a parameter has its number. This program only
watches. Everything that the script recorded is in the vehicle's dataflash log, which is fetched afterwards.
"""

from __future__ import annotations

import math
import random
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

from gcs_autotune.axes import axis_kind
from gcs_autotune.errors import (
    AutotuneError,
    DataError,
    GuardTripped,
    LinkLost,
    NotAchieved,
    PreconditionFailed,
    TelemetryFault,
    UsageError,
    WrongVehicle,
)
from gcs_autotune.identify import AxisFit, fit_axis
from gcs_autotune.link import Journal, MavlinkCraft, ParameterTransaction, ScriptLoan, script_folder
from gcs_autotune.logs import ABOARD_ENDS, ABOARD_ROWS, runs_aboard
from gcs_autotune.logs import record as read_log
from gcs_autotune.manoeuvres import (
    ABOARD_ENDINGS,
    ABOARD_PLAN,
    MOST_CORNERS,
    AboardEnding,
    AboardScript,
    headroom,
)
from gcs_autotune.observer import Observer, Progress
from gcs_autotune.trial import Trial
from gcs_autotune.untrusted_text import quoted
from gcs_autotune.workflow.announcement import battery, how_long, room
from gcs_autotune.workflow.context import TuneContext
from gcs_autotune.workflow.experiment import learn, leave_experiment
from gcs_autotune.workflow.experiments import SHALLOW, Relays
from gcs_autotune.workflow.flight_area import area_of_flight
from gcs_autotune.workflow.identification import delay_of
from gcs_autotune.workflow.itinerary import Itinerary, Leg, legs_of_experiment, pace_of
from gcs_autotune.workflow.mission import Mission, Visit, run_mission, watching
from gcs_autotune.workflow.operator import Operator
from gcs_autotune.workflow.record import RunDirectory
from gcs_autotune.workflow.settings import TuneSettings
from gcs_autotune.workflow.tune_log import TuneLog
from gcs_autotune.workflow.tune_preview import excursion_of

__all__ = ["AboardSettings", "fly_aboard"]

FILE = "gcs_autotune_aboard.lua"
"""Name of the script's file on the vehicle."""
STEPS = {"heading": math.radians(60.0), "depth": 0.5}
"""Axis -> size of the step that the script flies [rad or m]. Project choice."""
HEAP = 65536
"""Smallest SCR_HEAP_SIZE [bytes] for the script. Project choice; the script reports what it uses."""
READY, GRACE = 20.0, 30.0
"""Longest time [s] from loading the script to its first message, and from its last possible end to its last message.
Project choice.
"""
BY_OTHERS = ("mode changed", "disarmed")
"""Endings whose cause the vehicle's heartbeat shows."""
LEAN_LOG = {"LOG_BITMASK": 0.0}
"""Parameters that are set during the run, so that the log contains little but the script's rows. A slow link has to
carry it.
"""
_SCRIPTING = ("SCR_ENABLE", "SCR_HEAP_SIZE", "SCR_DIR_DISABLE", "LOG_BACKEND_TYPE", *LEAN_LOG)
_STARTERS = tuple(f"SCR_USER{n}" for n in range(6, 0, -1))
_NO_SCRIPTS = 2
"""Bit of SCR_DIR_DISABLE for the folder on the SD card."""
_TO_FILE = 1
"""Bit of LOG_BACKEND_TYPE for logs on the SD card."""


@dataclass(frozen=True, slots=True)
class AboardSettings:
    """One experiment aboard: the settings that every experiment has, and the script's own.

    silence : longest time without a heartbeat of this program after which the script ends [s]; 0: any.
    """

    tune: TuneSettings
    silence: float = 10.0


def fly_aboard(settings: AboardSettings, operator: Operator, observer: Observer, when: str = "") -> AxisFit:
    """Have the autopilot fly two relays and a step, fetch its log, identify the craft and return the record.

    The run directory is that of :func:`.experiment`, with the onboard log. However the run ends, script, parameters,
    mode and armed state are restored.

    Raises
    ------
    WrongVehicle
        The firmware has no scripting.
    PreconditionFailed
        Scripting is off, has too little memory, or the vehicle does not answer MAVLink FTP.
    OperatorStopped, GuardTripped, NotAchieved, LinkError, NotInformative
        The cause of an early end; what was recorded is on disk.
    """
    tune = replace(settings.tune, fetch_log=True)
    record, log = RunDirectory(tune.directory), TuneLog(tune, when, observer, "aboard")
    dof = axis_kind(tune.axis).dof
    visit = watching(tune, operator, log, record, tune.axis, (dof,))
    flight = _Flight(settings)
    with record.summarised(f"aboard {tune.axis}", when, log):
        try:
            onboard = run_mission(visit, flight.declare, log)
        except AutotuneError:
            flight.keep_runs(record, log)
            raise
        flight.keep_runs(record, log, onboard.path)
        flight.check_ending()
        fit = fit_axis(flight.runs, dof=dof, structure=tune.structure, delay=delay_of(tune))
    leave_experiment(record, fit, flight.runs, f"Experiment aboard: {tune.axis}", when)
    return fit


@dataclass(slots=True, eq=False)
class _Flight:
    """One experiment aboard one vehicle; ``runs`` are known once the log is fetched."""

    settings: AboardSettings
    runs: list[Trial] = field(default_factory=list)
    ending: str = ""
    _visit: Visit[TuneLog] = field(init=False)
    _context: TuneContext = field(init=False)
    _script: AboardScript = field(init=False)
    _transaction: ParameterTransaction | None = None
    _loan: ScriptLoan | None = None
    _about: dict[str, object] = field(default_factory=dict)
    _stages: tuple[str, ...] = ()
    _lean: dict[str, float] = field(default_factory=dict)
    _heard: int = 0

    def declare(self, visit: Visit[TuneLog]) -> Mission:
        """Return what will be flown on the vehicle of *visit*; nothing moves yet."""
        self._visit = visit
        self._context = context = learn(self.settings.tune, visit)
        craft, settings = visit.craft, context.settings
        axis = context.axis
        if axis.name not in STEPS:
            raise UsageError(
                f"`aboard` flies {' and '.join(STEPS)}, not {axis.name}. Use `gcs-autotune experiment {axis.name}`"
            )
        now = craft.observe()
        if axis.excitation.below_surface and not now.z >= SHALLOW:
            raise PreconditionFailed(f"the vehicle is {now.z:.1f} m deep. Dive to 1.5 m first. Nothing was armed")
        present = _check_scripting(craft)
        self._lean = {name: value for name, value in LEAN_LOG.items() if name in present}
        itinerary = _itinerary(context)
        self._stages = tuple(leg.stage for leg in itinerary.legs)
        whole = excursion_of(context, now, (itinerary,))
        self._script = self._made(context, present)
        count = len(self._script.text)
        names = ", ".join((*self._lean, self._script.go))
        ends = f", or after {self.settings.silence:g} s without contact (--silence)" if self.settings.silence else ""
        return Mission(
            itinerary=itinerary,
            modes=(craft.firmware.manual_mode,),
            movements=(
                f"two self-oscillations and a step in {axis.name}, flown by a script on the autopilot. It ends on any "
                f"movement of a stick, change of mode or failsafe{ends}. This program only watches"
            ),
            needs=(
                room(axis.dof, context.speed, settings, now, whole),
                how_long(itinerary),
                battery(now, settings.envelope, itinerary.seconds),
            ),
            fly=self._fly,
            writes=(
                f"write {names}, and upload the script {self._script.path} ({count / 1000:.0f} kB). Other scripts of "
                "the vehicle are started again. Parameters are restored and the script is removed at the end"
            ),
            load=self._load,
            unload=self._unload,
        )

    def _made(self, context: TuneContext, present: dict[str, float]) -> AboardScript:
        """Return the script for the vehicle."""
        settings, craft, axis = context.settings, context.craft, context.axis
        envelope = replace(settings.envelope, cruise=context.speed)
        envelope = replace(envelope, area=area_of_flight(craft, envelope.area, context.log))
        corners = 0 if envelope.area is None else sum(len(zone.corners) for zone in envelope.area.zones)
        if corners > MOST_CORNERS:
            raise PreconditionFailed(
                f"the permitted area has {corners} corners; a script can watch {MOST_CORNERS}. Use a simpler area or "
                "fence. Nothing was armed"
            )
        if craft.firmware.floats:
            envelope = replace(envelope, depth_excursion=math.inf, depth_min=0.0)
        relay = Relays.of(settings, axis.dof, craft, context.throttle).relay_settings(settings.relay_output)
        most = min(relay.most_output, headroom(craft.servos, relay.force, relay.throttle))
        if (relay.output is not None and relay.output > most) or most < relay.first_output:
            raise PreconditionFailed(
                f"at a throttle of {relay.throttle:.0%} only {most:.0%} of full output is left for {axis.name}. Use a "
                f"smaller --throttle{' or --relay-output' if relay.output is not None else ''}. Nothing was armed"
            )
        free = [name for name in _STARTERS if present.get(name) == 0.0]
        if not free:
            raise PreconditionFailed(
                "scripts of this vehicle use all SCR_USERn parameters (none is 0), and `aboard` needs one to start its "
                "own. Set one of them to 0 if it is not used. Nothing was armed"
            )
        return AboardScript(
            relay=replace(relay, most_output=most),
            servos=craft.servos,
            envelope=envelope,
            mode=craft.firmware.modes[craft.firmware.manual_mode],
            token=random.SystemRandom().randrange(1000, 10000),
            go=free[0],
            path=f"{script_folder(craft.session)}/{FILE}",
            sticks=craft.stick_channels,
            rows=ABOARD_ROWS.logged,
            ends=ABOARD_ENDS.logged,
            step=STEPS[axis.name],
            silence=self.settings.silence,
        )

    # --- on the vehicle -----------------------------------------------------------------------------------

    def _load(self, journal: Journal) -> None:
        """Set the parameters of a lean log, load the script and wait for its first message."""
        craft, log, script = self._visit.craft, self._visit.log, self._script
        self._heard = craft.session.texts.count
        self._transaction = ParameterTransaction(craft.parameters, journal)
        self._transaction.lend([script.go])
        self._transaction.set(self._lean)
        self._loan = ScriptLoan(craft.session, craft.commands, journal, script.path)
        log.say("uploading the script")
        self._loan.load(script.text)
        if not craft.session.wait_for(lambda: True if self._word() else None, READY):
            raise PreconditionFailed(
                f"the script does not run{self._errors()}. If SCR_ENABLE was 0 when the autopilot started, restart it. "
                "If its memory is too small, raise SCR_HEAP_SIZE and restart it. Nothing was armed"
            )
        log.say("the script is loaded, and waits for its start")

    def _fly(self, journal: Journal) -> None:
        """Start the script, watch it to its end, and make sure that it has ended."""
        craft, script = self._visit.craft, self._script
        if craft.has_receiver:
            craft.release()  # the script sees the sticks only if they are the receiver's
        transaction = self._transaction
        assert transaction is not None
        self._heard = craft.session.texts.count
        craft.start_recording("aboard")
        try:
            transaction.set({script.go: float(script.token)})
            self._watch()
        finally:
            with craft.shielded(), suppress(AutotuneError):
                craft.parameters.write(script.go, 0.0)
            self._about = dict(craft.stop_recording(self.ending).meta)
        if self.ending.startswith("stick"):
            craft.yield_to(f"stick {self.ending.removeprefix('stick').strip()} of the transmitter was moved")

    def _watch(self) -> None:
        craft, log = self._visit.craft, self._visit.log
        begun, begin, stage = craft.observe().t, "", "approach"
        while True:
            try:
                now = craft.observe()
            except (LinkLost, TelemetryFault) as error:
                self._outlast(error)
                continue
            word = self._word()
            if _meaning(word) is not None:
                self.ending = word
                if word in BY_OTHERS:
                    craft.await_heartbeat()
                    craft.observe()  # raises what changed it, if that was not this program
                return
            if word.startswith("begin") and word != begin:
                begin, part = word, int(word.split()[1])
                stage = self._stages[part - 1]
                log.say(f"{stage} (part {part} of {len(ABOARD_PLAN)})")
            signal = self._context.axis.excitation.signal
            log.update(
                Progress(stage, "aboard", now.t, signal, now.value(signal), age=now.age, x=now.x, y=now.y, psi=now.psi)
            )
            if self._errors() or now.t - begun > self._script.whole + GRACE:
                raise NotAchieved(f"the script did not report its end{self._errors()}. Its outputs ended in neutral")

    def _outlast(self, error: AutotuneError) -> None:
        """Wait for a vehicle that fell silent, or whose telemetry is missing. The script flies on or ends by itself.

        Raises
        ------
        LinkLost, TelemetryFault
            The *error*, if the silence lasts longer than the patience, or the autopilot has restarted.
        """
        craft, patience = self._visit.craft, self.settings.tune.patience
        self._visit.log.say(f"{error}. The script flies on or ends by itself; waiting for up to {patience:.0f} s")
        begun, ticks = craft.clock.now(), craft.telemetry.output_ticks
        while not craft.telemetry.watchdog.has_restarted and craft.clock.now() - begun < patience:
            with suppress(LinkLost):
                if craft.session.await_return(patience) and craft.session.wait_for(
                    lambda: True if craft.telemetry.output_ticks > ticks or _meaning(self._word()) else None, 1.0
                ):
                    return
        raise error

    def _unload(self) -> None:
        """Remove the script and restore the parameters."""
        errors: list[AutotuneError] = []
        for back in (self._loan, self._transaction):
            try:
                if back is not None:
                    back.give_back()
            except AutotuneError as error:
                errors.append(error)
        if errors:
            raise errors[0]

    def _word(self) -> str:
        """Return the last word of the script about itself; empty if it has not spoken since the last stage."""
        texts = [text.text for text in self._visit.craft.session.texts.since(self._heard)]
        begin = f"aboard {self._script.token} "
        return next((text.removeprefix(begin) for text in reversed(texts) if text.startswith(begin)), "")

    def _errors(self) -> str:
        """Return what the autopilot reports about scripts that fail, in brackets; empty if nothing."""
        texts = [text.text for text in self._visit.craft.session.texts.since(self._heard)]
        bad = [text for text in texts if text.startswith("Lua:") or "allocate memory" in text]
        return f" (its message: {quoted(bad[-2:])})" if bad else ""

    # --- afterwards ---------------------------------------------------------------------------------------

    def keep_runs(self, record: RunDirectory, log: TuneLog, path: Path | None = None) -> None:
        """Store the runs in the onboard log at *path*, or in the one that was fetched after an early end."""
        path = path or next(iter(sorted(record.path.glob("onboard-*.bin"))), None)
        if path is None or self.runs:
            return
        relay = self._script.relay
        meta = {
            **self._about,
            "dof": self._context.axis.dof,
            "signal": relay.signal,
            "throttle": relay.throttle,
            "outputs_dated": "at the command",
        }
        try:
            found = read_log(path)
            assert found is not None
            self.runs = runs_aboard(found, ABOARD_PLAN, relay.force, meta)
        except DataError as error:
            log.say(f"{path.name}: {error}")
            return
        for run in self.runs:
            record.keep(run)
            log.flown(run)
            log.say(f"{run.name}: {run.ending} ({run.duration:.0f} s recorded)")

    def check_ending(self) -> None:
        """Check that the script ended well and left runs to identify from.

        Raises
        ------
        GuardTripped
            A limit or a person ended it. NotAchieved: the log was not fetched. NotInformative: it contains no run.
        """
        meaning = _meaning(self.ending)
        assert meaning is not None
        if meaning.ending == "aborted":
            raise GuardTripped(
                f"the script ended: {meaning.why}. The actuators are neutral", guard=self.ending, advice=meaning.advice
            )
        if not self.runs:
            raise NotAchieved(
                "there is no record: the onboard log was not fetched. Use `gcs-autotune logs fetch`, and `gcs-autotune "
                "identify` with the file"
            )


def _meaning(word: str) -> AboardEnding | None:
    """Return the ending that *word* of the script reports; None if it is not an ending."""
    return ABOARD_ENDINGS.get("stick" if word.startswith("stick") else word)


def _check_scripting(craft: MavlinkCraft) -> dict[str, float]:
    """Return the parameters of scripting and logging.

    Raises
    ------
    WrongVehicle
        The firmware has no scripting.
    PreconditionFailed
        It is off, has too little memory, or no log is written.
    """
    found = craft.parameters.read_existing([*_SCRIPTING, *_STARTERS])
    if "SCR_ENABLE" not in found:
        raise WrongVehicle(
            f"{craft.session.vehicle} has no scripting (no parameter SCR_ENABLE). Boards with 1 MB of flash lack it. "
            "Use `gcs-autotune experiment` over a faster link"
        )
    if not found["SCR_ENABLE"] > 0.0:
        raise PreconditionFailed(
            "scripting is off. Set SCR_ENABLE to 1 and restart the autopilot (disarmed), then start again. It may stay "
            "on afterwards. Nothing was armed"
        )
    if int(found.get("SCR_DIR_DISABLE", 0.0)) & _NO_SCRIPTS:
        raise PreconditionFailed(
            "SCR_DIR_DISABLE keeps the autopilot from loading scripts from its SD card. Set it to 0 and restart the "
            "autopilot. Nothing was armed"
        )
    heap = found.get("SCR_HEAP_SIZE", math.inf)
    if heap < HEAP:
        raise PreconditionFailed(
            f"SCR_HEAP_SIZE is {heap:.0f} bytes; the script needs {HEAP}. Set it to {HEAP} and restart the autopilot "
            "(disarmed). Nothing was armed"
        )
    if not int(found.get("LOG_BACKEND_TYPE", 1.0)) & _TO_FILE:
        raise PreconditionFailed(
            "LOG_BACKEND_TYPE does not contain 1 (File), so the script cannot record. Set it to 1 and restart the "
            "autopilot. Nothing was armed"
        )
    return found


def _itinerary(context: TuneContext) -> Itinerary:
    """Return the stages: the approach is part of each."""
    pace = pace_of(context.craft.steered_by)
    first, second = legs_of_experiment(context.axis.dof, pace, dives=False)[-2:]
    return Itinerary((first, second, Leg("step", 0.3 * pace.relay, before=pace.turn, kind="step")), pace.turn)
