"""Recorded runs from every ordinary log, as trials: no robot middleware, no ground station needed.

* ``files``: :func:`load_runs` and the table of readers by suffix; ``renaming`` for columns by other names;
* ``tlog`` telemetry logs, ``dataflash`` logs on board: both write a ``tape`` (samples by source, one per boot);
* ``channels`` which source becomes which motion channel, ``outputs`` what drove the craft;
* ``stretches`` the tape cut into runs, one per stretch armed in one mode.
"""

from __future__ import annotations

from gcs_autotune.logs.dataflash import load_dataflash
from gcs_autotune.logs.files import READERS, TRIALS_FOLDER, load_runs
from gcs_autotune.logs.renaming import parse_columns, renamed
from gcs_autotune.logs.tlog import load_tlog

__all__ = ["READERS", "TRIALS_FOLDER", "load_dataflash", "load_runs", "load_tlog", "parse_columns", "renamed"]
