"""Run one tune with faults, check the state of the vehicle, restore, and check again."""

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

from benchmarks.faults.cached_design import cached_design
from benchmarks.faults.case import STEP_DURATION, Case
from benchmarks.faults.fault import STATION_KINDS, Fault
from benchmarks.faults.link import Killed
from benchmarks.faults.station import Order, OtherStation, misattributed, undone_orders
from benchmarks.faults.vehicle import Condition, FaultyConnection, VehicleAsFound, events
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

__all__ = ["Outcome", "run_case"]

_WHEN = "2026-11-21T12:00:00"
_PATIENCE = 1500.0
"""Link time [s] after which a tune counts as hanging."""
_GAINS: Mapping[tuple[str, str], str] = {
    ("heading", "ardurover"): "ATC_STR_RAT_P",
    ("heading", "ardusub"): "ATC_RAT_YAW_P",
    ("depth", "ardusub"): "PSC_ACCZ_P",
}
"""Axis and firmware -> a gain that both a tune and the other station write."""
_WORK = 60
"""Processor time [s] after which a tune counts as hanging. Wall time would include other programs."""
_SETTLE = 15.0
"""Time [s] for the firmware's time-outs after the tool has ended."""


@dataclass(slots=True)
class Outcome:
    """Result of one case; right if ``failures`` is empty."""

    case: dict[str, Any]
    ending: str = ""
    code: int = 0
    message: str = ""
    proved: bool = False
    writes: int = 0
    restored_at_once: bool = False
    restored: str = ""
    orders: int = 0
    ties: int = 0
    failures: list[str] = field(default_factory=list)
    seconds: float = 0.0

    def to_json(self) -> str:
        """Return one line."""
        return json.dumps(asdict(self))


class _Messages(SilentObserver):
    def __init__(self) -> None:
        self.texts: list[str] = []

    def say(self, text: str) -> None:
        self.texts.append(text)
        self.hear(text)

    def hear(self, text: str) -> None:
        """Do nothing; :class:`_Stage` replaces this."""


class _Operator(Unattended):
    stopped = False

    def stop_requested(self) -> bool:
        return self.stopped


class _Person(_Operator):
    """An operator at the keyboard who agrees to every question; *overrules*: also to overrule another operator."""

    answered_beforehand = False

    def __init__(self, *, overrules: bool) -> None:
        super().__init__()
        self._overrules = overrules

    def ask(self, question: str, while_waiting: Callable[[], object]) -> bool:
        return self._overrules if "Another operator" in question else True


class _Stage:
    """One run of the tool (tune or restore) in this process, and the events during it."""

    def __init__(self, vehicle: VehicleAsFound, directory: Path, seed: int) -> None:
        self.vehicle, self.directory = vehicle, directory
        self.operator, self.messages = _Operator(), _Messages()
        self.snapshot: bytes | None = None
        self.was_killed = False
        self.rebooted_unseen = False
        self._seed = seed
        self._connection: FaultyConnection | None = None
        self.found_at = math.inf
        self.messages.hear = self._hear  # type: ignore[method-assign]

    def _hear(self, text: str) -> None:
        if text.startswith("State before the run: mode"):
            self.found_at = self.vehicle.server.now

    @property
    def journal(self) -> Path:
        return self.directory / "journal.jsonl"

    def connection(self, faults: tuple[Fault, ...]) -> FaultyConnection:
        actions: Mapping[str, Callable[[Fault], None]] = {
            "killed": self._kill,
            "reboot": self._reboot,
            "disk-full": lambda f: _limit_files(0),
            "operator": self._stop,
            "stall": self._stall,
            **dict.fromkeys([k for k in STATION_KINDS if k != "stall"], self._interfere),
        }
        self._connection = self.vehicle.connection(faults, seed=self._seed, actions=actions, patience=_PATIENCE)
        return self._connection

    def _stall(self, fault: Fault) -> None:
        """Pause the computer: the vehicle's time continues, and nothing is sent."""
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

    def _kill(self, fault: Fault) -> None:
        self.was_killed = True
        self.snapshot = self.journal.read_bytes() if self.journal.exists() else None

    def run(self, work: Callable[[], Any]) -> tuple[Any, BaseException | None]:
        """Run *work*; return (result, exception). The journal of a killed tool is reset to the moment of the kill."""
        result, error = None, None
        signal.signal(signal.SIGPROF, _too_long)
        signal.setitimer(signal.ITIMER_PROF, _WORK)
        try:
            result = work()
        except (Killed, Exception) as caught:  # noqa: BLE001 - every exception is judged
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


def run_case(case: Case, keep: Path | None = None) -> Outcome:
    """Run *case* and return its outcome."""
    begun = time.process_time()
    outcome = Outcome(case.to_dict())
    folder = Path(tempfile.mkdtemp(prefix="faulted-")) if keep is None else keep
    try:
        _Run(case, folder, outcome).run()
    finally:
        if keep is None:
            shutil.rmtree(folder, ignore_errors=True)
    gc.collect()
    outcome.seconds = time.process_time() - begun
    return outcome


class _Run:
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
        self._apply_earlier_orders(stage)
        self._check_writes()
        self.vehicle.wait(_SETTLE)
        proved = self._proved()
        outcome.proved = bool(proved)
        outcome.writes = len(self.vehicle.writes)
        now = self.vehicle.condition()
        self._accept_disarming(now, stage.messages.texts)
        if self.case.has_station:
            now = self._judge_station(stage, error, now)
        if stage.rebooted_unseen:
            self._accept_reboot(now)
        differences = self._differences(now, proved)
        outcome.restored_at_once = not differences
        journal = self.vehicle.journal
        is_begun = journal is not None and journal.exists()
        settled = not is_begun or is_settled(journal)
        if differences and not stage.was_killed and not self._requests_restore(error):
            outcome.failures.append(
                f"left {'; '.join(differences)}, and did not report it: {outcome.message or 'no error'}"
            )
        if differences and settled:
            outcome.failures.append(f"left {'; '.join(differences)}, with nothing to restore in the journal")
        if not settled:
            self._restore()
        left = self._differences(self.vehicle.condition(), proved)
        if left:
            outcome.failures.append(f"after restoring: {'; '.join(left)}")

    @property
    def found_firmware(self) -> str:
        """Return the firmware of the vehicle."""
        return "ardurover" if self.vehicle.server.vehicle.data.is_boat else "ardusub"

    def _judge_station(self, stage: _Stage, error: BaseException | None, now: Condition) -> Condition:
        """Check the tool against the other station's orders; return the vehicle's condition after the last of them."""
        station, firmware = self.vehicle.station, FIRMWARE[self.found_firmware]
        assert station is not None
        orders = [o for o in station.orders if o.t >= stage.found_at]
        self.outcome.orders = len(orders)
        stops_in = [firmware.modes[name] for name in firmware.stops_in]
        broken, self.outcome.ties = undone_orders(orders, self.vehicle.ordered, stops_in)
        self.outcome.failures += broken
        if station.sticks_until > self.vehicle.server.now:
            self.vehicle.wait(station.sticks_until - self.vehicle.server.now + _SETTLE)
            now = self.vehicle.condition()
        for order in orders:
            if order.what == "mode":
                stays = now.mode == int(order.value)
                fell = not self.case.has_receiver and now.mode in stops_in  # radio failsafe after the overrides ended
                if stays or fell:
                    self.found = replace(self.found, mode=now.mode, armed=now.armed)
                    self.is_handed_over = now.armed
        kinds = self._possible_causes(stage, orders)
        if kinds and error is not None and not isinstance(error, Killed):
            wrong = misattributed(" ".join((str(error), *stage.messages.texts)), kinds)
            if wrong:
                self.outcome.failures.append(f"{wrong}: {str(error)[:400]}")
        return now

    def _possible_causes(self, stage: _Stage, orders: Sequence[Order]) -> list[str]:
        """Return the kinds of faults that may have ended the run; a stall only if longer than a failsafe's delay."""
        kinds = ["station-" + {"armed": "disarm"}.get(o.what, o.what) for o in orders]
        for fault in self.case.faults:
            waits = 2.2 if self.found_firmware == "ardurover" else 2.7
            if fault.kind == "stall" and not self.case.has_receiver and fault.size > waits:
                kinds.append("stall")
            elif fault.kind in ("reboot", "silence"):
                kinds.append(fault.kind)
        return kinds

    def _accept_reboot(self, now: Condition) -> None:
        """Accept the state after a restart that came before the tool had recorded the original one.

        This is disarmed, in the mode of the boot. It is not accepted if the journal has the original mode, or if the
        vehicle is in it.
        """
        if now.mode == self.found.mode:
            return
        firmware = FIRMWARE["ardurover" if self.vehicle.server.vehicle.data.is_boat else "ardusub"]
        path = self.vehicle.journal
        entries = events(path.read_text(encoding="utf-8")) if path is not None and path.exists() else []
        recorded = next((e["mode"] for e in entries if e["event"] == "opened"), "")
        if recorded != firmware.mode_name(self.found.mode):
            self.found = replace(self.found, mode=self.booted.mode.number, armed=False)

    def _accept_disarming(self, now: Condition, texts: Sequence[str]) -> None:
        """Accept that an armed craft disarmed itself, if the tool reported it: only the operator may arm it."""
        if self.found.armed and not now.armed and any(DISARMED_ITSELF in text for text in texts):
            self.found = replace(self.found, armed=False)

    def _differences(self, now: Condition, proved: Mapping[str, float]) -> list[str]:
        station = self.vehicle.station
        written = {o.name for o in station.orders if o.what == "write"} if station is not None else set()
        held = {**now.parameters, **{name: self.found.parameters[name] for name in written}}
        outputs = () if self.is_handed_over else now.outputs
        rest = {name: value for name, value in proved.items() if name not in written}
        return replace(now, parameters=held, outputs=outputs).differs_from(self.found, rest)

    def _apply_earlier_orders(self, stage: _Stage) -> None:
        """Apply the orders of the other station before the tool's connection to the original state."""
        for order in self.vehicle.station.orders if self.vehicle.station is not None else ():
            if order.t < stage.found_at and order.what == "mode":
                self.found = replace(self.found, mode=int(order.value))
            elif order.t < stage.found_at and order.what == "write":
                self.found = replace(self.found, parameters={**self.found.parameters, order.name: order.value})

    def _tune(self, stage: _Stage) -> Any:
        case, subject = self.case, self.case.subject
        model = None
        if not case.is_full:
            path = self.folder / "model.json"
            plain = as_extended(SingleDof(subject.dof, "1", *subject.model))
            path.write_text(json.dumps(ExtendedModel(plain.base, ()).to_dict()), encoding="utf-8")
            model = load_model(path)
        settings = TuneSettings(
            stage.connection(case.faults),
            self.run_directory,
            axis=subject.axis,
            given=model,
            step_duration=None if case.is_full else STEP_DURATION,
        )
        with cached_design(subject.vehicle, case.index):
            return tune(settings, stage.operator, stage.messages, _WHEN)

    def _restore(self) -> None:
        """Restore, first with faults if the case has them, then without; the last one must succeed."""
        tries = [self.case.restore_faults, ()] if self.case.restore_faults else [()]
        error: BaseException | None = None
        for k, faults in enumerate(tries):
            stage = _Stage(self.vehicle, self.run_directory, self.case.index + 1 + k)
            connection = stage.connection(tuple(faults))
            _, error = stage.run(
                lambda c=connection, s=stage: restore_run(c, self.run_directory, s.operator, s.messages)  # type: ignore[misc]
            )
            if error is not None and not isinstance(error, (AutotuneError, Killed)):
                self.outcome.failures.append(f"restore: {type(error).__name__}: {error}")
            self.vehicle.wait(_SETTLE)
            self._accept_disarming(self.vehicle.condition(), stage.messages.texts)
        if isinstance(error, NotAsFound) and "without --yes" in str(error):
            if not self._may_be_left(error):
                self.outcome.failures.append(f"restore left changes that no other station had ordered: {error}")
            error = self._decide()
        if error is not None:
            self.outcome.failures.append(f"restore failed: {error}")
        elif not is_settled(self.run_directory):
            self.outcome.failures.append("restore did not settle the journal")
        else:
            self.outcome.restored = "restored"

    def _may_be_left(self, error: NotAsFound) -> bool:
        """Return whether another station, or a late copy of an order, can have caused all differences in *error*."""
        station = self.vehicle.station
        if station is None:
            return not any(name in self.found.parameters for name in error.differences)
        ordered = {o.name if o.what == "write" else "state" for o in station.orders}
        return {n if n in self.found.parameters else "state" for n in error.differences} <= ordered

    def _decide(self) -> BaseException | None:
        """Restore with an operator who overrules others only if there is no other station."""
        stage = _Stage(self.vehicle, self.run_directory, self.case.index + 9)
        stage.operator = _Person(overrules=self.vehicle.station is None)
        connection = stage.connection(())
        _, error = stage.run(lambda: restore_run(connection, self.run_directory, stage.operator, stage.messages))
        self.vehicle.wait(_SETTLE)
        return error

    def _proved(self) -> dict[str, float]:
        """Return the kept parameters in the journal."""
        path = self.vehicle.journal
        if path is None or not path.exists():
            return {}
        kept = [e["values"] for e in events(path.read_text(encoding="utf-8", errors="replace")) if e["event"] == "kept"]
        return {} if not kept else {str(n): float(v) for n, v in kept[-1].items()}

    def _check_writes(self) -> None:
        """Check that every write was in the journal before it arrived, with the true original value."""
        for name, value, journal in self.vehicle.writes:
            entries = events(journal)
            lent = {e["name"]: e["value"] for e in entries if e["event"] == "lent"}
            if not any(e["event"] == "writing" and e["name"] == name for e in entries) or name not in lent:
                self.outcome.failures.append(f"{name} = {value:g} was written before the journal had it")
            elif not math.isclose(lent[name], self.found.parameters[name], rel_tol=1e-6):
                self.outcome.failures.append(f"the journal has {lent[name]:g} as the original {name}")

    @staticmethod
    def _requests_restore(error: BaseException | None) -> bool:
        return error is not None and "gcs-autotune restore" in str(error)


def _limit_files(size: int) -> None:
    """Limit the size of files of this process to *size* bytes."""
    _, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (hard if size == resource.RLIM_INFINITY else size, hard))


def _too_long(*_: object) -> None:
    raise TimeoutError(f"not finished after {_WORK} s of processor time")


def _close_descriptors(path: Path) -> None:
    """Close the open descriptors of *path*, as the system does for a killed process."""
    for entry in Path("/proc/self/fd").iterdir():
        try:
            if entry.readlink() == path:
                os.close(int(entry.name))
        except OSError:
            continue
