"""Each manoeuvre of the table is flown on a toy craft; an abort in any phase restores the craft."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np
import pytest

from gcs_autotune.craft import Actuate
from gcs_autotune.errors import AutotuneError, LinkLost, OperatorStopped, UsageError
from gcs_autotune.limits import limit_of
from gcs_autotune.manoeuvres import (
    MANOEUVRES,
    CalmCheck,
    ComeBack,
    Dive,
    DiveSettings,
    Envelope,
    Manoeuvre,
    ManoeuvreKind,
    NominalPlant,
    Sequencer,
    SignCheck,
    SignCheckSettings,
    Step,
    StepSettings,
    ThrottleSteps,
    ThrottleStepsSettings,
    TurnAround,
    TurnAroundSettings,
    preview,
    restore_on_exit,
)
from gcs_autotune.models import SingleDof
from gcs_autotune.observer import Progress, SilentObserver
from gcs_autotune.trial import Trial

from .toy_craft import BeforeWall, PondCraft, Pushed

FREE = Envelope(heading_excursion=math.inf, depth_excursion=math.inf, roll=math.inf, pitch=math.inf)
SHORT = {"duration": 6.0, "executes": 2.0, "levels": 2.0, "turn": 2.0, "push": 2.0, "f-start": 0.3, "fade-in": 1.0}
BY_COMMAND: Mapping[str, Callable[[], Manoeuvre]] = {
    "throttle-steps": lambda: ThrottleSteps(ThrottleStepsSettings(0.5)),
    "step": lambda: Step(StepSettings("psi", 0.3, 5.0)),
    "sign-check": lambda: SignCheck(SignCheckSettings("psi", "N", reach=0.1, least=0.02, longest=4.0)),
    "turn-around": lambda: TurnAround(TurnAroundSettings(0.5)),
    "dive": lambda: Dive(DiveSettings(1.0)),
    "come-back": lambda: ComeBack(3.0, 0.0, 0.5),
    "calm-check": CalmCheck,
}
"""What other commands fly of the table."""


def options(kind: ManoeuvreKind, throttle: float) -> dict[str, float]:
    rows = {name: limit_of(name, kind.axis) for name in kind.options}
    usual = {n: row.default * row.factor for n, row in rows.items() if row.default is not None}
    short = {n: v for n, v in SHORT.items() if n in kind.options}
    return {**usual, **short, "throttle": throttle, "side": 1.0, "keep-still": float(not throttle)}


def forces_of(kind: ManoeuvreKind) -> Iterator[str]:
    """Yield every force that drives it, its own as none."""
    yield ""
    for force in "XYZKMN" if kind.for_force is not None else "":
        try:
            other = kind.of(force)
        except UsageError:
            continue
        if other.drives != kind.drives:
            yield force


ROWS = [(name, force) for name, kind in MANOEUVRES.items() if not kind.layered for force in forces_of(kind)]
"""Layered manoeuvres need loops: see test_layered.py."""


def made(name: str, force: str = "", *, boat: bool) -> Manoeuvre:
    kind = MANOEUVRES[name].of(force)
    return BY_COMMAND[name]() if kind.make is None else kind.make(options(kind, 0.5 * boat))


class Phases(SilentObserver):
    """Remembers the phases; in *phase*, lets *act* happen."""

    def __init__(self, phase: str = "", act: Callable[[], None] = lambda: None) -> None:
        self.seen: list[str] = []
        self._phase, self._act = phase, act

    def update(self, progress: Progress) -> None:
        if not self.seen or self.seen[-1] != progress.manoeuvre:
            self.seen.append(progress.manoeuvre)
        if progress.manoeuvre == self._phase:
            self._act()


def fly(craft: PondCraft, manoeuvre: Manoeuvre, observer: Phases) -> Trial:
    kept: list[Trial] = []
    try:
        with restore_on_exit(craft, SilentObserver()):
            craft.arm()
            Sequencer(craft, FREE, observer, kept.append).fly(manoeuvre)
    except AutotuneError:
        (trial,) = kept
        assert trial.ending == "aborted"
        raise
    return kept[0]


def at_sea(name: str, force: str = "") -> tuple[PondCraft, bool]:
    """Return a craft that the manoeuvre suits; whether it is a boat."""
    boat = MANOEUVRES[name].of(force).needs_way
    if name == "hand-release":
        return Pushed(), False
    if name == "wall-relay":
        return BeforeWall(), False
    return PondCraft(firmware="ardurover" if boat else "ardusub"), boat


ENDS: tuple[tuple[type[AutotuneError], Callable[[PondCraft], Any]], ...] = (
    (OperatorStopped, lambda craft: setattr(craft, "stop_wanted", True)),
    (LinkLost, lambda craft: craft.fail_at.setdefault(craft.tick + 1, LinkLost("gone"))),
)


@pytest.mark.parametrize(("name", "force"), ROWS)
def test_an_abort_in_any_phase_restores_the_craft_and_keeps_the_record(name: str, force: str) -> None:
    craft, boat = at_sea(name, force)
    observer = Phases()
    whole = fly(craft, made(name, force, boat=boat), observer)
    assert whole.ending != "aborted", whole.reason
    assert whole.meta["manoeuvre"] == name
    assert not force or whole.meta["force"] == force
    phases = list(dict.fromkeys(observer.seen))
    for phase, (error, act) in itertools.product(phases, ENDS):
        craft, boat = at_sea(name, force)
        found = craft.mode
        with pytest.raises(error):
            fly(craft, made(name, force, boat=boat), Phases(phase, partial(act, craft)))
        assert craft.command == Actuate()
        assert craft.mode == found
        assert not craft.armed
        assert craft.log[-1] == "release"


def test_every_row_is_tested_and_has_its_name() -> None:
    assert {name for name, kind in MANOEUVRES.items() if not kind.is_alone} == set(BY_COMMAND)
    for name, kind in MANOEUVRES.items():
        assert kind.name == name
        for preset in kind.presets:
            assert preset.make(30.0).settings["manoeuvre"] == name
            assert preset.make(30.0).purpose == ("identification" if kind.identifies else "check")


@pytest.mark.parametrize("name", [n for n, kind in MANOEUVRES.items() if kind.for_force and not kind.axis])
def test_time_based_signals_drive_any_force_and_are_previewed(name: str) -> None:
    paper = NominalPlant(
        SingleDof("yaw", "1", 1.0, 1.0), 1.0, "a test", others={f: SingleDof("surge", "1", 1.0, 1.0) for f in "XYZ"}
    )
    for force in "NXYZ" if name != "hand-release" else "":
        kind = MANOEUVRES[name].of(force)
        assert kind.make is not None
        assert kind.drives == {force}
        manoeuvre = kind.make(options(kind, 0.0))
        trial = preview(manoeuvre, paper, FREE, floats=False).trial
        assert abs(trial[force].values).max() >= 0.3
        assert manoeuvre.settings["force"] == force
    if name == "hand-release":
        assert MANOEUVRES[name].of("M").excites == {"pitch"}
        with pytest.raises(UsageError, match="fly free-decay"):
            MANOEUVRES[name].of("X")
        return
    ahead = MANOEUVRES[name].of("X")
    assert ahead.make is not None
    if ahead.stays or ahead.tied:
        return
    boat = ahead.make({**options(ahead, 0.5), "keep-still": 0.0})
    assert preview(boat, paper, FREE).trial["X"].values.min() >= 0.0


@pytest.mark.parametrize(("force", "signal"), [("N", "psi"), ("Z", "z"), ("X", "u")])
def test_a_relay_on_the_set_point_of_each_loop_is_previewed_to_its_end(force: str, signal: str) -> None:
    kind = MANOEUVRES["set-point-relay"].of(force)
    assert kind.make is not None
    sizes = options(kind, 0.0)
    manoeuvre = kind.make({**sizes, "speed": 1.0})
    seen = preview(manoeuvre, NominalPlant(SingleDof("yaw", "1", 1.0, 1.0), 1.0, "a test"), FREE, floats=False, way=1.0)
    assert (seen.trouble, manoeuvre.outcome and manoeuvre.outcome.ending) == ("", "completed")
    assert np.ptp(seen.trial[signal].values) > 2.0 * sizes["hysteresis"]


def test_a_row_that_steers_accepts_no_other_force() -> None:
    with pytest.raises(UsageError, match="does not accept --force Z"):
        MANOEUVRES["spiral"].of("Z")


@pytest.mark.parametrize(
    ("least", "blind_at", "text"), [(0.3, 12.0, "stopped reporting the distance"), (4.9, math.inf, "nearer")]
)
def test_a_wall_relay_ends_when_the_wall_is_lost_or_too_near(least: float, blind_at: float, text: str) -> None:
    kind = MANOEUVRES["wall-relay"]
    assert kind.make is not None
    craft = BeforeWall()
    craft.blind_at = blind_at
    craft.arm()
    manoeuvre = kind.make({**options(kind, 0.0), "least-distance": least})
    ended = Sequencer(craft, FREE, SilentObserver(), lambda trial: None).fly(manoeuvre)
    assert ended.ending == "aborted"
    assert text in ended.reason
    assert craft.command == Actuate()
