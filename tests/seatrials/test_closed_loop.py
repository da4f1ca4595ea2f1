"""Relays on the set-point tell the heading loop as it is: natural frequency and damping of one that is known."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from gcs_autotune.errors import NotInformative
from gcs_autotune.manoeuvres import MANOEUVRES, Envelope, Sequencer
from gcs_autotune.seatrials import ship_figures
from gcs_autotune.trial import Trial
from gcs_autotune.watch import SilentWatcher
from tests.manoeuvres.pond import PondCraft

RELAYS = {"set-point": 10.0, "hysteresis": 3.0, "second-set-point": 6.0, "second-hysteresis": 3.0}


def flown(craft: PondCraft, relays: dict[str, float] = RELAYS) -> Trial:
    kind = MANOEUVRES["set-point-relay"]
    assert kind.make is not None
    kept: list[Trial] = []
    options = {name: math.radians(x) for name, x in relays.items()}
    sequencer = Sequencer(craft, Envelope(heading_excursion=math.inf), SilentWatcher(), kept.append)
    craft.arm()
    sequencer.fly(kind.make({**options, "throttle": 0.0, "side": 1.0, "keep-still": 1.0}))
    return kept[0]


def test_a_loop_of_second_order_is_read_off_two_relays_on_its_set_point() -> None:
    # the pond's autopilot: psi'' + (0.8 + 1) psi' + 2 psi = 2 psi_ref
    (sheet,) = ship_figures(flown(PondCraft()))
    assert sheet["natural-frequency"].reading.value == pytest.approx(math.sqrt(2.0), rel=0.02)
    assert sheet["damping"].reading.value == pytest.approx(1.8 / math.sqrt(8.0), rel=0.03)
    assert sheet["overshoot"].reading.value == pytest.approx(0.075, abs=0.015)
    assert "well damped" in sheet.verdict
    assert sheet.doubts == ()


def test_a_loop_whose_steering_is_at_its_limit_is_doubted() -> None:
    wide = {"set-point": 60.0, "hysteresis": 10.0, "second-set-point": 45.0, "second-hysteresis": 10.0}
    (sheet,) = ship_figures(flown(PondCraft(), wide))
    assert "saturated" in {d.slug for d in sheet.doubts}


def test_one_relay_is_too_few_for_the_loop() -> None:
    run = flown(PondCraft())
    second = [m for m in run.marks if m.kind == "relay"][1]
    with pytest.raises(NotInformative, match="holds 1 relays"):
        ship_figures(replace(run, marks=tuple(m for m in run.marks if m is not second)))
