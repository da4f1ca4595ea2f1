"""Layered manoeuvres on the nominal plant: each keeps its path, and an infeasible one ends with the number."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from gcs_autotune.control import AxisLoop, Uncertainty, design_own
from gcs_autotune.craft import Actuate, Observation
from gcs_autotune.errors import UsageError
from gcs_autotune.limits import limit_of
from gcs_autotune.manoeuvres import (
    MANOEUVRES,
    Envelope,
    FaceWall,
    FollowWall,
    Layered,
    NominalPlant,
    OwnLoops,
    PlantState,
    Preview,
    Trajectory,
    preview,
    read_points,
)
from gcs_autotune.models import SingleDof
from gcs_autotune.seatrials import ship_figures

FREE = Envelope(heading_excursion=math.inf, depth_excursion=math.inf, distance=1000.0)
ROV = {
    "yaw": SingleDof("yaw", "1", 0.1, 0.1, 0.1),
    "surge": SingleDof("surge", "1", 0.4, 0.5, 1.0),
    "sway": SingleDof("sway", "1", 0.5, 0.6, 1.5),
    "heave": SingleDof("heave", "1", 0.6, 0.6, 1.5),
}
BOAT = {"yaw": SingleDof("yaw", "1", 2.0, 1.5), "surge": SingleDof("surge", "1", 1.0, 0.1, 0.2)}


def loops(models: dict[str, SingleDof]) -> dict[str, AxisLoop]:
    steps = {"yaw": 0.5, "surge": 2.0 if models is BOAT else 0.3, "sway": 0.3, "heave": 0.3}
    return {
        dof: AxisLoop(design_own(m, Uncertainty(0.1, 0.2), step=steps[dof], limits=(-0.9, 0.9)), float)
        for dof, m in models.items()
    }


VECTORED = OwnLoops(loops(ROV))
STEERED = OwnLoops(loops({dof: m for dof, m in ROV.items() if dof != "sway"}))
RUDDER = OwnLoops(loops(BOAT), throttle=0.5, under_way=True, spot=False)


def flown(name: str, own: OwnLoops, **options: float) -> Preview:
    kind = MANOEUVRES[name]
    assert kind.make is not None
    rows = {option: limit_of(option) for option in kind.options}
    usual = {option: row.default * row.factor for option, row in rows.items() if row.default is not None}
    manoeuvre = kind.make({"speed": 0.0, "throttle": 0.0, **usual, **options})
    assert isinstance(manoeuvre, Layered | FollowWall)
    return on_water(manoeuvre, own)


def on_water(manoeuvre: Layered | FollowWall, own: OwnLoops) -> Preview:
    models = BOAT if own.under_way else ROV
    others = {m.axis.force: m for dof, m in models.items() if dof != "yaw"}
    plant = NominalPlant(models["yaw"], 1.0, "a test", others=others)
    begins = PlantState(u=1.2) if own.under_way else PlantState(z=2.0)
    return preview(manoeuvre.over(own), plant, FREE, floats=own.under_way, begins=begins)


def figures(seen: Preview) -> dict[str, float]:
    assert seen.outcome is not None
    assert seen.outcome.ending == "completed", seen.outcome
    (sheet,) = ship_figures(seen.trial)
    return {figure.slug: figure.reading.value for figure in sheet.figures}


def test_a_vectored_craft_hovers() -> None:
    found = figures(flown("hover", VECTORED, duration=20.0))
    assert found["target-rms"] < 0.01
    assert found["heading-rms"] < 0.01


@pytest.mark.parametrize("own", [VECTORED, STEERED], ids=["vectored", "steered"])
def test_an_rov_goes_to_a_point_and_stops_there(own: OwnLoops) -> None:
    found = figures(flown("goto", own, ahead=5.0, starboard=4.0))
    assert found["arrival"] < 0.1
    assert found["path-most"] < 0.3


def test_a_boat_passes_its_point() -> None:
    found = figures(flown("goto", RUDDER, ahead=60.0, starboard=30.0, speed=1.2))
    assert found["arrival"] < 0.5


@pytest.mark.parametrize("own", [VECTORED, STEERED, RUDDER], ids=["vectored", "steered", "rudder"])
@pytest.mark.parametrize("turn", [math.pi / 2, -2.0])
def test_every_craft_turns_to_a_heading(own: OwnLoops, turn: float) -> None:
    seen = flown("orientation", own, **{"heading-change": turn})
    assert figures(seen)["heading-rms"] < math.radians(3.0)
    assert seen.trial["psi"].values[-1] == pytest.approx(turn, abs=math.radians(2.0))
    assert (seen.room > 5.0) == own.under_way


@pytest.mark.parametrize("own", [VECTORED, STEERED], ids=["vectored", "steered"])
def test_an_rov_follows_timed_points(own: OwnLoops) -> None:
    manoeuvre = Trajectory(read_points("20,4,0 40,4,4 60,0,4"))
    found = figures(on_water(manoeuvre, own))
    assert found["target-rms"] < (0.05 if own is VECTORED else 0.5)
    assert found["arrival"] < 0.2


def test_a_boat_follows_timed_points() -> None:
    found = figures(on_water(Trajectory(read_points("30,30,0 60,60,20 90,80,45")), RUDDER))
    assert found["path-rms"] < 1.0
    assert found["target-rms"] < 2.0


@pytest.mark.parametrize("own", [VECTORED, STEERED], ids=["vectored", "steered"])
def test_an_rov_keeps_a_plane_while_it_moves(own: OwnLoops) -> None:
    seen = flown("plane", own, depth=3.0, ahead=6.0)
    found = figures(seen)
    assert found["depth-rms"] < 0.1
    assert found["arrival"] < 0.2
    assert seen.trial["z"].values[-1] == pytest.approx(3.0, abs=0.05)


@pytest.mark.parametrize("sideways", [True, False], ids=["sideways", "vertically"])
def test_a_craft_moves_along_a_wall_and_keeps_its_distance(sideways: bool) -> None:
    """The wall is flat and ahead; both rangefinders see it."""
    own = OwnLoops({dof: loop for dof, loop in VECTORED.loops.items() if dof != ("heave" if sideways else "sway")})
    manoeuvre = FollowWall(1.5, 1.0, 0.1).over(own)
    x = y = psi = u = v = w = r = 0.0
    z, t, dt, seen = 2.0, 0.0, 0.1, []

    def observed() -> Observation:
        ahead = (4.0 - x) / math.cos(psi) + 1e-4 * math.sin(37.0 * t)  # a real one never repeats itself exactly
        return Observation(
            t, psi, r, x=x, y=y, z=z, u=u, v=v, w=w, speed=u,
            d=ahead + 0.1 * math.tan(psi), d_starboard=ahead - 0.1 * math.tan(psi),
        )  # fmt: skip

    commands = manoeuvre.commands(observed())
    command = next(commands)
    while manoeuvre.outcome is None and t < 300.0:
        assert isinstance(command, Actuate)
        rates = {"surge": (command.X, u), "sway": (command.Y, v), "heave": (command.Z, w), "yaw": (command.N, r)}
        u, v, w, r = (
            nu + dt * (tau - (ROV[dof].beta + ROV[dof].beta_quadratic * abs(nu)) * nu) / ROV[dof].alpha
            for dof, (tau, nu) in rates.items()
        )
        x += dt * (u * math.cos(psi) - v * math.sin(psi))
        y += dt * (u * math.sin(psi) + v * math.cos(psi))
        z, psi, t = z + dt * w, psi + dt * r, t + dt
        if manoeuvre.phase == "along":
            seen.append(4.0 - x)
        command = commands.send(observed())
    assert manoeuvre.outcome is not None
    assert manoeuvre.outcome.ending == "completed"
    assert np.mean(np.abs(np.array(seen) - 1.5)) < 0.1
    assert (y if sideways else z - 2.0) == pytest.approx(1.0, abs=0.15)


def test_a_wall_that_is_lost_for_too_long_ends_the_manoeuvre() -> None:
    manoeuvre = FollowWall(math.nan, 1.0, 0.1).over(VECTORED)
    here = Observation(0.0, 0.0, 0.0, x=0.0, y=0.0, z=2.0, u=0.0, v=0.0, w=0.0, speed=0.0, d=2.0, d_starboard=2.0)
    commands = manoeuvre.commands(here)
    next(commands)
    for k in range(1, 400):
        wall = 2.0 + 0.001 * (k % 2) if k < 100 else math.nan
        commands.send(replace(here, t=0.1 * k, d=wall, d_starboard=wall))
        if manoeuvre.outcome is not None:
            break
    assert manoeuvre.outcome is not None
    assert "have not seen the wall for 10 s" in manoeuvre.outcome.reason


# --- what a craft cannot do -----------------------------------------------------------------------------------------


def test_a_craft_that_does_not_face_the_wall_turns_to_it_before_the_distance_is_used() -> None:
    commands, t, psi, r, pushed = None, 0.0, 1.1, 0.0, 0.0
    face = FaceWall(0.0)
    for _ in range(400):
        now = Observation(t, psi, r, z=2.0, w=0.0, d=2.0 if abs(psi) < 0.7 else math.nan)
        if commands is None:
            commands = face.commands(now)
            command = next(commands)
        else:
            command = commands.send(now)
        assert isinstance(command, Actuate)
        pushed = max(pushed, abs(command.X))
        if face.outcome is not None:
            break
        r += 0.1 * (1.4 * command.N - 0.4 * r)
        psi, t = psi + 0.1 * r, t + 0.1
    assert face.outcome is not None
    assert face.outcome.reason == "faces the wall, 2.00 m ahead"
    assert (abs(psi) < math.radians(5.0), pushed) == (True, 0.0)


def test_a_wall_that_is_not_ahead_ends_the_turn_to_it() -> None:
    face = FaceWall(0.0)
    commands = face.commands(Observation(0.0, 0.0, 0.0))
    next(commands)
    for k in range(1, 620):
        if face.outcome is None:
            commands.send(Observation(0.1 * k, 0.0, 0.0))
    assert face.outcome is not None
    assert face.outcome.reason == ("after 60 s the heading is 0 deg off and the rangefinders do not see the wall")


def why(seen: Preview) -> str:
    assert seen.outcome is not None
    assert seen.outcome.ending == "aborted"
    assert not any(seen.trial[force].values.any() for force in "XYZN")
    return seen.outcome.reason


def test_a_trajectory_faster_than_the_craft_is_rejected_with_a_speed_limit() -> None:
    assert "m/s. Use at most --speed" in why(on_water(Trajectory(read_points("5,20,0")), VECTORED))


def test_a_corner_tighter_than_the_turning_circle_is_rejected_with_both_radii() -> None:
    reason = why(on_water(Trajectory(read_points("20,20,0 40,0,0.5")), RUDDER))
    assert "tighter than the turning circle of" in reason


def test_a_point_inside_the_turning_circle_is_rejected_with_the_nearest_reachable_one() -> None:
    assert "Use a point at least" in why(flown("goto", RUDDER, ahead=0.5, starboard=1.0, speed=1.2))


@pytest.mark.parametrize("lost", ["x", "psi", "u", "v", "r"])
def test_a_lost_signal_ends_the_manoeuvre_with_neutral_outputs(lost: str) -> None:
    kind = MANOEUVRES["hover"]
    assert kind.make is not None
    manoeuvre = kind.make({"duration": 20.0})
    assert isinstance(manoeuvre, Layered)
    here = Observation(0.0, 0.0, 0.0, x=0.0, y=0.0, z=2.0, u=0.0, v=0.0, w=0.0, speed=0.0)
    commands = manoeuvre.over(VECTORED).commands(here)
    next(commands)
    assert commands.send(replace(here, t=0.1, **{lost: math.nan})) == Actuate()
    assert manoeuvre.outcome is not None
    assert manoeuvre.outcome.ending == "aborted"


def test_a_craft_carried_away_by_a_current_is_stopped() -> None:
    kind = MANOEUVRES["hover"]
    assert kind.make is not None
    manoeuvre = kind.make({"duration": 60.0})
    assert isinstance(manoeuvre, Layered)
    here = Observation(0.0, 0.0, 0.0, x=0.0, y=0.0, z=2.0, u=0.0, v=0.0, w=0.0, speed=0.0)
    commands = manoeuvre.over(VECTORED).commands(here)
    next(commands)
    assert commands.send(replace(here, t=0.1, y=6.0)) == Actuate()
    assert manoeuvre.outcome is not None
    assert "6.0 m from its target" in manoeuvre.outcome.reason


@pytest.mark.parametrize("text", ["", "10,1", "a,b,c", "10,1,nan", "10,1,1 5,2,2", "0,1,1"])
def test_invalid_points_are_rejected(text: str) -> None:
    with pytest.raises(UsageError, match="--points"):
        read_points(text)
