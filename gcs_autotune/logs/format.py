"""A type of file: how it is recognised, and its reader or the advice to convert it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from gcs_autotune.errors import BadFile
from gcs_autotune.logs.sample_store import LogReader
from gcs_autotune.trial import Trial

__all__ = ["Format", "Head", "RunReader", "absent"]

SIZE = 1 << 16
"""Number of bytes of a file that are examined to recognise it. Project choice."""

RunReader: TypeAlias = Callable[[Path, Mapping[str, str]], list[Trial]]
"""Function that reads (path, name in the file -> ``channel[unit]``). It raises ``BadFile`` or ``UsageError``."""


@dataclass(frozen=True, slots=True)
class Head:
    """The beginning of a file: its first bytes; empty for a directory."""

    path: Path
    data: bytes

    @classmethod
    def of(cls, path: Path) -> Head:
        """Read the beginning of the file at *path*.

        Raises
        ------
        BadFile
            It cannot be read.
        """
        if path.is_dir():
            return cls(path, b"")
        try:
            with path.open("rb") as stream:
                return cls(path, stream.read(SIZE))
        except OSError as error:
            raise BadFile(f"{path} cannot be read: {error.strerror or error}") from error

    @property
    def text(self) -> str:
        """The first bytes as text, with undecodable bytes replaced."""
        return self.data.decode("utf-8-sig", errors="replace")

    @property
    def is_text(self) -> bool:
        """Return whether these bytes look like text with one byte per character."""
        return bool(self.data) and b"\0" not in self.data and not self.data.startswith((b"\xfd", b"\xfe"))


@dataclass(frozen=True, slots=True)
class Format:
    """One kind of file.

    Attributes
    ----------
    name : name with its article, as used after "is": "a PX4 ULog".
    fits : whether the first bytes of a file are of this type, whatever its name.
    suffixes : file name suffixes, used if the start of the file is damaged.
    record : reads a vehicle's log into stores. runs : reads columns into runs. Neither: unsupported, and
    advice : how to convert it; ``{name}`` is the file's name.
    """

    name: str
    fits: Callable[[Head], bool]
    suffixes: tuple[str, ...] = ()
    record: LogReader | None = None
    runs: RunReader | None = None
    advice: str = ""


def absent(path: Path, what: str, library: str, instead: str) -> BadFile:
    """Return the error for a file whose *library* is not installed. *instead* : the alternative."""
    cure = f"pip install 'gcs-autotune[formats]' to read it, or {instead}"
    return BadFile(f"{path} is {what}, and {library} is not installed: {cure}")
