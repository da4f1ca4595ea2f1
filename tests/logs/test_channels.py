"""From a store to channels, one sample at a time."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs_autotune.logs.channels import filters_of, motion_channels
from gcs_autotune.logs.sample_store import SampleStore

NORTH, EAST = (1.0, 0.0), (0.0, 1.0)


def store(heading: float, wander: float, *, over: tuple[float, float] = NORTH, source: str = "local") -> SampleStore:
    """Heading samples at whole tenths alternate about *heading*; velocity over ground is half-way between."""
    found = SampleStore("log", "ms")
    for k in range(40):
        psi = heading + (wander if k % 2 else -wander)
        found.take(0.1 * k, {"attitude.phi": 0.0, "attitude.theta": 0.0, "attitude.psi": math.remainder(psi, math.tau)})
        moved = 0.1 * k * np.array(over)
        found.take(0.1 * k + 0.05, {f"{source}.x": moved[0], f"{source}.y": moved[1]})
        found.take(0.1 * k + 0.05, {f"{source}.vn": over[0], f"{source}.ve": over[1]})
    return found


@pytest.mark.parametrize(
    ("heading", "over", "ahead", "to_starboard"),
    [
        (0.0, NORTH, 1.0, 0.0),
        (0.0, EAST, 0.0, 1.0),
        (math.pi, NORTH, -1.0, 0.0),
        (math.pi, EAST, 0.0, -1.0),
        (-math.pi / 2.0, NORTH, 0.0, 1.0),
    ],
)
@pytest.mark.parametrize("source", ["local", "ekf"])
def test_velocity_over_ground_is_rotated_by_the_heading_also_across_south(
    heading: float, over: tuple[float, float], ahead: float, to_starboard: float, source: str
) -> None:
    channels, sources = motion_channels(store(heading, 0.05, over=over, source=source))
    inside = channels["u"].t <= channels["psi"].t[-1]
    assert inside.sum() == 39
    assert channels["u"].values[inside] == pytest.approx(np.full(39, ahead), abs=2e-3)
    assert channels["v"].values[inside] == pytest.approx(np.full(39, to_starboard), abs=2e-3)
    assert channels["U"].values == pytest.approx(np.ones(40))
    assert {sources[n] for n in "xyUuv"} == {source}


def test_the_heading_itself_stays_as_it_was_recorded() -> None:
    channels, _ = motion_channels(store(math.pi, 0.05))
    assert np.abs(channels["psi"].values).max() <= math.pi
    assert np.ptp(channels["psi"].values) > 6.0


def test_a_source_with_too_few_or_constant_samples_is_skipped() -> None:
    found = store(0.0, 0.05, source="gps")
    for k in range(30):
        found.take(0.1 * k, {"ekf.x": 5.0, "ekf.y": 5.0})
    for k in range(19):
        found.take(0.1 * k, {"local.x": 1.0 * k, "local.y": 0.0})
    channels, sources = motion_channels(found)
    assert sources["x"] == sources["u"] == "gps"
    assert len(channels["x"]) == 40


@pytest.mark.parametrize(("moves", "expected"), [(True, "control"), (False, "global")])
def test_a_changing_depth_is_preferred_to_a_constant_one(moves: bool, expected: str) -> None:
    found = SampleStore("log", "ms")
    for k in range(30):
        found.take(0.1 * k, {"global.z": 2.0, "global.w": 0.0})
        found.take(0.1 * k, {"control.z": 2.0 + 0.1 * k * moves})
    channels, sources = motion_channels(found)
    assert sources["z"] == expected
    assert ("w" in channels) is (expected == "global")


@pytest.mark.parametrize(
    ("vz", "size", "source", "down"),
    [
        (-1.0, 0.5, "global", True),
        (1.0, 0.5, "global", False),
        (-1.0, 0.5, "local", False),
        (-1.0, 0.004, "global", False),
        (-0.3, 0.5, "global", True),
    ],
)
def test_an_upward_vertical_speed_of_older_firmware_is_inverted_by_comparison_with_depth(
    vz: float, size: float, source: str, down: bool
) -> None:
    found = SampleStore("log", "ms")
    noise = np.random.default_rng(0).normal(0.0, 0.02 * size, 200)
    for k in range(200):
        t = 0.2 * k
        found.take(t, {f"{source}.z": 2.0 + size * math.sin(0.5 * t) + noise[k]})
        found.take(t, {f"{source}.w": vz * 0.5 * size * math.cos(0.5 * t)})
    channels, sources = motion_channels(found)
    turned = bool(channels["w"].values[0] * vz < 0.0)
    assert turned is down
    assert sources["w"] == (f"{source}, converted to depth" if down else source)


@pytest.mark.parametrize("count", [19, 20])
def test_without_velocity_the_speed_comes_from_the_first_source_with_enough_samples(count: int) -> None:
    found = SampleStore("log", "ms")
    for k in range(30):
        if k < count:
            found.take(0.1 * k, {"hud.U": 1.5})
        found.take(0.1 * k, {"gps.U": 2.5})
    channels, sources = motion_channels(found)
    assert (sources["U"], channels["U"].values[0]) == (("hud", 1.5) if count == 20 else ("gps", 2.5))


@pytest.mark.parametrize(("cutoff", "known"), [(0.0, False), (-1.0, False), (0.5, True), (1.0, True), (20.0, True)])
def test_a_gyro_filter_is_recorded_with_its_delay(cutoff: float, known: bool) -> None:
    found = filters_of({"INS_GYRO_FILTER": cutoff}, {"r": "imu", "q": "ekf", "u": "gps"})
    assert set(found) == ({"r", "q"} if known else set())
    if known:
        assert found["r"]["delay_s"] == pytest.approx(math.sqrt(2.0) / (2.0 * math.pi * cutoff), abs=1e-6)
        assert (found["r"]["bias_removed"], found["q"]["bias_removed"]) == (False, True)
