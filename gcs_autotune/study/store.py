"""The results folder of a study: rows in Parquet parts, each written completely or not at all.

A part is written under a temporary name, forced to the disk and renamed. A row appears once, whatever was interrupted:
of equal cases the first one counts.
"""

from __future__ import annotations

import contextlib
import json
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from gcs_autotune.documents import load_json
from gcs_autotune.errors import BadFile, PreconditionFailed, UsageError
from gcs_autotune.notebook import pandas_module
from gcs_autotune.plain_json import json_text
from gcs_autotune.rounding import counted

try:
    import fcntl
except ImportError:  # pragma: no cover - Windows
    fcntl = None  # type: ignore[assignment]

__all__ = ["DAMAGED", "DONE", "FAILED", "GIVEN_UP", "Row", "Store", "frame_of", "open_study", "parquet"]

SCHEMA = "gcs-autotune study 1"
HEAD, PLAN, LOCK, PARTS = "study.json", "study.toml", ".lock", "parts"
DAMAGED = ".damaged"
"""Ending of a part that cannot be read; `study run` renames it and repeats its cases."""
ROWS, SECONDS = 512, 5.0
"""Rows after which a part is written, and the time [s] after which fewer are. Project choices."""
MOST_PARTS = 64
"""Number of parts above which they are merged at the start and the end of a run. Project choice."""
DONE, FAILED, GIVEN_UP = "done", "failed", "given up"


@dataclass(frozen=True, slots=True)
class Row:
    """The result of a case.

    ``case``: hash of its values and of the code; ``point``: of its values alone; ``index``: its position.
    ``status``: done, failed or given up; ``reason``: why it is not done; ``tries``: how often it was begun.
    ``seconds``: time of the last try; ``ended``: when it ended [s since 1970].
    ``given``: its values. ``numbers``, ``texts``: its results.
    """

    case: str
    point: str
    index: int
    status: str
    given: Mapping[str, Any]
    numbers: Mapping[str, float]
    texts: Mapping[str, str]
    reason: str = ""
    tries: int = 1
    seconds: float = 0.0
    ended: float = 0.0


def parquet() -> Any:
    """Return ``pyarrow.parquet``.

    Raises
    ------
    UsageError
        It is not installed.
    """
    try:
        import pyarrow.parquet
    except ImportError as error:
        raise UsageError(f"`study` needs Dask and pyarrow. Run pip install 'gcs-autotune[study]' ({error})") from None
    return pyarrow.parquet


def _schema() -> Any:
    import pyarrow as pa

    return pa.schema(
        [
            *(("case", pa.string()), ("point", pa.string()), ("index", pa.int64()), ("status", pa.string())),
            *(("given", pa.string()), ("numbers", pa.map_(pa.string(), pa.float64()))),
            *(("texts", pa.map_(pa.string(), pa.string())), ("reason", pa.string()), ("tries", pa.int32())),
            *(("seconds", pa.float64()), ("ended", pa.float64())),
        ]
    )


class Store:
    """The results in *folder*. Reading needs no lock; :meth:`writing` allows one writer at a time."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._parts = folder / PARTS
        self._waiting: list[Row] = []
        self._since = time.monotonic()

    # -- the head

    @property
    def has_head(self) -> bool:
        """Whether the folder contains a study."""
        return (self.folder / HEAD).is_file()

    @property
    def head(self) -> dict[str, Any]:
        """Content of ``study.json``.

        Raises
        ------
        BadFile
            The folder contains no study.
        """
        path = self.folder / HEAD
        if not self.has_head:
            raise BadFile(f"{self.folder} contains no study: {HEAD} is missing. Give the results folder of `study run`")
        head = load_json(path, "the head of a study")
        if not isinstance(head, dict) or head.get("schema") != SCHEMA:
            raise BadFile(f"{path} is not the head of a study of this version ({SCHEMA})")
        return head

    @property
    def plan_file(self) -> Path:
        """The copy of the study file."""
        return self.folder / PLAN

    def begin(self, plan: str, head: Mapping[str, Any]) -> None:
        """Write the head and the copy of the study file."""
        with _naming_disk(self.folder, "the study"):
            self._parts.mkdir(parents=True, exist_ok=True)
            _write(self.plan_file, lambda path: path.write_text(plan, encoding="utf-8"))
            text = json_text({"schema": SCHEMA, **head})
            _write(self.folder / HEAD, lambda path: path.write_text(text, encoding="utf-8"))

    @property
    def is_being_written(self) -> bool:
        """Whether a process holds the folder with :meth:`writing`. False where files cannot be locked."""
        if fcntl is None or not (self.folder / LOCK).exists():
            return False
        with (self.folder / LOCK).open("a") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except OSError:
                return True
        return False

    def row(self, case: str) -> tuple[int, dict[str, Any]]:
        """Return position and values of the stored case whose key begins with *case*.

        Raises
        ------
        UsageError
            There is none, or more than one.
        """
        found = {
            row["case"]: (row["index"], json.loads(row["given"]))
            for table in self.tables(["case", "index", "given"], damaged=lambda path: None)
            for row in table.to_pylist()
            if row["case"].startswith(case)
        }
        if len(found) != 1:
            many = "more than one case begins" if found else "no stored case begins"
            raise UsageError(f"{self.folder}: {many} with {case}. `study report` shows the keys of the worst cases")
        return next(iter(found.values()))

    @contextlib.contextmanager
    def writing(self) -> Iterator[None]:
        """Hold the folder for one writer, and write the waiting rows at the end, however it ends.

        Raises
        ------
        PreconditionFailed
            Another process writes to it. UsageError: it cannot be created.
        """
        try:
            self._parts.mkdir(parents=True, exist_ok=True)
            lock = (self.folder / LOCK).open("w")
        except OSError as error:
            raise UsageError(f"cannot create {self.folder}: {error.strerror}. Use another --out") from error
        with lock:
            if fcntl is not None:
                try:
                    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except OSError as error:
                    raise PreconditionFailed(
                        f"{self.folder} is in use: another `study run` writes to it. Wait for its end, or stop it"
                    ) from error
            for left in self._parts.glob("*.tmp"):
                left.unlink()
            try:
                yield
            finally:
                self.flush()

    # -- rows

    def add(self, row: Row) -> None:
        """Store *row*, at once or with the next rows."""
        self._waiting.append(row)
        if len(self._waiting) >= ROWS or time.monotonic() - self._since >= SECONDS:
            self.flush()

    def flush(self) -> None:
        """Write the rows that wait.

        Raises
        ------
        BadFile
            The disk is full or cannot be written.
        """
        self._since = time.monotonic()
        if self._waiting:
            self._write_part(self._waiting)
            self._waiting = []

    def _write_part(self, rows: Sequence[Row]) -> Path:
        import pyarrow as pa

        columns = [asdict(row) for row in rows]
        for each in columns:
            each["given"] = json.dumps(each["given"], sort_keys=True)
            each["numbers"], each["texts"] = list(each["numbers"].items()), list(each["texts"].items())
        table = pa.Table.from_pylist(columns, schema=_schema())
        return self._write_table(table)

    def _write_table(self, table: Any) -> Path:
        last = max((int(p.name.split("-")[1].split(".")[0]) for p in self._parts.glob("part-*")), default=-1)
        path = self._parts / f"part-{last + 1:06d}.parquet"
        with _naming_disk(path, counted(table.num_rows, "case")):
            _write(path, lambda temporary: parquet().write_table(table, temporary))
        return path

    def parts(self) -> list[Path]:
        """Return the parts in the order in which they were written."""
        return sorted(self._parts.glob("part-*.parquet"))

    def tables(
        self, columns: Sequence[str] | None = None, damaged: Callable[[Path], None] | None = None
    ) -> Iterator[Any]:
        """Yield the pyarrow table of each part.

        damaged : called with a part that cannot be read, which is then left out; None: an error.

        Raises
        ------
        BadFile
            A part cannot be read.
        """
        for path in self.parts():
            try:
                yield parquet().read_table(path, columns=columns, schema=_schema() if columns is None else None)
            except Exception as error:
                if isinstance(error, UsageError):
                    raise
                if damaged is None:
                    raise BadFile(
                        f"{path} cannot be read: it is cut short or damaged. `study run` repeats its cases"
                    ) from error
                damaged(path)

    def cases(self, damaged: Callable[[Path], None] | None = None) -> set[str]:
        """Return the keys of the stored cases."""
        return {key for table in self.tables(["case"], damaged) for key in table.column("case").to_pylist()}

    def table(self, damaged: Callable[[Path], None] | None = None) -> Any:
        """Return all rows as one pyarrow table, each case once, in the order of the study."""
        import pyarrow as pa

        tables = list(self.tables(None, damaged))
        whole = pa.concat_tables(tables) if tables else _schema().empty_table()
        seen: dict[str, int] = {}
        for k, key in enumerate(whole.column("case").to_pylist()):
            seen.setdefault(key, k)
        if len(seen) < whole.num_rows:
            whole = whole.take(list(seen.values()))
        return whole.sort_by([("index", "ascending"), ("case", "ascending")])

    def mend(self) -> list[Path]:
        """Rename the parts that cannot be read, so that their cases are repeated. Return their names."""
        found: list[Path] = []
        for _ in self.tables(["case"], found.append):
            pass
        for path in found:
            path.rename(path.with_name(path.name + DAMAGED))
        return found

    def merge(self) -> None:
        """Write small parts as one if there are many. If this is interrupted, rows that appear twice count once."""
        import pyarrow as pa

        small = [path for path in self.parts() if parquet().read_metadata(path).num_rows < ROWS]
        if len(small) > MOST_PARTS:
            self._write_table(pa.concat_tables(parquet().read_table(path, schema=_schema()) for path in small))
            for path in small:
                path.unlink()


@contextlib.contextmanager
def _naming_disk(path: Path, what: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        why = os.strerror(error.errno) if error.errno else error  # pyarrow wraps the words of the system in its own
        raise BadFile(
            f"cannot write {what} to {path}: {why}. Free some space and repeat the command; "
            "the stored cases are not repeated"
        ) from error


def _write(path: Path, write: Callable[[Path], object]) -> None:
    """Write a file completely or not at all: temporary file, fsync, rename."""
    temporary = path.with_name(f"{path.name}.tmp")
    try:
        write(temporary)
        with temporary.open("rb") as stream:
            os.fsync(stream.fileno())
        temporary.replace(path)
    except OSError:
        temporary.unlink(missing_ok=True)
        raise
    if os.name == "posix":
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)


def open_study(folder: str | Path, *, arrow: bool = False) -> Any:
    """Return the results in *folder* as a pandas DataFrame, one row per case and one column per value and result.

    arrow : return the pyarrow table as it is stored instead, with the results as maps.

    Raises
    ------
    BadFile
        The folder contains no study, or a part cannot be read. UsageError: pandas or pyarrow is missing.
    """
    store = Store(Path(folder))
    store.head  # noqa: B018  whether it is a study
    table = store.table()
    return table if arrow else frame_of(table)


def frame_of(table: Any) -> Any:
    """Return a table of :class:`Store` as a DataFrame. Of equal names, one has the prefix ``given.`` or ``result.``."""
    pd = pandas_module()
    plain = table.select([n for n in table.column_names if n not in ("given", "numbers", "texts")]).to_pandas()
    given = [json.loads(text) for text in table.column("given").to_pylist()]
    results = [
        {**dict(numbers), **dict(texts)}
        for numbers, texts in zip(table.column("numbers").to_pylist(), table.column("texts").to_pylist(), strict=True)
    ]
    values, outcome = (pd.DataFrame(rows, index=plain.index) for rows in (given, results))
    taken = {*plain.columns, *values.columns}
    outcome = outcome.rename(columns={name: f"result.{name}" for name in outcome.columns if name in taken})
    values = values.rename(columns={name: f"given.{name}" for name in values.columns if name in plain.columns})
    return pd.concat([plain, values, outcome], axis=1)
