"""A boat returns to its start or reports why it did not; rough water is not reported as calm."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from gcs_autotune.craft import Actuate
from gcs_autotune.manoeuvres import CalmCheck, ComeBack, ComeToRest, Envelope, NominalPlant, preview
from gcs_autotune.manoeuvres.between_runs import CALM, DAMPING, GAIN, LEAST_WAY, LOOK, MOST, REST, SPARE, STILL, WAIT
from gcs_autotune.models import SingleDof

from .toy_craft import PondCraft, answered, at_rest

FREE = Envelope(heading_excursion=math.inf)


@pytest.mark.parametrize("bearing", [0.0, 1.5, 3.1, -2.0])
@pytest.mark.parametrize(("gain", "lag"), [(0.2, 3.3), (0.6, 0.6), (1.5, 2.0)])
def test_fast_and_slow_boats_return_from_any_bearing_without_weaving(gain: float, lag: float, bearing: float) -> None:
    boat = NominalPlant(SingleDof("yaw", "1", lag / gain, 1.0 / gain), 1.0, "a test")
    seen = preview(ComeBack(50.0 * math.cos(bearing), 50.0 * math.sin(bearing), 0.5), boat, FREE)
    assert seen.outcome is not None
    assert seen.outcome.reason.startswith("returned to 5 m from the start")
    N = seen.trial["N"].values
    assert np.count_nonzero(np.diff(np.sign(N[np.abs(N) > 0.1]))) <= 2


def test_a_missing_position_and_missing_headway_are_reported() -> None:
    lost = ComeBack(10.0, 0.0, 0.5)
    next(lost.commands(at_rest(x=math.nan)))
    assert lost.outcome is not None
    assert "reports no position" in lost.outcome.reason
    still = preview(ComeBack(30.0, 0.0, 0.5), NominalPlant(SingleDof("yaw", "1", 1.0, 1.0), 0.0, "a test"), FREE)
    assert still.outcome is not None
    assert still.outcome.ending == "stopped"
    assert "still 30 m from the start after 160 s" in still.outcome.reason


@pytest.mark.parametrize(("roll", "ending"), [(1.0, "completed"), (6.0, "aborted")])
def test_the_calm_check_waits_for_rolling_to_stop_and_then_aborts(roll: float, ending: str) -> None:
    check = CalmCheck()
    commands = check.commands(at_rest(phi=0.0, theta=0.0))
    command = next(commands)
    for k in range(1, 700):
        if check.outcome is not None:
            break
        assert command == Actuate()
        command = commands.send(at_rest(t=0.1 * k, phi=math.radians(roll) * math.sin(0.2 * k), theta=0.0))
    assert check.outcome is not None
    assert check.outcome.ending == ending
    assert "deg" in check.outcome.reason


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_rudder_turns_the_bow_to_the_target_the_short_way_with_damping_and_a_limit(side: float) -> None:
    def steering(**seen: float) -> Actuate:
        command = next(ComeBack(0.0, 20.0 * side, 0.5).commands(at_rest(**seen)))
        assert isinstance(command, Actuate)
        return command

    assert steering(psi=0.9 * side * math.pi / 2.0) == Actuate(
        X=0.5, N=pytest.approx(side * GAIN * 0.1 * math.pi / 2.0)
    )
    assert steering(psi=side * math.pi / 2.0, r=0.2) == Actuate(X=0.5, N=pytest.approx(-DAMPING * 0.2))
    assert steering(psi=side * math.pi / 2.0, r=math.nan).N == pytest.approx(0.0)
    assert steering(psi=0.0).N == side * MOST
    assert steering(psi=side * 1.4 * math.pi).N == -side * MOST
    assert steering(psi=math.nan).N == 0.0


def test_a_return_ends_within_a_few_metres_and_its_timeout_grows_with_distance() -> None:
    near = ComeBack(3.0, 4.0, 0.5)
    next(near.commands(at_rest()))
    assert near.outcome is not None
    assert near.outcome.ending == "completed"
    away = ComeBack(30.0, 40.0, 0.5)
    rows = answered(away, lambda t, command: at_rest(t=t))
    assert rows[-1][0].t == math.floor(2.0 * (SPARE + 50.0 / LEAST_WAY)) / 2.0 + 0.5
    driven = ComeBack(0.0, 0.0, 0.5)
    rows = answered(driven, lambda t, command: at_rest(t=t, x=60.0 if t >= 5.0 else 6.0))
    assert rows[-1][0].t == SPARE + 60.0 / LEAST_WAY + 0.5, "the timeout grows with the distance"


@pytest.mark.parametrize("axis", ["phi", "theta"])
@pytest.mark.parametrize(("share", "ending"), [(0.98, "completed"), (1.02, "aborted")])
def test_water_is_calm_when_roll_and_pitch_stay_near_their_means(axis: str, share: float, ending: str) -> None:
    check = CalmCheck()
    rows = answered(check, lambda t, command: at_rest(t=t, **{axis: 0.3 + share * CALM * (-1.0) ** round(2.0 * t)}))
    assert check.outcome is not None
    assert check.outcome.ending == ending
    assert rows[-1][0].t == (LOOK if ending == "completed" else WAIT + 0.5)
    rough = CalmCheck()
    rows = answered(rough, lambda t, command: at_rest(t=t, **{axis: 0.3 * (t < 20.0) * (-1.0) ** round(2.0 * t)}))
    assert rough.outcome is not None
    assert rough.outcome.ending == "completed"
    assert 20.0 < rows[-1][0].t <= 20.0 + LOOK


@pytest.mark.parametrize("rate", [0.6, -0.6])
def test_a_craft_with_little_drag_is_brought_to_rest_gently(rate: float) -> None:
    pond = PondCraft(gain=1.5, drag=0.0)
    pond.mode, pond.r = "MANUAL", rate
    rest, begun = ComeToRest(), pond.clock.now()
    commands = rest.commands(pond.observe())
    command = next(commands)
    while rest.outcome is None:
        pond.send(command)
        command = commands.send(pond.observe())
    assert rest.outcome.reason == "at rest"
    assert abs(pond.r) <= 1.5 * STILL[0], "the rms of a second is within"
    assert 2.0 < pond.clock.now() - begun < REST


def test_coming_to_rest_before_a_depth_step_shows_depth_and_vertical_output() -> None:
    now = replace(at_rest(z=2.5), output={"N": 0.1, "Z": 0.3})
    assert ComeToRest("z", "Z").progress(now).signal == "z"
    assert (ComeToRest("z", "Z").progress(now).value, ComeToRest("z", "Z").progress(now).output) == (2.5, 0.3)
    assert ComeToRest().progress(now).signal == "psi"


@pytest.mark.parametrize(
    ("seen", "seconds"),
    [({"r": 0.0, "w": 0.0}, 1.0), ({"r": 0.0, "w": math.nan}, 1.0), ({"r": 0.05}, REST), ({"w": 0.1}, REST)],
)
def test_the_wait_for_rest_is_short_when_at_rest_and_limited_otherwise(seen: dict[str, float], seconds: float) -> None:
    rest = ComeToRest()
    commands = rest.commands(at_rest(**seen))
    next(commands)
    ticks = 0
    while rest.outcome is None:
        ticks += 1
        commands.send(at_rest(t=0.1 * ticks, **seen))
    assert rest.outcome.ending == "completed"
    assert 0.1 * ticks == pytest.approx(seconds, abs=0.15)


def test_small_oscillations_about_rest_do_not_prolong_the_wait() -> None:
    rest = ComeToRest()
    rows = answered(rest, lambda t, command: at_rest(t=t, r=1.2 * STILL[0] * math.sin(6.0 * t)))
    assert rest.outcome is not None
    assert rest.outcome.reason == "at rest"
    assert rows[-1][0].t < 3.0
