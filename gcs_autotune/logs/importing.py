"""Runs of a log written to disk as the CSV files and side files every command reads."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gcs_autotune.errors import BadFile, UsageError
from gcs_autotune.link import save_params
from gcs_autotune.logs.recording import Recording
from gcs_autotune.trial import Trial, save_trial

__all__ = ["fresh_folder", "write_runs"]


def fresh_folder(folder: Path) -> Path:
    """Make *folder*, which must not hold runs already.

    Raises
    ------
    UsageError
        It holds CSV files: other runs would be mixed with these. BadFile: it cannot be made.
    """
    if folder.is_dir() and any(folder.glob("*.csv")):
        raise UsageError(f"{folder} holds runs already: name another folder with --out")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadFile(f"{folder} cannot be made: {error.strerror}; name another folder with --out") from error
    return folder


def write_runs(folder: Path, label: str, runs: Sequence[Trial], log: Recording, told: Mapping[str, Any]) -> list[Path]:
    """Write *runs* (``LABEL-03-MANUAL.csv``, marks and meta data beside it as ``.json``) and return their paths.

    Beside them go the survey (*told*) as ``LABEL.log.json`` and, where the log tells any, the vehicle's parameters as
    ``LABEL.param``.

    Raises
    ------
    BadFile
        The disk is full, or the folder cannot be written.
    """
    stem = _plain(label)
    paths = []
    try:
        for run in runs:
            path = folder / f"{stem}-{int(run.meta['stretch']):02d}-{_plain(str(run.meta['mode']))}.csv"
            save_trial(run, path)
            paths.append(path)
        (folder / f"{stem}.log.json").write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")
    except OSError as error:
        raise BadFile(f"{folder} cannot be written: {error.strerror}; check the disk") from error
    for tape in log.tapes[-1:]:
        if tape.parameters:
            save_params(folder / f"{stem}.param", tape.parameters, comment=f"{tape.vehicle}, from {log.meta['source']}")
    return paths


def _plain(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9_.]+", "-", text).strip("-.") or "log"
