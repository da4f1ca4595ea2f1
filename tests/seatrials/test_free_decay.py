"""A push by hand and its decay: period and damping of a known craft."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs_autotune.errors import NotInformative
from gcs_autotune.manoeuvres import MANOEUVRES, Envelope, Sequencer
from gcs_autotune.observer import SilentObserver
from gcs_autotune.seatrials import ship_figures
from gcs_autotune.trial import Channel, Trial
from tests.manoeuvres.toy_craft import PondCraft, Pushed


def flown(craft: PondCraft, force: str) -> Trial:
    kind = MANOEUVRES["hand-release"].of(force)
    assert kind.make is not None
    kept: list[Trial] = []
    craft.arm()
    Sequencer(craft, Envelope(), SilentObserver(), kept.append).fly(kind.make({"duration": 60.0}))
    return kept[0]


@pytest.mark.parametrize(("force", "title"), [("K", "free decay in roll"), ("M", "free decay in pitch")])
def test_period_and_damping_are_identified_from_a_decay_after_a_push(force: str, title: str) -> None:
    (sheet,) = ship_figures(flown(Pushed(), force))
    assert sheet.title == title
    damped = Pushed.omega * math.sqrt(1.0 - Pushed.zeta**2)
    assert sheet["period"].reading.value == pytest.approx(2.0 * math.pi / damped, rel=0.01)
    assert sheet["natural-frequency"].reading.value == pytest.approx(Pushed.omega, rel=0.01)
    assert sheet["damping"].reading.value == pytest.approx(Pushed.zeta, rel=0.1)
    assert sheet["largest"].reading.value == pytest.approx(0.25, abs=0.01)


def test_quadratic_drag_appears_as_damping_that_grows_with_the_amplitude() -> None:
    x, v, rows = 0.4, 0.0, []
    for k in range(6000):
        rows.append((0.01 * k, x))
        v += 0.01 * (-4.0 * x - 0.1 * v - 1.0 * abs(v) * v)
        x += 0.01 * v
    t, phi = np.array(rows)[::10].T
    run = Trial("decay", {"phi": Channel("phi", "rad", t, phi)}, meta={"manoeuvre": "hand-release", "rest": 0.0})
    (sheet,) = ship_figures(run)
    assert [d.slug for d in sheet.doubts] == ["quadratic-damping"]
    assert sheet["damping"].reading.value == pytest.approx(0.1 / 4.0, rel=0.15)
    # 8/(3 pi) |v|v over half a period: the mean loss is 8/3 of the amplitude
    assert sheet["quadratic"].reading.value == pytest.approx(8.0 / 3.0 / 2.0, rel=0.15)


def test_a_missing_push_or_oscillation_is_reported() -> None:
    with pytest.raises(NotInformative, match="A free decay needs 4"):
        ship_figures(Trial("still", {"phi": Channel("phi", "rad", np.arange(50.0), np.linspace(0.2, 0.0, 50))},
                           meta={"manoeuvre": "hand-release", "rest": 0.0}))  # fmt: skip
    kind = MANOEUVRES["hand-release"]
    assert kind.make is not None
    craft = PondCraft()
    craft.arm()
    ended = Sequencer(craft, Envelope(), SilentObserver(), lambda trial: None).fly(kind.make({"duration": 60.0}))
    assert ended.ending == "aborted"
    assert "no push within" in ended.reason
