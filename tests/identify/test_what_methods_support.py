"""What each method supports, as in the table of docs/identify.md: stamps, rounding, outliers, delay, effects."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from axis_plants import DEG, Relay

from gcs_autotune.errors import UsageError
from gcs_autotune.identify import METHODS, Fit, fit
from gcs_autotune.identify.method import Bears
from gcs_autotune.models import Form
from gcs_autotune.trial import Channel, Trial

QUICK, STEP, NOISE = (0.031, 0.0, 0.069, 0.003), 0.02, 0.004
SLOW = (2.0, 1.5, 0.0, 0.05)
FORM = Form("yaw", "", ("yaw",), ("N_rdot", "N_rr", "N_0"), {}, {"N": (("N", 1.0),)}, coriolis=False)
GENERAL = [name for name, method in METHODS.items() if method.coupled]
"""The methods for any input; the others read figures off a manoeuvre."""

COLUMNS = dict(zip(("stamps", "rounding", "outliers", "delay", "effects", "lever arm"), get_args(Bears), strict=True))
DOCS = Path(__file__).parents[2] / "docs" / "identify.md"


def bearing(what: Bears, *, able: bool = True) -> list[str]:
    return [name for name in GENERAL if (what in METHODS[name].bears) == able]


@pytest.fixture(scope="module")
def calm(record: Callable[..., Trial]) -> list[Trial]:
    return [record(QUICK, Relay(C, 15 * DEG), 20.0, dt=STEP, name=str(C)) for C in (0.08, 0.16)]


@pytest.fixture(scope="module")
def dated(calm: list[Trial]) -> list[Trial]:
    """Changes dated half a step too early, as if midway between two messages; heading at a fifth of the rate."""
    runs = []
    for seed, trial in enumerate(calm):
        psi, N = trial["psi"], trial["N"]
        noise = np.random.default_rng(seed).normal(0.0, NOISE, len(psi.t[::5]))
        changed = np.concatenate([[False], np.diff(N.values) != 0.0])
        channels = {
            "psi": Channel("psi", "rad", psi.t[::5], psi.values[::5] + noise),
            "N": dataclasses.replace(N, t=N.t - np.where(changed, 0.5 * STEP, 0.0)),
        }
        runs.append(Trial(trial.name, channels, meta={"outputs_dated": "midway"}))
    return runs


@pytest.fixture(scope="module")
def spoilt(record: Callable[..., Trial]) -> Trial:
    """A turn rate of which eight samples are far off."""
    run = record(SLOW, Relay(1.0, 15 * DEG), 40.0, dt=0.1, rate_noise=0.005)
    values = run["r"].values.copy()
    values[np.random.default_rng(1).choice(len(values), 8, replace=False)] += 1.0
    return dataclasses.replace(run, channels={"N": run["N"], "r": dataclasses.replace(run["r"], values=values)})


def test_the_table_in_the_docs_matches_the_code() -> None:
    rows = [line.strip()[1:-1].split("|") for line in DOCS.read_text(encoding="utf-8").splitlines()]
    head = next(i for i, row in enumerate(rows) if [c.strip() for c in row] == ["method", *COLUMNS])
    result = {}
    for row in rows[head + 2 :]:
        if len(row) != len(COLUMNS) + 1:
            break
        marks = [cell.strip() for cell in row[1:]]
        for name in row[0].replace("`", "").split(","):
            result[name.strip()] = {b for b, mark in zip(COLUMNS.values(), marks, strict=True) if mark == "yes"}
    assert result == {name: set(method.bears) for name, method in METHODS.items()}


@pytest.mark.parametrize("form", [False, True], ids=["axis", "form"])
@pytest.mark.parametrize("name", bearing("stamps"))
def test_early_stamps_do_not_bias_methods_that_support_them(name: str, form: bool, dated: list[Trial]) -> None:
    found = fit(dated, FORM, name, delay=0.0) if form else fit(dated, "nonlinear", name, dof="yaw", delay=0.0)
    inertia = found.parameters["N_rdot" if form else "alpha_r"]
    assert abs(abs(inertia.value) - QUICK[0]) < 4.0 * inertia.std < 0.05 * QUICK[0]
    assert found.extra["time_shift"] == pytest.approx(0.5 * STEP, abs=0.003)
    assert "stamps-taken-as-exact" not in {d.slug for d in found.doubts}


def test_a_method_that_takes_stamps_as_exact_has_a_doubt(dated: list[Trial]) -> None:
    assert "stamps-taken-as-exact" in {d.slug for d in fit(dated, method="iso", dof="yaw").doubts}


@pytest.mark.parametrize("name", bearing("robust"))
def test_outliers_do_not_move_methods_that_support_robust_loss(name: str, spoilt: Trial) -> None:
    robust, plain = (
        fit(spoilt, "linear", name, dof="yaw", delay=0.0, loss=loss).parameters["alpha_r"].value
        for loss in ("soft_l1", "linear")
    )
    assert abs(robust - SLOW[0]) < 0.5 * abs(plain - SLOW[0])


def test_outliers_do_not_move_a_robust_fit_with_effects(spoilt: Trial) -> None:
    robust, plain = (
        fit(spoilt, "linear", dof="yaw", effects=["quadratic-drag@yaw"], loss=loss).parameters["N_rdot"].value
        for loss in ("soft_l1", "linear")
    )
    assert abs(robust + SLOW[0]) < 0.5 * abs(plain + SLOW[0])


def test_outliers_cannot_be_both_down_weighted_and_explained(spoilt: Trial) -> None:
    with pytest.raises(UsageError, match="Omit --robust"):
        fit(spoilt, "linear", dof="yaw", effects=["outliers"], loss="soft_l1")


@pytest.mark.parametrize("name", bearing("robust", able=False))
def test_a_method_without_a_robust_loss_has_a_doubt(name: str, calm: list[Trial]) -> None:
    found = fit(calm[0], "nonlinear", name, dof="yaw", delay=0.0, loss="soft_l1")
    assert "outliers-not-weighed" in {d.slug for d in found.doubts}


@pytest.mark.parametrize("form", ["axis", "form", "effects"])
def test_a_coarse_compass_is_taken_as_rounding_in_every_form(form: str, calm: list[Trial]) -> None:
    psi = calm[0]["psi"]
    coarse = Channel("psi", "rad", psi.t[::5], DEG * np.round(psi.values[::5] / DEG))
    run = dataclasses.replace(calm[0], channels={"psi": coarse, "N": calm[0]["N"]})

    def of(found: Fit) -> float:
        return abs(found.parameters["alpha_r" if form == "axis" else "N_rdot"].value)

    if form == "axis":
        found: Fit = fit(run, "nonlinear", dof="yaw", delay=0.0)
    else:
        found = fit(run, FORM, delay=0.0, effects=["linear-drag@yaw"] if form == "effects" else ())
    assert found.extra["quantum"]["psi"] == pytest.approx(DEG)
    assert of(found) == pytest.approx(QUICK[0], rel=0.01)


@pytest.mark.parametrize("name", bearing("effects", able=False))
def test_a_method_without_effects_rejects_them(name: str, calm: list[Trial]) -> None:
    with pytest.raises(UsageError, match="output-error"):
        fit(calm[0], "nonlinear", name, dof="yaw", effects=["dead-zone@N"])
