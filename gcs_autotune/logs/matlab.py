"""MATLAB's MAT files (up to version 7.2) to runs: vectors of one length beside a vector ``t``, also within structures.

SciPy reads them. A MAT file names no units: they are those of the signals (SI), unless ``--columns`` says otherwise.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gcs_autotune.errors import BadFile
from gcs_autotune.foreign_text import visible
from gcs_autotune.logs.format import FAULTS, Format, Head
from gcs_autotune.trial import TIMES, Trial, trial_of_columns

__all__ = ["FORMAT", "read_mat"]

HEAD = re.compile(rb"MATLAB 5\.0 MAT-file")
EXPORT = "export it from MATLAB as CSV: writematrix([t psi N], 'run.csv'), with a head line t[s],psi[rad],N[N m] above"
DEEPEST = 8
"""Chosen: structures within structures."""
SHORTEST = 2


def read_mat(path: Path, columns: Mapping[str, str]) -> list[Trial]:
    """Read the run in the MAT file at *path*.

    columns : name in the file -> ``channel[unit]``.

    Raises
    ------
    BadFile
        Unreadable, or without a vector of times and one beside it. UsageError: a name in *columns* it does not have.
    """
    import scipy.io

    try:
        tree = scipy.io.loadmat(path, squeeze_me=True, simplify_cells=True)
    except FAULTS as error:
        raise BadFile(f"{path} is a MATLAB file that cannot be read ({_first_line(error)}): {EXPORT}") from None
    vectors = dict(_vectors("", tree, 0))
    short = [name.rpartition(".")[2] for name in vectors]
    named = {name if short.count(s) > 1 else s: v for (name, v), s in zip(vectors.items(), short, strict=True)}
    back = {old: new for new, old in ((new, old) for old, new in columns.items())}
    time = next((n for n in named if back.get(n, n).partition("[")[0].strip().lower() in TIMES), None)
    if time is None:
        found = ", ".join(visible(name) for name in list(named)[:10]) or "none"
        raise BadFile(
            f"{path} is a MATLAB file without a vector of times called t (vectors of numbers in it: {found}): say "
            f"which is what with --columns OLD=t[s],..., or {EXPORT}"
        )
    table = {name: v for name, v in named.items() if len(v) == len(named[time])}
    other = [name for name in named if name not in table]
    run = trial_of_columns(table, path.name, columns)
    notes = [
        *run.meta.get("notes", ()),
        ("assumed-units", f"{path.name} names no units: SI was assumed where --columns names none", "give --columns"),
    ]
    if other:
        cause = f"vectors of another length than {time} were left out: {', '.join(map(visible, other[:5]))}"
        notes.append(("left-out-vectors", cause, "resample them to the times of the run"))
    return [replace(run, name=visible(path.stem), meta={**run.meta, "format": "MATLAB file", "notes": notes})]


def _first_line(error: BaseException) -> str:
    return visible(str(error).partition("\n")[0][:80]) or type(error).__name__


def _vectors(name: str, value: Any, depth: int) -> Iterator[tuple[str, np.ndarray[Any, Any]]]:
    """Yield every vector of real numbers in a tree of structures, by its name with dots."""
    if isinstance(value, Mapping) and depth < DEEPEST:
        for key, inner in value.items():
            if not str(key).startswith("__"):
                yield from _vectors(f"{name}.{key}" if name else str(key), inner, depth + 1)
    elif isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype.kind in "fiub" and len(value) >= SHORTEST:
        yield name, value.astype(np.float64)


def _fits(head: Head) -> bool:
    return HEAD.match(head.data) is not None


FORMAT = Format("a MATLAB file", _fits, (".mat",), runs=read_mat)
