"""Effects of the surroundings in the simulator, against laws derived by hand."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from sitl import open_vehicle
from sitl.catalogue import load_vehicle
from sitl.check import check_vehicle
from sitl.craft import Craft
from sitl.effects import BadEffect, make_effect, parse_effect
from sitl.effects.effect import Setting
from sitl.open_loop import Hull, open_loop
from sitl.plants import State, Water, Wrench

PLANE = Hull(
    ("surge", "sway", "yaw"), {"surge": 10.0, "sway": 15.0, "yaw": 2.0}, {"surge": 5.0, "sway": 10.0, "yaw": 2.0}
)
DIVER = Hull(
    ("surge", "heave", "yaw"), {"surge": 10.0, "heave": 12.0, "yaw": 2.0}, {"surge": 5.0, "heave": 6.0, "yaw": 2.0}
)


def drift(hull, text, measured, **more):
    """Fly a hull without commands for 20 s with the effect that *text* describes."""
    still = {"X": np.zeros(200)}
    return open_loop(
        hull, still, duration=20.0, interval=0.1, measured=measured, effects=[parse_effect(text)], **more
    )  # fmt: skip


def test_a_gyre_carries_a_drifting_hull_along_an_arc():
    run = drift(PLANE, "changing-current.V_x=0.4,turn=0.1", ("x", "y", "u", "v"))
    t = run["t"]
    assert run["x"] == pytest.approx(4.0 * np.sin(0.1 * t), abs=1e-4)
    assert run["y"] == pytest.approx(4.0 * (1.0 - np.cos(0.1 * t)), abs=1e-4)
    assert run["u"] == pytest.approx(0.4 * np.cos(0.1 * t), abs=1e-9)


def test_a_tide_grows_and_reverses():
    run = drift(PLANE, "changing-current.V_y=0.4,growth=-0.1", ("y",))
    assert run["y"] == pytest.approx(0.4 * (run["t"] - 0.05 * run["t"] ** 2), abs=1e-4)


def test_shear_slows_the_current_with_depth_and_stops_it():
    at = {
        depth: drift(DIVER, "changing-current.V_x=0.4,shear=0.2", ("u",), initial={"z": depth})["u"]
        for depth in (0.0, 2.0, 6.0)
    }
    assert [speeds[-1] for speeds in at.values()] == pytest.approx([0.4, 0.24, 0.0])


def test_a_dive_through_shear_keeps_the_momentum_of_the_mass():
    state, water = State(w=0.5, psi=0.5 * math.pi), Water()
    setting = Setting(state, water, {}, ("surge", "heave", "yaw"), {}, {}, {}, (), mass=8.0)
    effect = make_effect("changing-current", "", {"V_x": 0.4, "shear": 0.2})
    effect.begin(setting)
    wrench = Wrench()
    effect.alter_force(0.0, wrench)
    assert (wrench.X, wrench.Y) == pytest.approx((0.0, -8.0 * 0.2 * 0.5 * 0.4))  # mass x gradient x descent


def test_currents_add_up():
    craft = Craft(
        load_vehicle("charlie"),
        effects=[parse_effect("changing-current.V_x=0.3"), parse_effect("steady-current.V_x=0.2")],
    )
    craft.begin("1")
    craft.move(0.02, 0.02, [1500] * 16)
    assert craft.plant.water.V_x == pytest.approx(0.5)


def test_a_current_faster_than_the_craft_is_rejected_with_both_speeds():
    with pytest.raises(
        BadEffect, match=r"changing-current: the current of 9 m/s is faster than the craft .*Use a slower"
    ):
        open_vehicle("charlie", effects=[parse_effect("changing-current.V_x=9")])


def forces_of(text, state, *, water=None, dofs=("surge", "sway", "yaw"), **more):
    """Return the wrench of the effect that *text* describes on a craft in that *state*, at time 0."""
    setting = Setting(state, water or Water(), {"yaw.alpha": 1.0}, dofs, {}, {}, {}, (), **more)
    effect, wrench = parse_effect(text), Wrench()
    effect.begin(setting)
    effect.alter_force(0.0, wrench)
    return wrench


def test_wind_pushes_by_area_coefficient_and_relative_speed():
    text = "wind-load.speed=8,direction=0,A_F=2,A_L=3,L=5,c_x=0.6,c_y=0.9,c_n=0.1"
    astern = forces_of(text, State(u=1.0))
    assert (astern.X, astern.Y, astern.N) == pytest.approx((0.5 * 1.225 * 0.6 * 2.0 * 7.0**2, 0.0, 0.0))
    abeam = forces_of(text, State(psi=-0.5 * math.pi))  # towards north, so from port of a craft that heads west
    assert (abeam.X, abeam.Y, abeam.N) == pytest.approx((0.0, 0.5 * 1.225 * 0.9 * 3.0 * 8.0**2, 0.0), abs=1e-9)
    on_the_port_bow = forces_of(text, State(psi=-0.75 * math.pi))
    assert on_the_port_bow.N == pytest.approx(0.5 * 1.225 * 0.1 * 3.0 * 5.0 * 8.0**2)


def test_wind_acts_on_the_speed_over_ground():
    text = "wind-load.speed=8,direction=0,X=10"
    assert forces_of(text, State(u=1.0), water=Water(V_x=-1.0)).X == pytest.approx(10.0)


def test_gusts_have_the_spread_of_their_spectrum_and_follow_the_seed():
    effects = [parse_effect("wind-load.speed=10,direction=0,X=1,gust=1") for _ in range(2)]
    for effect, seed in zip(effects, ("1", "2"), strict=True):
        effect.begin(Setting(State(), Water(), {}, ("surge", "yaw"), {}, {}, {}, (), seed=seed))
    speeds = np.array([[effect.wind(t) for t in np.arange(0.0, 24000.0, 10.0)] for effect in effects])
    f = np.geomspace(1.0 / 1200.0, 0.25, 2001)
    density = 320.0 / (1.0 + (172.0 * f) ** 0.468) ** (5.0 / (3.0 * 0.468))
    assert speeds.std(axis=1) == pytest.approx(math.sqrt(np.trapezoid(density, f)), rel=0.05)
    assert speeds.mean(axis=1) == pytest.approx(10.0, abs=0.1)
    assert abs(np.corrcoef(speeds)[0, 1]) < 0.2


def test_a_negative_gust_is_rejected():
    with pytest.raises(BadEffect, match=r"wind-load.gust: -1 is too small. The minimum is 0$"):
        parse_effect("wind-load.direction=0,gust=-1")


FILE = """title = "Mine"
like = "charlie"

[{heading}]
{entries}
"""


@pytest.mark.parametrize(
    ("heading", "entries", "line", "reason"),
    [
        ("current", {"V_x": (9.0, "m/s")}, 4, r"current: the current of 9 m/s is faster than the craft"),
        ("current", {"V_x": (0.1, "m/s"), "turn": (math.nan, "rad/s")}, 6, r"current\.turn.* nan"),
        ("wind", {"direction": (1.0, "rad"), "gust": (-1.0, "1")}, 6, r"wind\.gust.* >= 0"),
        ("wind", {"speed": (8.0, "m/s")}, 4, r"wind needs direction"),
        ("wind", {"direction": (90.0, "deg")}, 5, r"wind\.direction is in 'deg'"),
        ("pool", {"length": (10.0, "m")}, 4, r"pool: missing entry 'width'"),
        ("pool", {"length": (9.0, "m"), "width": (1.0, "m"), "beam": (1.2, "m")}, 4, r"pool: the wall is across the"),
        ("waves", {"X": (10.0, "N")}, 4, r"waves: missing entry 'frequency'"),
        ("waves", {"frequency": (2.0, "rad/s"), "X": (-10.0, "N")}, 6, r"waves\.X.* >= 0"),
        ("waves", {"frequency": (2.0, "rad/s"), "Z": (10.0, "N")}, 4, r"waves cannot act on 'heave'"),
        (
            "shallows",
            {"draught": (0.5, "m"), "depth": (0.4, "m")},
            4,
            r"shallows: the depth of 0.4 m at the origin must",
        ),
        ("shallows", {"draught": (0.5, "m"), "depth": (math.nan, "m")}, 6, r"shallows\.depth.* nan"),
        ("bank", {"direction": (1.0, "rad"), "distance": (-2.0, "m")}, 6, r"bank\.distance.* >= 0.001"),
        (
            "bank",
            {"direction": (1.0, "rad"), "distance": (0.5, "m"), "beam": (1.2, "m")},
            4,
            r"bank: the wall is across the craft, 0.5 m from its origin with a half beam of 0.6 m\. Set a",
        ),
    ],
)
def test_wrong_surroundings_in_a_vehicle_file_are_rejected_with_the_line(tmp_path, heading, entries, line, reason):
    rows = "\n".join(f'{n} = {{ value = {v}, unit = "{unit}", source = "here" }}' for n, (v, unit) in entries.items())
    path = tmp_path / "mine.toml"
    path.write_text(FILE.format(heading=heading, entries=rows), encoding="utf-8")
    (fault,) = check_vehicle(path)
    assert re.match(rf"{re.escape(str(path))}:{line}: .*{reason}", fault), fault


def test_a_vehicle_file_defines_its_surroundings(tmp_path):
    path = tmp_path / "mine.toml"
    entries = '\n'.join((
        'speed = { value = 8.0, unit = "m/s", source = "here" }',
        'direction = { value = 0.0, unit = "rad", source = "here" }',
        'A_F = { value = 2.0, unit = "m^2", source = "here" }',
    ))  # fmt: skip
    path.write_text(FILE.format(heading="wind", entries=entries), encoding="utf-8")
    assert check_vehicle(path) == []
    craft = Craft(load_vehicle(str(path)))
    craft.begin("1")
    for k in range(500):
        craft.move(0.02 * k, 0.02, [1500] * 16)
    assert craft.plant.state.x > 1.0


def test_a_vehicle_file_defines_a_sea_that_pushes_each_degree_of_freedom_by_its_force(tmp_path):
    path = tmp_path / "mine.toml"
    sizes = {"X": ("N", 12.0), "N": ("N m", 3.0), "drift_X": ("N", 2.0), "frequency": ("rad/s", 2.0)}
    entries = "\n".join(f'{n} = {{ value = {v}, unit = "{unit}", source = "here" }}' for n, (unit, v) in sizes.items())
    path.write_text(FILE.format(heading="waves", entries=entries), encoding="utf-8")
    assert check_vehicle(path) == []
    craft = Craft(load_vehicle(str(path)))
    craft.begin("1")
    ahead, turning = [], []
    for t in np.arange(0.0, 1200.0, 0.25):
        wrench = Wrench()
        for effect in craft.effects:
            effect.alter_force(t, wrench)
        ahead.append(wrench.X)
        turning.append(wrench.N)
    assert np.mean(ahead) == pytest.approx(2.0, abs=0.6)
    assert np.std(ahead) == pytest.approx(12.0, rel=0.15)
    assert np.std(turning) == pytest.approx(3.0, rel=0.15)
    assert np.corrcoef(ahead, turning)[0, 1] > 0.9, "one sea makes both"


def test_the_walls_of_a_pool_are_around_a_craft_in_its_middle(tmp_path):
    path = tmp_path / "mine.toml"
    sizes = {"length": ("m", 12.0), "width": ("m", 6.0), "Y": ("N s^2/m", 6.0)}
    entries = "\n".join(f'{n} = {{ value = {v}, unit = "{unit}", source = "here" }}' for n, (unit, v) in sizes.items())
    path.write_text(FILE.format(heading="pool", entries=entries), encoding="utf-8")
    assert check_vehicle(path) == []
    craft = Craft(load_vehicle(str(path)))
    craft.begin("1")
    at = craft.plant.state

    def suction(north, east, heading):
        at.x, at.y, at.psi, at.u = north, east, heading, 2.0
        wrench = Wrench()
        for effect in craft.effects:
            effect.alter_force(0.0, wrench)
        return wrench.Y

    assert suction(0.0, 0.0, 0.0) == pytest.approx(0.0, abs=1e-9)
    assert suction(0.0, 2.0, 0.0) == pytest.approx(24.0 / 1.0 - 24.0 / 5.0)
    assert suction(4.0, 0.0, 0.5 * math.pi) == pytest.approx(24.0 / 10.0 - 24.0 / 2.0)


def test_a_wind_without_speed_is_still_air():
    text = "wind-load.speed=0,direction=0,A_F=2,c_x=0.6"
    assert forces_of(text, State(u=2.0)).X == pytest.approx(-0.5 * 1.225 * 0.6 * 2.0 * 4.0)
    with pytest.raises(BadEffect, match="forces at speed, which is 0"):
        forces_of("wind-load.speed=0,direction=0,X=1", State())


def of_a_sea(text, at, times, *, seed="1"):
    """Return the forces ahead [N] of the sea that *text* describes, on a craft at the positions *at* (n, 2)."""
    state, effect, found = State(), parse_effect(text), []
    effect.begin(Setting(state, Water(), {}, ("surge", "sway", "yaw"), {}, {}, {}, (), seed=seed))
    for t, (state.x, state.y) in zip(times, at, strict=True):
        wrench = Wrench()
        effect.alter_force(t, wrench)
        found.append(wrench.X)
    return np.array(found)


SEA = "wave-disturbance@surge.amplitude=2,frequency=1.2,gamma=3.3"
TIMES = np.arange(0.0, 2000.0, 0.5)


def peak_of(force):
    """Return the mean frequency [rad/s] of a force, weighted by its power."""
    power = np.abs(np.fft.rfft(force)) ** 2
    return float(np.sum(power * np.fft.rfftfreq(len(force), 0.5)) / np.sum(power) * 2.0 * math.pi)


def test_a_sea_has_its_size_and_its_spectrum():
    force = of_a_sea(SEA, np.zeros((len(TIMES), 2)), TIMES)
    assert force.std() == pytest.approx(2.0, rel=0.03)
    assert force.mean() == pytest.approx(0.0, abs=0.02)
    x = np.geomspace(0.5, 2.5, 4001)
    density = np.exp(-1.25 / x**4) / x**5 * 3.3 ** np.exp(-0.5 * ((x - 1.0) / np.where(x <= 1.0, 0.07, 0.09)) ** 2)
    mean = np.trapezoid(density * x, x) / np.trapezoid(density, x)
    assert peak_of(force) == pytest.approx(1.2 * mean, rel=0.05)


def test_the_encounter_frequency_is_higher_in_head_seas():
    way = np.column_stack([1.5 * TIMES, 0.0 * TIMES])  # 1.5 m/s to the north
    with_them, against = (peak_of(of_a_sea(f"{SEA},direction={d}", way, TIMES)) for d in (0.0, math.pi))
    still = peak_of(of_a_sea(SEA, 0.0 * way, TIMES))
    assert with_them < still - 0.5 * 1.2**2 / 9.81 * 1.5 and against > still + 0.5 * 1.2**2 / 9.81 * 1.5


def test_the_drift_force_of_a_sea_has_its_mean_and_varies_slowly():
    sea, drifting = (of_a_sea(SEA + more, np.zeros((len(TIMES), 2)), TIMES) for more in ("", ",drift=3"))
    drift = drifting - sea
    assert drift.mean() == pytest.approx(3.0, rel=0.05)
    assert drift.min() >= 0.0 and drift.std() > 1.0
    assert peak_of(drift - drift.mean()) < 0.5 * 1.2


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("wave-disturbance.amplitude=-1,frequency=1", r"amplitude: -1 is too small"),
        ("wave-disturbance@surge.amplitude=1,frequency=1,drift=1", "needs a sea. Set gamma"),
        ("wave-disturbance.amplitude=1,frequency=1,gamma=3.3,drift=1", "acts on surge or sway, not on yaw"),
    ],
)
def test_an_impossible_sea_is_rejected(text, reason):
    with pytest.raises(BadEffect, match=reason):
        Craft(load_vehicle("charlie"), effects=[parse_effect(text)]).begin("1")


def test_a_tether_is_slack_up_to_its_length_and_pulls_beyond_in_all_three_directions():
    text = "tether-line.stiffness=10,length=5"
    dofs = ("surge", "sway", "heave", "yaw")
    assert forces_of(text, State(x=3.0, z=4.0), dofs=dofs) == Wrench()
    taut = forces_of(text, State(x=6.0, z=8.0), dofs=dofs)
    assert (taut.X, taut.Y, taut.Z) == pytest.approx((-30.0, 0.0, -40.0))
    assert forces_of(text, State(x=6.0, z=8.0, psi=0.5 * math.pi), dofs=dofs).Y == pytest.approx(30.0)


def test_a_tether_is_dragged_across_itself_and_not_along():
    text = "tether-line.length=50,drag=4"
    dofs = ("surge", "sway", "heave", "yaw")
    along = forces_of(text, State(x=10.0, u=2.0), dofs=dofs)
    assert (along.X, along.Y, along.Z) == pytest.approx((0.0, 0.0, 0.0))
    across = forces_of(text, State(x=10.0, w=2.0), dofs=dofs)
    assert (across.X, across.Y, across.Z) == pytest.approx((0.0, 0.0, -16.0))


def test_the_pull_of_a_tether_acts_in_the_axes_of_a_tilted_craft():
    text = "tether-line.stiffness=10,length=5"
    pitched = forces_of(text, State(z=8.0, theta=0.5 * math.pi, tilts=True), dofs=("surge", "sway", "heave", "yaw"))
    assert (pitched.X, pitched.Z) == pytest.approx((30.0, 0.0), abs=1e-9)  # bow up: ahead is up


SHALLOWS = "shallow-water.draught=0.5,depth=1.5,north=0.05,drag=8,sway=0.4,yaw=0.2"


def test_shallow_water_adds_drag_and_inertia_by_draught_over_water_under_the_keel():
    inertia = {"sway.alpha": 15.0, "yaw.alpha": 2.0}
    state, effect, wrench = State(u=-2.0, x=-10.0), parse_effect(SHALLOWS), Wrench()
    effect.begin(Setting(state, Water(), inertia, ("surge", "sway", "yaw"), {}, {}, {}, ()))
    effect.alter_force(0.0, wrench)
    effect.alter_parameters(0.0, inertia)  # 0.5 m of draught over 1 m - 10 m x 0.05 under the keel
    assert (wrench.X, wrench.Y, wrench.N) == pytest.approx((8.0 * 1.0 * 4.0, 0.0, 0.0))
    assert inertia == pytest.approx({"sway.alpha": 15.0 * 1.4, "yaw.alpha": 2.0 * 1.2})


def test_a_hull_is_slower_towards_the_shore():
    ahead = {"X": np.full(400, 5.0)}
    ran = {}
    for course in (0.0, math.pi):  # the water becomes deeper towards north
        start = {"psi": course}
        run = open_loop(
            PLANE, ahead, duration=40.0, interval=0.1, measured=("u",), effects=[parse_effect(SHALLOWS)], initial=start
        )
        ran[course] = run["u"][-1]
    assert ran[math.pi] < 0.5 * ran[0.0]


def test_bank_suction_grows_with_speed_squared_over_the_gap_and_turns_the_bow_away():
    text = "bank-suction.direction=1.5707963,distance=5,Y=6,N=3"  # the wall is to the east
    beside = forces_of(text, State(u=2.0, y=3.0))
    assert (beside.X, beside.Y, beside.N) == pytest.approx((0.0, 6.0 * 4.0 / 2.0, -3.0 * 4.0 / 2.0))
    astern = forces_of(text, State(u=-2.0, y=3.0))
    assert (astern.Y, astern.N) == pytest.approx((12.0, 6.0))  # the stern is ahead, and turns away
    assert forces_of(text, State(u=2.0, y=3.0, psi=math.pi)).Y == pytest.approx(-12.0)
    towards = forces_of(text, State(u=2.0, psi=0.5 * math.pi))
    assert (towards.Y, towards.N) == pytest.approx((0.0, 0.0), abs=1e-6)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("shallow-water.draught=1,depth=1", "the depth of 1 m at the origin must exceed the draught of 1 m"),
        ("shallow-water.draught=nan,depth=2", "'nan' is not a finite number"),
        ("bank-suction.direction=0,distance=-3", "distance: -3 is too small"),
        (
            "bank-suction.direction=0,distance=0.2,beam=0.6",
            r"across the craft, 0.2 m from .* Set a distance above 0.3 m",
        ),
    ],
)
def test_impossible_shallows_or_banks_are_rejected(text, reason):
    with pytest.raises(BadEffect, match=reason):
        Craft(load_vehicle("charlie"), effects=[parse_effect(text)]).begin("1")


@pytest.mark.parametrize(
    ("head", "values", "places"),
    [
        ("wind-load", "direction=0", "surge+sway+yaw or surge+yaw"),
        ("shallow-water", "draught=0.2,depth=2", "surge+sway+yaw or surge+yaw"),
        ("bank-suction", "direction=0,distance=5", "sway+yaw or yaw"),
        ("coriolis-coupling", "Y_ur=1", "surge+sway+yaw"),
        ("sway-yaw-coupling", "N_v=1", "sway+yaw"),
        ("sway-moment", "N_v=1", "yaw"),
        ("speed-damping", "N_|u|r=1", "yaw"),
        ("munk-moment", "N_uv=1", "yaw"),
        ("time-scale", "factor=1.1", "t"),
        ("time-offset", "offset=0.1", "t"),
    ],
)
def test_an_unknown_place_is_rejected_with_the_valid_places(head, values, places):
    with pytest.raises(BadEffect, match=f"^{head} cannot act on 'foo'. Use {re.escape(places)}$"):
        parse_effect(f"{head}@foo.{values}")
    for place in places.split(" or "):
        assert parse_effect(f"{head}@{place}.{values}").place == place


@pytest.mark.parametrize("heading", ["wind", "shallows", "bank", "waves", "pool"])
def test_a_place_in_a_vehicle_file_is_rejected_at_its_line(tmp_path, heading):
    path = tmp_path / "mine.toml"
    path.write_text(FILE.format(heading=heading, entries='place = "foo"'), encoding="utf-8")
    assert check_vehicle(path) == [f"{path}:5: {heading}: unknown entry 'place'"]
