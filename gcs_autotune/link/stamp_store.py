"""The latest signing time ever used, on disk: a vehicle refuses what is not newer, even if our clock was set back."""

from __future__ import annotations

import os
import sys
from pathlib import Path

__all__ = ["StampStore", "state_folder"]

_AHEAD = 30 * 100_000
"""Chosen: 30 s [10 us] reserved at a time, so that a run killed at any moment has used nothing beyond the file."""
_FILE = "signing-time"


def state_folder() -> Path:
    """Return where this program keeps what it must remember from run to run."""
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or Path.home())
    else:
        base = Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state")
    return base / "gcs-autotune"


class StampStore:
    """One number in one file, which only grows. It says nothing about any key.

    Attributes
    ----------
    trouble : why it cannot be kept, empty while it can; signing then rests on the machine's clock alone.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._path = (folder or state_folder()) / _FILE
        self.trouble = ""
        self.last = self._read()
        self._reserved = self.last

    def reach(self, stamp: int) -> None:
        """Make sure that the file holds at least *stamp* [10 us since 2015]."""
        if stamp < self._reserved:
            return
        self._reserved = max(stamp, self._read()) + _AHEAD
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            draft = self._path.with_suffix(f".{os.getpid()}")
            draft.write_text(f"{self._reserved}\n")
            draft.replace(self._path)
        except OSError as error:
            self._note(error)

    def _read(self) -> int:
        try:
            return int(self._path.read_text())
        except FileNotFoundError:
            return 0
        except (OSError, ValueError) as error:
            self._note(error)
            return 0

    def _note(self, error: Exception) -> None:
        self.trouble = self.trouble or (
            f"the signing time of earlier runs ({self._path}) cannot be kept: {error}; were this machine's clock set "
            "back, the vehicle would not hear us"
        )
