"""The protocol between a simulated body and its actuators, effects and sensors."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from sitl import BadVehicle, load_vehicle, plants
from sitl.craft import Craft
from sitl.effects import make_effect
from sitl.modelfile import BadModel, FlownModel
from sitl.plants import GRAVITY, AxisDynamics, Coupling, PlanarHull, Plant, State, Water, Wrench, measured_speed
from sitl.sensors import SensorReading, Sensors

DT = 0.02


class Sled:
    """The least a plant can be: a mass on rails ahead, without drag."""

    dofs = ("surge",)

    def __init__(self) -> None:
        self.state, self.water = State(), Water()
        self.parameters = {f"{dof}.{name}": 0.0 for dof in ("surge", "yaw") for name in ("alpha", "beta", "beta2")}
        self.parameters["surge.alpha"] = 20.0
        self._udot = 0.0

    def step(self, wrench: Wrench, dt: float) -> None:
        self._udot = wrench.X / self.parameters["surge.alpha"]
        self.state.x += self.state.u * dt + 0.5 * self._udot * dt * dt
        self.state.u += self._udot * dt

    def specific_force(self) -> tuple[float, float, float]:
        return self._udot, 0.0, -GRAVITY


def sled(*effects) -> Craft:
    craft = Craft(load_vehicle("blueboat"), plant=Sled(), effects=effects)
    craft.begin("1")
    return craft


def pushed(craft: Craft, seconds: float = 5.0) -> float:
    """Return the speed after full throttle for that long."""
    for k in range(round(seconds / DT)):
        craft.move(DT * (k + 1), DT, [2000, 1500, 2000])
    return craft.plant.state.u


def test_the_actuators_of_a_vehicle_drive_another_plant():
    thrust = load_vehicle("blueboat").make_actuators().full["surge"]
    assert pushed(sled()) == pytest.approx(5.0 * thrust / 20.0)


def test_effects_change_the_parameters_and_the_wrench_of_another_plant():
    plain = pushed(sled())
    assert pushed(sled(make_effect("mass-change", "surge", {"ratio": 2.0, "time": 0.0}))) == pytest.approx(plain / 2.0)
    assert pushed(sled(make_effect("input-bias", "surge", {"bias": 0.1}))) == pytest.approx(1.1 * plain)


def test_a_mass_change_acts_on_every_listed_degree_of_freedom():
    def speed(*place: str) -> float:
        effects = [make_effect("mass-change", where, {"ratio": 2.0, "time": 0.0}) for where in place]
        craft = Craft(load_vehicle("blueboat"), effects=effects)
        craft.begin("1")
        return pushed(craft, 1.0)

    assert speed("surge+yaw") == speed("all") == speed("surge") < speed()
    assert speed("yaw") == speed()


def test_sensors_read_another_plant():
    craft, data = sled(), load_vehicle("blueboat")
    craft.plant.state.u, reading = 1.5, SensorReading()
    Sensors(data.sensors, 1, floats=True).sample(craft.plant, reading)
    assert reading.u == pytest.approx(1.5, abs=10.0 * data.sensors.speed_noise)


def test_a_model_and_a_user_plant_exclude_each_other():
    with pytest.raises(BadModel, match="either plant or model"):
        Craft(load_vehicle("blueboat"), plant=Sled(), model=FlownModel({}, {}, {}, (), None))


def test_a_row_of_the_table_is_a_plant_that_vehicle_files_may_name(tmp_path, monkeypatch):
    blueboat = Path(plants.__file__).parents[1] / "vehicles" / "blueboat.toml"
    mine = tmp_path / "sled.toml"
    mine.write_text('plant = "sled"\n' + blueboat.read_text(encoding="utf-8"), encoding="utf-8")
    with pytest.raises(BadVehicle, match=r"plant: there is no .sled.\. Use one of planar-hull"):
        load_vehicle(str(mine))
    monkeypatch.setitem(plants.PLANTS, "sled", lambda tables: Sled())
    craft = Craft(load_vehicle(str(mine)))
    assert isinstance(craft.plant, Sled)
    assert pushed(craft) == pytest.approx(pushed(sled()))
    with pytest.raises(BadModel, match="sled is another plant"):
        Craft(load_vehicle(str(mine)), model=FlownModel({}, {}, {}, (), None))


def hull(*, sways: bool) -> PlanarHull:
    axis = AxisDynamics(10.0, 3.0, 1.0)
    water = Water(bottom=math.inf, V_x=0.4, V_y=-0.3)
    made: Plant = PlanarHull(
        axis,
        axis,
        AxisDynamics(0.5, 0.4, 0.1),
        water,
        sway=axis if sways else None,
        coupling=Coupling(coriolis=True) if sways else None,
    )
    assert isinstance(made, PlanarHull)
    return made


@pytest.mark.parametrize("sways", [False, True])
def test_the_specific_force_adds_up_to_the_velocity_over_ground(sways):
    """What an inertial navigation system does: rotate by the heading, take gravity out, integrate."""
    body, wrench = hull(sways=sways), Wrench(X=8.0, Y=2.0, Z=1.0, N=0.2)
    body.state.z, velocity = 50.0, [0.4, -0.3, 0.0]
    for _ in range(500):
        before = body.state.psi
        body.step(wrench, DT)
        ahead, aside, down = body.specific_force()
        c, s = math.cos(0.5 * (before + body.state.psi)), math.sin(0.5 * (before + body.state.psi))
        velocity[0] += (c * ahead - s * aside) * DT
        velocity[1] += (s * ahead + c * aside) * DT
        velocity[2] += (down + GRAVITY) * DT
    u, v, _ = measured_speed(body.state, body.water)
    c, s = math.cos(body.state.psi), math.sin(body.state.psi)
    assert velocity == pytest.approx([c * u - s * v, s * u + c * v, body.state.w], abs=1e-9)


def test_at_rest_the_specific_force_is_only_gravity():
    body = hull(sways=False)
    assert body.specific_force() == (0.0, 0.0, -GRAVITY)
