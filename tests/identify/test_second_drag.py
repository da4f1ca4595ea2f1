"""A small second drag: what is reported when the record hardly shows it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from axis_plants import DEG, Relay

from gcs_autotune.identify import AxisFit, fit_axis
from gcs_autotune.trial import Channel, Trial

SEEDS = 24
NOISE = 0.008
MOSTLY_LINEAR = (0.2, 0.75, 0.025, 0.0)
LINEAR = (0.2, 0.75, 0.0, 0.0)


def runs(record: Callable[..., Trial], plant: tuple[float, ...]) -> list[Trial]:
    return [record(plant, Relay(C, 15 * DEG), 25.0, name=str(C)) for C in (0.3, 0.6)]


def fits(clean: list[Trial]) -> list[AxisFit]:
    found = []
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        noisy = [
            Trial(
                t.name,
                {"psi": Channel("psi", "rad", t["psi"].t, t["psi"].values + rng.normal(0.0, NOISE, len(t["psi"])))}
                | {"N": t["N"]},
            )
            for t in clean
        ]
        found.append(fit_axis(noisy, delay=0.0))
    return found


@pytest.fixture(scope="module")
def hardly_affine(record: Callable[..., Trial]) -> list[AxisFit]:
    return fits(runs(record, MOSTLY_LINEAR))


@pytest.fixture(scope="module")
def truly_linear(record: Callable[..., Trial]) -> list[AxisFit]:
    return fits(runs(record, LINEAR))


def coverage(found: list[AxisFit], std: list[float]) -> float:
    errors = np.array([f.parameters["beta_r"].value - 0.75 for f in found])
    return float(np.mean(np.abs(errors) <= 1.96 * np.array(std)))


@pytest.mark.slow
def test_the_drag_interval_covers_the_truth_although_a_second_drag_is_left_out(hardly_affine: list[AxisFit]) -> None:
    kept = [f for f in hardly_affine if f.structure == "linear"]
    assert len(kept) >= SEEDS // 3
    raised = [f.parameters["beta_r"].std for f in kept]
    bare = [min(raised)] * len(kept)
    assert coverage(kept, raised) >= coverage(kept, bare) + 0.2
    assert coverage(hardly_affine, [f.parameters["beta_r"].std for f in hardly_affine]) >= 0.75


def gain_of_two(fit: AxisFit) -> float:
    """Return by how much BIC is lower with both drags than with the linear one alone."""
    bic = {c.structure: c.bic for c in fit.candidates}
    return bic["linear"] - bic["affine"]


def test_an_undecided_second_drag_is_a_doubt(hardly_affine: list[AxisFit]) -> None:
    undecided = [f for f in hardly_affine if f.structure == "linear" and gain_of_two(f) > -2.0]
    assert 0 < len(undecided) < SEEDS
    assert [f for f in hardly_affine if "second-drag-undecided" in {d.slug for d in f.doubts}] == undecided


def test_both_drags_are_chosen_if_the_record_supports_them(hardly_affine: list[AxisFit]) -> None:
    both = [f for f in hardly_affine if f.structure == "affine"]
    assert len(both) >= SEEDS // 8
    assert min(gain_of_two(f) for f in both) > 2.0
    assert min(min(f.model.beta, f.model.beta_quadratic) for f in both) > 0.0
    assert max(gain_of_two(f) for f in hardly_affine if f.structure == "linear") <= 2.0


@pytest.mark.slow
def test_a_linear_drag_stays_linear_and_mostly_without_doubt(truly_linear: list[AxisFit]) -> None:
    assert [f.structure for f in truly_linear].count("linear") == SEEDS
    doubted = [f for f in truly_linear if "second-drag-undecided" in {d.slug for d in f.doubts}]
    assert len(doubted) <= 2
    assert coverage(truly_linear, [f.parameters["beta_r"].std for f in truly_linear]) >= 0.85
