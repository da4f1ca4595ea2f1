"""The run directory: all files that a run writes, saved as the run proceeds."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

from gcs_autotune.documents import check_run_folder
from gcs_autotune.errors import AutotuneError, BadFile, UsageError
from gcs_autotune.mavlink import save_params, save_qgc_params
from gcs_autotune.plain_json import json_text
from gcs_autotune.report import how_to_resume
from gcs_autotune.trial import Trial, save_trial
from gcs_autotune.workflow.itinerary import MissionLog

__all__ = ["JOURNAL", "PROPOSED", "SAVED", "RunDirectory"]

JOURNAL = "journal.jsonl"
"""The journal's name in a run directory."""

SUMMARY = "summary.json"
"""Name of the file with a short summary of how a run ended. The summary of a tune contains more."""
SAVED = "parameters_before.param"
"""Name of the file with the parameters of before a run."""
PROPOSED = "proposed.param"
"""Name of the file with gains that a run proposed but did not write."""


class RunDirectory:
    """The directory of one run, and the names of its files.

    It contains ``trials/NN-name.csv`` (+ ``.json``), ``telemetry.tlog``, ``journal.jsonl``, parameters, model and
    report. :meth:`make` creates it once the link is open.

    Raises
    ------
    UsageError
        The directory cannot be created, or already contains a run.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.is_made = False
        self._count = 0
        check_run_folder(path)

    def make(self) -> None:
        """Create the directory.

        Raises
        ------
        UsageError
            The directory cannot be created.
        """
        try:
            (self.path / "trials").mkdir(parents=True)
        except FileExistsError:
            raise UsageError(f"{self.path} already contains a run. Use another --out") from None
        except OSError as error:
            raise UsageError(f"cannot create the run directory {self.path}: {error}. Use another --out") from error
        self.is_made = True

    def discard(self) -> None:
        """Delete the directory of a run that was rejected before anything was flown.

        A directory with trials is kept.
        """
        if self.is_made and not any((self.path / "trials").iterdir()):
            shutil.rmtree(self.path, ignore_errors=True)
            self.is_made = False

    @property
    def tlog(self) -> Path:
        """Path of the telemetry log with everything sent and received."""
        return self.path / "telemetry.tlog"

    @property
    def journal(self) -> Path:
        """Path of the journal of the changes on the vehicle, until they are restored."""
        return self.path / JOURNAL

    def keep(self, trial: Trial) -> None:
        """Write a trial. A trial with a lead-in is also written in full, to a second file.

        Raises
        ------
        BadFile
            The file cannot be written (a full disk).
        """
        self._count += 1
        stem = f"{self._count:02d}-{trial.name}"
        try:
            if trial.proper is not trial:
                save_trial(replace(trial, meta={}), self.path / "trials" / f"{stem}-with-lead-in.csv")
            save_trial(trial.proper, self.path / "trials" / f"{stem}.csv")
        except OSError as error:
            raise self._unwritable(error) from error

    def save_parameters(self, name: str, values: Mapping[str, float]) -> Path:
        """Write ``parameters_<name>.json`` and a ``.param`` file (``NAME,VALUE``) with the same content; return the
        path of the latter.

        Raises
        ------
        BadFile
            The files cannot be written (a full disk).
        """
        path = self.path / f"parameters_{name}.param"
        try:
            path.with_suffix(".json").write_text(json.dumps(dict(values), indent=1) + "\n", encoding="utf-8")
            path.write_text("".join(f"{k},{v:.9g}\n" for k, v in values.items()), encoding="utf-8")
        except OSError as error:
            raise self._unwritable(error) from error
        return path

    def save_proposed(
        self, values: Mapping[str, float], types: Mapping[str, int], vehicle: tuple[int, int], comment: str
    ) -> None:
        """Write gains that are not proved yet, as ``proposed.param`` and, for QGroundControl, ``.params``.

        Raises
        ------
        BadFile
            The files cannot be written (a full disk).
        """
        path = self.path / PROPOSED
        save_params(path, values, comment=comment)
        save_qgc_params(path.with_suffix(".params"), values, types, vehicle, comment=comment)

    def save_json(self, name: str, content: Mapping[str, object]) -> None:
        """Save *content* as JSON in the file *name*; errors as for :meth:`save_parameters`."""
        try:
            (self.path / name).write_text(json_text(content), encoding="utf-8")
        except OSError as error:
            raise self._unwritable(error) from error

    @contextmanager
    def summarised(self, title: str, when: str, log: MissionLog) -> Iterator[None]:
        """Write the title and ending of the run inside the context to ``summary.json``, which lists of runs show.

        log : that of the run; it contains how to continue after an early end.

        Raises
        ------
        BadFile
            The run succeeded but the file cannot be written (a full disk).
        """
        about = {"title": title, "when": when}
        try:
            yield
        except AutotuneError as error:
            if self.is_made:
                with suppress(BadFile):  # the first error is the one to report
                    how = how_to_resume(log.way_on)
                    resume = {"resume": how} if how else {}
                    self.save_json(SUMMARY, {**about, "ending": "aborted", "reason": str(error), **resume})
            raise
        self.save_json(SUMMARY, {**about, "ending": "completed", "reason": ""})

    def _unwritable(self, error: OSError) -> BadFile:
        return BadFile(
            f"the run directory {self.path} cannot be written ({error.strerror or error}). Free some disk space or "
            "use another --out"
        )
