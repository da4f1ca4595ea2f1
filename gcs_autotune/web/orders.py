"""Convert the page's form to a command line. The fields come from the tables of axes, manoeuvres and limits.

Each value is passed as ``--name=value``, so that none can be an option itself.
"""

from __future__ import annotations

import os
import shlex
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from types import MappingProxyType
from typing import Any

from gcs_autotune.axes import AXES
from gcs_autotune.errors import UsageError
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.limits import axes_of, limit_of
from gcs_autotune.manoeuvres import DOF_OF, MANOEUVRES, ManoeuvreKind, read_area
from gcs_autotune.registry import lookup
from gcs_autotune.web.archive import GUIDED, STYLED, Archive, gains_of, undo_of

__all__ = ["RunOrder", "fields", "make_order"]

JOBS: Mapping[str, str] = {
    GUIDED: "Tune my boat or ROV: all loops",
    "tune": "Tune one loop: experiments, model, gains, test by a step",
    "experiment": "Experiment: identify a model; writes no parameter",
    "fly": "Fly a standard manoeuvre: preview, figures and model; writes no parameter",
}
"""Job that can be started -> its description in one line."""
UNDO = "undo"
"""Job that restores the parameters of before a ``run``. It is offered beside the run, not in the form."""
EVERYDAY = "Everyday settings"
"""Heading of the numbers that the page shows unfolded."""
CRAFTS: Mapping[str, str] = {"Simulated boat": "sitl:charlie", "Simulated ROV": "sitl:bluerov2"}
"""Name of a simulated craft on the page -> its link."""
_ASKED: Mapping[str, tuple[str, ...]] = {
    EVERYDAY: ("throttle", "max-distance", "max-time"),
    "Safety limits": (
        *("max-speed", "max-heading-excursion", "max-depth-excursion", "max-depth", "min-depth"),
        *("max-turn-rate", "max-roll", "max-pitch", "min-battery", "min-battery-voltage"),
    ),
    "Manoeuvre": ("speed", "relay-output", "relay-hysteresis", "relays", "patience"),
    "Proof": ("step", "step-duration", "settling-time"),
    "Model": ("full-scale",),
    "Link": ("baud", "system-id"),
}
"""Numbers on the page by heading, with their names in the table of limits."""
_ONLY: Mapping[str, tuple[str, ...]] = {
    **dict.fromkeys(_ASKED["Proof"], ("tune",)),
    **dict.fromkeys(("relay-output", "relay-hysteresis"), ("tune", "experiment")),
    "relays": (GUIDED, "tune", "experiment"),
    "full-scale": ("tune", "fly"),
}
"""Number -> the jobs that have it, if not all do."""
_BOAT, _ROV, _BEFORE_A_WALL = "sitl:charlie", "sitl:bluerov2", "sitl:videoray-wall"
"""Simulated vehicles for manoeuvres without a link."""
SIDES = ("starboard", "port")
STYLES = ("gentle", "normal", "quick")
"""Names of ``design.STYLES``, from slow to fast; importing that takes a second."""
DESIGNING = ("full-scale", "settling-time", "relay-output", "relay-hysteresis", "relays")
"""Numbers on the page that are not used if designed gains are only proved."""
_LONGEST_URI, _LONGEST_AREA = 300, 4000


@dataclass(frozen=True, slots=True)
class RunOrder:
    """A run to start: ``arguments`` of our command line, and the ``directory`` for its files.

    is_undo : whether it restores the vehicle of the run in ``directory``.
    """

    title: str
    arguments: tuple[str, ...]
    directory: Path
    is_undo: bool = False

    @property
    def is_simulated(self) -> bool:
        """Whether the run uses a simulated vehicle started for it, in simulated time."""
        return any(word.startswith("--connect=sitl:") for word in self.arguments)

    @property
    def command(self) -> str:
        """The same command as typed on a terminal."""
        return shlex.join(["gcs-autotune", *(word for word in self.arguments if word != "--remote")])


LINK_VARIABLE = "GCS_AUTOTUNE_LINK"
"""Name of the environment variable with the initial link on the page."""


def fields(preset: Mapping[str, Any] = MappingProxyType({})) -> dict[str, Any]:
    """Return the fields of the page: jobs, axes with default links, numbers with ranges, as typed.

    preset : option -> value of the settings file, which applies to a run that does not choose another. ``craft``: those
    of each craft by name.
    """
    asked = {name for names in _ASKED.values() for name in names}
    return {
        "link": os.environ.get(LINK_VARIABLE, "") or str(preset.get("connect", "")),
        "crafts": CRAFTS,
        "presets": {
            name: {
                "connect": str(own.get("connect", "")),
                "numbers": {key: f"{v:g}" for key, v in own.items() if key in asked},
            }
            for name, own in preset.get("craft", {}).items()
        },
        "everyday": EVERYDAY,
        "jobs": [{"name": name, "title": title, "example": _BOAT} for name, title in JOBS.items()],
        "axes": [{"name": name, "example": kind.example, "signal": kind.stepped} for name, kind in AXES.items()],
        "manoeuvres": [_manoeuvre(kind) for kind in MANOEUVRES.values() if kind.is_alone],
        "sides": SIDES,
        "styles": STYLES,
        "numbers": {heading: [_field(name, preset) for name in names] for heading, names in _ASKED.items()},
    }


def _manoeuvre(kind: ManoeuvreKind) -> dict[str, Any]:
    """Return the fields of a manoeuvre: its options and the forces that it can drive, each with a simulated craft."""
    return {
        "name": kind.name,
        "help": kind.help,
        "room": kind.room,
        "options": [_field(name) for name in kind.options],
        "forces": {force: _example(kind.of(force)) for force in _forces(kind)},
        "example": _example(kind),
    }


def _forces(kind: ManoeuvreKind) -> list[str]:
    forces = []
    for force in DOF_OF if kind.for_force is not None else ():
        with suppress(UsageError):
            if any(kind.of(force).drives <= set(firmware.channels) for firmware in FIRMWARE.values()):
                forces.append(force)
    return forces


def _example(kind: ManoeuvreKind) -> str:
    if kind.needs:
        return _BEFORE_A_WALL
    tilts = not kind.excites.isdisjoint(("roll", "pitch"))
    return _ROV if kind.stays or tilts or not kind.drives <= {"N", "X"} else _BOAT


def _field(name: str, preset: Mapping[str, Any] = MappingProxyType({})) -> dict[str, Any]:
    rows = axes_of(name)
    return {
        "name": name,
        "jobs": _ONLY.get(name, tuple(JOBS)),
        "by_axis": {
            row.axis: {
                "meaning": row.meaning,
                "unit": row.unit,
                "range": row.range,
                "usual": f"{preset[name]:g} (gcs-autotune.toml)"
                if name in preset
                else row.unset.replace("--", "") or ("" if row.default is None else f"{row.default:g}"),
            }
            for row in rows
        },
    }


def make_order(chosen: Mapping[str, Any], runs: Path, now: datetime) -> RunOrder:
    """Return the order for the values *chosen* on the page.

    The keys are ``job``, ``connect``, ``dry_run``, ``fetch_log``, ``numbers`` by name, ``axis`` and ``style``. To fly
    they are ``manoeuvre``, ``force``, ``first_to``, ``area``. ``craft`` is one of the settings file. ``model`` is a
    file in a folder of *runs*, used for the design or the preview. Its ``styles.json`` stands for the gains designed
    for ``style``; they are only proved. A dry run of a manoeuvre is its preview. ``resume``: name of a guided run to
    continue.

    Raises
    ------
    UsageError, UnknownName
        A value is missing or not valid; the message names the field.
    """
    job, uri = (str(chosen.get(name, "")).strip() for name in ("job", "connect"))
    if job == UNDO:
        return _undo(str(chosen.get("run", "")), runs)
    lookup(JOBS, job, "job")
    numbers, dry = chosen.get("numbers") or {}, chosen.get("dry_run") is True
    if job == "fly":
        kind, force = _chosen_manoeuvre(chosen)
        what, axis, example, words = kind.name, "", _example(kind), [f"--force={force}"] if force else []
        side = str(chosen.get("first_to") or SIDES[0])
        lookup(dict.fromkeys(SIDES, True), side, "side")
        words += [
            f"--first-to={side}",
            *_area(str(chosen.get("area", "")).strip()),
            *_numbers(numbers, job, axis, kind.options),
            *["--preview"] * dry,
        ]
    else:
        what = axis = GUIDED if job == GUIDED else str(chosen.get("axis", ""))
        example = _BOAT if job == GUIDED else lookup(AXES, axis, "axis").example
        if _proves(chosen) and isinstance(numbers, Mapping):
            numbers = {name: value for name, value in numbers.items() if name not in DESIGNING}
        words = _numbers(numbers, job, axis) + ["--dry-run"] * (dry and job != "experiment") + _style(chosen, job)
    uri = uri or example
    words += _model(chosen, job, runs)
    words += ["--fetch-log"] * (chosen.get("fetch_log") is True)
    if len(uri) > _LONGEST_URI or not uri.isprintable():
        raise UsageError("link: not a connection URI. Write e.g. udpin:0.0.0.0:14550")
    if craft := str(chosen.get("craft") or ""):
        if len(craft) > _LONGEST_URI or not craft.isprintable():
            raise UsageError("craft: not a name of gcs-autotune.toml. Choose one from the list")
        words.append(f"--craft={craft}")
    label = "".join(c if c.isalnum() else "-" for c in uri.removeprefix("sitl:").partition("?")[0]).strip("-")[:60]
    directory, earlier = _fresh(runs / f"{now:%Y%m%d-%H%M%S}-{label}-{what}"), str(chosen.get("resume") or "")
    if earlier and job == GUIDED:
        directory = Archive(runs).path(earlier)
        words.append(f"--resume={directory}")
    else:
        words.append(f"--out={directory}")
    verb = "tune" if job == GUIDED else job
    title = f"preview of {what}" if job == "fly" and dry else f"{verb} {what}"
    return RunOrder(title, (verb, what, f"--connect={uri}", *words, "--remote"), directory)


def _undo(name: str, runs: Path) -> RunOrder:
    """Return the order that restores the vehicle of the run *name*, over the link of that run."""
    archive = Archive(runs)
    folder = archive.path(name)
    words = undo_of(folder)
    if not words:
        raise UsageError("this run has nothing to undo")
    return RunOrder(f"undo of {name}", (*words, "--remote"), folder, is_undo=True)


def _style(chosen: Mapping[str, Any], job: str) -> list[str]:
    """Return the option for the chosen style of a tune."""
    style = str(chosen.get("style") or "normal")
    if not _proves(chosen):  # else it is looked up among the designs
        lookup(dict.fromkeys(STYLES, True), style, "style")
    return [f"--style={style}"] * (style != "normal" and job in (GUIDED, "tune"))


def _chosen_manoeuvre(chosen: Mapping[str, Any]) -> tuple[ManoeuvreKind, str]:
    """Return the row of the chosen manoeuvre, and the force to drive; empty for its own."""
    kind = lookup(MANOEUVRES, str(chosen.get("manoeuvre", "")), "manoeuvre")
    if not kind.is_alone:
        raise UsageError(f"{kind.name} is not flown by itself, but by {kind.command}")
    force = str(chosen.get("force") or "")
    if force and force not in _forces(kind):
        raise UsageError(f"{kind.name} cannot drive the force '{force[:10]}'")
    return kind.of(force), force


def _area(corners: str) -> list[str]:
    """Return the option for *corners* as typed on the page. No file of this computer is opened for it."""
    if not corners:
        return []
    if len(corners) > _LONGEST_AREA or not set(corners) <= set("0123456789.,;+- "):
        raise UsageError(
            "area: write 'lat,lon lat,lon lat,lon' in degrees. A file works only with fly --area in a terminal"
        )
    try:
        read_area(corners)
    except UsageError as error:
        raise UsageError(str(error).replace("--area", "area", 1)) from None
    return [f"--area={corners}"]


def _model(chosen: Mapping[str, Any], job: str, runs: Path) -> list[str]:
    """Return the option for the chosen model, ``RUN/model.json``, for a job that has it."""
    name, _, inner = str(chosen.get("model") or "").partition("/")
    has_one = job in _ONLY["full-scale"]
    if not name or not has_one:
        if str((chosen.get("numbers") or {}).get("full-scale", "")).strip() and has_one:
            raise UsageError("full-scale applies only to a model. Choose a model, or leave full-scale empty")
        return []
    if not inner.endswith(".json"):
        raise UsageError("model: not a model file of a run. Choose one from the list")
    try:
        file = Archive(runs).path(name, inner)
    except UsageError as error:
        raise UsageError(f"model: {error}") from None
    return [f"--gains={gains_of(file, str(chosen.get('style')))}"] if _proves(chosen) else [f"--model={file}"]


def _proves(chosen: Mapping[str, Any]) -> bool:
    """Return whether the run only proves gains that were designed on the page."""
    return chosen.get("job") == "tune" and str(chosen.get("model") or "").endswith(f"/{STYLED}")


def _fresh(path: Path) -> Path:
    return next(p for p in (path, *(path.with_name(f"{path.name}-{k}") for k in range(2, 1000))) if not p.exists())


def _numbers(given: Any, job: str, axis: str, options: Sequence[str] = ()) -> list[str]:
    if not isinstance(given, Mapping):
        raise UsageError("the settings are not an object of names and values")
    asked = {name for names in _ASKED.values() for name in names} | set(options)
    words = []
    for name, text in given.items():
        if name not in asked:
            raise UsageError(f"unknown setting '{str(name)[:40]}'")
        if not str(text).strip() or job not in _ONLY.get(name, JOBS):
            continue
        try:
            value = limit_of(name, axis).parse(str(text).strip())
        except KeyError:
            raise UsageError(f"{name} does not apply to the axis {axis}") from None
        except UsageError as error:
            raise UsageError(f"{name}: {error}") from None
        words.append(f"--{name}={value!r}")
    return words
