"""`authority`: what is predicted from models is what the simulated boats then fly."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from gcs_autotune.cli import main
from gcs_autotune.design import Authority, limits_for
from gcs_autotune.workflow import authority

WITHIN = 0.1
"""Largest relative difference of a flown figure from the predicted one."""


class Boat:
    """A simulated boat with its run directories in *folder*."""

    def __init__(self, folder: Path, vehicle: str) -> None:
        self.folder, self.link = folder, ["--connect", f"sitl:{vehicle}", "--yes", "--quiet"]

    def run(self, name: str, *words: str) -> Path:
        """Fly with the command of *words* and return its run directory."""
        path = self.folder / name
        assert main([*words, *self.link, "--out", str(path)]) == 0
        return path

    def figures(self, run: Path) -> dict[str, float]:
        """Return the figures of a flown manoeuvre."""
        reported = json.loads((run / "figures.json").read_text())
        return {f["slug"]: f["value"] for sheet in reported["sheets"] for f in sheet["figures"]}


@pytest.fixture(scope="module", params=["blueboat", "charlie"])
def flown(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Boat, Authority]:
    """Return a boat and what is predicted from a speed run, a heading run and a stop with full astern."""
    boat = Boat(tmp_path_factory.mktemp(request.param), request.param)
    speed, heading = (boat.run(axis, "experiment", axis) for axis in ("speed", "heading"))
    stop = boat.run("astern", "fly", "stopping", "--throttle", "1", "--astern", "1")
    surge = boat.folder / "surge.json"
    words = ["--dof", "surge", "--start", str(speed / "model.json"), "--effects", "asymmetric-thrust@X", "--no-page"]
    assert main(["identify", str(speed), str(stop), *words, "--save", str(surge)]) == 0
    return boat, authority([surge, heading])


def near(predicted: float, measured: float) -> bool:
    return abs(predicted / measured - 1.0) <= WITHIN


@pytest.mark.slow
def test_the_predicted_turning_circle_agrees_with_the_flown_one(flown: tuple[Boat, Authority]) -> None:
    boat, found = flown
    reported = boat.figures(boat.run("circle", "fly", "turning-circle", "--steering", "1"))
    circle = next(c for c in found.circles if c.throttle == pytest.approx(found.models.working))
    assert near(circle.diameters["starboard"].value, reported["steady-diameter"])
    assert near(circle.rates["starboard"].value, abs(reported["rate"]))
    assert near(found.figures["turn-rate-starboard"].value, abs(reported["rate"]))


@pytest.mark.slow
def test_predicted_top_speed_and_full_astern_stop_agree_with_the_flown_ones(flown: tuple[Boat, Authority]) -> None:
    boat, found = flown
    reported = boat.figures(boat.folder / "astern")
    assert near(found.figures["top-ahead"].value, reported["approach"])
    assert near(found.figures["stop-astern-top"].value, reported["track-reach"])
    assert near(found.figures["stop-time-astern-top"].value, reported["time-stop"])


@pytest.mark.slow
def test_the_predicted_coasting_stop_agrees_with_the_flown_one(flown: tuple[Boat, Authority]) -> None:
    boat, found = flown
    reported = boat.figures(boat.run("coasting", "fly", "stopping", "--throttle", "1"))
    stop = found.figures["stop-coasting-top"]
    assert near(stop.value, reported["track-reach"])


@pytest.mark.slow
def test_the_actuators_of_both_boats_give_parameters(flown: tuple[Boat, Authority]) -> None:
    _, found = flown
    rows = {row.name: row for row in limits_for(found)}
    if found.models.skid:
        assert rows["MOT_THST_ASYM"].value == pytest.approx(2.0, rel=WITHIN)
        assert "MOT_THST_EXPO" not in rows
    else:
        assert rows["MOT_THST_EXPO"].value == pytest.approx(1.0, abs=WITHIN)
        assert rows["SERVO1_TRIM"].value == pytest.approx(1492.0, abs=2.0)
    assert 0.0 < rows["ATC_STR_RAT_MAX"].value < 120.0
