"""Every tune in its order, with gains of whatever kind: propose, ask, apply, prove, keep or restore."""

from __future__ import annotations

import ast
import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from gcs_autotune.axes import AXES
from gcs_autotune.design import Change, StepMetrics, Verdict, is_followed
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.link import Journal
from gcs_autotune.manoeuvres import Envelope
from gcs_autotune.trial import Mark, Trial
from gcs_autotune.workflow import Unattended
from gcs_autotune.workflow import autopilot_loop as autopilot_loop_module
from gcs_autotune.workflow.accompanying_step import Compared
from gcs_autotune.workflow.autopilot_loop import _AutopilotLoop, _offer_of
from gcs_autotune.workflow.itinerary import Itinerary, Leg
from gcs_autotune.workflow.mission import Mission, Visit, run_mission, visiting
from gcs_autotune.workflow.record import RunDirectory
from gcs_autotune.workflow.runner import ManoeuvreRunner
from gcs_autotune.workflow.tunable_loop import GainLoan, Offer, ProofResult, TunableLoop, tune_loop
from gcs_autotune.workflow.tune_log import TuneLog

from .sitl_harness import QUICK, WHEN, Ear, SitlHarness


def step(itae: float) -> StepMetrics:
    return StepMetrics(itae, overshoot=0.0, rise=1.0, settling=2.0, steady_error=0.0, travel=0.1)


@pytest.mark.parametrize(
    ("promised", "predicted_now", "flown_now", "is_refused"),
    [
        (0.5, 1.0, 1.0, False),
        (2.0, 1.0, 1.0, True),
        (1.0, 1.0, 1.0, True),
        (1.5, 1.0, 2.0, False),
        (1.5, 2.0, 1.0, False),
    ],
    ids=["better than both", "worse than both", "the same", "better than flown", "better than predicted"],
)
def test_gains_are_refused_only_when_predicted_worse_than_both_prediction_and_flight(
    promised: float, predicted_now: float, flown_now: float, is_refused: bool
) -> None:
    offer = _offer_of(proposed(promised, [CHANGE], predicted_now), step(flown_now), 1.0)
    assert bool(offer.refusal) is is_refused


@pytest.mark.parametrize(
    ("predicted_now", "flown_now", "is_doubtful"),
    [(1.0, 1.25, False), (1.0, 0.8, False), (0.307, 0.105, True), (1.0, 1.6, True), (0.001, 0.009, False)],
)
def test_a_prediction_is_doubtful_if_the_step_with_the_present_gains_was_predicted_badly(
    predicted_now: float, flown_now: float, is_doubtful: bool
) -> None:
    offer = _offer_of(proposed(0.0005, [CHANGE], predicted_now), step(flown_now), 1.0)
    said = f"the model predicts {predicted_now:.3g} s^2 for the step with the present gains, and {flown_now:.3g} s^2"
    assert (said in offer.promise) is is_doubtful


def test_a_refusal_states_the_predictions_and_what_limits_the_margins() -> None:
    proposal = proposed(2.0, [CHANGE])
    proposal.limit = "SCHED_LOOP_RATE is 100 Hz"
    assert _offer_of(proposal, step(1.0), 1.0).refusal.endswith("(ITAE 2 instead of 1 s^2). SCHED_LOOP_RATE is 100 Hz")


class Loan:
    """As much of a parameter transaction as a proof needs; what was done to it, in order."""

    def __init__(self, *_: object) -> None:
        self.kept = False
        done.append("lent")

    def __enter__(self) -> Loan:
        return self

    def __exit__(self, *error: object) -> None:
        done.append("left" if self.kept else "given back")

    def set(self, values: dict[str, float]) -> None:
        done.append(f"set {values}")

    def keep(self) -> None:
        self.kept = True
        done.append("kept")


done: list[str] = []
CHANGE = Change("P", 1.0, 2.0, 0.0, 9.0, "better")


@pytest.fixture
def context(monkeypatch: pytest.MonkeyPatch) -> Any:
    """A craft whose step after has the cost ``context.flies``; the operator's answer is ``context.answer``."""
    done.clear()
    said: list[str] = []
    log = SimpleNamespace(
        say=said.append,
        note=lambda fact: None,
        said=said,
        end=lambda ending, why: done.append(ending),
        given_changes=[CHANGE],
        proposal=None,
        metrics_before=step(1.0),
        metrics_after=None,
        verdict=None,
        beside=None,
    )
    context = SimpleNamespace(
        log=log,
        settings=SimpleNamespace(dry_run=False, style="normal"),
        agrees=lambda question: done.append(question) or context.answer,
        answer=True,
        flies=0.5,
        run_in_background=lambda work, *args: work(*args),
        craft=SimpleNamespace(parameters=None, firmware=FIRMWARE["ardusub"]),
        axis=FIRMWARE["ardusub"].axes["depth"],
        law=SimpleNamespace(free_overshoot=0.0, controls_velocity=False),
        runner=SimpleNamespace(come_to_rest=lambda stage, axis: done.append(f"rest in {stage}")),
        turn_around=lambda name, ahead, last: done.append(f"back for {name}"),
        fly=lambda manoeuvre, stage: done.append(stage) or recorded(context.flies, 8.0, 7.0),
    )
    monkeypatch.setattr(autopilot_loop_module, "ParameterTransaction", Loan)
    read.clear()
    return context


def recorded(itae: float, *lasted: float) -> Trial:
    """A flown step, its halves of so many seconds, that will be read as *itae*."""
    marks = [Mark(t, "target") for t in (0.0, 3.0, 33.0)]
    return Trial("step", {}, marks, meta={"duration": 30.0, "lasted": list(lasted), "itae": itae})


read: list[Sequence[float]] = []
BEFORE = recorded(1.0, 30.0, 6.0)


def ruler(trial: Trial, windows: Sequence[float]) -> StepMetrics:
    read.append(windows)
    return step(trial.meta["itae"])


@pytest.mark.parametrize(("firmware", "axis", "seen"), [("ardusub", "depth", ["z Z"]), ("ardurover", "heading", [])])
def test_a_craft_is_monitored_on_its_axis_while_it_comes_to_rest_and_a_boat_is_not(
    firmware: str, axis: str, seen: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    flown: list[str] = []
    craft: Any = SimpleNamespace(firmware=FIRMWARE[firmware], armed=False)
    observer: Any = SimpleNamespace(say=print)
    runner = ManoeuvreRunner(craft, Envelope(), observer, print)

    def attempt(manoeuvre: Any, stage: str) -> Trial:
        flown.append(f"{manoeuvre.signal} {manoeuvre.force}")
        return Trial("come-to-rest", {})

    monkeypatch.setattr(runner, "attempt", attempt)
    runner.come_to_rest("proving", AXES[axis])
    assert flown == seen


PROOF = SimpleNamespace(step=lambda name: name, settings=SimpleNamespace(duration=30.0))
CRITERIA: Any = SimpleNamespace(proof=PROOF, read=ruler, halves=lambda trial, windows: [])


class Flown(_AutopilotLoop):
    """A loop of the autopilot whose step before has been flown, with an offer that is there already."""

    def __init__(self, context: Any, offer: Offer) -> None:
        super().__init__(context)
        self._before, self._criteria, self.offer = BEFORE, CRITERIA, offer

    def experiment(self) -> None:
        pass

    def propose(self) -> Offer:
        return self.offer


def tuned(context: Any, offer: Offer) -> list[str]:
    loop: TunableLoop = Flown(context, offer)
    tune_loop(loop, context.log, context.agrees, cast(Journal, None), dry_run=context.settings.dry_run)
    return done


def supplied(context: Any) -> list[str]:
    return tuned(context, Offer([CHANGE]))


def test_both_steps_are_measured_over_the_time_both_recorded(context: Any) -> None:
    supplied(context)
    assert read == [(8.0, 6.0), (8.0, 6.0)]
    assert (
        "both flights are compared over the first 8 s of the step and the first 6 s of the step back: the shorter "
        "flight ends there" in context.log.said
    )


def test_supplied_gains_are_written_only_on_approval_and_never_in_a_dry_run(context: Any) -> None:
    context.settings.dry_run = True
    assert supplied(context) == ["dry-run"]
    done.clear()
    context.settings.dry_run, context.answer = False, False
    assert supplied(context) == ["Write P 1 -> 2 and test it by the same manoeuvre?", "declined"]


@pytest.mark.parametrize(("flies", "ending"), [(0.5, ["kept", "kept", "left"]), (1.2, ["given back", "restored"])])
def test_supplied_gains_are_kept_when_their_step_is_better_and_else_restored(
    context: Any, flies: float, ending: list[str]
) -> None:
    context.flies = flies
    _, *rest = supplied(context)
    proof = ["back for step-after", "rest in step with new gains", "step with new gains"]
    assert rest == ["lent", "set {'P': 2.0}", *proof, *ending]
    assert context.log.verdict[0] is (flies < 1.0)
    assert context.log.metrics_after.itae == flies


def proposed(promised: float, changes: list[Change], predicted_now: float = 1.0) -> Any:
    margins = SimpleNamespace(gain=2.0, phase=0.7)
    return SimpleNamespace(
        changes=changes,
        new={c.parameter: c.new for c in changes},
        before=SimpleNamespace(metrics=step(predicted_now)),
        after=SimpleNamespace(metrics=step(promised)),
        worst_margins=margins,
        windows=(9.0, 9.0),
        spread=0.1,
        beside=None,
        limit="",
    )


@pytest.mark.parametrize(
    ("promised", "changes", "dry", "answer", "ending"),
    [
        (0.5, [], False, True, ["unchanged"]),
        (1.5, [CHANGE], False, True, ["unchanged"]),
        (0.5, [CHANGE], True, True, ["dry-run"]),
        (0.5, [CHANGE], False, False, ["Write P 1 -> 2 and test it by the same manoeuvre?", "declined"]),
    ],
)
def test_a_missing_worse_or_declined_proposal_ends_without_writing(
    context: Any, promised: float, changes: list[Change], dry: bool, answer: bool, ending: list[str]
) -> None:
    context.settings.dry_run, context.answer = dry, answer
    tuned(context, _offer_of(proposed(promised, changes), step(1.0), 1.0))
    assert done == ending
    assert ("ITAE 1 -> " in " ".join(context.log.said)) is bool(changes)


def test_a_proposal_that_proves_better_is_kept(context: Any) -> None:
    tuned(context, _offer_of(proposed(0.5, [CHANGE]), step(1.0), 1.0))
    assert done[-3:] == ["kept", "kept", "left"]


def test_gains_with_oscillating_turn_rates_are_restored_though_headings_are_better(
    context: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    swinging = replace(step(0.5), oscillation=0.3)
    compared = Compared(step(1.0), swinging, is_followed(step(1.0), swinging, {}, "turn rates"))
    beside = SimpleNamespace(compared=lambda context: compared)
    monkeypatch.setattr(autopilot_loop_module.AccompanyingStep, "flown", lambda context, known: beside)
    tuned(context, _offer_of(proposed(0.5, [CHANGE]), step(1.0), 1.0))
    assert done[-2:] == ["given back", "restored"]
    better, reasons = context.log.verdict
    assert not better
    assert "turn rates: remaining oscillation 0.0% -> 30.0% of the step, more than the 5.0% allowed" in reasons
    assert context.log.beside == (step(1.0), swinging)


def test_gains_with_equal_headings_and_clearly_better_turn_rates_are_kept(
    context: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    compared = Compared(step(1.0), step(0.1), is_followed(step(1.0), step(0.1), {}, "turn rates"))
    beside = SimpleNamespace(compared=lambda context: compared)
    monkeypatch.setattr(autopilot_loop_module.AccompanyingStep, "flown", lambda context, known: beside)
    context.flies = 1.02
    tuned(context, _offer_of(proposed(0.9, [CHANGE]), step(1.0), 1.0))
    assert done[-3:] == ["kept", "kept", "left"]
    assert "the other mode's error is 90% lower" in context.log.verdict[1][0]


class Thermostat:
    """A controller of our own: its gain is an attribute, its proof is arithmetic, and no vehicle has a parameter."""

    name = "thermostat"

    def __init__(self, gain: float, proposed: float, best: float) -> None:
        self.gain, self.proposed, self.best = gain, proposed, best
        self.cost = float("nan")
        self.flown: list[float] = []

    def read(self) -> Mapping[str, float]:
        return {"gain": self.gain}

    def lend(self, journal: Journal) -> GainLoan:
        return Borrowed(self)

    def _fly(self) -> float:
        self.flown.append(self.gain)
        return abs(self.gain - self.best)

    def experiment(self) -> None:
        self.cost = self._fly()

    def propose(self) -> Offer:
        return Offer([Change("gain", self.gain, self.proposed, 0.0, 9.0, "nearer")])

    def fly_baseline(self) -> None:
        pass

    def prove(self) -> ProofResult:
        now = self._fly()
        if not self.flown[-1] == self.proposed:
            raise AssertionError("the proof was flown with other gains")
        return ProofResult(Verdict(((now < self.cost, f"cost {self.cost:g} -> {now:g}"),)))


class Borrowed:
    def __init__(self, loop: Thermostat) -> None:
        self.loop, self.old, self.kept = loop, loop.gain, False

    def set(self, values: Mapping[str, float]) -> None:
        self.loop.gain = values["gain"]

    def keep(self) -> None:
        self.kept = True

    def __enter__(self) -> Borrowed:
        return self

    def __exit__(self, *error: object) -> None:
        if not self.kept:
            self.loop.gain = self.old


@pytest.mark.parametrize(
    ("proposed_gain", "dry", "answer", "left", "ending"),
    [
        (2.5, False, True, 2.5, "kept"),
        (7.0, False, True, 1.0, "restored"),
        (2.5, True, True, 1.0, "dry-run"),
        (2.5, False, False, 1.0, "declined"),
    ],
)
def test_a_controller_of_our_own_is_tuned_like_an_autopilot(
    context: Any, proposed_gain: float, dry: bool, answer: bool, left: float, ending: str
) -> None:
    loop = Thermostat(1.0, proposed_gain, best=3.0)
    context.answer = answer
    tune_loop(loop, context.log, context.agrees, cast(Journal, None), dry_run=dry)
    assert loop.gain == left
    assert done[-1] == ending


@pytest.mark.parametrize(("best", "ending", "left"), [(3.0, "kept", 2.5), (-3.0, "restored", 1.0)])
def test_a_mission_tunes_a_controller_of_our_own_and_writes_no_parameter(
    tmp_path: Path, best: float, ending: str, left: float
) -> None:
    harness, loop = SitlHarness(tmp_path, QUICK), Thermostat(1.0, 2.5, best)
    settings, record = harness.settings(), RunDirectory(harness.directory)
    log = TuneLog(settings, WHEN, Ear(harness.said))
    before, after = dict(loop.read()), {}

    def declare(visit: Visit[TuneLog]) -> Mission:
        return Mission(
            itinerary=Itinerary([Leg("heat", 10.0)]),
            modes=("MANUAL",),
            movements="nothing",
            needs=(),
            fly=lambda journal: tune_loop(loop, log, visit.agrees, journal),
            writes="set the gain of the thermostat",
            finish=lambda: after.update(loop.read()),
        )

    run_mission(visiting(settings, Unattended(), log, record, "heading"), declare, log)
    assert (log.story().ending, before, after) == (ending, {"gain": 1.0}, {"gain": left})
    assert "will set the gain of the thermostat" in harness.said
    journal = [json.loads(line)["event"] for line in (harness.directory / "journal.jsonl").read_text().splitlines()]
    assert "writing" not in journal
    harness.assert_untouched()


def test_only_the_autopilot_loop_aboard_and_restore_write_parameters() -> None:
    """Restoring a run that was cut off is for what its journal lists, whoever wrote it."""
    folder = Path(autopilot_loop_module.__file__).parent
    writers = set()
    for path in folder.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            called = isinstance(node, ast.Attribute) and node.attr in ("set", "write", "write_all", "set_many")
            own = called and ast.unparse(node.value).endswith("parameters")
            if own or (isinstance(node, ast.Name) and node.id == "ParameterTransaction"):
                writers.add(path.stem)
    assert writers == {"aboard", "autopilot_loop", "restore"}


def test_gains_of_a_controller_of_our_own_are_restored_when_its_proof_fails(context: Any) -> None:
    loop = Thermostat(1.0, 2.5, best=3.0)
    loop.prove = lambda: 1 // 0  # type: ignore[assignment, return-value, method-assign]
    with pytest.raises(ZeroDivisionError):
        tune_loop(loop, context.log, context.agrees, cast(Journal, None))
    assert loop.gain == 1.0
