"""A Lua script of ours on the vehicle for a while: uploaded by MAVLink FTP, loaded, and gone afterwards.

Its path is in the journal from before the upload until the file is removed and the scripts are reloaded without it.
"""

from __future__ import annotations

from contextlib import suppress

from gcs_autotune.errors import AutotuneError, CommandDenied, LinkLost, NotAsFound, PreconditionFailed
from gcs_autotune.link.file_transfer import has_remote_folder, remove_remote_file, write_remote_file
from gcs_autotune.link.parameters.journal import Journal
from gcs_autotune.link.session import Session
from gcs_autotune.link.vehicle.commands import Commands
from gcs_autotune.mavlink import mavlink

__all__ = ["ScriptLoan", "drop_script", "script_folder"]

_FOLDERS = ("APM/scripts", "scripts")
"""Folders from which ArduPilot loads scripts: on a board, and in its simulator."""
_STOP_AND_RESTART = 3.0
"""SCRIPTING_CMD_STOP_AND_RESTART."""
_PATIENCE = 30.0
"""Time [s] to wait for a silent vehicle before the clean-up fails. Project choice."""


def script_folder(session: Session) -> str:
    """Return the folder of the vehicle's scripts.

    Raises
    ------
    PreconditionFailed
        It has none.
    NoReply
        It does not answer MAVLink FTP.
    """
    path = next((folder for folder in _FOLDERS if has_remote_folder(session, folder)), "")
    if not path:
        raise PreconditionFailed(
            f"{session.vehicle} has no folder {_FOLDERS[0]}. The autopilot makes it at a start with SCR_ENABLE 1 and "
            "an SD card: check both, and restart it"
        )
    return path


def _restart_scripts(commands: Commands) -> None:
    commands.command_int(mavlink.MAV_CMD_SCRIPTING, _STOP_AND_RESTART)


def drop_script(session: Session, commands: Commands, path: str) -> None:
    """Remove the script *path* from the vehicle, and reload the scripts without it. It may be gone already.

    Raises
    ------
    NoReply, LinkLost
        The vehicle does not answer. BadFile: the file cannot be removed.
    """
    remove_remote_file(session, path)
    with suppress(CommandDenied):  # without scripting nothing is loaded
        _restart_scripts(commands)


class ScriptLoan:
    """One script of ours on the vehicle; *path* is its file there."""

    def __init__(self, session: Session, commands: Commands, journal: Journal, path: str) -> None:
        self._session, self._commands, self._journal = session, commands, journal
        self.path = path
        self._is_there = False

    def load(self, text: str) -> None:
        """Upload the script *text* and have the autopilot load it. Its other scripts are reloaded too.

        Raises
        ------
        NoReply, LinkLost, OperatorStopped
            The vehicle does not answer, or the operator stopped it.
        BadFile, PreconditionFailed
            The vehicle does not store the file, or does not load scripts.
        """
        self._journal.record("script_writing", path=self.path)
        self._is_there = True
        write_remote_file(self._session, self.path, text.encode("ascii"))
        try:
            _restart_scripts(self._commands)
        except CommandDenied as error:
            raise PreconditionFailed(
                f"{error}. Scripting does not run on this autopilot: set SCR_ENABLE to 1 and restart it"
            ) from error

    def give_back(self) -> None:
        """Remove the script. The operator cannot interrupt; a silent vehicle is waited for once.

        Raises
        ------
        NotAsFound
            It could not be removed; the journal has its path.
        """
        if not self._is_there:
            return
        with self._session.operator.shielded():
            try:
                self._drop()
            except AutotuneError as error:
                raise NotAsFound(
                    f"the script {self.path} could not be removed from the vehicle ({error}). Run `gcs-autotune "
                    f"restore` with {self._journal.path}",
                    differences={"script": str(error)},
                ) from error
        self._is_there = False
        with suppress(PreconditionFailed):  # a full disk: the journal only lists too much then
            self._journal.record("script_removed", path=self.path)

    def _drop(self) -> None:
        try:
            drop_script(self._session, self._commands, self.path)
        except LinkLost:
            if not self._session.outlast(_PATIENCE):
                raise
            drop_script(self._session, self._commands, self.path)
