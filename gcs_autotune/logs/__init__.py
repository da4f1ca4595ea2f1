"""Recorded runs from every ordinary log, as trials: no robot middleware, no ground station needed.

* ``files``: :func:`load_runs`; ``formats``, the one table of kinds of files, by content; ``renaming`` for columns by
  other names;
* ``tlog``, ``mavlink_csv`` MAVLink messages, written into sample stores (samples by source, one ``store`` per boot) by
  ``mavlink_scribe``; ``dataflash`` logs on board, with ``dataflash_format``; ``qgc_csv``;
  which message brings which source is in the tables ``mavlink_signals`` and ``dataflash_signals``;
* ``channels`` which source becomes which motion channel, ``filters`` what the autopilot did to it before,
  ``outputs`` what drove the craft;
* ``stretches`` a recording cut into runs, one per stretch armed in one mode; ``excitation`` and ``survey`` what is in
  it; ``importing`` writes it down.

Everything reads its file a piece at a time.
"""

from __future__ import annotations

from gcs_autotune.logs.files import TRIALS_FOLDER, load_runs, record
from gcs_autotune.logs.formats import FORMATS, format_of
from gcs_autotune.logs.renaming import parse_columns, renamed
from gcs_autotune.logs.sample_store import Census, Recording
from gcs_autotune.logs.segmentation import Cut, SkippedPart, cut_runs, runs_of
from gcs_autotune.logs.survey import fresh_folder, survey, write_runs

__all__ = [
    "FORMATS",
    "TRIALS_FOLDER",
    "Census",
    "Cut",
    "Recording",
    "SkippedPart",
    "cut_runs",
    "format_of",
    "fresh_folder",
    "load_runs",
    "parse_columns",
    "record",
    "renamed",
    "runs_of",
    "survey",
    "write_runs",
]
