"""Standard manoeuvres over MAVLink: the figures of a noisy run are those of one without noise; limits are reported."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from gcs_autotune.errors import NotAchieved, NotInformative, UsageError
from gcs_autotune.logs import load_runs
from gcs_autotune.models import TransferFunction
from gcs_autotune.seatrials import ship_figures
from gcs_autotune.seatrials.closed_loop import oscillation_of
from gcs_autotune.thrusters import fit_thruster, read_pull_test
from gcs_autotune.workflow import FlySettings

from .sitl_harness import SLOW_LOOP, Ear, SitlHarness
from .test_fly import calm, flown

TURN = 2.0 * math.pi


def read(run: Any) -> dict[str, float]:
    return {f.slug: f.reading.value for sheet in ship_figures(run) for f in sheet.figures}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "vehicle", "options", "slugs"),
    [
        ("turning-circle", "blueboat", {"turn": TURN}, ("tactical-diameter", "steady-diameter", "rate", "time-180")),
        ("stopping", "charlie", {"astern": 1.0}, ("track-reach", "time-stop", "time-half")),
    ],
)
def test_figures_in_the_run_directory_agree_with_a_run_without_noise(
    name: str, vehicle: str, options: dict[str, float], slugs: tuple[str, ...], tmp_path: Path
) -> None:
    harness = SitlHarness(tmp_path / "noisy", vehicle)
    result = flown(harness, options, name)
    assert result.remarks == []
    (run,) = load_runs(harness.directory)
    noisy, true = read(run), read(flown(calm(SitlHarness(tmp_path / "calm", vehicle)), options, name).trial)
    for slug in slugs:
        assert noisy[slug] == pytest.approx(true[slug], rel=0.02)
    assert result.fit is not None
    harness.assert_neutral()
    assert not harness.vehicle.autopilot.armed
    assert harness.mode == harness.found


def test_saturated_thrusters_are_reported(tmp_path: Path) -> None:
    result = flown(SitlHarness(tmp_path, "blueboat"), {"turn": 2.0, "steering": 1.0}, "turning-circle", throttle=0.9)
    assert "N was limited: 100% commanded" in result.remarks[0]
    assert "at the output" in result.remarks[0]


@pytest.mark.slow
def test_a_turn_that_is_not_completed_is_reported_and_the_record_is_kept(tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path)
    with pytest.raises(NotAchieved, match="Use more helm"):
        flown(harness, {"turn": TURN, "steering": 0.02}, "turning-circle")
    harness.assert_neutral()
    assert list((harness.directory / "trials").glob("*turning-circle.csv"))


def test_weaker_thrust_astern_is_identified_from_a_stopping_boat(tmp_path: Path) -> None:
    """A BlueBoat pulls half as much astern (41.77 kg, 110.4 N: alpha_u 0.378 per full thrust)."""
    result = flown(SitlHarness(tmp_path, "blueboat"), {"astern": 0.6}, "stopping")
    (own,) = result.fit.significant_effects
    assert (own.slug, own["ratio"]) == ("asymmetric-thrust", pytest.approx(0.5, abs=0.1))
    assert result.fit.model.alpha == pytest.approx(0.378, abs=0.04)


@pytest.mark.slow
def test_an_s_manoeuvre_reports_the_other_motions_it_caused(tmp_path: Path) -> None:
    options = {"duration": 30.0, "steering": 0.4}
    result = flown(SitlHarness(tmp_path / "a", "videoray-coupled", **SLOW_LOOP), options, "s-manoeuvre")
    (remark,) = [text for text in result.remarks if "omits" in text]
    assert remark.startswith("s-manoeuvre also moved surge and sway, which the model of yaw omits")
    assert "--dof horizontal" in remark
    still = flown(SitlHarness(tmp_path / "b", "videoray", **SLOW_LOOP), options, "s-manoeuvre")
    (remark,) = [text for text in still.remarks if "omits" in text]
    assert remark.startswith("s-manoeuvre also moved surge")
    assert "--dof surge" in remark
    boat = flown(SitlHarness(tmp_path / "c", "blueboat"), options, "s-manoeuvre")  # thrust is constant there
    assert not any("omits" in text for text in boat.remarks)


def test_a_timed_force_is_flown_and_its_model_identified(tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path, "bluerov2", parameters={"SCHED_LOOP_RATE": 100.0})
    options = {"duration": 15.0, "steering": 0.4}
    result = flown(harness, options, "doublets", force="X")
    assert result.fit.dof == "surge"
    assert 0.5 < result.preview.room < 2.0  # there and back
    with pytest.raises(UsageError, match="drives N and does not accept --force X"):
        FlySettings("zig-zag", harness.common(), force="X")


@pytest.mark.slow
def test_set_point_relays_measure_the_loop_with_and_without_noise_and_drive_no_actuator(
    tmp_path: Path,
) -> None:
    harness = SitlHarness(tmp_path / "noisy", "blueboat")
    modes: set[str] = set()

    class Modes(Ear):
        def update(self, progress: Any) -> None:
            modes.add(harness.mode)

    result = flown(harness, {}, "set-point-relay", observer=Modes(harness.said))
    assert modes == {"GUIDED"}
    true = flown(calm(SitlHarness(tmp_path / "calm", "blueboat")), {}, "set-point-relay").sheets[0]
    (sheet,) = result.sheets
    assert sheet.doubts == ()
    for slug in ("natural-frequency", "damping"):
        reported, calm_water = sheet[slug].reading, true[slug].reading
        assert 0.0 < reported.std < reported.value
        assert abs(reported.value - calm_water.value) < 2.0 * math.hypot(reported.std, calm_water.std)
    # Linear, without the limit on the turn's acceleration: poles -0.32 +- 0.51j and -1.35 1/s
    reported = sheet["natural-frequency"].reading
    assert abs(reported.value - 0.604) < 2.0 * reported.std
    assert read(load_runs(harness.directory)[0])["damping"] == pytest.approx(sheet["damping"].reading.value, rel=1e-3)
    harness.assert_neutral()
    assert harness.mode == harness.found


@pytest.mark.slow
@pytest.mark.parametrize("relays", [(20.0, 5.0, 15.0, 5.0), (10.0, 5.0, 30.0, 10.0)])
def test_charlies_closed_loop_is_identified_from_the_two_published_relay_cases(
    relays: tuple[float, float, float, float], tmp_path: Path
) -> None:
    """Miskovic2010, table 7.13, both cases (C, x_a, C, x_a in degrees), under gains that spare the rudder its stops."""
    k_A, k_FF, k_P, k_I = 0.5, 0.8, 1.2, 0.1
    gains = {"ATC_STR_ANG_P": k_A, "ATC_STR_RAT_FF": k_FF, "ATC_STR_RAT_P": k_P, "ATC_STR_RAT_I": k_I}
    harness = SitlHarness(tmp_path, parameters=gains)
    names = ("set-point", "hysteresis", "second-set-point", "second-hysteresis")
    result = flown(harness, dict(zip(names, map(math.radians, relays), strict=True)), "set-point-relay")
    (sheet,) = result.sheets
    # her yaw at 80 % (n^2 = 41, table 7.12), full rudder 30 degrees, of which ArduRover takes 1/1.2 at 1.2 m/s
    alpha, beta = (1.2 * x / math.radians(30.0) for x in (8.564, 2.572))
    loop = TransferFunction((k_A * k_I, k_A * (k_FF + k_P)), (k_A * k_I, k_I + k_A * (k_FF + k_P), beta + k_P, alpha))
    omega_n, zeta = oscillation_of(loop)
    for slug, true in (("natural-frequency", omega_n), ("damping", zeta)):
        reported = sheet[slug].reading
        assert 0.0 < reported.std < 0.1 * true
        assert abs(reported.value - true) < 3.0 * reported.std
    assert sheet["explained"].reading.value > 0.95
    assert sheet.doubts == ()


def test_a_bollard_staircase_with_measured_pulls_gives_a_thruster_map(tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path, "blueboat")
    options = {"duration": 26.0, "steering": 0.3, "levels": 3.0}
    result = flown(harness, options, "bollard-staircase", force="X")
    assert result.preview.room < 0.1  # tied up
    assert not any("sign check" in text for text in harness.said)
    assert "--forces" in result.remarks[0]
    table = harness.directory / "bollard-staircase.csv"
    commands = [float(row.split(",")[0]) for row in table.read_text().splitlines()[1:]]
    assert commands == pytest.approx([0, 0.1, 0.2, 0.3, 0.2, 0.1, 0, -0.1, -0.2, -0.3, -0.2, -0.1, 0], abs=0.005)
    pulls = [110.4 * c * (1.0 if c > 0.0 else 0.5) for c in commands]
    fit = fit_thruster(read_pull_test(table, pulls=pulls))
    assert fit.map.force(0.25) == pytest.approx(27.6, rel=0.1)
    with pytest.raises(NotInformative, match="one force per row"):
        read_pull_test(table, pulls=pulls[1:])
    harness.assert_neutral()
