"""From what was chosen on the page to a command line of ours: one table of fields, with the limits of the table.

Each value is handed over as ``--name=value``, so that none of them can be an option itself.
"""

from __future__ import annotations

import os
import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from gcs_autotune.axes import AXES
from gcs_autotune.errors import UsageError
from gcs_autotune.limits import axes_of, limit_of
from gcs_autotune.registry import lookup

__all__ = ["RunOrder", "fields", "make_order"]

JOBS: Mapping[str, str] = {
    "tune": "Tune: swing, identify, design, prove",
    "experiment": "Experiment: swing and identify, write nothing",
}
"""What can be started -> what it does, in a line."""
_ASKED: Mapping[str, tuple[str, ...]] = {
    "Safety limits": (
        *("max-distance", "max-speed", "max-heading-excursion", "max-depth-excursion", "max-depth", "min-depth"),
        *("max-roll", "max-pitch", "min-battery", "min-battery-voltage", "max-time"),
    ),
    "Manoeuvre": ("throttle", "speed", "relay-output", "relay-hysteresis", "relays", "patience"),
    "Proof (tune)": ("step", "step-duration", "settling-time"),
    "Link": ("baud", "system-id"),
}
"""Numbers that the page asks for, by heading; the names of the table of limits."""
_TUNE_ONLY = _ASKED["Proof (tune)"]
_LONGEST_URI = 300


@dataclass(frozen=True, slots=True)
class RunOrder:
    """A run that is to be started: ``arguments`` of our command line, the ``directory`` it leaves things in."""

    title: str
    arguments: tuple[str, ...]
    directory: Path

    @property
    def is_simulated(self) -> bool:
        """Whether it flies a simulated vehicle started for it, in time of its own."""
        return any(word.startswith("--connect=sitl:") for word in self.arguments)

    @property
    def command(self) -> str:
        """The same on a terminal."""
        return shlex.join(["gcs-autotune", *(word for word in self.arguments if word != "--remote")])


LINK_VARIABLE = "GCS_AUTOTUNE_LINK"
"""Environment variable: the link that the page begins with."""


def fields() -> dict[str, Any]:
    """Return what the page asks for: jobs, axes with their usual links, and numbers with their ranges, as typed."""
    return {
        "link": os.environ.get(LINK_VARIABLE, ""),
        "jobs": [{"name": name, "title": title} for name, title in JOBS.items()],
        "axes": [{"name": name, "example": kind.example} for name, kind in AXES.items()],
        "numbers": {heading: [_field(name) for name in names] for heading, names in _ASKED.items()},
    }


def _field(name: str) -> dict[str, Any]:
    rows = axes_of(name)
    return {
        "name": name,
        "tune_only": name in _TUNE_ONLY,
        "by_axis": {
            row.axis: {
                "meaning": row.meaning,
                "unit": row.unit,
                "range": row.range,
                "usual": row.unset or ("" if row.default is None else f"{row.default:g}"),
            }
            for row in rows
        },
    }


def make_order(chosen: Mapping[str, Any], runs: Path, now: datetime) -> RunOrder:
    """Return the order for what was *chosen*: ``job``, ``axis``, ``connect``, ``dry_run``, ``numbers`` by name.

    Raises
    ------
    UsageError, UnknownName
        It cannot be had; the message names the field.
    """
    job, axis, uri = (str(chosen.get(name, "")) for name in ("job", "axis", "connect"))
    lookup(JOBS, job, "job")
    lookup(AXES, axis, "axis")
    uri = uri.strip() or AXES[axis].example
    if len(uri) > _LONGEST_URI or not uri.isprintable():
        raise UsageError("link: that is no connection string")
    label = "".join(c if c.isalnum() else "-" for c in uri.removeprefix("sitl:").partition("?")[0]).strip("-")[:60]
    directory = _fresh(runs / f"{now:%Y%m%d-%H%M%S}-{label}-{axis}")
    words = [job, axis, f"--connect={uri}", f"--out={directory}", *_numbers(chosen.get("numbers") or {}, job, axis)]
    if chosen.get("dry_run") is True and job == "tune":
        words.append("--dry-run")
    return RunOrder(f"{job} {axis}", (*words, "--remote"), directory)


def _fresh(path: Path) -> Path:
    return next(p for p in (path, *(path.with_name(f"{path.name}-{k}") for k in range(2, 1000))) if not p.exists())


def _numbers(given: Any, job: str, axis: str) -> list[str]:
    if not isinstance(given, Mapping):
        raise UsageError("the numbers are no object of name and value")
    asked = {name for names in _ASKED.values() for name in names}
    words = []
    for name, text in given.items():
        if name not in asked:
            raise UsageError(f"the page asks for no number '{str(name)[:40]}'")
        if not str(text).strip() or (job != "tune" and name in _TUNE_ONLY):
            continue
        try:
            value = limit_of(name, axis).parse(str(text).strip())
        except KeyError:
            raise UsageError(f"{name}: the axis {axis} has no such number") from None
        except UsageError as error:
            raise UsageError(f"{name}: {error}") from None
        words.append(f"--{name}={value!r}")
    return words
