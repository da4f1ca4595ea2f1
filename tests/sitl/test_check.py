"""``sitl --check FILE``: file, line and quantity of each fault."""

from __future__ import annotations

from pathlib import Path

import pytest

import sitl
from sitl import VEHICLES
from sitl.__main__ import main
from sitl.check import check_vehicle

FILES = Path(sitl.__file__).parent / "vehicles"


@pytest.mark.parametrize("name", VEHICLES)
def test_every_vehicle_of_the_table_passes(name, capsys):
    assert main(["--check", str(FILES / VEHICLES[name])]) == 0
    assert "no faults found" in capsys.readouterr().out


def changed(path: Path, name: str, old: str, new: str) -> tuple[Path, int]:
    """Write a changed copy, and return it with the line of the change."""
    text = (FILES / VEHICLES[name]).read_text(encoding="utf-8")
    assert text.count(old) == 1
    path.write_text(text.replace(old, new), encoding="utf-8")
    return path, text[: text.index(old)].count("\n") + 1


DEAD = 'dead = { value = 0.05, unit = "1", source = "here" }'


@pytest.mark.parametrize(
    ("name", "old", "new", "quantity", "reason"),
    [
        ("blueboat", "value = 41.77", "value = -41.77", "surge.alpha", "expected a number > 0"),
        ("blueboat", "value = 41.77", 'value = "heavy"', "surge.alpha", "expected a number, got text"),
        ("blueboat", 'value = 41.77, unit = "kg"', 'value = 41.77, unit = "lb"', "surge.alpha", "is in 'lb'. Use kg"),
        ("blueboat", "value = 41.77", "value = 1e308", "surge.alpha", "1e+308 is too large"),
        ("blueboat", "value = 41.77", "value = 1e99", "surge.alpha", "expected a number <= 1000000000.0"),
        ("charlie", "value = [16.0, 25.0,", "value = [25.0, 16.0,", "yaw.n2", "Sort the table so that n2 rises"),
        ("charlie", "[10.795, 8.755,", "[10.795,", "yaw.alpha", "4 values for 5 values of n2"),
        ("bluerov2-6dof", "mass = { value = 13.5", "mass = { value = -13.5", "body.mass", "expected a number > 0"),
        ("bluerov2-6dof", "x = { value = [0.156,", 'x = { value = ["a",', "thrusters.x", "expected a number"),
        ("tugboat", 'I_xz = { value = 0.05, unit = "kg m^2"', 'I_xz = { value = 0.05, unit = "g"', "body.I_xz", "'g'"),
        ("ies-rov", "resistance = {", "resistence = {", "motor", "unknown entry 'resistence'"),
        ("blueboat", "beta = { value = 29.35", "beta = { value = 9e8", "surge", "the motion diverges"),
        ("blueboat", "value = 41.77", "value = 1e-300", "surge", "the motion diverges"),
        ("tugboat", "time_constant = { value = 0.15", "time_constant = { value = 0.001", "motor", "diverges"),
        ("ies-rov", "inertia = { value = 0.002", "inertia = { value = 1e-9", "motor", "diverges"),
        ("blueboat", "CRUISE_SPEED", "CRUISE_SPED", "parameters.CRUISE_SPED", "firmware 'rover' has no such parameter"),
        ("blueboat", 'firmware = "rover"', 'firmware = "sub"', "parameters.CRUISE_SPEED", "'sub' has no such"),
        ("blueboat", "value = 25.65", "value = [25.65, 3.0]", "yaw.alpha", "expected a number, got a list"),
        ("charlie", "[10.795, 8.755, 8.2, 9.155, 8.695]", "9.0", "yaw.alpha", "1 values for 5 values of n2"),
        ("charlie", "value = [16.0, 25.0,", "value = [0.0, 25.0,", "yaw.n2", "expected a number > 0.0"),
        ("charlie-rudders", "[-1.2, -1.2]", "[-1.2, -1.2, -1.2]", "rudder", "lists of different length (x 3, y 2)"),
        ("charlie-rudders", "[sway]", 'actuators = "twin-thruster"\n[sway]', "rudder", "have no rudder. Use 'rudder'"),
        ("ies-rov", "diameter = {", "# diameter = {", "thrusters", "missing entry 'a_ahead'"),
        ("bluerov2-6dof", "coriolis = { value = true", "coriolis = { value = 1", "coupling.coriolis", "must be true"),
        ("tugboat", "Y_rdot = {", "Q_rdot = {", "coupling", "cannot simulate Q_rdot"),
        ("blueboat", "\"twin-thruster\"", "\"twin-screw\"", "actuators", "there is no 'twin-screw'. Use one of rudder"),
        ("blueboat", 'firmware = "rover"', 'firmware = "plane"', "firmware", "there is no 'plane'"),
        ("tugboat", 'plant = "rigid-body"', 'plant = "body"', "plant", "there is no 'body'"),
        ("tugboat", 'like = "blueboat"', 'like = "bluboat"', "like", "did you mean blueboat"),
        ("videoray-wall", "period = {", "# period = {", "rangefinder", "missing entry 'period'"),
        ("blueboat", "CRUISE_SPEED", "THIS_IS_TOO_LONG_", "parameters.THIS_IS_TOO_LONG_", "at most 16 letters"),
        ("blueboat", "[sensors]", "[senses]", "", "unknown entry 'senses'"),
        ("blueboat", "firmware =", "firmwear =", "", "unknown entry 'firmwear'"),
        ("blueboat", "alpha = { value = 41.77", "# alpha = { value = 41.77", "surge", "missing entry 'alpha'"),
        ("charlie-rudders", "stall = {", "# stall = {", "rudder", "missing entry 'stall'"),
        ("blueboat", "astern = {", f"{DEAD}\nastern = {{", "thruster", "the curve of [thrusters]"),
        ("ies-rov", "density = {", "# density = {", "propeller", "missing entry 'density'"),
    ],
)  # fmt: skip
def test_a_fault_is_reported_with_file_line_and_quantity(name, old, new, quantity, reason, tmp_path, capsys):
    path, line = changed(tmp_path / "mine.toml", name, old, new)
    assert main(["--check", str(path)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert f"{path}:" in error and quantity in error and reason in error
    text = path.read_text(encoding="utf-8")
    if f"[{quantity}]" in text and "unknown" not in reason:  # at its heading
        line = text[: text.index(f"[{quantity}]")].count("\n") + 1
    if "'sub'" in reason:  # at a parameter of the other firmware
        line = text[: text.index("CRUISE_SPEED")].count("\n") + 1
    assert error.startswith(f"sitl: {path}:{line}: {quantity}")


def test_all_faulty_entries_are_listed(tmp_path):
    path, _ = changed(tmp_path / "mine.toml", "blueboat", "value = 41.77", "value = -41.77")
    path.write_text(path.read_text(encoding="utf-8").replace("value = 25.65", 'value = "x"'), encoding="utf-8")
    assert [fault.split(": ")[1] for fault in check_vehicle(path)] == ["yaw.alpha.value", "surge.alpha.value"]


def test_invalid_toml_is_reported_with_its_line(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text('title = "x"\nfirmware = = "rover"\n', encoding="utf-8")
    assert check_vehicle(path) == [f"{path}:2: Invalid value"]


def test_a_missing_entry_or_file_is_reported(tmp_path):
    path, text = tmp_path / "mine.toml", (FILES / VEHICLES["blueboat"]).read_text(encoding="utf-8")
    path.write_text(text.partition("[parameters]")[0], encoding="utf-8")
    assert check_vehicle(path)[0].startswith(f"{path}: missing entry 'parameters'. Start with a copy")
    assert "cannot be read" in check_vehicle(tmp_path / "none.toml")[0]
