"""Opening and settling the journal of a visit: before anything is armed, moved or written, it is on the disk."""

from __future__ import annotations

from collections.abc import Callable

from gcs_autotune.craft import Observation
from gcs_autotune.errors import PreconditionFailed
from gcs_autotune.link import Journal, MavlinkCraft, fingerprint_of
from gcs_autotune.workflow.record import RunDirectory
from gcs_autotune.workflow.settings import Connection

__all__ = ["Ledger"]


class Ledger:
    """The journal of one visit.

    ``settle`` once the craft was left as found; ``leave`` in any case at the end: what is not settled by then is for
    ``gcs-autotune restore``.
    """

    def __init__(self, record: RunDirectory, connection: Connection, say: Callable[[str], None]) -> None:
        self._record = record
        self._connection = connection
        self._say = say
        self._journal: Journal | None = None

    def open(self, craft: MavlinkCraft, found: Observation) -> Journal:
        """Write down how the craft was found.

        Raises
        ------
        PreconditionFailed
            The journal cannot be written; then nothing may be done.
        """
        self._journal = Journal(
            self._record.journal,
            vehicle=craft.session.vehicle,
            link=self._connection.uri,
            mode=found.mode,
            armed=found.armed,
            fingerprint=fingerprint_of(craft.parameters),
        )
        return self._journal

    def settle(self) -> None:
        """Note that all is as it may be. A disk that is full by now does no harm."""
        if self._journal is None:
            return
        try:
            self._journal.close()
        except PreconditionFailed as error:
            self._say(
                f"all is as found, but the journal does not say so ({error}); `gcs-autotune restore` will look again"
            )

    def leave(self) -> None:
        """Let go of the file."""
        if self._journal is not None:
            self._journal.leave()
