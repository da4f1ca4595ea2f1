"""Turning circle, spirals and pull-out of simulated ships whose figures are known."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from ship_plants import DEG, loop, nomoto, plan, sail

from gcs_autotune.errors import MissingChannel, NotInformative, UnknownName
from gcs_autotune.identify.open_loop import Reading
from gcs_autotune.seatrials import Particulars, ship_figures
from gcs_autotune.seatrials.criteria import first_overshoot_limit, judged, second_overshoot_limit

SPIRAL = (0, 20, 10, 5, 2, 0, -2, -5, -10, -20, -10, -5, -2, 0, 2, 5, 10, 20)
RATE = 0.3 * 20.0 * DEG
"""Steady rate of the turning ship."""


def turn(helm=20.0, duration=240.0, **more):
    settings = {"drift": 1.0, "loss": 2.0, "noise": 0.2 * DEG, "position_noise": 0.05, "psi_0": 1.0, **more}
    return sail(nomoto(0.3, 5.0), plan((0, 0.0), (40, helm * DEG)), duration, name="circle", **settings)


def spiral(yaw):
    return sail(
        yaw, plan(*((60.0 * i, d * DEG) for i, d in enumerate(SPIRAL))), 60.0 * len(SPIRAL), dt=0.2, h=0.05, noise=0.003
    )


def pull_out(yaw):
    orders = plan((0, 0.0), (10, 20 * DEG), (70, 0.0), (140, -20 * DEG), (200, 0.0))
    return sail(yaw, orders, 270.0, noise=0.003, h=0.02)


class Bech:
    """A helmsman who holds one yaw rate after the other."""

    def __init__(self, rates, hold):
        self.rates, self.hold, self.last, self.sum = rates, hold, 0.0, 0.0

    def __call__(self, t, psi):
        error = self.rates[min(int(t / self.hold + 1e-9), len(self.rates) - 1)] - (psi - self.last) / 0.1
        self.last, self.sum = psi, self.sum + 0.1 * error
        return 8.0 * error + 2.0 * self.sum


def test_a_turning_circle_in_a_current_has_the_figures_of_still_water():
    (still,) = ship_figures(turn(), Particulars(7.0))
    (drifting,) = ship_figures(turn(current=(0.05, -0.1), seed=3), Particulars(7.0))
    assert drifting["current"].reading.value == pytest.approx(math.hypot(0.05, 0.1), rel=0.02)
    for slug in ("advance", "transfer", "tactical-diameter", "steady-diameter"):
        one, other = still[slug].reading, drifting[slug].reading
        assert abs(one.value - other.value) < 4.0 * math.hypot(one.std, other.std) + 0.01 * one.value, slug


def test_the_figures_of_a_steady_turn_match_the_simulation():
    (sheet,) = ship_figures(turn(), Particulars(7.0))
    speed = 1.0 - 2.0 * RATE
    assert sheet["steady-speed"].reading.value == pytest.approx(speed, rel=0.01)
    assert sheet["steady-diameter"].reading.value == pytest.approx(2.0 * speed / RATE, rel=0.01)
    assert sheet["drift"].reading.value == pytest.approx(RATE, rel=0.03)
    assert sheet["speed-loss"].reading.value == pytest.approx(2.0 * RATE, rel=0.03)
    assert sheet["rate"].reading.value == pytest.approx(RATE, rel=1e-3)


def gaining(run, execute=40.0):
    """Return *run* with a speed that still increases by 0.3 m/s in the last 40 s of its approach."""
    missing = 0.00375 * np.maximum(execute - run["x"].t, 0.0) ** 2
    x, y = (replace(run[c], values=run[c].values + missing * trig(1.0)) for c, trig in (("x", np.cos), ("y", np.sin)))
    return replace(run, channels={**run.channels, "x": x, "y": y})


@pytest.mark.parametrize(
    ("loss", "gains", "slug"),
    [(-2.0, False, "thrust-while-steering"), (-2.0, True, "approach-not-steady"), (2.0, False, "")],
)
def test_a_circle_that_gains_speed_has_the_doubt_that_explains_it(loss, gains, slug):
    run = turn(loss=loss)
    (sheet,) = ship_figures(gaining(run) if gains else run, Particulars(7.0))
    assert (sheet["speed-loss"].reading.value < 0.0) is bool(slug)
    explained = {"thrust-while-steering", "approach-not-steady"} & {d.slug for d in sheet.doubts}
    assert explained == ({slug} if slug else set())


def test_advance_and_tactical_diameter_follow_from_the_track_itself():
    run = turn(noise=0.0, position_noise=0.0, psi_0=0.0, duration=120.0)
    (sheet,) = ship_figures(run, Particulars(7.0))
    x, y, r = run["x"].values, run["y"].values, run["psi"].values
    quarter, half = int((r >= 0.5 * math.pi).argmax()), int((abs(r) >= math.pi - 0.006).argmax())
    assert sheet["advance"].reading.value == pytest.approx(x[quarter] - 40.0, abs=0.1)
    assert sheet["transfer"].reading.value == pytest.approx(y[quarter], abs=0.1)
    assert sheet["tactical-diameter"].reading.value == pytest.approx(y[half], abs=0.1)


def test_a_circle_to_port_mirrors_one_to_starboard_and_a_short_one_has_a_doubt():
    (one,), (other,) = (
        ship_figures(turn(helm=h, duration=100.0, noise=0.0, position_noise=0.0)) for h in (20.0, -20.0)
    )
    assert other.title == "turning circle to port"
    for slug in ("advance", "transfer", "tactical-diameter"):
        assert one[slug].reading.value == pytest.approx(other[slug].reading.value, rel=1e-3)
    assert {d.slug for d in one.doubts} >= {"current-unknown"}


def test_a_ship_that_fails_the_turning_standard_is_reported():
    (sheet,) = ship_figures(turn(helm=35.0), Particulars(1.4))
    assert sheet["tactical-diameter-lengths"].verdict == "fails"
    assert ship_figures(turn(), Particulars(7.0))[0]["tactical-diameter-lengths"].verdict == "meets"


def test_a_turn_with_less_than_full_helm_cannot_fail_the_turning_standard():
    (sheet,) = ship_figures(turn(helm=20.0), Particulars(1.4))
    assert sheet["tactical-diameter-lengths"].reading.value > 5.0
    assert sheet["tactical-diameter-lengths"].limit is None


def test_a_stable_ships_spiral_is_one_line():
    (sheet,) = ship_figures(spiral(nomoto(0.3, 5.0, 0.01)))
    assert sheet.manoeuvre == "spiral"
    assert "directionally stable" in sheet.verdict
    assert sheet["slope"].reading.value == pytest.approx(0.3, rel=0.02)


def test_an_unstable_ships_spiral_shows_its_loop():
    (sheet,) = ship_figures(spiral(loop(0.3, 5.0, 400.0)))
    assert "directionally unstable" in sheet.verdict
    assert sheet["residual-rate"].reading.value == pytest.approx(1.0 / math.sqrt(400.0), rel=0.01)
    # r - 400 r^3 has its extremes at r = 1/sqrt(1200): the jump lies at 0.3 delta = 2/3 r, to each side
    width = 2.0 * 2.0 / 3.0 / math.sqrt(1200.0) / 0.3
    found = sheet["loop-width"].reading
    assert abs(found.value - width) < 2.5 * found.std


@pytest.mark.parametrize(("yaw", "word"), [(nomoto(0.3, 5.0), "stable"), (loop(0.3, 5.0, 400.0), "unstable")])
def test_a_reverse_spiral_gives_the_same_verdict(yaw, word):
    rates = [0.08, 0.06, 0.04, 0.025, 0.012, -0.012, -0.025, -0.04, -0.06, -0.08]
    run = sail(yaw, Bech(rates, 60.0), 600.0, h=0.02, noise=0.0)
    (sheet,) = ship_figures(run, manoeuvre="reverse-spiral")
    assert f"directionally {word}" in sheet.verdict
    if word == "unstable":
        assert sheet["residual-rate"].reading.value == pytest.approx(0.05, rel=0.03)
        assert sheet["loop-width"].reading.value == pytest.approx(4.0 / 3.0 / math.sqrt(1200.0) / 0.3, rel=0.05)


def test_a_pull_out_distinguishes_stable_unstable_and_trim():
    stable = {s.manoeuvre: s for s in ship_figures(pull_out(nomoto(0.3, 5.0, 0.01)))}["pull-out"]
    assert "directionally stable" in stable.verdict
    assert stable["offset"].reading.value == pytest.approx(0.003, abs=1e-4)
    unstable = {s.manoeuvre: s for s in ship_figures(pull_out(loop(0.3, 5.0, 400.0)))}["pull-out"]
    assert "directionally unstable" in unstable.verdict
    assert unstable["residual-rate"].reading.value == pytest.approx(0.05, rel=0.01)


def test_a_pull_out_from_one_side_does_not_determine_stability():
    run = sail(nomoto(0.3, 5.0), plan((0, 0.0), (10, 20 * DEG), (70, 0.0)), 140.0, noise=0.003)
    (sheet,) = ship_figures(run, manoeuvre="pull-out")
    assert "not determined" in sheet.verdict
    assert "one-side" in {d.slug for d in sheet.doubts}


def test_the_imo_limits_match_msc_137():
    assert [math.degrees(first_overshoot_limit(s)) for s in (5.0, 20.0, 40.0)] == pytest.approx([10.0, 15.0, 20.0])
    assert [math.degrees(second_overshoot_limit(s)) for s in (5.0, 20.0, 40.0)] == pytest.approx([25.0, 32.5, 40.0])


def test_a_figure_at_its_limit_is_left_open():
    assert judged("a", "a", Reading(4.45, 0.1), 4.5).verdict == "open"
    assert judged("a", "a", Reading(4.2, 0.1), 4.5).verdict == "meets"
    assert judged("a", "a", Reading(4.8, 0.1), 4.5).verdict == "fails"
    assert judged("a", "a", Reading(math.nan, 0.1), 4.5).verdict == "open"


def test_records_without_the_needed_channels_are_rejected():
    run = turn()
    without = run.__class__("no-track", {n: run[n] for n in ("psi", "delta")})
    with pytest.raises(NotInformative, match="no positions"):
        ship_figures(without)
    with pytest.raises(MissingChannel, match="heading"):
        ship_figures(run.__class__("no-heading", {n: run[n] for n in ("x", "delta")}))
    with pytest.raises(UnknownName, match="zig-zag"):
        ship_figures(run, manoeuvre="zigzag")
