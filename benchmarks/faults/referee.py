"""Play one tune with faults, then ask the vehicle itself, then restore, then ask again."""

from __future__ import annotations

import gc
import json
import math
import os
import resource
import shutil
import signal
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from benchmarks.faults.case import STEP_DURATION, Case
from benchmarks.faults.desk import cheap_desk
from benchmarks.faults.fault import STATION_KINDS, Fault
from benchmarks.faults.link import Killed
from benchmarks.faults.station import Order, OtherStation, misattributed, overruled
from benchmarks.faults.vehicle import Condition, Moored, VehicleAsFound, events
from gcs_autotune.effects import ExtendedModel
from gcs_autotune.errors import AutotuneError, NotAsFound, exit_code
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.identify.axis.form import as_extended
from gcs_autotune.identify.model_file import load_model
from gcs_autotune.manoeuvres import DISARMED_ITSELF
from gcs_autotune.models import SingleDof
from gcs_autotune.observer import SilentObserver
from gcs_autotune.workflow import TuneSettings, Unattended, restore_run, tune
from gcs_autotune.workflow.restore import is_settled
from sitl import open_vehicle

__all__ = ["Outcome", "play"]

_WHEN = "2026-11-21T12:00:00"
_PATIENCE = 1500.0
"""Seconds of link time after which a tune counts as hanging."""
_GAINS: Mapping[tuple[str, str], str] = {
    ("heading", "ardurover"): "ATC_STR_RAT_P",
    ("heading", "ardusub"): "ATC_RAT_YAW_P",
    ("depth", "ardusub"): "PSC_ACCZ_P",
}
"""Axis and firmware -> a gain that a tune of it writes, and the other station too."""
_WORK = 60
"""Seconds of the processor's time after which anything does; the wall clock would count other people's work."""
_SETTLE = 15.0
"""Seconds given to the firmware's own time-outs after the tool is gone."""


@dataclass(slots=True)
class Outcome:
    """One case and what came of it. ``failures`` empty: as it must be."""

    case: dict[str, Any]
    ending: str = ""
    code: int = 0
    message: str = ""
    proved: bool = False
    writes: int = 0
    as_found_at_once: bool = False
    restored: str = ""
    orders: int = 0
    ties: int = 0
    failures: list[str] = field(default_factory=list)
    seconds: float = 0.0

    def to_json(self) -> str:
        """One line."""
        return json.dumps(asdict(self))


class _Ear(SilentObserver):
    def __init__(self) -> None:
        self.said: list[str] = []

    def say(self, text: str) -> None:
        self.said.append(text)
        self.hear(text)

    def hear(self, text: str) -> None:
        """Somebody else who wants to know."""


class _Operator(Unattended):
    stopped = False

    def stop_requested(self) -> bool:
        return self.stopped


class _Person(_Operator):
    """Somebody at the keyboard, who *overrules* other operators or does not, and agrees to all else."""

    answered_beforehand = False

    def __init__(self, *, overrules: bool) -> None:
        super().__init__()
        self._overrules = overrules

    def ask(self, question: str, while_waiting: Callable[[], object]) -> bool:
        return self._overrules if "Another operator" in question else True


class _Stage:
    """One running of the tool (a tune or a restore) in this process, and the acts that can befall it."""

    def __init__(self, vehicle: VehicleAsFound, directory: Path, seed: int) -> None:
        self.vehicle, self.directory = vehicle, directory
        self.operator, self.ear = _Operator(), _Ear()
        self.snapshot: bytes | None = None
        self.was_killed = False
        self.rebooted_unseen = False
        self._seed = seed
        self._connection: Moored | None = None
        self.found_at = math.inf
        self.ear.hear = self._hear  # type: ignore[method-assign]

    def _hear(self, text: str) -> None:
        if text.startswith("State before the run: mode"):
            self.found_at = self.vehicle.server.now

    @property
    def journal(self) -> Path:
        return self.directory / "journal.jsonl"

    def connection(self, faults: tuple[Fault, ...]) -> Moored:
        acts: Mapping[str, Callable[[Fault], None]] = {
            "killed": self._killed,
            "reboot": self._reboot,
            "disk-full": lambda f: _limit_files(0),
            "operator": self._stop,
            "stall": self._stall,
            **dict.fromkeys([k for k in STATION_KINDS if k != "stall"], self._interfere),
        }
        self._connection = self.vehicle.connection(faults, seed=self._seed, acts=acts, patience=_PATIENCE)
        return self._connection

    def _stall(self, fault: Fault) -> None:
        """The computer stands still: the vehicle's time goes on, and nothing is sent."""
        assert self._connection is not None
        clock: Any = self._connection.opened[-1].clock
        clock.advance(fault.size)

    def _interfere(self, fault: Fault) -> None:
        assert self.vehicle.station is not None
        self.vehicle.station.act(fault)

    def _reboot(self, fault: Fault) -> None:
        self.rebooted_unseen |= not self.journal.exists()
        self.vehicle.server.reboot_soon()

    def _stop(self, fault: Fault) -> None:
        self.operator.stopped = True

    def _killed(self, fault: Fault) -> None:
        self.was_killed = True
        self.snapshot = self.journal.read_bytes() if self.journal.exists() else None

    def run(self, work: Callable[[], Any]) -> tuple[Any, BaseException | None]:
        """Do it; return (result, what it raised). What a killed tool wrote while unwinding is taken back."""
        result, error = None, None
        signal.signal(signal.SIGPROF, _too_long)
        signal.setitimer(signal.ITIMER_PROF, _WORK)
        try:
            result = work()
        except (Killed, Exception) as caught:  # noqa: BLE001 - the referee looks at whatever comes
            error = caught
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            _limit_files(resource.RLIM_INFINITY)
        if self.was_killed:
            _close_descriptors(self.journal)
            if self.snapshot is None:
                self.journal.unlink(missing_ok=True)
            else:
                self.journal.write_bytes(self.snapshot)
        return result, error


def play(case: Case, keep: Path | None = None) -> Outcome:
    """Play *case* and judge it."""
    begun = time.process_time()
    outcome = Outcome(case.to_dict())
    folder = Path(tempfile.mkdtemp(prefix="faulted-")) if keep is None else keep
    try:
        _Play(case, folder, outcome).run()
    finally:
        if keep is None:
            shutil.rmtree(folder, ignore_errors=True)
    gc.collect()
    outcome.seconds = time.process_time() - begun
    return outcome


class _Play:
    def __init__(self, case: Case, folder: Path, outcome: Outcome) -> None:
        self.case, self.folder, self.outcome = case, folder, outcome
        parameters = {"SIM_RC_FAIL": 0.0 if case.has_receiver else 1.0, **case.subject.parameters}
        self.vehicle = VehicleAsFound(case.subject.vehicle, seed=case.index, parameters=parameters)
        self.vehicle.wait(5.0)
        autopilot = self.vehicle.server.vehicle.autopilot
        autopilot.set_mode(case.found_mode)
        if case.found_armed:
            autopilot.arm(force=True)
        self.vehicle.wait(5.0 if not case.found_armed else 0.1)
        self.booted = open_vehicle(case.subject.vehicle, seed=case.index, parameters=parameters).vehicle.autopilot
        self.found = self.vehicle.condition()
        if case.has_station:
            self.vehicle.station = OtherStation(self.vehicle, _GAINS[case.subject.axis, self.found_firmware])
        self.is_handed_over = False
        self.run_directory = folder / "run"
        self.vehicle.journal = self.run_directory / "journal.jsonl"

    def run(self) -> None:
        stage = _Stage(self.vehicle, self.run_directory, self.case.index)
        story, error = stage.run(lambda: self._tune(stage))
        outcome = self.outcome
        outcome.ending = "killed" if stage.was_killed else story.ending if story is not None else type(error).__name__
        outcome.code = 0 if error is None else exit_code(error)
        outcome.message = "" if error is None else str(error)[:600]
        if error is not None and not isinstance(error, (AutotuneError, Killed)):
            outcome.failures.append(f"{type(error).__name__}: {error}")
        self._know_earlier_orders(stage)
        self._check_writes()
        self.vehicle.wait(_SETTLE)
        proved = self._proved()
        outcome.proved = bool(proved)
        outcome.writes = len(self.vehicle.writes)
        now = self.vehicle.condition()
        self._take_its_word(now, stage.ear.said)
        if self.case.has_station:
            now = self._judge_station(stage, error, now)
        if stage.rebooted_unseen:
            self._look_again(now)
        differences = self._differences(now, proved)
        outcome.as_found_at_once = not differences
        journal = self.vehicle.journal
        is_begun = journal is not None and journal.exists()
        settled = not is_begun or is_settled(journal)
        if differences and not stage.was_killed and not self._is_said(error):
            outcome.failures.append(
                f"left {'; '.join(differences)}, and did not say so: {outcome.message or 'no error'}"
            )
        if differences and settled:
            outcome.failures.append(f"left {'; '.join(differences)}, and nothing to restore in the journal")
        if not settled:
            self._restore()
        left = self._differences(self.vehicle.condition(), proved)
        if left:
            outcome.failures.append(f"after restoring: {'; '.join(left)}")

    @property
    def found_firmware(self) -> str:
        """Which firmware the vehicle has."""
        return "ardurover" if self.vehicle.server.vehicle.data.is_boat else "ardusub"

    def _judge_station(self, stage: _Stage, error: BaseException | None, now: Condition) -> Condition:
        """Hold the tool to the orders of the other station; return the vehicle's condition once that one rests."""
        station, firmware = self.vehicle.station, FIRMWARE[self.found_firmware]
        assert station is not None
        orders = [o for o in station.orders if o.t >= stage.found_at]
        self.outcome.orders = len(orders)
        stops_in = [firmware.modes[name] for name in firmware.stops_in]
        broken, self.outcome.ties = overruled(orders, self.vehicle.ordered, stops_in)
        self.outcome.failures += broken
        if station.sticks_until > self.vehicle.server.now:
            self.vehicle.wait(station.sticks_until - self.vehicle.server.now + _SETTLE)
            now = self.vehicle.condition()
        for order in orders:
            if order.what == "mode":
                stays = now.mode == int(order.value)
                fell = not self.case.has_receiver and now.mode in stops_in  # its own radio failsafe, sticks let go
                if stays or fell:
                    self.found = replace(self.found, mode=now.mode, armed=now.armed)
                    self.is_handed_over = now.armed
        kinds = self._possible_causes(stage, orders)
        if kinds and error is not None and not isinstance(error, Killed):
            wrong = misattributed(" ".join((str(error), *stage.ear.said)), kinds)
            if wrong:
                self.outcome.failures.append(f"{wrong}: {str(error)[:400]}")
        return now

    def _possible_causes(self, stage: _Stage, orders: Sequence[Order]) -> list[str]:
        """Return the kinds of faults that may have ended the run: a stall only if it outlasts a failsafe's wait."""
        kinds = ["station-" + {"armed": "disarm"}.get(o.what, o.what) for o in orders]
        for fault in self.case.faults:
            waits = 2.2 if self.found_firmware == "ardurover" else 2.7
            if fault.kind == "stall" and not self.case.has_receiver and fault.size > waits:
                kinds.append("stall")
            elif fault.kind in ("reboot", "silence"):
                kinds.append(fault.kind)
        return kinds

    def _look_again(self, now: Condition) -> None:
        """It restarted before the tool had written down how it was found.

        What there was to be found is then a vehicle disarmed in the mode it boots in, unless the journal has the mode
        from before, or the vehicle is in it: the tool may have seen it in time.
        """
        if now.mode == self.found.mode:
            return
        firmware = FIRMWARE["ardurover" if self.vehicle.server.vehicle.data.is_boat else "ardusub"]
        path = self.vehicle.journal
        told = events(path.read_text(encoding="utf-8")) if path is not None and path.exists() else []
        was = next((e["mode"] for e in told if e["event"] == "opened"), "")
        if was != firmware.mode_name(self.found.mode):
            self.found = replace(self.found, mode=self.booted.mode.number, armed=False)

    def _take_its_word(self, now: Condition, said: Sequence[str]) -> None:
        """A craft found armed that disarmed itself stays so: arming is the operator's. But he must have been told."""
        if self.found.armed and not now.armed and any(DISARMED_ITSELF in text for text in said):
            self.found = replace(self.found, armed=False)

    def _differences(self, now: Condition, proved: Mapping[str, float]) -> list[str]:
        station = self.vehicle.station
        written = {o.name for o in station.orders if o.what == "write"} if station is not None else set()
        held = {**now.parameters, **{name: self.found.parameters[name] for name in written}}
        outputs = () if self.is_handed_over else now.outputs
        rest = {name: value for name, value in proved.items() if name not in written}
        return replace(now, parameters=held, outputs=outputs).differs_from(self.found, rest)

    def _know_earlier_orders(self, stage: _Stage) -> None:
        """What the other station did before the tool looked is how the tool found the vehicle."""
        for order in self.vehicle.station.orders if self.vehicle.station is not None else ():
            if order.t < stage.found_at and order.what == "mode":
                self.found = replace(self.found, mode=int(order.value))
            elif order.t < stage.found_at and order.what == "write":
                self.found = replace(self.found, parameters={**self.found.parameters, order.name: order.value})

    def _tune(self, stage: _Stage) -> Any:
        case, subject = self.case, self.case.subject
        given = None
        if not case.is_full:
            path = self.folder / "model.json"
            plain = as_extended(SingleDof(subject.dof, "1", *subject.model))
            path.write_text(json.dumps(ExtendedModel(plain.base, ()).to_dict()), encoding="utf-8")
            given = load_model(path)
        settings = TuneSettings(
            stage.connection(case.faults),
            self.run_directory,
            axis=subject.axis,
            given=given,
            step_duration=None if case.is_full else STEP_DURATION,
        )
        with cheap_desk(subject.vehicle, case.index):
            return tune(settings, stage.operator, stage.ear, _WHEN)

    def _restore(self) -> None:
        """Restore, at first with things going wrong again; then cleanly, which must do; then once more for nothing."""
        tries = [self.case.restore_faults, ()] if self.case.restore_faults else [()]
        error: BaseException | None = None
        for k, faults in enumerate(tries):
            stage = _Stage(self.vehicle, self.run_directory, self.case.index + 1 + k)
            connection = stage.connection(tuple(faults))
            _, error = stage.run(
                lambda c=connection, s=stage: restore_run(c, self.run_directory, s.operator, s.ear)  # type: ignore[misc]
            )
            if error is not None and not isinstance(error, (AutotuneError, Killed)):
                self.outcome.failures.append(f"restore: {type(error).__name__}: {error}")
            self.vehicle.wait(_SETTLE)
            self._take_its_word(self.vehicle.condition(), stage.ear.said)
        if isinstance(error, NotAsFound) and "without --yes" in str(error):
            if not self._may_be_left(error):
                self.outcome.failures.append(f"restore left what nobody else had ordered: {error}")
            error = self._decide()
        if error is not None:
            self.outcome.failures.append(f"restore failed: {error}")
        elif not is_settled(self.run_directory):
            self.outcome.failures.append("restore did not settle the journal")
        else:
            self.outcome.restored = "restored"

    def _may_be_left(self, error: NotAsFound) -> bool:
        """Whether another station may be behind all that *error* names, or a late copy of our own order."""
        station = self.vehicle.station
        if station is None:
            return not any(name in self.found.parameters for name in error.differences)
        ordered = {o.name if o.what == "write" else "state" for o in station.orders}
        return {n if n in self.found.parameters else "state" for n in error.differences} <= ordered

    def _decide(self) -> BaseException | None:
        """Let a person restore: one who overrules nobody where there is another station, and all else where not."""
        stage = _Stage(self.vehicle, self.run_directory, self.case.index + 9)
        stage.operator = _Person(overrules=self.vehicle.station is None)
        connection = stage.connection(())
        _, error = stage.run(lambda: restore_run(connection, self.run_directory, stage.operator, stage.ear))
        self.vehicle.wait(_SETTLE)
        return error

    def _proved(self) -> dict[str, float]:
        """Return what the journal says was kept."""
        path = self.vehicle.journal
        if path is None or not path.exists():
            return {}
        kept = [e["values"] for e in events(path.read_text(encoding="utf-8", errors="replace")) if e["event"] == "kept"]
        return {} if not kept else {str(n): float(v) for n, v in kept[-1].items()}

    def _check_writes(self) -> None:
        """Every write that arrived was on disk before, with the value that was really found."""
        for name, value, journal in self.vehicle.writes:
            told = events(journal)
            lent = {e["name"]: e["value"] for e in told if e["event"] == "lent"}
            if not any(e["event"] == "writing" and e["name"] == name for e in told) or name not in lent:
                self.outcome.failures.append(f"{name} = {value:g} was written before the journal had it")
            elif not math.isclose(lent[name], self.found.parameters[name], rel_tol=1e-6):
                self.outcome.failures.append(f"the journal says {name} was {lent[name]:g}")

    @staticmethod
    def _is_said(error: BaseException | None) -> bool:
        return error is not None and "gcs-autotune restore" in str(error)


def _limit_files(size: int) -> None:
    """Let no file of this process grow beyond *size* bytes."""
    _, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (hard if size == resource.RLIM_INFINITY else size, hard))


def _too_long(*_: object) -> None:
    raise TimeoutError(f"not done after {_WORK} s of computing")


def _close_descriptors(path: Path) -> None:
    """Close what a killed tool left open of *path*, as the system does for a process."""
    for entry in Path("/proc/self/fd").iterdir():
        try:
            if entry.readlink() == path:
                os.close(int(entry.name))
        except OSError:
            continue
