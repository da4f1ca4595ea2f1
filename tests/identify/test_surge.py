"""A boat's surge from throttle steps under way: inertia, drag and thrust curve come apart."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gcs_autotune.identify import fit_axis, load_model, save_model
from gcs_autotune.identify.thrust import CURVE, fit_surge, set_on_the_way_back, square_of
from gcs_autotune.identify.thrust.surge import bent
from gcs_autotune.models import SingleDof, simulate
from gcs_autotune.trial import Channel, Mark, Trial
from gcs_autotune.workflow import StudySettings, study

LEVELS = ((0.6, 0.27, 0.8, 0.0, 0.6), (0.6, 0.0, 0.8, 0.42, 0.6))
DWELL = 12.0


def flown(model: SingleDof, square: float, levels: tuple[float, ...], seed: int, noise: float = 0.02) -> Trial:
    """Throttle steps as ``ThrottleSteps`` flies them: slewed, in steps of one percent, speed at 10 Hz."""
    t_in = np.arange(0.0, DWELL * len(levels), 0.02)
    required = np.array([levels[int(t / DWELL)] for t in t_in])
    X = np.empty_like(required)
    now = levels[0]
    for i, target in enumerate(required):
        now += np.clip(target - now, -0.02, 0.02)
        X[i] = round(100.0 * now) / 100.0
    thrust = (1.0 - square) * X + square * X * np.abs(X)
    t = np.arange(0.0, DWELL * len(levels), 0.1)
    start = model.steady_velocity(float(thrust[0]))
    u = simulate(model, t_in, thrust, t, nu_0=start).nu + noise * np.random.default_rng(seed).standard_normal(len(t))
    return Trial(f"throttle-{seed}", {"X": Channel("X", "1", t_in, X), "u": Channel("u", "m/s", t, u)})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("model", "square"),
    [
        (SingleDof("surge", "1", 4.0, 0.0, 0.444), 1.0),
        (SingleDof("surge", "1", 0.8, 0.25, 0.1), 0.5),
        (SingleDof("surge", "1", 0.04, 0.0, 0.01), 0.0),
    ],
    ids=["plain propeller", "half bent", "straight"],
)
def test_inertia_drag_and_thrust_curve_are_identified_within_their_errors(model: SingleDof, square: float) -> None:
    noise = 0.02 * max(model.steady_velocity(0.6) / 1.2, 1.0)
    fit = fit_surge([flown(model, square, levels, n, noise) for n, levels in enumerate(LEVELS)])
    std = fit.extra[CURVE]["std"]
    assert abs(square_of(fit) - square) < 3.5 * std
    assert std < 0.12
    assert fit.model.alpha == pytest.approx(model.alpha, abs=4.0 * fit.parameters["alpha_u"].std)
    for throttle in (0.2, 0.4, 0.6, 0.8):
        target = model.steady_velocity((1.0 - square) * throttle + square * throttle**2)
        q = square_of(fit)
        assert fit.model.steady_velocity((1.0 - q) * throttle + q * throttle**2) == pytest.approx(target, rel=0.03)
    assert "one-sided-input" not in {d.slug for d in fit.doubts}
    assert fit.extra["largest"] == {"X": 0.8}


def test_the_reported_thrust_curve_is_the_minimum_and_its_error_a_rise_of_one() -> None:
    """Beside shares far away, where the valley is steeper to one side, the bottom is missed by 2.5 standard errors."""
    levels = ((0.4, 0.18, 0.54, 0.0, 0.4), (0.4, 0.0, 0.54, 0.28, 0.4))
    runs = [flown(SingleDof("surge", "1", 0.378, 0.266), 0.0, level, n) for n, level in enumerate(levels)]
    curve = fit_surge(runs, delay=0.0).extra[CURVE]

    def misfit(square: float) -> float:
        bowed = [bent(run, square) for run in runs]
        return fit_axis(bowed, dof="surge", structure="affine", delay=0.0).residual_rms ** 2

    samples = sum(len(run["u"].t) for run in runs)
    least, *sides = (misfit(curve["square"] + way * curve["std"]) for way in (0.0, -1.0, 1.0))
    assert [samples * (side / least - 1.0) for side in sides] == pytest.approx([1.0, 1.0], abs=0.1)


def test_a_current_above_the_slowest_speed_is_removed_and_reported() -> None:
    """Over ground the coasting boat goes on for ever one way, and backwards the other."""
    model, water, runs = SingleDof("surge", "1", 4.0, 0.0, 0.444), 0.3, []
    for n, (levels, psi) in enumerate(zip(LEVELS, (0.0, np.pi), strict=True)):
        still = flown(model, 1.0, levels, n)
        u = still["u"].values + water * np.cos(psi)
        marks = tuple(
            Mark(DWELL * (k + 1), "steady", {"u": float(u[int(10 * DWELL * (k + 1)) - 5]), "level": level})
            for k, level in enumerate(levels)
        )
        psis = Channel("psi", "rad", still["u"].t, np.full(len(u), psi))
        runs.append(
            replace(still, channels={**still.channels, "u": replace(still["u"], values=u), "psi": psis}, marks=marks)
        )
    fit = fit_surge(runs, structure="nonlinear", delay=0.0)
    assert fit.model.alpha == pytest.approx(model.alpha, rel=0.03)
    assert fit.model.beta_quadratic == pytest.approx(model.beta_quadratic, rel=0.06)
    assert any(d.slug == "set-along-the-track" and "0.3" in d.cause for d in fit.doubts)


def test_a_surge_model_is_saved_with_its_thrust_curve(tmp_path) -> None:
    model = SingleDof("surge", "1", 4.0, 0.0, 0.444)
    fit = fit_surge([flown(model, 1.0, levels, n) for n, levels in enumerate(LEVELS)])
    path = tmp_path / "model.json"
    save_model(fit, path)
    curve = load_model(path).model.effects[-1]
    assert curve.slug == "quadratic-actuator"
    assert curve["share"] == pytest.approx(1.0, abs=0.1)


def test_the_thrust_curve_keeps_full_throttle_and_sign() -> None:
    X = Channel("X", "1", np.arange(4.0), np.array([-1.0, -0.5, 0.5, 1.0]))
    assert bent(Trial("t", {"X": X}), 1.0)["X"].values == pytest.approx([-1.0, -0.25, 0.25, 1.0])


@pytest.mark.slow
def test_identify_fits_the_thrust_curve_and_predicts_with_it(tmp_path: Path) -> None:
    """A fit of the same runs with a fixed damping and no thrust curve explains far less."""
    model = SingleDof("surge", "1", 4.0, 0.0, 0.444)
    runs = [flown(model, 1.0, levels, n) for n, levels in enumerate(LEVELS)]
    meant = [replace(run, meta={"thrust_curve": True, "dof": "surge"}) for run in runs]
    found = study(meant, [], StudySettings(), "2026-01-01T00:00:00")
    fixed = StudySettings(dof="surge", structure="affine", check=False)
    plain = study(runs, [], fixed, "2026-01-01T00:00:00")
    assert abs(found.fit.extra[CURVE]["square"] - 1.0) < 3.5 * found.fit.extra[CURVE]["std"]
    assert found.fit.fit_percent > plain.fit.fit_percent + 10.0
    assert found.answer.unseen is not None
    assert found.answer.unseen.fit_percent > 85.0
    path = tmp_path / "model.json"
    save_model(found.fit, path)
    assert [effect.slug for effect in load_model(path).model.effects] == ["quadratic-actuator"]


def with_steady(run: Trial, heading: float, levels: dict[float, float]) -> Trial:
    """Return *run* on a *heading* with a level begun and steady speeds marked."""
    t = run["u"].t
    marks = [Mark(0.0, "level", {"X": 0.6})]
    marks += [Mark(float(t[-1]), "steady", {"u": u, "level": level}) for level, u in levels.items()]
    psi = Channel("psi", "rad", t, np.full(len(t), heading))
    return replace(run, channels={**run.channels, "psi": psi}, marks=tuple(marks))


def on_heading(run: Trial, heading: float, water: float) -> Trial:
    """Return *run* on a *heading* [rad], its speed over ground in a current that sets north at *water* [m/s]."""
    u = replace(run["u"], values=run["u"].values + water * np.cos(heading))
    psi = Channel("psi", "rad", u.t, np.full(len(u.t), heading))
    steady = Mark(float(u.t[-1]), "steady", {"u": float(u.values[-1]), "level": 0.6})
    return replace(run, channels={**run.channels, "u": u, "psi": psi}, marks=(steady,))


@pytest.mark.parametrize("square", [0.0, 1.0])
@pytest.mark.parametrize(
    "water", [0.0, pytest.param(0.02, marks=pytest.mark.slow), 0.15, pytest.param(-0.3, marks=pytest.mark.slow)]
)
def test_a_run_in_the_opposite_direction_shows_the_current(water: float, square: float) -> None:
    model = SingleDof("surge", "1", 4.0, 0.0, 0.444) if square else SingleDof("surge", "1", 0.4, 0.3, 0.0)
    out, back = (on_heading(flown(model, square, LEVELS[n], n), n * np.pi, water) for n in (0, 1))
    fit = fit_surge([out])
    found = set_on_the_way_back(fit, out, replace(back, marks=()))
    assert found is not None
    assert found.set == pytest.approx(water, abs=0.2 * abs(water) + 0.005)
    assert found.is_none is (abs(water) < 0.03)
    assert set_on_the_way_back(fit, out, on_heading(back, 1.0, 0.0)) is None, "no way back"
    assert set_on_the_way_back(fit, out, replace(back, channels={"psi": back["psi"]})) is None
    result = [d.slug for d in fit_surge([out], along=found).doubts]
    assert ("set-along-the-track" in result) is (abs(water) > 0.05)


def test_the_cure_of_a_one_sided_surge_input_is_throttle_steps() -> None:
    fit = fit_axis([flown(SingleDof("surge", "1", 0.4, 0.3, 0.0), 0.0, LEVELS[0], 0, 0.02)], dof="surge")
    cures = [d.cure for d in fit.doubts if d.slug == "one-sided-input"]
    assert cures
    assert "throttle-steps" in cures[0]
    assert "zig-zag" not in cures[0]
