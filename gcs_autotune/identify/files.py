"""Finding the runs to identify from on disk."""

from __future__ import annotations

from pathlib import Path

from gcs_autotune.errors import BadFile
from gcs_autotune.trial import Trial, load_trial

__all__ = ["TRIALS_FOLDER", "load_runs"]

TRIALS_FOLDER = "trials"
"""Where a run directory keeps its recorded manoeuvres."""

_LOGS = (".tlog", ".bin", ".log")

IDENTIFYING = "relay"
"""The manoeuvre (``meta["manoeuvre"]`` in a trial's side file) a run directory is identified from."""


def load_runs(path: Path | str) -> list[Trial]:
    """Return the trials at *path*, in file-name order.

    * a CSV file: that trial;
    * a run directory: those of its ``trials/*.csv`` whose side file says ``"manoeuvre": "relay"``; when no side
      file names any manoeuvre at all (files from elsewhere), every CSV there;
    * any other directory: its ``*.csv``, by the same rule.

    Raises
    ------
    BadFile
        Nothing at *path*, no CSV in it, or none of a relay; and what ``load_trial`` raises.
    """
    place = Path(path)
    if place.suffix.lower() in _LOGS:
        raise BadFile(
            f"{place} is a {place.suffix} log, and those cannot be identified from yet; give the run directory or a "
            "CSV with columns like t[s],psi[rad],N[N m]"
        )
    if place.is_file():
        return [load_trial(place)]
    if not place.is_dir():
        raise BadFile(f"{place}: no such file or run directory")
    folder = place / TRIALS_FOLDER if (place / TRIALS_FOLDER).is_dir() else place
    files = sorted(folder.glob("*.csv"))
    if not files:
        raise BadFile(f"{folder} holds no recorded run (*.csv); give a CSV file or a run directory")
    trials = [load_trial(file) for file in files]
    if not any("manoeuvre" in t.meta for t in trials):
        return trials
    relays = [t for t in trials if t.meta.get("manoeuvre") == IDENTIFYING]
    if not relays:
        kinds = ", ".join(sorted({str(t.meta.get("manoeuvre", "unnamed")) for t in trials}))
        raise BadFile(f"{folder} holds no relay experiment, only: {kinds}; name the CSV file to identify from it")
    return relays
