"""Which oscillations are flown: one where it determines the gains, two sizes where the actuator needs them."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, cast

import pytest

from gcs_autotune.craft import Observation
from gcs_autotune.errors import NotInformative
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.identify import AxisFit
from gcs_autotune.manoeuvres import Envelope, ThrottleSteps
from gcs_autotune.trial import Channel, Trial
from gcs_autotune.workflow import identification
from gcs_autotune.workflow.identification import Identified, identify
from gcs_autotune.workflow.runner import ManoeuvreRunner


def flown(name: str) -> Trial:
    psi = Channel("psi", "rad", [0.1 * k for k in range(60)], [0.0] * 60)
    return Trial(name, {"psi": psi}, meta={"C": 0.3, "noise_std": 0.004})


STEP = flown("step-before")


class Rule:
    """A stop rule with the supplied state after each relay."""

    question = None

    def __init__(self, *, known: bool = False, another_size: bool = False) -> None:
        self.known, self.another_size, self.closed = known, another_size, False

    def start(self) -> None:
        assert not self.closed

    def weigh(self, whole: Any) -> None:
        self.known = whole

    def conclude(self, run: Any, awaited: Any) -> Any:
        return run

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def context(monkeypatch: pytest.MonkeyPatch) -> Any:
    """A context that notes which relays are flown, by what rule and from what noise; ``left`` is not explained."""
    relays: list[Any] = []
    context = SimpleNamespace(relays=relays, left=5.0)

    def fly(relay: Any, stage: str) -> Any:
        relays.append(relay)
        return flown(relay.name)

    class Relays:
        keep_still = True

        @classmethod
        def of(cls, *_: object) -> Relays:
            return cls()

        against_wall = False

        def relay(self, number: int, output: float | None, **options: Any) -> Any:
            return SimpleNamespace(name=self.name(number), **options)

        def name(self, number: int) -> str:
            return f"relay-{number}"

        def stage(self, which: str) -> str:
            return f"{which} self-oscillation"

        def second_output(self, first: Any) -> float:
            return 0.2

    def fitted(context: Any, plain: Any, trials: Any, step: Any, **_: Any) -> Identified:
        return Identified(SimpleNamespace(unexplained=context.left), trials)  # type: ignore[arg-type]

    monkeypatch.setattr(identification, "Relays", Relays)
    plain = SimpleNamespace(doubts=(), fit_percent=97.0, unexplained=3.0)
    monkeypatch.setattr(identification, "_plain", lambda context, trials: plain)
    monkeypatch.setattr(identification, "_extended", fitted)
    context.fly = fly
    context.settings = SimpleNamespace(relay_output=None, structure=None, most_relays=2, pull_test=None)
    context.log = SimpleNamespace(say=lambda text: None, fit=None)
    context.craft = SimpleNamespace(firmware=SimpleNamespace(needs_way=False), least_period=0.0)
    context.axis = FIRMWARE["ardusub"].axes["heading"]
    context.await_worker = None
    context.throttle = 0.0
    context.turn_around = lambda before, ahead: False
    context.earlier = SimpleNamespace(has=lambda name: name in context.resumed)
    context.resumed = ()
    context.run_in_background = lambda work, *args: True
    return context


def names(context: Any) -> list[tuple[str, bool]]:
    return [(relay.name, getattr(relay, "criterion", None) is not None) for relay in context.relays]


def test_one_sufficient_oscillation_is_enough_and_the_step_is_in_the_fit(context: Any) -> None:
    rule: Any = Rule(known=True)
    found = identify(context, STEP, rule)
    assert names(context) == [("relay-1", True)]
    assert [run.name for run in found.runs] == ["step-before", "relay-1"]
    assert rule.closed and not found.short  # the rule has looked at what is left open


def test_two_short_sizes_are_flown_where_the_first_requires_the_second(context: Any) -> None:
    found = identify(context, STEP, Rule(another_size=True))  # type: ignore[arg-type]
    assert names(context) == [("relay-1", True), ("relay-2", True)]
    assert context.relays[1].noise_std == 0.004
    assert found.short


def test_unexplained_short_relays_are_flown_again_in_full(context: Any) -> None:
    context.left = 15.0
    found = identify(context, STEP, Rule(another_size=True))  # type: ignore[arg-type]
    assert names(context) == [("relay-1", True), ("relay-2", True), ("relay-1", False), ("relay-2", False)]
    assert not found.short


def test_after_a_full_first_oscillation_the_second_is_flown_in_full_too(context: Any) -> None:
    context.left = 15.0
    found = identify(context, STEP, Rule())  # type: ignore[arg-type]
    assert names(context) == [("relay-1", True), ("relay-2", False)]
    assert not found.short


def test_without_a_rule_or_a_step_five_periods_decide(context: Any) -> None:
    identify(context, STEP)
    identify(context, None, Rule(known=True))  # type: ignore[arg-type]
    assert names(context) == [("relay-1", False), ("relay-2", False)] * 2


def test_an_oscillation_of_an_earlier_run_is_assessed_before_another_is_flown(context: Any) -> None:
    context.resumed = ("relay-1",)
    found = identify(context, STEP, Rule())  # type: ignore[arg-type]
    assert names(context) == [("relay-1", True)]
    assert [run.name for run in found.runs] == ["step-before", "relay-1"]


TURNED = Trial("turn-around", {}, ending="completed")


@pytest.mark.parametrize(
    ("x", "ahead", "last", "turns"),
    [
        (100.0, 60.0, False, False),
        (130.0, 30.0, False, True),
        (130.0, 60.0, True, False),
        (220.0, 60.0, True, True),
        (100.0, 200.0, False, True),
        (0.0, float("inf"), False, True),
        (float("nan"), 30.0, False, True),
    ],
    ids=["near", "far", "far, last", "the guard is near", "a long way ahead", "in any case", "unknown position"],
)
def test_a_boat_turns_around_only_where_the_space_requires_it(
    monkeypatch: pytest.MonkeyPatch, x: float, ahead: float, last: bool, turns: bool
) -> None:
    craft: Any = SimpleNamespace(firmware=SimpleNamespace(needs_way=True), armed=False, clock=None)
    craft.observe = lambda: Observation(0.0, 0.0, x=x, y=0.0)
    runner = ManoeuvreRunner(craft, Envelope(cruise=1.2), SimpleNamespace(say=print), lambda trial: None)  # type: ignore[arg-type]
    turned: list[str] = []

    def attempt(manoeuvre: Any, stage: str, envelope: Envelope) -> Trial:
        turned.append(stage)
        return TURNED

    monkeypatch.setattr(runner, "attempt", attempt)
    monkeypatch.setattr(runner._sequencer, "_home", Observation(0.0, 0.0, x=0.0, y=0.0))
    assert runner.turn_around(0.5, ahead, last=last) is turns
    assert turned == ["turning around"] * turns


@pytest.mark.parametrize(
    ("psi", "side"),
    [(0.3, 1.0), (-0.3, -1.0), (3.0, 1.0), (-3.0, -1.0)],
    ids=[
        "outwards, bow to starboard",
        "outwards, bow to port",
        "homewards, too far to port",
        "homewards, too far to starboard",
    ],
)
def test_a_boat_turns_around_to_the_side_of_its_start(monkeypatch: pytest.MonkeyPatch, psi: float, side: float) -> None:
    craft: Any = SimpleNamespace(firmware=SimpleNamespace(needs_way=True), armed=False, clock=None)
    craft.observe = lambda: Observation(0.0, psi, x=200.0, y=0.0)
    runner = ManoeuvreRunner(craft, Envelope(cruise=1.2), SimpleNamespace(say=print), lambda trial: None)  # type: ignore[arg-type]
    turned: list[Any] = []

    def attempt(manoeuvre: Any, stage: str, envelope: Envelope) -> Trial:
        turned.append(manoeuvre.meta_fields)
        return TURNED

    monkeypatch.setattr(runner, "attempt", attempt)
    monkeypatch.setattr(runner._sequencer, "_home", Observation(0.0, 0.0, x=0.0, y=0.0))
    assert runner.turn_around(0.5)
    assert turned[0]["output"] == 0.5 * side


def test_an_uninformative_first_run_is_followed_by_a_run_back() -> None:
    flown: list[str] = []

    def too_little(trials: Sequence[Trial], **_: object) -> AxisFit:
        if len(trials) < 2:
            raise NotInformative("too little")
        return cast(AxisFit, SimpleNamespace(runs=len(trials)))

    def fly(manoeuvre: ThrottleSteps, stage: str) -> SimpleNamespace:
        flown.append(manoeuvre.name)
        return manoeuvre.name

    context = SimpleNamespace(
        settings=SimpleNamespace(structure=None, delay=None, pull_test=None),
        log=SimpleNamespace(say=lambda text: None),
        throttle=0.4,
        earlier=SimpleNamespace(has=lambda name: False),
        fly=fly,
        turn_around=lambda *where: None,
        compute_while_turning=lambda before, work: work(),
        run_in_background=lambda work, *args: work(*args),
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(identification, "fit_surge", too_little)
        found = identification._by_throttle_steps(context, turns_first=False, early=True)  # type: ignore[arg-type]
    assert flown == ["throttle-1", "throttle-2"]
    assert found.runs == ["throttle-1", "throttle-2"] and not found.short
