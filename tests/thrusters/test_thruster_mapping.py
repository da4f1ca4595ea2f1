"""Pull tests of a simulated thruster: written out here, not taken from the package."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gcs_autotune.errors import BadFile, MissingChannel, NotInformative
from gcs_autotune.thrusters import (
    MapStructure,
    PullTest,
    ThrusterMap,
    TwinThrusters,
    fit_thruster,
    pulls_from_log,
    read_pull_test,
)

BLUEBOAT = Path(__file__).parents[2] / ".." / "shared" / "data" / "blueboat"


def water(n: np.ndarray, ahead: tuple[float, ...], astern: tuple[float, ...]) -> np.ndarray:
    """T by (a, b, edge) of each side, point by point."""
    forces = []
    for c in n:
        if c > ahead[2]:
            forces.append(ahead[0] * (c - ahead[2]) ** 2 + ahead[1] * (c - ahead[2]))
        elif c < astern[2]:
            forces.append(-astern[0] * (astern[2] - c) ** 2 - astern[1] * (astern[2] - c))
        else:
            forces.append(0.0)
    return np.array(forces)


AHEAD, ASTERN = (30.0, 4.0, 0.12), (18.0, 3.0, -0.08)


def pulls(seed: int = 1, noise: float = 0.1, ahead=AHEAD, astern=ASTERN, offset: float = 0.0) -> PullTest:
    n = np.linspace(-1.0, 1.0, 61)
    T = water(n, ahead, astern) + offset + np.random.default_rng(seed).normal(0.0, noise, len(n))
    return PullTest("tank", n, T, "1")


@pytest.mark.slow
def test_dead_zone_and_both_directions_are_identified_within_their_errors():
    fit = fit_thruster(pulls())
    assert "parameters" in str(fit) and "value ± standard error  relative" in str(fit)
    assert fit.structure.dead != "none" and not fit.structure.same_sides
    n = np.linspace(-1.0, 1.0, 201)
    assert np.max(np.abs(fit.map.force(n) - water(n, AHEAD, ASTERN))) < 0.2
    assert fit.noise == pytest.approx(0.1, rel=0.25)


@pytest.mark.slow
def test_a_plain_quadratic_thruster_has_no_dead_zone_and_no_linear_part():
    fit = fit_thruster(pulls(noise=0.05, ahead=(20.0, 0.0, 0.0), astern=(20.0, 0.0, 0.0)))
    assert (fit.structure.shape, fit.structure.dead, fit.structure.same_sides) == ("quadratic", "none", True)
    assert fit.parameters["a_f"].value == pytest.approx(20.0, abs=4.0 * fit.parameters["a_f"].std)


@pytest.mark.slow
def test_the_dynamometers_zero_is_not_mistaken_for_thrust():
    fit = fit_thruster(pulls(offset=1.5))
    assert fit.structure.offset
    assert fit.parameters["offset"].value == pytest.approx(1.5, abs=0.15)
    assert float(fit.map.force(0.0)) == 0.0


@pytest.mark.slow
def test_intervals_cover_the_truth_as_often_as_stated():
    structure = MapStructure("quadratic+linear", False, "free", True)
    truth = {"a_f": 30.0, "b_f": 4.0, "a_b": 18.0, "b_b": 3.0, "x_f": 0.12, "x_b": -0.08, "offset": 0.3}
    inside = [
        abs(fit.parameters[n].value - v) < 1.96 * fit.parameters[n].std
        for seed in range(60)
        for fit in [fit_thruster(pulls(seed, offset=0.3), structure=structure)]
        for n, v in truth.items()
    ]
    assert 0.90 < np.mean(inside) < 0.985


@pytest.mark.parametrize("direction", [1, -1])
def test_the_inverse_reverses_the_map_exactly_and_is_monotonic(direction: int):
    thruster = ThrusterMap(30.0, 4.0, -2.0, 9.0, 0.12, -0.08, -1.0, 1.0, direction=direction)
    low, high = thruster.limits
    target = np.linspace(low, high, 1001)
    commands = thruster.inverse(target)
    np.testing.assert_allclose(thruster.force(commands), target, atol=1e-12 * (high - low) * 10)
    assert np.all(direction * np.diff(commands) > 0.0)
    assert thruster.inverse(2.0 * high) == thruster.inverse(high)
    assert float(thruster.inverse(1e-9)) == pytest.approx(direction * 0.12, abs=1e-8)
    assert float(thruster.inverse(0.0)) == thruster.neutral
    assert ThrusterMap.from_dict(thruster.to_dict()) == thruster


@pytest.mark.slow
def test_compensation_makes_the_thruster_linear():
    fit = fit_thruster(pulls())
    target = np.linspace(-14.0, 24.0, 77)
    given = water(fit.map.inverse(target), AHEAD, ASTERN)
    assert np.max(np.abs(given - target)) < 0.2


def test_pulls_only_ahead_are_fitted_and_reported_as_one_sided():
    n = np.linspace(0.0, 1.0, 40)
    noise = np.random.default_rng(3).normal(0.0, 0.05, 40)
    fit = fit_thruster(PullTest("tank", n, water(n, AHEAD, ASTERN) + noise, "1"))
    assert "one-sided" in {d.slug for d in fit.doubts}
    assert fit.parameters["x_f"].value == pytest.approx(0.12, abs=0.03)


@pytest.mark.slow
def test_an_outlying_pull_and_a_wrong_curve_are_doubted():
    wild = pulls()
    force = wild.force.copy()
    force[50] += 6.0
    assert "outlying-pulls" in {d.slug for d in fit_thruster(PullTest("t", wild.command, force, "1")).doubts}
    n = np.repeat(np.linspace(-1.0, 1.0, 21), 3)
    bumpy = 20.0 * n + 3.0 * np.sin(9.0 * n) + np.random.default_rng(0).normal(0.0, 0.05, len(n))
    assert "lack-of-fit" in {d.slug for d in fit_thruster(PullTest("t", n, bumpy, "1")).doubts}


@pytest.mark.slow
@pytest.mark.parametrize(("side", "ahead", "astern"), [("left", 0.1344, 0.0709), ("right", 0.1420, 0.0671)])
def test_the_static_map_of_the_blueboat_is_identified(side: str, ahead: float, astern: float):
    if not BLUEBOAT.exists():
        pytest.skip("blueboat runs are not beside the repository (../shared/data)")
    path = BLUEBOAT / "run224.csv"
    fit = fit_thruster(read_pull_test(path, command=f"pwm_{side}", force=f"force_{side}"))
    assert fit.map.direction == (-1 if side == "left" else 1)
    assert (fit.structure.shape, fit.structure.dead) == ("linear", "none")
    assert fit.parameters["b_f"].value == pytest.approx(ahead, abs=1e-4)
    assert fit.parameters["b_b"].value == pytest.approx(astern, abs=1e-4)
    assert fit.map.neutral == pytest.approx(1511.0, abs=0.1)
    assert fit.noise < 0.0035, "what is left is the rounding of the column to 0.01 N"


def test_a_recording_counts_each_hold_once(tmp_path: Path):
    rows = [f"{0.1 * i},{(i // 20) * 10},{0.01 * ((i // 20) * 10) ** 2 + 0.1 * (-1) ** i}" for i in range(200)]
    path = tmp_path / "hold.csv"
    path.write_text("t[s],n[rpm],T[N]\n" + "\n".join(rows) + "\n")
    test = read_pull_test(path)
    assert len(test) == 10 and test.unit == "rad/s"
    np.testing.assert_allclose(test.force, 0.01 * np.arange(0, 100, 10) ** 2, atol=1e-12)


@pytest.mark.parametrize(
    ("text", "error", "words"),
    [
        ("", BadFile, "pull.csv is empty"),
        ("n[rpm];T[N]\n1;2\n", BadFile, "pull.csv separates its columns by ';'"),
        ("n[rpm],T[N]\n1,2\n2\n", BadFile, "row 3"),
        ("n[rpm],T[N]\n1,x\n", BadFile, "row 2"),
        ("n[rpm],T[lb]\n1,2\n", BadFile, r"pull.csv: unit \[lb\] is unknown"),
        ("n[rpm],depth[m]\n1,2\n", MissingChannel, "force"),
        ("n[rpm],T[N]\n1,2\n2,3\n", NotInformative, "different commands"),
        ("n[rpm],T[N]\n1,2\n2,2\n3,2\n4,2\n5,2\n6,2\n", NotInformative, "never changes"),
    ],
)
def test_invalid_tables_are_rejected_with_a_reason(tmp_path: Path, text: str, error: type[Exception], words: str):
    path = tmp_path / "pull.csv"
    path.write_text(text)
    with pytest.raises(error, match=words):
        read_pull_test(path)


@pytest.mark.parametrize("head", ["n[1/s]", "n[rev/s]", "[n[1/s]]", "n[Hz]"])
def test_revolutions_per_second_are_converted(tmp_path: Path, head: str):
    path = tmp_path / "pull.csv"
    path.write_text(f"{head},T[N]\n" + "".join(f"{k},{0.1 * k * k}\n" for k in range(-5, 6)))
    assert read_pull_test(path).command == pytest.approx(2.0 * np.pi * np.arange(-5, 6))


def test_kilograms_of_a_luggage_scale_are_converted_to_newtons(tmp_path: Path):
    path = tmp_path / "pull.csv"
    path.write_text("pwm[us],T[kgf]\n" + "\n".join(f"{1500 + 50 * k},{k}" for k in range(8)) + "\n")
    test = read_pull_test(path)
    assert test.unit == "us"
    assert test.force[1] == pytest.approx(9.80665)


def test_twin_thrusters_give_the_requested_forces_and_keep_the_moment_when_saturated():
    one = ThrusterMap(30.0, 4.0, 18.0, 3.0, 0.12, -0.08, -1.0, 1.0)
    twin = TwinThrusters(one, one, 0.4)
    command = twin.commands(10.0, 1.5)
    assert not command.saturated
    assert (command.X, command.N) == pytest.approx((10.0, 1.5))
    # written out: T_1 = X/2 + N/B, T_2 = X/2 - N/B
    assert float(one.force(command.port)) == pytest.approx(5.0 + 1.5 / 0.4)
    full = twin.commands(200.0, 3.0)
    assert full.saturated and full.N == pytest.approx(3.0) and full.X < 2.0 * one.limits[1]
    assert full.port == pytest.approx(1.0)
    round_ = twin.commands(0.0, 1e3)
    assert round_.saturated and round_.N == pytest.approx(0.2 * (one.limits[1] - one.limits[0]))


def bollard(folder: Path, *, clock: float, shown: float = 1.0) -> tuple[Path, Path, list[float]]:
    """Write the levels of a bollard run and a load cell's log on a clock of its own, slow to respond and noisy."""
    levels = [0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 0.0, -0.3, -0.6, -0.9]
    rows = [f"{c},,{100.0 + 8.0 * k:.2f},{108.0 + 8.0 * k:.2f}" for k, c in enumerate(levels)]
    table, log = folder / "bollard.csv", folder / "cell.csv"
    table.write_text("command[1],force[N],from[s],to[s]\n" + "\n".join(rows) + "\n")
    t = np.arange(90.0, 100.0 + 80.0 * shown + 5.0, 0.1)
    pulls = [20.0 * c * abs(c) for c in levels]
    target = np.array([pulls[k] if 0 <= k < len(levels) else 0.0 for k in np.floor((t - 100.0) / 8.0).astype(int)])
    force = np.zeros(len(t))
    for i in range(1, len(t)):
        force[i] = force[i - 1] + 0.1 / 0.6 * (target[i] - force[i - 1])
    force += np.random.default_rng(1).normal(0.0, 0.2, len(t))
    log.write_text("t[s],force[N]\n" + "\n".join(f"{a + clock:.2f},{b:.3f}" for a, b in zip(t, force, strict=True)))
    return table, log, pulls


@pytest.mark.parametrize("clock", [0.0, 1234.5, -60.0])
def test_a_load_cell_log_is_aligned_with_the_levels_for_any_clock_offset(tmp_path: Path, clock: float) -> None:
    table, log, pulls = bollard(tmp_path, clock=clock)
    found, offset = pulls_from_log(table, log)
    assert offset == pytest.approx(clock, abs=1.5)
    np.testing.assert_allclose(found, pulls, atol=0.3)


def test_a_log_that_is_too_short_or_has_no_times_is_rejected(tmp_path: Path) -> None:
    table, log, _ = bollard(tmp_path, clock=0.0, shown=0.5)
    with pytest.raises(NotInformative, match="must cover the 80 s of command levels"):
        pulls_from_log(table, log)
    log.write_text("force[N]\n1\n2\n")
    with pytest.raises(MissingChannel, match=r"needs t\[s\]"):
        pulls_from_log(table, log)
