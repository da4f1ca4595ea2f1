"""Previews on the nominal plant: it gains speed, turns after a delay, sways and leaves its envelope."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from gcs_autotune.craft import Actuate, DepthTarget, HeadingTarget
from gcs_autotune.manoeuvres import SPEED_TIME, Envelope, NominalPlant, OpenLoopProgramme, Relay, RelaySettings, preview
from gcs_autotune.manoeuvres.preview import _pushed, _steered
from gcs_autotune.models import SingleDof
from gcs_autotune.report import preview_document, to_html
from gcs_autotune.workflow.excursion import Ahead

FREE = Envelope(heading_excursion=math.inf, speed=math.inf)
YAW = SingleDof("yaw", "1", 1.25, 1.0, delay=0.5)


def held(seconds: float = 20.0, **forces: float) -> OpenLoopProgramme:
    return OpenLoopProgramme("held", lambda t: forces, seconds, force=next(iter(forces)))


def test_the_nominal_plant_gains_and_loses_speed_with_one_time_constant() -> None:
    craft = NominalPlant(YAW, 1.5, "a test")
    seen = preview(held(X=0.4), craft, FREE)
    u, t = seen.trial["u"].values, seen.trial["u"].t
    assert u == pytest.approx(1.5 * -np.expm1(-t / SPEED_TIME), abs=0.02)
    assert SPEED_TIME == 3.0
    coasting = preview(held(X=0.0), craft, FREE, way=1.5)
    assert coasting.trial["u"].values == pytest.approx(1.5 * np.exp(-t / SPEED_TIME), abs=0.02)
    assert seen.room == pytest.approx(float(np.trapezoid(u, t)), abs=0.1)
    assert seen.summary().startswith("20 s, 26 m of free water, 0 deg of turning (predicted from a test)")


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_nominal_plant_turns_as_its_model_after_its_delay(sign: float) -> None:
    seen = preview(held(N=0.3 * sign), NominalPlant(YAW, 0.0, "a test"), FREE)
    r, t = seen.trial["r"].values, seen.trial["r"].t
    late = np.maximum(t - 0.5, 0.0)
    assert r == pytest.approx(sign * 0.3 * -np.expm1(-late / 1.25), abs=0.003)
    assert seen.turned == pytest.approx(abs(float(np.trapezoid(r, t))), abs=0.02)
    assert seen.deep == 0.0
    assert "z" not in seen.trial.channels
    assert "deg of turning at up to roughly 17 deg/s (predicted from" in seen.summary()


def test_a_preview_beyond_the_turn_rate_limit_is_rejected() -> None:
    craft = NominalPlant(YAW, 0.0, "a test")
    slow = replace(FREE, turn_rate=math.radians(15.0))
    assert "'turn rate' tripped" in preview(held(N=0.3), craft, slow).refusal
    assert not preview(held(N=0.2), craft, slow).refusal


@pytest.mark.parametrize(("force", "signal"), [("Y", "y"), ("Z", "z")])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_nominal_plant_moves_only_along_forces_it_has_a_model_for(force: str, signal: str, sign: float) -> None:
    along = SingleDof({"Y": "sway", "Z": "heave"}[force], "1", 2.0, 1.0, 0.5, delta=0.1)
    answers = NominalPlant(YAW, 1.0, "a test", others={force: along})
    seen = preview(held(**{force: 0.4 * sign}), answers, FREE, floats=False)
    x = seen.trial[signal].values
    steady = along.steady_velocity(0.4 * sign)
    assert np.diff(x)[-1] / 0.1 == pytest.approx(steady, rel=0.01)
    assert seen.deep == pytest.approx(np.ptp(x) if force == "Z" else 0.0)
    assert seen.room == pytest.approx(np.ptp(x) if force == "Y" else 0.0)
    still = preview(held(**{force: 0.4 * sign}), NominalPlant(YAW, 1.0, "a test"), FREE, floats=False)
    assert np.ptp(still.trial[signal].values) == 0.0


def test_going_ahead_on_a_bearing_moves_north_and_east() -> None:
    def turn_then_go(t: float) -> dict[str, float]:
        return {"N": 0.5 if t < 4.0 else 0.0, "X": 1.0}

    seen = preview(OpenLoopProgramme("bend", turn_then_go, 30.0), NominalPlant(YAW, 1.0, "a test"), FREE)
    psi = seen.trial["psi"].values[-1]
    x, y = (np.diff(seen.trial[n].values)[-1] / 0.1 for n in ("x", "y"))
    assert (x, y) == (pytest.approx(math.cos(psi), abs=0.01), pytest.approx(math.sin(psi), abs=0.01))
    assert psi > 1.0


def test_a_preview_that_leaves_the_envelope_ends_there_and_names_the_limit() -> None:
    seen = preview(held(X=1.0), NominalPlant(YAW, 1.0, "a test"), Envelope(distance=5.0))
    assert seen.outcome is None
    assert "distance from start" in seen.refusal
    assert "actuators" not in seen.refusal
    assert seen.trouble == seen.refusal
    assert seen.room == pytest.approx(5.0, abs=0.2)
    good = preview(held(X=1.0), NominalPlant(YAW, 1.0, "a test"), Envelope(distance=50.0))
    assert good.trouble == ""
    assert good.outcome is not None
    assert good.seconds == pytest.approx(20.0, abs=0.2)


@pytest.mark.parametrize("known", [True, False])
def test_a_heading_target_is_reached_with_the_thrust_for_its_speed(known: bool) -> None:
    ahead = SingleDof("surge", "1", 3.0, 0.2, 0.1)
    craft = NominalPlant(YAW, 1.0, "a test", others={"X": ahead} if known else {})
    for psi, side in ((0.3, -1.0), (0.5, 0.0), (0.7, 1.0)):
        command = _steered(HeadingTarget(0.5, 1.5), craft, 1.0 - psi, 0.0, 0.0)
        assert command.X == pytest.approx((0.2 + 0.1 * 1.5) * 1.5 if known else 1.0)
        assert np.sign(round(command.N, 9)) == side
    assert _steered(HeadingTarget(0.5, 0.0), craft, 0.5, 0.0, 0.0) == Actuate()
    assert _steered(Actuate(Y=0.3), craft, 0.5, 0.0, 0.0) == Actuate(Y=0.3)
    assert _steered(DepthTarget(2.0), craft, 0.5, 0.0, 0.0) == Actuate()


def test_the_gain_of_the_speed_loop_shortens_the_acceleration() -> None:
    surge = {"X": SingleDof("surge", "1", 1.0, 0.2, 0.1)}
    plain = NominalPlant(YAW, 1.5, "a test", others=surge)
    first = [
        int(np.argmax(preview(Ahead(1.0, 30.0), craft, FREE).trial["u"].values > 0.95))
        for craft in (plain, replace(plain, speed_gain=0.5))
    ]
    assert 0 < first[1] < 0.7 * first[0]


def test_a_hand_push_heels_by_17_degrees_and_the_roll_decays() -> None:
    t = np.linspace(10.0, 40.0, 3001)
    tilt = np.array([_pushed(float(v)) for v in t])
    assert (_pushed(9.99), tilt[0], float(np.max(np.abs(tilt)))) == (0.0, 0.3, 0.3)
    assert np.min(tilt) < -0.15
    assert abs(tilt[-1]) < 1e-4


def test_surfacing_in_a_preview_is_reported() -> None:
    up = NominalPlant(YAW, 0.0, "a test", others={"Z": SingleDof("heave", "1", 1.0, 1.0)})
    seen = preview(held(Z=-0.5), up, FREE, floats=False, depth=2.0)
    assert seen.refusal == "the craft would surface from 2.0 m. Start deeper, or use less output"
    assert preview(held(Z=-0.5), up, Envelope(depth_excursion=20.0), floats=False, depth=15.0).trouble == ""
    assert preview(held(Z=0.5), up, Envelope(depth_excursion=20.0), floats=False, depth=0.1).trouble == ""


def relay_of(output: float) -> Relay:
    return Relay(RelaySettings("psi", "N", output=output, hysteresis=math.radians(10.0)))


def test_the_preview_of_a_relay_shows_its_limit_cycle_if_the_model_is_known() -> None:
    seen = preview(relay_of(0.4), NominalPlant(YAW, 0.0, "a test"), FREE)
    cycle = seen.cycle()
    assert cycle is not None
    switched = [mark.t for mark in seen.trial.marks if mark.kind == "switch"]
    settled = seen.trial["psi"].between(switched[-5], switched[-1]).values
    assert cycle.X_m == pytest.approx(0.5 * float(np.ptp(settled)), rel=0.10)
    assert cycle.period == pytest.approx(0.5 * (switched[-1] - switched[-5]), rel=0.10)
    size = f"limit cycle at 40 % output: amplitude {math.degrees(cycle.X_m):.3g} deg, period {cycle.period:.3g} s"
    assert size in seen.summary()
    assert preview(relay_of(0.4), NominalPlant(YAW, 0.0, "a guess", assumed=True), FREE).cycle() is None


def test_the_page_of_a_preview_plots_the_limit_cycle_of_a_relay() -> None:
    seen = preview(relay_of(0.4), NominalPlant(YAW, 0.0, "a test"), FREE)
    cycle = seen.cycle()
    assert cycle is not None and seen.motion is not None
    runs = [("relay", seen.trial, seen.summary(), "")]
    page = to_html(preview_document("Preview", "2026-11-20T12:00:00", runs, {"relay": (seen.motion, cycle)}))
    assert "Limit cycle of relay" in page and "-1/N(X) of the relay" in page
    assert page.count("<svg") == to_html(preview_document("Preview", "2026-11-20T12:00:00", runs)).count("<svg") + 1
