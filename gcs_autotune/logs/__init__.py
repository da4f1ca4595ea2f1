"""Read recorded runs from all common types of logs, without robot middleware or a ground station.

* ``files``: :func:`load_runs`; ``formats``: the table of file types, recognised by content; ``renaming``: columns with
  other names;
* ``tlog`` and ``mavlink_csv``: MAVLink messages, which ``mavlink_decoder`` writes into sample stores; ``dataflash``:
  onboard logs, with ``dataflash_format`` and ``aboard_record`` (rows of a script of ours); ``qgc_csv``, ``ulog``,
  ``matlab`` and ``rosbag``: other formats;
* ``sample_store``: samples by source, one store per boot; ``channels``: which source becomes which motion channel, and
  which inputs drove the craft;
* ``segmentation``: a recording is cut into runs, one per segment armed in one mode; ``survey``: its contents.

Files are read a piece at a time.
"""

from __future__ import annotations

from gcs_autotune.logs.aboard_record import ENDS as ABOARD_ENDS
from gcs_autotune.logs.aboard_record import ROWS as ABOARD_ROWS
from gcs_autotune.logs.aboard_record import runs_aboard
from gcs_autotune.logs.files import TRIALS_FOLDER, load_runs, record
from gcs_autotune.logs.formats import FORMATS, format_of
from gcs_autotune.logs.renaming import parse_columns, renamed
from gcs_autotune.logs.sample_store import Census, Recording, SampleStore
from gcs_autotune.logs.segmentation import Cut, SkippedPart, cut_runs, runs_of
from gcs_autotune.logs.survey import fresh_folder, survey, write_runs

__all__ = [
    "ABOARD_ENDS",
    "ABOARD_ROWS",
    "FORMATS",
    "TRIALS_FOLDER",
    "Census",
    "Cut",
    "Recording",
    "SampleStore",
    "SkippedPart",
    "cut_runs",
    "format_of",
    "fresh_folder",
    "load_runs",
    "parse_columns",
    "record",
    "renamed",
    "runs_aboard",
    "runs_of",
    "survey",
    "write_runs",
]
