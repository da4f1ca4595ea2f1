"""A boat comes back to where it began, or says why not; rough water is not called calm."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from gcs_autotune.craft import Actuate
from gcs_autotune.manoeuvres import CalmCheck, ComeBack, ComeToRest, Envelope, NominalPlant, preview
from gcs_autotune.manoeuvres.between_runs import CALM, DAMPING, GAIN, LEAST_WAY, LOOK, MOST, REST, SPARE, STILL, WAIT
from gcs_autotune.models import SingleDof

from .pond import PondCraft, answered, at_rest

FREE = Envelope(heading_excursion=math.inf)


@pytest.mark.parametrize("bearing", [0.0, 1.5, 3.1, -2.0])
@pytest.mark.parametrize(("gain", "lag"), [(0.2, 3.3), (0.6, 0.6), (1.5, 2.0)])
def test_from_any_bearing_quick_and_slow_boats_come_back_without_weaving(
    gain: float, lag: float, bearing: float
) -> None:
    boat = NominalPlant(SingleDof("yaw", "1", lag / gain, 1.0 / gain), 1.0, "a test")
    seen = preview(ComeBack(50.0 * math.cos(bearing), 50.0 * math.sin(bearing), 0.5), boat, FREE)
    assert seen.outcome is not None
    assert seen.outcome.reason.startswith("returned to 5 m from the start")
    N = seen.trial["N"].values
    assert np.count_nonzero(np.diff(np.sign(N[np.abs(N) > 0.1]))) <= 2


def test_a_boat_without_a_position_and_one_that_makes_no_way_say_so() -> None:
    lost = ComeBack(10.0, 0.0, 0.5)
    next(lost.commands(at_rest(x=math.nan)))
    assert lost.outcome is not None
    assert "reports no position" in lost.outcome.reason
    still = preview(ComeBack(30.0, 0.0, 0.5), NominalPlant(SingleDof("yaw", "1", 1.0, 1.0), 0.0, "a test"), FREE)
    assert still.outcome is not None
    assert still.outcome.ending == "stopped"
    assert "still 30 m from the start after 160 s" in still.outcome.reason


@pytest.mark.parametrize(("roll", "ending"), [(1.0, "completed"), (6.0, "aborted")])
def test_rolling_water_is_waited_for_and_then_refused(roll: float, ending: str) -> None:
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
def test_the_rudder_turns_the_bow_towards_the_place_by_the_shorter_way_damped_and_limited(side: float) -> None:
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


def test_a_boat_is_back_within_a_few_metres_and_given_the_time_that_the_distance_takes() -> None:
    near = ComeBack(3.0, 4.0, 0.5)
    next(near.commands(at_rest()))
    assert near.outcome is not None
    assert near.outcome.ending == "completed"
    away = ComeBack(30.0, 40.0, 0.5)
    rows = answered(away, lambda t, command: at_rest(t=t))
    assert rows[-1][0].t == math.floor(2.0 * (SPARE + 50.0 / LEAST_WAY)) / 2.0 + 0.5
    driven = ComeBack(0.0, 0.0, 0.5)
    rows = answered(driven, lambda t, command: at_rest(t=t, x=60.0 if t >= 5.0 else 6.0))
    assert rows[-1][0].t == SPARE + 60.0 / LEAST_WAY + 0.5, "farther away it is given more"


@pytest.mark.parametrize("axis", ["phi", "theta"])
@pytest.mark.parametrize(("share", "ending"), [(0.98, "completed"), (1.02, "aborted")])
def test_water_is_calm_when_roll_and_pitch_are_about_their_means(axis: str, share: float, ending: str) -> None:
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
def test_a_craft_with_hardly_any_drag_is_brought_to_rest_by_a_light_hand(rate: float) -> None:
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


def test_what_comes_to_rest_before_a_step_in_depth_tells_its_depth_and_what_drives_that() -> None:
    now = replace(at_rest(z=2.5), output={"N": 0.1, "Z": 0.3})
    assert ComeToRest("z", "Z").progress(now).signal == "z"
    assert (ComeToRest("z", "Z").progress(now).value, ComeToRest("z", "Z").progress(now).output) == (2.5, 0.3)
    assert ComeToRest().progress(now).signal == "psi"


@pytest.mark.parametrize(
    ("seen", "seconds"),
    [({"r": 0.0, "w": 0.0}, 1.0), ({"r": 0.0, "w": math.nan}, 1.0), ({"r": 0.05}, REST), ({"w": 0.1}, REST)],
)
def test_a_craft_that_lies_still_is_not_waited_for_and_one_that_never_does_not_for_ever(
    seen: dict[str, float], seconds: float
) -> None:
    rest = ComeToRest()
    commands = rest.commands(at_rest(**seen))
    next(commands)
    ticks = 0
    while rest.outcome is None:
        ticks += 1
        commands.send(at_rest(t=0.1 * ticks, **seen))
    assert rest.outcome.ending == "completed"
    assert 0.1 * ticks == pytest.approx(seconds, abs=0.15)


def test_single_readings_of_a_craft_that_swings_about_rest_in_a_dead_band_keep_nobody_waiting() -> None:
    rest = ComeToRest()
    rows = answered(rest, lambda t, command: at_rest(t=t, r=1.2 * STILL[0] * math.sin(6.0 * t)))
    assert rest.outcome is not None
    assert rest.outcome.reason == "at rest"
    assert rows[-1][0].t < 3.0
