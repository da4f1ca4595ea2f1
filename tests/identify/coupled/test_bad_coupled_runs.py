"""Bad data for a coupled model: the same damaged records as for one axis, through the same interface."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping

import numpy as np
import pytest
from coupled_plants import BOAT, horizontal, levels, sail

from gcs_autotune.errors import BadFile, MissingChannel, NotInformative
from gcs_autotune.identify import Fit, fit
from gcs_autotune.identify.signals import prepare_form
from gcs_autotune.models import FORMS
from gcs_autotune.trial import Channel, Trial

NOISE = {"x": 0.05, "y": 0.05, "psi": 0.005, "u": 0.02, "v": 0.02, "r": 0.005}
UNITS = {"x": "m", "y": "m", "psi": "rad", "u": "m/s", "v": "m/s", "r": "rad/s"}
PLAIN = dict.fromkeys(BOAT, 0.0) | {
    n: BOAT[n] for n in ("X_udot", "Y_vdot", "N_rdot", "X_u", "Y_v", "N_r", "X_0", "N_0")
}
FORM = FORMS["horizontal"].without("Y_0")


def sailed(seed: int, boat: Mapping[str, float] = BOAT, seconds: float = 40.0) -> Trial:
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 0.1)
    tau = np.column_stack([levels(rng, t, 6.0, 5.0, 40.0), levels(rng, t, 4.0, -8.0, 8.0)])
    X = sail(horizontal(boat), np.zeros(6), t, t, tau)
    channels = {n: Channel(n, UNITS[n], t, X[:, i] + rng.normal(0.0, NOISE[n], len(t))) for i, n in enumerate(UNITS)}
    channels["X"], channels["N"] = Channel("X", "N", t, tau[:, 0]), Channel("N", "N m", t, tau[:, 1])
    return Trial(f"run {seed}", channels)


@pytest.fixture(scope="module")
def runs() -> list[Trial]:
    return [sailed(seed) for seed in (11, 12)]


def spoilt(trial: Trial, change: Callable[[Channel], Channel], *names: str) -> Trial:
    channels = {n: change(c) if not names or n in names else c for n, c in trial.channels.items()}
    return dataclasses.replace(trial, channels=channels)


def is_right(found: Fit) -> bool:
    free = [p for p in found.parameters.values() if p.status == "fitted"]
    return all(abs(p.value - BOAT[p.name]) <= 4.5 * p.std for p in free)


def slugs(found: Fit) -> set[str]:
    return {d.slug for d in found.doubts}


def test_gaps_restarts_missing_and_late_samples_in_one_file_are_reported_and_tolerated(runs: list[Trial]) -> None:
    def bad(c: Channel) -> Channel:
        keep = ~((c.t > 12.0) & (c.t < 15.0))
        t, values = c.t[keep].copy(), c.values[keep].copy()
        t[[30, 31]], values[[30, 31]] = t[[31, 30]], values[[31, 30]]
        if c.name in ("u", "r"):
            values[[5, 60, 61]] = np.nan
        return dataclasses.replace(c, t=np.where(t >= 27.0, t - 20.0, t), values=values)

    found = fit([spoilt(runs[0], bad), runs[1]], FORM, delay=0.0)
    assert {"gaps", "clock-jump", "late-samples", "missing-samples"} <= slugs(found)
    assert found.used == ("run 11 (part 1)", "run 11 (part 2)", "run 12")
    assert is_right(found)


def test_repeated_stamps_are_dropped_and_reported(runs: list[Trial]) -> None:
    doubled = spoilt(runs[0], lambda c: dataclasses.replace(c, t=np.repeat(c.t, 2), values=np.repeat(c.values, 2)))
    (twice,), (once,) = prepare_form(doubled, FORM), prepare_form(runs[0], FORM)
    assert "repeated-stamps" in {d.slug for d in twice.notes}
    assert all(np.array_equal(twice.signals[n].values, once.signals[n].values) for n in once.signals)


def test_inputs_that_never_change_are_not_informative(runs: list[Trial]) -> None:
    still = spoilt(runs[0], lambda c: dataclasses.replace(c, values=np.full(len(c), 3.0)), "X", "N")
    with pytest.raises(NotInformative, match="ever changes"):
        fit(still, FORM)
    found = fit([still, runs[1]], FORM, delay=0.0)
    assert found.used == ("run 12",)
    assert "run-left-out" in slugs(found)


def test_a_missing_input_is_reported(runs: list[Trial]) -> None:
    channels = {n: c for n, c in runs[0].channels.items() if n != "N"}
    with pytest.raises(MissingChannel, match="run 'no N' lacks the input N"):
        fit([Trial("no N", channels), runs[1]], FORM)


@pytest.mark.parametrize(
    ("channel", "factor", "words"),
    [("psi", 180.0 / np.pi, "degrees"), ("r", 180.0 / np.pi, "degrees"), ("x", 100.0, None)],
)
def test_a_wrong_unit_is_rejected_with_the_unit_of_the_numbers(
    runs: list[Trial], channel: str, factor: float, words: str | None
) -> None:
    names = (channel,) if channel != "x" else ("x", "y")
    wrong = spoilt(runs[0], lambda c: dataclasses.replace(c, values=c.values * factor), *names)
    with pytest.raises(BadFile, match=f"is in {words or 'cm'}"):
        fit([wrong, runs[1]], FORM)


def test_a_clipped_gyro_loses_only_its_clipped_samples(runs: list[Trial]) -> None:
    limit = 0.7 * float(np.max(np.abs(runs[0]["r"].values)))
    clipped = spoilt(runs[0], lambda c: dataclasses.replace(c, values=np.clip(c.values, -limit, limit)), "r")
    found = fit([clipped, runs[1]], FORM, delay=0.0)
    assert "clipped" in slugs(found)
    assert is_right(found)


def test_positions_at_1_hz_and_a_compass_at_10_hz_are_fitted_together() -> None:
    """Compass and gyro at ten, no velocity at all; eight parameters, for speed."""

    def slow(trial: Trial) -> Trial:
        kept = {n: trial[n] for n in ("X", "N", "psi", "r")}
        fixes = {n: dataclasses.replace(trial[n], t=trial[n].t[3::10], values=trial[n].values[3::10]) for n in "xy"}
        return Trial(trial.name, {**kept, **fixes})

    form = FORM.without(*(n for n in FORM.free if not PLAIN.get(n)))
    runs = [slow(sailed(seed, PLAIN, 24.0)) for seed in (21,)]
    parts = prepare_form(runs[0], form)
    assert [len(p.signals["x"].t) for p in parts] == [24]
    found = fit(runs, form, delay=0.0)
    assert is_right(found)
    assert found.fit_percent > 90.0
