"""What an effect is worth to who knows the weather: the yardstick of the blind cases in rough water."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.blind.astray import water_of, whitened
from benchmarks.blind.case import draw_case
from benchmarks.blind.craft import Craft, draw_craft
from benchmarks.blind.noise_search import marked, report
from benchmarks.blind.oracle import visible, worth
from benchmarks.blind.process_noise import BURSTS, CALM, smoothed
from benchmarks.blind.rough import PAIR
from benchmarks.blind.secret import Hidden
from benchmarks.blind.voyage import Flown, draw_voyage, fly

NOISE = 0.002


def craft() -> Craft:
    return replace(draw_craft("yaw", np.random.default_rng(8)), samples=450)


def flown(*hidden: Hidden, weather: float = 0.3, burst: float = 0.0, seed: int = 4) -> Flown:
    """Return a voyage with that *hidden*, in *weather* in shares of full command."""
    ours = craft()
    full = ours.full[ours.input]
    values = {
        "spread": weather * full,
        "memory": 2.0 * ours.pace,
        "burst": burst * full,
        "every": 0.2 * ours.duration,
    }
    everything = (*hidden, Hidden("weather", ours.input, values, ours))
    voyage = draw_voyage(np.random.default_rng(seed), everything)
    return Flown(voyage, everything, tuple(fly(voyage, everything, {"psi": NOISE})))


def dead_zone(share: float) -> Hidden:
    ours = craft()
    return Hidden("dead-zone", ours.input, {"width": share * ours.full[ours.input]}, ours)


def waves() -> Hidden:
    ours = craft()
    values = {"moment": 0.2 * ours.full[ours.input], "swing": 0.01, "frequency": 1.0 / ours.pace, "damping": 0.1}
    return Hidden("waves", ours.input, values, ours)


def late(share: float) -> Hidden:
    ours = craft()
    return Hidden("lag", ours.input, {"delay": share * ours.pace, "time_constant": 0.0}, ours)


def filtered(share: float) -> Hidden:
    ours = craft()
    return Hidden("lag", ours.input, {"delay": 0.0, "time_constant": share * ours.pace}, ours)


def day(run: int, moment: float, thrust: float) -> Hidden:
    ours = craft()
    values = {"moment": moment * ours.full[ours.input], "thrust": thrust}
    return Hidden("day", ours.input, values, ours, in_runs=(run,))


def drag(share: float) -> Hidden:
    ours = craft()
    return Hidden("quadratic-drag", "yaw", {"coefficient": share * ours.linear["yaw"] / ours.top["yaw"]}, ours)


AROUND = {
    "even weather": (dead_zone(0.0),),
    "drag": (drag(1e-9),),
    "waves": (dead_zone(0.0), waves()),
    "late": (drag(1e-9), late(0.7)),
    "filtered": (drag(1e-9), filtered(0.5)),
    "days": (dead_zone(0.0), day(0, 0.1, 1.1), day(1, -0.1, 0.9)),
    "late amid waves": (dead_zone(0.0), waves(), late(0.7)),
}


@pytest.mark.parametrize(
    "name", [name if name == "even weather" else pytest.param(name, marks=pytest.mark.slow) for name in AROUND]
)
def test_an_effect_of_no_size_is_worth_nothing(name: str) -> None:
    burst = 0.0 if name == "even weather" else 1.0
    nats = [worth(flown(*AROUND[name], burst=burst, seed=seed), NOISE) for seed in range(4, 10)]
    assert max(nats) < 0.1
    assert np.mean(nats) == pytest.approx(-1.0, abs=1.0)  # what gain and damping, fitted to the plain craft alone, gain


@pytest.mark.slow
def test_without_weather_an_effect_of_no_size_is_worth_nothing_either() -> None:
    nats = [worth(flown(dead_zone(0.0), weather=1e-6, seed=seed), NOISE) for seed in range(4, 10)]
    assert np.mean(nats) == pytest.approx(-1.0, abs=1.0)


@pytest.mark.parametrize("strong", [dead_zone(0.3), drag(2.0)], ids=["dead zone", "drag"])
def test_a_strong_effect_is_worth_hundreds_without_weather_and_less_the_more_there_is(strong: Hidden) -> None:
    calm, mild, rough = (worth(flown(strong, weather=w), NOISE) for w in (1e-6, 0.1, 1.0))
    assert calm > 300.0
    assert calm > mild > rough


def test_the_filter_agrees_with_the_density_of_all_samples_together() -> None:
    short = flown(waves())
    damping = np.array([[0.5, 0.9], [0.7, 1.4], [1.2, 1.0]])[np.arange(11) % 3] / craft().pace
    water = water_of(short, np.array([1.0, 1.1]), damping, NOISE)
    strayed = 0.01 * np.random.default_rng(1).normal(size=(12, 2, 1))
    z, logs = whitened(water, strayed)
    dense = 0.0
    for run in range(2):
        covariances, crossing = [water.P[run]], np.zeros((12, 12))
        for F, Q in zip(water.F[:, run], water.Q[:, run], strict=True):
            covariances.append(F @ covariances[-1] @ F.T + Q)
        for i in range(12):
            reached = covariances[i]
            for j in range(i, 12):
                crossing[i, j] = crossing[j, i] = water.H @ reached @ water.H
                reached = water.F[j, run] @ reached if j < 11 else reached
        crossing += NOISE**2 * np.eye(12)
        y = strayed[:, run, 0]
        dense += y @ np.linalg.solve(crossing, y) + np.linalg.slogdet(crossing)[1]
    assert float(np.sum(z**2)) + logs == pytest.approx(float(dense), rel=1e-9)


def test_what_the_filter_does_not_foresee_is_as_large_as_it_says() -> None:
    ours = flown(waves(), day(0, 0.0, 1.1), burst=1.0)
    runs = len(ours.files)
    calm = fly(ours.voyage, [])
    thrust = np.where(np.arange(runs) == 0, 1.1, 1.0)
    apart = np.stack([f["psi"] - c["psi"] for f, c in zip(ours.files, calm, strict=True)], axis=1)
    apart[:, 0] -= 0.1 * (calm[0]["psi"] - calm[0]["psi"][0])
    water = water_of(ours, thrust, np.full((1, runs), 1.0 / craft().pace), NOISE)
    z, _ = whitened(water, apart[..., None])
    assert np.mean(z**2, axis=(0, 2)) == pytest.approx(np.ones(runs), abs=3.5 * np.sqrt(2.0 / len(z)))


def test_a_smoother_can_be_undone_and_hides_what_only_a_referee_sees() -> None:
    file = flown(weather=0.3, burst=1.0).files[0]
    assert BURSTS in file
    seen = smoothed(file, 3)
    assert BURSTS not in seen and all(BURSTS not in run.channels for run in draw_case("rough", 5, 0, CALM).runs)
    psi, keep = seen["psi"][::-1].copy(), 2.0 / 3.0
    for _ in range(2):
        psi[1:] = (psi[1:] - keep * psi[:-1]) / (1.0 - keep)
        psi = psi[::-1]
    assert psi[::-1] == pytest.approx(file["psi"], abs=1e-9)


def test_drawn_cases_carry_what_the_oracle_needs_and_pairs_and_clean_ones_are_left_out() -> None:
    kinds = [("process-noise", "saturation"), ("rough", "quadratic-drag"), ("rough", PAIR), ("rough", CALM)]
    told = [visible(draw_case(kind, 5, 0, slug)) for kind, slug in kinds]
    assert all(isinstance(nats, float) and np.isfinite(nats) for nats in told[:2])
    assert told[2:] == [None, None]
    assert visible(draw_case("single", 5, 0, "dead-zone")) is None


def test_rates_are_told_of_what_can_be_seen() -> None:
    row = {"truth": ["dead-zone"], "named": ["dead-zone"], "groups": [], "circumstances": [], "worth": 0.0}
    rows = [{**row, "weather": w, "visible": v} for w, v in ((0.2, 12.0), (0.8, 40.0), (0.3, 9.0), (0.2, None))]
    told = "\n".join(report([{**r, **marked(r)} for r in rows]))
    assert "2 of 3 effects" in told
    assert any(line.startswith("  visible effects, right") and "2 of    2" in line for line in told.splitlines())
    assert any(line.startswith("  visible effects in noise") and "1 of    1" in line for line in told.splitlines())
    assert "known disturbance" not in "\n".join(report([{**rows[3], **marked(row)}]))
