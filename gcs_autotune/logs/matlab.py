"""Convert MATLAB's MAT files (up to version 7.2) to runs.

A run consists of the vectors with the length of a vector ``t``, also inside structures. SciPy reads the file. A MAT
file contains no units: those of the signals (SI) apply, unless ``--columns`` sets others.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gcs_autotune.errors import BadFile
from gcs_autotune.logs.format import Format, Head
from gcs_autotune.trial import TIMES, Trial, trial_of_columns
from gcs_autotune.untrusted_text import visible

__all__ = ["FORMAT", "read_mat"]

HEAD = re.compile(rb"MATLAB 5\.0 MAT-file")
EXPORT = "export it from MATLAB as CSV: writematrix([t psi N], 'run.csv'), with the header line t[s],psi[rad],N[N m]"
DEEPEST = 8
"""Greatest depth of nested structures. Project choice."""
SHORTEST = 2


def read_mat(path: Path, columns: Mapping[str, str]) -> list[Trial]:
    """Read the run in the MAT file at *path*.

    columns : name in the file -> ``channel[unit]``.

    Raises
    ------
    BadFile
        The file is unreadable, or contains no vector of times with another vector. UsageError: a name in *columns* does
            not exist.
    """
    import scipy.io

    try:
        _verify_complete(path.read_bytes())
        tree = scipy.io.loadmat(path, squeeze_me=True, simplify_cells=True)
    except Exception as error:  # noqa: BLE001 - what reads a damaged file may raise anything
        raise BadFile(f"{path} is a MATLAB file that cannot be read ({_first_line(error)}): {EXPORT}") from None
    vectors = dict(_vectors("", tree, 0))
    short = [name.rpartition(".")[2] for name in vectors]
    named = {name if short.count(s) > 1 else s: v for (name, v), s in zip(vectors.items(), short, strict=True)}
    back = {old: new for new, old in ((new, old) for old, new in columns.items())}
    time = next((n for n in named if back.get(n, n).partition("[")[0].strip().lower() in TIMES), None)
    if time is None:
        found = ", ".join(visible(name) for name in list(named)[:10]) or "none"
        raise BadFile(
            f"{path} is a MATLAB file without a time vector t (its vectors: {found}). Map "
            f"them with --columns OLD=t[s],..., or {EXPORT}"
        )
    table = {name: v for name, v in named.items() if len(v) == len(named[time])}
    other = [name for name in named if name not in table]
    run = trial_of_columns(table, path.name, columns)
    notes = [
        *run.meta.get("notes", ()),
        (
            "assumed-units",
            f"{path.name} contains no units. SI is assumed for columns without a unit in --columns",
            "state the units with --columns",
        ),
    ]
    if other:
        cause = f"vectors whose length differs from {time} were skipped: {', '.join(map(visible, other[:5]))}"
        notes.append(("left-out-vectors", cause, "resample them to the time vector"))
    return [replace(run, name=visible(path.stem), meta={**run.meta, "format": "MATLAB file", "notes": notes})]


TYPES = frozenset({1, 2, 3, 4, 5, 6, 7, 9, 12, 13, 14, 15, 16, 17, 18})
"""Codes of data elements (MATLAB's "MAT-File Format", level 5): numbers, text, 14 an array, 15 compressed."""
ARRAY, COMPRESSED = 14, 15
CLASSES = range(1, 18)
FLAGS = 6
"""Type of the first element of an array. Its lowest byte is the class of the array."""
IS_COMPLEX = 0x0800
PARTS = {4: 4, 5: 6, **dict.fromkeys(range(6, 16), 4)}
"""Class of array (4 text, 5 sparse, 6 to 15 numbers) -> number of its elements, one more if it is complex."""
HEADER = 128
LARGEST = 1 << 31
"""Largest size of a compressed element when unpacked [bytes]. Project choice."""


def _verify_complete(data: bytes) -> None:
    """Raise ``ValueError`` unless the elements of a level-5 file are nested correctly.

    SciPy 1.17 ends the process by a segmentation fault if an element has an unknown type code.
    """
    if not HEAD.match(data):
        raise ValueError("the file does not start like a MAT file of level 5")
    order = {b"IM": "<", b"MI": ">"}.get(data[HEADER - 2 : HEADER])
    if order is None or len(data) <= HEADER:
        raise ValueError("the file contains no data after its header")
    _verify_elements(data[HEADER:], order, 0)


def _verify_elements(data: bytes, order: str, depth: int) -> list[int]:
    """Return the types of the elements in *data*; raise ``ValueError`` if one is unknown."""
    at, found = 0, []
    while at + 8 <= len(data):
        kind, size = struct.unpack_from(f"{order}II", data, at)
        start, end = at + 8, at + 8 + size
        if kind >> 16:  # a small element: its size in the upper half of the first word, its data in the second
            kind, size = kind & 0xFFFF, kind >> 16
            start, end = at + 4, at + 4 + size
            if size > 4:
                raise ValueError("a damaged element")
        if kind not in TYPES or end > len(data) or depth > 2 * DEEPEST or (kind == COMPRESSED and depth):
            raise ValueError("a damaged element")
        if kind == COMPRESSED:
            _verify_elements(zlib.decompressobj().decompress(data[start:end], LARGEST), order, depth + 1)
            at = end
            continue
        if kind == ARRAY and size:
            _verify_array(data[start:end], order, depth)
        found.append(kind)
        at = max(at + 8, end + -end % 8)
    return found


def _verify_array(data: bytes, order: str, depth: int) -> None:
    """Raise ``ValueError`` unless an array has the elements of its class. Without them SciPy reads past its end."""
    head = data[:12]
    if len(head) < 12 or struct.unpack_from(f"{order}I", head)[0] != FLAGS:
        raise ValueError("a damaged array")
    word = struct.unpack_from(f"{order}I", head, 8)[0]
    kind, is_complex = word & 0xFF, bool(word & IS_COMPLEX)
    parts = _verify_elements(data, order, depth + 1)
    needed = PARTS.get(kind, 0)
    if kind not in CLASSES or (needed and (len(parts) < needed + is_complex or ARRAY in parts)):
        raise ValueError("a damaged array")


def _first_line(error: BaseException) -> str:
    return visible(str(error).partition("\n")[0][:80]) or type(error).__name__


def _vectors(name: str, value: Any, depth: int) -> Iterator[tuple[str, np.ndarray[Any, Any]]]:
    """Yield every vector of real numbers in a tree of structures, with its name in dot notation."""
    if isinstance(value, Mapping) and depth < DEEPEST:
        for key, inner in value.items():
            if not str(key).startswith("__"):
                yield from _vectors(f"{name}.{key}" if name else str(key), inner, depth + 1)
    elif isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype.kind in "fiub" and len(value) >= SHORTEST:
        with np.errstate(invalid="ignore"):  # a damaged number may be a signalling NaN
            yield name, value.astype(np.float64)


def _fits(head: Head) -> bool:
    return HEAD.match(head.data) is not None


FORMAT = Format("a MATLAB file", _fits, (".mat",), runs=read_mat)
