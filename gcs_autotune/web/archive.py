"""Files on disk: runs, logs that were dropped on the page, and their files.

Nothing outside the folder of runs is accessible.
"""

from __future__ import annotations

import asyncio
import re
import shutil
import tempfile
import zipfile
from collections.abc import AsyncIterator, Mapping
from contextlib import suppress
from datetime import datetime
from io import BufferedWriter
from pathlib import Path
from typing import Any, BinaryIO

from msgspec import Struct

from gcs_autotune.axes import AXES
from gcs_autotune.errors import UsageError
from gcs_autotune.mavlink import save_params
from gcs_autotune.untrusted_text import visible
from gcs_autotune.web.job import JOB, is_settled, page_of, read_json
from gcs_autotune_files import Refused, conform, parse, read

__all__ = ["GUIDED", "KINDS", "ORDERED", "STYLED", "Archive", "gains_of", "loop_of", "packed", "undo_of"]

KINDS: Mapping[str, str] = {
    ".html": "text/html",
    **dict.fromkeys((".csv", ".json", ".jsonl", ".param", ".params", ".txt", ".toml"), "text/plain"),
    **dict.fromkeys((".tlog", ".bin", ".log"), "application/octet-stream"),
}
"""File name ending that is served -> content type with which the file is sent."""
ORDERED = "ordered.json"
"""File of a run with what was chosen for it on the page."""
STYLED = "styles.json"
"""File of a run with the designs from gentle to quick."""
GUIDED = "all"
"""Job of ``tune all``: the loops of a vehicle in order."""
DIAGNOSIS = "diagnosis.json"
"""File of the result of ``diagnose``."""
DROPPED = (".tlog", ".bin", ".log", ".csv")
"""File name endings that are accepted for upload."""
MOST_BYTES = 512 * 1024 * 1024
"""Largest file accepted [bytes]; an hour of a full-rate onboard log has about 300 MB. Project choice."""
_SPARE = 64 * 1024 * 1024
"""Free disk space [bytes] that an upload leaves for a run that may be recording. Project choice."""
_SHOWN = 300
"""Most entries listed, the newest first. Project choice."""
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,150}")


class Archive:
    """The folder of runs, *root*."""

    def __init__(self, root: Path) -> None:
        self.root = root

    def entries(self) -> list[dict[str, Any]]:
        """Return the stored runs and dropped logs, the newest first."""
        names = sorted((p.name for p in self.root.iterdir() if p.is_dir() and _NAME.fullmatch(p.name)), reverse=True)
        return [self._entry(self.root / name) for name in names[:_SHOWN]]

    def _entry(self, folder: Path) -> dict[str, Any]:
        summary = read_json(folder / "summary.json")
        kind = "diagnosis" if (folder / DIAGNOSIS).is_file() else "run"
        logs = [p.name for p in folder.iterdir() if p.suffix.lower() in DROPPED and p.name != "telemetry.tlog"]
        return {
            "name": folder.name,
            "when": visible(str(summary.get("when", "")).replace("T", " ")[:16]),
            "craft": visible(_craft(summary, _link(folder))),
            "title": visible(str(summary.get("title") or ("log" if logs else kind))),
            "ending": visible(str(summary.get("ending", ""))),
            "reason": visible(str(summary.get("reason", ""))),
            "change": _change(summary),
            "report": page_of(folder),
            "link": visible(_link(folder)),
            "again": read_json(folder / ORDERED) or None,
            "loop": loop_of(folder),
            "log": visible(logs[0]) if logs else "",
            "models": [p.relative_to(folder).as_posix() for p in sorted(_models(folder)) if _plain(p)],
        }

    def entry(self, name: str) -> dict[str, Any]:
        """Return the data of one entry: its trials for replay, and its files.

        Raises
        ------
        UsageError
            There is no such entry.
        """
        folder = self.path(name)
        paths = [p for p in sorted(folder.rglob("*")) if p.is_file() and p.suffix.lower() in KINDS and _plain(p)]
        files = [p.relative_to(folder).as_posix() for p in paths]
        trials = [f for f in files if "/trials/" in f"/{f}" and f.endswith(".csv") and "-with-lead-in" not in f]
        return {
            **self._entry(folder),
            "files": files,
            "trials": [_trial(folder, file) for file in trials],
            "resume": _resume(folder),
            "way_on": _way_on(folder),
            "undo": _undo_words(folder),
        }

    def path(self, name: str, inner: str = "") -> Path:
        """Return the folder of an entry, or a file in it.

        Raises
        ------
        UsageError
            The entry or file does not exist, or is not in the folder of runs.
        """
        try:
            folder = (self.root / name).resolve()
            path = (folder / inner).resolve()
            inside = _NAME.fullmatch(name) is not None and folder.parent == self.root.resolve()
            if inside and path.is_relative_to(folder) and (path.is_file() if inner else path.is_dir()):
                return path
        except (OSError, ValueError):
            pass
        raise UsageError("this run or file does not exist. Reload the page")

    async def take_in(self, name: str, size: int | None, pieces: AsyncIterator[bytes], now: datetime) -> str:
        """Store a dropped file in its own folder and return that folder's name. *size*: the announced size, if
        known.

        Raises
        ------
        UsageError
            The file is not a supported log, is too large, or the disk is full. Nothing of the file remains.
        """
        clean = re.sub(r"[^A-Za-z0-9._-]+", "_", Path(name.replace("\\", "/")).name).lstrip("._-")[-80:]
        suffix = Path(clean).suffix.lower()
        if suffix not in DROPPED or not Path(clean).stem:
            raise UsageError(f"only logs and tables can be uploaded: {', '.join(DROPPED)}")
        if size is not None and size > MOST_BYTES:
            raise UsageError(_too_large())
        folder = self.root / f"{now:%Y%m%d-%H%M%S-%f}-{Path(clean).stem}"
        try:
            _see_spare(self.root, size or 0)
            folder.mkdir()
            await _write(folder / clean, pieces)
        except OSError as error:
            shutil.rmtree(folder, ignore_errors=True)
            raise UsageError(f"the file could not be stored: {error.strerror or error}") from error
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise
        return folder.name


def _craft(summary: Mapping[str, Any], link: str) -> str:
    """Return the craft of a run by its firmware and *link*; a simulated one by its link alone."""
    vehicle = summary.get("vehicle")
    name = vehicle.get("firmware") if isinstance(vehicle, Mapping) else vehicle
    firmware = "" if link.startswith("sitl:") else str(name or "").partition(" ")[0]
    return " on ".join(filter(None, (firmware, link)))


def _change(summary: Mapping[str, Any]) -> str:
    """Return by how much the tracking error of a tune's step changed, such as ``-92 %``; empty without such a step."""
    metrics = summary.get("metrics")
    each = [metrics.get(name) for name in ("before", "after")] if isinstance(metrics, dict) else []
    told = [one.get("itae") for one in each if isinstance(one, dict)]
    errors = [float(error) for error in told if isinstance(error, (int, float)) and error > 0.0]
    if len(errors) < 2:
        return ""
    return f"{100.0 * (errors[1] / errors[0] - 1.0):+.0f} %"


def _link(folder: Path) -> str:
    """Return the link of the vehicle of a run, from its journal or that of a step; empty without one."""
    for journal in (folder / "journal.jsonl", *sorted(folder.glob("*/journal.jsonl"))):
        with suppress(OSError, Refused, AttributeError), journal.open("rb") as lines:
            return str(parse(lines.readline()).get("link", ""))
    return ""


def loop_of(folder: Path) -> str:
    """Return the loop that can be designed from the model of the run in *folder*; empty if there is none."""
    loop = str(read_json(folder / "summary.json").get("axis", ""))
    return loop if loop in AXES and (folder / "model.json").is_file() else ""


def gains_of(designs: Path, style: str) -> Path:
    """Write the gains of *style* in the file *designs* to a parameter file beside it, and return its path.

    Raises
    ------
    UsageError
        The file contains no new gains for this style, or the disk is full.
    """
    styles = read_json(designs).get("styles")
    matching = (
        [one for one in styles if isinstance(one, dict) and one.get("style") == style]
        if isinstance(styles, list)
        else []
    )
    try:
        rows = [(str(gain["parameter"]), float(gain["old"]), float(gain["new"])) for gain in matching[0]["gains"]]
    except (LookupError, TypeError, ValueError):
        rows = []
    if all(old == new for _, old, new in rows):
        raise UsageError(f"style '{style[:20]}' has no new gains to prove. Choose another one")
    gains = {name: new for name, _, new in rows}
    file = designs.with_name(f"style-{style}.param")
    try:
        save_params(file, gains, comment=f"designed for style {style}, not flown")
    except OSError as error:
        raise UsageError(f"the gains could not be stored: {error.strerror or error}") from error
    return file


def undo_of(folder: Path) -> tuple[str, ...]:
    """Return our command line that undoes the run in *folder*; empty if there is nothing to undo.

    A run that did not restore its vehicle is restored. One that kept new gains gets its old parameters back. A
    simulated vehicle ended with its run.
    """
    link = _link(folder)
    if not link or link.startswith("sitl:"):
        return ()
    if not is_settled(folder):
        return ("restore", str(folder))
    saved = folder / "parameters_before.param"
    kept = _ending(folder) == "kept"
    steps = read_json(folder / JOB).get("steps")
    if isinstance(steps, list):  # a job that was stopped may have kept the gains of a step
        kept = any(isinstance(step, dict) and step.get("ending") == "kept" for step in steps)
    return ("params", "restore", str(saved)) if kept and saved.is_file() else ()


def _undo_words(folder: Path) -> str:
    """Return what an undo of the run in *folder* does, for its button; empty if there is nothing to undo."""
    words = undo_of(folder)
    if not words:
        return ""
    return "Restore the vehicle" if words[0] == "restore" else "Undo: restore the old parameters"


def _ending(folder: Path) -> str:
    return str(read_json(folder / "summary.json").get("ending", ""))


def _resume(folder: Path) -> dict[str, Any] | None:
    """Return the choices on the page that continue a guided run; None if nothing is left to fly.

    A simulated vehicle ended with its run, so there is nothing to continue on.
    """
    job, link = read_json(folder / JOB), _link(folder)
    steps = [step for step in job.get("steps") or () if isinstance(step, dict)]
    unfinished = [step for step in steps if step.get("ending") in ("open", "aborted", "rejected", "skipped")]
    if not unfinished or not link or link.startswith("sitl:"):
        return None
    return {
        "job": GUIDED,
        "resume": folder.name,
        "connect": visible(link),
        "style": str(job.get("style", "")),
        "dry_run": job.get("dry_run") is True,
    }


def _way_on(folder: Path) -> dict[str, str]:
    """Return the ``command`` that continues an interrupted run, with the ``text`` before it; empty if there is none."""
    resume = read_json(folder / "summary.json").get("resume")
    if not isinstance(resume, dict) or not resume.get("command"):
        return {}
    return {name: visible(str(resume.get(name, ""))) for name in ("text", "command")}


def packed(folder: Path) -> BinaryIO:
    """Return the files of a run as a zip, to be read from its beginning.

    Raises
    ------
    UsageError
        The files are too large.
    """
    files = [path for path in sorted(folder.rglob("*")) if path.is_file() and path.suffix.lower() in KINDS]
    if sum(path.stat().st_size for path in files) > MOST_BYTES:
        raise UsageError(f"the run is larger than {MOST_BYTES // (1024 * 1024)} MB. Copy its folder instead")
    whole = tempfile.TemporaryFile()  # noqa: SIM115  (the response closes it)
    with zipfile.ZipFile(whole, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in files:
            archive.write(path, f"{folder.name}/{path.relative_to(folder).as_posix()}")
    whole.seek(0)
    return whole


def _plain(path: Path) -> bool:
    """Return whether a file name is text that can be sent."""
    return str(path) == visible(str(path))


def _models(folder: Path) -> list[Path]:
    """Return the model files in a run that ``tune``, ``experiment``, ``fly`` or the desk wrote."""
    return [p for p in (*folder.glob("model*.json"), *folder.glob("diagnosis/model*.json")) if p.is_file()]


def _too_large() -> str:
    return f"the file is larger than {MOST_BYTES // (1024 * 1024)} MB. Shorten the log, or use the command line"


def _see_spare(folder: Path, size: int) -> None:
    """Check that *size* more bytes leave enough disk space for a run that may be recording."""
    if shutil.disk_usage(folder).free < size + _SPARE:
        raise UsageError("the disk is nearly full, so nothing was stored. Free some disk space")


async def _write(path: Path, pieces: AsyncIterator[bytes]) -> None:
    """Write the received data, up to the permitted size and the required free disk space."""
    count = 0
    with path.open("xb") as stream:
        async for piece in pieces:
            count += len(piece)
            if count > MOST_BYTES:
                raise UsageError(_too_large())
            await asyncio.to_thread(_append, stream, piece, path.parent)  # a slow card must not keep a STOP waiting


def _append(stream: BufferedWriter, piece: bytes, folder: Path) -> None:
    _see_spare(folder, len(piece))
    stream.write(piece)
    stream.flush()


def _trial(folder: Path, file: str) -> dict[str, Any]:
    """Return the data to replay a recorded trial: signal, actuator, and the reference over time."""
    try:
        told = conform(read((folder / file).with_suffix(".json")), _Replayed)
    except Refused:  # it is replayed without
        told = _Replayed()
    values = [(mark.t, mark.detail.get("value")) for mark in told.marks if mark.kind == "target"]
    return {
        "file": file,
        "name": visible(" ".join([*Path(file).parts[:-2], told.name or Path(file).stem])),
        "signal": visible(told.meta.signal),
        "force": visible(told.meta.force),
        "reference": told.meta.reference,
        "targets": [[t, value] for t, value in values if isinstance(value, (int, float))],
        "ending": visible(f"{told.ending}: {told.reason}".strip(": ")),
    }


class _Meta(Struct, frozen=True):
    signal: str = "psi"
    force: str = ""
    reference: float | None = None


class _Target(Struct, frozen=True):
    t: float
    kind: str
    detail: dict[str, Any] = {}


class _Replayed(Struct, frozen=True):
    """Content of a trial's metadata file that the page needs."""

    name: str = ""
    ending: str = ""
    reason: str = ""
    meta: _Meta = _Meta()
    marks: list[_Target] = []
