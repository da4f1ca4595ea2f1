"""Download a log from the vehicle's SD card: a requested log, or the log of the run just flown."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from gcs_autotune.clock import Clock, Deadline
from gcs_autotune.errors import (
    AutotuneError,
    DataError,
    LinkError,
    NoReply,
    OperatorStopped,
    PreconditionFailed,
    UsageError,
)
from gcs_autotune.identify import AxisFit, fit_axis, structure_of
from gcs_autotune.link import MavlinkCraft, OnboardLog, fetch_log, list_logs
from gcs_autotune.logs import load_runs
from gcs_autotune.observer import Observer
from gcs_autotune.report import beside_telemetry, save_page, study_document
from gcs_autotune.workflow.connection import connect
from gcs_autotune.workflow.operator import Operator
from gcs_autotune.workflow.record import RunDirectory
from gcs_autotune.workflow.settings import Connection
from gcs_autotune.workflow.study import study_of

__all__ = ["RunLog", "fetch_onboard_log", "log_of_run"]

_EVERY = 5.0
"""Seconds between two progress messages. Project choice."""
_BY_HAND = "Use `gcs-autotune logs fetch` to fetch it later"


def fetch_onboard_log(
    connection: Connection, number: int | None, operator: Operator, observer: Observer
) -> tuple[tuple[OnboardLog, ...], OnboardLog | None, bytes]:
    """Return (list of the onboard logs, the log downloaded, its bytes). *number*: log to download; None: the newest; 0:
    none.

    Raises
    ------
    UsageError
        There is no such log. NoReply: the vehicle does not send it. OperatorStopped: the operator stopped the download.
    """
    with connect(connection, operator, observer) as session:
        logs = list_logs(session)
        if number == 0:
            return logs, None, b""
        chosen = next((log for log in reversed(logs) if number in (None, log.number)), None)
        if chosen is None:
            have = ", ".join(str(log.number) for log in logs) or "none"
            raise UsageError(f"the vehicle has no onboard log of this number. Available: {have}")
        observer.say(f"fetching log {chosen.number} ({chosen.size} bytes)")
        return logs, chosen, fetch_log(session, chosen, _teller(session.clock, observer))


def _teller(clock: Clock, observer: Observer) -> Callable[[int, int], None]:
    told = Deadline.after(clock, _EVERY)

    def tell(done: int, whole: int) -> None:
        nonlocal told
        if told.expired:
            observer.say(f"{done} of {whole} bytes")
            told = Deadline.after(clock, _EVERY)

    return tell


@dataclass(slots=True)
class RunLog:
    """The onboard log of one run; ``path`` is set once it is downloaded."""

    record: RunDirectory
    observer: Observer
    path: Path | None = None

    def identify(self, fits: Sequence[AxisFit], when: str) -> None:
        """Fit the model of the run to the onboard log as well, and report both models together.

        Writes ``fit-onboard.json`` and ``onboard.html`` to the run directory. A log that is not informative is
        reported; the run still counts as complete.
        """
        if self.path is None:
            return
        for fit in fits:
            stem = "" if len(fits) == 1 else f"-{fit.dof}"
            try:
                runs = load_runs(self.path)
                found = fit_axis(runs, dof=fit.dof, structure=structure_of(fit.structure))
            except (DataError, UsageError) as error:
                self.observer.say(f"{fit.dof} cannot be identified from {self.path.name}: {error}")
                continue
            self.record.save_json(f"fit-onboard{stem}.json", found.to_dict())
            document = study_document(study_of(found, runs, f"{fit.dof} from the onboard log", when))
            save_page(self.record.path, document, f"onboard{stem}.html")
            for line in beside_telemetry(fit, found):
                self.observer.say(line)


@contextmanager
def log_of_run(
    wanted: bool, craft: MavlinkCraft, record: RunDirectory, operator: Operator, observer: Observer
) -> Iterator[RunLog]:
    """Return a context around a run. After it, once the vehicle is restored, the run's onboard log is downloaded if it
    is *wanted*.

    Nothing is downloaded before the vehicle is restored, after a STOP, or over a failing link. A message then shows how
    to download it later. A STOP during the download ends only the download.

    Raises
    ------
    PreconditionFailed
        The vehicle lists no logs; raised before the run begins.
    """
    kept = RunLog(record, observer)
    before = _logs_before(craft) if wanted else ()
    try:
        yield kept
    except AutotuneError as error:
        if wanted and isinstance(error, (OperatorStopped, LinkError)):
            observer.say(f"the onboard log was not fetched. {_BY_HAND}")
        elif wanted:
            _fetch(kept, craft, operator, before)
        raise
    if wanted:
        _fetch(kept, craft, operator, before)


def _logs_before(craft: MavlinkCraft) -> tuple[OnboardLog, ...]:
    if craft.armed:
        raise PreconditionFailed(
            "--fetch-log: the vehicle is armed and stays armed, but it sends its logs only when disarmed. Disarm it "
            "first, or omit --fetch-log. Nothing was moved"
        )
    try:
        return list_logs(craft.session)
    except NoReply as error:
        raise PreconditionFailed(
            f"--fetch-log: {error}. Check that an SD card is fitted and LOG_BACKEND_TYPE is not 0, or omit "
            "--fetch-log. Nothing was armed"
        ) from error


def _fetch(kept: RunLog, craft: MavlinkCraft, operator: Operator, before: Sequence[OnboardLog]) -> None:
    """Download the log that is new or has grown. A failure is only reported, since the run is complete."""
    session, say = craft.session, kept.observer.say
    sizes = {log.number: log.size for log in before}
    tell = _teller(session.clock, kept.observer)

    def go_on(done: int, whole: int) -> None:
        if operator.stop_requested():
            raise _Enough
        tell(done, whole)

    try:
        with craft.shielded():
            logs = list_logs(session)
            log = next((log for log in reversed(logs) if log.size > sizes.get(log.number, 0)), None)
            if log is None:
                say(
                    "the vehicle wrote no log of this run. Check LOG_BACKEND_TYPE, LOG_BITMASK and the space on its SD "
                    "card"
                )
                return
            say(f"fetching log {log.number} from the vehicle ({log.size} bytes). A STOP ends only this download")
            data = fetch_log(session, log, go_on)
    except _Enough:
        say(f"the onboard log was not fetched completely. {_BY_HAND}")
    except AutotuneError as error:
        say(f"the onboard log was not fetched: {error}. {_BY_HAND}")
    else:
        path = kept.record.path / f"onboard-{log.number}.bin"
        try:
            path.write_bytes(data)
        except OSError as error:
            say(f"the onboard log could not be stored in {path}: {error.strerror or error}")
            return
        kept.path = path
        say(f"log {log.number} of the vehicle: {path}")


class _Enough(Exception):
    """Raised when the operator does not wait for the log."""
