"""Hot motors and a battery under load lose thrust; a vehicle file without them flies as before."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from sitl.actuators import MotorDrive
from sitl.catalogue import BadVehicle, load_vehicle
from sitl.craft import Craft
from sitl.derating import Derating

HEAT = {"time_constant": 30.0, "rise": 80.0, "limit": 20.0, "loss": 0.005}
BATTERY = {"voltage": 16.0, "resistance": 0.1, "full_current": 20.0}
UNITS = {"time_constant": "s", "rise": "K", "limit": "K", "loss": "1/K", "voltage": "V", "resistance": "ohm"}


def craft(tmp_path: Path, like: str = "blueboat", **headings: dict[str, float]) -> Craft:
    lines = [f'like = "{like}"']
    for heading, values in headings.items():
        lines.append(f"[{heading}]")
        lines += [f'{k} = {{ value = {v}, unit = "{UNITS.get(k, "A")}", source = "test" }}' for k, v in values.items()]
    path = tmp_path / "own.toml"
    path.write_text("\n".join(lines), encoding="utf-8")
    return Craft(load_vehicle(str(path)))


def speeds(own: Craft, pulses: list[int], seconds: float) -> list[float]:
    own.begin("0")
    found = []
    for k in range(round(seconds * 50)):
        own.move((k + 1) * 0.02, 0.02, pulses)
        found.append(own.plant.state.u)
    return found


def test_a_motor_below_its_limit_warms_exponentially() -> None:
    derating = Derating(MotorDrive((1,), 400.0, 2.0), {**HEAT, "limit": 500.0}, {})
    for _ in range(300):
        assert derating.weaken(0.1, [1700.0]) == [1700.0]
    assert derating.warmth[1] == pytest.approx(80.0 * 0.25**1.5 * (1.0 - math.exp(-1.0)))


def test_only_the_hot_motor_weakens_and_recovers_when_it_rests() -> None:
    derating = Derating(MotorDrive((1, 2), 400.0, 2.0), HEAT, {})
    for _ in range(1000):
        hot, idle = derating.weaken(0.1, [1900.0, 1500.0])
    assert idle == 1500.0
    # the steady state, written out: thrust f = 1 - loss (theta - limit), theta = rise f^1.5
    theta = derating.warmth[1]
    left = ((hot - 1500.0) / 400.0) ** 2
    assert theta == pytest.approx(80.0 * left**1.5, rel=0.06)
    assert left == pytest.approx(1.0 - 0.005 * (theta - 20.0), rel=1e-3)
    for _ in range(1000):
        derating.weaken(0.1, [1500.0, 1500.0])
    assert derating.weaken(0.1, [1900.0, 1500.0])[0] == 1900.0


def test_battery_sag_reduces_all_thrust_by_the_square_of_the_voltage() -> None:
    derating = Derating(MotorDrive((1, 2), 400.0, 1.0), {}, BATTERY)
    for _ in range(50):
        one, other = derating.weaken(0.1, [1900.0, 1100.0])
    assert one - 1500.0 == pytest.approx(1500.0 - other)
    assert (one - 1500.0) / 400.0 == pytest.approx((1.0 - 0.1 * derating.current / 16.0) ** 2)
    assert derating.current == pytest.approx(0.4 + 2.0 * 20.0 * ((one - 1500.0) / 400.0) ** 1.5)


@pytest.mark.parametrize("like", ["blueboat", "charlie", "bluerov2", "ies-rov"])
def test_derating_without_losses_has_no_effect_and_is_off_by_default(tmp_path: Path, like: str) -> None:
    pulses = [1700, 1600, 1800, 1450, 1500, 1500, 1500, 1500]
    nothing = craft(tmp_path, like, heat={**HEAT, "loss": 0.0}, battery={**BATTERY, "resistance": 0.0})
    assert nothing.derating is not None
    assert speeds(nothing, pulses, 2.0) == pytest.approx(speeds(Craft(load_vehicle(like)), pulses, 2.0), rel=1e-12)
    assert Craft(load_vehicle(like)).derating is None


@pytest.mark.parametrize("headings", [{"heat": HEAT}, {"battery": BATTERY}])
def test_a_boat_at_full_throttle_slows_down_by_derating(tmp_path: Path, headings: dict[str, dict[str, float]]) -> None:
    full = [1900, 1500, 1900, 1500, 1500, 1500, 1500, 1500]
    weak, plain = speeds(craft(tmp_path, **headings), full, 90.0), speeds(Craft(load_vehicle("blueboat")), full, 90.0)
    assert weak[-1] < 0.97 * plain[-1]
    assert weak[-1] > 0.5 * plain[-1]


def test_an_incomplete_heading_is_rejected_with_the_entry_that_is_missing(tmp_path: Path) -> None:
    with pytest.raises(BadVehicle, match="heat: missing entry 'limit'"):
        craft(tmp_path, heat={k: v for k, v in HEAT.items() if k != "limit"})
