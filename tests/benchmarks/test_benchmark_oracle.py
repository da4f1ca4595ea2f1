"""The improvement by the true effect with known disturbances."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.blind.case import draw_case
from benchmarks.blind.craft import Craft, draw_craft
from benchmarks.blind.disturbance_filter import disturbance_model, whitened
from benchmarks.blind.flight_plan import FlownRuns, draw_flight_plan, fly
from benchmarks.blind.hidden import Hidden
from benchmarks.blind.noise_search import marked, report
from benchmarks.blind.oracle import improvement, visible
from benchmarks.blind.process_noise import BURSTS, CALM, smoothed
from benchmarks.blind.rough_water import PAIR

NOISE = 0.002


def craft() -> Craft:
    return replace(draw_craft("yaw", np.random.default_rng(8)), samples=450)


def flown(*hidden: Hidden, drift: float = 0.3, burst: float = 0.0, seed: int = 4) -> FlownRuns:
    """Return runs with *hidden* effects and a drifting moment of *drift* (fraction of full command)."""
    ours = craft()
    full = ours.full[ours.input]
    values = {
        "spread": drift * full,
        "memory": 2.0 * ours.pace,
        "burst": burst * full,
        "every": 0.2 * ours.duration,
    }
    everything = (*hidden, Hidden("drifting-moment", ours.input, values, ours))
    plan = draw_flight_plan(np.random.default_rng(seed), everything)
    return FlownRuns(plan, everything, tuple(fly(plan, everything, {"psi": NOISE})))


def dead_zone(share: float) -> Hidden:
    ours = craft()
    return Hidden("dead-zone", ours.input, {"width": share * ours.full[ours.input]}, ours)


def waves() -> Hidden:
    ours = craft()
    values = {"moment": 0.2 * ours.full[ours.input], "heading": 0.01, "frequency": 1.0 / ours.pace, "damping": 0.1}
    return Hidden("waves", ours.input, values, ours)


def late(share: float) -> Hidden:
    ours = craft()
    return Hidden("lag", ours.input, {"delay": share * ours.pace, "time_constant": 0.0}, ours)


def filtered(share: float) -> Hidden:
    ours = craft()
    return Hidden("lag", ours.input, {"delay": 0.0, "time_constant": share * ours.pace}, ours)


def differing(run: int, moment: float, thrust: float) -> Hidden:
    ours = craft()
    values = {"moment": moment * ours.full[ours.input], "thrust": thrust}
    return Hidden("run-to-run", ours.input, values, ours, in_runs=(run,))


def drag(share: float) -> Hidden:
    ours = craft()
    return Hidden("quadratic-drag", "yaw", {"coefficient": share * ours.linear["yaw"] / ours.top["yaw"]}, ours)


AROUND = {
    "even": (dead_zone(0.0),),
    "drag": (drag(1e-9),),
    "waves": (dead_zone(0.0), waves()),
    "late": (drag(1e-9), late(0.7)),
    "filtered": (drag(1e-9), filtered(0.5)),
    "run to run": (dead_zone(0.0), differing(0, 0.1, 1.1), differing(1, -0.1, 0.9)),
    "late amid waves": (dead_zone(0.0), waves(), late(0.7)),
}


@pytest.mark.parametrize(
    "name", [name if name == "even" else pytest.param(name, marks=pytest.mark.slow) for name in AROUND]
)
def test_an_effect_of_no_size_improves_nothing(name: str) -> None:
    burst = 0.0 if name == "even" else 1.0
    nats = [improvement(flown(*AROUND[name], burst=burst, seed=seed), NOISE) for seed in range(4, 10)]
    assert max(nats) < 0.1
    assert np.mean(nats) == pytest.approx(-1.0, abs=1.0)  # what gain and damping, fitted to the plain craft alone, gain


@pytest.mark.slow
def test_without_disturbances_an_effect_of_no_size_improves_nothing_either() -> None:
    nats = [improvement(flown(dead_zone(0.0), drift=1e-6, seed=seed), NOISE) for seed in range(4, 10)]
    assert np.mean(nats) == pytest.approx(-1.0, abs=1.0)


@pytest.mark.parametrize("strong", [dead_zone(0.3), drag(2.0)], ids=["dead zone", "drag"])
def test_the_gain_of_a_strong_effect_falls_with_the_disturbance(strong: Hidden) -> None:
    calm, mild, rough = (improvement(flown(strong, drift=w), NOISE) for w in (1e-6, 0.1, 1.0))
    assert calm > 300.0
    assert calm > mild > rough


def test_the_filter_agrees_with_the_density_of_all_samples_together() -> None:
    short = flown(waves())
    damping = np.array([[0.5, 0.9], [0.7, 1.4], [1.2, 1.0]])[np.arange(11) % 3] / craft().pace
    model = disturbance_model(short, np.array([1.0, 1.1]), damping, NOISE)
    deviations = 0.01 * np.random.default_rng(1).normal(size=(12, 2, 1))
    z, logs = whitened(model, deviations)
    dense = 0.0
    for run in range(2):
        covariances, crossing = [model.P[run]], np.zeros((12, 12))
        for F, Q in zip(model.F[:, run], model.Q[:, run], strict=True):
            covariances.append(F @ covariances[-1] @ F.T + Q)
        for i in range(12):
            reached = covariances[i]
            for j in range(i, 12):
                crossing[i, j] = crossing[j, i] = model.H @ reached @ model.H
                reached = model.F[j, run] @ reached if j < 11 else reached
        crossing += NOISE**2 * np.eye(12)
        y = deviations[:, run, 0]
        dense += y @ np.linalg.solve(crossing, y) + np.linalg.slogdet(crossing)[1]
    assert float(np.sum(z**2)) + logs == pytest.approx(float(dense), rel=1e-9)


def test_innovations_have_the_predicted_size() -> None:
    ours = flown(waves(), differing(0, 0.0, 1.1), burst=1.0)
    runs = len(ours.files)
    calm = fly(ours.plan, [])
    thrust = np.where(np.arange(runs) == 0, 1.1, 1.0)
    apart = np.stack([f["psi"] - c["psi"] for f, c in zip(ours.files, calm, strict=True)], axis=1)
    apart[:, 0] -= 0.1 * (calm[0]["psi"] - calm[0]["psi"][0])
    model = disturbance_model(ours, thrust, np.full((1, runs), 1.0 / craft().pace), NOISE)
    z, _ = whitened(model, apart[..., None])
    assert np.mean(z**2, axis=(0, 2)) == pytest.approx(np.ones(runs), abs=3.5 * np.sqrt(2.0 / len(z)))


def test_a_smoother_can_be_undone_and_removes_the_column_of_bursts() -> None:
    file = flown(drift=0.3, burst=1.0).files[0]
    assert BURSTS in file
    seen = smoothed(file, 3)
    assert BURSTS not in seen and all(BURSTS not in run.channels for run in draw_case("rough", 5, 0, CALM).runs)
    psi, keep = seen["psi"][::-1].copy(), 2.0 / 3.0
    for _ in range(2):
        psi[1:] = (psi[1:] - keep * psi[:-1]) / (1.0 - keep)
        psi = psi[::-1]
    assert psi[::-1] == pytest.approx(file["psi"], abs=1e-9)


def test_drawn_cases_contain_what_the_oracle_needs_except_pairs_and_clean_ones() -> None:
    kinds = [("process-noise", "saturation"), ("rough", "quadratic-drag"), ("rough", PAIR), ("rough", CALM)]
    gains = [visible(draw_case(kind, 5, 0, slug)) for kind, slug in kinds]
    assert all(isinstance(nats, float) and np.isfinite(nats) for nats in gains[:2])
    assert gains[2:] == [None, None]
    assert visible(draw_case("single", 5, 0, "dead-zone")) is None


def test_rates_are_reported_for_visible_effects() -> None:
    row = {"truth": ["dead-zone"], "named": ["dead-zone"], "groups": [], "circumstances": [], "improvement": 0.0}
    rows = [{**row, "noise_share": w, "visible": v} for w, v in ((0.2, 12.0), (0.8, 40.0), (0.3, 9.0), (0.2, None))]
    text = "\n".join(report([{**r, **marked(r)} for r in rows]))
    assert "2 of 3 effects" in text
    assert any(line.startswith("  visible effects, right") and "2 of    2" in line for line in text.splitlines())
    assert any(line.startswith("  visible effects in noise") and "1 of    1" in line for line in text.splitlines())
    assert "known disturbance" not in "\n".join(report([{**rows[3], **marked(row)}]))
