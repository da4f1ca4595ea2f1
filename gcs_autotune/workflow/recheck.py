"""``recheck``: test whether the gains of an earlier tune are still good.

Two relays on the set-point are flown. Unless they show that the loop is poorly damped, the step of the last tune of the
same vehicle is flown after them, and the two steps are compared. Without such a tune a step is flown only if the relays
give no clear verdict.
"""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from gcs_autotune.axes import AxisKind
from gcs_autotune.design import StepMetrics
from gcs_autotune.documents import SETTING_OUT
from gcs_autotune.errors import AutotuneError, NotInformative
from gcs_autotune.link import MavlinkCraft, difference, same_float32
from gcs_autotune.manoeuvres import common_windows
from gcs_autotune.observer import Observer
from gcs_autotune.plain_json import json_text
from gcs_autotune.report import LoopCheck, LoopNumbers, recheck_document, save_page, sentence, simulated_with, to_json
from gcs_autotune.seatrials import LARGE_OVERSHOOT, POORLY_DAMPED, WELL_DAMPED, Sheet, ship_figures
from gcs_autotune.sname import SIGNALS
from gcs_autotune.trial import Trial, load_meta, load_trial
from gcs_autotune.workflow.connection import axis_of
from gcs_autotune.workflow.experiments import measure, noise_in, resolution
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
BAD, UNCLEAR = ("oscillates", "poorly damped"), ("undecided", "not identifiable")
"""Verdicts on the relays after which no step is flown, and those after which one is flown even without an earlier tune.
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
    ``step``: the record of this step; None without one.
    """

    directory: Path
    when: str
    numbers: LoopNumbers
    gains: Mapping[str, float]
    step: Path | None = None

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
            step = max(summary.parent.glob("trials/*-step-after.csv"), default=None)  # the last of a resumed tune
            tune = LastTune(summary.parent, str(told["when"]), numbers, gains, step)
            found.append((tune.when, about, tune))
        except (OSError, ValueError, KeyError, TypeError, AttributeError, IndexError):
            continue
    for _, about, tune in sorted(found, key=lambda row: row[0], reverse=True):
        if is_same(about):
            return tune
    return None


class Recheck:
    """The rule for a second flight: a step, unless the relays show that the loop is poorly damped.

    Relays alone do not show slow errors: with gains whose ITAE was eight times that of the tune, they showed a loop as
    well damped as after it.

    ``tune``: the last tune of the vehicle.
    ``present``: the gains of the loop on the vehicle.
    ``changed``: names of the gains changed since the tune.
    ``shown``: the flight from which the loop is evaluated.
    ``sheet``: figures computed from the relays.
    ``why``: reason why there are none.
    ``stepped``: whether a step was flown.
    ``step``, ``step_then``: metrics of this step and of that of the tune over the same time; None if one cannot be
    evaluated.
    """

    def __init__(self, axis: AxisKind, runs: Path, observer: Observer) -> None:
        self._axis, self._runs, self._observer = axis, runs, observer
        self.tune: LastTune | None = None
        self._options: Mapping[str, float] = {}
        self.present: Mapping[str, float] = {}
        self.changed: tuple[str, ...] = ()
        self.sheet: Sheet | None = None
        self.stepped = False
        self.step: StepMetrics | None = None
        self.step_then: StepMetrics | None = None
        self.why = ""
        self.shown: Trial | None = None

    def meet(self, craft: MavlinkCraft) -> None:
        """Find the last tune of this vehicle, and determine whether its gains are still set."""
        here = craft.session.vehicle
        assert here is not None

        def is_same(about: Mapping[str, Any]) -> bool:
            return not difference(about["vehicle"], about["fingerprint"], here, craft.parameters)

        self.tune = last_tune(self._runs, self._axis.name, is_same)
        self._options = _options_of(self.tune)
        own = [gain.parameter for gain in axis_of(craft.firmware, self._axis.name).gains]
        self.present = craft.parameters.read_existing(own if self.tune is None else list(self.tune.gains))
        if self.tune is None:
            self._observer.say(f"no earlier {self._axis.name} tune of this vehicle in {self._runs}/ to compare with")
            return
        self.changed = self.tune.changed(self.present)
        others = f". Changed since: {', '.join(self.changed)}" if self.changed else ". Its gains are unchanged"
        self._observer.say(f"the last {self._axis.name} tune is {self.tune.directory}{others}")

    def further(self, run: FlySettings) -> tuple[FlySettings, str, str]:
        """Return the step that may follow the relays of *run*, with its announcement.

        It is the step of the last tune, so that the two can be compared.
        """
        options = self._options
        step = replace(run, manoeuvre="step", options=options, name="step", follows=True)
        size = options.get("step", self._axis.step)
        unit = "deg" if self._axis.angular else SIGNALS[self._axis.stepped][0]
        shown = f" of {math.degrees(size) if self._axis.angular else size:.3g} {unit}" if math.isfinite(size) else ""
        if options:
            words = (
                f"fly a step{shown} and back, as in the tune, unless these relays show that the loop is poorly damped"
            )
            return step, words, f"a step{shown} and back, as in the tune"
        words = f"fly a step{shown} and back, if these relays give no clear verdict"
        return step, words, f"a step{shown} and back if the relays decide nothing"

    def again_with_its_gains(self, link: str) -> str:
        """Return the command that rechecks the tuned gains on a simulated vehicle, which starts with its original ones;
        empty on a real vehicle, or if no gain differs.
        """
        if not self.changed or self.tune is None or not link.startswith("sitl:"):
            return ""
        tuned = simulated_with(link, {name: self.tune.gains[name] for name in self.changed})
        return f"gcs-autotune recheck {self._axis.name} --connect {shlex.quote(tuned)}"

    def another(self, run: FlySettings, trial: Trial, think: Callable[..., Any]) -> FlySettings | None:
        """Return the step, or None if the relays were sufficient or the step was flown.

        *think* runs a computation while the link is served.
        """
        if run.manoeuvre == "step":
            self.stepped, (self.step, self.step_then) = True, think(partial(read_steps, trial, self.tune))
            self.shown = self.shown if self.step is None else trial
            return None
        self.sheet, self.why = think(partial(read_loop, trial))
        self.shown = trial
        kind = verdict_of(self._axis.name, self).kind
        if kind == "not identifiable":
            self._observer.say("the relays do not determine the damping of the loop")
        is_enough = kind in BAD if self._options else kind not in UNCLEAR
        return None if is_enough else self.further(run)[0]


def read_loop(trial: Trial) -> tuple[Sheet | None, str]:
    """Return (figures of the loop computed from a flight, reason why there are none)."""
    try:
        (sheet,) = ship_figures(trial)
    except NotInformative as error:
        return None, trial.reason if trial.reason.startswith("not settled") else str(error)
    return sheet, ""


def read_steps(trial: Trial, tune: LastTune | None) -> tuple[StepMetrics | None, StepMetrics | None]:
    """Return the metrics of a flown step, and of the step of the last *tune* over the same time.

    Both are measured as in a tune. None: there is no such step, or its record is too short.
    """
    if tune is not None and tune.step is not None:
        with suppress(AutotuneError, OSError, KeyError):
            then = load_trial(tune.step)
            windows = common_windows(trial, then)
            return _measured(trial, windows), _measured(then, windows)
    return _measured(trial), None


def _measured(step: Trial, windows: Sequence[float] = ()) -> StepMetrics | None:
    signal = str(step.meta["signal"])
    try:
        metrics = measure(step, noise_in(step, signal), resolution(step), windows)
    except NotInformative:
        return None
    return metrics if math.isfinite(metrics.overshoot) else None


def _options_of(tune: LastTune | None) -> dict[str, float]:
    """Return size and duration of the step that a *tune* flew with its new gains, as options; empty if unknown."""
    if tune is None or tune.step is None:
        return {}
    try:
        meta = load_meta(tune.step)
        return {"step": abs(float(meta["size"])), "step-duration": float(meta["duration"])}
    except (AutotuneError, OSError, ValueError, KeyError, TypeError):
        return {}


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
    if check.changed:
        note = (f"Gains changed since the tune: {', '.join(check.changed)}.",)
    if check.step is not None:
        is_known = sheet is not None and _is_informative(sheet)
        if not is_known:
            note = ("The relays did not determine the damping. The figures are those of a flown step.", *note)
        damping = of("damping") if is_known else math.nan
        return _of_step(check.step, check.step_then, damping, partial(verdict, notes=note), axis)
    if sheet is not None and "oscillation" in told:
        return verdict("oscillates", f"{sheet.verdict[0].upper()}{sheet.verdict[1:]}.", "bad", note)
    if sheet is None or not _is_informative(sheet):
        why = check.why or next(
            (d.cause for d in (sheet.doubts if sheet is not None else ())), "its damping is unclear"
        )
        text = f"Not identifiable: these relays do not determine the damping of the {axis} loop. {sentence(why)}"
        cure = f"Check the plot, fly in calmer water or with other sizes (--set-point), or run {again}."
        if check.stepped:
            note = (*note, "A flown step could not be evaluated either.")
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


def _of_step(
    step: StepMetrics, at_tune: StepMetrics | None, damping: float, verdict: Callable[..., LoopCheck], axis: str
) -> LoopCheck:
    """Return the verdict on the loop of *axis* from a flown *step*, from that of the last tune and the *damping* ratio
    that the relays show.
    """
    now = LoopNumbers(step.overshoot, step.rise, step.settling, damping, itae=step.itae, span=step.span)
    verdict = partial(verdict, now=now)
    shown = f"overshoots a step by {100.0 * step.overshoot:.0f} %"
    settles = math.isfinite(step.settling) or step.hidden_by_noise
    if at_tune is not None:
        then = LoopNumbers(at_tune.overshoot, at_tune.rise, at_tune.settling, itae=at_tune.itae, span=at_tune.span)
        verdict = partial(verdict, then=then)
        worse = _worse(now, 0.0, then)
        if not worse and now.itae > SLOWER * then.itae:
            worse = f"the tracking error of a step is {now.itae / then.itae:.1f} times that after the tune"
        if worse:
            return verdict("degraded", f"Degraded since the tune: {worse}. Run gcs-autotune tune {axis}.", "bad")
    if step.overshoot > LARGE_OVERSHOOT:
        text = f"Large overshoot: the {axis} loop {shown}. Run gcs-autotune tune {axis}."
        return verdict("poorly damped", text, "bad")
    if at_tune is not None:
        return verdict("good", f"Good: the {axis} loop is not clearly worse than after its tune.", "good")
    if not settles:
        text = f"Undecided: the {axis} loop {shown}, and does not settle to within 5 % in {step.span:.0f} s."
        return verdict("undecided", text, "neutral")
    text = f"Good: the {axis} loop {shown}. There is no earlier step of a tune to compare with."
    return verdict("good", text, "good")


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
    doubts = () if check.sheet is None or check.step is not None else tuple(check.sheet.doubts)
    again = check.again_with_its_gains(common.connection.uri)
    found = replace(
        found, again=again, doubts=doubts, remarks=tuple(r for r in result.remarks if "no figures" not in r)
    )
    title = f"Recheck of {axis.name}: {common.connection.uri.partition('?')[0]}"
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
