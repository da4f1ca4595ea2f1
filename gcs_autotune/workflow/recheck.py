"""``recheck``: test whether the gains of an earlier tune are still good.

Two relays on the set-point are flown. If the loop cannot be identified from them, they are flown again at another size.
The result is compared with that of the last tune of the same vehicle.
"""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from gcs_autotune.axes import AxisKind
from gcs_autotune.documents import SETTING_OUT
from gcs_autotune.errors import AutotuneError, NotInformative
from gcs_autotune.link import MavlinkCraft, difference, same_float32
from gcs_autotune.observer import Observer
from gcs_autotune.plain_json import json_text
from gcs_autotune.report import LoopCheck, LoopNumbers, recheck_document, save_page, sentence, simulated_with, to_json
from gcs_autotune.seatrials import LARGE_OVERSHOOT, POORLY_DAMPED, WELL_DAMPED, Sheet, ship_figures
from gcs_autotune.trial import Trial
from gcs_autotune.workflow.connection import axis_of
from gcs_autotune.workflow.flight_plan import FlightPlan, FlySettings
from gcs_autotune.workflow.fly import fly_plan
from gcs_autotune.workflow.operator import Operator
from gcs_autotune.workflow.record import SUMMARY
from gcs_autotune_files import read

__all__ = ["LastTune", "Recheck", "last_tune", "recheck", "verdict_of"]

AFTER = "parameters_after.json"
"""Name of the file with the vehicle's parameters at the end of a tune."""
BEFORE = "parameters_before.json"
"""Name of the file with the parameters that a run found."""
SMALLER, LARGER = 0.5, 2.0
"""Size of the second flight relative to the first: the smaller, and the larger if a dead band or noise masked the
response.
"""
MORE = 0.1
"""Increase of the overshoot since the tune, above which the loop counts as degraded. Project choice."""
SLOWER = 1.5
"""Ratio of rise or settling time to that of the tune, above which the loop counts as slower. Project choice."""


@dataclass(frozen=True, slots=True)
class LastTune:
    """The last tune of the vehicle stored on disk.

    ``directory``, ``when``: its run directory and time.
    ``gains``: the gains that it kept.
    ``numbers``: metrics of the step flown with these gains.
    """

    directory: Path
    when: str
    numbers: LoopNumbers
    gains: Mapping[str, float]

    def changed(self, present: Mapping[str, float]) -> tuple[str, ...]:
        """Return the names of the gains whose values in *present* differ from those of the tune."""
        return tuple(n for n, v in self.gains.items() if n in present and not same_float32(v, present[n]))


STEP_NUMBERS = ("overshoot", "rise", "settling")
"""Metrics that a tune and a recheck have in common."""


def last_tune(runs: Path, axis: str, is_same: Callable[[Mapping[str, Any]], bool]) -> LastTune | None:
    """Return the last tune of *axis* below *runs* that kept its gains; None if there is none.

    *is_same* returns, from the content of SETTING_OUT, whether a tune is of this vehicle. Folders with other content
    are skipped.
    """
    found = []
    for summary in (*runs.glob(f"*/{SUMMARY}"), *runs.glob(f"*/*/{SUMMARY}")):  # a step of `tune all` lies in its job
        try:
            told = read(summary)
            if told.get("axis") != axis or not told.get("kept"):
                continue
            about = read(summary.parent / SETTING_OUT)
            after = told["metrics"]["after"] or {}
            numbers = LoopNumbers(
                **{n: float(after[n]) if after.get(n) is not None else math.nan for n in STEP_NUMBERS}
            )
            held = read(summary.parent / AFTER)
            gains = {str(name): float(value) for name, value in held.items()}
            found.append((str(told["when"]), about, LastTune(summary.parent, str(told["when"]), numbers, gains)))
        except (OSError, ValueError, KeyError, TypeError, AttributeError, IndexError):
            continue
    for _, about, tune in sorted(found, key=lambda row: row[0], reverse=True):
        if is_same(about):
            return tune
    return None


class Recheck:
    """The rule for a second flight: evaluate the loop from the first, and fly again with other sizes if necessary.

    ``tune``: the last tune of the vehicle.
    ``present``: the gains of the loop on the vehicle.
    ``changed``: names of the gains changed since the tune.
    ``factor``: size of the second flight relative to the first; 0: none.
    ``shown``: the flight from which the loop is evaluated.
    ``sheet``: figures computed from ``shown``.
    ``why``: reason why there are no figures.
    """

    words = "fly again at half or twice the size, if these relays do not determine the damping of the loop"

    def __init__(self, axis: AxisKind, runs: Path, observer: Observer) -> None:
        self._axis, self._runs, self._observer = axis, runs, observer
        self.tune: LastTune | None = None
        self.present: Mapping[str, float] = {}
        self.changed: tuple[str, ...] = ()
        self.sheet: Sheet | None = None
        self.factor = 0.0
        self.why = ""
        self.shown: Trial | None = None

    def meet(self, craft: MavlinkCraft) -> None:
        """Find the last tune of this vehicle, and determine whether its gains are still set."""
        here = craft.session.vehicle
        assert here is not None

        def is_same(about: Mapping[str, Any]) -> bool:
            return not difference(about["vehicle"], about["fingerprint"], here, craft.parameters)

        self.tune = last_tune(self._runs, self._axis.name, is_same)
        own = [gain.parameter for gain in axis_of(craft.firmware, self._axis.name).gains]
        self.present = craft.parameters.read_existing(own if self.tune is None else list(self.tune.gains))
        if self.tune is None:
            self._observer.say(f"no earlier {self._axis.name} tune of this vehicle in {self._runs}/ to compare with")
            return
        self.changed = self.tune.changed(self.present)
        others = f". Changed since: {', '.join(self.changed)}" if self.changed else ". Its gains are unchanged"
        self._observer.say(f"the last {self._axis.name} tune is {self.tune.directory}{others}")

    def again_with_its_gains(self, link: str) -> str:
        """Return the command that rechecks the tuned gains on a simulated vehicle, which starts with its original ones;
        empty on a real vehicle, or if no gain differs.
        """
        if not self.changed or self.tune is None or not link.startswith("sitl:"):
            return ""
        tuned = simulated_with(link, {name: self.tune.gains[name] for name in self.changed})
        return f"gcs-autotune recheck {self._axis.name} --connect {shlex.quote(tuned)}"

    def another(self, run: FlySettings, trial: Trial, think: Callable[..., Any]) -> FlySettings | None:
        """Return the second run, or None if the first one was sufficient.

        *think* runs a computation while the link is served.
        """
        sheet, why = think(partial(read_loop, trial))
        if not self.factor or (
            sheet is not None and _is_informative(sheet)
        ):  # otherwise the first one is more informative
            self.sheet, self.why, self.shown = sheet, why, trial
        if self.factor or (sheet is not None and _is_informative(sheet)):
            return None
        small = sheet is not None and any("larger" in doubt.cure for doubt in sheet.doubts)
        factor = LARGER if small else SMALLER
        usual = run.make(0.0, speed=1.0).meta_fields
        sizes = zip(("set-point", "second-set-point"), usual["set_points"], strict=True)
        passed = zip(("hysteresis", "second-hysteresis"), usual["hystereses"], strict=True)
        options = {name: factor * float(value) for name, value in (*sizes, *passed)}
        try:
            other = replace(run, options={**run.options, **options}, name=f"{run.name}-again")
        except AutotuneError:  # below what the sensors show, or beyond what the loop may be asked
            return None
        self.factor = factor
        half = "half of" if factor < 1.0 else "twice"
        self._observer.say(f"the relays do not determine the damping of the loop: flying again at {half} their size")
        return other


def read_loop(trial: Trial) -> tuple[Sheet | None, str]:
    """Return (figures of the loop computed from a flight, reason why there are none)."""
    try:
        (sheet,) = ship_figures(trial)
    except NotInformative as error:
        return None, trial.reason if trial.reason.startswith("not settled") else str(error)
    return sheet, ""


def _is_informative(sheet: Sheet) -> bool:
    """Return whether the loop can be judged, that is, whether its damping is known."""
    numbers = {f.slug: f.reading for f in sheet.figures}
    if "oscillation" in numbers:
        return True
    limited = any(d.slug in ("saturated", "not-linear") for d in sheet.doubts)
    if limited or "damping" not in numbers or "overshoot" not in numbers:
        return False
    zeta, zeta_std = numbers["damping"].value, numbers["damping"].std
    damped = zeta - zeta_std > WELL_DAMPED or zeta + zeta_std < POORLY_DAMPED
    return damped or zeta_std < 0.5 * (WELL_DAMPED - POORLY_DAMPED)


def verdict_of(axis: str, check: Recheck) -> LoopCheck:
    """Return the verdict on a loop, with its numbers now and at the last tune."""
    sheet, tune = check.sheet, check.tune
    then = None if tune is None else tune.numbers
    again = f"gcs-autotune tune {axis}"
    told = {} if sheet is None else {f.slug: f.reading for f in sheet.figures}

    def of(slug: str) -> float:
        return float(told[slug].value) if slug in told else math.nan

    slugs = ("overshoot", "rise", "settling", "damping", "oscillation", "period")
    std = told["overshoot"].std if "overshoot" in told else math.nan
    now = LoopNumbers(overshoot_std=std, **{slug: of(slug) for slug in slugs})
    verdict = partial(LoopCheck, axis, now=now, then=then, when="" if tune is None else tune.when)
    note: tuple[str, ...] = ()
    if check.factor:
        size = "half" if check.factor < 1.0 else "twice"
        note = (f"The first relays gave no clear result, so they were flown again at {size} the size.",)
    if check.changed:
        note = (*note, f"Gains changed since the tune: {', '.join(check.changed)}.")
    if sheet is not None and "oscillation" in told:
        return verdict("oscillates", f"{sheet.verdict[0].upper()}{sheet.verdict[1:]}.", "bad", note)
    if sheet is None or not _is_informative(sheet):
        why = check.why or next(
            (d.cause for d in (sheet.doubts if sheet is not None else ())), "its damping is unclear"
        )
        text = f"Not identifiable: these relays do not determine the damping of the {axis} loop. {sentence(why)}"
        cure = f"Check the plot, fly in calmer water or with other sizes (--set-point), or run {again}."
        return verdict("not identifiable", text, "neutral", (*note, cure), now=LoopNumbers())
    zeta, zeta_std = told["damping"].value, told["damping"].std
    over, over_std = told["overshoot"].value, told["overshoot"].std
    worse = _worse(now, over_std, then)
    if worse:
        return verdict("degraded", f"Degraded since the tune: {worse}. Run {again}.", "bad", note)
    if zeta + zeta_std < POORLY_DAMPED or over - over_std > LARGE_OVERSHOOT:
        what = "Poorly damped" if zeta + zeta_std < POORLY_DAMPED else "Large overshoot"
        text = f"{what}: the {axis} loop overshoots a step by {100.0 * over:.0f} %. Run {again}."
        return verdict("poorly damped", text, "bad", note)
    if over + over_std > LARGE_OVERSHOOT:
        shown = f"{100.0 * over:.0f} +- {100.0 * over_std:.0f} %"
        text = f"Undecided: a step overshoots by {shown}. The limit is {100.0 * LARGE_OVERSHOOT:.0f} %."
        return verdict("undecided", text, "neutral", note)
    if zeta < POORLY_DAMPED:
        text = f"Undecided: the damping ratio is {zeta:.2f} +- {zeta_std:.2f}. The minimum is {POORLY_DAMPED}."
        return verdict("undecided", text, "neutral", note)
    if then is None:
        well = " well" if zeta - zeta_std > WELL_DAMPED else " sufficiently"
        text = f"Good: the {axis} loop is{well} damped. There is no earlier tune to compare with."
        return verdict("good", text, "good", note)
    return verdict("good", f"Good: the {axis} loop is not clearly worse than after its tune.", "good", note)


def _worse(now: LoopNumbers, std: float, then: LoopNumbers | None) -> str:
    """Return a sentence on what is worse than at the tune; empty if nothing is."""
    if then is None:
        return ""
    if now.overshoot - std > max(then.overshoot, 0.0) + MORE:
        return f"a step overshoots by {100.0 * now.overshoot:.0f} % (after the tune: {100.0 * then.overshoot:.0f} %)"
    if now.settling > SLOWER * then.settling and now.rise > SLOWER * then.rise:
        return f"a step settles in {now.settling:.1f} s (after the tune: {then.settling:.1f} s)"
    return ""


def recheck(
    plan: FlightPlan, axis: AxisKind, operator: Operator, observer: Observer, when: str, runs: Path
) -> LoopCheck:
    """Fly the one run of *plan*, evaluate the loop of *axis*, and return the verdict. Write ``report.html`` and
    ``recheck.json``.

    *runs*: the folder with earlier tunes. Errors are those of :func:`gcs_autotune.workflow.fly.fly_plan`.
    """
    common, check = plan.runs[0].common, Recheck(axis, runs, observer)
    plan = replace(plan, title=f"recheck {axis.name}", again=check)
    result = fly_plan(plan, common, operator, observer, when)
    shown = check.shown if check.shown is not None else next(run.trial for run in result.runs if run.trial is not None)
    found = verdict_of(axis.name, check)
    directory = common.directory
    doubts = () if check.sheet is None else tuple(check.sheet.doubts)
    again = check.again_with_its_gains(common.connection.uri)
    found = replace(
        found, again=again, doubts=doubts, remarks=tuple(r for r in result.remarks if "no figures" not in r)
    )
    title = f"Recheck of {axis.name}: {common.connection.uri}"
    document = recheck_document(found, title, when, shown)
    (directory / "recheck.json").write_text(json_text(to_json(document)), encoding="utf-8")
    numbers = {name: getattr(found.now, name) for name in STEP_NUMBERS}
    summary = {
        "title": f"recheck {axis.name}",
        "when": when,
        "ending": found.kind,
        "reason": found.text,
        "axis": axis.name,
        "gains": {name: [value, value] for name, value in check.present.items()},
        "metrics": {"before": numbers, "after": None},
    }
    (directory / BEFORE).write_text(json_text(dict(check.present)), encoding="utf-8")
    (directory / SUMMARY).write_text(json_text(summary), encoding="utf-8")
    save_page(directory, document)
    return found
