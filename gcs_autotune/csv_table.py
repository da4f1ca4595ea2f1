"""Parse tables with ``name[unit]`` headings. Reject other files with a message that states their type.

Spreadsheets and loggers use their own separators, decimal marks, dates and encodings. A wrong guess could scale numbers
by a thousand, so ambiguous files are rejected with a command that converts them. Unambiguous variants are read: a
header line in a comment (``numpy.savetxt``), units on a separate line, text columns.
"""

from __future__ import annotations

import csv
import io
import math
import re
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import BadFile
from gcs_autotune.rounding import counted
from gcs_autotune.sname import SIGNALS, parse_header, to_si
from gcs_autotune.untrusted_text import visible

__all__ = [
    "LAST",
    "Cells",
    "Note",
    "TableNumbers",
    "cells_of",
    "clock_notes",
    "is_believable",
    "is_pulses",
    "numbers_of",
    "shares_of_pulses",
    "since_1970",
    "text_of",
    "wide_encoding",
]

Array = NDArray[np.float64]
Note: TypeAlias = tuple[str, str, str]
"""Note on a file: slug, cause and remedy. It becomes a ``Doubt`` about everything identified from the run."""

_DATE = re.compile(r"^\s*\d{4}-\d{1,2}-\d{1,2}|^\s*\d{1,2}[./-]\d{1,2}[./-]\d{2,4}\b|^\s*\d{1,2}:\d{2}(:\d{2}|\s*$)")
_NUMBER = re.compile(r"^\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*$")
_DECIMAL_COMMA = re.compile(r"^\s*[+-]?\d+,\d+([eE][+-]?\d+)?\s*$")
_COMMA_IN_NUMBER = re.compile(r"\d,\d")
_SEPARATORS = {";": "';'", "\t": "tabs", "|": "'|'"}
_UNSEEN = re.compile(rb"[\x00-\x08\x0e-\x1a\x1c-\x1f]")
"""Control characters that do not occur in text. Escape sequences (1b) are handled where text is shown."""
SHOWN = 40
"""Number of characters of a cell that are quoted. Project choice."""
SAMPLE = 1 << 16
"""Number of bytes examined to detect an encoding. Project choice."""


@dataclass(frozen=True, slots=True)
class Cells:
    """The cells of a table: those of its ``head`` line and of its ``rows``. The first row has the number ``first``."""

    path: Path
    head: list[str]
    rows: list[list[str]]
    first: int = 2


@dataclass(frozen=True, slots=True)
class TableNumbers:
    """The numbers of a table.

    Attributes
    ----------
    columns : indices of the columns with numbers. values : (n, k) numbers of these columns, NaN for an empty cell.
    dropped : 1 if the last row was truncated. nans, infinite : number of such cells per column.
    texts : headings of the columns skipped because they contain only text.
    """

    columns: list[int]
    values: Array
    dropped: int
    nans: list[int]
    infinite: list[int]
    texts: list[str]


def text_of(path: Path) -> str:
    """Return the content of a file as text.

    Raises
    ------
    BadFile
        The file is unreadable, empty, in UTF-16 or UTF-32, or not text.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise BadFile(f"{path} cannot be read as a CSV run: {error.strerror or error}") from error
    if not data.strip():
        raise BadFile(f"{path} is empty. Check the recording, or copy the file again")
    wide = wide_encoding(data[:SAMPLE])
    if wide:
        raise BadFile(
            f"{path} is in {wide}. Save it as UTF-8, e.g.: iconv -f {wide} -t UTF-8 {shlex.quote(path.name)} > run.csv"
        )
    if _UNSEEN.search(data[:SAMPLE]):
        raise BadFile(f"{path} cannot be read as a CSV run: it is not text. Export it as CSV")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace")  # of Windows: a degree sign in a head


def wide_encoding(data: bytes) -> str:
    """Return ``UTF-16`` or ``UTF-32`` if *data* is such text, detected by its byte order mark or its zeros."""
    if data.startswith((b"\xff\xfe\0\0", b"\0\0\xfe\xff")):
        return "UTF-32"
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "UTF-16"
    for encoding, zeros, letters in (("UTF-16LE", data[1::2], data[::2]), ("UTF-16BE", data[::2], data[1::2])):
        if len(zeros) > 2 and zeros.count(0) > 0.9 * len(zeros) and letters.count(0) < 0.1 * len(letters):
            return encoding
    return ""


RUN = "t[s],psi[rad],N[N m]"
"""Header line of a run, as an example."""


def cells_of(path: Path, example: str = RUN) -> Cells:
    """Return the table at *path*: its header line and rows, without comments (``#``) and blank lines.

    example : a header line that such a table may have, for the messages.

    Raises
    ------
    BadFile
        The file is not a table with columns separated by commas. The message states its type.
    """
    text = text_of(path)
    try:
        rows = [row for row in csv.reader(io.StringIO(text, newline="")) if any(cell.strip() for cell in row)]
    except csv.Error as error:
        raise BadFile(f"{path} cannot be read as a CSV run: {error}") from error
    remarks = [row for row in rows if row[0].lstrip().startswith("#")]
    rows = [row for row in rows if not row[0].lstrip().startswith("#")]
    if rows:
        _verify_separator(path, rows)
    if rows and all(_NUMBER.match(cell) for cell in rows[0]):
        above = [row for row in remarks if len(row) == len(rows[0])]
        if not above:
            raise BadFile(f"{path} has no header line. Add one above the numbers, like {example}")
        rows = [[above[-1][0].lstrip("# \t"), *above[-1][1:]], *rows]
    if len(rows) < 2:
        raise BadFile(f"{path} contains no samples. It needs a header line like {example}, and rows of numbers")
    head, body = rows[0], rows[1:]
    if len(head) == 1 < len(body[0]):
        raise BadFile(
            f"{path}, row 1: {_short(head[0])} is a title above the header line. Remove the lines above the header "
            f"line ({example}), or start them with #"
        )
    while len(head) > 1 and not head[-1].strip() and all(not row[-1].strip() for row in body if len(row) == len(head)):
        width = len(head)
        head, body = head[:-1], [row[:-1] if len(row) == width else row for row in body]
    named = [visible(cell) if cell.strip() else f"column {i}" for i, cell in enumerate(head, start=1)]
    return _with_units(Cells(path, named, body))


def _verify_separator(path: Path, rows: Sequence[list[str]]) -> None:
    head = rows[0]
    name = shlex.quote(path.name)
    body = "\n".join(",".join(row) for row in rows[1:50])
    found = next((s for s in _SEPARATORS if s in head[0] and len(head) <= head[0].count(s)), "")
    if found:
        decimal = bool(_COMMA_IN_NUMBER.search(body))
        shown = "\\t" if found == "\t" else found
        command = f"sed 's/{',/./g; s/' if decimal else ''}{'[|]' if found == '|' else shown}/,/g' {name} > run.csv"
        raise BadFile(
            f"{path} separates its columns by {_SEPARATORS[found]}{' and uses decimal commas' if decimal else ''}. "
            f"Use ',' between columns{' and . in numbers' if decimal else ''}, e.g.: {command}"
        )
    spaced = [row[0].split() for row in rows[1:4] if len(row) == 1]
    if len(head) == 1 and spaced and all(len(s) > 1 and all(_NUMBER.match(c) for c in s) for s in spaced):
        raise BadFile(f"{path} separates its columns by spaces. Use ',' between columns, also in the header line")
    if len(head) > 1 and any(_DECIMAL_COMMA.match(cell) for row in rows[1:4] for cell in row):
        raise BadFile(f"{path} uses decimal commas. Use . in numbers (0.61), and ',' only between columns")
    halves = [row for row in rows[1:50] if len(row) == 2 * len(head)]
    if len(head) > 1 and len(halves) == len(rows[1:50]) > 1:
        raise BadFile(
            f"{path} has {len(head)} column heads but {2 * len(head)} cells in a row: it uses commas both as decimal "
            "signs and between columns. Export it with . in numbers and ',' between columns"
        )


def _with_units(cells: Cells) -> Cells:
    """Return *cells* with a second header line joined to the first, if it contains only units."""
    first = cells.rows[0]
    filled = [cell for cell in first if cell.strip()]
    if any(_number(cell) is not None for cell in filled) or len(first) != len(cells.head):
        return cells
    units = [cell.strip().strip("[]()").strip() for cell in first]
    if all(_is_unit(unit) for unit in units) and not any("[" in head for head in cells.head) and len(cells.rows) > 1:
        head = [f"{name.strip()}[{unit}]" if unit else name for name, unit in zip(cells.head, units, strict=True)]
        return Cells(cells.path, head, cells.rows[1:], cells.first + 1)
    if not any(_DATE.match(cell) for cell in filled):
        shown = ", ".join(_short(cell) for cell in filled[:3])
        raise BadFile(
            f"{cells.path}, row 2: {shown} are words instead of numbers. Keep one header line, with units in "
            "brackets: t[s],psi[deg],N[N m]"
        )
    return cells


def _is_unit(text: str) -> bool:
    try:
        to_si(text)
    except BadFile:
        return False
    return True


def _short(cell: str) -> str:
    text = visible(cell.strip())
    return f"'{text if len(text) <= SHOWN else text[:SHOWN] + '...'}'"


def numbers_of(cells: Cells) -> TableNumbers:
    """Return the numbers in the cells of a table.

    Raises
    ------
    BadFile
        A cell is not a number, a row has another length (a truncated *last* row is dropped), or there are no rows.
    """
    path, width = cells.path, len(cells.head)
    texts = [i for i in range(width) if _is_text(cells, i)]
    kept = [i for i in range(width) if i not in texts]
    values: list[list[float]] = []
    nans, infinite = [0] * len(kept), [0] * len(kept)
    dropped = 0
    for number, row in enumerate(cells.rows, start=cells.first):
        plain = _plain_numbers(row) if len(row) == width and not texts else None
        if plain is not None:
            values.append(plain)
            continue
        numbers = [_number(row[i]) for i in kept] if len(row) == width else []
        whole = [value for value in numbers if value is not None]
        if len(whole) < len(kept):
            if number == cells.first + len(cells.rows) - 1:
                dropped = 1
                break
            _refuse(cells, number, row, kept)
        values.append(whole)
        for k, value in enumerate(whole):
            if not math.isfinite(value) and row[kept[k]].strip():
                (nans if math.isnan(value) else infinite)[k] += 1
    if not values:
        if len(cells.rows[-1]) == width:
            _refuse(cells, cells.first, cells.rows[-1], kept)
        raise BadFile(f"{path} contains no complete row of samples")
    heads = [cells.head[i] for i in texts]
    return TableNumbers(kept, np.array(values, dtype=np.float64), dropped, nans, infinite, heads)


def _plain_numbers(row: Sequence[str]) -> list[float] | None:
    """Return the numbers of a row that contains only finite numbers, by a fast path; None for any other row."""
    text = "".join(row)
    if not text.isascii() or "_" in text:
        return None
    try:
        numbers = [float(cell) for cell in row]
    except ValueError:
        return None
    return numbers if math.isfinite(sum(numbers)) else None


def _number(cell: str) -> float | None:
    """Return the number in a cell, NaN if it is empty, None if it is not a number.

    Python's ``1_0`` and digits of other scripts do not count as numbers, because no logger writes them.
    """
    text = cell.strip()
    if not text:
        return math.nan
    if not text.isascii() or "_" in text:
        return None
    try:
        return float(text)
    except ValueError:
        return None


def _is_text(cells: Cells, i: int) -> bool:
    """Return whether column *i* contains only text and its name is not that of a known signal."""
    name, unit = parse_header(cells.head[i])
    if name in SIGNALS or unit or name.lower() in ("t", "time"):
        return False
    filled = (row[i] for row in cells.rows if len(row) > i and row[i].strip())
    first = next(filled, "")
    if not first or _number(first) is not None or _DATE.match(first):
        return False
    return all(_number(cell) is None and not _DATE.match(cell) for cell in filled)


def _refuse(cells: Cells, number: int, row: Sequence[str], columns: Sequence[int]) -> NoReturn:
    """Return the error for the first cell of *row* that is not a number."""
    if len(row) != len(cells.head):
        raise BadFile(
            f"{cells.path}, row {number}: {counted(len(row), 'cell')} instead of {len(cells.head)}. "
            "Correct or remove this row"
        )
    i = next(i for i in columns if _number(row[i]) is None)
    cell, head = row[i], cells.head[i]
    where = f"{cells.path}, row {number}, column {_short(head)}: {_short(cell)}"
    if _DATE.match(cell):
        raise BadFile(f"{where} is a date or a time of day. Use seconds as numbers (t[s]: 0.00, 0.10, ...)")
    if _DECIMAL_COMMA.match(cell):
        raise BadFile(f"{where} has a decimal comma. Use . in numbers")
    if cell.strip() == head.strip():
        raise BadFile(f"{where} repeats the header line. Split the file here: each part is a run")
    raise BadFile(f"{where} is not a number")


EPOCHS: tuple[tuple[float, float, str, float], ...] = (
    (1e17, 1e19, "ns", 1e-9),
    (1e14, 1e16, "us", 1e-6),
    (1e11, 1e13, "ms", 1e-3),
)
"""Ranges of time stamps without a unit that count from 1970.

Each row has the lower and the upper limit, the unit of such stamps, and that unit in seconds.
"""


def since_1970(file: str, t: Array) -> tuple[Array, list[Note]]:
    """Return time stamps (n,) without a unit converted to seconds, with a note if their size indicates another unit."""
    known = np.abs(t[np.isfinite(t)])
    typical = float(np.median(known)) if len(known) else 0.0
    for low, high, unit, factor in EPOCHS:
        if low < typical < high:
            cause = f"the timestamps of {file} have no unit. They are read as {unit} since 1970"
            return t * factor, [("epoch-stamps", cause, f"if this is correct, rename the column to t[{unit}]")]
    return t, []


ABSURD, LAST = 1e12, 1e11
"""Largest plausible signal in SI units, and largest plausible time stamp [s].

A larger number counts as damage. Project choice.
"""


def is_believable(name: str, values: Array, file: str) -> tuple[NDArray[np.bool_], list[Note]]:
    """Return a mask of the plausible values (n,) of a channel in SI units, with a note if some are not."""
    with np.errstate(invalid="ignore"):
        absurd = np.isfinite(values) & (np.abs(values) > ABSURD)
    if not absurd.any():
        return np.isfinite(values), []
    cause = (
        f"{int(absurd.sum())} of {len(values)} values of {name} in {file} are implausible, e.g. {values[absurd][0]:.3g}"
    )
    return np.isfinite(values) & ~absurd, [("absurd-values", cause, "check the logger. The samples were skipped")]


def clock_notes(file: str, t: Array) -> list[Note]:
    """Return notes on how many rows stamped *t* [s] have no time, and on how often the time runs backwards."""
    notes: list[Note] = []
    known = t[np.isfinite(t)]
    if 0 < len(t) - len(known):
        cause = f"{len(t) - len(known)} of {len(t)} rows of {file} have no time"
        notes.append(("rows-without-time", cause, "check the logger. The rows were skipped"))
    back = np.flatnonzero(np.diff(known) < 0.0)
    if len(back):
        first = int(back[0])
        times = f"{len(back)} times, first" if len(back) > 1 else "once,"
        cause = f"the time of {file} jumps back {times} from {known[first]:.10g} to {known[first + 1]:.10g} s"
        notes.append(("time-runs-back", cause, "record the vehicle's own timestamps, or split the file there"))
    return notes


NEUTRAL, HALF_RANGE = 1500.0, 400.0
"""Neutral pulse [us], and the difference [us] to full output, if nothing else is known: ArduPilot's defaults."""
SHORTEST, LONGEST = 700.0, 2300.0
"""Range of pulses [us].

An input with all values inside it is in pulses, because outputs and angles are smaller. Project choice.
"""


def is_pulses(unit: str, values: Array) -> bool:
    """Return whether an input is in pulses [us]: by its unit or, without one (``1``, of a rudder ``rad``), by its
    size."""
    return unit == "pwm" or (unit in ("1", "rad") and _are_pulses(values))


def _are_pulses(values: Array) -> bool:
    sent = values[values != 0.0]
    return len(sent) > 0 and bool(np.all((sent > SHORTEST) & (sent < LONGEST)))


def shares_of_pulses(name: str, values: Array, run: str) -> tuple[Array, Note]:
    """Return pulses [us] as normalised output about neutral. 0 us means no pulse, and so no output.

    Raises
    ------
    BadFile
        The pulses do not lie about the neutral one.
    """
    sent = values[values != 0.0]
    if len(sent) and not _are_pulses(values):
        raise BadFile(
            f"{name} of run '{visible(run)}' is in pulses, but ranges from {sent.min():g} to {sent.max():g}. Pulses "
            f"are around {NEUTRAL:g} us. Correct the unit, or use the normalised output (-1 to 1) without a unit"
        )
    size = f", {sent.min():g} to {sent.max():g} us" if len(sent) else ""
    cause = (
        f"{name} of run '{visible(run)}' is in pulses{size}. It is read as normalised output, "
        f"(pulse - {NEUTRAL:g} us) / {HALF_RANGE:g} us"
    )
    cure = "for another neutral or full output, write the normalised output: (pulse - trim) / (max - trim)"
    return np.where(values == 0.0, 0.0, (values - NEUTRAL) / HALF_RANGE), (f"pulses-{name}", cause, cure)
