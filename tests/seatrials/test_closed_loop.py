"""Relays on the set-point identify the heading loop: natural frequency and damping of a known one."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from gcs_autotune.errors import NotInformative, UsageError
from gcs_autotune.limits import limit_of
from gcs_autotune.manoeuvres import MANOEUVRES, Envelope, Sequencer
from gcs_autotune.models import TransferFunction
from gcs_autotune.observer import SilentObserver
from gcs_autotune.seatrials import closed_loop, ship_figures
from gcs_autotune.seatrials.closed_loop import _not_linear, _verdict, oscillation_of
from gcs_autotune.trial import Channel, Mark, Trial
from tests.manoeuvres.toy_craft import PondCraft, answered, at_rest

RELAYS = {"set-point": 10.0, "hysteresis": 3.0, "second-set-point": 6.0, "second-hysteresis": 3.0}

SMALL_IS_WORSE = (0.9, 0.6, 0.8)
_SLOW = np.poly([-0.005, -2.0 + 4.0j, -2.0 - 4.0j]).real[::-1]
SLOW_LOOP = TransferFunction((1.0, 120.0), tuple(_SLOW / _SLOW[0]))


def flown(craft: PondCraft, relays: dict[str, float] = RELAYS) -> Trial:
    kind = MANOEUVRES["set-point-relay"]
    assert kind.make is not None
    kept: list[Trial] = []
    options = {name: math.radians(x) for name, x in relays.items()}
    sequencer = Sequencer(craft, Envelope(heading_excursion=math.inf), SilentObserver(), kept.append)
    craft.arm()
    sequencer.fly(kind.make({**options, "throttle": 0.0, "side": 1.0, "keep-still": 1.0}))
    return kept[0]


def test_a_second_order_loop_is_identified_from_two_relays_on_its_set_point() -> None:
    # the pond's autopilot: psi'' + (0.8 + 1) psi' + 2 psi = 2 psi_ref
    (sheet,) = ship_figures(flown(PondCraft()))
    assert sheet["natural-frequency"].reading.value == pytest.approx(math.sqrt(2.0), rel=0.02)
    assert sheet["damping"].reading.value == pytest.approx(1.8 / math.sqrt(8.0), rel=0.03)
    assert sheet["overshoot"].reading.value == pytest.approx(0.075, abs=0.015)
    assert "well damped" in sheet.verdict
    assert sheet.doubts == ()


def test_the_depth_loop_is_identified_in_the_same_way() -> None:
    # the pond's autopilot has the same loop in depth
    relays = {"set-point": 0.17, "hysteresis": 0.05, "second-set-point": 0.1, "second-hysteresis": 0.05}
    kind = MANOEUVRES["set-point-relay"].of("Z")
    assert kind.make is not None
    craft, kept = PondCraft(), []
    craft.z = 5.0
    craft.arm()
    manoeuvre = kind.make({**relays, "throttle": 0.0, "side": 1.0, "keep-still": 1.0})
    Sequencer(craft, Envelope(), SilentObserver(), kept.append).fly(manoeuvre)
    (sheet,) = ship_figures(kept[0])
    assert sheet.title == "closed depth loop"
    assert sheet["natural-frequency"].reading.value == pytest.approx(math.sqrt(2.0), rel=0.02)
    assert sheet["damping"].reading.value == pytest.approx(1.8 / math.sqrt(8.0), rel=0.03)
    assert sheet["amplitude-1"].reading.unit == "m"
    assert "the depth loop is well damped" in sheet.verdict


@pytest.mark.parametrize(("force", "signal"), [("N", "psi"), ("Z", "z"), ("X", "u")])
def test_a_loop_that_does_not_follow_is_abandoned_and_reported(force: str, signal: str) -> None:
    kind = MANOEUVRES["set-point-relay"].of(force)
    assert kind.make is not None
    options = {name: limit_of(name, kind.axis) for name in kind.options}
    usual = {name: row.default * row.factor for name, row in options.items() if row.default is not None}
    manoeuvre = kind.make({**usual, "throttle": 0.5, "side": 1.0, "keep-still": 1.0, "speed": 1.0})
    rows = answered(manoeuvre, lambda t, _: at_rest(t=t, u=1.0, speed=1.0))
    assert manoeuvre.outcome is not None
    assert f"the {kind.axis} did not cross" in manoeuvre.outcome.reason
    assert {type(command).__name__ for _, command in rows} == {"DepthTarget" if force == "Z" else "HeadingTarget"}
    assert manoeuvre.signal == signal


def test_a_relay_that_would_stop_the_boat_is_rejected() -> None:
    kind = MANOEUVRES["set-point-relay"].of("X")
    assert kind.make is not None
    sizes = {"set-point": 0.6, "hysteresis": 0.1, "second-set-point": 0.3, "second-hysteresis": 0.1}
    with pytest.raises(UsageError, match="reaches zero speed"):
        kind.make({**sizes, "throttle": 0.5, "side": 1.0, "keep-still": 0.0, "speed": 0.5})
    with pytest.raises(UsageError, match="no loop for Y"):
        kind.of("Y")


def test_a_loop_whose_steering_is_at_its_limit_is_doubted() -> None:
    wide = {"set-point": 60.0, "hysteresis": 10.0, "second-set-point": 45.0, "second-hysteresis": 10.0}
    (sheet,) = ship_figures(flown(PondCraft(), wide))
    assert "saturated" in {d.slug for d in sheet.doubts}


def test_no_doubt_about_a_saturated_loop_advises_a_larger_relay(monkeypatch: pytest.MonkeyPatch) -> None:
    wide = {"set-point": 60.0, "hysteresis": 10.0, "second-set-point": 45.0, "second-hysteresis": 10.0}
    monkeypatch.setattr(closed_loop, "_loop", lambda *_: (SLOW_LOOP, SMALL_IS_WORSE, np.array([0.1, 0.01, 0.0])))
    (sheet,) = ship_figures(flown(PondCraft(), wide))
    assert [doubt.slug for doubt in sheet.doubts] == ["not-linear", "saturated", "slower-than-relays"]
    assert not [doubt.cure for doubt in sheet.doubts if "larger" in doubt.cure]
    assert "limit of the actuator" in sheet.doubts[0].cause


def test_motion_after_the_last_switch_does_not_count() -> None:
    run = flown(PondCraft())
    last = max(m.t for m in run.marks if m.kind == "switch")
    t = np.arange(last + 0.05, last + 6.0, 0.05)
    let_go = [np.append(run["psi"].t, t), np.append(run["psi"].values, run["psi"].values[-1] - 0.3 * (t - last))]
    longer = replace(run, channels={**run.channels, "psi": replace(run["psi"], t=let_go[0], values=let_go[1])})
    (sheet,), (same,) = ship_figures(run), ship_figures(longer)
    assert same["natural-frequency"].reading == sheet["natural-frequency"].reading
    assert same.doubts == ()


def test_a_loop_with_a_steady_error_is_identified_about_its_offset() -> None:
    run = flown(PondCraft())
    psi, began = run["psi"], next(m.t for m in run.marks if m.kind == "relay")
    t = np.maximum(psi.t - began, 0.0)
    w = math.sqrt(2.0 - 0.9**2)
    lost = np.exp(-0.9 * t) * (np.cos(w * t) + 0.9 / w * np.sin(w * t))  # as the pond's loop comes back to its course
    beside = replace(psi, values=psi.values + math.radians(2.0) * lost)  # a dead band let it stand there
    (sheet,) = ship_figures(replace(run, channels={**run.channels, "psi": beside}))
    assert sheet["natural-frequency"].reading.value == pytest.approx(math.sqrt(2.0), rel=0.03)
    assert sheet.doubts == ()


def oscillating_loop(b_1: float, a: tuple[float, float, float], noise: float) -> Trial:
    """Return two relays (20, 5), (15, 5) degrees on the set-point of (b_1 s + 1)/(a_3 s^3 + a_2 s^2 + a_1 s + 1), which
    had oscillated for 40 s before the record begins, at 10 Hz, with *noise* [rad] on psi.
    """
    A = np.zeros((4, 4))
    A[0, 1] = A[1, 2] = 1.0
    A[2] = np.array([-1.0, -a[0], -a[1], 1.0]) / a[2]
    step, x, rng = expm(0.1 * A), np.zeros(3), np.random.default_rng(1)
    t, psi, marks, ref = 0.1 * np.arange(1600), [], [], 0.0
    for now in t:
        C = math.radians(20.0 if now < 100.0 else 15.0)
        psi.append(x[0] + b_1 * x[1] + noise * rng.normal())
        if any(abs(now - begun) < 0.05 for begun in (40.0, 100.0)):
            marks.append(Mark(now, "relay", {"x_a": math.radians(5.0)}))
            ref = 0.0
        if abs(ref) < C or psi[-1] * ref > math.radians(5.0) * abs(ref):
            ref = -C if psi[-1] > 0.0 else C
            marks.append(Mark(now, "switch", {"psi_ref": ref}))
        x = step[:3, :3] @ x + step[:3, 3] * ref
    channels = {"psi": Channel("psi", "rad", t, np.array(psi)), "N": Channel("N", "1", t, np.zeros(len(t)))}
    meta = {"manoeuvre": "set-point-relay", "dof": "yaw", "noise_std": noise}
    return Trial("r", channels, tuple(marks), meta=meta).between(40.0, 160.0)


def test_a_loop_already_oscillating_with_a_slow_integral_is_identified() -> None:
    a = (22.0, 141.9, 392.5)  # Charlie's with gains that keep its rudder off its stops
    truth = oscillation_of(TransferFunction((1.0, 20.0), (1.0, *a)))
    (sheet,) = ship_figures(oscillating_loop(20.0, a, math.radians(0.25)))
    for slug, true in zip(("natural-frequency", "damping"), truth, strict=True):
        result = sheet[slug].reading
        assert result.std < 0.2 * true  # 18 % and 5 % at the optimum itself
        assert abs(result.value - true) < 3.0 * result.std


def test_rounding_errors_of_a_record_do_not_change_the_result() -> None:
    run = oscillating_loop(20.0, (22.0, 141.9, 392.5), math.radians(0.25))
    psi = run["psi"]
    beside = replace(run, channels={**run.channels, "psi": replace(psi, values=psi.values * (1.0 + 1e-13))})
    (one,), (other,) = ship_figures(run), ship_figures(beside)
    for slug in ("natural-frequency", "damping"):
        a, b = one[slug].reading, other[slug].reading
        assert b.value == pytest.approx(a.value, abs=0.05 * a.std)
        assert b.std == pytest.approx(a.std, rel=0.05)


def test_an_unidentifiable_fast_pole_does_not_worsen_the_other_figures() -> None:
    (sheet,) = ship_figures(oscillating_loop(0.0, (1.0, 1.0, 1e-6), math.radians(0.25)))
    assert sheet["natural-frequency"].reading.value == pytest.approx(1.0, rel=0.03)
    assert sheet["natural-frequency"].reading.std < 0.05
    assert sheet["overshoot"].reading.value == pytest.approx(0.163, abs=0.03)
    assert sheet["overshoot"].reading.std < 0.1


def test_a_larger_relay_is_advised_if_the_smaller_one_fits_worse() -> None:
    small, large, neither = (
        _not_linear(x, is_saturated=False) for x in (SMALL_IS_WORSE, (0.6, 0.9, 0.8), (0.8, 0.82, 0.8))
    )
    assert "dead zone" in small.cause
    assert "larger" in small.cure
    assert "saturation" in large.cause
    assert "another structure" in neither.cause


def test_the_verdict_reports_an_overshoot_hidden_by_the_damping_ratio() -> None:
    assert "overshoots a step by 40 %" in _verdict((0.8, 0.1), (0.4, 0.1), "heading")
    assert "well damped" in _verdict((0.8, 0.1), (0.1, 0.1), "heading")
    assert "oscillates" in _verdict((0.1, 0.05), (0.7, 0.3), "heading")
    assert "do not determine" in _verdict((math.nan, math.nan), (0.3, 0.7), "heading")


def test_a_loop_needs_two_relays() -> None:
    run = flown(PondCraft())
    second = [m for m in run.marks if m.kind == "relay"][1]
    with pytest.raises(NotInformative, match="has 1 relay on"):
        ship_figures(replace(run, marks=tuple(m for m in run.marks if m is not second)))


def test_a_settling_time_of_many_relay_periods_is_left_out() -> None:
    """A loop that overshoots a little and creeps back: its relays switch long before."""
    poles = np.poly([-0.25, -2.0 + 2.0j, -2.0 - 2.0j]).real[::-1]
    loop = TransferFunction((1.0, 4.6), tuple(poles / poles[0]))
    for period, is_known in ((4.0, True), (1.0, False)):
        times = {figure.slug: figure.reading.value for figure in closed_loop._step_figures(loop, period)}
        assert math.isfinite(times["settling"]) is is_known
        assert times["rise"] < 1.0


def test_step_figures_longer_than_the_relays_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """A BlueBoat's tuned loop: 677 s to settle, from 25 s of relays of five degrees."""
    monkeypatch.setattr(closed_loop, "_loop", lambda *_: (SLOW_LOOP, [0.95, 0.95, 0.95], np.array([0.1, 0.01, 0.0])))
    (sheet,) = ship_figures(oscillating_loop(0.0, (1.0, 1.0, 1e-6), 0.0))
    assert [doubt.slug for doubt in sheet.doubts] == ["slower-than-relays"]
    assert "takes 276.1 s to rise, but the relays switched it back and forth every 3.8 s" in sheet.doubts[0].cause
    assert not {"damping", "overshoot", "rise", "settling"} & {figure.slug for figure in sheet.figures}
    assert "do not determine the damping" in sheet.verdict
