"""Run a study: the cases that its results folder does not contain yet, on any executor."""

from __future__ import annotations

import inspect
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, overload

from gcs_autotune.errors import AutotuneError, BadFile, LinkLost, UsageError
from gcs_autotune.executor import Executor
from gcs_autotune.kept_results import fingerprint
from gcs_autotune.plain_json import plain_data
from gcs_autotune.registry import nearest_of
from gcs_autotune.study.build import Build, build_of, difference_from
from gcs_autotune.study.craft import file_of_user, link_of
from gcs_autotune.study.jobs import JOBS, TRIES, Killed, argument_names, commands_of, function_of, results_of
from gcs_autotune.study.plan import Case, Plan
from gcs_autotune.study.store import DONE, FAILED, GIVEN_UP, Row, Store

__all__ = ["Started", "check_plan", "given_up", "other_code", "play", "run_study", "unsuited"]


@dataclass(frozen=True, slots=True)
class Started:
    """What a worker must know of a study: what is done with a case, what is kept of it, and with which code."""

    do: str
    keep: tuple[str, ...]
    home: Path
    build: Build

    @classmethod
    def of(cls, plan: Plan) -> Started:
        """Return that of *plan*, with the code of this process."""
        return cls(plan.do, plan.keep, plan.home, build_of(plan.do, plan.home))

    def key(self, case: Case) -> str:
        """Return the hash of a case's values and of the code's version."""
        return self.names(case)[0]

    def names(self, case: Case) -> tuple[str, str, int]:
        """Return key, hash of the values alone, and position of a case."""
        point = case.point(self.do)
        own = file_of_user(case.given, self.home)
        return fingerprint(point, self.build.version, self.build.function, own), point, case.index


def unsuited(started: Started) -> str:
    """Return why this process must not work on the study: other code, with both versions; empty if it may."""
    return difference_from(started.build, started.do, started.home)


def play(started: Started, case: Case, folder: Path | None = None) -> Row:
    """Do what a case is for, and return its row; a failure is a row too.

    folder : where the files of the case stay; None: they are deleted.

    Raises
    ------
    UsageError
        The study's function cannot be imported here.
    """
    if started.do not in JOBS:
        function_of(started.do, started.home)
    status, reason, tries, found = GIVEN_UP, "", 0, dict[str, Any]()
    begun = time.monotonic()
    while status == GIVEN_UP and tries < TRIES:
        begun, tries = time.monotonic(), tries + 1
        try:
            with tempfile.TemporaryDirectory(prefix="gcs-autotune-study-") as own:
                found = results_of(started.do, case.given, folder or Path(own), started.home, started.keep)
            status, reason = DONE, ""
        except Killed as error:
            reason = f"{error}, {tries} times"
        except AutotuneError as error:
            status, reason = FAILED, str(error)
        except Exception as error:  # noqa: BLE001  a crash of a case is a row, and the study goes on
            status, reason = FAILED, f"{type(error).__name__}: {error}"
    numbers = {name: float(value) for name, value in found.items() if not isinstance(value, str)}
    texts = {name: value for name, value in found.items() if isinstance(value, str)}
    spent, now = time.monotonic() - begun, time.time()
    return Row(*started.names(case), status, case.given, numbers, texts, reason, tries, spent, now)


def given_up(started: Started, case: Case, tries: int) -> Row:
    """Return the row of a case whose worker was killed *tries* times."""
    reason = f"its worker was killed {tries} times"
    return Row(*started.names(case), GIVEN_UP, case.given, {}, {}, reason, tries, 0.0, time.time())


class _Pending(Sequence[Case]):
    """The cases of a plan with these positions, computed when they are needed."""

    def __init__(self, plan: Plan, at: Sequence[int]) -> None:
        self._plan, self._at = plan, at

    def __len__(self) -> int:
        return len(self._at)

    @overload
    def __getitem__(self, index: int) -> Case: ...
    @overload
    def __getitem__(self, index: slice) -> list[Case]: ...
    def __getitem__(self, index: int | slice) -> Case | list[Case]:
        if isinstance(index, slice):
            return [self._plan[i] for i in self._at[index]]
        return self._plan[self._at[index]]


def check_plan(
    plan: Plan,
    parse: Callable[[list[str]], object] = lambda line: None,
    start: Callable[[str], object] = lambda link: None,
) -> None:
    """Check that the first case can be begun, and one case for each value that a name takes from a list.

    parse : checks a command line, without the program's name. start : starts the simulated vehicle of a link and ends
    it again.

    Raises
    ------
    BadFile
        The function cannot be imported or has other arguments, or an option, a vehicle, one of its numbers or an effect
        is unknown. The message names file and entry.
    """
    try:
        if plan.do in JOBS:
            with tempfile.TemporaryDirectory() as folder:
                for line in commands_of(plan.do, plan[0].given, Path(folder), plan.home):
                    parse(line)
        else:
            _check_arguments(plan)
    except AutotuneError as error:
        wrong = [f"{_table(plan, n)}.{n}: " for n in plan[0].given if f"--{n.partition('.')[2]}=" in str(error)]
        raise BadFile(f"{plan.file}: {''.join(wrong[:1])}{error}") from error
    for name, axis in plan.vary.items() if plan.do in JOBS else ():
        for value in (*axis.values[1:_MOST_CHECKED], *(() if axis.values else (axis.at(1.0),))):
            try:
                with tempfile.TemporaryDirectory() as folder:
                    for line in commands_of(plan.do, {**plan[0].given, name: value}, Path(folder), plan.home):
                        parse(line)
            except AutotuneError as error:
                raise BadFile(f"{plan.file}: vary.{name}: {value}: {error}") from error
    _check_craft(plan, start)


def _table(plan: Plan, name: str) -> str:
    """Return the table of the study file that contains *name*."""
    return "vary" if name in plan.vary else "fixed"


def _check_arguments(plan: Plan) -> None:
    """Check that the function of a study can be imported and takes its arguments."""
    function = function_of(plan.do, plan.home)
    try:
        known = inspect.signature(function).parameters
    except (TypeError, ValueError):  # of a function in C without a signature
        return
    if any(p.kind is inspect.Parameter.VAR_KEYWORD for p in known.values()):
        return
    given = argument_names(plan[0].given)
    for name in given:
        if name not in known:
            own = f"argument.{name}"
            place = f"{_table(plan, own)}.{own}" if own in plan[0].given else name
            raise UsageError(f"{place}: {plan.do} has no argument '{name}'.{nearest_of(name, list(known))[1]}")
    for name, parameter in known.items():
        if name not in given and parameter.default is inspect.Parameter.empty:
            raise UsageError(f"argument.{name} is missing: {plan.do} needs it. Add it under fixed or vary")


def _check_craft(plan: Plan, start: Callable[[str], object]) -> None:
    """Check that the simulated vehicle of the first case starts, and those with other texts and extreme numbers."""

    def refusal(given: Mapping[str, Any]) -> AutotuneError | None:
        try:
            with tempfile.TemporaryDirectory() as folder:
                start(link_of(given, Path(folder), plan.home))
        except AutotuneError as error:
            return error
        return None

    first = plan[0].given
    names = [name for name in first if name.partition(".")[0] in ("vehicle", "effect")]
    if not names:
        return
    if error := refusal(first):
        wrong = [n for n in names if n != "vehicle.like" and not refusal({k: v for k, v in first.items() if k != n})]
        name = wrong[0] if wrong else "vehicle.like"
        raise BadFile(f"{plan.file}: {_table(plan, name)}.{name}: {first.get(name)}: {error}") from error
    others = [
        (name, value)
        for name, axis in plan.vary.items()
        if name in names
        for value in (axis.values or (axis.at(0.0), axis.at(1.0)))
        if value != first[name] and (isinstance(value, str) or value in (axis.values[-1:] or (value,)))
    ]
    for name, value in others[:_MOST_STARTED]:
        if error := refusal({**first, name: value}):
            raise BadFile(f"{plan.file}: vary.{name}: {value}: {error}") from error


_MOST_CHECKED = 100
"""Largest number of values of one name that are checked before a study begins. Project choice."""
_MOST_STARTED = 20
"""Largest number of simulated vehicles that are started before a study begins; each takes a second. Project choice."""


def run_study(
    plan: Plan,
    folder: Path,
    executor_of: Callable[[Started], Executor],
    *,
    dashboard: str = "",
    reports: Callable[[str], None] = lambda text: None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Started:
    """Do the cases of *plan* that *folder* does not contain, and store a row for each.

    executor_of : returns the executor for the study. dashboard : link of Dask's dashboard, for `study watch`.
    reports : called with a sentence. progress : called with (cases stored, all cases).

    Raises
    ------
    BadFile
        The folder contains another study or results of other code, or the disk is full. UsageError: the function cannot
        be imported on a worker, or no worker has this code. LinkLost: the scheduler has gone away. The rows known until
        then are stored.
    """
    started = Started.of(plan)
    store = Store(folder)
    with store.writing():
        _verify_same(store, plan)
        store.begin(
            plan.file.read_text(encoding="utf-8"),
            {
                "title": plan.title,
                "home": str(plan.home),
                "cases": len(plan),
                "dashboard": dashboard,
                "build": asdict(started.build),
                "settings": plan.settings,
            },
        )
        for path in store.mend():
            reports(f"{path} is cut short or damaged. It was renamed, and its cases are repeated")
        store.merge()
        known = store.cases()
        at = [i for i in range(len(plan)) if started.key(plan[i]) not in known] if known else range(len(plan))
        before = len(plan) - len(at)
        progress(before, len(plan))
        try:
            for done, row in enumerate(executor_of(started).map(partial(play, started), _Pending(plan, at)), 1):
                store.add(row)
                progress(before + done, len(plan))
        except ConnectionError as error:
            raise LinkLost(
                f"{error}. Repeat the command with a running scheduler; the stored cases are kept"
            ) from error
        except (UsageError, RuntimeError) as error:
            raise UsageError(f"{plan.file}: {error}") from error
        store.flush()
        store.merge()
    return started


def other_code(store: Store, plan: Plan) -> str:
    """Return how the code of this process differs from that of the results in *store*; empty if it does not."""
    return difference_from(Build(**store.head["build"]), plan.do, plan.home)


def _verify_same(store: Store, plan: Plan) -> None:
    """Verify that the folder is new, or contains this study and this code."""
    if not store.has_head:
        return
    head = store.head
    old, new = head.get("settings", {}), plain_data(plan.settings)
    differing = [name for name in (*new, *old) if old.get(name) != new.get(name)]
    if differing:
        raise BadFile(
            f"{store.folder} contains results of another study: {plan.file} differs from it in {differing[0]}. "
            "Use another --out"
        )
    if why := other_code(store, plan):
        raise BadFile(
            f"{store.folder} contains results of another version. This is {why}. Use another --out, or the code of "
            "that version"
        )
