"""What a study does with a case: commands of this program, or a Python function.

A command runs as a process of its own, with the options of its command line. A case that ends this process by a signal
is repeated; see :data:`TRIES`. The process ends with the worker that started it.
"""

from __future__ import annotations

import contextlib
import fnmatch
import importlib
import json
import math
import re
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gcs_autotune.errors import AutotuneError, UsageError
from gcs_autotune.plain_json import plain_data
from gcs_autotune.study.build import importing_from
from gcs_autotune.study.command_server import CommandServer
from gcs_autotune.study.craft import link_of

__all__ = [
    "FUNCTION",
    "JOBS",
    "TRIES",
    "WORDS",
    "Job",
    "argument_names",
    "commands_of",
    "function_of",
    "results_of",
    "subjects_of",
]

TRIES = 3
"""How often a case is tried whose process, or whose worker, is killed. Project choice."""
FUNCTION = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")
"""A Python function as a text: ``module:function``."""
WORDS: Mapping[str, tuple[int, ...]] = {
    "vehicle": (1, 2, 3),
    "effect": (0, 2),
    "seed": (0,),
    "argument": (1,),
    "tune": (1,),
    "experiment": (1,),
    "fly": (1,),
    "identify": (1,),
    "diagnose": (1,),
}
"""First word of a name -> possible numbers of words that follow it."""
_CRAFT = ("vehicle", "effect", "seed")
_MOST_RESULTS = 500
"""Largest number of results stored of one case. Project choice."""
_MOST_LISTED = 8
"""Longest list that is stored, item by item. Project choice."""
_LONGEST = 200
"""Characters stored of a text that a command reports. Texts of a function are stored whole. Project choice."""
_RESTORED = 8
"""Exit code of a tune that restored the old gains: the case is done."""


@dataclass(frozen=True, slots=True)
class Job:
    """What is done with a case by commands: their names in order, and what its report shows by default.

    ``success``, ``measure``: names of results; ``truth``, ``answer``: the value and the result that are compared.
    ``timed``: results that depend on the computer and are not stored.
    """

    steps: tuple[str, ...]
    success: str = ""
    measure: str = ""
    truth: str = ""
    answer: str = ""
    timed: tuple[str, ...] = ()


JOBS: Mapping[str, Job] = {
    "tune": Job(("tune",), success="kept", measure="metrics.after.itae"),
    "experiment": Job(("experiment",), measure="residual_rms"),
    "fly": Job(("fly",)),
    "identify": Job(("fly", "identify")),
    "diagnose": Job(("fly", "diagnose"), truth="effect", answer="causes.0", timed=("seconds",)),
}
"""What a study can do with a case. To add a job, add a row, and its command to :data:`POSITIONAL`."""
POSITIONAL: Mapping[str, str] = {
    "tune": "axis",
    "experiment": "axis",
    "fly": "manoeuvre",
    "identify": "",
    "diagnose": "",
}
"""Command -> name of the value that it takes without an option; empty: the runs of the command before it."""
_OPTIONS: Mapping[str, tuple[str, ...]] = {
    "tune": ("--yes", "--quiet", "--json"),
    "experiment": ("--yes", "--quiet", "--json"),
    "fly": ("--yes", "--quiet", "--json"),
    "identify": ("--quiet", "--json", "--no-page"),
    "diagnose": ("--quiet", "--json"),
}
_UNSUITED = {"connect", "out", "seed", "json", "yes", "quiet", "verbose", "remote", "resume", "help", "page", "save"}
"""Options that the study sets itself, or that need an operator."""


def subjects_of(do: str) -> tuple[str, ...]:
    """Return the first words that names may have in a study that does *do*."""
    return (*_CRAFT, *(JOBS[do].steps if do in JOBS else ("argument",)))


def commands_of(do: str, given: Mapping[str, Any], folder: Path, home: Path) -> Iterator[list[str]]:
    """Yield the command lines of a case, without the program's name. Files of the case are below *folder*, those of
    the study below *home*.

    Raises
    ------
    UsageError
        An option is not for studies, or what to fly or tune is missing.
    """
    run = folder / "run"
    for step in JOBS[do].steps if do in JOBS else ():
        options = {name.partition(".")[2]: value for name, value in given.items() if name.startswith(f"{step}.")}
        line, positional = [step], POSITIONAL[step]
        if positional:
            if positional not in options:
                raise UsageError(f"{step}.{positional} is missing. Add it under fixed or vary")
            link = ["--connect", link_of(given, folder, home), "--seed", f"{given['seed']:.0f}", "--out", str(run)]
            line += [str(options.pop(positional)), *link]
        else:
            line.append(str(run))
        for name, value in options.items():
            if name in _UNSUITED:
                raise UsageError(f"{step}.{name}: a study sets this option itself. Remove it")
            if value is not False:
                line.append(f"--{name}" if value is True else f"--{name}={value}")
        yield [*line, *_OPTIONS[step]]


def function_of(do: str, home: Path) -> Callable[..., Mapping[str, Any]]:
    """Return the function that *do* names. Its module is searched for in *home* first.

    Raises
    ------
    UsageError
        It cannot be imported.
    """
    module, _, name = do.partition(":")
    try:
        with importing_from(str(home)):
            found: Callable[..., Mapping[str, Any]] = getattr(importlib.import_module(module), name)
    except Exception as error:
        raise UsageError(f"do: '{do}' cannot be imported: {error}") from error
    return found


class Killed(AutotuneError):
    """The process of a command was ended by a signal."""


def results_of(do: str, given: Mapping[str, Any], folder: Path, home: Path, keep: Sequence[str] = ()) -> dict[str, Any]:
    """Do what a case is for, and return its results by name: numbers, texts, true or false.

    folder : for the files of the case. home : the folder of the study file.

    Raises
    ------
    AutotuneError
        It failed; the message is that of the command.
    """
    if do not in JOBS:
        found = function_of(do, home)(**_arguments(given, folder, home))
        if not isinstance(found, Mapping):
            raise UsageError(f"{do} returned a {type(found).__name__}. A function of a study returns a dict of results")
    else:
        found = {}
        for line in commands_of(do, given, folder, home):
            found = _answer_of(line)  # that of the last command is the result
    patterns, timed = keep or ("*",), JOBS[do].timed if do in JOBS else ()
    flat = {}
    for name, value in _flat("", plain_data(found), str(folder)):
        if do in JOBS and isinstance(value, str):
            value = value[:_LONGEST]
        if name not in timed and any(fnmatch.fnmatchcase(name, pattern) for pattern in patterns):
            flat[name] = value
        if len(flat) == _MOST_RESULTS:
            break
    return flat


def argument_names(given: Mapping[str, Any]) -> list[str]:
    """Return the names of the keyword arguments of a function: its own, ``seed``, and ``uri`` if a vehicle or effect
    is given.
    """
    own = [name.partition(".")[2] for name in given if name.startswith("argument.")]
    craft = any(name.partition(".")[0] in ("vehicle", "effect") for name in given)
    return [*own, "seed", *(["uri"] if craft else [])]


def _arguments(given: Mapping[str, Any], folder: Path, home: Path) -> dict[str, Any]:
    """Return the keyword arguments of a function, as :func:`argument_names`."""
    found = {name: given.get(f"argument.{name}") for name in argument_names(given)}
    own = {"seed": int(given["seed"])}
    return {**found, **own, **({"uri": link_of(given, folder, home)} if "uri" in found else {})}


COMMANDS = CommandServer()
"""One per worker."""


def _answer_of(line: Sequence[str]) -> dict[str, Any]:
    """Run a command and return the JSON that it prints."""
    ended = COMMANDS.run(line)
    words = ended.err.decode(errors="replace").strip().splitlines()
    if ended.code < 0:
        raise Killed(f"{line[0]} was ended by signal {-ended.code}")
    if ended.code not in (0, _RESTORED):
        last = next(
            (w for w in reversed(words) if w.startswith("gcs-autotune: ")), words[-1] if words else "no message"
        )
        raise AutotuneError(f"{line[0]}, exit code {ended.code}: {last.removeprefix('gcs-autotune: ')}")
    with contextlib.suppress(ValueError):
        answer = json.loads(ended.out)
        if isinstance(answer, dict):
            return answer
    raise AutotuneError(f"{line[0]} printed no JSON: {shlex.join(line)}")


_LEFT_OUT = {"when", "schema"}
"""Results that contain the time of day or the form of the file."""


def _flat(name: str, value: Any, folder: str) -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping):
        for key, inner in value.items():
            if key not in _LEFT_OUT:
                yield from _flat(f"{name}.{key}" if name else str(key), inner, folder)
    elif isinstance(value, list):
        if len(value) <= _MOST_LISTED:
            for k, inner in enumerate(value):
                yield from _flat(f"{name}.{k}", inner, folder)
    elif isinstance(value, bool):
        yield name, value
    elif isinstance(value, int | float):
        if math.isfinite(value):
            yield name, float(value)
    elif isinstance(value, str) and folder not in value:
        yield name, value
