"""Recorded runs from every ordinary log, as trials: no robot middleware, no ground station needed.

* ``files``: :func:`load_runs` and the table of readers by suffix; ``renaming`` for columns by other names;
* ``tlog`` telemetry logs, ``dataflash`` logs on board: both write a ``tape`` (samples by source, one per boot);
* ``channels`` which source becomes which motion channel, ``outputs`` what drove the craft;
* ``stretches`` the tape cut into runs, one per stretch armed in one mode.
"""

from __future__ import annotations

from gcs_autotune.logs.files import READERS, TRIALS_FOLDER, load_runs, record
from gcs_autotune.logs.recording import Census, Recording
from gcs_autotune.logs.renaming import parse_columns, renamed
from gcs_autotune.logs.stretches import Cut, cut_runs, runs_of

__all__ = [
    "READERS",
    "TRIALS_FOLDER",
    "Census",
    "Cut",
    "Recording",
    "cut_runs",
    "load_runs",
    "parse_columns",
    "record",
    "renamed",
    "runs_of",
]
