"""Fetch a log from the vehicle's own card."""

from __future__ import annotations

from gcs_autotune.clock import Deadline
from gcs_autotune.errors import UsageError
from gcs_autotune.link import OnboardLog, fetch_log, list_logs
from gcs_autotune.watch import Watcher
from gcs_autotune.workflow.connection import connect
from gcs_autotune.workflow.operator import Operator
from gcs_autotune.workflow.settings import Connection

__all__ = ["fetch_onboard_log"]

_EVERY = 5.0
"""Chosen: seconds between two words on how far it is."""


def fetch_onboard_log(
    connection: Connection, number: int | None, operator: Operator, watcher: Watcher
) -> tuple[tuple[OnboardLog, ...], OnboardLog | None, bytes]:
    """Return the logs there are, the one fetched and its bytes: *number*, the newest when None, none when 0.

    Raises
    ------
    UsageError
        There is no such log. NoReply: the vehicle does not send it. OperatorStopped: the operator did.
    """
    with connect(connection, operator, watcher) as session:
        logs = list_logs(session)
        if number == 0:
            return logs, None, b""
        chosen = next((log for log in reversed(logs) if number in (None, log.number)), None)
        if chosen is None:
            have = ", ".join(str(log.number) for log in logs) or "none"
            raise UsageError(f"there is no such log on board; there is: {have}")
        watcher.say(f"fetching log {chosen.number}, {chosen.size} bytes")
        told = Deadline.after(session.clock, _EVERY)

        def tell(done: int, whole: int) -> None:
            nonlocal told
            if told.expired:
                watcher.say(f"{done} of {whole} bytes")
                told = Deadline.after(session.clock, _EVERY)

        return logs, chosen, fetch_log(session, chosen, tell)
