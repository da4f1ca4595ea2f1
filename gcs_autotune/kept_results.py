"""Store results of long calculations in a file, so that a stopped calculation can continue.

A result is stored under a fingerprint of everything it depends on: data, start values, settings. A repeated calculation
within :func:`keeping` returns the stored result. The file contains one JSON line per result.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from gcs_autotune.clock import uncounted
from gcs_autotune.errors import BadFile

__all__ = ["KeptResults", "current_kept_results", "fingerprint", "keeping", "recalled"]

Result = TypeVar("Result")

SCHEMA = "gcs-autotune kept results 1"


class KeptResults:
    """Results in the file *path*, which is created with the first one. Each is written as soon as it is known.

    subject : fingerprint of the data and settings on which all results depend.

    Raises
    ------
    BadFile
        The file has another content, or results on another *subject*.
    """

    def __init__(self, path: Path, subject: str) -> None:
        self.path = path
        self._found: dict[str, Any] = {}
        known = _lines(path)
        head = {"schema": SCHEMA, "subject": subject}
        if known and known[0].get("schema") != SCHEMA:
            raise BadFile(f"{path} contains no results of a search. Start again without --resume")
        if known and known[0] != head:
            raise BadFile(
                f"{path} contains results of other runs, other options or another version. Use the same command as "
                "for the stopped search, or start again without --resume"
            )
        for line in known[1:]:
            if isinstance(line.get("key"), str) and "result" in line:
                self._found[line["key"]] = line["result"]
        self._head = None if known else head
        self._cut_off = bool(known) and not path.read_bytes().endswith(b"\n")

    def __len__(self) -> int:
        return len(self._found)

    def get(self, key: str) -> Any:
        """Return the result under *key*.

        Raises
        ------
        KeyError
            There is no such result.
        """
        return self._found[key]

    def keep(self, key: str, result: Any) -> None:
        """Store a JSON-compatible *result* under *key*.

        If the disk is full, only the stored result is lost, not the calculation.
        """
        self._write({"key": key, "result": result})

    def begin(self) -> None:
        """Create the file if nothing has been stored yet."""
        self._write()

    def _write(self, *more: Mapping[str, Any]) -> None:
        lines = (*(() if self._head is None else (self._head,)), *more)
        text = "\n" * self._cut_off + "".join(json.dumps(line, default=float) + "\n" for line in lines)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with self.path.open("ab", buffering=0) as file:
                file.write(text.encode())  # in one call: processes do not mix theirs
        except OSError:
            return
        self._head, self._cut_off = None, False

    def remove(self) -> None:
        """Delete the file, because the calculation has ended."""
        self.path.unlink(missing_ok=True)


def _lines(path: Path) -> list[dict[str, Any]]:
    """Return the objects in a file's lines. A truncated last line is ignored."""
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        return []
    except (OSError, UnicodeDecodeError) as error:
        raise BadFile(f"{path} cannot be read: {error}") from error
    found = []
    for line in text.splitlines():
        try:
            one = json.loads(line)
        except (ValueError, RecursionError):
            one = None
        if isinstance(one, dict):
            found.append(one)
    if text and not found:
        raise BadFile(f"{path} contains no results of a search. Start again without --resume")
    return found


_kept: ContextVar[KeptResults | None] = ContextVar("kept", default=None)
"""The results used by this thread and the processes it forks."""


@contextmanager
def keeping(results: KeptResults | None) -> Iterator[None]:
    """Store results calculated inside this context in *results*, and reuse those already stored. None: do neither."""
    token = _kept.set(results)
    try:
        yield
    finally:
        _kept.reset(token)


def current_kept_results() -> KeptResults | None:
    """Return the present store of results; None if there is none."""
    return _kept.get()


def recalled(
    asked: Callable[[], Sequence[Any]],
    calculate: Callable[[], Result],
    encode: Callable[[Result], Any],
    decode: Callable[[Any], Result],
) -> Result:
    """Return the stored result, or else the result of *calculate*, which is then stored.

    asked : returns everything that the result depends on, its kind first. encode, decode : convert to JSON's own types
        and back. The work of decoding is not counted, because the calculation already was.
    """
    kept = _kept.get()
    if kept is None:
        return calculate()
    key = fingerprint(*asked())
    try:
        with uncounted():
            return decode(kept.get(key))
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, ArithmeticError):
        pass  # not known, or a line that was edited
    result = calculate()
    kept.keep(key, encode(result))
    return result


def fingerprint(*things: Any) -> str:
    """Return 32 hexadecimal digits that identify *things*: numbers, texts, arrays, and dataclasses of these."""
    digest = hashlib.sha256()
    for thing in things:
        _add(thing, digest.update)
    return digest.hexdigest()[:32]


def _add(thing: Any, add: Callable[[bytes], None]) -> None:
    own = getattr(thing, "fingerprint", None)
    if isinstance(own, str):
        add(b"f" + own.encode())
    elif isinstance(thing, np.ndarray):
        add(f"a{thing.dtype.str}{thing.shape}".encode())
        add(np.ascontiguousarray(thing).tobytes())
    elif isinstance(thing, np.generic):
        _add(thing.item(), add)
    elif isinstance(thing, Mapping):
        add(b"{%d" % len(thing))
        for key, value in thing.items():
            _add(key, add)
            _add(value, add)
    elif isinstance(thing, Set):
        _add(sorted(map(repr, thing)), add)
    elif isinstance(thing, Sequence) and not isinstance(thing, str | bytes):
        add(b"[%d" % len(thing))
        for value in thing:
            _add(value, add)
    elif dataclasses.is_dataclass(thing):
        add(f"d{type(thing).__name__}".encode())
        for each in dataclasses.fields(thing):
            _add(getattr(thing, each.name), add)
    else:
        add(f"{type(thing).__name__}:{thing!r};".encode())
